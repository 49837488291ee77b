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

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled
from skyway.planner.problem.flight_table import table_cruise, table_slot, table_slot_end

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.flight_table import FlightTable

EPS_S = 1e-7  # functions are told apart by so much


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
def link(
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
            if a[k] + EPS_S < x < a[k + 1] - EPS_S:
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
def at(t: NDArray[np.float64], a: NDArray[np.float64], n: int, x: float) -> float:
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
def lower(
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
        if a1[k] < at(t0, a0, n0, t1[k]) - EPS_S:
            better = True
            break
    if not better:
        for k in range(n0):
            if at(t1, a1, n1, t0[k]) < a0[k] - EPS_S:
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
        now0, now1 = at(t0, a0, n0, x), at(t1, a1, n1, x)
        if k > 0:
            before = xs[k - 1]
            was0, was1 = at(t0, a0, n0, before), at(t1, a1, n1, before)
            if (was0 - was1) * (now0 - now1) < 0.0 and x > before:
                part = (was0 - was1) / ((was0 - was1) - (now0 - now1))
                where = before + part * (x - before)
                if out_t[size - 1] + EPS_S < where < x - EPS_S:
                    out_t[size], out_a[size] = where, was0 + part * (now0 - was0)
                    size += 1
        # Points closer than the tolerance count once.
        if size > 0 and x <= out_t[size - 1] + EPS_S and k < len(xs) - 1:
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
            if abs(a[size - 1] + part * (a[k + 1] - a[size - 1]) - a[k]) < EPS_S:
                continue
        t[size], a[size] = t[k], a[k]
        size += 1
    return size
