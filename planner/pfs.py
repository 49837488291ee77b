"""Probabilistic forward search: the paper's Algorithm 1, repaired.

At each station the reachable ones are ranked by expected flight, wait and recharge, and by the best that lies beyond
them; the best is flown to. Repaired: no station is visited twice, a dead end is left backwards, the charge is part of
the state, and where no station is in reach now the drone holds for wind that brings one into reach. A dead end is
remembered with its time: whoever arrives there later finds it dead too, for leaving later never arrives earlier and
every stop can charge to full.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from planner.itinerary import Hop
from planner.no_route import no_route
from planner.outlook import Outlook

if TYPE_CHECKING:
    from collections.abc import Iterator

    from planner.itinerary import Itinerary
    from planner.outlook import Reachable
    from planner.problem import Problem


def charging_time_per_flight_s(problem: Problem) -> float:
    """Seconds on a pad that a second of flight costs, at the constant rate of charging."""
    return problem.soc_per_s / problem.drone.charging_curve().rate_per_s


@dataclass(frozen=True)
class _Frame:
    """A station on the path searched: when the drone arrives, where it can go, and the hop that led here."""

    node: int
    arrive_s: float
    candidates: Iterator[Reachable]
    hop: Hop | None


class ForwardSearch:
    """One search; `solve` returns what to fly.

    Parameters
    ----------
    problem : Problem
        What to solve.
    charge_aware : bool
        Judge the rest of the way by flight and charging time, not by flight time alone.
    """

    def __init__(self, problem: Problem, *, charge_aware: bool = False) -> None:
        self.problem = problem
        self.full = problem.request.recharge == "full"
        self.factor = 1.0 + charging_time_per_flight_s(problem) if charge_aware else 1.0
        self.outlook = Outlook(problem)
        self._dead: dict[int, float] = {}
        self._soc: dict[int, float] = {}

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
                self._dead[frame.node] = min(self._dead.get(frame.node, math.inf), frame.arrive_s)
                frames.pop()
                continue
            arrive = choice.leave_s + choice.mean_s
            visited = any(choice.node == earlier.node for earlier in frames)
            if visited or arrive >= self._dead.get(choice.node, math.inf):
                continue
            hop = Hop((choice.segment,), choice.charge_to, choice.leave_s if choice.held else -math.inf)
            following = self._candidates(choice.node, arrive, self._soc_on_arrival(frame, choice), frame.node)
            frames.append(_Frame(choice.node, arrive, following, hop))
            if choice.node == p.destination:
                return tuple(frame.hop for frame in frames if frame.hop is not None)
        raise no_route(p, self.outlook)

    def _candidates(self, node: int, time_s: float, soc: float, came_from: int) -> Iterator[Reachable]:
        """Stations to go on to, best first; those that need waiting for wind come last."""
        p, outlook = self.problem, self.outlook
        at_origin = came_from < 0
        pad = time_s + p.waits.at(node, time_s)[0] if p.has_pads(node) and not (at_origin and p.in_flight) else None
        self._soc[node] = soc
        found: list[tuple[float, Reachable]] = []
        if at_origin and self.full:
            found = outlook.reachable(node, came_from, time_s, soc, None, full=False, factor=self.factor)
        if not found:
            found = outlook.reachable(node, came_from, time_s, soc, pad, full=self.full, factor=self.factor)
        yield from _best_first(found)
        if at_origin and p.in_flight:
            return
        seen = {one.node for _, one in found}
        held = outlook.held(node, came_from, time_s, soc, pad, full=self.full, factor=self.factor)
        yield from _best_first([pair for pair in held if pair[1].node not in seen])

    def _soc_on_arrival(self, frame: _Frame, choice: Reachable) -> float:
        """Charge that is there on landing in all but a share epsilon of the members: the next flight must not hope for more."""
        leaving = self._soc[frame.node] if choice.charge_to is None else choice.charge_to
        return max(leaving - choice.charge, 0.0)


def _best_first(found: list[tuple[float, Reachable]]) -> list[Reachable]:
    return [one for _, one in sorted(found, key=lambda pair: pair[0])]
