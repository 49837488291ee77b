"""Explanation of a robust plan: the purpose of each stop, alternatives, and the gap to a lower bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import NoRouteError
from skyway.models.base.statistics import weighted_quantile
from skyway.models.drones.energy_belief import LEAST_RATIO
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.fluid_bound import fluid_bound_s
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.problem.speeds import TrueSpeeds
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.outcome import later
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.base.statistics import Figure
    from skyway.planner.problem.problem import Problem
    from skyway.planner.result import PlanResult
    from skyway.planner.robust.candidate import Candidate
    from skyway.planner.robust.robust import RobustAnswer

LOW, HIGH = 0.1, 0.9
"""Quantiles that say how far a charge may be from that of the typical schedule."""


@dataclass(frozen=True)
class ChargeRange:
    """Dependence of a stop's charge on the information there."""

    station: str
    """Station id."""
    nominal: float
    low: float
    high: float
    """Charge on leaving: of the typical schedule, and between which it is in 8 of 10 simulated deliveries."""
    idle: float
    """Share of the runs that leave again without charging."""


@dataclass(frozen=True)
class StopReason:
    """Why a stop is made where it is, and why so much is charged there."""

    station: str
    """Station id."""
    asked: bool
    """Whether it was requested: then no other route was looked for."""
    runner_up: tuple[str, ...] | None
    """Stops of the best route without this one, None where there is none."""
    later: Figure | None
    """How much later that one arrives on average, s; None where there is none."""
    idle: float
    """Share of the simulated deliveries that leave again without charging."""
    leaves: float
    expected: float
    margin: float
    reserve: float
    """Charge with which those that charge leave, on average, and what it is for: what the next flight takes; what is
    kept for worse winds, gusts and the vehicle's own error; what must be left on landing (with the way on, at a target
    without pads). All runs count where none charges."""


@dataclass(frozen=True)
class WaitAndSee:
    """How good a planner could be that knew the wind and the queues."""

    bound_s: float
    """Mean delivery time of the exact planner that is told each member and a sampled queue, or a proved bound of it: no
    policy is better on average without gusts."""
    plan_s: float
    """Of the plan, over its simulated deliveries."""
    worlds: int
    """Told to it."""
    careful_s: float | None = None
    """The same of who must keep the reserve as surely as the plan: told wind, queues and what the drone takes on average, not what it takes
    on each flight, for which it must be charged. No plan is better that does not turn back in the air. None where nobody asked."""

    @property
    def gap(self) -> float:
        """Excess time of the plan over the bound, as a share of the bound."""
        return self.plan_s / self.bound_s - 1.0

    @property
    def careful_gap(self) -> float | None:
        """Excess time over the bound for those who must keep the reserve, as a share of that bound."""
        return None if self.careful_s is None else self.plan_s / self.careful_s - 1.0


def charge_ranges(answer: RobustAnswer) -> list[ChargeRange]:
    """Range of charges: how much more or less the plan charges at each stop, depending on the information there."""
    schedule, weight = answer.out_of_sample.schedule, answer.out_of_sample.weight
    network = answer.policy.problem.network
    found = []
    for number, leg in enumerate(answer.policy.itinerary):
        before = schedule[:, number - 1, SOC_LANDING] if number else np.full(len(schedule), answer.policy.problem.soc)
        flown = np.isfinite(schedule[:, number, TOUCH_DOWN])
        if not flown.any() or number == 0:
            continue
        off = schedule[flown, number, SOC_TAKE_OFF]
        idle = float(weight[flown][off <= before[flown] + 1e-9].sum() / weight[flown].sum())
        low, high = (weighted_quantile(off, weight[flown], q) for q in (LOW, HIGH))
        station = network.stations[int(network.tail[leg.segments[0]])].id
        found.append(ChargeRange(station, float(answer.typical.schedule[number, SOC_TAKE_OFF]), low, high, idle))
    return found


def stop_reasons(result: PlanResult) -> list[StopReason]:
    """Why each stop is made: the best route without it, and what its charge is for."""
    answer = result.robust
    if answer is None:
        return []
    problem, policy = answer.policy.problem, answer.policy
    search = RobustSearch(problem)
    best = answer.candidates[0].outcome
    found = []
    for number, leg in enumerate(policy.itinerary):
        if number == 0:
            continue
        node = int(problem.network.tail[leg.segments[0]])
        runner_up: tuple[str, ...] | None = None
        later_by: Figure | None = None
        asked = node in problem.must_stop
        try:
            other = None if asked else search.finalists(search.candidates(without=node))[0]
        except NoRouteError:
            other = None
        if other is not None:
            runner_up, later_by = stop_names(other), later(other.outcome, best)
        station = problem.network.stations[node].id
        found.append(StopReason(station, asked, runner_up, later_by, *_charge_at(answer, number)))
    return found


def _charge_at(answer: RobustAnswer, number: int) -> tuple[float, float, float, float, float]:
    """Share of runs that do not charge before a flight, and of those that do: charge, what it takes, margin, reserve."""
    schedule, weight = answer.out_of_sample.schedule, answer.out_of_sample.weight
    flown = np.isfinite(schedule[:, number, TOUCH_DOWN])
    before, off, down = (
        schedule[:, number - 1, SOC_LANDING],
        schedule[:, number, SOC_TAKE_OFF],
        schedule[:, number, SOC_LANDING],
    )
    charging = flown & (off > before + 1e-9)
    idle = 1.0 - float(weight[charging].sum()) / max(float(weight[flown].sum()), 1e-300)
    counted = charging if charging.any() else flown
    leaves, lands = (float(np.average(soc[counted], weights=weight[counted])) for soc in (off, down))
    landing = float(answer.policy.landing[number])
    return idle, leaves, leaves - lands, lands - landing, landing


def stop_names(candidate: Candidate) -> tuple[str, ...]:
    """Stations that a route stops at before its destination."""
    stations = candidate.policy.problem.network.stations
    return tuple(stations[node].id for node in candidate.stops[:-1])


def alternatives(answer: RobustAnswer, count: int) -> list[Candidate]:
    """Return different routes none of which is beaten in mean time, 95th percentile, risk and energy; best first."""

    def measures(one: Candidate) -> tuple[float, ...]:
        return (
            one.outcome.mean_s,
            one.outcome.quantile_s(0.95),
            1.0 - one.outcome.p_success,
            one.out_of_sample.charge_used,
        )

    found: list[Candidate] = []
    for one in answer.candidates:
        mine = measures(one)
        beaten = any(
            all(a <= b + 1e-9 for a, b in zip(measures(other), mine, strict=True)) and measures(other) != mine
            for other in answer.candidates
        )
        if (not beaten or one is answer.candidates[0]) and stop_names(one) not in map(stop_names, found):
            found.append(one)
    return found[:count]


def wait_and_see(answer: RobustAnswer, *, careful: bool = False) -> WaitAndSee | None:
    """Lower bound for the delivery time: the exact planner with each member and queue known; None without a route.

    `careful` computes `WaitAndSee.careful_s` as well. On large networks a search that takes long gives its own lower bound
    (`RobustParameters.reasons_s`).
    """
    problem = answer.policy.problem
    members = range(len(problem.probability))
    found = _mean_of_best(problem, [(problem, 0.0) for _ in members])
    if found is None:
        return None
    bound_s, worlds = found
    kept = _mean_of_best(problem, _keeping_reserve(problem)) if careful else None
    return WaitAndSee(
        bound_s, answer.outcome.mean_s - problem.depart_s, worlds, None if kept is None else max(kept[0], bound_s)
    )


def _mean_of_best(problem: Problem, worlds: Sequence[tuple[Problem, float]]) -> tuple[float, int] | None:
    """Mean delivery time, s, of the exact planner in each member, for a problem and a margin of each, and how many have a route."""
    robust = problem.parameters.robust
    limit_s = robust.reasons_s if robust.is_large(len(problem.network)) else math.inf
    times, weights = [], []
    for member, (told, margin) in enumerate(worlds):
        search = ExactSearch(
            told, SampledQueues(problem, member), speeds=TrueSpeeds(problem.air, member), margin_soc_per_s=margin,
            time_limit_s=limit_s,
        )  # fmt: skip
        if search.find() is None:
            continue
        times.append((search.best_s if search.complete else search.lower_bound_s) - problem.depart_s)
        weights.append(float(problem.probability[member]))
    if not times:
        return None
    return max(float(np.average(times, weights=weights)), problem.earliest_s - problem.depart_s), len(times)


def _keeping_reserve(problem: Problem) -> list[tuple[Problem, float]]:
    """Of each member the problem of a drone as it may be, and what its flights must keep besides, SoC a second.

    Landings below the reserve have the probability epsilon over all members, so in one of weight w at most epsilon / w. The part of the
    energy's error that persists is drawn evenly over the members, the part of each flight is what the margin is for.
    """
    belief = problem.usual_errors.energy_of(problem.drone)
    weights = problem.probability / problem.probability.sum()
    shares = np.random.default_rng(len(weights)).permutation((np.arange(len(weights)) + 0.5) / len(weights))
    worlds = []
    for weight, share in zip(weights.tolist(), shares.tolist(), strict=True):
        ratio = belief.mean_ratio + belief.sd_between * belief.sigmas(share)
        most = min(problem.epsilon / max(weight, problem.epsilon), 0.5)
        more = belief.sd_within * belief.sigmas(1.0 - most)
        worlds.append((problem.with_energy(max(ratio, LEAST_RATIO)), more * float(problem.soc_per_s)))
    return worlds


def mean_bound_s(problem: Problem) -> float:
    """Bound from below, at once, how long a delivery takes on average, s; see `planner.fluid_bound`."""
    return float(np.average(fluid_bound_s(problem) - problem.depart_s, weights=problem.probability))


@dataclass(frozen=True)
class RobustGain:
    """Gain of the robust plan over another planner's plan, both without replanning."""

    robust: PlanResult
    other: PlanResult
    """Both plans."""
    sooner: Figure
    """How much earlier the robust plan arrives on average, s, in the simulated deliveries that arrive with both;
    negative: later."""


def robust_gain(robust: PlanResult, other: PlanResult) -> RobustGain:
    """Compare a robust plan with one that is flown without changes."""
    return RobustGain(robust, other, later(other.outcome, robust.outcome))
