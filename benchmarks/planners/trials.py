"""Planners tried on an instance: each plans every delivery, and all are flown in the same truths."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InfeasibleError
from skyway.models.compute.spreading import spread
from skyway.planner.evaluation.evaluate import (
    Evaluation,
    Flown,
    clairvoyant_times,
    fly_charging,
    fly_itinerary,
    fly_policy,
    pooled,
    sample_realizations,
    summarise,
)
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, FORECAST_PLANNERS, PLANNERS, ROBUST, forecast_planner
from skyway.planner.schedule.itinerary import fly_sampled
from skyway.planner.schedule.outcome import outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TypeAlias

    from numpy.typing import NDArray

    from benchmarks.cases.instances import Instance
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.evaluation.evaluate import Realizations
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request
    from skyway.planner.schedule.itinerary import Itinerary
    from skyway.planner.schedule.outcome import Outcome

    Floats: TypeAlias = NDArray[np.float64]

TWO_WAYS = ("pfs", "pfs-charge-aware")
"""Planners that recharge as they are told: both options are tried."""
APART = ("pfs-strict",)
"""Planners whose failures do not take requests from the comparison of the others."""
MAX_FLIGHTS = 150
"""A plan of more flights takes longer than the horizon; it counts as wandering and is not flown."""
MAX_STATIONS = {"ies": 200, "pfs-strict": 50, "rolling": 200}
"""Planners that are tried only on networks of up to so many stations: the search that looks at everything, the one that
goes in circles until its step limit, and the rolling horizon, which plans at every stop of every run."""
ROLLING = "rolling"
"""`planner.online.evaluated.RollingRobust`: ``robust`` again at every stop."""
COMPARED_RUNS = 4
"""Runs of each delivery in which times are compared: the clairvoyant are told these, and the rolling horizon flies these alone."""
PLANNED, NO_ROUTE, WANDERED = "planned", "no-route", "wandered"


@dataclass(frozen=True)
class Contender:
    """A planner with a recharge option."""

    planner: str
    recharge: str

    @property
    def label(self) -> str:
        """For tables."""
        if self.planner == ROLLING:
            return "robust, rolling horizon"
        return f"{self.planner}, {self.recharge}" if self.planner in TWO_WAYS else self.planner


def tried(name: str, stations: int) -> bool:
    """Whether a planner is tried on a network of so many stations."""
    return stations <= MAX_STATIONS.get(name, stations)


def contenders(stations: int) -> list[Contender]:
    """All planners that do not need the truth, those that recharge as told in both ways."""
    found = []
    for name in PLANNERS:
        if name not in CLAIRVOYANT_PLANNERS and tried(name, stations):
            ways = ("full", "enough") if name in TWO_WAYS else ("full" if name in {*APART, "shortest"} else "enough",)
            found += [Contender(name, way) for way in ways]
    if tried(ROLLING, stations):
        found.append(Contender(ROLLING, "enough"))
    return found


@dataclass(frozen=True, eq=False)
class Trial:
    """One contender on one delivery.

    Attributes
    ----------
    contender, delivery
        Contender and delivery measured.
    status : str
        ``planned``, ``no-route`` or ``wandered`` (more than `MAX_FLIGHTS` flights).
    planning_s : float
        Wall time of the search.
    flights : int
        Of the plan.
    flown : Flown or None
        None without a plan.
    """

    contender: Contender
    delivery: int
    status: str
    planning_s: float
    flights: int
    flown: Flown | None


@dataclass(frozen=True)
class Row:
    """One planner on one instance.

    Attributes
    ----------
    instance, planner : str
        Instance and planner measured.
    clairvoyant : bool
        It had perfect information: a bound, not a rival.
    deliveries, planned, no_route, wandered, cut_off : int
        Requests, and how planning them ended.
    whole : Evaluation or None
        All simulated runs of its plans: failures, promises.
    common : Evaluation or None
        Of the first `COMPARED_RUNS` runs of each delivery, those that all planners (but `APART`) delivered: times.
    """

    instance: str
    planner: str
    clairvoyant: bool
    deliveries: int
    planned: int
    no_route: int
    wandered: int
    cut_off: int
    whole: Evaluation | None
    common: Evaluation | None

    def document(self) -> dict[str, object]:
        """The row for a JSON file."""
        plain = {key: value for key, value in vars(self).items() if not isinstance(value, Evaluation)}
        return plain | {
            "whole": None if self.whole is None else self.whole.document(),
            "common": None if self.common is None else self.common.document(),
        }


@dataclass(frozen=True, eq=False)
class Case:
    """One delivery of an instance, made ready for all who try it.

    Attributes
    ----------
    scenario, instance, number
        Network, and which delivery of the instance.
    forecast : WindEnsemble
        Without the day of the truths.
    truths : Truths
        What all are flown in.
    compared : int
        Of the runs, those in which times are compared.
    """

    scenario: Scenario
    instance: Instance
    number: int
    forecast: WindEnsemble
    realizations: Realizations
    compared: int

    def request(self, recharge: str) -> Request:
        """The delivery as a request."""
        return self.instance.request(self.instance.deliveries[self.number], recharge)[0]


def case_of(
    scenario: Scenario,
    instance: Instance,
    number: int,
    compared: int = COMPARED_RUNS,
    parameters: PlannerParameters = USUAL,
) -> Case:
    """Make a delivery of an instance ready, in the scenario of the instance."""
    request, day = instance.request(instance.deliveries[number], "enough")
    forecast = scenario.forecast(request.state.time, HORIZON_H, truth=day)
    if day.isoformat() in forecast.labels:
        raise AssertionError("the truth is in the forecast")
    realizations = sample_realizations(
        scenario, request, [day], runs=instance.runs, errors=instance.errors, seed=instance.truth_seed + number
    )
    realizations = replace(realizations, parameters=parameters)
    return Case(scenario, instance, number, forecast, realizations, min(compared, instance.runs))


@dataclass(frozen=True, eq=False)
class Asked:
    """What all deliveries of an instance are tried with.

    Attributes
    ----------
    instance : Instance
        The instance.
    compared : int
        See `COMPARED_RUNS`.
    time_limit_s : float
        Of each clairvoyant plan.
    parameters : PlannerParameters
        Of all planners.
    """

    instance: Instance
    compared: int = COMPARED_RUNS
    time_limit_s: float = 5.0
    parameters: PlannerParameters = USUAL


@dataclass(frozen=True, eq=False)
class Tried:
    """One delivery, tried by all.

    Attributes
    ----------
    trials : list of Trial
        Of those who do not need the truth.
    known : dict
        By clairvoyant planner: delivery times of the runs, planning time of all together, and how many were cut off.
    """

    trials: list[Trial]
    known: dict[str, tuple[Floats, float, int]]


def try_delivery(asked: Asked, number: int) -> Tried:
    """Try all planners on one delivery; but for the planning times it depends on nothing else."""
    instance = asked.instance
    scenario = _scenario(instance)
    case = case_of(scenario, instance, number, asked.compared, asked.parameters)
    trials = [try_case(case, rival) for rival in contenders(len(scenario.network))]
    known = {
        name: clairvoyant_times(
            case.realizations, instance.drone, name, range(case.compared), time_limit_s=asked.time_limit_s
        )
        for name in CLAIRVOYANT_PLANNERS
        if tried(name, len(scenario.network))
    }
    return Tried(trials, known)


@lru_cache(maxsize=1)
def _scenario(instance: Instance) -> Scenario:
    return instance.scenario()


def try_instance(
    asked: Asked, *, progress: Callable[[str], None], workers: int = 1, cluster: str | None = None
) -> list[Row]:
    """Try all planners on an instance.

    Parameters
    ----------
    asked : Asked
        The instance, and how.
    progress : callable
        Told in words how far it is.
    workers, cluster
        See `skyway.models.compute.spreading.spread`; planning times are those of a processor of its own only with one.
    """
    instance = asked.instance
    rivals = contenders(len(_scenario(instance).network))
    started = time.perf_counter()

    def told(done: int, total: int, left_s: float) -> None:
        spent_s = time.perf_counter() - started
        progress(f"{instance.name}: {done} of {total}, {spent_s:.0f} s, about {left_s:.0f} s left")

    count = len(instance.deliveries)
    done = spread(try_delivery, range(count), common=asked, workers=workers, cluster=cluster, told=told)
    trials = [trial for one in done for trial in one.trials]
    names = list(done[0].known) if done else []
    known = {name: [one.known[name][0] for one in done] for name in names}
    runs = min(asked.compared, instance.runs)
    spent = {name: sum(one.known[name][1] for one in done) / runs for name in names}
    cut = {name: sum(one.known[name][2] for one in done) for name in names}
    return _rows(instance, rivals, trials, known, spent, cut, asked.compared)


def try_case(case: Case, rival: Contender) -> Trial:
    """Let one contender plan a delivery, and fly that in its truths."""
    started = time.perf_counter()
    try:
        if rival.planner == ROLLING:
            return _try_rolling(case, rival)
        if rival.planner == ROBUST:
            return _try_robust(case, rival)
        itinerary, promise, spent = _solve(case, rival)
    except InfeasibleError:
        return Trial(rival, case.number, NO_ROUTE, time.perf_counter() - started, 0, None)
    if promise is None:
        return Trial(rival, case.number, WANDERED, spent, len(itinerary), None)
    depart_s = case.realizations.request.state.time.timestamp()
    flown = fly_itinerary(case.realizations, case.instance.drone, itinerary).judged(promise, depart_s)
    return Trial(rival, case.number, PLANNED, spent, len(itinerary), flown)


def _try_robust(case: Case, rival: Contender) -> Trial:
    """A route with charges decided at each stop."""
    parameters = case.realizations.parameters
    result = plan(
        case.scenario, case.request(rival.recharge), planner=ROBUST, forecast=case.forecast, parameters=parameters
    )
    assert result.robust is not None
    flown = fly_charging(case.realizations, case.instance.drone, result.robust.policy)
    flown = flown.judged(result.outcome, result.problem.depart_s)
    return Trial(rival, case.number, PLANNED, result.planning_time_s, len(result.itinerary), flown)


def _try_rolling(case: Case, rival: Contender) -> Trial:
    """Everything decided again at each stop; its planning time is that of one decision."""
    request = case.request(rival.recharge)
    started = time.perf_counter()
    start = _problem(case, request)
    policy = RollingRobust(start, case.realizations.errors)
    flown, done = fly_policy(case.realizations, case.instance.drone, policy, np.arange(case.compared))
    decisions = sum(len(legs) for legs in done)
    spent = (time.perf_counter() - started) / max(decisions, 1)
    return Trial(rival, case.number, PLANNED, spent, max((len(legs) for legs in done), default=0), flown)


def _problem(case: Case, request: Request) -> Problem:
    drone, parameters = case.scenario.drone(request.drone or ""), case.realizations.parameters
    return Problem(case.scenario, request, drone, case.forecast, parameters=parameters)


def _solve(case: Case, rival: Contender) -> tuple[Itinerary, Outcome | None, float]:
    """Itinerary, what the forecast makes of it (None where it is too long to be told), and planning time."""
    name, request = rival.planner, case.request(rival.recharge)
    if name not in FORECAST_PLANNERS:
        parameters = case.realizations.parameters
        result = plan(case.scenario, request, planner=name, forecast=case.forecast, parameters=parameters)
        return result.itinerary, result.outcome, result.planning_time_s
    problem = _problem(case, request)
    search = forecast_planner(name)(problem)
    started = time.perf_counter()
    itinerary = search.solve()
    spent = time.perf_counter() - started
    if len(itinerary) > MAX_FLIGHTS:
        return itinerary, None, spent
    return itinerary, outcome(problem, *fly_sampled(problem, itinerary)), spent


def _rows(
    instance: Instance,
    rivals: Sequence[Contender],
    trials: Sequence[Trial],
    known: dict[str, list[Floats]],
    spent: dict[str, float],
    cut: dict[str, int],
    compared: int,
) -> list[Row]:
    common = _common(instance, trials, compared)
    bound = next((known[name] for name in ("exact", "ies") if name in known), [])
    rows = []
    for rival in rivals:
        mine = [trial for trial in trials if trial.contender == rival]
        planning = tuple(trial.planning_s for trial in mine)
        whole, shared = [], []
        for trial in mine:
            if trial.flown is None:
                continue
            flown = trial.flown
            if bound:
                flown = replace(flown, clairvoyant_s=bound[trial.delivery][: len(flown)])
            whole.append(flown)
            shared.append(flown.chosen(common[trial.delivery][: len(flown)] & flown.delivered))
        rows.append(
            Row(
                instance.name,
                rival.label,
                clairvoyant=False,
                deliveries=len(mine),
                planned=len(whole),
                no_route=sum(trial.status == NO_ROUTE for trial in mine),
                wandered=sum(trial.status == WANDERED for trial in mine),
                cut_off=0,
                whole=summarise(rival.label, pooled(whole), planning) if whole else None,
                common=summarise(rival.label, pooled(shared)) if any(len(part) for part in shared) else None,
            )
        )
    for name, times in known.items():
        rows.append(_clairvoyant_row(instance, name, times, spent[name], cut[name], common))
    return rows


def _common(instance: Instance, trials: Sequence[Trial], compared: int) -> list[NDArray[np.bool_]]:
    """Of the runs of each delivery in which times are compared, those that all planners but those set apart delivered."""
    masks = [np.arange(instance.runs) < compared for _ in instance.deliveries]
    for trial in trials:
        if trial.contender.planner in APART:
            continue
        mask = masks[trial.delivery]
        if trial.flown is None:
            mask[:] = False
        else:
            mask[: len(trial.flown)] &= trial.flown.delivered
    return masks


def _clairvoyant_row(
    instance: Instance, name: str, times: list[Floats], spent_s: float, cut_off: int, common: list[NDArray[np.bool_]]
) -> Row:
    """Times that a planner who has perfect information plans: hourly wind, no gusts, no error of energy."""
    parts = []
    tried = 0
    for number, (found, mask) in enumerate(zip(times, common, strict=True)):
        block = np.full(len(found), number)
        tried += 1
        chosen = np.isfinite(found) & mask
        none = np.full(len(found), np.nan)
        zero = np.zeros(len(found), dtype=np.int64)
        flown = Flown(block, zero, np.zeros(len(found), dtype=bool), none, found, none, none, none)
        parts.append(flown.chosen(chosen))
    solved = sum(bool(np.isfinite(found).any()) for found in times)
    evaluation = summarise(name, pooled(parts), (spent_s / max(tried, 1),)) if any(map(len, parts)) else None
    return Row(
        instance.name,
        name,
        clairvoyant=True,
        deliveries=len(times),
        planned=solved,
        no_route=len(times) - solved - min(cut_off, len(times) - solved),
        wandered=0,
        cut_off=cut_off,
        whole=None,
        common=evaluation,
    )
