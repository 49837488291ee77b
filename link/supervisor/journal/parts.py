"""Groups of values that entries of the journal share: winds, data for a resume, expectations of a flight."""

from __future__ import annotations

from typing import Any

from skyway.link.supervisor.journal.entry import Part, Share
from skyway.models.wind.summary import WindSummary, summary_from


class Winds(Part, frozen=True, kw_only=True):
    """A summary of the expected winds; speeds in m/s, direction FROM, None: variable or unknown."""

    mean_mps: float | None = None
    p10_mps: float | None = None
    p90_mps: float | None = None
    from_deg: float | None = None
    sector_share: Share = None

    def words(self) -> str | None:
        """Return the wind in words; None if unknown."""
        found = summary_from({name: getattr(self, name) for name in self.__struct_fields__})
        return None if found is None else str(found)


def winds(summary: WindSummary) -> Winds:
    """Return a summary of winds as a part of the journal."""
    return Winds(**summary.as_data())


class Observation(Part, frozen=True, kw_only=True):
    """A wind measured in flight, see `models.wind.estimation.field.WindObservation`."""

    time_s: float | None
    lat_deg: float | None
    lon_deg: float | None
    north_mps: float | None
    east_mps: float | None
    variance: float | None
    height_m: float | None = None


class Standing(Part, frozen=True, kw_only=True):
    """State that a resume needs besides the plan."""

    station: str | None
    visited: tuple[str, ...]
    belief: dict[str, Any]
    diverts: tuple[str, ...]
    charge_to: Share
    asked_once: bool | None
    gauge: float | None
    lost_soc: float | None
    observations: tuple[Observation, ...]
    booted_s: float | None = None
    """When the vehicle's time since boot began, POSIX seconds by the clock of the journal."""


class Expected(Part, frozen=True, kw_only=True):
    """Expected end of a flight, from the last decision."""

    destination: str | None = None
    """Station id."""
    left_s: float | None = None
    late_s: float | None = None
    """`left_s`, `late_s`: flight time left, and delay of the landing against the plan at the take-off."""
    soc_land: Share = None
    planned_soc_land: Share = None
    p_below_reserve: Share = None
    """`soc_land`, `planned_soc_land`, `p_below_reserve`: charge at the landing: expected now, planned; probability that
    it is below the reserve."""
    cross_track_m: float | None = None
    """Distance from the route."""
    commanded_mps: float | None = None
    """Ground speed last sent."""
    believed_north_mps: float | None = None
    believed_east_mps: float | None = None
    """`believed_north_mps`, `believed_east_mps`: mean wind of the updated forecast, TOWARDS."""
    energy_factor: float | None = None
    """Ratio of the energy to that of the model."""
    limited: str | None = None
    """Cause of a limited speed."""


class Checked(Part, frozen=True, kw_only=True):
    """One entry of the checklist before a take-off."""

    name: str | None
    verdict: str | None
    said: str | None


class ParameterToSet(Part, frozen=True, kw_only=True):
    """A parameter that a take-off changes."""

    name: str | None
    now: float | None
    then: float | None
    why: str | None


class Forecast(Part, frozen=True, kw_only=True):
    """The forecast at the beginning of a delivery."""

    members: int | None = None
    labels: tuple[str, ...] = ()
    height_m: float | None = None
