"""What each kind of record of the journal tells; `docs/reference/journal.md` is the same for readers of files."""

from __future__ import annotations

import math
from collections.abc import Mapping  # noqa: TC003  the annotations are read at run time
from typing import Any, ClassVar

from skyway.link.supervisor.journal.entry import Entry, Place, Share
from skyway.link.supervisor.journal.fields import number as of_number
from skyway.link.supervisor.journal.parts import (  # noqa: TC001  the annotations are read at run time
    Checked,
    Expected,
    Forecast,
    ParameterToSet,
    Standing,
    Winds,
)
from skyway.models.base.formatting import wind_text

# The delivery


class Start(Entry, frozen=True, kw_only=True):
    """The first record: all that a report, or a resume, needs of the beginning."""

    EVENT = "start"
    schema: str | None
    composition: dict[str, Any]
    planner: str | None
    supervised: bool | None
    replanning: dict[str, Any] | None
    release: str | None
    asking: str | None
    forecast: Forecast
    destination: str | None
    reserve_soc: Share
    payload_kg: float | None


class Met(Entry, frozen=True, kw_only=True):
    """The vehicle was met."""

    EVENT = "vehicle"
    system: int | None
    autopilot: str | None
    uid: int | None


class StateEntered(Entry, frozen=True, kw_only=True):
    """A state was entered."""

    EVENT = "state"
    before: str | None
    after: str | None


class PlanTaken(Entry, frozen=True, kw_only=True):
    """A plan came into force: a composition from here on, or none."""

    EVENT = "plan"
    SPREAD: ClassVar[Mapping[str, str]] = {"standing": ""}
    plan: dict[str, Any] | None
    standing: Standing


class Decided(Entry, frozen=True, kw_only=True):
    """Something was decided; `figures` are what it was decided by."""

    EVENT = "decision"
    SPREAD: ClassVar[Mapping[str, str]] = {"figures": ""}
    action: str | None
    where: str | None
    figures: dict[str, Any]

    def numbers(self) -> dict[str, float]:
        """Return the figures that are finite numbers."""
        return {key: one for key in self.figures if (one := of_number(self.figures, key)) is not None}

    @property
    def new_plan(self) -> bool | None:
        """Whether it put another plan in force."""
        value = self.figures.get("new_plan")
        return value if isinstance(value, bool) else None


class Resumed(Entry, frozen=True, kw_only=True):
    """The program was begun again: `last` record found, or the `mode` the vehicle was found in."""

    EVENT = "resume"
    last: int | None = None
    mode: str | None = None


class Ended(Entry, frozen=True, kw_only=True):
    """The last record."""

    EVENT = "end"
    outcome: str | None
    station: str | None
    flights: int | None


# Before a take-off


class ListDone(Entry, frozen=True, kw_only=True):
    """The list was gone through."""

    EVENT = "preflight"
    checks: tuple[Checked, ...]
    failsafes: dict[str, Any]


class CheckDone(Entry, frozen=True, kw_only=True):
    """An entry of the list was looked at first, or its verdict changed."""

    EVENT = "check"
    name: str | None
    verdict: str | None
    said: str | None
    waits: bool | None


class Waiting(Entry, frozen=True, kw_only=True):
    """The list waits."""

    EVENT = "waits"
    left_s: float | None


class Briefed(Entry, frozen=True, kw_only=True):
    """The operator was told what a take-off is decided by."""

    EVENT = "briefing"
    lines: tuple[str, ...]
    diverts: tuple[str, ...]
    by_itself: tuple[str, ...]
    wind: Winds
    wind_origin: str | None
    parameters: tuple[ParameterToSet, ...]


class ParameterNote(Entry, frozen=True, kw_only=True):
    """A parameter is about to be set, was set, or was put back."""

    EVENT = "parameter"
    name: str | None = None
    done: str | None = None
    before: float | None = None
    after: float | None = None
    value: float | None = None
    names: tuple[str, ...] = ()


class Uploaded(Entry, frozen=True, kw_only=True):
    """A transfer ended."""

    EVENT = "upload"
    part: str | None
    verified: bool | None
    attempts: int | None


class StartNote(Entry, frozen=True, kw_only=True):
    """A take-off was refused, or not begun."""

    EVENT = "start"


# The flight


class LegBegun(Entry, frozen=True, kw_only=True):
    """A take-off is about to be commanded."""

    EVENT = "leg"
    SPREAD: ClassVar[Mapping[str, str]] = {"standing": ""}
    origin: str | None
    destination: str | None
    via: tuple[str, ...]
    way: tuple[Place, ...]
    planned_s: float | None
    planned_soc: Share
    wind: Winds
    wind_origin: str | None
    soc: Share
    told_soc: Share
    ground_speed_mps: float | None
    last: bool | None
    standing: Standing


class Tracked(Entry, frozen=True, kw_only=True):
    """Where it is, from time to time; winds TOWARDS."""

    EVENT = "track"
    SPREAD: ClassVar[Mapping[str, str]] = {"forecast": "forecast_", "believed": "believed_", "expected": ""}
    lat: float | None
    lon: float | None
    height_m: float | None
    alt_msl_m: float | None
    soc: Share
    ground_speed_mps: float | None
    power_w: float | None
    mode: str | None
    armed: bool | None
    landed: bool | None
    forecast_north_mps: float | None
    forecast_east_mps: float | None
    forecast: Winds
    believed: Winds
    wind_north_mps: float | None = None
    wind_east_mps: float | None = None
    wind_sigma_mps: float | None = None
    wind_source: str | None = None
    expected: Expected
    modelled_soc: float | None = None

    def measured_words(self) -> str | None:
        """Return the wind as it was measured at the vehicle, with its sigma; None where it was not."""
        north, east, sigma = self.wind_north_mps, self.wind_east_mps, self.wind_sigma_mps
        if north is None or east is None or self.wind_source not in (None, "measured", "held"):
            return None
        earlier = ", measured earlier" if self.wind_source == "held" else ""
        from_deg = math.degrees(math.atan2(-east, -north)) % 360.0
        return f"{wind_text(math.hypot(north, east), from_deg, sigma)}{earlier}"


class SpeedLimited(Entry, frozen=True, kw_only=True):
    """It leans as far as its autopilot lets it and is slower than commanded, or no longer so."""

    EVENT = "limit"
    limited: bool | None
    lean_deg: float | None
    limit_deg: float | None
    ground_speed_mps: float | None
    commanded_mps: float | None


class Turned(Entry, frozen=True, kw_only=True):
    """It is sent elsewhere in flight (no destination: it lands here); `begun` before it is commanded."""

    EVENT = "turn"
    destination: str | None = None
    begun: bool | None = None
    verified: bool | None = None


class Landed(Entry, frozen=True, kw_only=True):
    """It stands."""

    EVENT = "landed"
    SPREAD: ClassVar[Mapping[str, str]] = {"standing": ""}
    soc: Share
    planned: bool | None
    planned_soc: Share
    planned_s: float | None
    flight_s: float | None
    standing: Standing


class EnergyLearnt(Entry, frozen=True, kw_only=True):
    """What a flight took, and the belief after it."""

    EVENT = "energy"
    used_soc: float | None
    modelled_soc: float | None
    factor: float | None
    sigma: float | None


class Truth(Entry, frozen=True, kw_only=True):
    """What really blows, in a simulation that knows it; TOWARDS."""

    EVENT = "truth"
    wind_north_mps: float | None
    wind_east_mps: float | None
    soc: Share


# On the ground


class PadAnswered(Entry, frozen=True, kw_only=True):
    """A pad answered."""

    EVENT = "pad"
    answer: str | None = None
    soc: float | None = None
    to_soc: Share = None
    place_in_line: int | None = None
    pad_free_s: float | None = None
    done_s: float | None = None


class CounterSet(Entry, frozen=True, kw_only=True):
    """The vehicle's counter was set."""

    EVENT = "battery"
    soc: Share
    reported: float | None


class ReleaseNote(Entry, frozen=True, kw_only=True):
    """The package was released, or could not be."""

    EVENT = "release"


# The vehicle, the link, the operator


class Changed(Entry, frozen=True, kw_only=True):
    """Something about the vehicle became different."""

    EVENT = "change"
    what: str | None
    before: str | None
    after: str | None
    ours: bool | None


class TextHeard(Entry, frozen=True, kw_only=True):
    """The vehicle said something new, or goes on saying it."""

    EVENT = "text"
    text: str | None
    severity: str | None
    count: int | None


class GaugeNote(Entry, frozen=True, kw_only=True):
    """A pad measured less, or more, than the vehicle said; or charge was lost at once."""

    EVENT = "gauge"
    used_soc: float | None = None
    said_soc: float | None = None
    factor: float | None = None
    fell_soc: float | None = None


class LinkNote(Entry, frozen=True, kw_only=True):
    """Something about the link."""

    EVENT = "link"
    gone_s: float | None = None


class Rebooted(Entry, frozen=True, kw_only=True):
    """The vehicle has restarted."""

    EVENT = "reboot"


class SpeedNote(Entry, frozen=True, kw_only=True):
    """A ground speed was not taken over."""

    EVENT = "speed"


class OperatorNote(Entry, frozen=True, kw_only=True):
    """The operator was asked, or said something."""

    EVENT = "operator"
    question: str | None = None
    answers: tuple[str, ...] = ()
