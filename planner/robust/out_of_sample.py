"""Out-of-sample simulation: each member of the forecast is the true wind of a drone whose forecast excludes it.

Its neighbours are excluded, too; queues, gusts and errors of energy are sampled. The realizations are the same for all routes
of one request, and the promises of the chosen one are computed in realizations other than those of the choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.statistics import drawn_evenly, weighted_quantile
from skyway.models.wind.ensemble import evenly
from skyway.planner.schedule.audit import Realization
from skyway.planner.schedule.gust_kernels import Disturbance, no_disturbance
from skyway.planner.schedule.itinerary import fly_as_it_stands, place_nodes
from skyway.planner.schedule.outcome import outcome
from skyway.planner.schedule.schedule_kernels import PAD, ROOM, SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN
from skyway.planner.schedule.typical import Runs, typical_schedule

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome
    from skyway.planner.schedule.typical import Typical

CHOOSING, PROMISING = range(2)
"""Sets of realizations: one to compare routes, and one to compute the promises of the chosen route; different ones
for each number of runs."""
_GUSTS = 0x47
_NEARLY_NONE = 0.05
MARGIN_STEP = 2e-4
"""Resolution of calibrated margins."""
LEAST_SHARE = 1e-4
"""Least share for which a margin is calibrated by simulation; below it the charging rule relies on the assumed tail
of the energy distribution."""
_FIRST_MARGIN, _MOST_MARGIN = 0.05, 4.0


def left_out(ensemble: WindEnsemble, apart_days: int = 2) -> NDArray[np.float64]:
    """Return the forecast for each member as the truth, shape (members, members): the others that are not its neighbours."""
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


class SampledTruths(NamedTuple):
    """Realizations in which routes are tried."""

    members: NDArray[np.int64]
    """Shape (runs,). Member of the forecast that is the true wind of each run."""
    disturbance: Disturbance
    """Its queues, energy and gusts."""
    usual_ratio: NDArray[np.float64]
    """Shape (runs,). Persistent part of each vehicle's energy ratio to the model over the legs."""
    sample_set: int
    """Of whose queues."""

    @property
    def sets(self) -> int:
        """Sets of queues."""
        return int(self.disturbance.queue.max()) + 1


def simulated_realizations(
    problem: Problem,
    itinerary: Itinerary,
    errors: Errors,
    runs: int,
    max_realizations: int | None = None,
    sample_set: int = CHOOSING,
) -> SampledTruths:
    """Realizations in which routes are tried, the same for all of one request; see `ChargePolicy.simulate`.

    Each realization has its own gusts, and few share their queues (`RobustParameters.runs_per_queues`). Vehicles are drawn evenly, in each member and over all (`drawn_evenly`).
    """
    count = len(problem.probability)
    chosen = evenly(count, count if max_realizations is None else max_realizations)
    each = max(1, round(runs / len(chosen)))
    members = np.repeat(chosen, each)
    rng = np.random.default_rng((problem.request.seed, _GUSTS, sample_set))
    key = rng.integers(0, 2**64, len(members), dtype=np.uint64)
    flights = len(itinerary) + problem.needs_escape  # the way on is one more leg
    belief = errors.energy_of(problem.drone)
    shares = [drawn_evenly(rng, len(chosen), each) for _ in range(1 + flights)]
    usual, ratio = belief.ratios(np.column_stack(shares))
    sets = -(-len(members) // problem.parameters.robust.runs_per_queues_of(len(problem.network)))
    queue = np.arange(len(members)) % sets  # runs that share one are of different members
    disturbance = Disturbance(queue, ratio, key, errors.gust_sd, errors.gust_time_s)
    return SampledTruths(members, disturbance, usual, sample_set)


def realization_of(problem: Problem, itinerary: Itinerary, typical: Typical, runs: Runs) -> Realization:
    """Return the realization of ``PROMISING`` in which the typical schedule of runs was flown, for its audit."""
    queues = None
    if typical.queue is not None:
        nodes, until_s = place_nodes(problem, itinerary), np.full(runs.sets, -math.inf)
        until_s[typical.queue] = typical.schedule[-1, TOUCH_DOWN]
        queues = {node: problem.many_queues([node], PROMISING, runs.sets, until_s)[typical.queue] for node in nodes}
    return Realization(typical.member, queues)


def simulate_fixed(problem: Problem, itinerary: Itinerary, errors: Errors, runs: int) -> Runs:
    """Fly a fixed itinerary in the realizations in which the promises of a `ChargePolicy` are computed."""
    found = simulated_realizations(problem, itinerary, errors, runs, sample_set=PROMISING)
    paths = problem.many_queues(place_nodes(problem, itinerary), PROMISING, found.sets)
    schedule = fly_as_it_stands(problem, itinerary, found.members, found.disturbance, paths)
    weight = problem.probability[found.members]
    return Runs(schedule, weight / weight.sum(), found.members, found.disturbance.queue)


def typical_fixed(problem: Problem, itinerary: Itinerary, runs: Runs) -> Typical:
    """Choose the typical schedule of a fixed itinerary; see `planner.schedule.typical`."""
    paths = problem.many_queues(place_nodes(problem, itinerary), PROMISING, runs.sets)

    def fly(members: NDArray[np.int64], queues: NDArray[np.int64]) -> NDArray[np.float64]:
        return fly_as_it_stands(problem, itinerary, members, no_disturbance(len(members))._replace(queue=queues), paths)

    return typical_schedule(runs, problem.reserve, fly, problem.parameters.schedule)


@dataclass(frozen=True, eq=False)
class OutOfSample(Runs):
    """A policy flown out of sample, each member the truth of some runs."""

    energy_ratio: NDArray[np.float64]
    """Shape (runs, legs), or one more with a way on. Energy of each flight as a share of the charge for it; that of the
    way on is 0 if it keeps the reserve."""
    usual_ratio: NDArray[np.float64]
    """See `SampledTruths`."""
    energy: NDArray[np.float64]
    """Shape (runs, legs). Energy of each leg as a ratio to the model."""
    belief: EnergyBelief
    """Its distribution."""
    tables: NDArray[np.float64]
    """See `planner.robust.required_soc_kernels.required_soc_tables`."""
    control: NDArray[np.float64]
    """See `planner.robust.calibration.Calibrated.waits_s`."""
    onward_soc: NDArray[np.float64] | None = None
    """Shape (runs,). Charge on landing after the way on from a target without pads; None if none is needed."""

    @property
    def arrival_s(self) -> NDArray[np.float64]:
        """Return the arrival of each run, POSIX seconds, infinite if there is none."""
        return self.schedule[:, -1, TOUCH_DOWN]

    @property
    def waits_for_room(self) -> bool:
        """Whether runs that never leave wait for a place at the next station; most of them lack only charge."""
        held_s = self.schedule[:, :, ROOM][np.isinf(self.schedule[:, :, TAKE_OFF])]
        return bool((np.isfinite(held_s) & (held_s > 0.0)).any())

    def waited_for_pads(self, depart_s: float) -> float:
        """Return the share of the delivery time that deliveries wait for pads, from a departure on, POSIX seconds; 0 if none arrives."""
        arrives = np.isfinite(self.schedule[:, -1, TOUCH_DOWN])
        if not arrives.any():
            return 0.0
        flown, weight = self.schedule[arrives], self.weight[arrives]
        at_stops_s = np.column_stack((np.full(len(flown), depart_s), flown[:, :-1, TOUCH_DOWN]))
        waited_s = np.maximum(flown[:, :, PAD] - at_stops_s, 0.0).sum(axis=1)
        return float(weight @ waited_s / (weight @ (flown[:, -1, TOUCH_DOWN] - depart_s)))

    @property
    def held_before_last(self) -> float:
        """Wait of nearly all deliveries before the last flight, s, so that it can end."""
        arrives = np.isfinite(self.schedule[:, -1, TOUCH_DOWN])
        if not arrives.any():
            return 0.0
        return weighted_quantile(self.schedule[arrives, -1, ROOM], self.weight[arrives], _NEARLY_NONE)

    def p_broken(self, margin: float) -> float:
        """Return the share of the deliveries in which a flight takes more energy than is charged for with a margin.

        The conditional probability of each delivery, over the part of the energy that is new on each leg (`EnergyBelief`), given the wind
        and the persistent part of its vehicle. A count of violations would have a large sampling error at one of a thousand.
        """
        legs = self.energy.shape[1]
        took = self.energy_ratio[:, :legs]
        with np.errstate(divide="ignore"):
            enough = np.where(took > 0.0, (1.0 + margin) * self.energy / took, np.inf)
        breaks = self.belief.p_leg_above(enough, self.usual_ratio[:, None])
        kept = (1.0 - breaks).prod(axis=1) * (self.energy_ratio[:, legs:] <= 1.0 + margin).all(axis=1)
        return float(self.weight @ (1.0 - kept))

    @property
    def charging(self) -> NDArray[np.float64]:
        """Return the share of the runs that charge at the stop before each flight, shape (legs,); the first one always counts."""
        charged = np.ones(self.schedule.shape[:2], dtype=bool)
        charged[:, 1:] = self.schedule[:, 1:, SOC_TAKE_OFF] > self.schedule[:, :-1, SOC_LANDING] + 1e-9
        return np.asarray(self.weight @ charged)

    @property
    def charge_used(self) -> float:
        """Return the mean total charge of the flights of a run that arrives, as SoC; of any run if none does."""
        flown = np.isfinite(self.schedule[:, :, TOUCH_DOWN])
        used = np.where(flown, self.schedule[:, :, SOC_TAKE_OFF], 0.0) - np.where(
            flown, self.schedule[:, :, SOC_LANDING], 0.0
        )
        arrived = np.where(flown[:, -1], self.weight, 0.0)
        return float(np.average(used.sum(axis=1), weights=arrived if arrived.any() else self.weight))

    def outcome(self, problem: Problem, itinerary: Itinerary | None = None) -> Outcome:
        """Return the outcome over the runs; with energy and cost, given the itinerary."""
        return outcome(
            problem,
            self.schedule,
            self.weight,
            (self.member, self.queue),
            itinerary=itinerary,
            onward_soc=self.onward_soc,
            control=self.control,
        )


def margin_for(simulations: Sequence[OutOfSample], epsilon: float) -> float:
    """Return the least margin with which at most a share epsilon of simulated deliveries would violate the reserve, to `MARGIN_STEP`; 0 if none is needed.

    See `OutOfSample.p_broken`; of several simulations all deliveries count. No share below `LEAST_SHARE` is calibrated for.
    """
    epsilon = max(epsilon, LEAST_SHARE)

    runs = [len(found.weight) for found in simulations]

    def is_enough(margin: float) -> bool:
        return float(np.average([found.p_broken(margin) for found in simulations], weights=runs)) <= epsilon

    low, high = 0.0, _FIRST_MARGIN
    if is_enough(low):
        return 0.0
    while high < _MOST_MARGIN and not is_enough(high):
        low, high = high, 2.0 * high
    while high - low > MARGIN_STEP:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high
