"""Earlier deliveries at equal cost: `deliver_earlier`, after the search for tours.

The cost of a plan does not depend on when its packages are delivered, and many plans cost the same: a charge costs as much between two packages for one place as
after both of them, and a delivery as much on the first passage of a place as on the second.
"""

from __future__ import annotations

from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.tours.charger_kernels import BEGIN, KIND, NODE, SERVE, lateness
from skyway.planner.tours.route_kernels import GAIN
from skyway.planner.tours.search_kernels import copy_plan

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.search import Search

MOST_CHOICES = 64
"""Choices of ways that are tried for one order of customers, at most."""
MOST_TRIED = 4000
"""Choices of ways that are tried in all, at most."""
SOONER = 1e-9
"""A sum of times is less if it is less by this share."""


def deliver_earlier(search: Search) -> None:
    """Change the best plan of a search so that its customers are served earlier, in sum, at no higher cost; the time of each is weighted by the cost of not serving it.

    A customer of a tour is moved, a part of a tour is reversed, or two vehicles exchange their tours; for each order of customers all ways are tried that cost no more in sum.
    What is better is accepted at once, until nothing is, or `MOST_TRIED` choices of ways were tried.
    """
    if not search.used:
        return
    search.restart()
    served_at = _service_times(search)
    left, improved = MOST_TRIED, True
    while improved:
        improved = False
        for first, second in _exchanges(search):
            for orders in list(_orders(search, first, second)):
                found, tried = _first_better(search, orders, served_at, left)
                left -= tried
                improved |= found is not None
                served_at = found if found is not None else served_at
                if left <= 0:
                    return


def _exchanges(search: Search) -> Iterator[tuple[int, int]]:
    """Return each used vehicle with itself, and all pairs of vehicles that differ, of which one is used."""
    length, kind = search.best.length, search.tours.vehicles.kind
    for vehicle in np.flatnonzero(length).tolist():
        yield vehicle, vehicle
    for first, second in combinations(range(len(length)), 2):
        if kind[first] != kind[second] and (length[first] or length[second]):
            yield first, second


def _orders(search: Search, first: int, second: int) -> Iterator[dict[int, list[int]]]:
    """Return orders of customers for one vehicle, or for two that exchange theirs."""
    customers, others = search.route(first)[0], search.route(second)[0]
    if first != second:
        yield {first: others, second: customers}
        return
    yield {first: customers}
    for begin in range(len(customers)):
        without = customers[:begin] + customers[begin + 1 :]
        for at in range(len(customers)):
            if at not in {begin, begin - 1}:
                yield {first: [*without[:at], customers[begin], *without[at:]]}
        for end in range(begin + 3, len(customers) + 1):
            yield {first: customers[:begin] + customers[begin:end][::-1] + customers[end:]}


def _first_better(
    search: Search, orders: dict[int, list[int]], served_at: NDArray[np.float64], left: int
) -> tuple[NDArray[np.float64] | None, int]:
    """Make the best plan the first one with some orders of customers that is better; return its times of service, None if there is none, and how many choices of ways were tried."""
    tours, weights = search.tours, search.tours.refusal
    vehicles = np.array(sorted(vehicle for vehicle in orders if orders[vehicle]))
    nodes = np.array([node for customers in orders.values() for node in customers])
    most_cost = sum(float(search.best.cost[vehicle]) for vehicle in orders)
    goal = (weights[nodes] * served_at[nodes]).sum()
    pairs = [pair for customers in orders.values() if customers for pair in pairwise((0, *customers, 0))]
    tried = 0
    for ways in _choices(tours, pairs, most_cost + GAIN):
        tried += 1
        chosen = iter(ways)
        routes = {
            one: (order, [next(chosen) for _ in range(len(order) + 1)] if order else [])
            for one, order in orders.items()
        }
        if all(search.put(search.trial, one, *route) for one, route in routes.items()):
            alone = _service_times(search, vehicles)
            if (weights[nodes] * alone[nodes]).sum() < goal * (1.0 - SOONER):
                every = _service_times(search)
                in_time = lateness(tours, search.trial, search.chargers) == 0.0
                if in_time and (weights * every).sum() < (weights * served_at).sum() * (1.0 - SOONER):
                    copy_plan(search.trial, search.best)
                    return every, tried
        if tried >= min(left, MOST_CHOICES):
            break
    if tried:
        copy_plan(search.best, search.trial)
    return None, tried


def _choices(tours: Tours, pairs: Sequence[tuple[int, int]], most_cost: float) -> Iterator[tuple[int, ...]]:
    """Return all choices of a way for each pair of nodes, up to a cost in sum; the cheapest of each pair first."""
    spans = [range(tours.first[tail, head], tours.first[tail, head + 1]) for tail, head in pairs]
    if not all(spans):
        return
    cost = tours.ways.cost
    rest = np.append(np.cumsum([cost[span[0]] for span in spans][::-1])[::-1], 0.0)
    if rest[0] > most_cost:
        return
    todo: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    while todo:
        spent, chosen = todo.pop()
        if len(chosen) == len(spans):
            yield chosen
            continue
        within = [
            (spent + float(cost[way]), (*chosen, way))
            for way in spans[len(chosen)]
            if spent + cost[way] + rest[len(chosen) + 1] <= most_cost
        ]
        todo += within[::-1]


def _service_times(search: Search, vehicles: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
    """Return when each customer of some vehicles of the plan that is tried is served, without the other vehicles, or of all that it uses; 0 for all others."""
    served_at = np.zeros(len(search.tours.ready))
    for rows in search.timetables(search.trial, vehicles).values():
        served = rows[rows[:, KIND] == SERVE]
        served_at[served[:, NODE].astype(np.int64)] = served[:, BEGIN]
    return served_at
