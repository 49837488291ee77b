"""Kernels of the relaxation's grid of times: its cells, and what they know of queues, segments and charging.

Cell i begins at x_i = ``over_s + i * step_s``. Both passes over the grid, and why they are a bound, are in
`planner.exact.relaxation_kernels`.
"""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.problem.flight_table import table_cruise, table_slot, table_slot_end
from skyway.planner.schedule.profile_kernels import interpolate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Grounds
    from skyway.planner.problem.flight_table import FlightTable

LOOSE = 1e-9
"""Charges and potentials are compared this generously, so that rounding never cuts off what is exact."""


class Cells(NamedTuple):
    """The grid of times.

    Cell i holds the times from ``over_s + i * step_s`` (POSIX seconds) up to the next one's at which the drone is over
    a node; take-offs are a climb earlier and touch-downs (or arrivals in a queue) a descent later, in the cell of the
    same number.
    """

    over_s: float
    step_s: float
    length: int


@compiled
def cell_of(cells: Cells, shift_s: float, time_s: float) -> int:
    """Cell of a time on the grid moved by `shift_s`; `cells.length` for times beyond it or never.

    Takes cells from none up, and any time.
    """
    x = (time_s - cells.over_s - shift_s) / cells.step_s
    if x >= cells.length:
        return cells.length
    return max(int(math.floor(x + 1e-9)), 0)


@compiled
def queue_cells(
    grounds: Grounds, cells: Cells, descent_s: float, nodes: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """When arrivals at the beginning of each cell get a pad, and a place to land, shape (cells, nodes); POSIX seconds.

    A drone that arrives at a behind the first i others has a pad at max(a + delay_i, pad_i), lands at max(a, land_i).

    Takes a queue of one entry at least for each node, and cells from none up.
    """
    pad = np.empty((cells.length, nodes))
    spot = np.empty((cells.length, nodes))
    for node in range(nodes):
        low, high = grounds.queue_offset[node], grounds.queue_offset[node + 1]
        k = low
        for i in range(cells.length):
            arrive = cells.over_s + i * cells.step_s + descent_s
            # Others that have arrived by then; the first entry of a packed path is -inf, which is no drone.
            while k + 1 < high and grounds.arrival_s[k + 1] <= arrive:
                k += 1
            pad[i, node] = max(arrive + grounds.delay_s[k], grounds.pad_s[k])
            spot[i, node] = max(arrive, grounds.land_s[k])
    return pad, spot


@compiled
def crossing(table: FlightTable, cells: Cells, segment: int, over_s: float) -> tuple[int, int, float]:
    """First and last cell in which flights over a segment that begin within a cell end, and the least time of one, s.

    The last cell is before the first where the segment cannot be flown. `over_s` is the beginning of the cell. Flights
    are first in, first out, so those entered at its beginning and end are the first and the last to end.
    """
    # Flights that enter at the two ends of the cell.
    later_s = over_s + cells.step_s
    last = len(table.speed_mps) - 1
    begin = table_cruise(table, segment, over_s, last)
    if begin == NEVER:
        return 0, -1, NEVER
    end = table_cruise(table, segment, later_s, last)
    slot = table_slot(table, over_s)
    following = table_slot_end(table, slot)
    if end < NEVER and (following == NEVER or end <= table_slot_end(table, slot + 1)):
        # At most one boundary is crossed: the time has one bend and is flat before it.
        least = min(begin - over_s, end - later_s)
    else:
        if end == NEVER:  # later ones would meet a closed slot: those that fly are there before it begins
            other = table_slot(table, begin)
            while table.speed_mps[other, segment] > 0.0:
                other += 1
            end = table_slot_end(table, other - 1)
        # Several boundaries: the whole way at the best speed of all slots on it.
        fastest = 0.0
        for other in range(slot, table_slot(table, end) + 1):
            fastest = max(fastest, table.speed_mps[other, segment])
        least = table.distance_m[segment] / fastest
    return cell_of(cells, 0.0, begin), cell_of(cells, 0.0, end), least


@compiled
def slot_times(table: FlightTable, slot: int, step_s: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Seconds over each segment at the ground speeds of one slot, never where it is closed, and whole cells of these."""
    out, steps = np.empty(len(table.head)), np.zeros(len(table.head), dtype=np.int64)
    for segment in range(len(out)):
        speed = table.speed_mps[slot, segment]
        out[segment] = table.distance_m[segment] / speed if speed > 0.0 else NEVER
        if speed > 0.0:
            steps[segment] = int(out[segment] / step_s)
    return out, steps


@compiled
def inner_segments(table: FlightTable, step_s: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Segments that can be flown within a cell, at the best speed of any slot: those of node i are ``first[i] : first[i + 1]``."""
    nodes = len(table.first) - 1
    first = np.zeros(nodes + 1, dtype=np.int64)
    inner = np.empty(len(table.head), dtype=np.int64)
    count = 0
    for node in range(nodes):
        for segment in range(table.first[node], table.first[node + 1]):
            speed = 0.0
            for slot in range(len(table.speed_mps)):
                speed = max(speed, table.speed_mps[slot, segment])
            if table.distance_m[segment] <= 1.001 * step_s * speed:
                inner[count] = segment
                count += 1
        first[node + 1] = count
    return first, inner[:count].copy()


@compiled_lean
def crossed(
    table: FlightTable, cells: Cells, segment: int, i: int, in_slot: tuple[float, int, float], takes_s: float
) -> tuple[int, int, float]:
    """What `crossing` returns of cell i, quickly for flights that end in the slot of the cell or in the one after it.

    `in_slot` is when the cell begins, its slot and the slot's end, POSIX seconds; `takes_s` what the segment takes in it.
    """
    over_s, slot, ends = in_slot
    if takes_s == NEVER:
        return -1, -2, NEVER
    later_s = over_s + cells.step_s
    if later_s + takes_s <= ends:
        cell = i + int(takes_s / cells.step_s)
        return cell, cell + 1, takes_s
    # Entered at the two ends of the cell, it goes on at the speed of the next slot.
    speed, then = table.speed_mps[slot, segment], table.speed_mps[slot + 1, segment]
    if then > 0.0:
        length = table.distance_m[segment]
        begin = over_s + takes_s if over_s + takes_s <= ends else ends + (length - speed * (ends - over_s)) / then
        end = ends + (length - speed * (ends - later_s)) / then
        if end <= table_slot_end(table, slot + 1):
            return cell_of(cells, 0.0, begin), cell_of(cells, 0.0, end), min(begin - over_s, end - later_s)
    return crossing(table, cells, segment, over_s)


@compiled
def time_from_empty(grounds: Grounds, node: int, soc: float) -> float:
    """F^-1: time on a pad of a node from empty to a charge, s."""
    kind = grounds.curve_of[node]
    # Most charging is along the first, straight piece.
    if grounds.curve_soc[kind, 0] <= soc < grounds.curve_soc[kind, 1]:
        part = (soc - grounds.curve_soc[kind, 0]) / (grounds.curve_soc[kind, 1] - grounds.curve_soc[kind, 0])
        time: float = grounds.curve_s[kind, 0] + part * (grounds.curve_s[kind, 1] - grounds.curve_s[kind, 0])
        return time
    last = grounds.curve_points[kind]
    return interpolate(soc, grounds.curve_soc[kind, :last], grounds.curve_s[kind, :last])


@compiled
def charge_after(grounds: Grounds, node: int, time_s: float) -> float:
    """F: charge after a time on a pad of a node, from empty."""
    kind = grounds.curve_of[node]
    if grounds.curve_s[kind, 0] <= time_s < grounds.curve_s[kind, 1]:
        part = (time_s - grounds.curve_s[kind, 0]) / (grounds.curve_s[kind, 1] - grounds.curve_s[kind, 0])
        soc: float = grounds.curve_soc[kind, 0] + part * (grounds.curve_soc[kind, 1] - grounds.curve_soc[kind, 0])
        return soc
    last = grounds.curve_points[kind]
    return interpolate(time_s, grounds.curve_s[kind, :last], grounds.curve_soc[kind, :last])


@compiled
def least_times(table: FlightTable, goal: int) -> NDArray[np.float64]:
    """Least cruise time from each node to one, each segment at its best ground speed of any slot, s, shape (nodes,).

    Dijkstra's algorithm backwards from `goal`: T(v) = min over segments (v, w) of d / (greatest speed) + T(w).
    O(segments (slots + log segments)).

    Takes a node of the table; speeds finite and 0 or more.
    """
    nodes = len(table.first) - 1
    # The segments that lead into each node, and where each comes from.
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
    # Nearest nodes first.
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

    The greatest F^-1(min(g(t), 1)) - F^-1(least) over the cells of the window with g(t) >= least, at their ends t =
    x_(i+1) - climb, where g, which never decreases, is greatest.

    Takes a window of cells of the grid (none where the last is before the first), and a curve that ascends.

    Parameters
    ----------
    g : ndarray, shape (points, 2)
        Departure profile of the node.
    window : (first, last)
        Cells in which the drone can leave it.
    leave : ndarray, shape (cells, nodes)
        Of `backward_pass`.
    curve_s, curve_soc : ndarray, shape (points,)
        F of the node.
    """
    best = -1.0
    k = 0
    last = len(g) - 1
    first = max(window[0], cell_of(cells, -climb_s, g[0, 0]))
    for i in range(first, window[1] + 1):
        least = leave[i, node]
        if least == NEVER:
            continue
        # g at the end of the cell.
        t = cells.over_s + (i + 1) * cells.step_s - climb_s
        while k < last and g[k + 1, 0] <= t:
            k += 1
        charge = g[k, 1]
        if k < last and t > g[k, 0]:
            charge += (g[k + 1, 1] - g[k, 1]) * (t - g[k, 0]) / (g[k + 1, 0] - g[k, 0])
        # Time of charging from what is asked for to what there is.
        if charge >= least - LOOSE:
            spare = interpolate(min(charge, 1.0), curve_soc, curve_s) - interpolate(least, curve_soc, curve_s)
            best = max(best, spare, 0.0)
    return best
