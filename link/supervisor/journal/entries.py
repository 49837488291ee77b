"""Data of each kind of record of the journal; `docs/reference/journal.md` describes the same for readers of files."""

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


class Start(Entry, frozen=True, kw_only=True, tag="start"):
    """The first record: all that a report, or a resume, needs of the beginning."""

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
    hands_over: bool | None = None

    @property
    def delivers(self) -> bool:
        """Whether a package is to be handed over at the end; one whose journal does not say so delivers what it carries."""
        return self.payload_kg != 0.0 if self.hands_over is None else self.hands_over


class Met(Entry, frozen=True, kw_only=True, tag="vehicle"):
    """The vehicle was connected."""

    system: int | None
    autopilot: str | None
    uid: int | None


class StateEntered(Entry, frozen=True, kw_only=True, tag="state"):
    """A state was entered."""

    before: str | None
    after: str | None


class PlanTaken(Entry, frozen=True, kw_only=True, tag="plan"):
    """A plan came into force: a composition from here on, or none."""

    SPREAD: ClassVar[Mapping[str, str]] = {"standing": ""}
    plan: dict[str, Any] | None
    standing: Standing


class WentOn(Entry, frozen=True, kw_only=True, tag="onward"):
    """The package was delivered, or could not be: the drone continues from the target by this plan, not before `leave_s`."""

    destination: str | None
    loaded: bool | None
    delivered: bool | None
    leave_s: float | None
    plan: dict[str, Any] | None


class Decided(Entry, frozen=True, kw_only=True, tag="decision"):
    """A decision, with its `figures`."""

    SPREAD: ClassVar[Mapping[str, str]] = {"figures": ""}
    action: str | None
    where: str | None
    figures: dict[str, Any]

    def numbers(self) -> dict[str, float]:
        """Return the figures that are finite numbers."""
        return {key: one for key in self.figures if (one := of_number(self.figures, key)) is not None}

    @property
    def new_plan(self) -> bool | None:
        """Whether the decision put another plan in force."""
        value = self.figures.get("new_plan")
        return value if isinstance(value, bool) else None


class Resumed(Entry, frozen=True, kw_only=True, tag="resume"):
    """The program was restarted: `last` record found, or the `mode` in which the vehicle was found."""

    last: int | None = None
    mode: str | None = None


class Ended(Entry, frozen=True, kw_only=True, tag="end"):
    """The last record."""

    outcome: str | None
    station: str | None
    flights: int | None


# Work that is flown battery by battery


class WorkStands(Entry, frozen=True, kw_only=True, tag="work-stands"):
    """State of the work: done up to a point, to be continued from a pad; or finished."""

    point: int | None
    pad: str | None
    finished: bool | None


class WorkBegun(Entry, frozen=True, kw_only=True, tag="work-flight"):
    """A flight of the work is about to begin: from a point and a pad (none: the start) to a point and a pad (none: the end)."""

    begin_point: int | None
    begin_pad: int | None
    end_point: int | None
    end_pad: int | None


class WorkDone(Entry, frozen=True, kw_only=True, tag="work-done"):
    """Another point of the work was passed: the step of the unrolled mission, and the share of its leg."""

    step: int | None
    share: float | None


class WorkTurned(Entry, frozen=True, kw_only=True, tag="work-turn"):
    """The flight leaves the work earlier, at a point for a pad; `begun` before it is commanded."""

    point: int | None = None
    pad: int | None = None
    begun: bool | None = None
    verified: bool | None = None


# Before a take-off


class ListDone(Entry, frozen=True, kw_only=True, tag="preflight"):
    """The checklist was completed."""

    checks: tuple[Checked, ...]
    failsafes: dict[str, Any]


class CheckDone(Entry, frozen=True, kw_only=True, tag="check"):
    """First verdict of an entry of the checklist, or a change of its verdict."""

    name: str | None
    verdict: str | None
    said: str | None
    waits: bool | None


class Waiting(Entry, frozen=True, kw_only=True, tag="waits"):
    """A wait of the checklist."""

    left_s: float | None


class Briefed(Entry, frozen=True, kw_only=True, tag="briefing"):
    """The briefing of the operator before a take-off."""

    lines: tuple[str, ...]
    diverts: tuple[str, ...]
    by_itself: tuple[str, ...]
    wind: Winds
    wind_origin: str | None
    parameters: tuple[ParameterToSet, ...]


class ParameterNote(Entry, frozen=True, kw_only=True, tag="parameter"):
    """A parameter is about to be set, was set, or was restored."""

    name: str | None = None
    done: str | None = None
    before: float | None = None
    after: float | None = None
    value: float | None = None
    names: tuple[str, ...] = ()


class Uploaded(Entry, frozen=True, kw_only=True, tag="upload"):
    """A transfer ended."""

    part: str | None
    verified: bool | None
    attempts: int | None


class StartNote(Entry, frozen=True, kw_only=True, tag="start"):
    """A take-off was refused, or not commanded."""


# The flight


class LegBegun(Entry, frozen=True, kw_only=True, tag="leg"):
    """A take-off is about to be commanded."""

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
    planned_soc_sd: float | None = None


class Tracked(Entry, frozen=True, kw_only=True, tag="track"):
    """Position at intervals; winds TOWARDS."""

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
        """Return the wind as measured at the vehicle, with its standard deviation, in words; None if not measured."""
        north, east, sigma = self.wind_north_mps, self.wind_east_mps, self.wind_sigma_mps
        if north is None or east is None or self.wind_source not in (None, "measured", "held"):
            return None
        earlier = ", earlier measurement" if self.wind_source == "held" else ""
        from_deg = math.degrees(math.atan2(-east, -north)) % 360.0
        return f"{wind_text(math.hypot(north, east), from_deg, sigma)}{earlier}"


class SpeedLimited(Entry, frozen=True, kw_only=True, tag="limit"):
    """The vehicle leans as far as its autopilot permits and is slower than commanded, or no longer so."""

    limited: bool | None
    lean_deg: float | None
    limit_deg: float | None
    ground_speed_mps: float | None
    commanded_mps: float | None


class Turned(Entry, frozen=True, kw_only=True, tag="turn"):
    """The vehicle is diverted in flight (no destination: it lands at its position); `begun` before it is commanded."""

    destination: str | None = None
    begun: bool | None = None
    verified: bool | None = None


class Landed(Entry, frozen=True, kw_only=True, tag="landed"):
    """A landing."""

    SPREAD: ClassVar[Mapping[str, str]] = {"standing": ""}
    soc: Share
    planned: bool | None
    planned_soc: Share
    planned_s: float | None
    flight_s: float | None
    standing: Standing


class EnergyLearnt(Entry, frozen=True, kw_only=True, tag="energy"):
    """Energy of a flight, and the belief after it."""

    used_soc: float | None
    modelled_soc: float | None
    factor: float | None
    sigma: float | None


class Truth(Entry, frozen=True, kw_only=True, tag="truth"):
    """True wind of a simulation; TOWARDS."""

    wind_north_mps: float | None
    wind_east_mps: float | None
    soc: Share


# On the ground


class PadAnswered(Entry, frozen=True, kw_only=True, tag="pad"):
    """A pad answered."""

    answer: str | None = None
    soc: float | None = None
    to_soc: Share = None
    place_in_line: int | None = None
    pad_free_s: float | None = None
    done_s: float | None = None


class CounterSet(Entry, frozen=True, kw_only=True, tag="battery"):
    """The vehicle's battery counter was set."""

    soc: Share
    reported: float | None


class ReleaseNote(Entry, frozen=True, kw_only=True, tag="release"):
    """The package was released, or could not be."""


class Proved(Entry, frozen=True, kw_only=True, tag="proof"):
    """Evidence that the package was delivered, or not; or a weighing at a take-off with it (`gain_w`)."""

    verdict: str | None = None
    acknowledged: bool | None = None
    by_person: bool | None = None
    how: str | None = None
    before: float | None = None
    before_sigma: float | None = None
    lost_s: float | None = None
    share: float | None = None
    sigma: float | None = None
    gain_w: float | None = None


# The vehicle, the link, the operator


class Changed(Entry, frozen=True, kw_only=True, tag="change"):
    """A change of the vehicle."""

    what: str | None
    before: str | None
    after: str | None
    ours: bool | None


class TextHeard(Entry, frozen=True, kw_only=True, tag="text"):
    """A new text of the vehicle, or a repeated one."""

    text: str | None
    severity: str | None
    count: int | None


class GaugeNote(Entry, frozen=True, kw_only=True, tag="gauge"):
    """A pad measured less, or more, than the vehicle reported; or charge was lost suddenly."""

    used_soc: float | None = None
    said_soc: float | None = None
    factor: float | None = None
    fell_soc: float | None = None


class LinkNote(Entry, frozen=True, kw_only=True, tag="link"):
    """An event of the link."""

    gone_s: float | None = None


class RadioMeasured(Entry, frozen=True, kw_only=True, tag="radio"):
    """Traffic of a radio, and its loss by sequence numbers, since the last record; `delay_s` behind the fastest radio."""

    radio: str | None
    used: bool | None
    received: int | None
    lost: int | None
    delay_s: float | None = None
    round_trip_s: float | None = None
    rssi: int | None = None
    noise: int | None = None
    remote_rssi: int | None = None
    remote_noise: int | None = None


class RemoteIdNote(Entry, frozen=True, kw_only=True, tag="remote-id"):
    """The Remote ID module was first checked, appeared, disappeared, or changed what it `lacks`; with the operator data sent to it."""

    heard: bool | None
    ready: bool | None
    lacks: str | None
    operator: str | None
    self_id: str | None


class LogsSeen(Entry, frozen=True, kw_only=True, tag="logs"):
    """The logs on the vehicle before the delivery, and the protocol that listed them; new ones are downloaded at its end."""

    by: str | None
    sizes_bytes: dict[str, Any]


class ClientNote(Entry, frozen=True, kw_only=True, tag="client"):
    """An action of another ground station to which the link is forwarded, or its refusal."""

    client: str | None
    system: int | None
    component: int | None
    what: str | None
    order: str | None


class AircraftNear(Entry, frozen=True, kw_only=True, tag="traffic"):
    """Another aircraft has come near."""

    aircraft: str | None
    lat: float | None
    lon: float | None
    away_m: float | None
    above_m: float | None


class GaveWay(Entry, frozen=True, kw_only=True, tag="give-way"):
    """The drone gives way to another aircraft, or continues: ``hold``, ``land``, ``go`` or ``ignored``; without `station` it holds in the air."""

    action: str | None
    aircraft: str | None = None
    away_m: float | None = None
    above_m: float | None = None
    station: str | None = None
    waited_s: float | None = None


class Rebooted(Entry, frozen=True, kw_only=True, tag="reboot"):
    """The vehicle has restarted."""


class SpeedNote(Entry, frozen=True, kw_only=True, tag="speed"):
    """A ground speed command was not accepted."""


class OperatorNote(Entry, frozen=True, kw_only=True, tag="operator"):
    """A question to the operator, or an input."""

    question: str | None = None
    answers: tuple[str, ...] = ()


class Ordered(Entry, frozen=True, kw_only=True, tag="order"):
    """A command of a person: `taken` or `refused`, and then `done` or `failed`; or a change of command authority (`holder`)."""

    word: str | None
    done: str | None
    id: str | None = None
    who: str | None = None
    name: str | None = None
    holder: str | None = None
    holder_name: str | None = None
