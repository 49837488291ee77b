"""What the forecast says of the next flight and of what lies beyond it: reachability and look-ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.flight_kernels import slot_end, slot_of
from planner.outlook_kernels import Graph, Need, beyond, flight_outlook

if TYPE_CHECKING:
    from planner.problem import Problem

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
    charge_to : float or None
        SoC to charge to before; None where the drone leaves as it is.
    held : bool
        The drone stays, charged, until `leave_s`, because the wind is better then.
    """

    segment: int
    node: int
    leave_s: float
    charge: float
    mean_s: float
    charge_to: float | None
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
        return Graph(network.first, network.head, float(waits.start_s), float(waits.step_s), waits.wait_s)

    @property
    def budget(self) -> float:
        """Most that a flight can take from a full battery."""
        return 1.0 - self.problem.reserve

    def flight(self, segment: int, time_s: float) -> tuple[float, float, float]:
        """(mean time, charge taken, P(hold)) of a flight, see `flight_outlook`."""
        self.looked_at += 1
        node = int(self.problem.network.head[segment])
        mean, charge, p_hold = flight_outlook(
            self.problem.air, self.problem.probability, self.need, segment, node, time_s
        )
        return float(mean), float(charge), float(p_hold)

    def reachable(
        self, node: int, time_s: float, soc: float, *, full: bool, pad_s: float | None, hold: bool
    ) -> list[Reachable]:
        """Stations one segment away that a drone at `node` reaches with the reserve.

        Parameters
        ----------
        node, time_s, soc
            Where the drone stands, since when, and with which charge.
        full : bool
            Charge to 100 % before leaving, otherwise what the flight needs.
        pad_s : float or None
            When it comes onto a pad; None where it cannot charge.
        hold : bool
            Also wait, charged, for wind that brings a station into reach (otherwise such stations are left out).
        """
        network = self.problem.network
        found = []
        for segment in range(int(network.first[node]), int(network.first[node + 1])):
            one = (
                self._held(segment, node, time_s, soc, pad_s)
                if hold
                else self._now(segment, node, time_s, soc, pad_s, full=full)
            )
            if one is not None:
                found.append(one)
        return found

    def _now(
        self, segment: int, node: int, time_s: float, soc: float, pad_s: float | None, *, full: bool
    ) -> Reachable | None:
        p = self.problem
        target = int(p.network.head[segment])
        if full and pad_s is not None:
            leave = pad_s + p.charge_time_s(node, soc, 1.0) if soc < 1.0 else time_s
            mean, charge, _ = self.flight(segment, leave)
            return Reachable(segment, target, leave, charge, mean, 1.0) if charge <= self.budget else None
        mean, charge, _ = self.flight(segment, time_s)
        if charge <= soc - p.reserve:
            return Reachable(segment, target, time_s, charge, mean, None)
        if pad_s is None:
            return None
        leave = time_s
        for _ in range(8):  # the charge needed depends on when the drone leaves, and that on the charge
            if charge > self.budget:
                return None
            later = pad_s + p.charge_time_s(node, soc, charge + p.reserve)
            if later <= leave:
                break
            leave = later
            mean, charge, _ = self.flight(segment, leave)
        leave = max(leave, pad_s + p.charge_time_s(node, soc, min(charge + p.reserve, 1.0)))
        mean, check, _ = self.flight(segment, leave)
        if max(charge, check) > self.budget:
            return None
        return Reachable(segment, target, leave, max(charge, check), mean, min(max(charge, check) + p.reserve, 1.0))

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
            segment, int(p.network.head[segment]), leave, charge, mean, None if pad_s is None else 1.0, held=True
        )

    def beyond(self, node: int, came_from: int, time_s: float, factor: float) -> tuple[float, float]:
        """Look ahead from `node`, see `outlook_kernels.beyond`."""
        p = self.problem
        out = slice(int(p.network.first[node]), int(p.network.first[node + 1]))
        p.waits.need(np.asarray(p.network.head[out]))
        self.looked_at += out.stop - out.start
        best, charge = beyond(
            p.air, p.direct_air, p.probability, self.graph, self.need, node, came_from, time_s, self.budget, factor
        )
        return float(best), float(charge)
