"""One entry to all planners: `plan`."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.errors import AuditError, Fault, InfeasibleError, InputError, NoRouteError
from skyway.models.base.formatting import later_text, percent
from skyway.models.base.units import S_PER_H, from_posix, iso
from skyway.models.flight.weather_closures import closures_told
from skyway.models.scenario.air import air_notes, fleet_in_air
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.drone_choice import candidates
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.explain import alternatives
from skyway.planner.fluid_bound import fluid_bound_s
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.error_model import gust_notes
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.problem import HORIZON_H, Problem, check_apart
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, FORECAST_PLANNERS, PLANNERS, ROBUST, forecast_planner
from skyway.planner.result import Comparison, PlanResult
from skyway.planner.robust.out_of_sample import realization_of, simulate_fixed, typical_fixed
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.audit import Realization, audit
from skyway.planner.schedule.composing import compose
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.no_route import emptied_leg, grounded_leg, never_leaves, runs_empty
from skyway.planner.schedule.outcome import later, outcome
from skyway.planner.schedule.schedule_kernels import TOUCH_DOWN
from skyway.planner.time_limit import cut_off_note, with_gap
from skyway.planner.way_back import plan_there_and_back, with_way_back

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request
    from skyway.planner.robust.robust import RobustAnswer
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome


TOLD_S = 6 * 3600.0
"""Closures within so much after a delivery are told."""
LATE = 0.95
"""So many deliveries have arrived when a plan is compared with the end of its forecast."""
SMALL_NETWORK = 200
"""Up to this many stations the waits are forecast for all of them beforehand; else as the search meets them."""


def plan(
    scenario: Scenario,
    request: Request,
    *,
    planner: str = ROBUST,
    forecast: WindEnsemble | None = None,
    truth: WindEnsemble | None = None,
    time_limit_s: float = math.inf,
    progress: Callable[[int, float], None] | None = None,
    parameters: PlannerParameters = USUAL,
) -> PlanResult:
    """Compose a delivery.

    Parameters
    ----------
    scenario : Scenario
        The region.
    request : Request
        What is asked.
    planner : str
        One of `PLANNERS`.
    forecast : WindEnsemble, optional
        What is known of the wind; the scenario's analogue days by default.
    truth : WindEnsemble, optional
        One member, the wind as it will be: needed by `CLAIRVOYANT_PLANNERS`, unless the forecast has one member.
    time_limit_s : float
        A clairvoyant planner ends after this time, for each drone: with the best found and a bound of it, or an error.
        ``robust`` looks no further from this time on, once it has a route.
    progress : callable, optional
        Of ``ies``, see `ExhaustiveSearch`.
    parameters : PlannerParameters, optional
        Tuned numbers; those that are not at their defaults are kept with the composition.

    Returns
    -------
    PlanResult
        The composition and how it was found.

    Raises
    ------
    InputError
        The request does not fit the scenario.
    InfeasibleError
        There is no composition; the error names the binding constraint.
    AuditError
        Flown once more, the answer is not what it claims to be (`planner.schedule.audit`).
    """
    if planner not in PLANNERS:
        raise InputError(
            Fault("no such planner", field="planner", value=planner, remedy="one of " + ", ".join(PLANNERS))
        )
    if request.stop_at and planner != ROBUST:
        remedy = f"take the planner {ROBUST}, or leave the stops to the planner"
        raise InputError(
            Fault(
                f"{planner} plans no stops that are asked for",
                field="stop_at",
                value=", ".join(request.stop_at),
                remedy=remedy,
            )
        )
    check_objective(scenario, request, planner)
    _check_hours(scenario, request, planner)
    forecast = forecast if forecast is not None else scenario.forecast(request.state.time, HORIZON_H)
    scenario = fleet_in_air(scenario, forecast, request.state.time.timestamp())
    wind = forecast
    if planner in CLAIRVOYANT_PLANNERS:
        wind = _truth(forecast, truth, planner)

    def compose(scenario: Scenario, request: Request) -> PlanResult:
        return _compose(scenario, request, planner, wind, time_limit_s, progress, parameters)

    return plan_there_and_back(scenario, request, compose)


def _compose(
    scenario: Scenario,
    request: Request,
    planner: str,
    wind: WindEnsemble,
    time_limit_s: float,
    progress: Callable[[int, float], None] | None,
    parameters: PlannerParameters,
) -> PlanResult:
    """Compose a delivery without its way back."""
    rejected: dict[str, str] = {}
    problems = _problems(scenario, request, wind, rejected, parameters)
    if planner == ROBUST:
        return _plan_robust(problems, request.objective, rejected, parameters, time_limit_s)
    answers: list[PlanResult] = []
    errors: dict[str, InfeasibleError] = {}
    for problem in problems:
        try:
            answers.append(_solve(problem, planner, time_limit_s, progress))
        except InfeasibleError as error:
            errors[problem.drone.id] = error
    drones = [answer.problem.drone.id for answer in answers]
    best = _best(
        request.objective,
        drones,
        [answer.outcome for answer in answers],
        errors,
        rejected,
        parameters.robust.min_arrival,
    )
    return replace(
        answers[best],
        rejected=rejected,
        labels_expanded=sum(answer.labels_expanded for answer in answers),
        planning_time_s=sum(answer.planning_time_s for answer in answers),
    )


def compare(
    scenario: Scenario,
    request: Request,
    planners: Sequence[str],
    *,
    forecast: WindEnsemble | None = None,
    truth: WindEnsemble | None = None,
    time_limit_s: float = math.inf,
    parameters: PlannerParameters = USUAL,
) -> list[Comparison]:
    """Put the same request to several planners; a planner without an answer says why."""
    answers = []
    for name in planners:
        try:
            result = plan(
                scenario, as_planned_by(name, request), planner=name, forecast=forecast, truth=truth, time_limit_s=time_limit_s,
                parameters=parameters,
            )  # fmt: skip
            answers.append(Comparison(name, result, None))
        except InfeasibleError as error:
            answers.append(Comparison(name, None, error))
    return answers


def as_planned_by(planner: str, request: Request) -> Request:
    """Return a request with an objective that a planner knows: of those that plan for the time alone, least mean."""
    alone = planner != ROBUST and request.objective.beside_time
    return replace(request, objective=Objective()) if alone else request


def check_objective(scenario: Scenario, request: Request, planner: str) -> None:
    """Refuse an objective that a planner does not know, and costs where nothing is said of them."""
    objective = request.objective
    if objective.beside_time and planner != ROBUST:
        remedy = f"the planner {ROBUST} takes every objective; {planner} plans for the time alone"
        raise InputError(Fault("is not known to this planner", field="objective", value=objective.kind, remedy=remedy))
    if objective.counts_cost and scenario.tariff is None:
        remedy = "give a table [costs] in scenario.toml: currency, energy_price_per_kwh"
        raise InputError(
            Fault("needs prices, and the scenario has none", field="objective", value="cost", remedy=remedy)
        )


def _check_hours(scenario: Scenario, request: Request, planner: str) -> None:
    """Refuse opening hours, and an earliest delivery, for a planner that proves its answer without them; and that for a drone in the air."""
    if request.not_before is not None and (planner in CLAIRVOYANT_PLANNERS or request.state.position is not None):
        who = f"the planner {planner}" if request.state.position is None else "a drone in the air"
        remedy = f"plan from a station with {ROBUST}"
        value = request.not_before.isoformat()
        raise InputError(Fault(f"{who} cannot wait for it", field="not_before", value=value, remedy=remedy))
    closing = [station.id for station in scenario.network.stations if station.open_hours and station.pads]
    if closing and planner in CLAIRVOYANT_PLANNERS:
        remedy = f"the planner {ROBUST} does; or leave the column open_hours out"
        raise InputError(Fault("does not plan with opening hours", field="planner", value=planner, remedy=remedy))


def _problems(
    scenario: Scenario, request: Request, wind: WindEnsemble, rejected: dict[str, str], parameters: PlannerParameters
) -> Iterator[Problem]:
    """One problem for each drone to compose for; they share what is known of waits and queues."""
    problem: Problem | None = None
    for drone in candidates(scenario, request, rejected):
        problem = (
            Problem(scenario, request, drone, wind, parameters=parameters)
            if problem is None
            else problem.for_drone(drone)
        )
        check_apart(problem)
        yield problem


def _best(
    objective: Objective,
    drones: Sequence[str],
    outcomes: Sequence[Outcome],
    errors: dict[str, InfeasibleError],
    rejected: dict[str, str],
    least_arrival: float,
) -> int:
    """Choose among answers for several drones the one whose outcome is best, and say in `rejected` why not the others.

    Without an answer, one of the errors is raised.
    """
    rejected |= {drone: str(error) for drone, error in errors.items()}
    if not drones:
        raise _none(errors)
    orders = [(one.p_arrive < least_arrival, *objective.loss(one)) for one in outcomes]
    best = objective.ranked(orders)[0]
    for number, drone in enumerate(drones):
        if number != best:
            rejected[drone] = later_text(later(outcomes[number], outcomes[best]))
    return best


def _none(errors: dict[str, InfeasibleError]) -> InfeasibleError:
    """Explain why no drone of the fleet has a composition: the first one's reason, and which others have none either."""
    first, *others = errors
    if not others:
        return errors[first]
    message = f"{errors[first]}; nor is there one for {', '.join(others)}"
    return NoRouteError(message, constraint=errors[first].constraint)


def _doubts(
    problem: Problem, schedule: NDArray[np.float64], summary: Outcome, *, simulated: int = 0
) -> tuple[str, ...]:
    """Say where the plan promises less than was asked for: more than chance explains in so many simulated runs."""
    doubts = []
    broken = 1.0 - summary.p_success
    if simulated and broken > problem.epsilon + 2.0 * math.sqrt(problem.epsilon / simulated):
        doubts.append(
            f"{percent(broken, None)} of deliveries land below the reserve, {percent(problem.epsilon, None)} were asked for: "
            "no route that the planner knows is safer"
        )
    elif not simulated and broken > problem.epsilon + 1e-9:
        doubts.append(
            f"flown as it stands, {percent(broken, None)} of deliveries land below the reserve, {percent(problem.epsilon, None)} "
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


def _truth(forecast: WindEnsemble, truth: WindEnsemble | None, planner: str) -> WindEnsemble:
    if truth is None and len(forecast.probability) == 1:
        return forecast
    if truth is None:
        remedy = "name a day of the record with --actual-wind 2013-07-10, or give one wind with --wind 8@270"
        raise InputError(Fault(f"{planner} needs perfect information", field="truth", remedy=remedy))
    if len(truth.probability) != 1:
        raise InputError(Fault("the actual wind has more than one member", field="truth", value=len(truth.probability)))
    return truth


def _solve(
    problem: Problem, planner: str, time_limit_s: float, progress: Callable[[int, float], None] | None
) -> PlanResult:
    """Compose for one drone."""
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
        runs = simulate_fixed(same, itinerary, problem.usual_errors, problem.parameters.robust.final_runs)
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
    """Return the composition of a schedule, flown once more."""
    composition = compose(
        problem, itinerary, schedule, realization.member, summary, planner=planner, planning_time_s=spent_s, notes=notes
    )
    audit(composition, problem, itinerary, realization)
    return composition


def _plan_robust(
    problems: Iterator[Problem],
    objective: Objective,
    rejected: dict[str, str],
    parameters: PlannerParameters,
    time_limit_s: float,
) -> PlanResult:
    """Compare routes for every drone, and finish the best: the composition tells its typical schedule."""
    least_arrival, end_at = parameters.robust.min_arrival, time.perf_counter() + time_limit_s
    searches: list[RobustSearch] = []
    outcomes: list[Outcome] = []
    errors: dict[str, InfeasibleError] = {}
    spent = 0.0
    for problem in problems:
        started = time.perf_counter()
        search = RobustSearch(problem, end_at=end_at)
        try:
            outcomes.append(search.candidates(quick=True)[0].outcome)
            searches.append(search)
        except InfeasibleError as error:
            errors[problem.drone.id] = error
        spent += time.perf_counter() - started
    labels_expanded = 0
    while True:
        drones = [search.problem.drone.id for search in searches]
        told: dict[str, str] = {}
        best = _best(objective, drones, outcomes, errors, told, least_arrival)
        started = time.perf_counter()
        try:
            answer = searches[best].solve()
        except InfeasibleError as error:  # looked at closely, none of its routes will do: the next best drone may
            errors[drones[best]] = error
            labels_expanded += searches.pop(best).labels_expanded
            outcomes.pop(best)
        else:
            spent += time.perf_counter() - started
            labels_expanded += sum(search.labels_expanded for search in searches)
            told_result = _told(answer, spent, labels_expanded, rejected | told)
            if all(search.complete for search in searches):
                return told_result
            return with_gap(told_result, time_limit_s)
        spent += time.perf_counter() - started


def _told(answer: RobustAnswer, spent_s: float, labels_expanded: int, rejected: dict[str, str]) -> PlanResult:
    """Tell a robust answer as a composition: its typical schedule."""
    problem, itinerary, summary = answer.policy.problem, answer.policy.itinerary, answer.outcome
    notes = _doubts(problem, answer.typical.schedule, summary, simulated=len(answer.out_of_sample.weight))
    realization = realization_of(problem, itinerary, answer.typical, answer.out_of_sample)
    composition = _audited(problem, itinerary, answer.typical.schedule, summary, realization, ROBUST, spent_s, notes)
    objective = problem.request.objective
    if objective.deadline is not None:
        on_time = summary.on_time(objective.deadline.timestamp())
        composition = replace(composition, on_time_probability=on_time.value, on_time=on_time)
    return PlanResult(composition, itinerary, problem, summary, spent_s, labels_expanded, rejected, robust=answer)


def alternative_plans(result: PlanResult, count: int) -> list[PlanResult]:
    """Return up to `count` different plans, the given one first, none beaten in time, lateness, risk and energy at once."""
    if result.robust is None:
        return [result]
    plans, wind, parameters = [result], result.problem.forecast, result.problem.parameters

    def compose(scenario: Scenario, request: Request) -> PlanResult:
        return _compose(scenario, request, ROBUST, wind, math.inf, None, parameters)

    for candidate in alternatives(result.robust, count)[1:]:
        started = time.perf_counter()
        others = [one for one in result.robust.candidates if one is not candidate]
        try:
            answer = RobustSearch(result.problem).finish([candidate, *others])
        except NoRouteError:  # with its margin calibrated it never leaves
            continue
        told = _told(answer, time.perf_counter() - started, result.labels_expanded, {})
        try:
            plans.append(with_way_back(told, compose))
        except NoRouteError:  # nobody would come back from it
            continue
    return plans
