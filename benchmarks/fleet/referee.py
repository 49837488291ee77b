"""Reference solutions for the dispatcher: small problems in whole steps, solved to proven optimality as flows over time, place and charge.

It shares only the data of the problem with the dispatcher. Drones with one home are units of one flow through states (place,
step, charge); a unit that carries an order moves in a copy of these states that belongs to the order. Arcs wait, charge by a level in a
step, fly empty, pick up, fly loaded and deliver; the number that charge at a place in a step is at most that of its pads. HiGHS, in SciPy's
version, proves the optimum of the integer program. Charges on the way home assume free pads, so that the optimum is a lower bound.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from skyway.planner.dispatch.problem import DispatchProblem

BASE = -1
"""Layer of drones without an order."""


@dataclass(frozen=True)
class Verdict:
    """Result."""

    cost: float
    """Cost of the best plan found."""
    bound: float
    """Lower bound of the cost of any plan."""
    proved: bool
    arcs: int


class _Arc(NamedTuple):
    flow: int
    tail: tuple[int, int, int, int]
    """Layer, place, step, level."""
    head: tuple[int, int, int, int] | None
    cost: float
    pad: tuple[int, int] | None = None
    takes: int | None = None


def judge(problem: DispatchProblem, step_s: float, levels: int, *, time_limit_s: float = 60.0) -> Verdict:
    """Solve a problem of one type of drone, in one slot, whose times are whole steps and whose needs are whole levels."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    arcs, sources = _arcs(problem, step_s, levels)
    orders = problem.orders
    count, many = len(arcs), len(orders.ready_s)
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    lower: list[float] = []
    upper: list[float] = []
    number: dict[object, int] = {}

    def row(key: object, low: float, high: float) -> int:
        if key not in number:
            number[key] = len(lower)
            lower.append(low)
            upper.append(high)
        return number[key]

    def put(at: int, column: int, value: float) -> None:
        rows.append(at)
        columns.append(column)
        values.append(value)

    for key, units in sources.items():
        row(("state", *key), units, units)
    for place, arc in enumerate(arcs):
        put(row(("state", arc.flow, arc.tail), 0.0, 0.0), place, 1.0)
        if arc.head is not None:
            put(row(("state", arc.flow, arc.head), 0.0, 0.0), place, -1.0)
        if arc.pad is not None:
            put(row(("pad", arc.pad), -np.inf, float(problem.flights.pads[arc.pad[0]])), place, 1.0)
        if arc.takes is not None:
            put(row(("order", arc.takes), 1.0, 1.0), place, 1.0)
    for order in range(many):  # a last column for each order: it is refused
        put(row(("order", order), 1.0, 1.0), count + order, 1.0)
    cost = np.array([arc.cost for arc in arcs] + [float(one) for one in orders.refusal_s])
    shape = len(lower), count + many
    matrix = coo_array((values, (rows, columns)), shape=shape).tocsr()
    high = np.concatenate((np.full(count, float(len(problem.fleet.place))), np.ones(many)))
    high[:count] = np.where([arc.tail[0] != BASE or arc.takes is not None for arc in arcs], 1.0, high[:count])
    done = milp(
        cost, integrality=np.ones(count + many, dtype=np.int64), bounds=Bounds(np.zeros(count + many), high),
        constraints=LinearConstraint(matrix, lower, upper), options={"time_limit": time_limit_s, "mip_rel_gap": 1e-6},
    )  # fmt: skip
    if done.x is None:
        return Verdict(math.inf, float(done.mip_dual_bound or 0.0), proved=False, arcs=count)
    return Verdict(float(done.fun), float(done.mip_dual_bound), proved=done.status == 0, arcs=count)


def _arcs(  # noqa: PLR0915  one pass over all states
    problem: DispatchProblem, step_s: float, levels: int
) -> tuple[list[_Arc], dict[tuple[int, tuple[int, int, int, int]], int]]:
    """All arcs reachable by a unit, from the drones' first places."""
    flights, fleet, orders, weights = problem.flights, problem.fleet, problem.orders, problem.weights
    places = len(flights.pads)
    hops = [
        [[_hop(flights.time_s[mode, 0, i, j], flights.need[mode, 0, i, j], step_s, levels) for j in range(places)] for i in range(places)]
        for mode in (0, 1)
    ]  # fmt: skip
    ready = [round(one / step_s) for one in orders.ready_s]
    due = [one / step_s for one in orders.due_s]
    last = [math.floor(one / step_s + 1e-9) for one in orders.latest_s]
    end = max(last, default=0)
    fast = _fastest(hops[1], places)
    home_cost = _home_energy(hops[0], places)
    per_level = weights.energy_s / levels
    arcs: list[_Arc] = []
    sources: dict[tuple[int, tuple[int, int, int, int]], int] = defaultdict(int)
    todo: dict[int, set[tuple[int, int, int, int]]] = defaultdict(set)
    for drone in range(len(fleet.place)):
        begin = math.ceil(fleet.from_s[drone] / step_s - 1e-9)
        state = (BASE, int(fleet.place[drone]), begin, math.floor(fleet.soc[drone] * levels + 1e-9))
        sources[int(fleet.home[drone]), state] += 1
        todo[int(fleet.home[drone])].add(state)
    for flow, first in todo.items():
        by_step: dict[int, set[tuple[int, int, int, int]]] = defaultdict(set)
        for state in first:
            by_step[state[2]].add(state)

        def add(arc: _Arc, seen: dict[int, set[tuple[int, int, int, int]]] = by_step) -> None:
            arcs.append(arc)
            if arc.head is not None:
                seen[arc.head[2]].add(arc.head)

        step = min(by_step)
        while step <= end:
            pending = by_step.pop(step, set())
            known: set[tuple[int, int, int, int]] = set()
            while pending:
                state = pending.pop()
                if state in known:
                    continue
                known.add(state)
                layer, place, _, level = state
                if layer == BASE:
                    add(_Arc(flow, state, None, per_level * home_cost[place][flow]))
                    for order in range(len(ready)):
                        if (
                            place == orders.origin[order]
                            and step >= ready[order]
                            and step + fast[place][int(orders.destination[order])] <= last[order]
                        ):
                            pending.add((order, place, step, level))
                            arcs.append(_Arc(flow, state, (order, place, step, level), 0.0, None, order))
                elif place == orders.destination[layer]:
                    late = max(0.0, step - due[layer])
                    cost = step_s * (step - ready[layer] + weights.lateness * late)
                    pending.add((BASE, place, step, level))
                    arcs.append(_Arc(flow, state, (BASE, place, step, level), cost))
                    continue
                if step < end and (
                    layer == BASE or step + 1 + fast[place][int(orders.destination[layer])] <= last[layer]
                ):
                    add(_Arc(flow, state, (layer, place, step + 1, level), 0.0))
                    if level < levels:
                        add(_Arc(flow, state, (layer, place, step + 1, level + 1), 0.0, (place, step)))
                for other in range(places):
                    hop = hops[0 if layer == BASE else 1][place][other]
                    if hop is None or hop[1] > level:
                        continue
                    there = step + hop[0]
                    if layer != BASE and there + fast[other][int(orders.destination[layer])] > last[layer]:
                        continue
                    if there <= end:
                        add(_Arc(flow, state, (layer, other, there, level - hop[1]), per_level * hop[1]))
            step += 1
    return arcs, dict(sources)


def _hop(time_s: float, need: float, step_s: float, levels: int) -> tuple[int, int] | None:
    if not (math.isfinite(time_s) and need <= 1.0 + 1e-9):
        return None
    return math.ceil(time_s / step_s - 1e-9), math.ceil(need * levels - 1e-9)


def _fastest(hops: list[list[tuple[int, int] | None]], places: int) -> list[list[float]]:
    best = [[0.0 if i == j else math.inf if (hop := hops[i][j]) is None else float(hop[0]) for j in range(places)] for i in range(places)]  # fmt: skip
    for k in range(places):
        for i in range(places):
            for j in range(places):
                best[i][j] = min(best[i][j], best[i][k] + best[k][j])
    return best


def _home_energy(hops: list[list[tuple[int, int] | None]], places: int) -> list[list[float]]:
    """Least levels of charge from each place to each other."""
    swapped = [[None if hop is None else (hop[1], hop[0]) for hop in line] for line in hops]
    return _fastest(swapped, places)
