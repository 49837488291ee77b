"""A mission flown battery by battery: the supervisor's view of it, and its requirements on the planner.

`skyway.recharge` plans; here is what is said between the two. Points of the work and pads are numbers, as in `missions.recharge`.
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
    """Brought up to date with what was measured."""
    belief: EnergyBelief


@dataclass(frozen=True, slots=True, kw_only=True)
class Aloft(Known):
    """The same in flight."""

    span: Span
    """The flight under way."""
    item: int
    """Item that is flown to, in our numbering."""
    done: Done | None
    """How far the work is done; None before its first place."""
    place: tuple[float, float]
    height_m: float
    """Above the ground that the flight began on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Expected end of the rest of a flight."""

    left_s: float
    left_soc: float
    """By the model, without what is believed of the drone."""
    soc_land: float
    p_below: float
    """Probability that it lands below the reserve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkFlight:
    """One flight, ready to be uploaded."""

    span: Span
    mission: LegMission
    reaches: tuple[Done | None, ...]
    """Of each item: how far the work is done when it is reached."""
    origin: str
    destination: str
    """Stations."""
    diverts: tuple[str, ...]
    """Pads that it may be sent to instead."""
    planned_s: float
    modelled_soc: float
    """Charge by the model."""
    soc_land: float
    soc_sd: float
    speed_mps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkPlan:
    """Plan of the remaining work."""

    span: Span
    """The next flight."""
    charge_to: float
    """To leave with."""
    leave_s: float
    """POSIX seconds; not before."""
    composition: Composition
    said: str
    """A sentence."""
    figures: Mapping[str, Any] = field(default_factory=dict)


class WorkPlanner(Protocol):
    """Planner of the work; an `InputError` says why no flight is possible."""

    @property
    def epsilon(self) -> float:
        """A landing may miss the reserve with this probability."""
        ...

    @property
    def transit_mps(self) -> float:
        """Ground speed of ways to pads: what `refuge` reckons with, and a divert flies."""
        ...

    def plan(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Plan the remaining work: from the start, or from a point of the work and the pad where the drone stands."""
        ...

    def as_cut(self, family: Family, begin: tuple[int, int] | None, known: Known) -> WorkPlan:
        """Return what is left as it was cut before the first take-off."""
        ...

    def flight(self, family: Family, span: Span, known: Known) -> WorkFlight:
        """Make the mission of a flight; the same span makes the same mission."""
        ...

    def judge(self, family: Family, aloft: Aloft) -> Judgement:
        """Predict the rest of the current flight."""
        ...

    def earlier(self, family: Family, aloft: Aloft, judged: Judgement) -> tuple[Span, Judgement] | None:
        """Return the flight that leaves the work where it keeps the reserve after all, and what that comes to; None where none does."""
        ...

    def refuge(self, aloft: Aloft) -> tuple[str, Judgement] | None:
        """Return the pad that takes least charge to reach from here, and its prediction; None where no pad may be flown to."""
        ...

    def pad_of(self, station: str | None) -> int | None:
        """Return the pad at a station; None where it has none."""
        ...

    def point_at(self, done: Done | None) -> int:
        """Return the last point at which the work may be left and continued with that is done."""
        ...

    def is_done(self, span: Span, done: Done | None) -> bool:
        """Whether all work of a flight is done."""
        ...
