"""One entry to the search for tours: `solve`. After each cooling, the best selection of all routes found (`planner.tours.partition`)."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.planner.tours.charger_kernels import clear, drive, lateness
from skyway.planner.tours.partition import EDGE, Jobs, partition
from skyway.planner.tours.route_kernels import insertion
from skyway.planner.tours.search import Search
from skyway.planner.tours.search_kernels import copy_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.planner.parameters.tours import ToursParameters
    from skyway.planner.tours.problem import Tours

CHOICES = 8
"""Number of selections of routes if those selected are not jointly feasible."""
FEWER = 0.02
"""Temperature while the number of vehicles is reduced, in mean tours with one customer."""
BUILT = 2000
"""Iterations of the initial plan."""
SERVED_SHARE = 0.2
"""Share of the time by which the first plan in time is complete."""
CHEAPEST_TRIED = 3
"""Places at which a customer is inserted again, if nothing becomes late by that."""


def solve(
    tours: Tours,
    parameters: ToursParameters,
    *,
    seed: int = 0,
    time_limit_s: float = 60.0,
    iterations: int = 10**9,
    fewest_vehicles: bool = False,
) -> Search:
    """Search for tours, within a time limit or a number of iterations.

    Parameters
    ----------
    tours : Tours
        The problem.
    parameters : ToursParameters
        Parameters of the search.
    seed : int
        Seed of all random numbers; with a limit on iterations alone the tours are reproducible.
    time_limit_s, iterations : float, int
        The search ends after either.
    fewest_vehicles : bool
        Whether the number of vehicles is minimized first, whatever the cost.

    Raises
    ------
    InputError
        The limit is not above 0.
    """
    if not time_limit_s > 0.0:
        raise InputError("must be above 0", field="--time-limit", value=time_limit_s)
    search = Search(tours, parameters, seed)
    _warm_up(tours, parameters)
    begin = time.perf_counter()
    end_at, vehicles = begin + time_limit_s, len(tours.vehicles.begin)
    if len(tours.ready) < 2:
        return search
    search.run(
        end_at=end_at,
        iterations=min(BUILT, iterations),
        warm=parameters.cool,
        cool=parameters.cool,
        most_routes=vehicles,
    )
    _serve_in_time(search, begin + SERVED_SHARE * time_limit_s)
    most = vehicles
    if fewest_vehicles:
        share = parameters.fleet_share
        most = _fewer(search, begin + share * time_limit_s, int(share * iterations))
        search.forget()
    rest, left = end_at - time.perf_counter(), max(iterations - search.iterations, 1)
    for number in range(parameters.rounds):
        search.restart()
        spent = (number + 1) / parameters.rounds
        cooled_at = end_at - rest * (1.0 - spent + parameters.choice_share / parameters.rounds)
        last = 0 < number == parameters.rounds - 1
        warm = (parameters.warm * parameters.cool) ** 0.5 if last else parameters.warm
        search.run(
            end_at=cooled_at,
            iterations=max(left // parameters.rounds, 1),
            warm=warm,
            cool=parameters.cool,
            most_routes=most,
        )
        _serve_in_time(search, end_at - rest * (1.0 - spent))
        _choose(search, most, end_at - rest * (1.0 - spent))
    return search


def _warm_up(tours: Tours, parameters: ToursParameters) -> None:
    """Compile the kernels, so that the search has its time."""
    first = Search(tours, parameters)
    first.run(end_at=np.inf, iterations=1, warm=1.0, cool=1.0, most_routes=1)


def _fewer(search: Search, end_at: float, iterations: int) -> int:
    """Remove routes one after the other, as long as their customers are inserted elsewhere in time; return the remaining number."""
    tours = search.tours
    least = int(np.ceil(tours.demand.sum() / max(float(tours.vehicles.capacity.max()), 1e-9) - 1e-9))
    last = search.iterations + iterations
    while not len(search.refused) and search.used > max(least, 1):
        saved, most = search.saved(), search.used - 1
        search.restart()
        search.drop_route()
        search.best_cost = float(tours.refusal[1:].sum())
        search.run(
            end_at=end_at,
            iterations=max(last - search.iterations, 1),
            warm=FEWER,
            cool=FEWER,
            most_routes=most,
            until_served=True,
        )
        if (search.plan.route_of[1:] < 0).any() or len(search.refused):
            search.restore(saved)
            break
    return search.used


def _choose(search: Search, most_routes: int, end_at: float) -> None:
    """Select the best of all routes found; again without those that are not jointly feasible."""
    from scipy.sparse import csr_array

    tours = search.tours
    count = int(search.pool.filled[0])
    if not count or len(search.refused) or len(np.unique(tours.vehicles.kind)) > 1:
        return
    routes = [search.pooled(number) for number in range(count)]
    rows = np.concatenate([np.array(customers) - 1 for customers, _, _ in routes])
    columns = np.repeat(np.arange(count), [len(customers) for customers, _, _ in routes])
    served = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(tours.ready) - 1, count))
    cost = np.array([cost for _, _, cost in routes])
    jobs = None
    if tours.depot.chargers:
        found = np.array([search.job(customers, ways) for customers, ways, _ in routes], dtype=np.int64)
        jobs = Jobs(found[:, 0], found[:, 1], tours.depot.chargers)
    apart: list[list[int]] = []
    for _ in range(CHOICES):
        left = min(end_at - time.perf_counter(), search.parameters.choice_s)
        if left <= 0.0:
            break
        picked = partition(
            served, cost, most_cost=search.best_cost, most_routes=most_routes, jobs=jobs, apart=apart, time_limit_s=left
        )
        if picked is None or search.take([routes[number][:2] for number in picked]):
            break
        apart.append(picked.tolist())


def _serve_in_time(search: Search, end_at: float) -> None:
    """Make the present plan one in time, if it is late since pads are few and too many customers are served: those for whom a tour is late leave it, and are inserted where nothing becomes late.

    The search alone finds no such plan: it inserts every customer whom the energy and the windows of a tour allow, whether or not pads are free.
    """
    plan, tours = search.trial, search.tours
    if not len(tours.pads.number) or not len(search.refused):
        return
    copy_plan(search.plan, plan)
    clear(tours, search.chargers.calendar)
    for vehicle in np.flatnonzero(plan.length).tolist():
        _relieve(search, vehicle)
    absent = np.flatnonzero(plan.route_of[1:] < 0) + 1
    for node in absent[np.argsort(-tours.refusal[absent], kind="stable")].tolist():
        if time.perf_counter() >= end_at:
            break
        _insert_in_time(search, node)
    search.keep_trial()


def _relieve(search: Search, vehicle: int) -> None:
    """Take out customers of a tour of the trial plan until it is in time on the pads that the tours before it leave; book its pads."""
    plan, tours, calendar = search.trial, search.tours, search.chargers.calendar
    booked = calendar.filled.copy(), *(part[:, : calendar.filled.max() + 1].copy() for part in calendar[:3])

    def late() -> float:
        found = drive(tours, plan, vehicle, calendar, search.chargers.silent)[0]
        calendar.filled[:] = booked[0]
        for part, before in zip(calendar[:3], booked[1:], strict=True):
            part[:, : before.shape[1]] = before
        return float(found)

    while plan.length[vehicle] and late() > 0.0:
        customers = plan.customer[vehicle, : plan.length[vehicle]].tolist()
        tried = []
        for position, node in enumerate(customers):
            if _lay_out_again(search, vehicle, customers[:position] + customers[position + 1 :]):
                tried.append((late(), float(tours.refusal[node]), position))
        position = min(tried)[2] if tried else 0
        left = customers[:position] + customers[position + 1 :]
        if not _lay_out_again(search, vehicle, left):
            _lay_out_again(search, vehicle, [])
    if plan.length[vehicle]:
        drive(tours, plan, vehicle, calendar, search.chargers.silent)


def _lay_out_again(search: Search, vehicle: int, customers: Sequence[int]) -> bool:
    """Give a vehicle of the trial plan some customers, in this order, with the cheapest ways to each; false if that is not feasible."""
    plan = search.trial
    plan.route_of[plan.route_of == vehicle] = -1
    plan.length[vehicle] = 0
    ways: list[int] = []
    for count, node in enumerate(customers):
        _, to, on = insertion(search.tours, plan, vehicle, count, node, np.inf)
        ways = [*ways[:-1], to, on]
        if to < 0 or not search.put(plan, vehicle, customers[: count + 1], ways):
            return False
    return True


def _insert_in_time(search: Search, node: int) -> None:
    """Insert a customer into a tour of the trial plan, or a new one, where that costs least and nothing becomes late by it."""
    plan, tours = search.trial, search.tours
    idle = np.flatnonzero(plan.length == 0)
    first_idle = idle[np.unique(tours.vehicles.kind[idle], return_index=True)[1]]
    load = np.where(plan.length > 0, plan.load, 0.0) + tours.demand[node]
    vehicles = np.concatenate((np.flatnonzero(plan.length), first_idle))
    vehicles = vehicles[load[vehicles] <= tours.vehicles.capacity[vehicles] + EDGE]
    places = [(vehicle, at) for vehicle in vehicles.tolist() for at in range(int(plan.length[vehicle]) + 1)]
    found = sorted((*insertion(tours, plan, vehicle, at, node, np.inf), vehicle, at) for vehicle, at in places)
    for cost, to, on, vehicle, at in found[:CHEAPEST_TRIED]:
        if cost >= tours.refusal[node]:
            return
        count = int(plan.length[vehicle])
        customers, ways = plan.customer[vehicle, :count].tolist(), plan.way[vehicle, : count + 1].tolist()
        longer = [*customers[:at], node, *customers[at:]], [*ways[:at], to, on, *ways[at + 1 :]]
        if search.put(plan, vehicle, *longer) and lateness(tours, plan, search.chargers) == 0.0:
            return
        plan.route_of[node] = -1
        search.put(plan, vehicle, customers, ways)
