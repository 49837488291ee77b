"""Probabilistic forward search: the paper's Algorithm 1, repaired.

At each station the reachable ones are ranked by expected flight, wait and recharge, and by the best that lies beyond
them; the best is flown to. Repaired: no station is visited twice, a dead end is left backwards, the charge is part of
the state, and where no station is in reach now the drone holds for wind that brings one into reach. A dead end is
remembered: whoever arrives there later finds it dead too, for leaving later never arrives earlier and every stop can
charge to full; whoever arrives earlier does so too, unless wind or charge closed a way beyond it.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from planner.itinerary import Hop
from planner.no_route import joined, no_route
from planner.outlook import Outlook

if TYPE_CHECKING:
    from collections.abc import Iterator

    from planner.itinerary import Itinerary
    from planner.outlook import Reachable
    from planner.problem import Problem


def charging_time_per_flight_s(problem: Problem) -> float:
    """Seconds on a pad that a second of flight costs, at the constant rate of charging."""
    return problem.soc_per_s / problem.drone.charging_curve().rate_per_s


@dataclass
class _Frame:
    """A station on the path searched: when the drone arrives, where it can go, and the hop that led here.

    `limited` tells that wind or charge closed a way at or beyond this station: only then can an earlier arrival fare
    better.
    """

    node: int
    arrive_s: float
    candidates: Iterator[Reachable]
    hop: Hop | None
    limited: bool = False


class ForwardSearch:
    """One search; `solve` returns what to fly.

    Parameters
    ----------
    problem : Problem
        What to solve.
    charge_aware : bool
        Judge the rest of the way by flight and charging time, not by flight time alone, and overfly stations at which
        there is nothing to do.
    """

    def __init__(self, problem: Problem, *, charge_aware: bool = False) -> None:
        self.problem = problem
        self.full = problem.request.recharge == "full"
        self.factor = 1.0 + charging_time_per_flight_s(problem) if charge_aware else 1.0
        self.outlook = Outlook(problem)
        self.overfly = charge_aware
        self._dead: dict[int, float] = {}
        self._on_path = {problem.origin}
        self._closed_ways: set[int] = set()

    @property
    def looked_at(self) -> int:
        """Flights evaluated."""
        return self.outlook.looked_at

    def solve(self) -> Itinerary:
        """Search depth first, best first.

        Raises
        ------
        NoRouteError
            Naming what binds.
        """
        p = self.problem
        frames = [_Frame(p.origin, p.depart_s, self._candidates(p.origin, p.depart_s, p.soc, -1), None)]
        while frames:
            frame = frames[-1]
            choice = next(frame.candidates, None)
            if choice is None:
                frames.pop()
                if not self._dead and not joined(p):
                    break  # no need to find out by trying
                self._on_path.discard(frame.node)
                limited = frame.limited or frame.node in self._closed_ways
                self._dead[frame.node] = frame.arrive_s if limited else -math.inf
                if frames:
                    frames[-1].limited |= limited
                continue
            arrive = choice.leave_s + choice.mean_s
            dead_s = self._dead.get(choice.node, math.inf)
            if choice.node in self._on_path or arrive >= dead_s:
                frame.limited |= math.isfinite(dead_s)
                continue
            hop = Hop((choice.segment,), choice.charge_to, choice.leave_s if choice.held else -math.inf)
            following = self._candidates(choice.node, arrive, max(choice.soc, 0.0), frame.node)
            frames.append(_Frame(choice.node, arrive, following, hop))
            self._on_path.add(choice.node)
            if choice.node == p.destination:
                hops = [frame.hop for frame in frames if frame.hop is not None]
                return _overflying(hops) if self.overfly else tuple(hops)
        raise no_route(p, self.outlook)

    def _candidates(self, node: int, time_s: float, soc: float, came_from: int) -> Iterator[Reachable]:
        """Stations to go on to, best first; those that need waiting for wind come last."""
        p, outlook = self.problem, self.outlook
        at_origin = came_from < 0
        pad = time_s + p.waits.at(node, time_s)[0] if p.has_pads(node) and not (at_origin and p.in_flight) else None
        found: list[tuple[float, Reachable]] = []
        if at_origin and self.full:
            found = outlook.reachable(node, time_s, soc, None, full=False, factor=self.factor)
        if not found:
            found = outlook.reachable(node, time_s, soc, pad, full=self.full, factor=self.factor)
        yield from self._best_first(found, time_s)
        if at_origin and p.in_flight:
            return
        seen = {one.node for _, one in found}
        closed = [s for s in outlook.segments(node) if int(p.network.head[s]) not in seen]
        if closed:
            self._closed_ways.add(node)
        held = outlook.held(closed, time_s, soc, pad, full=self.full, factor=self.factor)
        yield from self._best_first(held, time_s)

    def _best_first(self, found: list[tuple[float, Reachable]], time_s: float) -> Iterator[Reachable]:
        """Stations in the order of their ranks; a rank that is only a bound is made final when its turn comes."""
        heap = [(rank_s, number, one.ranked, one) for number, (rank_s, one) in enumerate(found)]
        heapq.heapify(heap)
        while heap:
            _, number, final, one = heapq.heappop(heap)
            if final:
                yield one
                continue
            if one.node in self._on_path:
                continue
            rank_s = self.outlook.ranked(one, time_s, full=self.full, factor=self.factor)
            heapq.heappush(heap, (rank_s, number, True, one))


def _overflying(hops: list[Hop]) -> Itinerary:
    """Join flights between which the drone would land only to leave: each landing saved saves time and charge."""
    joined_hops: list[Hop] = []
    for hop in hops:
        if joined_hops and hop.charge_to is None and math.isinf(hop.not_before_s):
            before = joined_hops[-1]
            joined_hops[-1] = Hop(before.segments + hop.segments, before.charge_to, before.not_before_s)
        else:
            joined_hops.append(hop)
    return tuple(joined_hops)
