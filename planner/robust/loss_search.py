"""Routes for an objective beside time: label setting over stops in the mean-value problem.

A label is a landing: station, time, charge, and the loss so far, a weighted sum of time, energy and cost. From it the
drone flies to any station in reach on the fastest way in the wind of that time, charged as by a `ChargePolicy`: enough for
the flight with its margin, or full. A label is dominated if another at the same station is no later, has no less charge and
no more loss; if prices change with the hour, one of the same hour; if stations close, one with the same of these visited, since
the mean-value problem has no probability that they are open on arrival. Routes come in the order of their loss.

Flights are in the wind of the slot in which they begin. That, and that an earlier drone could wait for another wind, is ignored:
the routes are only candidates, which are judged by simulation (`planner.robust.robust`).
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.planner.problem.mean_value import HOURS
from skyway.planner.problem.objective import J_PER_KWH
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.spending import charge_price

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.planner.problem.mean_value import ExpectedQueues
    from skyway.planner.problem.objective import Weights
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.speeds import Speeds
    from skyway.planner.schedule.itinerary import Itinerary

    Floats = NDArray[np.float64]

STEP_S = 1800.0
"""Interval of the winds that are evaluated, s."""


@dataclass(frozen=True, eq=False, slots=True)
class Landing:
    """A label."""

    node: int
    time_s: float
    soc: float
    loss: float
    stage: int
    """Number of required stops already visited."""
    before: Landing | None
    slot: int
    """Slot of the wind in which it was reached."""


class LossSearch:
    """One search.

    Parameters
    ----------
    problem : Problem
        The delivery.
    queues : ExpectedQueues
        Waits.
    speeds : Speeds
        Ground speeds.
    margin : float
        Margin of the charge for a flight, as a share of its energy.
    allowed : ndarray of bool, shape (nodes,)
        Where the drone may land on its way, if there are pads.
    weights : Weights
        Weights of the objective.
    most_labels : int
        Maximum number of labels.
    late_s : float
        Delay of the drone against closing times, s: a station that is reached shortly before it closes often is not.
    """

    def __init__(
        self,
        problem: Problem,
        queues: ExpectedQueues,
        speeds: Speeds,
        margin: float,
        allowed: NDArray[np.bool_],
        weights: Weights,
        *,
        most_labels: int,
        late_s: float = 0.0,
    ) -> None:
        self.problem, self.weights, self.speeds = problem, weights, speeds
        self.labels_expanded = 0
        """Labels continued so far."""
        self._queues, self._most_labels, self._late_s = queues, most_labels, late_s
        network = problem.network
        self._margin_soc_per_s = margin * problem.soc_per_s
        self._stops = (network.pads > 0) & allowed
        self._targets = np.flatnonzero(self._stops | (np.arange(len(network)) == problem.destination))
        self._until_s = problem.depart_s + HOURS * S_PER_H
        self._kwh = problem.drone.battery_j / J_PER_KWH
        self._flown: dict[tuple[int, int], tuple[Floats, NDArray[np.int32]]] = {}
        self._graphs: dict[int, Any] = {}
        barred = {int(node): problem.no_landing(int(node)) for node in self._targets}
        self._barred = {node: found for node, found in barred.items() if found is not None}
        tariff = problem.tariff
        self._by_hour = (tariff is not None and tariff.by_hour) or bool(problem.closures)
        drone = problem.drone
        wear_per_s = drone.wear_per_flight_h / S_PER_H + drone.wear_per_cycle * problem.soc_per_s
        self._rate = weights.per_h / S_PER_H + weights.per_kwh * self._kwh * problem.soc_per_s
        self._rate += weights.cost * (wear_per_s if tariff is not None else 0.0)
        self._least = self._least_left_s()

    def routes(self, count: int) -> Iterator[Itinerary]:
        """Yield at most this number of routes, in order of increasing loss."""
        p = self.problem
        begin = Landing(p.origin, p.depart_s, p.soc, 0.0, 0, None, 0)
        heap: list[tuple[float, int, Landing]] = [(0.0, 0, begin)]
        known: dict[tuple[int, int, int, frozenset[int]], list[Landing]] = {}
        found: set[tuple[tuple[int, ...], ...]] = set()
        pushed = 0
        while heap and self.labels_expanded < self._most_labels and len(found) < count:
            _, _, label = heapq.heappop(heap)
            if label.node == p.destination and label.before is not None:
                legs = self._legs(label)
                if legs not in found:
                    found.add(legs)
                    yield tuple(Leg(segments) for segments in legs)
                continue
            self.labels_expanded += 1
            for after in self._onward(label):
                hour = int(after.time_s // S_PER_H) if self._by_hour else 0
                key = after.node, after.stage, hour, self._passed(after)
                others = known.setdefault(key, [])
                if any(_covers(one, after) for one in others):
                    continue
                others[:] = [one for one in others if not _covers(after, one)]
                others.append(after)
                pushed += 1
                bound = after.loss + self._rate * float(self._least[after.node])
                heapq.heappush(heap, (bound, pushed, after))

    def _passed(self, label: Landing) -> frozenset[int]:
        """Stations with closing times among those visited: labels with different ones are not compared."""
        found = set()
        before = label.before
        while before is not None:
            if before.node in self.problem.closures:
                found.add(before.node)
            before = before.before
        return frozenset(found)

    def _onward(self, label: Landing) -> Iterator[Landing]:
        """Yield all possible next flights."""
        p, node = self.problem, label.node
        waits = p.in_flight and label.before is None
        full = p.request.recharge == "full" and label.before is not None
        if not full:
            yield from self._flights(label, label.time_s, None)
        if waits or not p.has_pads(node) or (label.before is not None and not self._stops[node]):
            return
        late_s = self._late_s if node in p.closures and label.before is not None else 0.0
        pad_s = float(self._queues.at([node], self._until_s)[0].pad_time(label.time_s + late_s))
        half = p.charge_time_s(node, label.soc, 0.5 * (label.soc + 1.0))
        if math.isfinite(pad_s):
            yield from self._flights(label, pad_s + half, pad_s)

    def _flights(self, label: Landing, wind_s: float, pad_s: float | None) -> Iterator[Landing]:
        """Yield flights in the wind of a time: without charging, or charged from a pad at `pad_s`."""
        p, node, weights = self.problem, label.node, self.weights
        slot = self._slot(wind_s)
        waits = p.in_flight and label.before is None
        cruise_s = self._times(slot, node)[0][self._targets]
        flight_s = cruise_s + p.air.climb_s + p.air.descent_s
        takes = p.soc_fixed + p.soc_per_s * flight_s
        need = p.reserve + takes + self._margin_soc_per_s * flight_s + self._escape_soc()
        stage = np.array([self._stage(label, int(target)) for target in self._targets])
        open_ = (
            np.isfinite(cruise_s)
            & ~np.isin(self._targets, _visited(label))
            & (stage >= 0)
            & np.isfinite(self._least[self._targets])
        )
        leave = np.full(len(need), label.time_s)
        level = np.full(len(need), label.soc)
        paid = np.zeros(len(need))
        if pad_s is None:
            open_ &= need <= label.soc
        else:
            curve_s, curve_soc = p.curve(node)
            if p.request.recharge == "full" and label.before is not None:
                need = np.maximum(need, curve_soc[-1])
            open_ &= (need > label.soc) & (need <= curve_soc[-1] + 1e-12)
            level = np.where(open_, need, label.soc)
            leave = pad_s + np.interp(level, curve_soc, curve_s) - np.interp(label.soc, curve_soc, curve_s)
            if node in p.closures:
                leave = p.closures[node].past(np.full(len(need), pad_s), leave)
            if p.tariff is not None and weights.cost and open_.any():
                socs = np.full(len(need), label.soc), level
                energy = charge_price(p, node, np.full(len(need), pad_s), leave, socs)
                paid = self._kwh * energy + float(p.tariff.pad_fee[node])
        for number in np.flatnonzero(open_).tolist():
            target, lands_s = int(self._targets[number]), float(leave[number] + flight_s[number])
            barred = self._barred.get(target)
            if barred is not None:
                if waits:
                    continue
                lands_s = float(barred.put_off(np.array(lands_s), np.array(lands_s)))
            soc = float(level[number] - takes[number])
            loss = label.loss + weights.per_h / S_PER_H * (lands_s - label.time_s)
            loss += weights.per_kwh * self._kwh * float(takes[number])
            if weights.cost:
                loss += weights.cost * (float(paid[number]) + self._wear(float(flight_s[number]), float(takes[number])))
                if target == p.destination and p.tariff is not None:
                    loss += weights.cost * p.tariff.refill_per_kwh * self._kwh * max(p.soc - soc, 0.0)
            if lands_s < self._until_s:
                yield Landing(target, lands_s, soc, loss, int(stage[number]), label, slot)

    def _wear(self, flight_s: float, soc: float) -> float:
        drone = self.problem.drone
        return drone.wear_per_flight_h * flight_s / S_PER_H + drone.wear_per_cycle * soc

    def _stage(self, label: Landing, target: int) -> int:
        """Number of required stops visited up to a landing at a station; -1 if it may not land there yet."""
        required = self.problem.must_stop
        if label.stage < len(required) and target == required[label.stage]:
            return label.stage + 1
        early = target == self.problem.destination and label.stage < len(required)
        return -1 if early or target in required else label.stage

    def _escape_soc(self) -> Floats:
        """Charge for the way on from the destination, where it has no pads, for each target; 0 elsewhere."""
        p = self.problem
        extra = np.zeros(len(self._targets))
        if p.needs_escape and len(p.escapes):
            per_s, fixed = p.empty_cost
            mps = self.speeds.over(0, 0, p.escapes)[0]
            cruise = np.divide(p.air.distance_m[p.escapes], mps, out=np.full(len(mps), math.inf), where=mps > 0.0)
            away_s = float(cruise.min()) + p.air.climb_s + p.air.descent_s
            extra[self._targets == p.destination] = fixed + (per_s + self._margin_soc_per_s) * away_s
        return extra

    def _slot(self, time_s: float) -> int:
        air = self.problem.air
        held = max(STEP_S, air.slot_s)
        since = max(math.floor((time_s - air.start_s) / held), 0) * held
        return min(int(since / air.slot_s + 1e-6), self.speeds.slots - 1)

    def _graph(self, slot: int) -> Any:
        from scipy.sparse import csr_array

        if slot not in self._graphs:
            network, air = self.problem.network, self.problem.air
            mps = self.speeds.over(slot, slot, np.arange(len(network.head)))[0]
            flown = np.flatnonzero(mps > 0.0)
            shape = len(network), len(network)
            values = air.distance_m[flown] / mps[flown]
            self._graphs[slot] = csr_array((values, (network.tail[flown], network.head[flown])), shape=shape)
        return self._graphs[slot]

    def _times(self, slot: int, node: int) -> tuple[Floats, NDArray[np.int32]]:
        """Time over the segments from a station to each, s, and the station before each."""
        from scipy.sparse.csgraph import dijkstra

        if (slot, node) not in self._flown:
            limit = max(self.problem.longest_flight_s, 0.0)
            search: Any = dijkstra
            self._flown[slot, node] = search(self._graph(slot), indices=node, limit=limit, return_predecessors=True)
        return self._flown[slot, node]

    def _least_left_s(self) -> Floats:
        """Least time over the segments from each station to the destination, in the best wind of any time."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        network, air = self.problem.network, self.problem.air
        first, last = self._slot(self.problem.depart_s), self._slot(self._until_s)
        mps = self.speeds.over(first, last, np.arange(len(network.head))).max(axis=0)
        flown = np.flatnonzero(mps > 0.0)
        values = air.distance_m[flown] / mps[flown]
        shape = len(network), len(network)
        back = csr_array((values, (network.head[flown], network.tail[flown])), shape=shape)
        search: Any = dijkstra
        return np.asarray(search(back, indices=self.problem.destination))

    def _legs(self, label: Landing) -> tuple[tuple[int, ...], ...]:
        """Segments of each flight up to a label."""
        network = self.problem.network
        legs: list[tuple[int, ...]] = []
        while label.before is not None:
            _, before = self._times(label.slot, label.before.node)
            segments: list[int] = []
            node = label.node
            while node != label.before.node:
                tail = int(before[node])
                low, high = network.first[tail], network.first[tail + 1]
                segments.append(int(low + np.flatnonzero(network.head[low:high] == node)[0]))
                node = tail
            legs.append(tuple(reversed(segments)))
            label = label.before
        return tuple(reversed(legs))


def _visited(label: Landing) -> list[int]:
    """Stations landed at, and the origin: no route lands at one twice."""
    found = [label.node]
    while label.before is not None:
        label = label.before
        found.append(label.node)
    return found


def _covers(one: Landing, other: Landing) -> bool:
    """Whether a label is at least as good as another in everything."""
    return one.time_s <= other.time_s + 1e-6 and one.soc >= other.soc - 1e-9 and one.loss <= other.loss + 1e-12
