"""Shortest expected flight time (Dijkstra), with a full recharge at each stop."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING

from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.no_route import no_route

if TYPE_CHECKING:
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


class ShortestFlight:
    """Dijkstra on the expected flight times at the departure; a segment counts if a full battery flies it with the reserve."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.lookahead = Lookahead(problem, full=True)

    @property
    def labels_expanded(self) -> int:
        """Flights evaluated."""
        return self.lookahead.labels_expanded

    def solve(self) -> Itinerary:
        """Find the route, then charge to full at each stop and hold if the wind requires it.

        A `NoRouteError` names the binding constraint.
        """
        path = self._route()
        if path is None:
            raise no_route(self.problem, self.lookahead)
        return self._schedule(path)

    def _route(self) -> list[int] | None:
        """Segments of the shortest route, or None."""
        p, network = self.problem, self.problem.network
        best: dict[int, float] = {p.origin: 0.0}
        by: dict[int, int] = {}
        heap = [(0.0, p.origin)]
        while heap:
            time, node = heapq.heappop(heap)
            if time > best[node]:
                continue
            if node == p.destination:
                return self._trace(by)
            if node != p.origin and not p.has_pads(node):
                continue
            may_charge = p.has_pads(node) and not (node == p.origin and p.in_flight)
            budget = self.lookahead.budget if may_charge else p.soc - p.reserve
            for segment in range(int(network.first[node]), int(network.first[node + 1])):
                mean, charge, _ = self.lookahead.flight(segment, p.depart_s)
                other = int(network.head[segment])
                if charge <= budget and time + mean < best.get(other, math.inf):
                    best[other] = time + mean
                    by[other] = segment
                    heapq.heappush(heap, (time + mean, other))
        return None

    def _trace(self, by: dict[int, int]) -> list[int]:
        path: list[int] = []
        node = self.problem.destination
        while node != self.problem.origin:
            path.append(by[node])
            node = int(self.problem.network.tail[by[node]])
        return path[::-1]

    def _schedule(self, path: list[int]) -> Itinerary:
        p = self.problem
        now, soc = p.depart_s, p.soc
        legs: list[Leg] = []
        for number, segment in enumerate(path):
            node = int(p.network.tail[segment])
            pad = now + p.waits.at(node, now)[0] if p.has_pads(node) and not (number == 0 and p.in_flight) else None
            flight = self.lookahead.earliest(segment, now, soc, pad if number > 0 else None)
            waits = not math.isfinite(flight.leave_s)
            if waits:
                flight = self.lookahead.held(segment, now, soc, pad)
            if not math.isfinite(flight.leave_s):
                raise no_route(p, self.lookahead)
            charge_to = None if math.isnan(flight.charge_to) else flight.charge_to
            legs.append(Leg((segment,), charge_to, flight.leave_s if waits else -math.inf))
            now = flight.leave_s + flight.mean_s
            soc = max(flight.soc, 0.0)
        return tuple(legs)
