"""Results of planners: the composition, and how it was found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.models.base.errors import InfeasibleError
    from skyway.models.composition.composition import Composition
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.robust import RobustAnswer
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome


@dataclass(frozen=True)
class PlanResult:
    """A composition, and how it was found.

    Attributes
    ----------
    composition : Composition
        The answer.
    itinerary : Itinerary
        The decisions behind it.
    problem : Problem
        What was solved.
    outcome : Outcome
        What the forecast makes of the itinerary.
    planning_time_s : float
        Wall time of the search.
    labels_expanded : int
        Flights or sequences evaluated, see the planner.
    rejected : dict of str to str
        Drones not chosen, and why.
    complete : bool
        False where a time limit cut the search off: the answer may not be the best.
    robust : RobustAnswer or None
        Of ``robust``: how the charge is decided at each stop, and what else was compared. None: the itinerary is
        flown unchanged.
    """

    composition: Composition
    itinerary: Itinerary
    problem: Problem
    outcome: Outcome
    planning_time_s: float
    labels_expanded: int
    rejected: dict[str, str] = field(default_factory=dict)
    complete: bool = True
    robust: RobustAnswer | None = None

    @property
    def mean_energy_j(self) -> float | None:
        """Mean energy of the flights over the simulated deliveries of ``robust``, beside `Composition.energy_j` of the typical schedule; None without it."""
        return None if self.robust is None else self.robust.out_of_sample.charge_used * self.problem.drone.battery_j

    def __repr__(self) -> str:
        return f"PlanResult({self.composition})"

    def _repr_html_(self) -> str:
        return self.composition._repr_html_()


@dataclass(frozen=True)
class Comparison:
    """One planner's answer, or why it has none."""

    planner: str
    result: PlanResult | None
    error: InfeasibleError | None
