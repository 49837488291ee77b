"""Proved optima of small instances of the first set, by code that shares none with the solver.

*All tours*: every set of customers that one vehicle can serve is found with its shortest tour, by labels over (set served, place) in plain Python; HiGHS then proves
the best choice of them. *All arcs*: a mixed integer program over arcs, windows and energies, after Schneider, Stenger and Goeke (Transportation Science 48, 2014) with the partial recharging of
Keskin and Catay (Transportation Research C 65, 2016); exact as far as no station is visited more often than it has copies. It is the slower one, and judges the first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

if TYPE_CHECKING:
    from benchmarks.fleet.evrp.evrptw import Instance

VEHICLE = 1e4
"""A vehicle counts more than any distance."""
TINY = 1e-9


class Proof(NamedTuple):
    """Fewest vehicles, and the least distance with so many."""

    vehicles: int
    distance: float


class Stand(NamedTuple):
    """How a vehicle can stand at a place: with the energy `low` from `time` on, and more with each unit of time, up to `high`."""

    distance: float
    time: float
    low: float
    high: float


def by_tours(instance: Instance) -> Proof:
    """Prove the optimum from all tours."""
    tours = _all_tours(instance)
    customers = [number for number, kind in enumerate(instance.kind) if kind == "c"]
    served = np.array([[float(mask >> place & 1) for mask in tours] for place in range(len(customers))])
    cost = np.array(list(tours.values())) + VEHICLE
    found = milp(
        cost, constraints=LinearConstraint(csr_array(served), 1.0, 1.0), integrality=np.ones(len(cost)), bounds=Bounds(0, 1),
        options={"mip_rel_gap": 0.0},
    )  # fmt: skip
    if found.status != 0:
        raise RuntimeError(f"{instance.name}: {found.message}")
    picked = found.x > 0.5
    return Proof(int(picked.sum()), float((cost[picked] - VEHICLE).sum()))


def _all_tours(instance: Instance) -> dict[int, float]:
    """Length of the shortest tour of each set of customers that one vehicle can serve; sets are bits."""
    customers = [number for number, kind in enumerate(instance.kind) if kind == "c"]
    stations = [number for number, kind in enumerate(instance.kind) if kind == "f"]
    bit = {place: 1 << number for number, place in enumerate(customers)}
    shortest: dict[int, float] = {}
    front: dict[tuple[int, int], list[Stand]] = {(0, 0): [Stand(0.0, 0.0, instance.battery, instance.battery)]}
    waiting = [(0, 0, front[0, 0][0])]
    while waiting:
        mask, place, stand = waiting.pop()
        if stand not in front[mask, place]:
            continue  # another one covers it by now
        back = _arrive(instance, place, 0, stand)
        if back is not None and mask:
            shortest[mask] = min(shortest.get(mask, np.inf), back.distance)
        load = sum(instance.demand[one] for one in customers if mask & bit[one])
        for head in (*customers, *stations):
            if (
                head == place
                or mask & bit.get(head, 0)
                or (head in bit and load + instance.demand[head] > instance.capacity + TINY)
            ):
                continue
            found = _arrive(instance, place, head, stand)
            if found is None:
                continue
            if head in stations:
                found = found._replace(high=instance.battery)
            else:
                found = found._replace(time=found.time + float(instance.service[head]))
            key = mask | bit.get(head, 0), head
            kept = front.setdefault(key, [])
            if any(_covers(instance, one, found) for one in kept):
                continue
            kept[:] = [one for one in kept if not _covers(instance, found, one)]
            kept.append(found)
            waiting.append((*key, found))
    return shortest


def _arrive(instance: Instance, tail: int, head: int, stand: Stand) -> Stand | None:
    """How it can stand at the next place when service begins; None: it cannot be there in time, or not at all."""
    gap = float(np.hypot(*(instance.place[head] - instance.place[tail])))
    g, taken = instance.refuelling, gap * instance.consumption
    if stand.high - taken < -TINY:
        return None
    more = max(taken - stand.low, 0.0)  # must have been charged before
    time, low, high = (
        stand.time + g * more + gap / instance.velocity,
        stand.low + more - taken,
        max(stand.high - taken, 0.0),
    )
    if time > instance.due[head] + TINY:
        return None
    early = max(float(instance.ready[head]) - time, 0.0)
    low, time = min(low + early / g, high), time + early
    return Stand(stand.distance + gap, time, low, min(high, low + max(float(instance.due[head]) - time, 0.0) / g))


def _covers(instance: Instance, one: Stand, other: Stand) -> bool:
    """Whether one is as good in all."""
    if one.distance > other.distance + TINY or one.time > other.time + TINY or one.high < other.high - TINY:
        return False
    return min(one.high, one.low + (other.time - one.time) / instance.refuelling) >= other.low - TINY


def by_arcs(instance: Instance, *, copies: int = 2, time_limit_s: float = 60.0) -> Proof | None:
    """Prove the optimum by a program over arcs; None where that takes longer."""
    stations = [number for number, kind in enumerate(instance.kind) if kind == "f"]
    customers = [number for number, kind in enumerate(instance.kind) if kind == "c"]
    places = [
        0,
        *customers,
        *(station for station in stations for _ in range(copies)),
        0,
    ]  # the depot twice: departure and return
    count = len(places)
    gap = np.hypot(*(instance.place[places][:, None] - instance.place[places][None]).transpose(2, 0, 1))
    arcs = [
        (i, j)
        for i in range(count - 1)
        for j in range(1, count)
        if i != j
        and not (i == 0 and j == count - 1)
        and gap[i, j] * instance.consumption <= instance.battery + TINY
        and instance.ready[places[i]] + instance.service[places[i]] + gap[i, j] / instance.velocity
        <= instance.due[places[j]] + TINY
    ]
    first = {name: len(arcs) + number * count for number, name in enumerate(("time", "arrives", "leaves", "load"))}
    size = len(arcs) + 4 * count
    rows: list[tuple[dict[int, float], float, float]] = []
    for node in range(1, count - 1):
        entering = {number: 1.0 for number, (_, j) in enumerate(arcs) if j == node}
        leaving = {number: -1.0 for number, (i, _) in enumerate(arcs) if i == node}
        rows += [({**entering, **leaving}, 0.0, 0.0), (entering, 1.0 if node <= len(customers) else 0.0, 1.0)]
    horizon, battery, g = float(instance.due[0]), instance.battery, instance.refuelling
    big = horizon + g * battery
    for number, (i, j) in enumerate(arcs):
        time, at, left, load = (first[name] for name in ("time", "arrives", "leaves", "load"))
        way, used = gap[i, j] / instance.velocity, gap[i, j] * instance.consumption
        charged = {left + i: g, at + i: -g} if len(customers) < i < count - 1 else {}
        rows.append(
            ({time + i: 1.0, **charged, time + j: -1.0, number: big}, -np.inf, big - instance.service[places[i]] - way)
        )
        rows.append(({left + i: -1.0, at + j: 1.0, number: battery}, -np.inf, battery - used))
        if instance.demand[places[j]] > 0.0 or j == count - 1:
            rows.append(
                (
                    {load + j: 1.0, load + i: -1.0, number: instance.capacity},
                    -np.inf,
                    instance.capacity - instance.demand[places[i]],
                )
            )
        else:
            rows.append(
                (
                    {load + j: 1.0, load + i: -1.0, number: instance.capacity},
                    -np.inf,
                    instance.capacity - instance.demand[places[i]],
                )
            )
    for node in range(count):
        if node <= len(customers):  # no charge at customers; full at the departure
            rows.append(({first["leaves"] + node: 1.0, first["arrives"] + node: -1.0}, 0.0, 0.0))
        else:
            rows.append(({first["leaves"] + node: 1.0, first["arrives"] + node: -1.0}, 0.0, np.inf))
    low, high = np.zeros(size), np.ones(size)
    for node, place in enumerate(places):
        low[first["time"] + node], high[first["time"] + node] = instance.ready[place], instance.due[place]
        high[first["arrives"] + node] = high[first["leaves"] + node] = battery
        low[first["load"] + node], high[first["load"] + node] = instance.demand[place], instance.capacity
    cost = np.zeros(size)
    for number, (i, j) in enumerate(arcs):
        cost[number] = gap[i, j] + (VEHICLE if i == 0 else 0.0)
    entries = [(row, column, value) for row, (terms, _, _) in enumerate(rows) for column, value in terms.items()]
    r, c, v = (np.array(column) for column in zip(*entries, strict=True))
    matrix = csr_array((v, (r, c)), shape=(len(rows), size))
    found = milp(
        cost, constraints=LinearConstraint(matrix, [row[1] for row in rows], [row[2] for row in rows]),
        integrality=np.arange(size) < len(arcs), bounds=Bounds(low, high), options={"time_limit": time_limit_s, "mip_rel_gap": 1e-7},
    )  # fmt: skip
    if found.status != 0:
        return None
    used = [arc for number, arc in enumerate(arcs) if found.x[number] > 0.5]
    return Proof(sum(i == 0 for i, _ in used), float(sum(gap[arc] for arc in used)))
