"""Kernels of the relaxation: forward and backward passes over a grid of times; see `planner.exact.relaxation`."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled
from skyway.planner.problem.flight_table import table_cruise, table_slot, table_slot_end
from skyway.planner.schedule.profile_kernels import interpolate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Costs, Grounds
    from skyway.planner.problem.flight_table import FlightTable

_NONE = -math.inf
_LOOSE = 1e-9
"""Charges and potentials are compared this generously, so that rounding never cuts off what is exact."""


class Cells(NamedTuple):
    """The grid of times.

    Cell i holds the times from ``over_s + i * step_s`` up to the next one's at which the drone is over a node; take-offs
    are a climb earlier and touch-downs (or arrivals in a queue) a descent later, in the cell of the same number.
    """

    over_s: float
    step_s: float
    length: int


@compiled
def _cell(cells: Cells, shift_s: float, time_s: float) -> int:
    """Cell of a time on the grid that is shifted; beyond all cells for times that never come."""
    x = (time_s - cells.over_s - shift_s) / cells.step_s
    if x >= cells.length:
        return cells.length
    return max(int(math.floor(x + 1e-9)), 0)


@compiled
def queue_cells(
    grounds: Grounds, cells: Cells, descent_s: float, nodes: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """When arrivals at the beginning of each cell get a pad and a place to land, shape (cells, nodes).

    Takes a queue of one entry at least for each node, and cells from none up.
    """
    pad = np.empty((cells.length, nodes))
    spot = np.empty((cells.length, nodes))
    for node in range(nodes):
        low, high = grounds.queue_offset[node], grounds.queue_offset[node + 1]
        k = low
        for i in range(cells.length):
            arrive = cells.over_s + i * cells.step_s + descent_s
            while k + 1 < high and grounds.arrival_s[k + 1] <= arrive:
                k += 1
            pad[i, node] = max(arrive + grounds.delay_s[k], grounds.pad_s[k])
            spot[i, node] = max(arrive, grounds.land_s[k])
    return pad, spot


@compiled
def _crossing(table: FlightTable, cells: Cells, segment: int, over_s: float) -> tuple[int, int, float]:
    """First and last cell in which flights over a segment that are entered within a cell end, and the least time of one.

    The last cell is before the first where the segment cannot be flown.
    """
    later_s = over_s + cells.step_s
    last = len(table.speed_mps) - 1
    begin = table_cruise(table, segment, over_s, last)
    if begin == NEVER:
        return 0, -1, NEVER
    end = table_cruise(table, segment, later_s, last)
    slot = table_slot(table, over_s)
    following = table_slot_end(table, slot)
    if end < NEVER and (following == NEVER or end <= table_slot_end(table, slot + 1)):
        least = min(
            begin - over_s, end - later_s
        )  # at most one boundary is crossed: the time has one bend and is flat before it
    else:
        if end == NEVER:  # later ones would meet a closed slot: those that fly are there before it begins
            other = table_slot(table, begin)
            while table.speed_mps[other, segment] > 0.0:
                other += 1
            end = table_slot_end(table, other - 1)
        fastest = 0.0
        for other in range(slot, table_slot(table, end) + 1):
            fastest = max(fastest, table.speed_mps[other, segment])
        least = table.distance_m[segment] / fastest
    return _cell(cells, 0.0, begin), _cell(cells, 0.0, end), least


@compiled
def _time_from_empty(grounds: Grounds, node: int, soc: float) -> float:
    """Time on a pad of a node from empty to a charge."""
    kind = grounds.curve_of[node]
    if (
        grounds.curve_soc[kind, 0] <= soc < grounds.curve_soc[kind, 1]
    ):  # most charging is along the first, straight piece
        part = (soc - grounds.curve_soc[kind, 0]) / (grounds.curve_soc[kind, 1] - grounds.curve_soc[kind, 0])
        time: float = grounds.curve_s[kind, 0] + part * (grounds.curve_s[kind, 1] - grounds.curve_s[kind, 0])
        return time
    last = grounds.curve_points[kind]
    return interpolate(soc, grounds.curve_soc[kind, :last], grounds.curve_s[kind, :last])


@compiled
def _charge_after(grounds: Grounds, node: int, time_s: float) -> float:
    """Charge after a time on a pad of a node, from empty."""
    kind = grounds.curve_of[node]
    if grounds.curve_s[kind, 0] <= time_s < grounds.curve_s[kind, 1]:
        part = (time_s - grounds.curve_s[kind, 0]) / (grounds.curve_s[kind, 1] - grounds.curve_s[kind, 0])
        soc: float = grounds.curve_soc[kind, 0] + part * (grounds.curve_soc[kind, 1] - grounds.curve_soc[kind, 0])
        return soc
    last = grounds.curve_points[kind]
    return interpolate(time_s, grounds.curve_s[kind, :last], grounds.curve_soc[kind, :last])


class Pass(NamedTuple):
    """What both passes read: see `planner.exact.relaxation`.

    Attributes
    ----------
    pad_s, spot_s : ndarray, shape (cells, nodes)
        Of `queue_cells`.
    has_pads : ndarray of bool, shape (nodes,)
        Where a drone can land on its way.
    goal : int
        The destination.
    needed : ndarray, shape (cells,)
        Least charge on touch-down there; infinite in cells that are too late.
    allowed : ndarray of bool, shape (coarse cells, nodes)
        Where it is worth asking; elsewhere there is no way.
    ratio : int
        Cells in a coarse cell.
    """

    table: FlightTable
    grounds: Grounds
    costs: Costs
    cells: Cells
    pad_s: NDArray[np.float64]
    spot_s: NDArray[np.float64]
    has_pads: NDArray[np.bool_]
    goal: int
    needed: NDArray[np.float64]
    allowed: NDArray[np.bool_]
    ratio: int


@compiled
def forward_pass(  # noqa: PLR0915  one loop: taking it apart costs more than the work that is done in it
    one: Pass, origin: tuple[int, float, float, float, bool], remaining: tuple[NDArray[np.float64], float], after: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, int]:
    """Most charge that a drone can have over each node, and leave it with, in each cell.

    Takes a `Pass` of `planner.exact.relaxation` of a cell or more, a finite start, and any pad time, deadline and `after` from 0 up, infinite included.

    Parameters
    ----------
    one : Pass
        Where and when.
    origin : (node, soc, time_s, pad_s, at_once)
        Where and when the delivery starts, and when there is a pad; ``at_once``: it cannot stay.
    remaining : (least_s, deadline_s)
        Least cruise time from each node to the destination; nothing is followed that cannot be there by the deadline.
    after : float
        How far to go on after the first arrival, as a share of the time until then.

    Returns
    -------
    over, leave : ndarray, shape (cells, nodes)
        -inf where there is no way.
    first, last : int
        Cell of the first touch-down at the destination (beyond all cells: none) and the last one filled.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    pad_s, spot_s, has_pads, allowed, goal, ratio = (
        one.pad_s,
        one.spot_s,
        one.has_pads,
        one.allowed,
        one.goal,
        one.ratio,
    )
    first, head, length_m, speeds = table.first, table.head, table.distance_m, table.speed_mps
    nodes = len(first) - 1
    rows = np.full((5, cells.length, nodes), _NONE)
    over, rest, leave, landed, onto = rows[0], rows[1], rows[2], rows[3], rows[4]
    h, z = np.full(nodes, _NONE), np.full(nodes, _NONE)  # most charge landed and potential reached so far
    seen = np.zeros(nodes, dtype=np.bool_)
    start, soc, depart_s, first_pad_s, at_once = origin
    seen[start] = True
    begin = min(_cell(cells, -table.climb_s, depart_s), cells.length - 1)
    landed[begin, start] = soc
    cell = _cell(cells, -table.climb_s, first_pad_s)
    if cell < cells.length:
        onto[cell, start] = _time_from_empty(grounds, start, soc) - first_pad_s
    least_s, deadline = remaining
    last, found = cells.length - 1, cells.length
    per_s, strict = costs.soc_per_s, costs.soc_per_s + costs.margin_soc_per_s
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    climb = costs.soc_fixed + per_s * table.climb_s
    enough = costs.reserve - _LOOSE + strict * table.descent_s
    full_s = costs.reserve / costs.rate_per_s
    drain = (per_s + costs.rate_per_s) / costs.rate_per_s
    i = begin - 1
    while i < last:
        i += 1
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        inside = table_slot_end(table, slot) - x - cells.step_s
        down_by = x + cells.step_s + table.descent_s
        stale = seen.copy()
        again = True
        while again:
            again = False
            for node in range(nodes):
                if not stale[node]:
                    continue
                stale[node] = False
                barred = len(allowed) > 0 and not allowed[i // ratio, node]
                flight = least_s[node] + table.descent_s
                charge = over[i, node]
                left = rest[i, node] if margin else charge
                late = max(x + flight, full_s + flight * drain - (charge / costs.rate_per_s - x)) > deadline
                if barred or late or left < enough:
                    charge = left = _NONE
                elif node == goal:
                    landing = min(charge - per_s * table.descent_s, left - strict * table.descent_s)
                    if landing >= one.needed[i] - _LOOSE and found > i:
                        found = i
                        elapsed_s = max(x + table.descent_s - depart_s, cells.step_s)  # the first cell begins before it
                        more_s = min(after * elapsed_s, 1e9) + 60.0
                        last = min(last, i + 1 + int(more_s / cells.step_s))
                        deadline = min(deadline, down_by + more_s)
                elif has_pads[node]:
                    hover = max(0.0, spot_s[i, node] - down_by) + table.descent_s
                    down = charge - per_s * hover
                    if left - strict * hover >= costs.reserve - _LOOSE:
                        cell = _cell(cells, -table.climb_s, spot_s[i, node])
                        if cell < cells.length:
                            landed[cell, node] = max(landed[cell, node], down)
                        cell = _cell(cells, -table.climb_s, pad_s[i, node])
                        if cell < cells.length:
                            u = _time_from_empty(grounds, node, down) - pad_s[i, node]
                            onto[cell, node] = max(onto[cell, node], u)
                h[node], z[node] = max(h[node], landed[i, node]), max(z[node], onto[i, node])
                off = h[node]
                if z[node] > _NONE:
                    off = max(off, _charge_after(grounds, node, x + cells.step_s - table.climb_s + z[node]))
                if at_once and node == start and i > begin:
                    off = _NONE
                leave[i, node] = off
                off -= climb
                late = max(x + flight, full_s + flight * drain - (off / costs.rate_per_s - x)) > deadline
                if not barred and not late:
                    charge, left = max(charge, off), max(left, off - costs.margin_soc_per_s * table.climb_s)
                over[i, node] = charge
                if margin:
                    rest[i, node] = left
                if left < enough:
                    continue
                for segment in range(first[node], first[node + 1]):
                    speed = speeds[slot, segment]
                    if speed <= 0.0:
                        continue
                    least = length_m[segment] / speed
                    if least <= inside:
                        cell = i + int(least / cells.step_s)
                        end = cell + 1
                    else:
                        cell, end, least = _crossing(table, cells, segment, x)
                    less, lesser = charge - per_s * least, left - strict * least
                    if lesser < enough:
                        continue
                    other = head[segment]
                    seen[other] = True
                    while cell <= end and cell < cells.length:
                        if less > over[cell, other] or (margin and lesser > rest[cell, other]):
                            over[cell, other] = max(less, over[cell, other])
                            if margin:
                                rest[cell, other] = max(lesser, rest[cell, other])
                            if cell == i:
                                stale[other] = again = True
                        cell += 1
    return over, leave, found, last


@compiled
def backward_pass(one: Pass) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: PLR0915  as above
    """Least charge from which the destination can be reached in time, over each node and on leaving it.

    Takes a `Pass` of `planner.exact.relaxation`: a cell or more, and arrays of its cells and nodes.

    Returns
    -------
    over, leave : ndarray, shape (cells, nodes)
        Infinite where there is no way.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    pad_s, spot_s, has_pads, allowed, goal, ratio = (
        one.pad_s,
        one.spot_s,
        one.has_pads,
        one.allowed,
        one.goal,
        one.ratio,
    )
    first, head, length_m, speeds = table.first, table.head, table.distance_m, table.speed_mps
    nodes = len(first) - 1
    rows = np.full((5, cells.length + 1, nodes), NEVER)
    # Over a node; the same for reserve and margin alone; to leave it; the least of that, and of the potential, from here on.
    over, rest, leave, ever, potential = rows[0], rows[1], rows[2], rows[3], rows[4]
    per_s, strict = costs.soc_per_s, costs.soc_per_s + costs.margin_soc_per_s
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    climb = costs.soc_fixed + per_s * table.climb_s
    for i in range(cells.length - 1, -1, -1):
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        inside = table_slot_end(table, slot) - x - cells.step_s
        down_by = x + cells.step_s + table.descent_s
        again = True
        ever[i], potential[i] = ever[i + 1], potential[i + 1]
        while again:
            again = False
            for node in range(nodes):
                if not allowed[i // ratio, node]:
                    continue
                fly, least_rest = NEVER, NEVER
                short = False
                for segment in range(first[node], first[node + 1]):
                    speed = speeds[slot, segment]
                    if speed <= 0.0:
                        continue
                    other = head[segment]
                    least = length_m[segment] / speed
                    if least <= inside:
                        cell = i + int(least / cells.step_s)
                        end = cell + 1
                    else:
                        cell, end, least = _crossing(table, cells, segment, x)
                    short = short or cell == i
                    while cell <= end and cell < cells.length:
                        fly = min(fly, over[cell, other] + per_s * least)
                        if margin:
                            least_rest = min(least_rest, rest[cell, other] + strict * least)
                        cell += 1
                if not margin:
                    least_rest = fly
                off = max(fly, least_rest + costs.margin_soc_per_s * table.climb_s) + climb
                if off < NEVER and (off <= 1.0 + _LOOSE or not has_pads[node]):
                    leave[i, node], ever[i, node] = off, min(ever[i, node], off)
                    u = _time_from_empty(grounds, node, min(off, 1.0)) - (x - table.climb_s + cells.step_s)
                    potential[i, node] = min(potential[i, node], u)
                if node == goal:
                    fly = min(fly, one.needed[i] + per_s * table.descent_s)
                    least_rest = min(least_rest, one.needed[i] + strict * table.descent_s)
                elif has_pads[node] and ever[i, node] < NEVER:
                    down = NEVER
                    cell = _cell(cells, -table.climb_s, spot_s[i, node])
                    if cell < cells.length:
                        down = ever[cell, node]
                    cell = _cell(cells, -table.climb_s, pad_s[i, node])
                    if cell < cells.length and potential[cell, node] < NEVER:
                        down = min(down, _charge_after(grounds, node, pad_s[i, node] + potential[cell, node]))
                    hover = max(0.0, spot_s[i, node] - down_by) + table.descent_s
                    fly = min(fly, max(down, costs.reserve) + per_s * hover)
                    if down < NEVER:
                        least_rest = min(least_rest, costs.reserve + strict * hover)
                if fly < over[i, node] or (margin and least_rest < rest[i, node]):
                    over[i, node] = min(fly, over[i, node])
                    if margin:
                        rest[i, node] = min(least_rest, rest[i, node])
                    again = again or short
    return over[:-1], leave[:-1]


@compiled
def in_time(
    over: NDArray[np.float64],
    cells: Cells,
    descent_s: float,
    costs: Costs,
    least_s: NDArray[np.float64],
    deadline_s: float,
) -> NDArray[np.bool_]:
    """Return where a drone over a node with the most charge it can have can be at the destination by a deadline.

    Takes arrays of the cells and nodes, and any deadline.
    """
    out = np.zeros(over.shape, dtype=np.bool_)
    drain = (costs.soc_per_s + costs.rate_per_s) / costs.rate_per_s
    for i in range(len(over)):
        x = cells.over_s + i * cells.step_s
        for node in range(len(least_s)):
            flight = least_s[node] + descent_s
            charge = (costs.reserve - over[i, node]) / costs.rate_per_s + flight * drain
            out[i, node] = over[i, node] > _NONE and max(x + flight, x + charge) <= deadline_s
    return out


@compiled
def least_times(table: FlightTable, goal: int) -> NDArray[np.float64]:
    """Least cruise time from each node to one, each segment at its best ground speed of any slot, shape (nodes,).

    Takes a node of the table; speeds finite and 0 or more.
    """
    nodes = len(table.first) - 1
    count = np.zeros(nodes + 1, dtype=np.int64)
    for other in table.head:
        count[other + 1] += 1
    first = np.cumsum(count)
    place = first[:-1].copy()
    into = np.empty(len(table.head), dtype=np.int64)
    tail = np.empty(len(table.head), dtype=np.int64)
    for node in range(nodes):
        for segment in range(table.first[node], table.first[node + 1]):
            into[place[table.head[segment]]] = segment
            tail[segment] = node
            place[table.head[segment]] += 1
    out = np.full(nodes, NEVER)
    out[goal] = 0.0
    heap = [(0.0, goal)]
    while len(heap) > 0:
        time, node = heapq.heappop(heap)
        if time > out[node]:
            continue
        for k in range(first[node], first[node + 1]):
            segment = into[k]
            speed = 0.0
            for slot in range(len(table.speed_mps)):
                speed = max(speed, table.speed_mps[slot, segment])
            if speed > 0.0 and time + table.distance_m[segment] / speed < out[tail[segment]]:
                out[tail[segment]] = time + table.distance_m[segment] / speed
                heapq.heappush(heap, (out[tail[segment]], tail[segment]))
    return out


@compiled
def slack(
    g: NDArray[np.float64],
    node: int,
    cells: Cells,
    climb_s: float,
    window: tuple[int, int],
    leave: NDArray[np.float64],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> float:
    """Most by which a departure profile exceeds what a node asks for, in seconds of charging; negative: nowhere.

    Takes a window of cells of the grid (none where the last is before the first), and a curve that ascends.
    """
    best = -1.0
    k = 0
    last = len(g) - 1
    first = max(window[0], _cell(cells, -climb_s, g[0, 0]))
    for i in range(first, window[1] + 1):
        least = leave[i, node]
        if least == NEVER:
            continue
        t = cells.over_s + (i + 1) * cells.step_s - climb_s
        while k < last and g[k + 1, 0] <= t:
            k += 1
        charge = g[k, 1]
        if k < last and t > g[k, 0]:
            charge += (g[k + 1, 1] - g[k, 1]) * (t - g[k, 0]) / (g[k + 1, 0] - g[k, 0])
        if charge >= least - _LOOSE:
            spare = interpolate(min(charge, 1.0), curve_soc, curve_s) - interpolate(least, curve_soc, curve_s)
            best = max(best, spare, 0.0)
    return best
