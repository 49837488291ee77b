"""Kernels of labels: what a vehicle can be at a node, and must be there, as line segments over time and energy.

With one pace of charging c (time per energy), all that a vehicle can be when it leaves a node after some charging is a segment

    (t0, s0) .. (t0 + c (s1 - s0), s1),

the more time, the more energy; less energy than the segment is possible, too. All that it must be when it arrives, for the rest
of its route to be feasible, is

    s >= low,   t <= min(last, line + c (s - low)).

Both keep their shape over arcs, windows and stations (Desaulniers, Errico, Irnich and Schneider, "Exact algorithms for electric
vehicle-routing problems with time windows", Operations Research 64 (2016), have the forward one). So whether two parts of a route fit
together is told at once. Time that is infinite (ahead), or minus infinite (behind), means: infeasible.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled_lean

if TYPE_CHECKING:
    from skyway.planner.tours.problem import Tours

SLACK = 1e-9


@compiled_lean
def move(time: float, energy: float, pace: float, t0: float, s0: float, s1: float) -> tuple[float, float, float]:
    """Label after an arc: shifted, and cut off where the energy would be below 0."""
    t0 += time
    s0 -= energy
    s1 -= energy
    if s1 < -SLACK:
        return np.inf, 0.0, 0.0
    s1 = max(s1, 0.0)
    if s0 < 0.0:
        t0 -= pace * s0
        s0 = 0.0
    return t0, s0, s1


@compiled_lean
def travel(tours: Tours, way: int, load: float, t0: float, s0: float, s1: float) -> tuple[float, float, float]:
    """Label on arrival over a way, with a load aboard: arcs with a charge of any length between each two."""
    ways = tours.ways
    t0, s0, s1 = move(ways.time[way, 0], ways.energy[way, 0] + load * ways.lift[way, 0], tours.pace, t0, s0, s1)
    for stop in range(2):
        if ways.station[way, stop] < 0 or t0 == np.inf:
            break
        s1 = max(s1, tours.level)
        leg = stop + 1
        t0, s0, s1 = move(
            ways.time[way, leg], ways.energy[way, leg] + load * ways.lift[way, leg], tours.pace, t0, s0, s1
        )
    return t0, s0, s1


@compiled_lean
def serve(tours: Tours, node: int, t0: float, s0: float, s1: float) -> tuple[float, float, float]:
    """Label after the service of a customer: what is before the window waits, what is after it is cut off."""
    ready, due, pace = tours.ready[node], tours.due[node], tours.pace
    if t0 > due + SLACK:
        return np.inf, 0.0, 0.0
    if t0 < ready:
        s0 = min(s0 + (ready - t0) / pace, s1)
        t0 = ready
    if t0 + pace * (s1 - s0) > due:
        s1 = min(s1, s0 + max(due - t0, 0.0) / pace)
    return t0 + tours.service[node], s0, s1


@compiled_lean
def move_back(
    time: float, energy: float, battery: float, low: float, line: float, last: float
) -> tuple[float, float, float]:
    """What is required before an arc."""
    low += energy
    if low > battery + SLACK:
        return 0.0, -np.inf, -np.inf
    return low, line - time, last - time


@compiled_lean
def travel_back(
    tours: Tours, way: int, load: float, low: float, line: float, last: float
) -> tuple[float, float, float]:
    """What is required when a way begins: before a station any energy does, with the time to charge what is missing."""
    ways = tours.ways
    for leg in range(2, 0, -1):
        if ways.station[way, leg - 1] >= 0:
            takes = ways.energy[way, leg] + load * ways.lift[way, leg]
            low, line, last = move_back(ways.time[way, leg], takes, tours.battery, low, line, last)
            if low > tours.level + SLACK or last == -np.inf:
                return 0.0, -np.inf, -np.inf
            line -= tours.pace * low
            low = 0.0
    return move_back(ways.time[way, 0], ways.energy[way, 0] + load * ways.lift[way, 0], tours.battery, low, line, last)


@compiled_lean
def serve_back(tours: Tours, node: int, low: float, line: float, last: float) -> tuple[float, float, float]:
    """What is required on arrival at a customer whose rest of the route requires something."""
    ready, due, service = tours.ready[node], tours.due[node], tours.service[node]
    line -= service
    last = min(last - service, due)
    if last < ready - SLACK:
        return 0.0, -np.inf, -np.inf
    if line < ready:
        low += (ready - line) / tours.pace
        line = ready
    if low > tours.battery + SLACK:
        return 0.0, -np.inf, -np.inf
    return low, min(line, last), last


@compiled_lean
def fits(pace: float, t0: float, s0: float, s1: float, low: float, line: float, last: float) -> bool:
    """Whether what arrives is what is required: at the least energy that does, beyond that nothing gains."""
    at = max(s0, low)
    if at > s1 + SLACK or t0 == np.inf:
        return False
    return t0 + pace * (at - s0) <= min(last, line + pace * (at - low)) + SLACK
