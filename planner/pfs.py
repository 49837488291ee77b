"""Probabilistic forward search: the paper's Algorithm 1, repaired.

At each station the reachable ones are ranked by expected flight, wait and recharge, and by the best that lies beyond
them; the best is flown to. Repaired: no station is visited twice, a dead end is left backwards, the charge is part of
the state, and where no station is in reach now the drone holds for wind that brings one into reach. A dead end is
remembered: whoever arrives there later finds it dead too, for leaving later never arrives earlier and every stop can
charge to full; whoever arrives earlier does so too, unless wind or charge closed a way beyond it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.forward_kernels import DEAD_END, FOUND, NEEDS_WAITS, Candidates, Frames, Marks, Start, search
from skyway.planner.itinerary import Hop
from skyway.planner.no_route import joined, no_route
from skyway.planner.outlook import Outlook

if TYPE_CHECKING:
    from skyway.planner.itinerary import Itinerary
    from skyway.planner.problem import Problem


def charging_time_per_flight_s(problem: Problem) -> float:
    """Seconds on a pad that a second of flight costs, at the constant rate of charging."""
    return problem.soc_per_s / problem.drone.charging_curve().rate_per_s


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
        factor = 1.0 + charging_time_per_flight_s(problem) if charge_aware else 1.0
        self.outlook = Outlook(problem, factor=factor)
        self.overfly = charge_aware

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
        start = Start(p.origin, float(p.depart_s), float(p.soc), p.in_flight)
        frames = _frames(len(p.network))
        rest = _candidates(len(p.network.tail)), _marks(len(p.network))
        while True:
            answer = search(self.outlook.world, start, frames, *rest)
            if answer == NEEDS_WAITS:
                self.outlook.forecast_missing()
            elif answer == FOUND:
                hops = _hops(frames)
                return _overflying(hops) if self.overfly else tuple(hops)
            elif answer != DEAD_END or not joined(p):  # where no segments lead there, do not find it out by trying
                raise no_route(p, self.outlook)


def _frames(nodes: int) -> Frames:
    count = nodes + 1
    return Frames(
        node=np.empty(count, dtype=np.int64),
        stage=np.empty(count, dtype=np.int64),
        arrive_s=np.empty(count),
        soc=np.empty(count),
        pad_s=np.empty(count),
        limited=np.zeros(count, dtype=np.bool_),
        segment=np.empty(count, dtype=np.int64),
        charge_to=np.empty(count),
        not_before_s=np.empty(count),
        depth=np.full(1, -1, dtype=np.int64),
    )


def _candidates(segments: int) -> Candidates:
    return Candidates(np.empty(segments, dtype=np.int64), *(np.empty(segments) for _ in range(5)))


def _marks(nodes: int) -> Marks:
    return Marks(
        on_path=np.zeros(nodes, dtype=np.bool_),
        dead_s=np.full(nodes, math.inf),
        closed=np.zeros(nodes, dtype=np.bool_),
        dead_ends=np.zeros(1, dtype=np.int64),
        seen=np.zeros(nodes, dtype=np.bool_),
        queue=np.empty(nodes, dtype=np.int64),
    )


def _hops(frames: Frames) -> list[Hop]:
    """Flights of the path found."""
    path = slice(1, int(frames.depth[0]) + 1)
    columns = (values[path].tolist() for values in (frames.segment, frames.charge_to, frames.not_before_s))
    return [Hop((segment,), None if math.isnan(to) else to, stay) for segment, to, stay in zip(*columns, strict=True)]


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
