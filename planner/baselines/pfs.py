"""Probabilistic forward search: the paper's Algorithm 1, with its defects corrected.

At each station the reachable ones are ranked by expected flight, wait and recharge, and by the best continuation
from them; the drone flies to the best. Corrected: no station is visited twice, the search backtracks from a dead end, the charge is part of
the state, and if no station is in reach now the drone holds for wind that brings one into reach. A dead end is
remembered: a later arrival there is dead too, since leaving later never arrives earlier and every stop can
charge to full; an earlier arrival is dead too, unless wind or charge closed a way beyond it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.baselines.pfs_kernels import DEAD_END, FOUND, NEEDS_WAITS, Candidates, Frames, Marks, Start, search
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.no_route import joined, no_route

if TYPE_CHECKING:
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


def charging_time_per_flight_s(problem: Problem) -> float:
    """Seconds on a pad per second of flight, at the constant rate of charging."""
    return problem.soc_per_s / problem.drone.charging_curve().rate_per_s


class ForwardSearch:
    """One search; `solve` returns the flights.

    A `charge_aware` search judges the remaining way by flight and charging time, not by flight time alone, and overflies
    stations at which no action is needed.
    """

    def __init__(self, problem: Problem, *, charge_aware: bool = False) -> None:
        self.problem = problem
        factor = 1.0 + charging_time_per_flight_s(problem) if charge_aware else 1.0
        self.lookahead = Lookahead(problem, factor=factor)
        self.overfly = charge_aware

    @property
    def labels_expanded(self) -> int:
        """Flights evaluated."""
        return self.lookahead.labels_expanded

    def solve(self) -> Itinerary:
        """Search depth first, best first; a `NoRouteError` names the binding constraint."""
        p = self.problem
        start = Start(p.origin, float(p.depart_s), float(p.soc), p.in_flight)
        frames = _frames(len(p.network))
        rest = _candidates(len(p.network.tail)), _marks(len(p.network))
        while True:
            answer = search(self.lookahead.world, start, frames, *rest)
            if answer == NEEDS_WAITS:
                self.lookahead.forecast_missing()
            elif answer == FOUND:
                legs = _legs(frames)
                return _overflying(legs) if self.overfly else tuple(legs)
            elif answer != DEAD_END or not joined(p):  # without segments to it, do not search in vain
                raise no_route(p, self.lookahead)


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


def _legs(frames: Frames) -> list[Leg]:
    """Flights of the path found."""
    path = slice(1, int(frames.depth[0]) + 1)
    columns = (values[path].tolist() for values in (frames.segment, frames.charge_to, frames.not_before_s))
    return [
        Leg((segment,), None if math.isnan(to) else to, stop_label)
        for segment, to, stop_label in zip(*columns, strict=True)
    ]


def _overflying(legs: list[Leg]) -> Itinerary:
    """Join flights between which the drone would land only to take off again: each landing avoided saves time and charge."""
    joined_legs: list[Leg] = []
    for leg in legs:
        if joined_legs and leg.charge_to is None and math.isinf(leg.not_before_s):
            before = joined_legs[-1]
            joined_legs[-1] = Leg(before.segments + leg.segments, before.charge_to, before.not_before_s)
        else:
            joined_legs.append(leg)
    return tuple(joined_legs)


class ChargeAwareSearch(ForwardSearch):
    """`ForwardSearch` that judges the remaining way by flight and charging time, and overflies idle stops."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem, charge_aware=True)
