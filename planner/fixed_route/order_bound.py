"""A bound over all orders: no order, stops and distribution over drones end earlier.

A linear relaxation. Each unit is entered from one other and left to one other, on ways with their time and their charge,
the lesser of both directions; tours that do not include the start are cut off if they occur in the solution. Leaving the work for a pad, and resuming
it there, costs at least as much as at the place nearest to a pad.

Let tau(q) be the time from empty to charge q on the fastest curve, r the reserve, a way of energy E take m E on average and be started with r + s E at
least. Charging at V stops is tau(left with) - tau(come with), stop by stop; put together by ways it is tau of what the last way starts with, less
tau of what the first one ends with, and for each way between tau(d) - tau(d - m E), which is least for d = r + s E: phi(E). So it is at least
a (E - E0) - b V for each tangent of the lower hull of phi, and, E0 being what first ways take, tau(r) - tau(start) and a chord more. HiGHS, of SciPy,
solves it.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.planner.fixed_route.charging_stops import fastest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.fixed_route.orders import FreeOrder

MANY = 150
"""Number of units above which ways are not distinguished by their origin."""
ROUNDS = 12
NEAREST = 6
"""Ways to and from a unit that are considered first."""
REDUCED_S = 1e-7
EXTRA = 4
"""Columns that are not ways."""
TOLERANCE_S = 1e-3
"""The bound is reduced by this share, since the solver works in floating point."""


def bound_of_orders(work: FreeOrder) -> float:
    """Return a time before which no order of some work ends, seconds on its clock; infinite if no order ends."""
    least, drones = work.least, work.drones
    route = least.pads
    tour = _Ways(least, np.array(work.groups))
    base_s, base_soc = tour.base
    # columns: ways; visits of pads, ways from pad to pad, charging, what the first way of each drone takes
    wait_s = min(float(wait[:, 1].min()) for wait in route.waits)
    extra_s = [work.visit_s + wait_s, _least_hop(route.hops.between_s[0]) + wait_s, 1.0, 0.0]
    objective = np.concatenate((tour.time_s, extra_s))
    energy = np.concatenate((tour.soc, [work.visit_soc, _least_hop(route.hops.between_soc[0]), 0.0, 0.0]))
    visits, charging, first = np.zeros((3, len(energy)))
    visits[-4:-2], charging[-2], first[-1] = 1.0, 1.0, 1.0
    begin = (route.soc_start - route.reserve_soc) / route.sure_ratio
    usable = (1.0 - route.reserve_soc) / route.sure_ratio
    rows = [first, energy - first - usable * visits]
    most = [drones * begin, -base_soc]
    price, spare_soc = work.price_s, (route.soc_start - route.reserve_soc) / route.mean_ratio
    rows.append(price * energy - charging)
    most.append(price * (drones * spare_soc - base_soc))
    for slope, level, chord, credit_s in _tangents(least):
        rows.append(slope * (energy - first) + chord * first - level * visits - charging)
        most.append(drones * credit_s - slope * base_soc)
    answer = math.inf
    columns = tour.first_columns()
    equal, wanted = tour.degrees(drones)
    for _ in range(ROUNDS):
        solved = _priced(objective, _sparse(rows), np.array(most), equal, wanted, columns)
        if solved is None:
            return math.inf
        answer, x = solved
        cuts = tour.cuts(x)
        if not cuts:
            break
        rows += [-row for row in cuts]
        most += [-1.0] * len(cuts)
    return route.start_s + max((base_s + answer - TOLERANCE_S) / drones, 0.0)


def _tangents(work: FreeOrder) -> list[tuple[float, float, float, float]]:
    """Return of each tangent of phi its slope a and level b; the slope of first ways; and the value of the charge at the start, s."""
    route = work.pads
    tau_soc, tau_s = fastest(route.curves)
    reserve, mean, sure = route.reserve_soc, route.mean_ratio, route.sure_ratio

    def tau(soc: NDArray[np.float64] | float) -> NDArray[np.float64]:
        return np.asarray(np.interp(soc, tau_soc, tau_s))

    # phi is linear between where either end of the way meets a point of the curve
    bends = [(tau_soc - reserve) / sure, *([(tau_soc - reserve) / (sure - mean)] if sure > mean else [])]
    last = (1.0 - reserve) / sure
    at = np.unique(np.clip(np.concatenate([*bends, [0.0, last]]), 0.0, last))
    phi = tau(reserve + sure * at) - tau(reserve + (sure - mean) * at)
    hull: list[int] = []
    for number in range(len(at)):  # the lower hull of its points
        while len(hull) > 1 and (phi[hull[-1]] - phi[hull[-2]]) * (at[number] - at[hull[-2]]) >= (
            phi[number] - phi[hull[-2]]
        ) * (at[hull[-1]] - at[hull[-2]]):
            hull.pop()
        hull.append(number)
    begin = (route.soc_start - reserve) / sure
    saved = float(tau(route.soc_start) - tau(route.soc_start - mean * begin))
    chord = saved / begin if begin > 0.0 else 0.0
    credit_s = float(tau(route.soc_start) - tau(reserve))
    slopes = [(float((phi[b] - phi[a]) / (at[b] - at[a])), a) for a, b in pairwise(hull)]
    return [(slope, slope * float(at[a]) - float(phi[a]), chord, credit_s) for slope, a in slopes]


def _least_hop(hops: NDArray[np.float64]) -> float:
    """Minimum over ways from one pad to another."""
    away = hops[~np.eye(len(hops), dtype=bool)]
    away = away[np.isfinite(away)]
    return float(away.min()) if len(away) else 0.0


def _sparse(rows: Sequence[NDArray[np.float64]]) -> Any:
    """Return rows as a table for access by columns."""
    from scipy.sparse import csc_array

    return csc_array(np.array(rows))


def _priced(
    objective: NDArray[np.float64],
    rows: Any,
    most: NDArray[np.float64],
    equal: Any,
    wanted: NDArray[np.float64],
    columns: NDArray[np.bool_],
) -> tuple[float, NDArray[np.float64]] | None:
    """Solve a linear program over columns that are 0 or more, with those that its solution needs; None if it is infeasible.

    Columns are added, and stay in `columns`, until no other one has reduced costs below 0: then the solution is that of the complete program.
    """
    while True:
        chosen = np.flatnonzero(columns)
        found = _solved(objective[chosen], rows[:, chosen], most, equal[:, chosen], wanted)
        if found is None:
            if columns.all():
                return None
            columns[:] = True
            continue
        answer, part, prices = found
        reduced = objective - rows.T @ prices[: len(most)] - equal.T @ prices[len(most) :]
        missing = ~columns & (reduced < -REDUCED_S)
        if not missing.any():
            x = np.zeros(len(objective))
            x[chosen] = part
            return answer, x
        columns |= missing


def _solved(
    objective: NDArray[np.float64],
    rows: Any,
    most: NDArray[np.float64],
    equal: Any,
    wanted: NDArray[np.float64],
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]] | None:
    """Solve a linear program over columns that are 0 or more: its solution, the columns, and the dual values of its rows; None if it is infeasible."""
    from scipy.optimize import linprog

    found = linprog(objective, rows, most, equal, wanted, method="highs")
    if found.status != 0:
        return None
    prices = np.concatenate((found.ineqlin.marginals, found.eqlin.marginals))
    return float(found.fun or 0.0), np.asarray(found.x), prices


class _Ways:
    """Ways of the relaxation, from the head or a unit to a unit or the tail; `units` stands for head and tail."""

    def __init__(self, work: FreeOrder, groups: NDArray[np.int64]) -> None:
        self.units = units = work.units
        inside = [
            (float(one.work_s.sum()), float(one.work_soc.sum())) if one is not None else (math.inf, math.inf)
            for one in work.turns
        ]
        per_unit = np.array(inside, dtype=np.float64).reshape(units, 2, 2).min(axis=1)
        ends = [(float(one.work_s.sum()), float(one.work_soc.sum())) for one in (work.head, work.tail)]
        self.base = (
            float(per_unit[:, 0].sum()) + work.drones * sum(one[0] for one in ends),
            float(per_unit[:, 1].sum()) + work.drones * sum(one[1] for one in ends),
        )
        """Time and charge of all units, and of head and tail of each drone."""
        time_s, soc = (self._less(table) for table in (work.way_s[0], work.way_soc[0]))
        # a drone that stays at home has no head and no tail
        time_s[units, units], soc[units, units] = (-sum(one[kind] for one in ends) for kind in (0, 1))
        allowed = np.array([[self._may(a, b, groups, work.drones) for b in range(units + 1)] for a in range(units + 1)])
        allowed &= np.isfinite(time_s)
        self.apart = units <= MANY
        if self.apart:
            self.tails, self.heads = np.nonzero(allowed)
            self.time_s, self.soc = time_s[self.tails, self.heads], soc[self.tails, self.heads]
        else:
            self.heads = np.flatnonzero(allowed.any(axis=0))
            self.tails = np.full(len(self.heads), -1)
            self.time_s = np.where(allowed, time_s, math.inf).min(axis=0)[self.heads]
            self.soc = np.where(allowed, soc, math.inf).min(axis=0)[self.heads]

    def _less(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ways between units: the minimum over both directions at both ends."""
        units = self.units
        found = np.empty((units + 1, units + 1))
        found[:units, :units] = table[: 2 * units, : 2 * units].reshape(units, 2, units, 2).min(axis=(1, 3))
        found[units, :units] = table[2 * units, : 2 * units].reshape(units, 2).min(axis=1)
        found[:units, units] = table[: 2 * units, 2 * units].reshape(units, 2).min(axis=1)
        found[units, units] = table[2 * units, 2 * units]
        return found

    def _may(self, one: int, other: int, groups: NDArray[np.int64], drones: int) -> bool:
        """Whether a way is allowed: groups stay in their order."""
        if one == other:
            return one == self.units and drones > 1
        if drones > 1:
            return self.units in (one, other) or bool(groups[one] <= groups[other])
        if one == self.units:
            return bool(groups[other] == groups.min())
        if other == self.units:
            return bool(groups[one] == groups.max())
        return bool(groups[one] <= groups[other] <= groups[one] + 1)

    def degrees(self, drones: int) -> tuple[Any, NDArray[np.float64]]:
        """Return the equations, as a sparse table: each unit is entered once and left once, head and tail once by each drone."""
        from scipy.sparse import csc_array

        sides = (self.heads, self.tails) if self.apart else (self.heads,)
        ways = len(self.heads)
        at = np.concatenate([number * (self.units + 1) + side for number, side in enumerate(sides)])
        count = len(sides) * (self.units + 1)
        columns = np.tile(np.arange(ways), len(sides))
        rows: Any = csc_array((np.ones(len(at)), (at, columns)), shape=(count, ways + EXTRA))
        wanted = np.ones(count)
        wanted[self.units :: self.units + 1] = drones
        return rows, wanted

    def first_columns(self) -> NDArray[np.bool_]:
        """Choose the initial columns: the shortest ways from and to each unit, and all that are not ways."""
        chosen = np.ones(len(self.heads) + EXTRA, dtype=bool)
        if not self.apart:
            return chosen
        chosen[:-EXTRA] = False
        for side in (self.heads, self.tails):
            order = np.lexsort((self.time_s, side))
            begins = np.searchsorted(side[order], np.arange(self.units + 1))
            rank = np.arange(len(order)) - begins[side[order]]
            chosen[order[rank < NEAREST]] = True
        return chosen

    def cuts(self, x: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return rows of ways into sets of units that are entered too rarely: at least one of them is required."""
        if not self.apart or self.units < 2:
            return []
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        flow = x[: len(self.heads)]
        found: list[NDArray[np.float64]] = []
        for least in (1e-6, 0.3, 0.6):
            used = flow > least
            graph = csr_array((flow[used], (self.tails[used], self.heads[used])), shape=(self.units + 1,) * 2)
            count, part = connected_components(graph, directed=False)
            for number in range(count):
                inside = part == number
                if inside[self.units]:
                    continue
                into = ~inside[self.tails] & inside[self.heads]
                if float(flow[into].sum()) < 1.0 - 1e-3:
                    found.append(np.concatenate((into.astype(np.float64), np.zeros(EXTRA))))
            if found:
                break
        return found
