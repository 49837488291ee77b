"""Bounds by straight ways: when nothing arrives yet, and which nodes a delivery can use until a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.subnetwork import places

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Costs
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.speeds import Speeds


@dataclass(frozen=True)
class Extent:
    """Of one delivery, at some speeds and costs (`planner.exact.stop_labels.costs_of`)."""

    problem: Problem
    speeds: Speeds
    costs: Costs

    @cached_property
    def place_m(self) -> NDArray[np.float64]:
        """Where the nodes are, see `planner.exact.subnetwork.places`."""
        return places(self.problem.network)

    @cached_property
    def way_m(self) -> NDArray[np.float64]:
        """Straight way over each node, shape (nodes,)."""
        place = self.place_m
        ends = place[[self.problem.origin, self.problem.destination]]
        return np.asarray(np.linalg.norm(place[:, None] - ends, axis=2).sum(axis=1))

    def straight_s(self, slots: int) -> float:
        """Arrival that nothing beats within some slots: straight at the greatest speed, charged as fast as can be."""
        p, costs = self.problem, self.costs
        way = float(np.linalg.norm(self.place_m[p.origin] - self.place_m[p.destination])) * 0.995
        flight = way / self.speeds.fastest_mps(0, min(slots, self.speeds.slots) - 1) + costs.landing_s
        charge = flight * costs.soc_per_s + min(costs.soc_fixed, 0.0)
        charged = (costs.reserve + charge - p.soc) / costs.rate_per_s
        return p.depart_s + flight + max(charged, 0.0)

    def slots(self, until_s: float) -> tuple[int, int]:
        """First and last slot that matter until a time."""
        p, air = self.problem, self.problem.air
        first, last = (
            min(max(int((t + 1e-6 - air.start_s) // air.slot_s), 0), self.speeds.slots - 1)
            for t in (p.depart_s, until_s)
        )
        return first, min(last + 1, self.speeds.slots - 1)

    def usable(self, until_s: float) -> NDArray[np.bool_]:
        """Which nodes can lie on a route that arrives by a time, shape (nodes,)."""
        p, costs = self.problem, self.costs
        flight = self.way_m * 0.995 / self.speeds.fastest_mps(*self.slots(until_s)) + costs.landing_s
        span = until_s - p.depart_s
        charged = (costs.reserve + flight * costs.soc_per_s + min(costs.soc_fixed, 0.0) - p.soc) / costs.rate_per_s
        keep: NDArray[np.bool_] = (flight <= span) & (flight + charged <= span)
        keep[[p.origin, p.destination]] = True
        return keep
