"""Kernels that put customers into routes where they cost least, with blinks: now and then a position is overlooked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.models.jit.random_kernels import below, uniform
from skyway.planner.tours.label_kernels import SLACK
from skyway.planner.tours.route_kernels import insert, insertion, node_at, recharge, relabel, take_out
from skyway.planner.tours.ruin_kernels import mend

if TYPE_CHECKING:
    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.route_kernels import Plan, Space
    from skyway.planner.tours.ruin_kernels import Work

BLINK = 0.01
"""Chance that a position is overlooked (the value of the paper)."""


@compiled_lean
def sort_absent(tours: Tours, work: Work) -> None:
    """Order the absent customers at random, or by demand, distance or window (weights 4, 4, 2, 1 and 2 each)."""
    draw = below(work.random, 17)
    count = work.absent[-1]
    for one in range(count):
        node = work.absent[one]
        far = tours.ways.cost[tours.first[0, node]] if tours.first[0, node] < tours.first[0, node + 1] else 0.0
        if draw < 4:
            score = uniform(work.random)
        elif draw < 8:
            score = -tours.demand[node]
        elif draw < 10:
            score = -far
        elif draw < 11:
            score = far
        elif draw < 13:
            score = tours.due[node] - tours.ready[node]
        elif draw < 15:
            score = tours.ready[node]
        else:
            score = -tours.due[node]
        at = one
        while at > 0 and work.score[at - 1] > score:
            work.score[at], work.absent[at] = work.score[at - 1], work.absent[at - 1]
            at -= 1
        work.score[at], work.absent[at] = score, node


@compiled_lean
def best_place(tours: Tours, plan: Plan, work: Work, node: int, most_routes: int) -> tuple[float, int, int, int, int]:
    """Return what a customer adds where it adds least, route, position, and the ways to and from it; infinite where nowhere is.

    Vehicles that are not used yet are tried once of each kind, while fewer than `most_routes` are.
    """
    best, chosen, place, best_to, best_on = np.inf, -1, -1, -1, -1
    used = 0
    for route in range(len(plan.length)):
        length = plan.length[route]
        used += length > 0
        if length == 0 or plan.load[route] + tours.demand[node] > tours.vehicles.capacity[route] + SLACK:
            continue
        for position in range(length + 1):
            before, after = node_at(plan, route, position - 1), node_at(plan, route, position)
            at = plan.ahead[route, position, 0] + tours.fastest[before, node]
            if at > tours.due[node] + SLACK:
                break
            leave = max(at, tours.ready[node]) + tours.service[node]
            if leave + tours.fastest[node, after] > plan.behind[route, position, 2] + SLACK:
                continue
            if uniform(work.random) < BLINK:
                continue
            added, to, on = insertion(tours, plan, route, position, node, best)
            if added < best:
                best, chosen, place, best_to, best_on = added, route, position, to, on
    kind = -1
    for route in range(len(plan.length)):
        if used >= most_routes:
            break
        if (
            plan.length[route]
            or tours.vehicles.kind[route] == kind
            or tours.demand[node] > tours.vehicles.capacity[route] + SLACK
        ):
            continue
        kind = tours.vehicles.kind[route]
        added, to, on = insertion(tours, plan, route, 0, node, best)
        if added < best:
            best, chosen, place, best_to, best_on = added, route, 0, to, on
    return best, chosen, place, best_to, best_on


@compiled_lean
def put_in(tours: Tours, plan: Plan, work: Work, space: Space, node: int, most_routes: int) -> bool:
    """Insert a customer where it costs least; false, and all as before, where no place is found."""
    _, route, place, to, on = best_place(tours, plan, work, node, most_routes)
    if route < 0:
        return False
    spared = plan.way[route, place]
    insert(plan, route, place, node, to, on)
    work.touched[route] = True
    if relabel(tours, plan, route) or (recharge(tours, plan, route, space, np.inf) and relabel(tours, plan, route)):
        return True
    take_out(plan, route, place, spared)  # its load is too much for what is before it
    if not relabel(tours, plan, route):
        mend(tours, plan, work, space, route)
    return False


@compiled_lean
def recreate(tours: Tours, plan: Plan, work: Work, space: Space, most_routes: int) -> None:
    """Put the absent customers in, and charge the routes that changed at least cost."""
    sort_absent(tours, work)
    left = 0
    for one in range(work.absent[-1]):
        node = work.absent[one]
        if not put_in(tours, plan, work, space, node, most_routes):
            work.absent[left] = node
            left += 1
    work.absent[-1] = left
    for route in range(len(plan.length)):
        if work.touched[route] and plan.length[route]:
            cost = 0.0
            for position in range(plan.length[route] + 1):
                cost += tours.guide[plan.way[route, position]]
            if recharge(tours, plan, route, space, cost):
                relabel(tours, plan, route)
