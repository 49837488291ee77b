"""Out-of-sample simulation: each member of the forecast is flown as the truth by a drone whose forecast lacks it.

Its neighbours are lacking, too; queues, gusts and errors of energy are sampled. The realizations are the same for all routes
of one request, and the promises of the chosen one are counted in others than it was chosen in.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import weighted_quantile
from skyway.models.wind.ensemble import evenly
from skyway.planner.schedule.audit import Realization
from skyway.planner.schedule.gust_kernels import Disturbance, no_disturbance
from skyway.planner.schedule.itinerary import fly_as_it_stands, place_nodes
from skyway.planner.schedule.outcome import outcome
from skyway.planner.schedule.schedule_kernels import ROOM, SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN
from skyway.planner.schedule.typical import Runs, typical_schedule

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.sampling import QueuePath
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome
    from skyway.planner.schedule.typical import Typical

CHOOSING, PROMISING = range(2)
"""Sets of realizations: one to compare routes in, and one to count the promises of the chosen route in."""
_GUSTS = 0x47
_NEARLY_NONE = 0.05


def _queues(problem: Problem) -> tuple[int, int]:
    """Sampled sets of queues in each of ``CHOOSING`` and ``PROMISING``."""
    return problem.parameters.robust.choosing_queues, problem.parameters.robust.promising_queues


def left_out(ensemble: WindEnsemble, apart_days: int = 2) -> NDArray[np.float64]:
    """Forecast for each member as the truth, shape (members, members): the others that are not its neighbours."""
    labels = ensemble.labels
    try:
        days = np.array([date.fromisoformat(label).toordinal() for label in labels])
        near = np.abs(days[:, None] - days[None]) < apart_days
    except ValueError:
        near = np.eye(len(labels), dtype=bool)
    share = np.where(near, 0.0, ensemble.probability[None])
    lonely = share.sum(axis=1) <= 0.0
    share[lonely] = ensemble.probability
    return np.ascontiguousarray(share / share.sum(axis=1, keepdims=True))


def simulated_realizations(
    problem: Problem,
    itinerary: Itinerary,
    errors: Errors,
    runs: int,
    max_realizations: int | None = None,
    sample_set: int = CHOOSING,
) -> tuple[NDArray[np.int64], Disturbance, list[QueuePath]]:
    """Realizations in which routes are tried, the same for all of one request: (member of each run, its sky, queue paths).

    Paths are those of the sets at the stop before each flight, in order (set, leg). See `ChargePolicy.simulate`.
    """
    count = len(problem.probability)
    chosen = evenly(count, count if max_realizations is None else max_realizations)
    members = np.repeat(chosen, max(1, round(runs / len(chosen))))
    sample = np.arange(len(members)) % _queues(problem)[sample_set]
    paths = queue_sets(problem, itinerary, sample_set)
    rng = np.random.default_rng((problem.request.seed, _GUSTS, sample_set))
    key = rng.integers(0, 2**64, len(members), dtype=np.uint64)
    flights = len(itinerary) + problem.needs_escape  # the way on is one more
    energy = errors.energy_of(problem.drone).sampled(rng, len(members), flights)
    return members, Disturbance(sample, energy, key, errors.gust_sd, errors.gust_time_s), paths


def queue_sets(problem: Problem, itinerary: Itinerary, sample_set: int) -> list[QueuePath]:
    """Sampled queues at each of `planner.schedule.itinerary.place_nodes`, in order (set, place)."""
    return queues_at(problem, place_nodes(problem, itinerary), sample_set)


def queues_at(problem: Problem, nodes: Sequence[int], sample_set: int) -> list[QueuePath]:
    """Sampled queues at each of some nodes, in order (set, node)."""
    first = sum(_queues(problem)[:sample_set])
    sets = problem.queue_sets(nodes, range(first, first + _queues(problem)[sample_set]))
    return [found[node] for found in sets for node in nodes]


def realization_of(problem: Problem, itinerary: Itinerary, typical: Typical) -> Realization:
    """Return the realization of ``PROMISING`` in which a typical schedule was flown, for its audit."""
    queues = None
    if typical.queue is not None:
        sample = sum(_queues(problem)[:PROMISING]) + typical.queue
        queues = problem.queue_paths(place_nodes(problem, itinerary), sample)
    return Realization(typical.member, queues)


def simulate_fixed(problem: Problem, itinerary: Itinerary, errors: Errors, runs: int) -> Runs:
    """Fly an itinerary as it stands in the realizations in which the promises of a `ChargePolicy` are counted."""
    members, disturbance, paths = simulated_realizations(problem, itinerary, errors, runs, sample_set=PROMISING)
    schedule = fly_as_it_stands(problem, itinerary, members, disturbance, paths)
    weight = problem.probability[members]
    return Runs(schedule, weight / weight.sum(), members, disturbance.queue)


def typical_fixed(problem: Problem, itinerary: Itinerary, runs: Runs) -> Typical:
    """Choose the typical schedule of an itinerary that is flown as it stands; see `planner.schedule.typical`."""
    paths = queue_sets(problem, itinerary, PROMISING)

    def fly(members: NDArray[np.int64], queues: NDArray[np.int64]) -> NDArray[np.float64]:
        return fly_as_it_stands(problem, itinerary, members, no_disturbance(len(members))._replace(queue=queues), paths)

    return typical_schedule(runs, problem.reserve, fly, problem.parameters.schedule)


@dataclass(frozen=True, eq=False)
class OutOfSample(Runs):
    """A policy flown out of sample, each member the truth of some runs."""

    energy_ratio: NDArray[np.float64]
    """Shape (runs, legs), or one more where the way on is one. Energy of each flight as a share of what it was charged for; that of the
    way on 0 where it keeps the reserve."""
    tables: NDArray[np.float64]
    """See `planner.robust.required_soc_kernels.required_soc_tables`."""
    onward_soc: NDArray[np.float64] | None = None
    """Shape (runs,). Charge on landing after the way on from a target without pads; None where none is needed."""

    @property
    def arrival_s(self) -> NDArray[np.float64]:
        """Arrival of each run, POSIX seconds, infinite where there is none."""
        return self.schedule[:, -1, TOUCH_DOWN]

    @property
    def waits_for_room(self) -> bool:
        """Whether room at the next station holds any run that never leaves; most of them are held by their charge alone."""
        held_s = self.schedule[:, :, ROOM][np.isinf(self.schedule[:, :, TAKE_OFF])]
        return bool((np.isfinite(held_s) & (held_s > 0.0)).any())

    @property
    def held_before_last(self) -> float:
        """For how long nearly all deliveries are held before the last flight, s: until it may end."""
        arrives = np.isfinite(self.schedule[:, -1, TOUCH_DOWN])
        if not arrives.any():
            return 0.0
        return weighted_quantile(self.schedule[arrives, -1, ROOM], self.weight[arrives], _NEARLY_NONE)

    @property
    def charging(self) -> NDArray[np.float64]:
        """Share of the runs that charge at the stop before each flight, shape (legs,); the first one counts always."""
        charged = np.ones(self.schedule.shape[:2], dtype=bool)
        charged[:, 1:] = self.schedule[:, 1:, SOC_TAKE_OFF] > self.schedule[:, :-1, SOC_LANDING] + 1e-9
        return np.asarray(self.weight @ charged)

    @property
    def charge_used(self) -> float:
        """Mean charge that the flights of a run take together, as SoC."""
        flown = np.isfinite(self.schedule[:, :, TOUCH_DOWN])
        used = np.where(flown, self.schedule[:, :, SOC_TAKE_OFF], 0.0) - np.where(
            flown, self.schedule[:, :, SOC_LANDING], 0.0
        )
        return float(self.weight @ used.sum(axis=1))

    def outcome(self, problem: Problem, itinerary: Itinerary | None = None) -> Outcome:
        """Sum the runs up; what they spend, too, given the itinerary."""
        groups = self.member, self.queue
        return outcome(problem, self.schedule, self.weight, groups, itinerary=itinerary, onward_soc=self.onward_soc)


def margin_for(simulations: Sequence[OutOfSample], epsilon: float) -> float:
    """Least margin with which at most a share epsilon of simulated deliveries would have broken the reserve.

    A delivery breaks it where one of its flights takes more energy than was charged for, which the flight's energy ratio
    tells; the margin is the energy ratio that a share epsilon of the deliveries exceeds, 0 where that is below 1.
    """
    worst = np.concatenate([found.energy_ratio.max(axis=1) for found in simulations])
    weight = np.concatenate([found.weight for found in simulations])
    order = np.argsort(-worst)
    above = np.cumsum(weight[order]) / weight.sum()
    at = int(np.searchsorted(above, epsilon, side="right"))
    return max(float(worst[order][min(at, len(order) - 1)]) - 1.0, 0.0)
