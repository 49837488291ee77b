"""A mission flown battery by battery: the interface between the supervisor and the planner of the work.

`skyway.recharge` implements the planner. Points of the work and pads are numbers, as in `missions.recharge`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.legs import LegMission
    from skyway.missions.autopilots.family import Family
    from skyway.missions.recharge.spans import Done, Span
    from skyway.models.composition.composition import Composition
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.wind.ensemble import WindEnsemble


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """Information at a decision."""

    time_s: float
    """POSIX seconds."""
    soc: float
    forecast: WindEnsemble
    """Forecast updated with measurements."""
    belief: EnergyBelief


@dataclass(frozen=True, slots=True, kw_only=True)
class Aloft(Known):
    """Information at a decision in flight."""

    span: Span
    """The present flight."""
    item: int
    """Current item, in our numbering."""
    done: Done | None
    """Progress of the work; None before its first place."""
    place: tuple[float, float]
    height_m: float
    """Above the ground at the start of the flight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Expected end of the rest of a flight."""

    left_s: float
    left_soc: float
    """By the model, without the belief about the drone."""
    soc_land: float
    p_below: float
    """Probability that it lands below the reserve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkFlight:
    """One flight, ready to be uploaded."""

    span: Span
    mission: LegMission
    reaches: tuple[Done | None, ...]
    """Progress of the work when each item is reached."""
    origin: str
    destination: str
    """Station."""
    diverts: tuple[str, ...]
    """Divert pads."""
    planned_s: float
    modelled_soc: float
    """Modelled charge."""
    soc_land: float
    soc_sd: float
    speed_mps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkPlan:
    """Plan of the remaining work."""

    span: Span
    """The next flight."""
    charge_to: float
    """Charge at departure."""
    leave_s: float
    """Earliest take-off, POSIX seconds."""
    composition: Composition
    said: str
    """Reason, a sentence."""
    figures: Mapping[str, Any] = field(default_factory=dict)


class WorkPlanner(Protocol):
    """Planner of the work; raises an `InputError` if no flight is possible."""

    @property
    def epsilon(self) -> float:
        """Accepted probability that a landing misses the reserve."""
        ...

    @property
    def transit_mps(self) -> float:
        """Ground speed of ways to pads: assumed by `refuge`, and flown by a divert."""
        ...

    def plan(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Plan the remaining work: from the start, or from a point of the work and the pad of the drone."""
        ...

    def as_cut(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Return the rest of the plan made before the first take-off."""
        ...

    def flight(self, family: Family, span: Span, known: Known) -> WorkFlight:
        """Build the mission of a flight; the same span gives the same mission."""
        ...

    def judge(self, family: Family, aloft: Aloft) -> Judgement:
        """Predict the rest of the current flight."""
        ...

    def earlier(self, family: Family, aloft: Aloft, judged: Judgement) -> tuple[Span, Judgement] | None:
        """Return the flight that leaves the work at a place where it keeps the reserve, and its judgement; None if there is none."""
        ...

    def refuge(self, aloft: Aloft) -> tuple[str, Judgement] | None:
        """Return the pad that takes least charge to reach, and the judgement of that flight; None if no pad is permitted."""
        ...

    def pad_of(self, station: str | None) -> int | None:
        """Return the pad at a station; None if it has none."""
        ...

    def point_at(self, done: Done | None) -> int:
        """Return the last point, with this progress, at which the work may be left and continued."""
        ...

    def is_done(self, span: Span, done: Done | None) -> bool:
        """Whether all work of a flight is done."""
        ...
