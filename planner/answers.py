"""Answers of planners as results: one drone's itinerary, flown through the forecast, audited, with its doubts."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.errors import AuditError
from skyway.models.base.formatting import percent, share
from skyway.models.base.units import S_PER_H, from_posix, iso
from skyway.models.flight.weather_closures import closures_told
from skyway.models.scenario.air import air_notes
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.fluid_bound import fluid_bound_s
from skyway.planner.problem.error_model import gust_notes
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.registry import FORECAST_PLANNERS, ROBUST, forecast_planner
from skyway.planner.result import PlanResult
from skyway.planner.robust.out_of_sample import realization_of, simulate_fixed, typical_fixed
from skyway.planner.schedule.audit import Realization, audit
from skyway.planner.schedule.composing import compose
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.no_route import emptied_leg, grounded_leg, never_leaves, runs_empty
from skyway.planner.schedule.outcome import outcome
from skyway.planner.schedule.schedule_kernels import TOUCH_DOWN
from skyway.planner.time_limit import cut_off_note

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.planner.robust.robust import RobustAnswer
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome


TOLD_S = 6 * 3600.0
"""Plans mention closures up to this time after the delivery."""
LATE = 0.95
"""Share of deliveries that must arrive before the end of the forecast; otherwise the plan says so."""
MOST_SIMULATED_FLIGHTS = 225_000
"""A fixed plan of more flights, over all simulated deliveries, is simulated in fewer deliveries, though not in fewer than a hurried one: what they read of queues
is kept, a megabyte for each flight of the plan. A hundred and fifty flights are no plan that anybody flies."""
SMALL_NETWORK = 200
"""Up to this number of stations, waits are forecast for all of them beforehand; otherwise as the search meets them."""


def solve(
    problem: Problem, planner: str, time_limit_s: float, progress: Callable[[int, float], None] | None
) -> PlanResult:
    """Return the answer of a planner for one drone."""
    if planner in FORECAST_PLANNERS:
        if len(problem.network) <= SMALL_NETWORK:
            problem.waits.need(np.arange(len(problem.network)))
        search = forecast_planner(planner)(problem)
        started = time.perf_counter()
        itinerary = _waiting(problem, search.solve())
        spent = time.perf_counter() - started
        same = problem.thinned(
            problem.parameters.robust.members
        )  # the members in which the figures of `robust` are counted
        robust = problem.parameters.robust
        count = robust.final_runs_of(len(problem.network))
        count = min(count, max(MOST_SIMULATED_FLIGHTS // len(itinerary), robust.hurried_runs))
        runs = simulate_fixed(same, itinerary, problem.usual_errors, count)
        if not np.isfinite(runs.schedule[:, -1, TOUCH_DOWN]).any():
            raise never_leaves(problem, itinerary, grounded_leg(runs.schedule))
        typical = typical_fixed(same, itinerary, runs)
        emptied = emptied_leg(typical.schedule)
        if emptied is not None:
            raise runs_empty(same, itinerary, emptied, "; the planner robust waits on the ground")
        summary = outcome(same, runs.schedule, runs.weight, (runs.member, runs.queue), itinerary=itinerary)
        notes = _doubts(problem, typical.schedule, summary)
        realization = realization_of(same, itinerary, typical, runs)
        composition = _audited(same, itinerary, typical.schedule, summary, realization, planner, spent, notes)
        return PlanResult(composition, itinerary, same, summary, spent, search.labels_expanded)
    queues = SampledQueues(problem, 0)
    if planner == "exact":
        clairvoyant: ExactSearch | ExhaustiveSearch = _exact(problem, queues, time_limit_s)
    else:
        clairvoyant = ExhaustiveSearch(problem, queues, time_limit_s=time_limit_s, progress=progress)
    started = time.perf_counter()
    itinerary = clairvoyant.solve()
    spent = time.perf_counter() - started
    schedule = fly_true(problem, itinerary, queues)
    if not np.isfinite(schedule[0, -1, TOUCH_DOWN]):
        raise AuditError(planner, None, "arrival, POSIX s", clairvoyant.best_s, "the wind never allows the take-off")
    summary = outcome(problem, schedule, np.ones(1), itinerary=itinerary)
    if isinstance(clairvoyant, ExactSearch) and not clairvoyant.complete:
        clairvoyant.lower_bound_s = max(clairvoyant.lower_bound_s, float(fluid_bound_s(problem)[0]))
    notes = () if clairvoyant.complete else (cut_off_note(clairvoyant, time_limit_s),)
    realization = Realization(0, queues, clairvoyant.best_s)
    composition = _audited(problem, itinerary, schedule[0], summary, realization, planner, spent, notes)
    return PlanResult(
        composition, itinerary, problem, summary, spent, clairvoyant.labels_expanded, complete=clairvoyant.complete
    )


def robust_result(answer: RobustAnswer, spent_s: float, labels_expanded: int, rejected: dict[str, str]) -> PlanResult:
    """Return a robust answer as a result: the composition is its typical schedule."""
    problem, itinerary, summary = answer.policy.problem, answer.policy.itinerary, answer.outcome
    notes = _doubts(problem, answer.typical.schedule, summary, simulated=len(answer.out_of_sample.weight))
    realization = realization_of(problem, itinerary, answer.typical, answer.out_of_sample)
    composition = _audited(problem, itinerary, answer.typical.schedule, summary, realization, ROBUST, spent_s, notes)
    objective = problem.request.objective
    if objective.deadline is not None:
        on_time = summary.on_time(objective.deadline.timestamp())
        composition = replace(composition, on_time_probability=on_time.value, on_time=on_time)
    return PlanResult(composition, itinerary, problem, summary, spent_s, labels_expanded, rejected, robust=answer)


def _waiting(problem: Problem, itinerary: Itinerary) -> Itinerary:
    """Return an itinerary whose last flight does not end before the earliest delivery, however fast it is."""
    if not math.isfinite(problem.earliest_s):
        return itinerary
    last = itinerary[-1]
    begins_s = problem.earliest_s - problem.fastest_s(last.segments)
    return (*itinerary[:-1], replace(last, not_before_s=max(last.not_before_s, begins_s)))


def _exact(problem: Problem, queues: SampledQueues, time_limit_s: float) -> ExactSearch:
    """Return an exact search that ends after a time; in a hurry, it looks for any answer first."""
    hurry = time_limit_s < problem.parameters.exact.hurry_s
    return ExactSearch(problem, queues, time_limit_s=time_limit_s if hurry else math.inf, cut_off_s=time_limit_s)


def _audited(
    problem: Problem,
    itinerary: Itinerary,
    schedule: NDArray[np.float64],
    summary: Outcome,
    realization: Realization,
    planner: str,
    spent_s: float,
    notes: tuple[str, ...],
) -> Composition:
    """Return the composition of a schedule, flown again."""
    composition = compose(
        problem, itinerary, schedule, realization.member, summary, planner=planner, planning_time_s=spent_s, notes=notes
    )
    audit(composition, problem, itinerary, realization)
    return composition


def _doubts(
    problem: Problem, schedule: NDArray[np.float64], summary: Outcome, *, simulated: int = 0
) -> tuple[str, ...]:
    """Return notes where the plan promises less than requested: by more than chance explains in `simulated` runs."""
    doubts = []
    broken = 1.0 - summary.p_success
    if simulated and broken > problem.epsilon + 2.0 * math.sqrt(problem.epsilon / simulated):
        doubts.append(
            f"{share(summary.success.rest)} of deliveries land below the reserve, {percent(problem.epsilon, None)} were allowed: "
            "the planner found no safer route"
        )
    elif not simulated and broken > problem.epsilon + 1e-9:
        doubts.append(
            f"flown without replanning, {share(summary.success.rest)} of deliveries land below the reserve, {percent(problem.epsilon, None)} "
            "were asked for: decide the charge again at each stop"
        )
    if problem.in_flight and summary.p_arrive < 1.0 - problem.epsilon:
        doubts.append(
            f"in {percent(1.0 - summary.p_arrive, None)} of deliveries the wind forbids the first leg now, and a drone in the "
            "air cannot hold: be ready to divert"
        )
    if not np.isfinite(schedule[-1, TOUCH_DOWN]) or schedule[-1, TOUCH_DOWN] > problem.depart_s + HORIZON_H * S_PER_H:
        doubts.append(f"the delivery takes longer than the {HORIZON_H} h that the forecast covers: do not rely on it")
    wind = problem.forecast
    if summary.quantile_s(LATE) > wind.known_until_s:
        ends = iso(from_posix(wind.known_until_s))
        doubts.append(f"the delivery may last longer than the forecast, which ends at {ends}: {wind.then}")
    landed_s = float(schedule[-1, TOUCH_DOWN])
    until_s = (landed_s if math.isfinite(landed_s) else problem.depart_s) + TOLD_S
    zone = ZoneInfo(problem.scenario.timezone)
    closed = closures_told(wind, problem.drone, problem.rules, zone, problem.depart_s, until_s)
    air = air_notes(problem.drone, wind, problem.depart_s)
    return (*doubts, *closed, *air, *gust_notes(problem.usual_errors), *wind.notes)
