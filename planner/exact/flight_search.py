"""Searches for arrival functions: the earliest touch-down at every station for each take-off, see `planner.exact.flight_functions`.

Searches are guided: a flight is left out that nowhere has the charge which a guide asks for (`Asked`).
"""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled
from skyway.planner.exact.flight_functions import EPS_S, at, link, lower
from skyway.planner.exact.relaxation_grid_kernels import LOOSE, Cells, cell_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.flight_table import FlightTable

_EARLY_S = 1e-4  # a flight that must be down before a slot begins is down this much earlier
_POINTS = 16  # points of a function at first; grows as needed


class Asked(NamedTuple):
    """What is asked of the flights from one node: nothing where there are no cells."""

    cells: Cells
    """The grid of a guide, see `planner.exact.relaxation`."""
    leave: NDArray[np.float64]
    """Shape (cells,). Most charge that the drone can take off with up to the end of each cell; -inf where with none."""
    need: NDArray[np.float64]
    """Shape (cells, nodes). Least charge that it must have over each node; infinite where there is no way."""
    soc_per_s: float
    soc_fixed: float
    """A flight of T seconds takes ``soc_fixed + soc_per_s * T``."""
    begin_s: float
    end_s: float
    """First and last take-off."""


def nothing_asked() -> Asked:
    """Return what leaves out no flight."""
    return Asked(Cells(0.0, 1.0, 0), np.empty(0), np.empty((0, 0)), 0.0, 0.0, -math.inf, math.inf)


@compiled
def _may_serve(asked: Asked, node: int, climb_s: float, took_s: float, between_s: tuple[float, float]) -> bool:
    """Whether a drone that takes `took_s` seconds at least to be over a node, some time between two, can have the charge.

    In cell j it took off by x_(j+1) - took, with the most charge of until then.
    """
    cells = asked.cells
    if cells.length == 0:
        return True
    spent = asked.soc_fixed + asked.soc_per_s * took_s - 10.0 * LOOSE
    first = cell_of(cells, 0.0, between_s[0] - 0.01)
    for j in range(first, min(cell_of(cells, 0.0, between_s[1] + 0.01), cells.length - 1) + 1):
        if asked.need[j, node] < NEVER:
            off = cell_of(cells, -climb_s, cells.over_s + (j + 1) * cells.step_s - took_s)
            if asked.leave[min(off, cells.length - 1)] - spent >= asked.need[j, node]:
                return True
    return False


@compiled
def _is_later(
    t: NDArray[np.float64], a: NDArray[np.float64], n: NDArray[np.int64], node: int, other: int, least_s: float
) -> bool:
    """Whether the function of a node and `least_s` more is nowhere below that of another: going on there gains nothing."""
    for k in range(n[node]):
        if a[node, k] + least_s < at(t[other], a[other], n[other], t[node, k]) - EPS_S:
            return False
    for k in range(n[other]):  # noqa: SIM110  a kernel
        if at(t[node], a[node], n[node], t[other, k]) + least_s < a[other, k] - EPS_S:
            return False
    return True


@compiled
def _slot_begin(table: FlightTable, slot: int) -> float:
    """Beginning of a slot; the first one also holds some time before it: a drone in flight begins a climb earlier."""
    if slot > 0:
        return table.start_s + slot * table.slot_s
    return table.start_s - max(table.slot_s, 2.0 * table.climb_s)


@compiled
def _search(
    table: FlightTable,
    source: int,
    slots: tuple[int, int],
    limit_s: float,
    useful: NDArray[np.bool_],
    asked: Asked,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Arrival over every node (before descent) for take-offs in slot ``slots[0]``, on segments open up to ``slots[1]``.

    Returns t, a, shape (nodes, points), and n, shape (nodes,): the functions, with no points where there is no way
    within `limit_s` or none that serves what is asked. Label correction, the function with the earliest arrival
    first: O(nodes x segments) functions at worst, in practice each segment once or twice, and O(nodes) for each node.
    """
    s0, s1 = slots
    nodes = len(table.first) - 1
    t, a = np.empty((nodes, _POINTS)), np.empty((nodes, _POINTS))
    n = np.zeros(nodes, dtype=np.int64)
    # The source: over it a climb after each take-off of the slot that is asked for.
    begin, end = max(_slot_begin(table, s0), asked.begin_s), min(table.start_s + (s0 + 1) * table.slot_s, asked.end_s)
    if begin >= end:
        return t, a, n
    t[source, 0], t[source, 1] = begin, end
    a[source, 0], a[source, 1] = begin + table.climb_s, end + table.climb_s
    n[source] = 2
    # Least and greatest time from take-off to over each node; least and greatest time over each open segment.
    took, longest = np.full(nodes, NEVER), np.full(nodes, NEVER)
    took[source] = longest[source] = table.climb_s
    times_s = np.empty((2, len(table.head)))
    least_s, most_s = times_s[0], times_s[1]
    worth = _in_reach(table, source, slots, limit_s, useful, asked, times_s)
    # Nodes whose function has changed; the one that is reached first comes first, so that most are settled at once.
    queued = np.zeros(nodes, dtype=np.bool_)
    queued[source] = True
    heap = [(a[source, 0], source)]
    while len(heap) > 0:
        _, node = heapq.heappop(heap)
        if not queued[node]:  # an earlier arrival brought it up before
            continue
        queued[node] = False
        for segment in range(table.first[node], table.first[node + 1]):
            other = table.head[segment]
            # Skip what gains nothing, at the least time over the segment; closed segments and the way back to the source.
            soonest = took[node] + least_s[segment]
            if not worth[other] or soonest >= longest[other] - EPS_S or soonest + table.descent_s > limit_s:
                continue
            if other == source or (n[other] > 0 and _is_later(t, a, n, node, other, least_s[segment])):
                continue
            between = a[node, 0] + least_s[segment], a[node, n[node] - 1] + most_s[segment]
            if not _may_serve(asked, other, table.climb_s, soonest, between):
                continue
            # T o A, if it is short enough for the battery at any time.
            lt, la, ln = link(table, segment, s1, t[node], a[node], n[node])
            shortest = NEVER
            for k in range(ln):
                shortest = min(shortest, la[k] - lt[k])
            if shortest + table.descent_s > limit_s:
                continue
            # The lower envelope with what is known of the node; if that changes, the node is queued again.
            if n[other] > 0:
                lt, la, ln, better = lower(t[other], a[other], n[other], lt, la, ln)
                if not better:
                    continue
            if ln > t.shape[1]:
                wider_t, wider_a = np.empty((nodes, 2 * ln)), np.empty((nodes, 2 * ln))
                wider_t[:, : t.shape[1]], wider_a[:, : a.shape[1]] = t, a
                t, a = wider_t, wider_a
            t[other, :ln], a[other, :ln], n[other] = lt[:ln], la[:ln], ln
            took[other], longest[other] = NEVER, 0.0
            for k in range(ln):
                took[other], longest[other] = min(took[other], la[k] - lt[k]), max(longest[other], la[k] - lt[k])
            queued[other] = True
            heapq.heappush(heap, (a[other, 0], other))
    return t, a, n


@compiled
def _least_and_most(table: FlightTable, node: int, slots: tuple[int, int], times_s: NDArray[np.float64]) -> None:
    """Set least and greatest time over each segment that leaves a node at the speeds of some slots; never where one of them closes it."""
    for segment in range(table.first[node], table.first[node + 1]):
        slowest, fastest = NEVER, 0.0
        for slot in range(slots[0], slots[1] + 1):
            speed = table.speed_mps[slot, segment]
            slowest, fastest = min(slowest, speed), max(fastest, speed)
        times_s[0, segment] = table.distance_m[segment] / fastest - EPS_S if slowest > 0.0 else NEVER
        times_s[1, segment] = table.distance_m[segment] / slowest if slowest > 0.0 else NEVER


@compiled
def _in_reach(
    table: FlightTable,
    source: int,
    slots: tuple[int, int],
    limit_s: float,
    useful: NDArray[np.bool_],
    asked: Asked,
    times_s: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which useful nodes can be flown over within a time at the least time over each segment, over such nodes, with the charge that is asked for.

    Dijkstra's algorithm. `times_s` is set for the segments that leave the source and these nodes.
    """
    found = np.zeros(len(table.first) - 1, dtype=np.bool_)
    if asked.cells.length == 0:
        for node in range(len(found)):
            _least_and_most(table, node, slots, times_s)
        return useful
    over = np.full(len(found), NEVER)
    over[source] = table.climb_s
    heap = [(table.climb_s, source)]
    while len(heap) > 0:
        took_s, node = heapq.heappop(heap)
        if took_s > over[node]:
            continue
        between_s = asked.begin_s + took_s, asked.end_s + limit_s
        found[node] = useful[node] and _may_serve(asked, node, table.climb_s, took_s, between_s)
        if not found[node] and node != source:
            continue
        _least_and_most(table, node, slots, times_s)
        for segment in range(table.first[node], table.first[node + 1]):
            other, there = table.head[segment], took_s + times_s[0, segment]
            if useful[other] and there < over[other] and there + table.descent_s <= limit_s:
                over[other] = there
                heapq.heappush(heap, (there, other))
    return found


@compiled
def flights_from(
    table: FlightTable, source: int, slots: tuple[int, int], limit_s: float, useful: NDArray[np.bool_], asked: Asked
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Earliest touch-down at every node for take-offs at `source` from the first to the last of some slots.

    Takes a node and slots of the table, in order, and flags for all nodes; speeds finite and 0 or more
    (`kernel_inputs.check_speeds`). Where the last slot is before the first, the flights are those of the first.

    Parameters
    ----------
    table : FlightTable
        Segments and ground speeds.
    source, slots : int, (int, int)
        Take-off node, first and last slot.
    limit_s : float
        Longest flight the battery allows.
    useful : ndarray of bool, shape (nodes,)
        Stations worth flying to or over; the others are left out.
    asked : Asked
        What flights must serve for; others may be left out.

    Returns
    -------
    offset : ndarray, shape (nodes + 1,)
        Pieces of node j are ``offset[j] : offset[j + 1]``.
    pieces : ndarray, shape (pieces, 4)
        (t0, a0, t1, a1): take-off and touch-down, linear between; sorted, gaps are not flyable.
    """
    pieces = [np.empty((0, 4))]
    owner = [np.empty(0, dtype=np.int64)]
    _add_flights(table, source, slots[0], limit_s, useful, asked, pieces, owner)
    for slot in range(slots[0] + 1, slots[1] + 1):
        _add_flights(table, source, slot, limit_s, useful, asked, pieces, owner)
    return _pack(len(table.first) - 1, pieces, owner)


@compiled
def _add_flights(
    table: FlightTable,
    source: int,
    slot: int,
    limit_s: float,
    useful: NDArray[np.bool_],
    asked: Asked,
    pieces: list[NDArray[np.float64]],
    owner: list[NDArray[np.int64]],
) -> None:
    """Add the pieces of take-offs within one slot, and the node of each, block by block.

    One search for each last slot in which a flight may end, the earliest first: the answer of a search holds for the
    take-offs that are down by the end of its last slot, if no earlier search has answered for them.
    """
    nodes = len(table.first) - 1
    slots = len(table.speed_mps)
    reach = min(slot + int(math.ceil(limit_s / table.slot_s)), slots - 1)
    taken = np.full(nodes, _slot_begin(table, slot))  # up to here earlier last slots have answered
    for last in range(slot, reach + 1):
        if last < reach:
            same = True
            for segment in range(len(table.head)):
                if table.speed_mps[last + 1, segment] <= 0.0 and table.speed_mps[last, segment] > 0.0:
                    same = False
                    break
            if same:
                continue  # the next last slot has the same segments and reaches farther
        t, a, n = _search(table, source, (slot, last), limit_s, useful, asked)
        bound = NEVER if last == slots - 1 else table.start_s + (last + 1) * table.slot_s - _EARLY_S
        for node in range(nodes):
            if node == source or n[node] == 0:
                continue
            found = np.empty((n[node], 4))
            size = 0
            for k in range(n[node] - 1):
                # Touch-downs of a piece, cut to the take-offs that are still unanswered and that are down by then.
                t0, a0 = t[node, k], a[node, k] + table.descent_s
                t1, a1 = t[node, k + 1], a[node, k + 1] + table.descent_s
                if t1 <= taken[node] or t1 <= t0 or a0 > bound:
                    continue
                slope = (a1 - a0) / (t1 - t0)
                if t0 < taken[node]:
                    t0, a0 = taken[node], a0 + slope * (taken[node] - t0)
                if a1 > bound:
                    t1, a1 = t1 - (a1 - bound) / slope, bound
                if t1 > t0 and a0 <= bound:
                    found[size, 0], found[size, 1], found[size, 2], found[size, 3] = t0, a0, t1, a1
                    size += 1
            if size > 0:
                taken[node] = found[size - 1, 2]
                pieces.append(found[:size])
                owner.append(np.full(size, node))


@compiled
def _pack(
    nodes: int, pieces: list[NDArray[np.float64]], owner: list[NDArray[np.int64]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Sort pieces by node, keeping their order: offset and pieces as `flights_from` returns them.

    `owner` is the node of each piece, block by block like `pieces`. Counting sort, O(nodes + pieces).
    """
    offset = np.zeros(nodes + 1, dtype=np.int64)
    for block in owner:
        for node in block:
            offset[node + 1] += 1
    offset = np.cumsum(offset)
    place = offset[:-1].copy()
    out = np.empty((offset[-1], 4))
    for number in range(len(pieces)):
        for k in range(len(pieces[number])):
            node = owner[number][k]
            out[place[node]] = pieces[number][k]
            place[node] += 1
    return offset, out
