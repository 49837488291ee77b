"""What the forecast says of the next flight and of what lies beyond it: reachability and look-ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.flight_kernels import slot_end, slot_of
from planner.outlook_kernels import Graph, Need, Speeds, flight_outlook, options, rank

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.flight import Air
    from planner.problem import Problem

MAX_KEPT_SPEEDS = 400_000_000
"""Ground speeds kept for reuse; beyond this (networks of more than some 10,000 stations) they are worked out anew."""
MAX_FLIGHTS_AHEAD_H = 24
"""How long a drone is held on the ground for wind that brings a station into reach."""


@dataclass(frozen=True, slots=True)
class Reachable:
    """A station one segment away.

    Attributes
    ----------
    segment, node : int
        How, and which.
    leave_s : float
        Earliest take-off that keeps the reserve.
    charge : float
        SoC that the flight takes in all but a share epsilon of the members.
    mean_s : float
        Expected time from `leave_s` to touch-down.
    soc : float
        SoC on landing in all but a share epsilon of the members.
    charge_to : float or None
        SoC to charge to before; None where the drone leaves as it is.
    ranked : bool
        Its rank is final, not a lower bound.
    held : bool
        The drone stays, charged, until `leave_s`, because the wind is better then.
    """

    segment: int
    node: int
    leave_s: float
    charge: float
    mean_s: float
    soc: float
    charge_to: float | None
    ranked: bool = True
    held: bool = False


class Outlook:
    """Answers about flights from a station at a time, over the forecast of a problem.

    Attributes
    ----------
    looked_at : int
        Flights evaluated so far.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.looked_at = 0
        empty = problem.empty_cost
        self.need = Need(
            soc_per_s=float(problem.soc_per_s),
            soc_fixed=float(problem.soc_fixed),
            empty_per_s=float(empty[0]),
            empty_fixed=float(empty[1]),
            epsilon=float(problem.epsilon),
            destination=int(problem.destination),
            escapes=problem.escapes,
            needs_escape=bool(problem.needs_escape),
        )

    @cached_property
    def graph(self) -> Graph:
        """Network and waits for kernels; the waits' rows fill as they are needed."""
        network, waits = self.problem.network, self.problem.waits
        return Graph(
            network.first, network.head, network.pads > 0, float(waits.start_s), float(waits.step_s), waits.wait_s
        )

    @cached_property
    def speeds(self) -> tuple[Speeds, Speeds]:
        """Ground speeds over segments and over straight flights to the destination, filled as they are met."""
        p = self.problem
        members, slots, _ = p.air.north.shape
        keep = slots if members * slots * (len(p.network.tail) + len(p.network)) <= MAX_KEPT_SPEEDS else 0
        sizes = len(p.network.tail), len(p.network)
        first, second = (Speeds(np.empty((keep, n, members)), np.zeros((keep, n), dtype=np.bool_)) for n in sizes)
        return first, second

    @property
    def budget(self) -> float:
        """Most that a flight can take from a full battery."""
        return 1.0 - self.problem.reserve

    def flight(self, segment: int, time_s: float) -> tuple[float, float, float]:
        """(mean time, charge taken, P(hold)) of a flight, see `flight_outlook`."""
        self.looked_at += 1
        node = int(self.problem.network.head[segment])
        mean, charge, p_hold = flight_outlook(
            self.problem.air, self.speeds[0], self.problem.probability, self.need, segment, node, time_s
        )
        return float(mean), float(charge), float(p_hold)

    def reachable(
        self, node: int, time_s: float, soc: float, pad_s: float | None, *, full: bool, factor: float
    ) -> list[tuple[float, Reachable]]:
        """Stations one segment away that a drone at `node` reaches with the reserve, each with its rank.

        Parameters
        ----------
        node, time_s, soc, pad_s
            Where the drone stands, since when, with which charge, and when it comes onto a pad (None: it cannot charge).
        full : bool
            Charge to 100 % before leaving, otherwise what the flight needs.
        factor : float
            Of the remaining flight in the look-ahead.
        """
        p = self.problem
        rows = options(
            *self._fixed(node),
            node,
            (time_s, soc, math.inf if pad_s is None else pad_s),
            (full, p.reserve, factor),
            *p.curve(node),
        )
        first = int(p.network.first[node])
        self.looked_at += len(rows)
        found = []
        for row, (leave, charge, mean, to, landed, rank_s, final) in enumerate(rows.tolist()):
            if math.isfinite(rank_s):
                target = int(p.network.head[first + row])
                to_soc = None if math.isnan(to) else to
                one = Reachable(first + row, target, leave, charge, mean, landed, to_soc, ranked=final > 0.0)
                found.append((rank_s, one))
        return found

    def ranked(self, one: Reachable, time_s: float, *, full: bool, factor: float) -> float:
        """Final rank of a station whose rank was a lower bound so far."""
        p = self.problem
        node = int(p.network.tail[one.segment])
        state = (time_s, one.leave_s + one.mean_s, one.soc)
        fixed = self._fixed(one.node)
        return float(rank(*fixed, (node, one.node), state, (full, p.reserve, factor), *p.curve(one.node)))

    def segments(self, node: int) -> list[int]:
        """Segments that leave a node towards stations with pads or the destination."""
        p = self.problem
        leaving = range(int(p.network.first[node]), int(p.network.first[node + 1]))
        return [s for s in leaving if p.has_pads(int(p.network.head[s])) or int(p.network.head[s]) == p.destination]

    def held(
        self, segments: list[int], time_s: float, soc: float, pad_s: float | None, *, full: bool, factor: float
    ) -> list[tuple[float, Reachable]]:
        """Stations that wind brings into reach later, while the drone waits, charged; as `reachable`."""
        p = self.problem
        found = []
        for segment in segments:
            node = int(p.network.tail[segment])
            one = self._held(segment, node, time_s, soc, pad_s)
            if one is None:
                continue
            rank_s = self.ranked(one, time_s, full=full, factor=factor)
            if math.isfinite(rank_s):
                found.append((rank_s, one))
        return found

    def _fixed(self, node: int) -> tuple[Air, Air, tuple[Speeds, Speeds], NDArray[np.float64], Graph, Need]:
        """What every look-ahead from a node reads; fills the waits it will ask for."""
        p = self.problem
        p.waits.need(self._within_two(node))
        return p.air, p.direct_air, self.speeds, p.probability, self.graph, self.need

    def _within_two(self, node: int) -> NDArray[np.int64]:
        """Nodes at most two segments away."""
        network = self.problem.network
        near = network.head[network.first[node] : network.first[node + 1]]
        blocks = [network.head[network.first[k] : network.first[k + 1]] for k in near]
        return np.concatenate([np.array([node]), near, *blocks])

    def _held(self, segment: int, node: int, time_s: float, soc: float, pad_s: float | None) -> Reachable | None:
        """Earliest take-off with a full battery (or, without a pad, with what there is) at which the flight can be made."""
        p = self.problem
        ready = time_s if pad_s is None else pad_s + p.charge_time_s(node, soc, 1.0)
        limit = soc - p.reserve if pad_s is None else self.budget
        before, leave = ready, ready
        _, charge, _ = self.flight(segment, leave)
        while charge > limit:
            before = leave
            leave = float(slot_end(p.air, slot_of(p.air, leave)))
            if not math.isfinite(leave) or leave > ready + MAX_FLIGHTS_AHEAD_H * 3600.0:
                return None
            _, charge, _ = self.flight(segment, leave)
        while leave - before > 0.5:  # towards the earliest such time, which lies within the slot before
            middle = 0.5 * (before + leave)
            if self.flight(segment, middle)[1] <= limit:
                leave = middle
            else:
                before = middle
        mean, charge, _ = self.flight(segment, leave)
        return Reachable(
            segment,
            int(p.network.head[segment]),
            leave,
            charge,
            mean,
            (soc if pad_s is None else 1.0) - charge,
            None if pad_s is None else 1.0,
            held=True,
        )
