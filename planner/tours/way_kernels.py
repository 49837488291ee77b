"""Kernels that find the ways between two places: an arc, or arcs over one or two stations; those that another one beats in all are left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Arcs

SLACK = 1e-9
COST, TIME, ENERGY, LIFT, STATION, ARC, TABLE = 0, 1, 4, 7, 10, 12, 15
"""First columns of cost, time, energy and lift of up to three arcs, the stations between them (-1: none), and which of the parallel arcs they are."""


@compiled
def legs_of(way: NDArray[np.float64]) -> int:
    """How many arcs a way has."""
    return 1 + int(way[STATION] >= 0) + int(way[STATION + 1] >= 0)


@compiled
def beats(one: NDArray[np.float64], other: NDArray[np.float64], most_load: float) -> bool:
    """Whether a way is as good as another wherever that can be used: no longer, no more energy at its ends, and between its stations."""
    legs, others = legs_of(one), legs_of(other)
    if (legs == 1) != (others == 1) or legs > others:
        return False
    if (
        one[COST] > other[COST]
        or one[TIME] + one[TIME + 1] + one[TIME + 2] > other[TIME] + other[TIME + 1] + other[TIME + 2]
    ):
        return False
    for leg in range(legs):
        against = others - 1 if leg == legs - 1 else leg
        for load in (0.0, most_load):
            if one[ENERGY + leg] + load * one[LIFT + leg] > other[ENERGY + against] + load * other[LIFT + against]:
                return False
    return True


@compiled
def candidates(
    arcs: Arcs, stations: NDArray[np.int64], tail: int, head: int, spare: float, battery: float, level: float, table: NDArray[np.float64]
) -> int:  # fmt: skip
    """Write all ways of a pair that take no longer than `spare` and keep the battery; returns how many, up to the length of the table."""
    parallel, count, filled = arcs.cost.shape[0], len(stations), 0
    stops = np.empty(4, dtype=np.int64)
    choice = np.empty(3, dtype=np.int64)
    for one in range(-1, count):
        for other in range(-1, count):
            if other >= 0 and (one < 0 or other == one):
                continue
            legs = 1 + int(one >= 0) + int(other >= 0)
            stops[0] = tail
            if one >= 0:
                stops[1] = stations[one]
            if other >= 0:
                stops[2] = stations[other]
            stops[legs] = head
            for number in range(parallel**legs):
                rest, feasible = number, True
                way = table[filled]
                way[:] = 0.0
                way[STATION], way[STATION + 1] = one, other
                for leg in range(legs):
                    choice[leg] = rest % parallel
                    rest //= parallel
                    arc = choice[leg], stops[leg], stops[leg + 1]
                    way[COST] += arcs.cost[arc]
                    way[TIME + leg], way[ENERGY + leg], way[LIFT + leg] = (
                        arcs.time[arc],
                        arcs.energy[arc],
                        arcs.lift[arc],
                    )
                    way[ARC + leg] = choice[leg]
                    feasible = feasible and arcs.energy[arc] <= (battery if leg == 0 else level) + SLACK
                if feasible and way[COST] < np.inf and way[TIME] + way[TIME + 1] + way[TIME + 2] <= spare + SLACK:
                    filled += 1
                    if filled == len(table):
                        return filled - 1
    return filled


@compiled
def ways_of(
    arcs: Arcs,
    stations: NDArray[np.int64],
    tail: int,
    head: int,
    spare: float,
    battery: float,
    level: float,
    most_load: float,
) -> NDArray[np.float64]:
    """Ways of a pair by cost, shape (ways, 15), none of them beaten by another.

    Takes two nodes of the arcs, and stations of them, any number.
    """
    parallel, count = arcs.cost.shape[0], len(stations)
    table = np.empty((parallel + parallel**2 * count + parallel**3 * count * count + 1, TABLE))
    filled = candidates(arcs, stations, tail, head, spare, battery, level, table)
    order = np.argsort(table[:filled, COST])
    kept = np.empty((filled, TABLE))
    found = 0
    for place in range(filled):
        way = table[order[place]]
        beaten = False
        for one in range(found):
            if beats(kept[one], way, most_load):
                beaten = True
                break
        if not beaten:
            kept[found] = way
            found += 1
    return kept[:found].copy()
