"""Arrival functions of flights: the earliest touch-down at every station for each take-off time.

Between take-off and landing a drone may overfly stations. For take-offs within one time slot the earliest arrival over
all walks is a continuous, never-decreasing, piecewise-linear function A_v(t) of the take-off time t for each node v.
With T(x) the time at which the segment (v, w) is left that was entered at x (`table_cruise`), they are the greatest
that satisfy

    A_source(t) = t + climb,     A_w(t) <= T(A_v(t)) for each segment (v, w)

and are found for all stations at once by label correction on whole functions: A_w <- min(A_w, T o A_v) until nothing
changes (profile search). Touch-down is A_v(t) + descent. The rule that no segment of a flight may be over the limits in
any slot the flight touches (`models.flight.rules`) is met by one search for each last slot, on the segments that are
open in all slots up to it.

A function is two arrays t, a of n points, POSIX seconds, linear between them.

Source: Dean, "Shortest paths in FIFO time-dependent networks: theory and algorithms" (2004).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled
from skyway.planner.exact.relaxation_grid_kernels import LOOSE, Cells, cell_of
from skyway.planner.problem.flight_table import table_cruise, table_slot, table_slot_end

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.flight_table import FlightTable

_EPS_S = 1e-7
_EARLY_S = 1e-4  # a flight that must be down before a slot begins is down this much earlier
_POINTS = 16  # points of a function at first; grows as needed


class Asked(NamedTuple):
    """What is asked of the flights from one node: nothing where there are no cells."""

    cells: Cells
    """The grid of a guide, see `planner.exact.relaxation`."""
    leave: NDArray[np.float64]
    """Shape (cells,). Most charge that the drone can take off with up to the end of each cell; -inf where with none."""
    need: NDArray[np.float64]
    """Shape (nodes, cells). Least charge that it must have over each node; infinite where there is no way."""
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
        if asked.need[node, j] < NEVER:
            off = cell_of(cells, -climb_s, cells.over_s + (j + 1) * cells.step_s - took_s)
            if asked.leave[min(off, cells.length - 1)] - spent >= asked.need[node, j]:
                return True
    return False


@compiled
def _is_later(
    t: NDArray[np.float64], a: NDArray[np.float64], n: NDArray[np.int64], node: int, other: int, least_s: float
) -> bool:
    """Whether the function of a node and `least_s` more is nowhere below that of another: going on there gains nothing."""
    for k in range(n[node]):
        if a[node, k] + least_s < _at(t[other], a[other], n[other], t[node, k]) - _EPS_S:
            return False
    for k in range(n[other]):
        if _at(t[node], a[node], n[node], t[other, k]) + least_s < a[other, k] - _EPS_S:
            return False
    return True


@compiled
def _entered(table: FlightTable, segment: int, slot: int, since_s: float) -> float:
    """When a segment was entered that is left as a slot ends; -inf where that was before `since_s`.

    T^-1, slot by slot backwards.
    """
    left = table.distance_m[segment]
    now = table_slot_end(table, slot)
    while now > since_s:
        speed = table.speed_mps[slot, segment]
        if speed <= 0.0:
            break
        begin = table_slot_end(table, slot - 1) if slot > 0 else -NEVER
        if now - left / speed >= begin:
            return now - left / speed
        left -= speed * (now - begin)
        now = begin
        slot -= 1
    return -NEVER


@compiled
def _link(
    table: FlightTable, segment: int, last_slot: int, t: NDArray[np.float64], a: NDArray[np.float64], n: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Append a segment to an arrival function of n points: T o A.

    A segment's own arrival function bends where it is entered at the boundary of two slots, and where it is left at
    one: that boundary, however many lie before it on the way, is pulled back through the segment. Between bends T is
    linear, so points at all of them and at those of A are exact.
    """
    entering = table_slot(
        table, a[0]
    )  # the next boundaries to be met on entering and on leaving, by the slots they end
    leaving = entering
    out_t = np.empty(n + 2 * max(last_slot - entering, 0))
    out_a = np.empty(len(out_t))
    enter = table_slot_end(table, entering) if entering < last_slot else NEVER
    leave = _entered(table, segment, leaving, a[0]) if leaving < last_slot else NEVER
    size = 0
    for k in range(n):
        # The points of A, and between each two of them the bends of T that lie there, in order.
        out_t[size], out_a[size] = t[k], table_cruise(table, segment, a[k], last_slot)
        size += 1
        while k < n - 1:
            x = min(enter, leave)
            if x >= a[k + 1]:
                break
            if a[k] + _EPS_S < x < a[k + 1] - _EPS_S:
                # The take-off that enters the segment at the bend x.
                where = t[k] + (x - a[k]) / (a[k + 1] - a[k]) * (t[k + 1] - t[k])
                if out_t[size - 1] < where < t[k + 1]:
                    out_t[size], out_a[size] = where, table_cruise(table, segment, x, last_slot)
                    size += 1
            # The next bend of the kind that was met.
            if enter <= leave:
                entering += 1
                enter = table_slot_end(table, entering) if entering < last_slot else NEVER
            else:
                leaving += 1
                leave = _entered(table, segment, leaving, a[0]) if leaving < last_slot else NEVER
    return out_t, out_a, size


@compiled
def _at(t: NDArray[np.float64], a: NDArray[np.float64], n: int, x: float) -> float:
    """Value of a function of n points at x, held beyond its ends; by bisection."""
    low, high = 0, n - 1
    if x <= t[0]:
        return a[0]
    if x >= t[high]:
        return a[high]
    while high - low > 1:
        middle = (low + high) // 2
        if t[middle] <= x:
            low = middle
        else:
            high = middle
    if t[high] <= t[low]:
        return a[high]
    return a[low] + (a[high] - a[low]) * (x - t[low]) / (t[high] - t[low])


@compiled
def _lower(
    t0: NDArray[np.float64],
    a0: NDArray[np.float64],
    n0: int,
    t1: NDArray[np.float64],
    a1: NDArray[np.float64],
    n1: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, bool]:
    """Lower envelope of two functions on the same domain; the flag tells whether the second is anywhere lower.

    If it is not, at the points of either, the first is returned as it is: most corrections change nothing.
    """
    better = False
    # Is the second lower anywhere?
    for k in range(n1):
        if a1[k] < _at(t0, a0, n0, t1[k]) - _EPS_S:
            better = True
            break
    if not better:
        for k in range(n0):
            if _at(t1, a1, n1, t0[k]) < a0[k] - _EPS_S:
                better = True
                break
    if not better:
        return t0, a0, n0, False
    # The points of both in order; their values there and at the point before; where the two cross in between.
    xs = np.sort(np.concatenate((t0[:n0], t1[:n1])))
    out_t = np.empty(2 * len(xs))
    out_a = np.empty(2 * len(xs))
    size = 0
    for k in range(len(xs)):
        x = xs[k]
        now0, now1 = _at(t0, a0, n0, x), _at(t1, a1, n1, x)
        if k > 0:
            before = xs[k - 1]
            was0, was1 = _at(t0, a0, n0, before), _at(t1, a1, n1, before)
            if (was0 - was1) * (now0 - now1) < 0.0 and x > before:
                part = (was0 - was1) / ((was0 - was1) - (now0 - now1))
                where = before + part * (x - before)
                if out_t[size - 1] + _EPS_S < where < x - _EPS_S:
                    out_t[size], out_a[size] = where, was0 + part * (now0 - was0)
                    size += 1
        # Points closer than the tolerance count once.
        if size > 0 and x <= out_t[size - 1] + _EPS_S and k < len(xs) - 1:
            continue
        out_t[size], out_a[size] = x, min(now0, now1)
        size += 1
    return out_t, out_a, _straighten(out_t, out_a, size), True


@compiled
def _straighten(t: NDArray[np.float64], a: NDArray[np.float64], n: int) -> int:
    """Drop, in place, points that lie on the line through their neighbours; returns how many are left."""
    size = min(n, 1)
    for k in range(1, n):
        if k < n - 1 and t[k + 1] > t[size - 1]:
            part = (t[k] - t[size - 1]) / (t[k + 1] - t[size - 1])
            if abs(a[size - 1] + part * (a[k + 1] - a[size - 1]) - a[k]) < _EPS_S:
                continue
        t[size], a[size] = t[k], a[k]
        size += 1
    return size


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
    within `limit_s` or none that serves what is asked. Label correction with a first-in-first-out queue (Bellman and
    Ford): O(nodes x segments) functions at worst, in practice each segment a few times.
    """
    s0, s1 = slots
    nodes = len(table.first) - 1
    t = np.empty((nodes, _POINTS))
    a = np.empty((nodes, _POINTS))
    n = np.zeros(nodes, dtype=np.int64)
    # The source: over it a climb after each take-off of the slot that is asked for.
    begin = max(_slot_begin(table, s0), asked.begin_s)
    end = min(table.start_s + (s0 + 1) * table.slot_s, asked.end_s)
    if begin >= end:
        return t, a, n
    t[source, 0], t[source, 1] = begin, end
    a[source, 0], a[source, 1] = begin + table.climb_s, end + table.climb_s
    n[source] = 2
    # Nodes whose function has changed, in a ring.
    queue = np.empty(nodes + 1, dtype=np.int64)
    queued = np.zeros(nodes, dtype=np.bool_)
    queue[0], queued[source] = source, True
    read, write = 0, 1
    while read != write:
        node = queue[read]
        read = (read + 1) % (nodes + 1)
        queued[node] = False
        took_s = NEVER
        for k in range(n[node]):
            took_s = min(took_s, a[node, k] - t[node, k])
        for segment in range(table.first[node], table.first[node + 1]):
            other = table.head[segment]
            if not useful[other] or other == source:
                continue
            # Skip segments that are closed in one of the slots; the least time over the others.
            slowest, fastest = NEVER, 0.0
            for slot in range(s0, s1 + 1):
                speed = table.speed_mps[slot, segment]
                slowest, fastest = min(slowest, speed), max(fastest, speed)
            if slowest <= 0.0:
                continue
            least_s = table.distance_m[segment] / fastest - _EPS_S
            if took_s + least_s + table.descent_s > limit_s:
                continue
            if n[other] > 0 and _is_later(t, a, n, node, other, least_s):
                continue
            soonest = a[node, 0] + least_s
            latest = a[node, n[node] - 1] + table.distance_m[segment] / slowest
            if not _may_serve(asked, other, table.climb_s, took_s + least_s, (soonest, latest)):
                continue
            # T o A, if it is short enough for the battery at any time.
            lt, la, ln = _link(table, segment, s1, t[node], a[node], n[node])
            shortest = NEVER
            for k in range(ln):
                shortest = min(shortest, la[k] - lt[k])
            if shortest + table.descent_s > limit_s:
                continue
            # The lower envelope with what is known of the node; if that changes, the node is queued again.
            if n[other] > 0:
                lt, la, ln, better = _lower(t[other], a[other], n[other], lt, la, ln)
                if not better:
                    continue
            if ln > t.shape[1]:
                wider_t, wider_a = np.empty((nodes, 2 * ln)), np.empty((nodes, 2 * ln))
                wider_t[:, : t.shape[1]], wider_a[:, : a.shape[1]] = t, a
                t, a = wider_t, wider_a
            t[other, :ln], a[other, :ln], n[other] = lt[:ln], la[:ln], ln
            if not queued[other]:
                queue[write] = other
                write = (write + 1) % (nodes + 1)
                queued[other] = True
    return t, a, n


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
