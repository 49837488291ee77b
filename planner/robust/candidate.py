"""A route that `robust` considers: its charging rule, and its out-of-sample results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.planner.robust.charge_policy import ChargePolicy
    from skyway.planner.robust.out_of_sample import OutOfSample
    from skyway.planner.schedule.outcome import Outcome


@dataclass(frozen=True, eq=False)
class Candidate:
    """A route with its charging rule, and its results."""

    policy: ChargePolicy
    """Flights and rule."""
    outcome: Outcome
    """Out of sample."""
    unsafe: bool
    """It violates the reserve more often than allowed, beyond sampling error."""
    loss: tuple[float, ...]
    """See `planner.problem.objective.Objective.loss`."""
    out_of_sample: OutOfSample
    """The runs behind the outcome; the same realizations for all candidates of a comparison."""

    @property
    def stops(self) -> tuple[int, ...]:
        """Nodes landed at, in order."""
        head = self.policy.problem.network.head
        return tuple(int(head[leg.segments[-1]]) for leg in self.policy.itinerary)

    @property
    def flights(self) -> tuple[tuple[int, ...], ...]:
        """Segments of each flight: what tells routes apart."""
        return tuple(leg.segments for leg in self.policy.itinerary)

    def order(self) -> tuple[float, ...]:
        """Sort key of candidates: arrival, then keeping the reserve, then the objective."""
        least = self.policy.problem.parameters.robust.min_arrival
        return self.outcome.p_arrive < least, self.unsafe, *self.loss
