"""One simulated day of a fleet: planned with a forecast that excludes the day, flown in its wind, with other drones at the pads."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import S_PER_H
from skyway.models.drones.energy_belief import LEAST_RATIO
from skyway.models.orders.fitting import fit
from skyway.planner.capacity.changes import NOTHING, Change, changed
from skyway.planner.capacity.demand import ENERGY, STRANGERS, Demand, draws, drones_of, orders_of
from skyway.planner.capacity.execution import HORIZON_S, WARM_UP_S, carry_out, strangers
from skyway.planner.dispatch.dispatch import result_of
from skyway.planner.dispatch.flights import Laid, lay_out_problem
from skyway.planner.dispatch.improve import solve
from skyway.planner.dispatch.search import Search
from skyway.planner.parameters.planner import USUAL, PlannerParameters
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import DEFAULT_EPSILON
from skyway.planner.promises.promises import fly_plan
from skyway.planner.promises.worlds import checked_ratio, power_shares

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import date, datetime
    from pathlib import Path

    from skyway.models.drones.drone import Drone
    from skyway.models.orders.fitting import Work
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.result import Route, Step

SLACK_SOC = 0.005
"""A landing below the reserve by less than this does not count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Common data of all days of a study."""

    scenario: Path | None
    """Folder; None is the built-in one."""
    digest: str
    """Digest of its files: every worker has the same."""
    begin: datetime
    """Departure of the orders: the hour of the day, and the season."""
    days: tuple[date, ...]
    """Days of the record that provide the wind, one after another."""
    demand: Demand
    drone: str
    reserve: float = 0.2
    iterations: int = 0
    """Number of changes tried to improve the plan of a day; 0: orders are promised one after another, in order of time."""
    seed: int = 0
    parameters: PlannerParameters = USUAL


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Parameters that vary from case to case."""

    rate_per_h: float
    promise_s: float
    drones: int
    change: Change = NOTHING


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """One day of one case."""

    study: Study
    case: Case
    day: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DayDone:
    """Results of the orders of a day."""

    orders: int
    promised: int
    delivered: int
    on_time: int
    """Delivered as promised."""
    stated: float
    """Sum of the probabilities with which they were promised; NaN if none are worked out."""
    waited_s: float
    """For pads, of all delivered orders."""
    delivery_s: float
    """From ready to delivered, of all delivered orders."""
    landings: int
    below: int
    """Landings below the reserve."""
    missed: tuple[tuple[str, str], ...] = ()
    """Origins and destinations of orders that were not delivered in time."""


@lru_cache(maxsize=1)
def _scenario(folder: Path | None, digest: str, load: Callable[[Path | None], Scenario]) -> Scenario:
    found = load(folder)
    if found.sha256 != digest:
        remedy = "give all workers the same folder"
        raise InputError("a worker has other files of the scenario", str(folder), remedy=remedy)
    return found


@lru_cache(maxsize=64)
def _changed(base: tuple[Path | None, str, Callable[[Path | None], Scenario]], change: Change) -> Scenario:
    return changed(_scenario(*base), change)


def simulate(piece: Piece, load: Callable[[Path | None], Scenario]) -> DayDone:
    """Plan and fly one day; the same piece gives the same day on every machine."""
    study, case = piece.study, piece.case
    base = _scenario(study.scenario, study.digest, load)
    model = base.drone(study.drone)
    drones = drones_of(base, study.drone, case.drones, study.seed, piece.day, case.change.drones)
    orders = orders_of(base, study.demand, case.rate_per_h, case.promise_s, study.begin, study.seed, piece.day, model.max_payload_kg)  # fmt: skip
    if not orders:
        return DayDone(
            orders=0, promised=0, delivered=0, on_time=0, stated=0.0, waited_s=0.0, delivery_s=0.0, landings=0, below=0
        )
    work = fit(_changed((study.scenario, study.digest, load), case.change), orders, drones)
    day = study.days[piece.day % len(study.days)]
    forecast = work.scenario.analogues(study.begin, HORIZON_H, day)
    prompt = replace(study.parameters, dispatch=replace(study.parameters.dispatch, max_late_s=0.0))
    laid = lay_out_problem(work, study.begin, forecast, prompt, reserve=study.reserve)
    search = _planned(laid, study, piece.day)
    routes, answers = result_of(work, laid, search)
    stated = _stated(work, routes, [one.order for one in answers.values()], forecast, study)
    true_wind = work.scenario.truth(day, study.begin, HORIZON_H)
    met = lay_out_problem(work, study.begin, true_wind, study.parameters, reserve=0.0, margins=False)
    truth = DayTruth(work, met, model, study.parameters.dispatch.margin, draws(study.seed, piece.day, ENERGY))
    ready = {one.id: one.ready.timestamp() for one in work.orders}
    pads = {one.id: one.pads for one in work.scenario.network.stations if one.pads}
    horizon_s = _horizon_s(study, case)
    others = _others(work.scenario, study, piece.day, horizon_s)
    done = carry_out(routes, ready, pads, others, study.begin.timestamp(), truth, study.reserve, horizon_s)
    due = {one.id: one.due.timestamp() for one in work.orders}
    kept = {name for name, at in done.delivered_s.items() if at <= due[name] + 1e-6}
    return DayDone(
        orders=len(orders), promised=len(answers), delivered=len(done.delivered_s), on_time=len(kept),
        stated=stated,
        waited_s=math.fsum(done.waited_s.get(one, 0.0) for one in done.delivered_s),
        delivery_s=math.fsum(at - ready[one] for one, at in done.delivered_s.items()),
        landings=len(done.lowest), below=sum(one < study.reserve - SLACK_SOC for one in done.lowest),
        missed=tuple((one.origin, one.destination) for one in work.orders if one.id not in kept),
    )  # fmt: skip


def _planned(laid: Laid, study: Study, day: int) -> Search:
    parameters = study.parameters.dispatch
    if study.iterations:
        return solve(laid.problem, parameters, seed=study.seed + day, time_limit_s=1e9, iterations=study.iterations)
    search = Search(laid.problem, parameters)
    for order in np.argsort(laid.problem.orders.ready_s, kind="stable"):
        search.insert_best(int(order))
    return search


def _stated(
    work: Work, routes: Sequence[Route], promised: Sequence[str], forecast: WindEnsemble, study: Study
) -> float:
    """Sum of the probabilities with which orders are promised: the plan is flown in the winds of the forecast."""
    if not study.parameters.dispatch.worlds:
        return math.nan
    if not promised:
        return 0.0
    done = fly_plan(work, routes, study.begin, forecast, study.parameters, reserve=study.reserve)
    due = {one.id: (number, one.due.timestamp()) for number, one in enumerate(work.orders)}
    numbers, due_s = zip(*(due[name] for name in promised), strict=True)
    return float((done.delivered_s[:, numbers] <= np.array(due_s) + 1e-6).mean(axis=0).sum())


def _horizon_s(study: Study, case: Case) -> float:
    """Time until which a day is simulated: whole hours, at least one after the last order is due."""
    last_due_s = study.demand.hours * S_PER_H + case.promise_s
    return max(HORIZON_S, S_PER_H * math.ceil(last_due_s / S_PER_H + 1.0))


def _others(scenario: Scenario, study: Study, day: int, horizon_s: float) -> dict[str, list[tuple[float, float]]]:
    """Other drones of a day at each station, by the load of each hour."""
    stations, begin_s = scenario.network.stations, study.begin.timestamp()
    hours = int((WARM_UP_S + horizon_s) / S_PER_H)
    loads = [scenario.load.hourly(node, begin_s - WARM_UP_S, hours) for node in range(len(stations))]
    seed = int(draws(study.seed, day, STRANGERS).integers(2**31))
    drawn = strangers(
        np.array([one[0] for one in loads]), np.array([one[1] for one in loads]), begin_s, seed, horizon_s
    )
    return {one.id: drawn[node] for node, one in enumerate(stations) if one.pads}


class DayTruth:
    """Actual flights and charges of a day: its wind, and aircraft whose consumption differs from the model."""

    def __init__(self, work: Work, laid: Laid, drone: Drone, margin: float, random: np.random.Generator) -> None:
        network = work.scenario.network
        self._flights = laid.problem.flights
        self._place = {network.stations[node].id: number for number, node in enumerate(laid.places)}
        self._drone = {one.id: number for number, one in enumerate(work.vehicles)}
        orders = laid.problem.orders
        self._loaded = {one.id: int(orders.mode[0, number]) for number, one in enumerate(work.orders)}
        self._share = dict(zip((one.id for one in work.orders), power_shares(work, laid)[0].tolist(), strict=True))
        self._empty = int(laid.problem.fleet.empty_mode[0])
        belief = USUAL_ERRORS.energy_of(drone)
        self._ratio = belief.mean_ratio + belief.sd_between * random.standard_t(
            belief.degrees_of_freedom, len(work.vehicles)
        )
        self._within = belief.sd_within
        self._freedom = belief.degrees_of_freedom
        self._checked = checked_ratio(belief, margin, DEFAULT_EPSILON)
        self._key = int(random.integers(2**31))

    def flight(self, drone: str, step: Step, begin_s: float) -> tuple[float, float]:
        """Time and charge of a flight that begins then."""
        flights, at = self._flights, self._at(step, begin_s)
        number = self._drone[drone]
        key = (self._key, number, int(step.begin.timestamp()), self._place[step.destination])
        fresh = self._within * float(np.random.default_rng(key).standard_t(self._freedom))
        ratio = max(float(self._ratio[number]) + fresh, LEAST_RATIO)
        return float(flights.time_s[at]), ratio * self._mass_share(step) * float(flights.need[at])

    def wanted(self, drone: str, step: Step, begin_s: float) -> float:
        """Charge required by the check before a take-off beyond the reserve: for all but a share epsilon of flights in the wind of that time."""
        del drone
        return self._checked * self._mass_share(step) * float(self._flights.need[self._at(step, begin_s)])

    def _mass_share(self, step: Step) -> float:
        """Power with the package over that of its class."""
        return self._share[step.order] if step.order is not None and step.phase == "with the package" else 1.0

    def _at(self, step: Step, begin_s: float) -> tuple[int, int, int, int]:
        flights = self._flights
        mode = self._loaded[step.order] if step.order is not None and step.phase == "with the package" else self._empty
        slot = min(max(int((begin_s - flights.start_s) / flights.slot_s), 0), flights.time_s.shape[1] - 1)
        return mode, slot, self._place[step.origin], self._place[step.destination]

    def charging_s(self, drone: str, place: str, soc: float, up_to: float) -> float:
        """Time of a charge."""
        del drone
        flights = self._flights
        curve = flights.curve_of[0, self._place[place]]
        level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
        return float(np.interp(up_to, level, at_s) - np.interp(soc, level, at_s))
