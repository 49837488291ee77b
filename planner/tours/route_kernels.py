"""Kernels of routes: their labels, the cheapest insertion into them, and their cheapest charges."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.planner.tours.label_kernels import SLACK, fits, serve, serve_back, travel, travel_back

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours

GAIN = 1e-7
"""What is better by less is not better."""


class Plan(NamedTuple):
    """Routes; those of length 0 are not used."""

    customer: NDArray[np.int64]
    """Shape (routes, most)."""
    way: NDArray[np.int64]
    """Shape (routes, most + 1): the way to each customer, and to the depot."""
    length: NDArray[np.int64]
    load: NDArray[np.float64]
    """Shape (routes,) each."""
    cost: NDArray[np.float64]
    """Shape (routes,)."""
    aboard: NDArray[np.float64]
    """Shape (routes, most + 1): load on the way to each position."""
    ahead: NDArray[np.float64]
    """Shape (routes, most + 1, 3): label when the node before each position is left."""
    behind: NDArray[np.float64]
    """The same shape: what is required on arrival at each position."""
    route_of: NDArray[np.int64]
    """Shape (nodes,): -1 where a customer is in none."""


class Space(NamedTuple):
    """Room of `recharge` for its labels."""

    label: NDArray[np.float64]
    """Shape (most + 2, labels, 4): cost, and the label when a node is left."""
    came: NDArray[np.int64]
    """Shape (most + 2, labels, 2): the label before, and the way."""
    filled: NDArray[np.int64]
    """Shape (most + 2,)."""


@compiled_lean
def node_at(plan: Plan, route: int, position: int) -> int:
    """Node at a position of a route; the depot before and after it."""
    if 0 <= position < plan.length[route]:
        return int(plan.customer[route, position])
    return 0


@compiled_lean
def start_of(tours: Tours, plan: Plan, route: int) -> float:
    """When a route can begin: its vehicle is there, and all that it carries."""
    start = max(float(tours.vehicles.begin[route]), float(tours.ready[0]))
    for position in range(plan.length[route]):
        start = max(start, float(tours.release[plan.customer[route, position]]))
    return start


@compiled_lean
def relabel(tours: Tours, plan: Plan, route: int) -> bool:
    """Compute labels, loads and cost of a route from its customers and ways; false where it is infeasible.

    Takes a route of the plan, of customers and ways of the problem.
    """
    length, vehicles = plan.length[route], tours.vehicles
    load = 0.0
    for position in range(length):
        load += tours.demand[plan.customer[route, position]]
    plan.load[route], plan.cost[route] = load, 0.0
    if length == 0:
        return True
    if load > vehicles.capacity[route] + SLACK:
        return False
    t0, s0, s1 = start_of(tours, plan, route), vehicles.energy[route], vehicles.energy[route]
    for position in range(length + 1):
        plan.ahead[route, position, 0], plan.ahead[route, position, 1], plan.ahead[route, position, 2] = t0, s0, s1
        plan.aboard[route, position] = load
        plan.cost[route] += tours.ways.cost[plan.way[route, position]]
        t0, s0, s1 = travel(tours, plan.way[route, position], load, t0, s0, s1)
        if t0 < np.inf and position < length:
            node = plan.customer[route, position]
            load -= tours.demand[node]
            t0, s0, s1 = serve(tours, node, t0, s0, s1)
        if t0 == np.inf:
            return False
    last = min(tours.due[0], vehicles.end[route])
    if t0 > last + SLACK:
        return False
    low, line = 0.0, last
    for position in range(length, -1, -1):
        if position < length:
            low, line, last = serve_back(tours, plan.customer[route, position], low, line, last)
        plan.behind[route, position, 0], plan.behind[route, position, 1], plan.behind[route, position, 2] = (
            low,
            line,
            last,
        )
        if last == -np.inf:
            return False
        low, line, last = travel_back(tours, plan.way[route, position], plan.aboard[route, position], low, line, last)
    return True


@compiled_lean
def insertion(tours: Tours, plan: Plan, route: int, position: int, node: int, most: float) -> tuple[float, int, int]:
    """Return the least (guide) cost that a customer adds at a position, below `most`, and the ways to and from it; infinite: none.

    Ways are tried by cost, and left from where they cost more than the best so far. What the
    customer's load takes before its position, and what waiting for it delays there, is told by `relabel` only.

    Takes a labelled route of the plan, a position from 0 to its length, and a customer that is in no route.
    """
    ways, first = tours.ways, tours.first
    before, after = node_at(plan, route, position - 1), node_at(plan, route, position)
    begin, end = first[before, node], first[before, node + 1]
    begin_on, end_on = first[node, after], first[node, after + 1]
    best, best_to, best_on = np.inf, -1, -1
    if begin == end or begin_on == end_on:
        return best, best_to, best_on
    if plan.length[route]:
        spared, load = tours.guide[plan.way[route, position]], plan.aboard[route, position]
        t0, s0, s1 = plan.ahead[route, position, 0], plan.ahead[route, position, 1], plan.ahead[route, position, 2]
        low, line, last = (
            plan.behind[route, position, 0],
            plan.behind[route, position, 1],
            plan.behind[route, position, 2],
        )
    else:
        spared, load = 0.0, 0.0
        t0, s0, s1 = (
            max(tours.vehicles.begin[route], tours.ready[0]),
            tours.vehicles.energy[route],
            tours.vehicles.energy[route],
        )
        low, line, last = (
            0.0,
            min(tours.due[0], tours.vehicles.end[route]),
            min(tours.due[0], tours.vehicles.end[route]),
        )
    t0 = max(t0, tours.release[node] + (tours.fastest[0, before] if position else 0.0))
    for to in range(begin, end):
        if ways.cost[to] + ways.cost[begin_on] - spared >= most:
            break
        if tours.guide[to] + ways.cost[begin_on] - spared >= most:
            continue
        at, have, can = travel(tours, to, load + tours.demand[node], t0, s0, s1)
        if at == np.inf:
            continue
        at, have, can = serve(tours, node, at, have, can)
        if at == np.inf:
            continue
        for on in range(begin_on, end_on):
            if tours.guide[to] + ways.cost[on] - spared >= most:
                break
            added = tours.guide[to] + tours.guide[on] - spared
            if added >= most:
                continue
            there, left, could = travel(tours, on, load, at, have, can)
            if fits(tours.pace, there, left, could, low, line, last):
                best, most, best_to, best_on = added, added, to, on
    return best, best_to, best_on


@compiled_lean
def insert(plan: Plan, route: int, position: int, node: int, to: int, on: int) -> None:
    """Put a customer into a route; `relabel` is due."""
    length = plan.length[route]
    for one in range(length, position, -1):
        plan.customer[route, one] = plan.customer[route, one - 1]
        plan.way[route, one + 1] = plan.way[route, one]
    plan.customer[route, position] = node
    plan.way[route, position] = to
    plan.way[route, position + 1] = on
    plan.length[route] = length + 1
    plan.route_of[node] = route


@compiled_lean
def take_out(plan: Plan, route: int, position: int, way: int) -> None:
    """Take a customer out of a route, whose neighbours are then joined by a way; `relabel` is due."""
    plan.route_of[plan.customer[route, position]] = -1
    for one in range(position, plan.length[route] - 1):
        plan.customer[route, one] = plan.customer[route, one + 1]
        plan.way[route, one + 1] = plan.way[route, one + 2]
    plan.way[route, position] = way
    plan.length[route] -= 1


@compiled_lean
def _covered(space: Space, stage: int, cost: float, t0: float, s0: float, s1: float, pace: float) -> bool:
    """Whether a label of a stage is as good as a new one in all; those that the new one makes useless go."""
    kept = 0
    for one in range(space.filled[stage]):
        label = space.label[stage, one]
        if (
            label[0] <= cost
            and label[1] <= t0
            and label[3] >= s1
            and min(label[3], label[2] + (t0 - label[1]) / pace) >= s0
        ):
            return True
        if not (
            cost <= label[0] and t0 <= label[1] and s1 >= label[3] and min(s1, s0 + (label[1] - t0) / pace) >= label[2]
        ):
            if kept != one:
                for part in range(4):
                    space.label[stage, kept, part] = label[part]
                for part in range(2):
                    space.came[stage, kept, part] = space.came[stage, one, part]
            kept += 1
    space.filled[stage] = kept
    return False


@compiled_lean
def recharge(tours: Tours, plan: Plan, route: int, space: Space, most: float) -> bool:
    """Choose the ways of a route: the cheapest (by `guide`) that are feasible, below a cost; false, and the ways as before, where none are.

    Labels of cost, time and energy after each customer, extended over all ways, without those that another covers. Where there are more
    than there is room for, the dearest are left.
    """
    ways, length = tours.ways, plan.length[route]
    rest, load = 0.0, 0.0
    for position in range(length + 1):
        if position < length:
            load += tours.demand[plan.customer[route, position]]
        begin = tours.first[node_at(plan, route, position - 1), node_at(plan, route, position)]
        if begin == tours.first[node_at(plan, route, position - 1), node_at(plan, route, position) + 1]:
            return False
        rest += ways.cost[begin]
    if rest >= most - GAIN:
        return False
    space.filled[0] = 1
    space.label[0, 0, 0], space.label[0, 0, 1] = 0.0, start_of(tours, plan, route)
    space.label[0, 0, 2] = space.label[0, 0, 3] = tours.vehicles.energy[route]
    for position in range(length + 1):
        tail, head = node_at(plan, route, position - 1), node_at(plan, route, position)
        begin, end = tours.first[tail, head], tours.first[tail, head + 1]
        rest -= ways.cost[begin]
        space.filled[position + 1] = 0
        for one in range(space.filled[position]):
            label = space.label[position, one]
            for way in range(begin, end):
                if label[0] + ways.cost[way] + rest >= most - GAIN:
                    break
                cost = label[0] + tours.guide[way]
                if cost + rest >= most - GAIN:
                    continue
                t0, s0, s1 = travel(tours, way, load, label[1], label[2], label[3])
                if t0 < np.inf:
                    t0, s0, s1 = serve(tours, head, t0, s0, s1)
                if t0 == np.inf or _covered(space, position + 1, cost, t0, s0, s1, tours.pace):
                    continue
                filled = space.filled[position + 1]
                if filled == space.label.shape[1]:
                    continue
                label_on = space.label[position + 1, filled]
                label_on[0], label_on[1], label_on[2], label_on[3] = cost, t0, s0, s1
                space.came[position + 1, filled, 0], space.came[position + 1, filled, 1] = one, way
                space.filled[position + 1] = filled + 1
        if space.filled[position + 1] == 0:
            return False
        load -= tours.demand[head]
    chosen = 0
    for one in range(1, space.filled[length + 1]):
        if space.label[length + 1, one, 0] < space.label[length + 1, chosen, 0]:
            chosen = one
    for position in range(length, -1, -1):
        plan.way[route, position] = space.came[position + 1, chosen, 1]
        chosen = space.came[position + 1, chosen, 0]
    return True
