"""One entry to the dispatcher: `dispatch`."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import duration
from skyway.models.base.units import from_posix
from skyway.models.ledger.window import Window
from skyway.models.queues.seen_pads import NOTHING_SEEN, PadsSeen
from skyway.planner.dispatch.bound import lower_bound
from skyway.planner.dispatch.flight_kernels import (
    BEGIN,
    CHARGE,
    END,
    FLY,
    FROM,
    KIND,
    LOADED,
    ORDER,
    PAD,
    PHASE,
    SOC,
    SOC_AFTER,
    TO,
)
from skyway.planner.dispatch.flights import Laid, lay_out_problem, mode_problem
from skyway.planner.dispatch.improve import solve
from skyway.planner.dispatch.kept import before
from skyway.planner.dispatch.result import PHASES, Answer, DispatchPlan, Route, Step
from skyway.planner.dispatch.search import Search
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import DEFAULT_RESERVE_SOC
from skyway.planner.schedule.no_route import WindBetween

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from datetime import datetime

    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.orders.order import Order
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.dispatch.flights import Leg
    from skyway.planner.parameters.planner import PlannerParameters

MAX_EXPLAINED = 60
"""Number of refused orders for which a reason is computed."""
UNSERVED = "no drone of the fleet can pick it up, deliver it and return in time, even without other orders"


def dispatch(
    work: Work,
    depart: datetime,
    *,
    forecast: WindEnsemble | None = None,
    holds: Sequence[Hold] = (),
    reserve: float = DEFAULT_RESERVE_SOC,
    time_limit_s: float = 10.0,
    iterations: int = 10**9,
    seed: int = 0,
    parameters: PlannerParameters = USUAL,
    kept: Mapping[str, Sequence[Step]] | None = None,
    promised: Mapping[str, datetime] | None = None,
    once_promised: Collection[str] = (),
    margin_of: Mapping[str, DepartureMargin] | None = None,
    hope: WindEnsemble | None = None,
    closed: Mapping[Leg, float] | None = None,
    bounded: bool = True,
    seen: PadsSeen = NOTHING_SEEN,
) -> DispatchPlan:
    """Plan which drone takes which order when, over which pads.

    Parameters
    ----------
    work : Work
        Orders and drones, with their places in a scenario.
    depart : datetime
        Earliest beginning of any charge or flight.
    forecast : WindEnsemble, optional
        Forecast of the wind; the scenario's by default.
    holds : sequence of Hold
        Windows of pads that others have booked.
    reserve : float
        Least SoC at any landing.
    time_limit_s, iterations : float, int
        The search ends after either. The limit includes the time for laying out the problem, but leaves a fifth of itself to the search.
    seed : int
        Seed of all random numbers; with a limit on iterations alone the plan is reproducible.
    parameters : PlannerParameters, optional
        Parameters of the planners.
    kept : mapping of str to sequence of Step, optional
        Previously planned steps of each drone that have not begun: the search starts from them, and keeps them where possible.
    promised : mapping of str to datetime, optional
        Promised delivery times. A plan that changes promises is accepted only if its gain exceeds their cost.
    once_promised : collection of str
        Orders that ever had a promise, including those of `promised`: their priority is higher by one, and they are delivered late rather than refused.
    margin_of : mapping of str to DepartureMargin, optional
        Departure margin of each type of drone (`planner.dispatch.departure_margin`); the usual one by default.
    hope : WindEnsemble, optional
        A second forecast in which, with the usual margin, an order must also be infeasible to be reported as hopeless: measured winds are temporary.
    closed : mapping of Leg to float, optional
        Legs that are closed until a time, POSIX seconds.
    bounded : bool
        Whether the lower bound of the cost is computed; otherwise it is 0.
    seen : PadsSeen
        Other drones reported on the pads: expected waits start from this state.

    Raises
    ------
    InputError
        The plan reaches beyond the forecast, or the problem is too large.
    """
    started = time.perf_counter()
    forecast = forecast if forecast is not None else work.scenario.forecast(depart, HORIZON_H)
    once = {*once_promised, *(promised or {})}
    laid = lay_out_problem(
        work,
        depart,
        forecast,
        parameters,
        holds=holds,
        reserve=reserve,
        margin_of=margin_of,
        promised=once,
        closed=closed,
        seen=seen,
    )
    left_s = max(time_limit_s - (time.perf_counter() - started), 0.2 * time_limit_s)
    search = solve(
        laid.problem, parameters.dispatch, seed=seed, time_limit_s=left_s, iterations=iterations,
        before=before(work, laid, kept or {}, promised or {}),
    )  # fmt: skip
    routes, answers = result_of(work, laid, search)
    hoped = None
    if hope is not None and len(answers) < len(work.orders):
        hoped = lay_out_problem(work, depart, hope, parameters, holds=holds, reserve=reserve, promised=once, seen=seen)
    health = {one.id: one.battery_health for one in work.vehicles}
    energy_j = sum(
        (one.soc_begin - one.soc_end) * health[route.drone] * work.scenario.drone(route.type).battery_j
        for route in routes
        for one in route.steps
        if one.kind == "fly"
    )
    return DispatchPlan(
        depart=depart,
        answers=tuple(
            _explained(work, laid, answers, parameters, _WhyNever(work, depart, forecast, parameters), hoped)
        ),
        routes=tuple(routes),
        cost_s=search.cost,
        bound_s=lower_bound(laid.problem) if bounded else 0.0,
        energy_j=energy_j,
        iterations=search.iterations,
        planning_time_s=time.perf_counter() - started,
    )


def result_of(work: Work, laid: Laid, search: Search) -> tuple[list[Route], dict[int, Answer]]:
    """Convert the routes, and the outcome of each order, to the result."""
    stations = [work.scenario.network.stations[node].id for node in laid.places]
    first_pad, pads = laid.problem.flights.first_pad, laid.problem.flights.pads
    routes, answers = [], {}
    for drone in np.flatnonzero(search.routes.length):
        rows = search.steps[drone]
        steps = []
        windows: dict[int, list[Window]] = {}
        last = search.route(int(drone))[-1]
        for row in rows:
            charge = row[KIND] == CHARGE
            order = int(row[ORDER])
            begin, end = from_posix(row[BEGIN]), from_posix(row[END])
            place = int(row[FROM])
            pad = int(row[PAD]) - int(first_pad[place]) + 1 if charge and pads[place] else None
            steps.append(
                Step(
                    kind="charge" if charge else "fly",
                    order=None if order < 0 else work.orders[order].id,
                    phase=PHASES[int(row[PHASE])],
                    origin=stations[place],
                    destination=stations[int(row[TO])],
                    begin=begin,
                    end=end,
                    soc_begin=float(row[SOC]),
                    soc_end=float(row[SOC_AFTER]),
                    pad=pad,
                )
            )
            if pad is not None:
                windows.setdefault(last if order < 0 else order, []).append(
                    Window(station=stations[place], pad=pad, start=begin, end=end)
                )
        for order in search.route(int(drone)):
            flown = rows[(rows[:, ORDER] == order) & (rows[:, PHASE] == LOADED) & (rows[:, KIND] == FLY)]
            done = from_posix(flown[-1, END])
            answers[order] = Answer(
                order=work.orders[order].id,
                status="served",
                drone=work.vehicles[drone].id,
                fetched=from_posix(flown[0, BEGIN]),
                delivered=done,
                late_s=max((done - work.orders[order].due).total_seconds(), 0.0),
                windows=tuple(windows.get(order, ())),
            )
        orders = tuple(work.orders[one].id for one in search.route(int(drone)))
        vehicle = work.vehicles[drone]
        routes.append(Route(drone=vehicle.id, type=vehicle.type, orders=orders, steps=tuple(steps)))
    return routes, answers


class _WhyNever:
    """Why no drone can serve an order, even alone: its mass, else the wind, where that stops all drones that can carry it."""

    def __init__(self, work: Work, depart: datetime, forecast: WindEnsemble, parameters: PlannerParameters) -> None:
        self._work, self._depart, self._index = work, depart, work.scenario.network.index
        self._wind_of = cache(
            lambda type_: WindBetween(mode_problem(work, depart, forecast, parameters, work.scenario.drone(type_), 0.0))
        )

    def overdue(self, order: Order) -> str:
        """Say that the due time of an order has passed when the plan begins, before another reason; empty if it has not."""
        return "its due time passed before the plan begins; " if order.due <= self._depart else ""

    def __call__(self, order: Order) -> str:
        return self._work.too_heavy(order) or self._wind(order) or UNSERVED

    def _wind(self, order: Order) -> str | None:
        found = None
        for drone in self._work.carriers(order):
            stops = [self._index[one] for one in (drone.place, order.origin, order.destination, drone.home)]
            closings = (self._wind_of(drone.type).closing(start, goal) for start, goal in pairwise(stops))
            here = next(filter(None, closings), None)
            if here is None:
                return None
            found = found or here
        return found


def _explained(
    work: Work, laid: Laid, answers: dict[int, Answer], parameters: PlannerParameters, never: _WhyNever, hoped: Laid | None = None
) -> list[Answer]:  # fmt: skip
    """Give each order that is not served a reason: its outcome as the only order; hopeless if it is infeasible in the forecast `hope`, too."""
    refused = [number for number in range(len(work.orders)) if number not in answers]
    forever = np.full(len(work.orders), np.inf)
    alone, at_best = (
        Search(
            replace(one.problem, orders=one.problem.orders._replace(latest_s=forever), taken=()), parameters.dispatch
        )
        if refused and one is not None
        else None
        for one in (laid, hoped)
    )
    for count, number in enumerate(refused):
        order = work.orders[number]
        reason, hopeless = "the drones and pads serve orders of greater weight", False
        if alone is not None and count < MAX_EXPLAINED:
            latest = float(laid.problem.orders.latest_s[number])
            found, hopeless = _alone(work, alone, number, reason, latest)
            reason = never.overdue(order) + (found or never(order))
            if hopeless and at_best is not None:
                hopeless = _alone(work, at_best, number, reason, latest)[1]
        answers[number] = Answer(order=order.id, status="refused", reason=reason, hopeless=hopeless)
    return [answers[number] for number in range(len(work.orders))]


def _alone(work: Work, alone: Search, number: int, otherwise: str, latest_s: float) -> tuple[str | None, bool]:
    """Return the reason why an order is not served, from its outcome as the only order, and whether even that is infeasible; no reason if no drone can serve it at all."""
    drones, added, position = alone.tried(number)
    if not len(drones) or not np.isfinite(added).any():
        return None, True
    best = int(np.argmin(added))
    drone = int(drones[best])
    before = alone.saved(drone)
    if not alone.insert(number, drone, int(position[best])):
        return otherwise, False
    rows = alone.steps[drone]
    done_s = float(rows[(rows[:, ORDER] == number) & (rows[:, PHASE] == LOADED)][-1, END])
    alone.restore(drone, before)
    alone.drone_of[number] = -1
    if done_s > latest_s:
        late_s = done_s - work.orders[number].due.timestamp()
        return f"even without other orders it would be {duration(late_s)} late, with {work.vehicles[drone].id}", True
    return f"{otherwise}; alone, {work.vehicles[drone].id} could deliver it", False
