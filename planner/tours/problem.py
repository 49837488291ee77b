"""A problem of tours as arrays: customers, and the ways between each two of them, with or without a charge."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.planner.calendar_kernels import Calendar
from skyway.planner.tours.way_kernels import ARC, COST, ENERGY, LIFT, SLACK, STATION, TABLE, TIME, ways_of

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Ways(NamedTuple):
    """Ways between pairs of nodes, those of each pair consecutive, in the order of cost.

    A way is one arc, or up to three with a charge at the station between each two of them. No way of a pair dominates another.
    """

    cost: NDArray[np.float64]
    """Shape (ways,)."""
    time: NDArray[np.float64]
    energy: NDArray[np.float64]
    lift: NDArray[np.float64]
    """Shape (ways, 3) each, by arc; `lift` is the energy for each unit of load on board."""
    station: NDArray[np.int64]
    """Shape (ways, 2): numbers of stations; -1: none."""
    arc: NDArray[np.int64]
    """Shape (ways, 3): number of the parallel arc."""


class Vehicles(NamedTuple):
    """Vehicles, shape (vehicles,) each; they begin and end at the depot."""

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    energy: NDArray[np.float64]
    """Energy at the beginning."""
    capacity: NDArray[np.float64]
    kind: NDArray[np.int64]
    """Identical vehicles have the same number, and are consecutive."""


class Pads(NamedTuple):
    """Chargers of the stations; without a station they are unlimited."""

    first: NDArray[np.int64]
    number: NDArray[np.int64]
    """Shape (stations,) each: number of the first one, and their number."""
    taken: Calendar
    """Windows booked by others."""


class Depot(NamedTuple):
    """Chargers at the depot that fill empty vehicles before their tours, one at a time each, without a break; 0 chargers: unlimited."""

    chargers: int
    periods: NDArray[np.int64]
    """Shape (energies,): periods of charging for each energy."""
    period: float
    """Length of a period; the first begins at time 0."""


class Tours(NamedTuple):
    """Nodes are the depot, 0, and customers; shape (nodes,) each unless stated."""

    ready: NDArray[np.float64]
    due: NDArray[np.float64]
    """Earliest and latest beginning of service; for the depot: earliest departure and latest return of a vehicle."""
    service: NDArray[np.float64]
    demand: NDArray[np.float64]
    refusal: NDArray[np.float64]
    """Cost of not serving it."""
    release: NDArray[np.float64]
    """Time at which its load is at the depot: no tour that serves it leaves before."""
    vehicles: Vehicles
    battery: float
    pace: float
    """Energy of a full battery, and time to charge one unit of it."""
    level: float
    """Energy up to which stations charge."""
    first: NDArray[np.int64]
    """Shape (nodes, nodes + 1): number of the first way of a pair; the next element has the end."""
    ways: Ways
    guide: NDArray[np.float64]
    """Shape (ways,): cost by which ways are chosen, `Ways.cost` or above; with limited chargers at the depot the
    search adds a price on energy."""
    fastest: NDArray[np.float64]
    """Shape (nodes, nodes): least time of any way of a pair, infinite where there is none."""
    near: NDArray[np.int64]
    """Shape (nodes, customers): customers by the cost of the way from and to each node."""
    pads: Pads
    depot: Depot


class Arcs(NamedTuple):
    """Arcs between all places, shape (parallel, places, places) each; an infinite cost: there is none."""

    cost: NDArray[np.float64]
    time: NDArray[np.float64]
    energy: NDArray[np.float64]
    lift: NDArray[np.float64]
    """Energy for each unit of load on board."""


class Visits(NamedTuple):
    """Demand of places, shape (places,) each; place 0 is the depot."""

    ready: NDArray[np.float64]
    due: NDArray[np.float64]
    service: NDArray[np.float64]
    demand: NDArray[np.float64]
    refusal: NDArray[np.float64]
    release: NDArray[np.float64]


class Charging(NamedTuple):
    """Charging of all stations: time for a unit of energy, the energy up to which they charge, and the capacity."""

    pace: float
    level: float
    battery: float


NO_PADS = Pads(
    np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64),
    Calendar(np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64)),
)  # fmt: skip
NO_DEPOT = Depot(0, np.empty(0, dtype=np.int64), 1.0)


def alike(count: int, begin: float, end: float, energy: float, capacity: float) -> Vehicles:
    """Return a number of identical vehicles."""
    begins, ends, energies, capacities = (
        np.full(count, value, dtype=np.float64) for value in (begin, end, energy, capacity)
    )
    return Vehicles(begins, ends, energies, capacities, np.zeros(count, dtype=np.int64))


def lay_out(
    arcs: Arcs, visits: Visits, stations: NDArray[np.int64], vehicles: Vehicles, charging: Charging, pads: Pads = NO_PADS, depot: Depot = NO_DEPOT,
    alike: NDArray[np.int64] | None = None,
) -> tuple[Tours, NDArray[np.int64]]:  # fmt: skip
    """Return the problem, and the place of each of its nodes.

    Parameters
    ----------
    arcs, visits : Arcs, Visits
        Arcs between the places, and demand of the places.
    stations : array, shape (stations,)
        Places of stations; all others are the depot or customers. `Ways.station` has their index in it.
    vehicles : Vehicles
        The fleet.
    charging : Charging
        Charging at the stations.
    pads, depot : Pads, Depot
        Limited chargers.
    alike : array, shape (places,), optional
        Number of each place; those with the same arcs have the same number, so that their ways are found once.
    """
    places = len(visits.ready)
    known: dict[tuple[int, int], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    nodes = np.setdiff1d(np.arange(places), stations)
    rows: list[NDArray[np.float64]] = [np.empty((0, TABLE))]
    first = np.zeros((len(nodes), len(nodes) + 1), dtype=np.int64)
    least = np.full((len(nodes), len(nodes)), np.inf)
    fastest = least.copy()
    most, count = float(vehicles.capacity.max()), 0
    for tail in range(len(nodes)):
        for head in range(len(nodes)):
            first[tail, head] = count
            i, j = int(nodes[tail]), int(nodes[head])
            spare = float(visits.due[j] - visits.ready[i] - visits.service[i])
            if tail == head or spare < 0.0:
                continue
            pair = (i, j) if alike is None else (int(alike[i]), int(alike[j]))
            if pair not in known:
                longest = spare if alike is None else np.inf
                found = ways_of(arcs, stations, i, j, longest, float(charging.battery), float(charging.level), most)
                known[pair] = found, found[:, TIME : TIME + 3].sum(axis=1)
            found, time = known[pair]
            if len(time) and time.max() > spare + SLACK:
                found = found[time <= spare + SLACK]
            if len(found):
                least[tail, head] = found[0, COST]
                fastest[tail, head] = found[:, TIME : TIME + 3].sum(axis=1).min()
                rows.append(found)
                count += len(found)
        first[tail, -1] = count
    ways = _ways(np.concatenate(rows))
    near = np.argsort(np.minimum(least, least.T)[:, 1:], axis=1, kind="stable") + 1
    ready, due, service, demand, refusal, release = (part[nodes].astype(np.float64) for part in visits)
    tours = Tours(
        ready, due, service, demand, refusal, release, vehicles, float(charging.battery), float(charging.pace), float(charging.level), first,
        ways, ways.cost, fastest, near, pads, depot,
    )  # fmt: skip
    return tours, nodes


def _ways(table: NDArray[np.float64]) -> Ways:
    time, energy, lift = (np.ascontiguousarray(table[:, begin : begin + 3]) for begin in (TIME, ENERGY, LIFT))
    station, arc = (
        np.ascontiguousarray(table[:, begin:end].astype(np.int64))
        for begin, end in ((STATION, STATION + 2), (ARC, ARC + 3))
    )
    return Ways(np.ascontiguousarray(table[:, COST]), time, energy, lift, station, arc)
