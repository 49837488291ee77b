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

TIE_S = 1e-4
"""Times are compared this generously: sums of POSIX seconds are rounded by some 1e-6 s."""

_TIE = 1e-8
"""Who ends this close to the border of two cells may be in either: POSIX seconds are rounded by some 1e-7 s."""


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


class Waits(NamedTuple):
    """What arrivals at the beginning of each cell wait for, shape (cells, nodes) each."""

    pad_s: NDArray[np.float64]
    spot_s: NDArray[np.float64]
    """When they get a pad, and a place to land, POSIX seconds."""
    pad_cell: NDArray[np.int32]
    spot_cell: NDArray[np.int32]
    """The first cell with take-offs from then on; as many as there are cells if that is after the last."""


@compiled
def queue_cells(grounds: Grounds, cells: Cells, climb_s: float, descent_s: float, nodes: int) -> Waits:
    """Return what arrivals wait for.

    A drone that arrives at a behind the first i others has a pad at max(a + delay_i, pad_i), lands at max(a, land_i).

    Takes a queue of one entry at least for each node, and cells from none up.
    """
    pad = np.empty((cells.length, nodes))
    spot = np.empty((cells.length, nodes))
    pad_cell = np.empty((cells.length, nodes), dtype=np.int32)
    spot_cell = np.empty((cells.length, nodes), dtype=np.int32)
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
            pad_cell[i, node] = cell_of(cells, -climb_s, pad[i, node])
            spot_cell[i, node] = cell_of(cells, -climb_s, spot[i, node])
    return Waits(pad, spot, pad_cell, spot_cell)


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


class Open(NamedTuple):
    """Segments that are open in a slot: those of node i are ``first[i] : first[i + 1]``."""

    first: NDArray[np.int64]
    """Shape (nodes + 1,)."""
    number: NDArray[np.int64]
    head: NDArray[np.int64]
    takes_s: NDArray[np.float64]
    """Shape (segments,) each. Segment, where it leads, and seconds over it at the ground speed of the slot."""
    steps: NDArray[np.int64]
    """Whole cells of these."""
    place: NDArray[np.int64]
    """Where a flight ends that begins in cell i, in cells by nodes one behind the other: this much after the beginning of cell i."""
    ratio: NDArray[np.float64]
    """Ground speed over that of the next slot; 0 where it is closed then."""
    opened: NDArray[np.bool_]
    """Whether it was closed in the slot before."""
    longest_s: NDArray[np.float64]
    """Shape (nodes,). The longest of `takes_s`."""


@compiled
def open_in(table: FlightTable, slot: int, step_s: float) -> Open:
    """Return the segments that are open in a slot, for cells of some seconds."""
    nodes, size = len(table.first) - 1, len(table.head)
    following = min(slot + 1, len(table.speed_mps) - 1)
    first = np.zeros(nodes + 1, dtype=np.int64)
    whole = np.empty((4, size), dtype=np.int64)
    number, head, steps, place = whole[0], whole[1], whole[2], whole[3]
    takes_s, ratio, opened = np.empty(size), np.empty(size), np.zeros(size, dtype=np.bool_)
    longest_s = np.zeros(nodes)
    count = 0
    for node in range(nodes):
        for segment in range(table.first[node], table.first[node + 1]):
            speed, then = table.speed_mps[slot, segment], table.speed_mps[following, segment]
            if speed <= 0.0:
                continue
            number[count], head[count] = segment, table.head[segment]
            takes_s[count] = table.distance_m[segment] / speed
            longest_s[node] = max(longest_s[node], takes_s[count])
            steps[count] = int(takes_s[count] / step_s)
            place[count] = steps[count] * nodes + head[count]
            ratio[count] = speed / then if then > 0.0 else 0.0
            opened[count] = slot > 0 and table.speed_mps[slot - 1, segment] <= 0.0
            count += 1
        first[node + 1] = count
    return Open(first, number, head, takes_s, steps, place, ratio, opened, longest_s)


@compiled
def regular_s(table: FlightTable, slot: int, x: float, step_s: float) -> float:
    """Return how long flights over a segment may take to need no look at the slots beside that of the cell that begins at x: `crossed` knows of the others."""
    if slot > 0 and x < table.start_s + slot * table.slot_s + table.climb_s:
        return -1.0
    return table_slot_end(table, slot) - x - step_s - table.descent_s


@compiled_lean
def crossed(
    table: FlightTable, cells: Cells, open_now: Open, k: int, i: int, in_slot: tuple[float, int, float]
) -> tuple[int, int, float]:
    """What `crossing` returns of cell i and the k-th open segment, quickly for flights that end in the slot of the cell or in the one after it.

    `in_slot` is when the cell begins, its slot and the slot's end, POSIX seconds. A flight that takes T in the slot and has s seconds of it
    left ends after s + (T - s) v / w, with v / w the ratio of its speed to that of the next slot.

    No segment of a flight may be closed in any slot between take-off and touch-down. So one that has just been opened is
    entered a climb after the slot's beginning at the soonest, and one that is closed next is left a descent before its end.
    """
    over_s, slot, ends = in_slot
    takes_s, ratio, step_s = open_now.takes_s[k], open_now.ratio[k], cells.step_s
    waits_s = 0.0
    if open_now.opened[k]:
        waits_s = max(table.start_s + slot * table.slot_s + table.climb_s - over_s, 0.0)
        if waits_s > step_s:
            return -1, -2, NEVER
    # What is left of the slot where it is entered first and last in the cell.
    left_s, later_s = ends - over_s - waits_s, ends - over_s - step_s
    if ratio <= 0.0:  # what flies is down before the next slot
        left_s, later_s = left_s - table.descent_s, later_s - table.descent_s
        if takes_s > left_s + 1e-6:
            return -1, -2, NEVER
    if takes_s <= later_s:
        return i + int((waits_s + takes_s) / step_s - _TIE), i + open_now.steps[k] + 1, takes_s
    if ratio <= 0.0:
        return i + int((waits_s + takes_s) / step_s - _TIE), i + int((waits_s + left_s) / step_s + _TIE), takes_s
    begin = takes_s if takes_s <= left_s else left_s + (takes_s - left_s) * ratio
    end = later_s + (takes_s - later_s) * ratio
    if over_s + step_s + end <= table_slot_end(table, slot + 1):
        return i + int((waits_s + begin) / step_s - _TIE), i + 1 + int(end / step_s + _TIE), min(begin, end)
    return crossing(table, cells, open_now.number[k], over_s)


@compiled
def nearest_first(open_now: Open, step_s: float) -> NDArray[np.int64]:
    """Put the segments of each node that may be flown within a cell before its others; returns how many these are, shape (nodes,).

    As no cell holds two slots, that takes less than a cell at the speed of the slot.
    """
    inner = np.zeros(len(open_now.first) - 1, dtype=np.int64)
    for node in range(len(inner)):
        low = open_now.first[node]
        for k in range(low, open_now.first[node + 1]):
            if open_now.takes_s[k] > 1.001 * step_s:
                continue
            m = low + inner[node]
            for one in (open_now.number, open_now.head, open_now.steps, open_now.place):
                one[k], one[m] = one[m], one[k]
            open_now.opened[k], open_now.opened[m] = open_now.opened[m], open_now.opened[k]
            for other in (open_now.takes_s, open_now.ratio):
                other[k], other[m] = other[m], other[k]
            inner[node] += 1
    return inner


@compiled_lean
def time_from_empty(grounds: Grounds, node: int, soc: float) -> float:
    """F^-1: time on a pad of a node from empty to a charge, s."""
    kind = grounds.curve_of[node]
    return interpolate(soc, grounds.curve_soc[kind], grounds.curve_s[kind])


@compiled_lean
def charge_after(grounds: Grounds, node: int, time_s: float) -> float:
    """F: charge after a time on a pad of a node, from empty."""
    kind = grounds.curve_of[node]
    return interpolate(time_s, grounds.curve_s[kind], grounds.curve_soc[kind])


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
