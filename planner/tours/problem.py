"""A problem of tours as arrays: customers, and the ways between each two of them, with or without a charge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.planner.calendar_kernels import Calendar

if TYPE_CHECKING:
    from numpy.typing import NDArray

SLACK = 1e-9
"""What rounding may take of a limit."""


class Ways(NamedTuple):
    """Ways between two nodes, those of each pair one after the other by cost, shape (ways,) each.

    A way is one arc, or an arc to a station, a charge there, and an arc from it. None of a pair is better than another in all.
    """

    cost: NDArray[np.float64]
    time: NDArray[np.float64]
    energy: NDArray[np.float64]
    lift: NDArray[np.float64]
    """Of the arc, or of the arc to the station; `lift` is the energy for each unit of load aboard."""
    station: NDArray[np.int64]
    """-1: no charge."""
    time_on: NDArray[np.float64]
    energy_on: NDArray[np.float64]
    lift_on: NDArray[np.float64]
    """Of the arc from the station; 0 without."""
    arc: NDArray[np.int64]
    """Shape (ways, 2): which of the parallel arcs it takes."""


class Vehicles(NamedTuple):
    """Vehicles, shape (vehicles,) each; they begin and end at the depot."""

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    energy: NDArray[np.float64]
    """With which it begins."""
    capacity: NDArray[np.float64]
    kind: NDArray[np.int64]
    """Those that are alike have the same number, and stand one after the other."""


class Pads(NamedTuple):
    """Chargers of the stations; without a station they are no concern."""

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    """Shape (stations,) each: number of the first one, and how many."""
    taken: Calendar
    """Windows that others have."""


class Depot(NamedTuple):
    """Chargers at the depot that fill empty vehicles before their tours, one at a time each, without a break; 0 chargers: no concern."""

    chargers: int
    periods: NDArray[np.int64]
    """Shape (energies,): periods until so much energy is charged."""
    period: float
    """Length of a period; the first begins at time 0."""


class Tours(NamedTuple):
    """Nodes are the depot, 0, and customers; shape (nodes,) each unless stated."""

    ready: NDArray[np.float64]
    due: NDArray[np.float64]
    """When service begins at the earliest and latest; of the depot: when a vehicle leaves at the earliest and is back at the latest."""
    service: NDArray[np.float64]
    demand: NDArray[np.float64]
    refusal: NDArray[np.float64]
    """Cost of not serving it."""
    vehicles: Vehicles
    battery: float
    pace: float
    """Energy of a full battery, and time to charge one unit of it."""
    level: float
    """Up to which energy stations charge."""
    first: NDArray[np.int64]
    """Shape (nodes, nodes + 1): number of the first way of a pair; the next element has the end."""
    ways: Ways
    guide: NDArray[np.float64]
    """Shape (ways,): cost by which ways are chosen, `Ways.cost` or above; a search with chargers at the depot puts a price on energy there."""
    fastest: NDArray[np.float64]
    """Shape (nodes, nodes): least time of any way of a pair, infinite where there is none."""
    near: NDArray[np.int64]
    """Shape (nodes, customers): customers by the cost of the way from and to each node."""
    pads: Pads
    depot: Depot


@dataclass(frozen=True)
class Arcs:
    """Arcs between all places, shape (parallel, places, places) each; an infinite cost: there is none."""

    cost: NDArray[np.float64]
    time: NDArray[np.float64]
    energy: NDArray[np.float64]
    lift: NDArray[np.float64]
    """Energy for each unit of load aboard."""


@dataclass(frozen=True)
class Visits:
    """What places want, shape (places,) each; place 0 is the depot."""

    ready: NDArray[np.float64]
    due: NDArray[np.float64]
    service: NDArray[np.float64]
    demand: NDArray[np.float64]
    refusal: NDArray[np.float64]


@dataclass(frozen=True)
class Charging:
    """How all stations charge: time for a unit of energy, up to which energy, of how much in all."""

    pace: float
    level: float
    battery: float


NO_PADS = Pads(
    np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64),
    Calendar(np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64)),
)  # fmt: skip
NO_DEPOT = Depot(0, np.empty(0, dtype=np.int64), 1.0)


def alike(count: int, begin: float, end: float, energy: float, capacity: float) -> Vehicles:
    """Return so many vehicles that are the same."""
    columns = (np.full(count, value, dtype=np.float64) for value in (begin, end, energy, capacity))
    return Vehicles(*columns, np.zeros(count, dtype=np.int64))


def lay_out(
    arcs: Arcs, visits: Visits, stations: NDArray[np.int64], vehicles: Vehicles, charging: Charging, pads: Pads = NO_PADS, depot: Depot = NO_DEPOT
) -> tuple[Tours, NDArray[np.int64]]:  # fmt: skip
    """Return the problem, and the place of each of its nodes.

    Parameters
    ----------
    arcs, visits : Arcs, Visits
        Between and at places.
    stations : array, shape (stations,)
        Places where is charged; all others are the depot or customers. `Ways.station` has their number in it.
    vehicles : Vehicles
        The fleet.
    charging : Charging
        At the stations.
    pads, depot : Pads, Depot
        Chargers that are few.
    """
    places = len(visits.ready)
    nodes = np.setdiff1d(np.arange(places), stations)
    rows: list[tuple[float, ...]] = []
    first = np.zeros((len(nodes), len(nodes) + 1), dtype=np.int64)
    least = np.full((len(nodes), len(nodes)), np.inf)
    fastest = least.copy()
    most = float(vehicles.capacity.max())
    for tail in range(len(nodes)):
        for head in range(len(nodes)):
            first[tail, head] = len(rows)
            found = (
                _ways(arcs, visits, stations, int(nodes[tail]), int(nodes[head]), charging, most)
                if tail != head
                else []
            )
            if found:
                least[tail, head] = found[0][0]
                fastest[tail, head] = min(way[1] + way[5] for way in found)
            rows += found
        first[tail, -1] = len(rows)
    table = np.array(rows, dtype=np.float64).reshape(-1, 10)
    cost, time, energy, lift, station, time_on, energy_on, lift_on = (
        np.ascontiguousarray(table[:, one]) for one in range(8)
    )
    ways = Ways(
        cost, time, energy, lift, station.astype(np.int64), time_on, energy_on, lift_on, table[:, 8:].astype(np.int64)
    )
    near = np.argsort(np.minimum(least, least.T)[:, 1:], axis=1, kind="stable") + 1
    picked = (
        getattr(visits, name)[nodes].astype(np.float64) for name in ("ready", "due", "service", "demand", "refusal")
    )
    return Tours(
        *picked, vehicles, float(charging.battery), float(charging.pace), float(charging.level), first, ways, cost, fastest, near, pads, depot
    ), nodes  # fmt: skip


def _ways(
    arcs: Arcs, visits: Visits, stations: NDArray[np.int64], tail: int, head: int, charging: Charging, most_load: float
) -> list[tuple[float, ...]]:
    """Ways of a pair by cost, none of them worse than another in all."""
    found: list[tuple[float, ...]] = []
    leave = visits.ready[tail] + visits.service[tail]
    parallel = range(len(arcs.cost))
    for one in parallel:
        cost, time, energy = arcs.cost[one, tail, head], arcs.time[one, tail, head], arcs.energy[one, tail, head]
        if cost < np.inf and energy <= charging.battery + SLACK and leave + time <= visits.due[head] + SLACK:
            found.append((cost, time, energy, arcs.lift[one, tail, head], -1, 0.0, 0.0, 0.0, one, 0))
    for number, station in enumerate(stations.tolist()):
        for one in parallel:
            for other in parallel:
                cost = arcs.cost[one, tail, station] + arcs.cost[other, station, head]
                time, on = arcs.time[one, tail, station], arcs.time[other, station, head]
                energy, energy_on = arcs.energy[one, tail, station], arcs.energy[other, station, head]
                fits = cost < np.inf and energy <= charging.battery + SLACK and energy_on <= charging.level + SLACK
                if fits and leave + time + on <= visits.due[head] + SLACK:
                    lift, lift_on = arcs.lift[one, tail, station], arcs.lift[other, station, head]
                    found.append((cost, time, energy, lift, number, on, energy_on, lift_on, one, other))
    found.sort()
    kept: list[tuple[float, ...]] = []
    for way in found:
        if not any(_covers(other, way, most_load) for other in kept):
            kept.append(way)
    return kept


def _covers(one: tuple[float, ...], other: tuple[float, ...], most_load: float) -> bool:
    """Whether a way that costs no more is as good as another wherever that can be used."""
    if (one[4] < 0) != (other[4] < 0):
        return False
    parts = ((2, 3), (6, 7))
    less = all(
        one[at] <= other[at] and one[at] + most_load * one[up] <= other[at] + most_load * other[up] for at, up in parts
    )
    return less and one[1] + one[5] <= other[1] + other[5]
