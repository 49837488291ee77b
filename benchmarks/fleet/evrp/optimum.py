"""Proved optima of small instances of the first set, by code that shares none with the solver.

Every set of customers that one vehicle can serve is found with its shortest tour, by label setting over (set served, place) in plain Python, with any number
of stations between customers. HiGHS then proves the best selection of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

if TYPE_CHECKING:
    from benchmarks.fleet.evrp.evrptw import Instance

VEHICLE = 1e4
"""Cost of a vehicle, above any distance."""
TINY = 1e-9


class Proof(NamedTuple):
    """Least number of vehicles, and the least distance with that number."""

    vehicles: int
    distance: float


class Stand(NamedTuple):
    """State of a vehicle at a place: energy `low` at `time`, and more with each unit of time, up to `high`."""

    distance: float
    time: float
    low: float
    high: float


def prove(instance: Instance) -> Proof:
    """Prove the optimum from all tours."""
    tours = shortest_tours(instance)
    customers = [number for number, kind in enumerate(instance.kind) if kind == "c"]
    served = np.array([[float(mask >> place & 1) for mask in tours] for place in range(len(customers))])
    cost = np.array(list(tours.values())) + VEHICLE
    found = milp(
        cost, constraints=LinearConstraint(csr_array(served), 1.0, 1.0), integrality=np.ones(len(cost), dtype=np.int64), bounds=Bounds(0, 1),
        options={"mip_rel_gap": 0.0},
    )  # fmt: skip
    if found.status != 0:
        raise RuntimeError(f"{instance.name}: {found.message}")
    picked = found.x > 0.5
    return Proof(int(picked.sum()), float((cost[picked] - VEHICLE).sum()))


def shortest_tours(instance: Instance) -> dict[int, float]:
    """Length of the shortest tour of each set of customers that one vehicle can serve; sets are bit masks."""
    customers = [number for number, kind in enumerate(instance.kind) if kind == "c"]
    stations = [number for number, kind in enumerate(instance.kind) if kind == "f"]
    bit = {place: 1 << number for number, place in enumerate(customers)}
    shortest: dict[int, float] = {}
    front: dict[tuple[int, int], list[Stand]] = {(0, 0): [Stand(0.0, 0.0, instance.battery, instance.battery)]}
    waiting = [(0, 0, front[0, 0][0])]
    while waiting:
        mask, place, stand = waiting.pop()
        if stand not in front[mask, place]:
            continue  # dominated meanwhile
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
    """State at the next place when service begins; None if it cannot be reached in time, or at all."""
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
    """Whether one state dominates another."""
    if one.distance > other.distance + TINY or one.time > other.time + TINY or one.high < other.high - TINY:
        return False
    return min(one.high, one.low + (other.time - one.time) / instance.refuelling) >= other.low - TINY
