"""Routes with a free order: units of work, and the fixed route of each order.

A *turn* is a unit flown from its beginning (2 u) or from its end (2 u + 1). Ways between turns are a table; the head of the
mission comes before the first turn of every route, its tail after the last one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import Slots
from skyway.planner.fixed_route.charging_stops import FixedRoute, fastest
from skyway.planner.fixed_route.way_kernels import Hops

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_LITTLE = 0.2
"""Share of a battery."""
_FEW = 250
"""Up to this number, all positions are considered."""


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """Positions of a stretch of work, one after the other, and their hops by slot."""

    work_s: NDArray[np.float64]
    work_soc: NDArray[np.float64]
    """Shape (slots, positions - 1)."""
    to_s: NDArray[np.float64]
    to_soc: NDArray[np.float64]
    from_s: NDArray[np.float64]
    from_soc: NDArray[np.float64]
    """Shape (slots, positions, pads)."""
    can_leave: NDArray[np.bool_]

    @property
    def ends_only(self) -> Stretch:
        """The stretch with only its first and last position."""
        if len(self.can_leave) <= 2:
            return self
        to_s, to_soc, from_s, from_soc = (
            one[:, [0, -1]] for one in (self.to_s, self.to_soc, self.from_s, self.from_soc)
        )
        work_s, work_soc = (one.sum(axis=1, keepdims=True) for one in (self.work_s, self.work_soc))
        return Stretch(work_s, work_soc, to_s, to_soc, from_s, from_soc, self.can_leave[[0, -1]])

    @property
    def least(self) -> Stretch:
        """The stretch with the minimum of each hop over all slots."""
        hops = (self.work_s, self.work_soc, self.to_s, self.to_soc, self.from_s, self.from_soc)
        work_s, work_soc, to_s, to_soc, from_s, from_soc = (one.min(axis=0, keepdims=True) for one in hops)
        return Stretch(work_s, work_soc, to_s, to_soc, from_s, from_soc, self.can_leave)


@dataclass(frozen=True, eq=False)
class FreeOrder:
    """Work whose units may be reordered, for one or more drones that share its pads."""

    pads: FixedRoute
    """Pads, charge and clock; only its hops between pads are used."""
    head: Stretch
    tail: Stretch
    turns: tuple[Stretch | None, ...]
    """Unit u has 2 u and 2 u + 1; None if it is not flown from its end."""
    groups: tuple[int, ...]
    """Of each unit; no unit is flown before one of a lower group."""
    way_s: NDArray[np.float64]
    way_soc: NDArray[np.float64]
    """Shape (slots, turns + 1, turns + 1). From the last position of a turn to the first of another; the last row is the head, the last
    column the tail."""
    counts: tuple[int, ...]
    """Pads of each kind that can be used at once."""
    drones: int = 1
    visit_s: float = 0.0
    visit_soc: float = 0.0
    """Minimum cost of leaving the work for a pad and coming back, at any place."""

    @property
    def units(self) -> int:
        """Number of units."""
        return len(self.groups)

    @cached_property
    def least(self) -> FreeOrder:
        """The same with the minimum of each hop over all slots, for bounds."""
        hops = self.pads.hops
        pads = hops._replace(
            **{name: getattr(hops, name).min(axis=0, keepdims=True) for name in hops._fields if name != "resume"}
        )
        return replace(
            self,
            pads=replace(self.pads, hops=pads, slots=Slots(0.0, 1.0, 1)),
            head=self.head.least,
            tail=self.tail.least,
            turns=tuple(None if one is None else one.least for one in self.turns),
            way_s=self.way_s.min(axis=0, keepdims=True),
            way_soc=self.way_soc.min(axis=0, keepdims=True),
        )

    @cached_property
    def coarse(self) -> FreeOrder:
        """The same with only the ends of turns as places to leave, except for turns that take much of a battery.

        Fewer positions; plans for it are also plans for the original.
        """
        if sum(len(one.can_leave) for one in self.turns[::2] if one is not None) <= _FEW:
            return self
        usable = _LITTLE * (1.0 - self.pads.reserve_soc) / self.pads.sure_ratio
        turns = tuple(
            one if one is None or one.work_soc.max(axis=0).sum() > usable else one.ends_only for one in self.turns
        )
        return replace(self, turns=turns)

    @cached_property
    def price_s(self) -> float:
        """Charging time per unit of modelled SoC at the fastest rate, s."""
        tau_soc, tau_s = fastest(self.pads.curves)
        return float(self.pads.mean_ratio * (tau_s[1] - tau_s[0]) / (tau_soc[1] - tau_soc[0]))

    @cached_property
    def way_cost_s(self) -> NDArray[np.float64]:
        """Ways by weighted time and charge, shape (turns + 1, turns + 1)."""
        return np.asarray(self.least.way_s[0] + self.price_s * self.least.way_soc[0])

    @cached_property
    def turn_cost_s(self) -> NDArray[np.float64]:
        """Turns likewise; infinite if there is none."""
        costs = [
            math.inf if one is None else float(one.work_s.sum() + self.price_s * one.work_soc.sum())
            for one in self.least.turns
        ]
        return np.array(costs)

    def route(self, tour: Sequence[int]) -> FixedRoute:
        """Return the fixed route of an order of turns."""
        names = [len(self.turns), *tour]
        stretches = [self.head, *(self._turn(one) for one in tour), self.tail]
        ways = [(one, other) for one, other in zip(names, [*tour, len(self.turns)], strict=True)]
        slots = self.way_s.shape[0]

        def along(name: str, way: NDArray[np.float64]) -> NDArray[np.float64]:
            parts: list[NDArray[np.float64]] = []
            for number, stretch in enumerate(stretches):
                if number:
                    parts.append(way[:, ways[number - 1][0], ways[number - 1][1]].reshape(slots, 1))
                parts.append(getattr(stretch, name))
            return np.ascontiguousarray(np.concatenate(parts, axis=1))

        def at(name: str) -> NDArray[np.float64]:
            return np.ascontiguousarray(np.concatenate([getattr(one, name) for one in stretches], axis=1))

        can_leave = np.concatenate([one.can_leave for one in stretches])
        hops = self.pads.hops._replace(
            work_s=along("work_s", self.way_s),
            work_soc=along("work_soc", self.way_soc),
            to_s=at("to_s"),
            to_soc=at("to_soc"),
            from_s=at("from_s"),
            from_soc=at("from_soc"),
            resume=np.arange(len(can_leave)),
        )
        return replace(self.pads, hops=Hops(*hops), can_leave=can_leave)

    def _turn(self, turn: int) -> Stretch:
        stretch = self.turns[turn]
        if stretch is None:
            raise ValueError("a unit is flown from its end that cannot be")
        return stretch
