"""One entry to tours of a fleet: `plan_tours`."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import from_posix
from skyway.models.ledger.window import Window
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.dispatch.result import Answer, DispatchPlan, Route, Step
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import DEFAULT_RESERVE_SOC
from skyway.planner.tours.charger_kernels import (
    BEGIN,
    CHARGE,
    END,
    ENERGY,
    ENERGY_AFTER,
    KIND,
    MOVE,
    NODE,
    PAD,
    SERVE,
    STATION,
)
from skyway.planner.tours.earlier import deliver_earlier
from skyway.planner.tours.fleet import group_of
from skyway.planner.tours.solve import solve

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.fitting import Work
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.flights import Laid
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.tours.fleet import Group, Taken
    from skyway.planner.tours.search import Search

NO_DRONE = "no drone of the fleet stands at its station and is at home there"
HOPELESS = "no drone there can deliver it by its due time and return, even without other orders"
CROWDED = "the drones and pads serve orders of greater weight"


def plan_tours(
    work: Work,
    depart: datetime,
    *,
    forecast: WindEnsemble | None = None,
    holds: Sequence[Hold] = (),
    reserve: float = DEFAULT_RESERVE_SOC,
    time_limit_s: float = 10.0,
    iterations: int = 10**9,
    seed: int = 0,
    fewest_drones: bool = False,
    parameters: PlannerParameters = USUAL,
) -> DispatchPlan:
    """Plan tours: each drone leaves its station once, with all of its packages on board, and returns after the last one.

    Orders of a station are flown by the drones that stand there and have it as home; type by type, the one with the greatest payload first. Orders that would be late are refused.

    Parameters
    ----------
    work, depart, forecast, holds, reserve, time_limit_s, iterations, seed, parameters
        As for `planner.dispatch.dispatch.dispatch`.
    fewest_drones : bool
        Whether the number of drones is minimized first, whatever time and energy they take.

    Raises
    ------
    InputError
        The plan reaches beyond the forecast, or the problem is too large.
    """
    started = time.perf_counter()
    forecast = forecast if forecast is not None else work.scenario.forecast(depart, HORIZON_H)
    loads_kg = [drone.max_payload_kg for drone in work.scenario.drones]
    laid = lay_out_problem(work, depart, forecast, parameters, holds=holds, reserve=reserve, loads_kg=loads_kg)
    taken: list[Taken] = list(laid.problem.taken)
    routes: list[Route] = []
    answers: dict[int, Answer] = {}
    cost = tried = 0.0
    teams = _teams(work, laid)
    for place, drones in teams:
        orders = [
            number
            for number in range(len(work.orders))
            if laid.problem.orders.origin[number] == place and number not in answers
        ]
        if not orders:
            continue
        group = group_of(work, laid, drones, orders, depart.timestamp(), taken, parameters)
        search = solve(group.tours, parameters.tours, seed=seed, time_limit_s=time_limit_s / len(teams), iterations=max(iterations // len(teams), 1), fewest_vehicles=fewest_drones)  # fmt: skip
        deliver_earlier(search)
        cost, tried = cost + search.cost, tried + search.iterations
        for vehicle, rows in search.timetables().items():
            route, found = _result_of(work, laid, group, group.drones[vehicle], rows)
            routes.append(route)
            answers.update(found)
            charges = rows[(rows[:, KIND] == CHARGE) & (rows[:, PAD] >= 0)]
            taken += [(int(row[PAD]), group.begin_s + row[BEGIN], group.begin_s + row[END]) for row in charges]
        for node in search.refused.tolist():
            key = -1 - group.orders[node - 1]
            if key not in answers or answers[key].hopeless:  # drones of another type could have served it
                answers[key] = _refused(work, group, search, node)
    every = tuple(
        answers.get(number) or answers.get(-1 - number) or _unserved(work, number) for number in range(len(work.orders))
    )
    cost += float(
        sum(laid.problem.orders.refusal_s[number] for number in range(len(every)) if every[number].status == "refused")
    )
    return DispatchPlan(
        depart=depart, answers=every, routes=tuple(routes), cost_s=cost, bound_s=0.0, energy_j=_energy_j(work, routes),
        iterations=int(tried), planning_time_s=time.perf_counter() - started,
    )  # fmt: skip


def _teams(work: Work, laid: Laid) -> list[tuple[int, list[int]]]:
    """Drones of one type that stand at their home, where orders begin, by station; those of the greatest payload first."""
    teams: dict[tuple[int, str], list[int]] = {}
    wanted = set(laid.problem.orders.origin.tolist())
    for number, drone in enumerate(work.vehicles):
        if drone.place == drone.home and int(laid.problem.fleet.place[number]) in wanted:
            teams.setdefault((int(laid.problem.fleet.place[number]), drone.type), []).append(number)
    order = sorted(teams, key=lambda team: (team[0], -work.scenario.drone(team[1]).max_payload_kg, team[1]))
    return [(team[0], teams[team]) for team in order]


def _refused(work: Work, group: Group, search: Search, node: int) -> Answer:
    alone, order = search.alone(node), work.orders[group.orders[node - 1]]
    reason = CROWDED if alone else work.too_heavy(order) or HOPELESS
    return Answer(order=order.id, status="refused", reason=reason, hopeless=not alone)


def _unserved(work: Work, number: int) -> Answer:
    order = work.orders[number]
    return Answer(order=order.id, status="refused", reason=work.too_heavy(order) or NO_DRONE, hopeless=True)


def _energy_j(work: Work, routes: Sequence[Route]) -> float:
    vehicles = {one.id: one for one in work.vehicles}
    return sum(
        (one.soc_begin - one.soc_end) * vehicles[route.drone].battery_health * work.scenario.drone(route.type).battery_j
        for route in routes
        for one in route.steps
        if one.kind == "fly"
    )


def _without_waiting(rows: NDArray[np.float64], due: NDArray[np.float64]) -> NDArray[np.float64]:
    """Postpone a departure, to reduce the waits on the way: as far as nothing is late, and no booked pad is affected.

    With the waits W_i before customers and their slack d_i = due - begin: by min over i of (W_1 + … + W_i + d_i), and no more than all waits, before the first charge.
    """
    charges = np.flatnonzero(rows[:, KIND] == CHARGE)
    part = rows[: charges[0] if len(charges) else len(rows)]
    waited, room = 0.0, np.inf
    for before, row in pairwise(part):
        if row[KIND] == SERVE:
            waited += row[BEGIN] - before[END]
            room = min(room, waited + due[int(row[NODE])] - row[BEGIN])
    put_off = min(waited, room)
    shifted = rows.copy()
    for number in range(len(part)):
        if part[number, KIND] == SERVE:
            put_off = max(put_off - (part[number, BEGIN] - part[number - 1, END]), 0.0)
        shifted[number, [BEGIN, END]] += put_off
    return shifted


def _result_of(
    work: Work, laid: Laid, group: Group, drone: int, rows: NDArray[np.float64]
) -> tuple[Route, dict[int, Answer]]:
    """Convert the timetable of a drone, and the outcome of its orders, to the result."""
    network, flights = work.scenario.network, laid.problem.flights
    name = [network.stations[node].id for node in laid.places]
    health, vehicle = work.vehicles[drone].battery_health, work.vehicles[drone]
    rows = _without_waiting(rows, group.tours.due)
    steps: list[Step] = []
    windows: dict[int, list[Window]] = {}
    served: list[int] = []
    done: dict[int, datetime] = {}
    at = group.place
    for row in rows:
        node = int(row[NODE])
        order = group.orders[node - 1] if node else None
        waited = group.waits_s[int(row[STATION])] if row[KIND] == MOVE and row[STATION] >= 0 else 0.0
        begin, end = (from_posix(group.begin_s + time) for time in (row[BEGIN], row[END] - waited))
        if row[KIND] == SERVE:
            served.append(group.orders[node - 1])
            done[served[-1]] = begin
            continue
        stop = int(row[STATION])
        goal = (
            int(flights.stops[stop])
            if stop >= 0
            else group.place
            if order is None
            else int(laid.problem.orders.destination[order])
        )
        charge = row[KIND] == CHARGE
        if goal != at or charge:
            soc = [flights.reserve + float(row[column]) / health for column in (ENERGY, ENERGY_AFTER)]
            pad = int(row[PAD]) - int(flights.first_pad[goal]) + 1 if charge else None
            steps.append(
                Step(
                    kind="charge" if charge else "fly", order=None if order is None else work.orders[order].id,
                    phase="home" if order is None else "with the package", origin=name[at], destination=name[goal], begin=begin, end=end,
                    soc_begin=soc[0], soc_end=soc[1], pad=pad,
                )
            )  # fmt: skip
            if pad is not None:
                key = served[-1] if order is None else order
                windows.setdefault(key, []).append(Window(station=name[goal], pad=pad, start=begin, end=end))
        at = goal
    left = next((one.begin for one in steps if one.kind == "fly"), from_posix(group.begin_s + rows[0, BEGIN]))
    answers = {
        order: Answer(
            order=work.orders[order].id, status="served", drone=vehicle.id, fetched=left, delivered=done[order], windows=tuple(windows.get(order, ()))
        )
        for order in served
    }  # fmt: skip
    return Route(
        drone=vehicle.id, type=vehicle.type, orders=tuple(work.orders[one].id for one in served), steps=tuple(steps)
    ), answers
