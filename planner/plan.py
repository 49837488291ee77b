"""One entry to all planners: `plan`."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import NoneType
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InfeasibleError, InputError, NoRouteError, refuse
from skyway.models.base.formatting import duration, later_text
from skyway.models.base.ranges import kind_faults
from skyway.models.base.units import S_PER_MIN
from skyway.models.scenario.air import fleet_in_air
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.ensemble import WindEnsemble
from skyway.planner.answers import robust_result, solve
from skyway.planner.drone_choice import candidates
from skyway.planner.explain import alternatives
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.problem.request_checks import check_apart
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, PLANNERS, ROBUST
from skyway.planner.result import Comparison, PlanResult
from skyway.planner.robust.robust import Look, RobustSearch
from skyway.planner.schedule.outcome import later
from skyway.planner.time_limit import beyond_limit, with_gap
from skyway.planner.way_back import plan_there_and_back, with_way_back

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.schedule.outcome import Outcome


_WIND = "such as constant_wind(speed_mps, from_deg, …)"


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
        Flown again, the answer is not what it claims to be (`planner.schedule.audit`).
    """
    refuse(
        [
            *kind_faults("scenario", scenario, Scenario, "read_scenario(FOLDER) or build_scenario(STATIONS)"),
            *kind_faults("request", request, Request, "Request(state=…, destination=…, payload_kg=…)"),
            *kind_faults("forecast", forecast, (WindEnsemble, NoneType), _WIND),
            *kind_faults("truth", truth, (WindEnsemble, NoneType), _WIND),
        ]
    )
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
            answers.append(solve(problem, planner, time_limit_s, progress))
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
    """Solve the same request with several planners; those without an answer give the reason."""
    if isinstance(planners, str):
        raise InputError("is one name", field="planners", value=planners, remedy=f"a list of names: [{planners!r}]")
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
    """Return a request with an objective the planner supports: for those that minimise only time, the minimum mean."""
    alone = planner != ROBUST and request.objective.beside_time
    return replace(request, objective=Objective()) if alone else request


def check_objective(scenario: Scenario, request: Request, planner: str) -> None:
    """Refuse an objective that a planner does not support, and costs where the scenario has no prices."""
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
        remedy = f"use the planner {ROBUST}, or remove the column open_hours"
        raise InputError(Fault("does not plan with opening hours", field="planner", value=planner, remedy=remedy))


def _problems(
    scenario: Scenario, request: Request, wind: WindEnsemble, rejected: dict[str, str], parameters: PlannerParameters
) -> Iterator[Problem]:
    """One problem for each drone to compose for; they share computed waits and queues."""
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
    best = objective.ranked([_order(objective, one, least_arrival) for one in outcomes])[0]
    for number, drone in enumerate(drones):
        if number != best:
            rejected[drone] = later_text(later(outcomes[number], outcomes[best]))
    return best


def _order(objective: Objective, outcome: Outcome, least_arrival: float) -> tuple[float, ...]:
    """What answers are ranked by: one that hardly ever arrives is the last resort."""
    return outcome.p_arrive < least_arrival, *objective.loss(outcome)


def _none(errors: dict[str, InfeasibleError]) -> InfeasibleError:
    """Explain why no drone of the fleet has a composition: the first one's reason, and which others have none either."""
    first, *others = errors
    if not others:
        return errors[first]
    message = f"{errors[first]}; nor is there one for {', '.join(others)}"
    return NoRouteError(message, constraint=errors[first].constraint)


def _truth(forecast: WindEnsemble, truth: WindEnsemble | None, planner: str) -> WindEnsemble:
    if truth is None and len(forecast.probability) == 1:
        return forecast
    if truth is None:
        remedy = "name a day of the record with --actual-wind 2013-07-10, or give one wind with --wind 8@270; in Python: truth=, or forecast= of one member"
        raise InputError(Fault(f"{planner} needs perfect information", field="truth", remedy=remedy))
    if len(truth.probability) != 1:
        raise InputError(Fault("the actual wind has more than one member", field="truth", value=len(truth.probability)))
    return truth


def _plan_robust(
    problems: Iterator[Problem],
    objective: Objective,
    rejected: dict[str, str],
    parameters: PlannerParameters,
    time_limit_s: float,
) -> PlanResult:
    """Look at the best drone closer and closer until it is finished: the composition tells its typical schedule.

    Drones that arrive later even at best are not looked at.
    """
    least_arrival, end_at = parameters.robust.min_arrival, time.perf_counter() + time_limit_s
    started = time.perf_counter()
    searches = [RobustSearch(problem, end_at=end_at) for problem in problems]
    looks = {search.problem.drone.id: search.looks() for search in searches}
    alone = len(searches) == 1
    unseen = {search.problem.drone.id: -math.inf if alone else _at_best(search, objective) for search in searches}
    found: dict[str, Look] = {}
    errors: dict[str, InfeasibleError] = {}

    def look(drone: str) -> None:
        try:
            found[drone] = next(looks[drone])
        except InfeasibleError as error:  # looked at closely, none of its routes will do: another drone may
            errors[drone] = error
            found.pop(drone, None)

    while True:
        told: dict[str, str] = {}
        outcomes = [one.outcome for one in found.values()]
        foremost = min((_order(objective, one, least_arrival) for one in outcomes), default=(True, math.inf))
        drone = min(unseen, key=lambda drone: unseen[drone], default=None)
        if drone is not None and (False, unseen[drone]) < foremost:
            del unseen[drone]
            look(drone)
            continue
        best = list(found)[_best(objective, list(found), outcomes, errors, told, least_arrival)]
        answer = found[best].answer
        if answer is not None:
            break
        look(best)
    for drone, least_s in unseen.items():
        more_s = S_PER_MIN * math.floor((least_s - answer.outcome.mean_s) / S_PER_MIN)  # no more than the bound says
        later_by = f"at least {duration(more_s)} later" if more_s > 0.0 else "no earlier"
        told[drone] = f"{later_by}, even with no margin for wind and gusts"
    spent_s = time.perf_counter() - started
    labels_expanded = sum(search.labels_expanded for search in searches)
    result = robust_result(answer, spent_s, labels_expanded, rejected | told)
    if all(search.complete for search in searches):
        return beyond_limit(result, time_limit_s)
    return with_gap(result, time_limit_s)


def _at_best(search: RobustSearch, objective: Objective) -> float:
    """Arrival that hardly any plan for a drone beats, if that is what the objective compares, POSIX seconds; else, and without a way, it must be looked at."""
    least_s = search.earliest_s() if objective.kind in ("mean", "p95") else -math.inf
    return least_s if math.isfinite(least_s) else -math.inf


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
        told = robust_result(answer, time.perf_counter() - started, result.labels_expanded, {})
        try:
            plans.append(with_way_back(told, compose))
        except NoRouteError:  # nobody would come back from it
            continue
    return plans
