"""Onward flights from a destination without pads: the least charge at touch-down, over time."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.flight_search import flights_from, nothing_asked
from skyway.planner.problem.flight_table import FlightTable, table_slot

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.speeds import Speeds

_TOO_MUCH_SOC = 2.0
"""No battery holds this: there is no way on."""
_TOO_LONG_S = 1e9
"""Nobody hovers that long."""
_MOMENT_S = 3e-4
"""The last take-off before a slot that is closed is known this well (`planner.exact.flight_functions`)."""


def needed_at_destination(
    problem: Problem, speeds: Speeds, margin_soc_per_s: float, until_s: float
) -> NDArray[np.float64]:
    """Least charge on touch-down at the destination, by time: the reserve, and the way on where it has no pads.

    The way on is one flight to a station (`planner.problem.ways_on`); it begins after the time at the target or, held by
    the wind, when it first can. Touch-downs after `until_s` do not matter; for the margin see `planner.exact.stop_labels.StopLabels`.

    Returns time and SoC, shape (points, 2), linear between points and constant after the last; two points at the same
    time are a jump.
    """
    p = problem
    if not p.needs_escape:
        return np.array([[p.depart_s, p.reserve]])
    end = max(min(p.air.start_s + speeds.slots * p.air.slot_s, until_s + 60.0), p.depart_s + 1.0)
    if not p.ways_on:
        return np.array([[p.depart_s, p.reserve + _TOO_MUCH_SOC]])
    per_s, fixed = p.onward_cost
    lines = [_cost(p, speeds, way, (per_s + margin_soc_per_s, fixed), end) for way in p.ways_on]
    needed = _least(lines)
    needed[:, 1] = p.reserve + np.minimum(needed[:, 1], _TOO_MUCH_SOC)
    return needed


def needed_to_land(
    problem: Problem, speeds: Speeds, queues: Mapping[int, QueuePath], margin_soc_per_s: float, until_s: float
) -> NDArray[np.float64]:
    """Least charge on coming to the destination, by time: where it has pads, what hovering takes until there is room.

    Like `needed_at_destination`, for bounds: the destination without pads is the same, for there is always room.
    """
    p = problem
    if not p.has_pads(p.destination):
        return needed_at_destination(p, speeds, margin_soc_per_s, until_s)
    queue = queues[p.destination]
    begin = np.concatenate(([p.depart_s], np.maximum(queue.arrival_s, p.depart_s)))
    end = np.append(begin[1:], max(float(begin[-1]), until_s) + 1.0)
    room = np.clip(queue.land_s, begin, end)  # when hovering is over, for those who come in the interval
    late = np.maximum(queue.land_s - end, 0.0)
    hover_s = np.column_stack((np.maximum(queue.land_s - begin, 0.0), late, late)).ravel()
    needed = p.reserve + p.soc_per_s * np.minimum(hover_s, _TOO_LONG_S)
    points = np.column_stack((np.column_stack((begin, room, end)).ravel(), needed))
    fresh = np.concatenate(([True], np.any(np.diff(points, axis=0) != 0.0, axis=1)))
    return np.asarray(points[fresh])


def _cost(
    problem: Problem, speeds: Speeds, way: tuple[int, ...], cost: tuple[float, float], end_s: float
) -> NDArray[np.float64]:
    """Charge that a flight on takes, by the time of the touch-down before it: (t0, cost, t1, cost), without gaps."""
    air, dwell_s = problem.air, problem.request.dwell_s
    begin_s, end_s = problem.depart_s + dwell_s, end_s + dwell_s
    per_s, fixed = cost
    count, segments = len(way), np.array(way)
    table = FlightTable(
        air.start_s,
        air.slot_s,
        air.climb_s,
        air.descent_s,
        np.minimum(np.arange(count + 2), count),
        np.arange(1, count + 1),
        np.ascontiguousarray(air.distance_m[segments]),
        np.ascontiguousarray(speeds.over(0, speeds.slots - 1, segments), dtype=np.float64),
    )
    longest_s, useful = _TOO_MUCH_SOC / per_s, np.ones(count + 1, dtype=np.bool_)
    first = int(table_slot(table, begin_s))
    out: list[tuple[float, float, float, float]] = []
    done, before = begin_s, 0.0
    for last in (int(table_slot(table, end_s)), speeds.slots - 1):  # the wind may hold the drone until after the end
        offset, pieces = flights_from(table, 0, (first, last), longest_s, useful, nothing_asked())
        for t0, a0, t1, a1 in pieces[offset[count] : offset[count + 1]].tolist():
            if t1 <= done or done >= end_s:
                continue
            c0, c1 = fixed + per_s * (a0 - t0), fixed + per_s * (a1 - t1)
            begin, at_first = t0, c0
            if t0 < done:
                begin, at_first = done, c0 + (c1 - c0) * (done - t0) / (t1 - t0)
            elif t0 > done:  # held by the wind until then, at once or a moment later: the dearer one
                sure = min(done + _MOMENT_S, t0)
                out += [(done, max(before, c0), sure, max(before, c0)), (sure, c0, t0, c0)]
            out.append((begin, at_first, t1, c1))
            done, before = t1, c1
    if done < end_s:
        out.append((done, _TOO_MUCH_SOC, end_s, _TOO_MUCH_SOC))
    return np.asarray(np.array(out) - np.array([dwell_s, 0.0, dwell_s, 0.0]))


def _least(lines: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Lower envelope of functions that are linear in pieces and may jump, as points; see `needed_at_destination`."""
    last = min(float(line[-1, 2]) for line in lines)
    times = np.unique(np.concatenate([line[:, [0, 2]].ravel() for line in lines]))
    times = times[times <= last]
    begin, end = _ends(lines, times)
    crossings = [times]
    for a, b in combinations(range(len(lines)), 2):
        before, after = begin[a] - begin[b], end[a] - end[b]
        cross = before * after < 0.0
        part = before[cross] / (before[cross] - after[cross])
        crossings.append(times[:-1][cross] + part * np.diff(times)[cross])
    times = np.unique(np.concatenate(crossings))
    begin, end = _ends(lines, times)
    points = np.column_stack((np.repeat(times, 2)[1:-1], np.column_stack((begin.min(axis=0), end.min(axis=0))).ravel()))
    fresh = np.concatenate(([True], np.any(np.abs(np.diff(points, axis=0)) > (0.0, 1e-12), axis=1)))
    return np.asarray(points[fresh])


def _ends(lines: list[NDArray[np.float64]], times: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Values just after and just before the times that bound each interval, shape (functions, intervals) each."""
    middle = 0.5 * (times[:-1] + times[1:])
    found = []
    for line in lines:
        t0, c0, t1, c1 = line[np.clip(np.searchsorted(line[:, 0], middle, side="right") - 1, 0, len(line) - 1)].T
        slope = np.divide(c1 - c0, t1 - t0, out=np.zeros_like(t0), where=t1 > t0)
        found.append((c0 + slope * (times[:-1] - t0), c0 + slope * (times[1:] - t0)))
    return np.array([one for one, _ in found]), np.array([other for _, other in found])
