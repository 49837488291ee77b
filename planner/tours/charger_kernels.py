"""Kernels of the pads of stations: tours are driven one after the other, and each charges as little as the rest of its way requires, on the pad that is free first."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.planner.calendar_kernels import Calendar, book, free_from
from skyway.planner.tours.depot_kernels import Queue, late_jobs
from skyway.planner.tours.route_kernels import node_at, start_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.route_kernels import Plan

MOVE, CHARGE, SERVE = range(3)
KIND, NODE, STATION, BEGIN, END, ENERGY, ENERGY_AFTER, PAD = range(8)
"""Columns of a timetable: to which node, at or to which station on the way to it (-1: none), when, and with which energy."""
LEAST = 1e-9
"""Energy below which nothing is charged."""


class Space(NamedTuple):
    """What laying out tours on chargers needs."""

    queue: Queue
    """Of the chargers at the depot."""
    calendar: Calendar
    """Of all pads of stations."""
    silent: NDArray[np.float64]
    """Shape (0, 8): a timetable that nobody reads."""


@compiled_lean
def note(rows: NDArray[np.float64], row: int, kind: int, node: int, station: int, begin: float, end: float, energy: float, after: float, pad: int) -> int:  # fmt: skip
    """Write a row of a timetable, where there is room; return the number of the next one."""
    if row < len(rows):
        rows[row, KIND], rows[row, NODE], rows[row, STATION], rows[row, BEGIN] = kind, node, station, begin
        rows[row, END], rows[row, ENERGY], rows[row, ENERGY_AFTER], rows[row, PAD] = end, energy, after, pad
    return row + 1


@compiled_lean
def charge(
    tours: Tours, calendar: Calendar, rows: NDArray[np.float64], row: int, route: int, node: int, station: int, time: float, energy: float, wanted: float
) -> tuple[float, int]:  # fmt: skip
    """Charge at a station on the pad that is free first; returns the end, and the number of the next row."""
    pads, length = tours.pads, tours.pace * (wanted - energy)
    begin, pad = time, -1
    if len(pads.number):
        begin = np.inf
        for one in range(pads.first[station], pads.first[station] + pads.number[station]):
            free = free_from(calendar, one, time, length, -2)
            if free < begin:
                begin, pad = free, one
        book(calendar, pad, begin, begin + length, route)
    row = note(rows, row, CHARGE, node, station, begin, begin + length, energy, wanted, pad)
    return begin + length, row


@compiled_lean
def drive(tours: Tours, plan: Plan, route: int, calendar: Calendar, rows: NDArray[np.float64]) -> tuple[float, int]:
    """Drive a tour on the pads that are free, and take them; returns by how much it is late in sum, and how many rows it has.

    At a station with the energy s it charges max(0, b - s), b the least energy with which the rest of the route is feasible: more would make
    nothing possible, since what is charged takes the same time anywhere.

    Takes a route of the plan, labelled by `relabel`, and rows for each of its stops.
    """
    ways = tours.ways
    time, energy = start_of(tours, plan, route), tours.vehicles.energy[route]
    late, row = 0.0, 0
    for position in range(plan.length[route] + 1):
        way, node, load = plan.way[route, position], node_at(plan, route, position), plan.aboard[route, position]
        for leg in range(3):
            if leg > 0 and ways.station[way, leg - 1] < 0:
                break
            takes = ways.energy[way, leg] + load * ways.lift[way, leg]
            onward = leg < 2 and ways.station[way, leg] >= 0
            if leg > 0:
                wanted = min(takes + (0.0 if onward else plan.behind[route, position, 0]), tours.level)
                if wanted > energy + LEAST:
                    time, row = charge(
                        tours, calendar, rows, row, route, node, ways.station[way, leg - 1], time, energy, wanted
                    )
                    energy = wanted
            arrival = time + ways.time[way, leg]
            row = note(
                rows,
                row,
                MOVE,
                node,
                ways.station[way, leg] if onward else -1,
                time,
                arrival,
                energy,
                energy - takes,
                -1,
            )
            time, energy = arrival, energy - takes
        last = min(tours.due[0], tours.vehicles.end[route]) if node == 0 else tours.due[node]
        late += max(time - last, 0.0)
        if node > 0:
            begin = max(time, tours.ready[node])
            time = begin + tours.service[node]
            row = note(rows, row, SERVE, node, -1, begin, time, energy, energy, -1)
    return late, row


@compiled_lean
def clear(tours: Tours, calendar: Calendar) -> None:
    """Leave only what others have in a calendar.

    Takes a calendar of the chargers of the tours.
    """
    taken = tours.pads.taken
    for pad in range(len(taken.filled)):
        calendar.filled[pad] = taken.filled[pad]
        for one in range(taken.filled[pad]):
            calendar.start_s[pad, one], calendar.end_s[pad, one] = taken.start_s[pad, one], taken.end_s[pad, one]
            calendar.owner[pad, one] = -1


@compiled_lean
def late_tours(tours: Tours, plan: Plan, calendar: Calendar, silent: NDArray[np.float64]) -> float:
    """Return by how much tours are late in sum, since pads of stations are taken."""
    clear(tours, calendar)
    late = 0.0
    for route in range(len(plan.length)):
        if plan.length[route]:
            late += drive(tours, plan, route, calendar, silent)[0]
    return late


@compiled_lean
def lateness(tours: Tours, plan: Plan, space: Space) -> float:
    """Return by how much tours are late in sum, since chargers are few.

    Takes a plan whose routes are labelled, and the room that it needs.
    """
    late = late_jobs(tours, plan, space.queue) if tours.depot.chargers else 0.0
    if len(tours.pads.number):
        late += late_tours(tours, plan, space.calendar, space.silent)
    return late
