"""Where to leave a fixed route to change the battery, with few packs and few chargers: exact.

The pack taken from the drone goes to the first free charger, and is charged to full; the drone waits on the pad for the pack that is
full first. A label is an arrival: a place, a pad, when the drone can continue with a full pack, when each other pack is full, and when each
charger is free. It is dropped if another one of the same place is no later in all of these: then everything possible with it is possible with the
other, since a drone may wait on a pad. A way takes the same time and charge whenever it starts between two changes of the wind, so only the first take-off of each
such piece is tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.charging_stops import ChargingPlan, ChargingStop, Label, StopSearch
from skyway.planner.fixed_route.way_kernels import NOWHERE, flown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.fixed_route.charging_stops import FixedRoute

_NONE = np.empty((0, 3))
_TIE_S = 1e-7


@dataclass(frozen=True, eq=False, slots=True)
class PackPool:
    """Batteries and chargers that move with the person who changes batteries."""

    packs: int
    """The drone's included; all are full at the start."""
    chargers: int
    swap_s: float
    """Duration of a change; the removed pack is charged after it."""
    curve_s: NDArray[np.float64]
    curve_soc: NDArray[np.float64]
    """Of a charger: seconds from empty and SoC."""

    def refill_s(self, soc: float) -> float:
        """Time in which a charger fills a pack."""
        return float(self.curve_s[-1] - np.interp(max(soc, 0.0), self.curve_soc, self.curve_s))

    def changed(self, here: PoolState, arrive_s: float, soc: float) -> tuple[float, PoolState]:
        """Exchange the battery of a drone that arrives at a time with a charge: departure time, and the remaining packs."""
        out_s = arrive_s + self.swap_s
        begin_s = max(out_s, here.free[0])
        full_s = begin_s + self.refill_s(soc)
        free = tuple(sorted((*here.free[1:], full_s)))
        first, *others = sorted((*here.full, full_s))
        return max(arrive_s, first) + self.swap_s, PoolState(tuple(others), free)

    @property
    def all_full(self) -> PoolState:
        """State of the packs at the start."""
        return PoolState((-math.inf,) * (self.packs - 1), (-math.inf,) * self.chargers)


@dataclass(frozen=True, slots=True)
class PoolState:
    """Instants in order."""

    full: tuple[float, ...]
    """When each pack outside a drone is full."""
    free: tuple[float, ...]
    """When each charger is free."""


@dataclass(frozen=True, eq=False, slots=True)
class _Change(Label):
    """A label with its pool, and the way it was reached."""

    pool: PoolState
    depart_s: float
    arrive_s: float
    soc_arrive: float
    on_pad_s: float


def swap_stops(route: FixedRoute, pool: PackPool) -> ChargingPlan | None:
    """Return the stops of the earliest route on which every flight starts with a full pack, or None if there is none.

    The route's curves are those of a drone that is full at once, and the duration of a change is in its waits.
    """
    return _PackSearch(route, pool).solve()


class _PackSearch(StopSearch):
    def __init__(self, route: FixedRoute, pool: PackPool) -> None:
        super().__init__(route)
        self.pool = pool
        self.changes: dict[tuple[int, int], list[_Change]] = {}

    def solve(self) -> ChargingPlan | None:
        route = self.route
        start = np.array([[route.start_s, route.soc_start]])
        begin = _Change(
            NOWHERE, NOWHERE, start, _NONE, _NONE, None, self.pool.all_full, math.nan, math.nan, 1.0, math.nan
        )
        self.search_from(begin)
        return None if self.best is None else self._told(*self.best)

    def landings(self, label: Label, position: int, pad: int) -> list[_Change]:
        """Fly to a pad in each interval, and exchange the battery there; omit landings dominated by known ones."""
        if not isinstance(label, _Change):
            return []
        first, last = self.windows[pad]
        wait = self.route.waits[pad]
        known = self.changes.setdefault((position, pad), [])
        found: list[_Change] = []
        for a0, s0, t0, a1, *_ in np.asarray(
            flown(label.g, self._pieces(label, position, pad), *self.ratios, self.route.reserve_soc)
        ).tolist():
            if a1 < first:
                continue
            arrive_s, depart_s = (a0, t0) if a0 >= first else (first, t0 + first - a0)
            on_pad_s = arrive_s + float(np.interp(arrive_s, wait[:, 0], wait[:, 1])) - self.pool.swap_s
            leave_s, pool = self.pool.changed(label.pool, on_pad_s, s0)
            if leave_s > last:
                continue
            if any(_no_later(one, leave_s, pool) for one in known):
                continue
            g = np.array([[leave_s, 1.0]])
            reached = _Change(position, pad, g, _NONE, _NONE, label, pool, depart_s, arrive_s, s0, on_pad_s)
            known[:] = [one for one in known if not _no_later(reached, float(one.g[0, 0]), one.pool)]
            known.append(reached)
            found.append(reached)
        return found

    def _told(self, label: Label, depart_s: float) -> ChargingPlan:
        stops: list[ChargingStop] = []
        pieces = self._pieces(label, len(self.route.can_leave) - 1, NOWHERE)
        rows = np.asarray(flown(label.g, pieces, *self.ratios, self.route.reserve_soc))
        first = int(rows[:, 0].argmin())
        end_s, soc_end = float(rows[first, 0]), float(rows[first, 1])
        here: Label | None = label
        while isinstance(here, _Change) and here.before is not None:
            stops.append(
                ChargingStop(here.position, here.pad, here.arrive_s, here.soc_arrive, here.on_pad_s, depart_s, 1.0)
            )
            depart_s, here = here.depart_s, here.before
        return ChargingPlan(tuple(reversed(stops)), depart_s, end_s, soc_end, self.labels)


def _no_later(one: _Change, leave_s: float, pool: PoolState) -> bool:
    """Whether a label dominates one with this pool and departure."""
    if float(one.g[0, 0]) > leave_s + 1e-9:
        return False
    pairs = zip((*one.pool.full, *one.pool.free), (*pool.full, *pool.free), strict=True)
    return all(ours <= theirs + 1e-9 for ours, theirs in pairs)
