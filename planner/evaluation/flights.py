"""Outcomes of deliveries in realizations; a fixed itinerary is flown in all of them at once."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.queues.paths import pack
from skyway.planner.problem.kernel_inputs import check_whole
from skyway.planner.schedule.itinerary import fly_as_it_stands, place_nodes, stop_nodes
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.evaluation.realizations import Realizations
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.charge_policy import ChargePolicy
    from skyway.planner.schedule.gust_kernels import Disturbance
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome

DELIVERED, STRANDED, UNFLYABLE, GAVE_UP = range(4)
"""How a run ends: delivered; the charge was used up in flight; the wind never opened a flight within the horizon; the
policy found no way on, or none in the hours that a forecast reaches."""
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""On-time probabilities at which promises are compared with what happens."""


@dataclass(frozen=True, eq=False)
class Flown:
    """Outcomes of simulated deliveries."""

    block: NDArray[np.int64]
    """Shape (runs,). Ordinal of the day of each run."""
    ending: NDArray[np.int64]
    """Shape (runs,). ``DELIVERED``, ``STRANDED``, ``UNFLYABLE`` or ``GAVE_UP``."""
    below_reserve: NDArray[np.bool_]
    """Shape (runs,). A landing was below the reserve (a stranded run's was)."""
    lowest_soc: NDArray[np.float64]
    """Shape (runs,). Lowest charge at a landing; negative: stranded, infinite: it never took off."""
    delivery_s: NDArray[np.float64]
    flight_s: NDArray[np.float64]
    wait_s: NDArray[np.float64]
    recharge_s: NDArray[np.float64]
    """Shape (runs,) each. Of delivered runs, else NaN; the first is the sum of the others. Hovering for a holding spot
    is flight, holding for wind is waiting."""
    kept: NDArray[np.bool_] = field(default_factory=lambda: np.empty((0, len(LEVELS)), dtype=bool))
    """Shape (runs, levels). The delivery came by the deadlines that are the quantiles `LEVELS` of what was promised;
    empty without promises."""
    promised: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, len(LEVELS))))
    """Shape (runs, levels). Probability promised of each of these deadlines: the level, or more where many arrivals are
    promised at one moment."""
    clairvoyant_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Shape (runs,). Delivery time of a planner that is told this truth (without gusts and error of energy), NaN where
    unknown."""

    def __len__(self) -> int:
        return len(self.block)

    @property
    def delivered(self) -> NDArray[np.bool_]:
        """Whether the package arrived, shape (runs,)."""
        return np.asarray(self.ending == DELIVERED)

    def judged(self, promise: Outcome, depart_s: float) -> Flown:
        """Compare with what was promised at planning time."""
        due = np.array([promise.quantile_s(level) for level in LEVELS])
        promised = np.array([promise.p_by(deadline) for deadline in due])
        time = np.where(self.delivered, self.delivery_s, np.inf)
        kept = time[:, None] <= due - depart_s + 1e-6
        return replace(self, kept=kept, promised=np.broadcast_to(promised, kept.shape))

    def chosen(self, runs: NDArray[np.bool_] | NDArray[np.int64]) -> Flown:
        """Some of the runs."""
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return Flown(**{name: values[runs] if len(values) == len(self) else values for name, values in columns.items()})


def pooled(parts: Sequence[Flown]) -> Flown:
    """Join runs of several plans; promises and clairvoyant times stay where all parts have them."""
    total = sum(len(part) for part in parts)
    joined: dict[str, Any] = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Flown)}
    for name in ("kept", "promised", "clairvoyant_s"):
        if len(joined[name]) != total:
            joined[name] = joined[name][:0]
    return Flown(**joined)


def fly_itinerary(realizations: Realizations, drone: str, itinerary: Itinerary) -> Flown:
    """Fly a fixed itinerary in all realizations.

    Raises an `InputError` if it does not lead from the origin of their request to its destination.
    """
    problem = realizations.problem(drone)
    check_whole(problem, itinerary)
    runs = np.arange(len(realizations))
    return tally(problem, itinerary, realizations.block, schedules(realizations, problem, itinerary, runs))


def fly_charging(realizations: Realizations, drone: str, policy: ChargePolicy) -> Flown:
    """Fly a route that charges by what is known at each stop in all realizations; refuses what `fly_itinerary` refuses."""
    problem = realizations.problem(drone)
    check_whole(problem, policy.itinerary)
    disturbance, paths = _met(realizations, problem, policy.itinerary, np.arange(len(realizations)))
    schedule, _ = policy.fly(problem, disturbance, realizations.day, paths)
    return tally(problem, policy.itinerary, realizations.block, schedule)


def _met(
    realizations: Realizations, problem: Problem, itinerary: Itinerary, runs: NDArray[np.int64]
) -> tuple[Disturbance, PackedPaths]:
    """Return what an itinerary meets in some realizations, and the sets of queues that it names, in order (place, set)."""
    nodes = place_nodes(problem, itinerary)
    wanted, position = np.unique(realizations.queue[runs], return_inverse=True)
    sets = [realizations.queues(problem, nodes, queue) for queue in wanted.tolist()]
    disturbance = realizations.disturbance(problem.drone, runs)._replace(queue=position.astype(np.int64))
    return disturbance, pack([found[node] for node in nodes for found in sets])


def schedules(
    realizations: Realizations, problem: Problem, itinerary: Itinerary, runs: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Schedule of an itinerary in some realizations, shape (runs, legs, 7); see `schedule_kernels`."""
    disturbance, paths = _met(realizations, problem, itinerary, runs)
    return fly_as_it_stands(problem, itinerary, realizations.day[runs], disturbance, paths)


def tally(problem: Problem, itinerary: Itinerary, block: NDArray[np.int64], schedule: NDArray[np.float64]) -> Flown:
    """Return the outcomes of runs of one itinerary, from their schedules, shape (runs, legs, 7)."""
    down, soc = schedule[:, :, TOUCH_DOWN], schedule[:, :, SOC_LANDING]
    begun = np.isfinite(down)
    lowest = np.where(begun, soc, np.inf).min(axis=1)
    ending = np.full(len(schedule), DELIVERED)
    ending[~begun.all(axis=1)] = UNFLYABLE
    ending[lowest < 0.0] = STRANDED
    whole = ending == DELIVERED
    flown = schedule[whole]
    recharge = np.zeros(len(flown))
    for number, node in enumerate(stop_nodes(problem, itinerary)):
        before = flown[:, number - 1, SOC_LANDING] if number else np.full(len(flown), problem.soc)
        time, level = problem.curve(node)
        after = np.maximum(flown[:, number, SOC_TAKE_OFF], before)
        recharge += np.interp(after, level, time) - np.interp(before, level, time)
    delivery = flown[:, -1, TOUCH_DOWN] - problem.depart_s
    flight = (flown[:, :, TOUCH_DOWN] - flown[:, :, TAKE_OFF]).sum(axis=1)

    def spread(values: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.full(len(schedule), np.nan)
        out[whole] = values
        return out

    return Flown(
        block=block,
        ending=ending,
        below_reserve=lowest < problem.reserve - 1e-9,
        lowest_soc=lowest,
        delivery_s=spread(delivery),
        flight_s=spread(flight),
        wait_s=spread(delivery - flight - recharge),
        recharge_s=spread(recharge),
    )
