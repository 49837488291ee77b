"""Outcome of an itinerary: figures of its simulated deliveries, with their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import Figure, certain, weighted_quantile
from skyway.planner.schedule.precision import Crossed
from skyway.planner.schedule.schedule_kernels import READY, ROOM, SOC_LANDING, TAKE_OFF, TOUCH_DOWN
from skyway.planner.schedule.spending import spending

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.spending import Spending

HELD_S = 0.5
"""A drone that leaves later than possible by at least this counts as held."""
FULL_COSTS = 1.0
"""Cost of a full station, in mean charging times of others. With half of one and 64 sets, intervals held the mean of other seeds in
92 % (one wind) and 96 % (all) of 16 requests; with one and 128 sets in 95 and 97 % of 20 others that were not used for the choice."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of an itinerary over the forecast."""

    start_s: float
    """Requested departure, POSIX seconds."""
    arrival_s: NDArray[np.float64]
    weight: NDArray[np.float64]
    """Shape (runs that arrive,) each. Arrival of each run, POSIX seconds, and its probability."""
    p_reserve: NDArray[np.float64]
    """Shape (legs,). Probability that the landing keeps the reserve, given that the flight takes place."""
    p_hold: NDArray[np.float64]
    p_hold_room: NDArray[np.float64]
    """Shape (legs,) each. Probabilities that the drone, ready to leave, holds before the flight for the wind, and for
    room at the next station; given likewise."""
    p_success: float
    """Probability that every landing keeps the reserve, that of the way on from a target without pads included."""
    p_arrive: float
    """Probability that every flight begins within the horizon: its wind permits it, and it takes no more than a full battery."""
    kept: NDArray[np.bool_]
    """Shape (runs that arrive,). Whether every landing of a run keeps the reserve, that of the way on included."""
    p_onward: float | None = None
    """Probability that the way on from a target without pads keeps the reserve, given the arrival; None if there is none, or
    it was not counted."""
    crossed: Crossed | None = None
    """Days and queues of the runs that arrive; None if nothing was sampled: one truth, known beforehand."""
    spending: Spending | None = None
    """Consumption of the runs that arrive; None if not requested."""

    @property
    def mean_s(self) -> float:
        """Mean arrival, POSIX seconds; infinite when no run arrives."""
        total = float(self.weight.sum())
        return float(np.average(self.arrival_s, weights=self.weight)) if total > 0 else math.inf

    def quantile_s(self, q: float) -> float:
        """Quantile of the arrival, POSIX seconds."""
        return weighted_quantile(self.arrival_s, self.weight, q) if len(self.weight) else math.inf

    def p_by(self, deadline_s: float) -> float:
        """Probability to arrive by a deadline, POSIX seconds."""
        return min(float(self.weight[self.arrival_s <= deadline_s + 1e-6].sum()), 1.0)

    @property
    def delivery(self) -> Figure:
        """Mean delivery time, s, with its uncertainty."""
        if self.crossed is None or not len(self.weight):
            return certain(self.mean_s - self.start_s)
        return self.crossed.mean(self.arrival_s - self.start_s)

    def delivery_quantile(self, q: float) -> Figure:
        """Delivery time that a share q of the deliveries does not exceed, s, with its uncertainty."""
        if self.crossed is None or not len(self.weight):
            return certain(self.quantile_s(q) - self.start_s)
        return self.crossed.quantile(self.arrival_s - self.start_s, q)

    def average(self, values: NDArray[np.float64]) -> float:
        """Mean over the runs that arrive, one or more, of a value of each."""
        return float(np.average(values, weights=self.weight))

    def spread(self, values: NDArray[np.float64]) -> tuple[Figure, Figure]:
        """Mean and 95th percentile of a value of each run that arrives, one or more, with their uncertainty."""
        if self.crossed is None:
            return certain(self.average(values)), certain(weighted_quantile(values, self.weight, 0.95))
        crossed = replace(self.crossed, rare_s=0.0)
        return crossed.mean(values), crossed.quantile(values, 0.95)

    @property
    def success(self) -> Figure:
        """Probability that every landing keeps the reserve, with its uncertainty."""
        if self.crossed is None or not len(self.weight):
            return certain(self.p_success)
        return self.crossed.rate(self.kept)

    def on_time(self, deadline_s: float) -> Figure:
        """Probability to arrive by a deadline, POSIX seconds, with its uncertainty."""
        if self.crossed is None or not len(self.weight):
            return certain(self.p_by(deadline_s))
        found = self.crossed.rate(self.arrival_s <= deadline_s + 1e-6)
        return found.scaled(self.p_arrive)


def outcome(
    problem: Problem,
    runs: NDArray[np.float64],
    weight: NDArray[np.float64],
    groups: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
    *,
    itinerary: Itinerary | None = None,
    onward_soc: NDArray[np.float64] | None = None,
    control: NDArray[np.float64] | None = None,
) -> Outcome:
    """Summarise runs of an itinerary; `groups` are the member and the set of queues of each, if sampled.

    `control` is the variable on which their weights were calibrated, see `planner.schedule.precision.Crossed`. Given the itinerary, consumption is summarised, too, if the scenario has prices or the objective counts it.
    `onward_soc`, shape (runs,), is the charge on landing after the way on from a target without pads.
    """
    flown = np.isfinite(runs[:, :, TOUCH_DOWN])
    kept = runs[:, :, SOC_LANDING] >= problem.reserve - 1e-9
    with np.errstate(invalid="ignore"):
        for_room = runs[:, :, ROOM] > HELD_S
        if problem.request.not_before is not None:  # who would have landed before it, has waited for it
            for_room[:, -1] &= runs[:, -1, TOUCH_DOWN] - runs[:, -1, ROOM] >= problem.request.not_before.timestamp()
        for_wind = runs[:, :, TAKE_OFF] - runs[:, :, READY] - runs[:, :, ROOM] > HELD_S
    mass = np.maximum(weight @ flown, 1e-300)
    arrived = flown[:, -1]
    share = max(float(weight[arrived].sum()), 1e-300)
    spent = (
        spending(problem, itinerary, runs).of(arrived) if itinerary is not None and problem.counts_spending else None
    )
    on = np.ones(len(weight), dtype=bool) if onward_soc is None else onward_soc >= problem.reserve - 1e-9
    all_kept = kept.all(axis=1) & on
    return Outcome(
        start_s=problem.request.state.time.timestamp(),
        arrival_s=runs[arrived, -1, TOUCH_DOWN],
        weight=weight[arrived],
        p_reserve=np.minimum((weight @ (flown & kept)) / mass, 1.0),
        p_hold=np.minimum((weight @ (flown & for_wind)) / mass, 1.0),
        p_hold_room=np.minimum((weight @ (flown & for_room)) / mass, 1.0),
        p_success=min(float(weight[arrived & all_kept].sum()) / share, 1.0),
        p_arrive=max(1.0 - float(weight[~arrived].sum()), 0.0) if arrived.any() else 0.0,
        spending=spent,
        kept=np.asarray(all_kept[arrived]),
        p_onward=None if onward_soc is None else min(float(weight[arrived & on].sum()) / share, 1.0),
        crossed=None if groups is None else _crossed(problem, arrived, weight, groups, control),
    )


def _crossed(
    problem: Problem,
    arrived: NDArray[np.bool_],
    weight: NDArray[np.float64],
    groups: tuple[NDArray[np.int64], NDArray[np.int64]],
    control: NDArray[np.float64] | None,
) -> Crossed:
    member, queue = groups
    known = np.zeros((len(weight), 0)) if control is None else control
    return Crossed(weight[arrived], member[arrived], queue[arrived], full_costs_s(problem), known[arrived])


def full_costs_s(problem: Problem) -> float:
    """Approximate cost of finding a station full, s; 0 if there are no other drones."""
    load = problem.load
    used = load.arrivals_per_s.max(axis=1) > 0.0
    return FULL_COSTS * float(load.mean_charging_s[used].mean()) if used.any() else 0.0


def later(one: Outcome, other: Outcome) -> Figure:
    """Mean difference in arrival from another route, s; of the deliveries that arrive on both, and paired, if both were flown in the same ones."""
    if one.crossed is None or other.crossed is None or not len(one.weight) or not len(other.weight):
        return certain(one.mean_s - other.mean_s)
    mine, theirs = _same_runs(one.crossed, other.crossed)
    if len(mine):
        found = one.crossed.of(mine).difference(one.arrival_s[mine], other.arrival_s[theirs])
        off = float(np.average(one.arrival_s[mine], weights=one.weight[mine])) - found.value
        off -= float(np.average(other.arrival_s[theirs], weights=other.weight[theirs]))  # they may have other weights
        return replace(found, value=found.value + off, low=found.low + off, high=found.high + off)
    a, b = one.delivery, other.delivery
    value, error = one.mean_s - other.mean_s, math.hypot(a.error, b.error)
    return Figure(value, value - 2.0 * error, value + 2.0 * error, error, math.hypot(a.seed_error, b.seed_error))


def _same_runs(one: Crossed, other: Crossed) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the runs that two outcomes have in common, by day and queue; none if most are others."""
    most = 1 + max(int(one.queue.max()), int(other.queue.max()))
    keys, others = (found.day * most + found.queue for found in (one, other))
    if np.array_equal(keys, others):
        every = np.arange(len(keys))
        return every, every
    _, mine, theirs = np.intersect1d(keys, others, return_indices=True)
    alone = len(np.unique(keys)) == len(keys) and len(np.unique(others)) == len(others)
    few = 2 * len(mine) <= max(len(keys), len(others))
    return (mine, theirs) if alone and not few else (mine[:0], theirs[:0])
