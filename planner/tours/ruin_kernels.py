"""Kernels that take strings of customers out of neighbouring routes.

After Christiaens and Vanden Berghe, "Slack induction by string removals for vehicle routing problems", Transportation Science 54 (2020).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.models.jit.random_kernels import below, uniform
from skyway.planner.tours.route_kernels import node_at, recharge, relabel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.route_kernels import Plan, Space

SPLIT, GROW = 0.5, 0.01
"""Chances that a string is split, and that its gap grows (the values of the paper)."""


class Work(NamedTuple):
    """Room of a search."""

    random: NDArray[np.uint64]
    """Shape (1,): state of the generator (SplitMix64)."""
    absent: NDArray[np.int64]
    """Shape (nodes + 1,): customers that are in no route; the last element is how many."""
    absences: NDArray[np.float64]
    """Shape (nodes,): how often each was in none."""
    touched: NDArray[np.bool_]
    ruined: NDArray[np.bool_]
    """Shape (routes,) each."""
    score: NDArray[np.float64]
    """Shape (nodes,)."""


@compiled_lean
def drop(plan: Plan, work: Work, node: int) -> None:
    """Take a customer out of `route_of`."""
    plan.route_of[node] = -1
    count = work.absent[-1]
    work.absent[count] = node
    work.absent[-1] = count + 1


@compiled_lean
def mend(tours: Tours, plan: Plan, work: Work, space: Space, route: int) -> None:
    """Make a route that lost customers feasible with its cheapest charges; where it has none, all customers leave it."""
    plain, valid, cost = True, True, 0.0
    for position in range(plan.length[route] + 1):
        way = plan.way[route, position]
        tail, head = node_at(plan, route, position - 1), node_at(plan, route, position)
        plain = plain and way == tours.first[tail, head]
        valid = valid and tours.first[tail, head] <= way < tours.first[tail, head + 1]
        cost += tours.guide[way] if valid else 0.0
    if valid and relabel(tours, plan, route):
        if not plain and recharge(tours, plan, route, space, cost):
            relabel(tours, plan, route)
        return
    if recharge(tours, plan, route, space, np.inf) and relabel(tours, plan, route):
        return
    for position in range(plan.length[route]):
        drop(plan, work, plan.customer[route, position])
    plan.length[route] = 0
    relabel(tours, plan, route)


@compiled_lean
def cut(
    tours: Tours, plan: Plan, work: Work, space: Space, route: int, begin: int, span: int, gap: int, skip: int
) -> None:
    """Take a string of customers out of a route, all but `skip` of them from position `gap` on; the rest is joined by the cheapest ways."""
    length, kept, broken = plan.length[route], begin, False
    for position in range(begin, length + 1):
        node = node_at(plan, route, position)
        if position < min(begin + span, length) and not gap <= position < gap + skip:
            drop(plan, work, node)
            broken = True
            continue
        way = plan.way[route, position]
        if broken:
            way = tours.first[plan.customer[route, kept - 1] if kept > 0 else 0, node]
            broken = False
        plan.way[route, kept] = way
        if position < length:
            plan.customer[route, kept] = node
            kept += 1
    plan.length[route] = kept
    if kept:
        mend(tours, plan, work, space, route)
    else:
        relabel(tours, plan, route)


@compiled_lean
def ruin(tours: Tours, plan: Plan, work: Work, space: Space, removed: float, longest: int) -> None:
    """Take strings out of routes near one customer."""
    random = work.random
    routes, served = 0, 0
    for route in range(len(plan.length)):
        routes += plan.length[route] > 0
        served += plan.length[route]
        work.ruined[route] = False
    if not routes:
        return
    usual = min(float(longest), served / routes)
    strings = int(1.0 + uniform(random) * (4.0 * removed / (1.0 + usual) - 1.0))
    seed = 1 + below(random, len(tours.ready) - 1)
    for one in range(-1, tours.near.shape[1]):
        node = seed if one < 0 else tours.near[seed, one]
        route = plan.route_of[node]
        if route < 0 or work.ruined[route]:
            continue
        length = plan.length[route]
        count = 1 + below(random, int(min(float(length), usual)))
        at = 0
        while plan.customer[route, at] != node:
            at += 1
        skip = 0
        if count > 1 and count < length and uniform(random) < SPLIT:
            skip = 1
            while count + skip < length and uniform(random) < GROW:
                skip += 1
        span = count + skip
        least, last = max(at - span + 1, 0), min(at, length - span)
        begin = least + below(random, last - least + 1)
        gap = begin + 1 + below(random, count - 1) if skip else begin
        work.ruined[route] = work.touched[route] = True
        cut(tours, plan, work, space, route, begin, span, gap, skip)
        strings -= 1
        if strings == 0:
            break
