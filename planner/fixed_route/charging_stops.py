"""The best places, pads and charging times to interrupt a fixed route so that it ends first: exact.

Labels are stops with all options of the drone there, as charge over time (`planner.schedule.profile_kernels`): waiting for a pad,
charging along a curve that is not straight, and continuing later if the wind changes are all in the one function. They are processed
in the order of a bound (`planner.fixed_route.bound_kernels`), onward ways of a label one by one, so that most are never computed; the
first that ends the route is the best. A label is dropped if another one of the same place has at any time as much charge.

The fixed-route vehicle charging problem (Froger, Mendoza, Jabali and Laporte, "Improved formulations and algorithmic components for the
electric vehicle routing problem with nonlinear charging functions", Computers & Operations Research 104, 2019) is this one with one slot.
"""

from __future__ import annotations

import heapq
import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.bound_kernels import onward, remaining
from skyway.planner.fixed_route.pad_windows import ALWAYS, Window, landed_within
from skyway.planner.fixed_route.way_kernels import NOWHERE, flown, landed, pieces_of, way
from skyway.planner.schedule.profile_kernels import covers, interpolate, profile_at

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.models.flight.kernels import Slots
    from skyway.planner.fixed_route.way_kernels import Hops

_TIE_S = 1e-7
"""Ends closer than this are the same."""


@dataclass(frozen=True, eq=False)
class FixedRoute:
    """A route with a fixed order, and the pads near it."""

    hops: Hops
    slots: Slots
    """Clock of the hops; one slot if they do not change."""
    can_leave: NDArray[np.bool_]
    """Shape (positions,). Where the work may be left."""
    curves: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]
    """Of each pad: seconds from empty and SoC, piecewise linear and concave."""
    waits: tuple[NDArray[np.float64], ...]
    """Of each pad: points (arrival, wait), see `planner.fixed_route.way_kernels.waited`."""
    start_s: float
    soc_start: float
    reserve_soc: float = 0.0
    mean_ratio: float = 1.0
    """Mean of actual over modelled hops."""
    sure_ratio: float = 1.0
    """Required charge of a way from pad to pad, over the model's."""
    windows: tuple[Window, ...] = ()
    """Times at which each pad can be used; empty: always."""


@dataclass(frozen=True, slots=True)
class ChargingStop:
    """One stop of a solution; instants in seconds on the clock of the route."""

    position: int
    """Where the work is left."""
    pad: int
    arrive_s: float
    soc_arrive: float
    on_pad_s: float
    """When the pad is free."""
    leave_s: float
    soc_leave: float


@dataclass(frozen=True, slots=True)
class ChargingPlan:
    """Stops in their order, and when the route ends."""

    stops: tuple[ChargingStop, ...]
    depart_s: float
    """Take-off at the start."""
    end_s: float
    soc_end: float
    labels: int
    """Number of stops computed in the search."""


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """A stop: where the work was left, the pad, charge over time there, and the label from which it was reached."""

    position: int
    pad: int
    g: NDArray[np.float64]
    z: NDArray[np.float64]
    h: NDArray[np.float64]
    before: Label | None


def charging_stops(route: FixedRoute, *, below_s: float = math.inf) -> ChargingPlan | None:
    """Return the stops with which a route ends first, or None if no stops let it end, or none before `below_s`.

    Times and charges are those of hops that take `mean_ratio` times their modelled values. Of two solutions with the same end, one is returned.
    """
    return StopSearch(route, below_s).solve()


def least_end(route: FixedRoute) -> float:
    """Return a bound of the end of a route, without searching its stops; infinite if none let it end."""
    search = StopSearch(replace(route, windows=()))
    none = np.empty((0, 3))
    rows = search.ways_on(Label(NOWHERE, NOWHERE, np.array([[route.start_s, route.soc_start]]), none, none, None))
    return float(rows[:, 0].min()) if len(rows) else math.inf


class StopSearch:
    """Best-first search over labels; `_land` returns the result of a landing."""

    def __init__(self, route: FixedRoute, below_s: float = math.inf) -> None:
        self.route = route
        hops = route.hops
        self.least = hops._replace(
            **{name: getattr(hops, name).min(axis=0, keepdims=True) for name in hops._fields if name != "resume"}
        )
        self.ratios = (route.mean_ratio, route.sure_ratio)
        self.least_wait_s = np.array([float(wait[:, 1].min()) for wait in route.waits])
        self.windows = route.windows or (ALWAYS,) * len(route.waits)
        slots = route.slots
        changes = [slots.start_s + slots.slot_s * slots.length] if slots.length > 1 else []
        opens = [first for first, _ in self.windows if math.isfinite(first)]
        self.last_change_s = max([*changes, *opens], default=-math.inf)
        self.tau_soc, self.tau_s = fastest(route.curves)
        self.bounds = (
            route.can_leave, self.least_wait_s, self.ratios, route.reserve_soc, self.tau_soc, self.tau_s
        )  # fmt: skip
        self.left = remaining(self.least, *self.bounds)
        self.curves = packed(route.curves)
        self.known: dict[tuple[int, int], list[NDArray[np.float64]]] = {}
        self.reached: dict[tuple[int, int], list[tuple[list[float], list[float]]]] = {}
        self.queue: list[tuple[float, int, int, Label, Iterator[list[float]], int, int]] = []
        self.labels = 0
        self.best_s = below_s
        self.best: tuple[Label, float] | None = None

    def solve(self) -> ChargingPlan | None:
        """Process the onward ways in the order of their bounds until none may end before the best."""
        start = np.array([[self.route.start_s, self.route.soc_start]])
        none = np.empty((0, 3))
        begin = Label(NOWHERE, NOWHERE, start, none, none, None)
        self._dive(begin)
        self.known.clear()
        self.reached.clear()
        self.search_from(begin)
        return None if self.best is None else self._traced(*self.best)

    def search_from(self, begin: Label) -> None:
        """Find the best onward way of a label."""
        self._go_on_from(begin)
        while self.queue:
            bound, _, _, label, ways, position, pad = heapq.heappop(self.queue)
            if bound >= self.best_s - _TIE_S:
                break
            self._queue_next(label, ways)
            if pad == NOWHERE:
                self._end(label, position)
                continue
            for reached in self.landings(label, position, pad):
                self._go_on_from(reached)

    def landings(self, label: Label, position: int, pad: int) -> Sequence[Label]:
        """Fly to a pad: the labels there that are not dominated by known ones."""
        reached = self._land(label, position, pad)
        return () if reached is None else (reached,)

    def _dive(self, label: Label) -> None:
        """Take the best onward way repeatedly: a nearly optimal solution, so that most others are never searched."""
        for _ in range(len(self.route.can_leave) * len(self.route.curves)):
            rows = self.ways_on(label)
            reached = None
            for number in np.lexsort((-rows[:, 1], rows[:, 0]))[:20]:
                _, position, pad = rows[number, :3].tolist()
                if int(pad) == NOWHERE:
                    self._end(label, int(position))
                    return
                reached = self._land(label, int(position), int(pad))
                if reached is not None:
                    break
            if reached is None:
                return
            label = reached

    def ways_on(self, label: Label) -> NDArray[np.float64]:
        """Return the onward ways of a label that may end before the best, with their bounds."""
        found = onward(
            label.g, label.position, label.pad, self.least, self.left, *self.bounds, self.curves, self.best_s
        )  # fmt: skip
        return np.asarray(found)

    def _go_on_from(self, label: Label) -> None:
        """Queue the best onward way of a label; the others wait in its iterator."""
        rows = self.ways_on(label)
        order = np.lexsort((-rows[:, 1], rows[:, 0]))
        self._queue_next(label, (rows[number].tolist() for number in order))

    def _queue_next(self, label: Label, ways: Iterator[list[float]]) -> None:
        """Queue the best remaining onward way of a label; of equal ones, the one with more work done comes first.

        Ways to a place with a known label that certainly has as much charge at any time are omitted.
        """
        for bound, until, to_pad, first_s, potential_s in ways:
            place = int(until), int(to_pad)
            if any(_surely_covers(z, first_s, potential_s) for z in self.reached.get(place, ())):
                continue
            self.labels += 1
            heapq.heappush(self.queue, (bound, -place[0], self.labels, label, ways, *place))
            return

    def _pieces(self, label: Label, position: int, pad: int) -> NDArray[np.float64]:
        slots, begin_s = self.route.slots, float(label.g[0, 0])
        until_s = max(min(max(float(label.g[-1, 0]), self.last_change_s), self.best_s), begin_s) + 1.0
        if label.pad != NOWHERE:
            until_s = min(until_s, self.windows[label.pad][1])
        return np.asarray(pieces_of(self.route.hops, slots, label.position, label.pad, position, pad, begin_s, until_s))

    def _end(self, label: Label, position: int) -> None:
        pieces = self._pieces(label, position, NOWHERE)
        rows = np.asarray(flown(label.g, pieces, *self.ratios, self.route.reserve_soc))
        if len(rows) and float(rows[:, 0].min()) < self.best_s:
            first = int(rows[:, 0].argmin())
            self.best_s = float(rows[first, 0])
            self.best = (label, float(rows[first, 2]))

    def _land(self, label: Label, position: int, pad: int) -> Label | None:
        """Fly to a pad; None if that is impossible, or dominated by a known label."""
        pieces = self._pieces(label, position, pad)
        z, h, g = self._on_pad(label.g, pieces, pad)
        known = self.known.setdefault((position, pad), [])
        if not len(g) or any(covers(other, g, 1e-12) for other in known):
            return None
        known.append(g)
        self.reached.setdefault((position, pad), []).append((z[:, 0].tolist(), z[:, 1].tolist()))
        return Label(position, pad, g, z, h, label)

    def _on_pad(
        self, g: NDArray[np.float64], pieces: NDArray[np.float64], pad: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        route = self.route
        if self.windows[pad] == ALWAYS:
            return landed(g, pieces, self.ratios, route.reserve_soc, route.waits[pad], *route.curves[pad])
        return landed_within(
            g, pieces, self.ratios, route.reserve_soc, route.waits[pad], route.curves[pad], self.windows[pad]
        )  # fmt: skip

    def _traced(self, label: Label, depart_s: float) -> ChargingPlan:
        """Convert the best chain of labels to stops, from the end to the start."""
        route = self.route
        stops: list[ChargingStop] = []
        position, pad, at, leave_s = len(route.can_leave) - 1, NOWHERE, label, depart_s
        end_s, soc_end = math.nan, math.nan
        while True:
            seconds, soc, _ = way(route.hops, route.slots, at.position, at.pad, position, pad, leave_s)
            charge = float(np.interp(leave_s, at.g[:, 0], at.g[:, 1])) if len(at.g) > 1 else float(at.g[0, 1])
            charge = max(charge, _after(at.g, leave_s))
            arrive_s, arrived = leave_s + seconds, charge - route.mean_ratio * soc
            if pad == NOWHERE:
                end_s, soc_end = arrive_s, arrived
            else:
                stops[-1] = replace(stops[-1], arrive_s=arrive_s, soc_arrive=arrived, on_pad_s=max(stops[-1].on_pad_s, arrive_s))  # fmt: skip
            if at.before is None:
                break
            on_pad_s, before_s = self._stay(at, leave_s, charge)
            stops.append(ChargingStop(at.position, at.pad, math.nan, math.nan, on_pad_s, leave_s, charge))
            position, pad, at, leave_s = at.position, at.pad, at.before, before_s
        return ChargingPlan(tuple(reversed(stops)), leave_s, end_s, soc_end, self.labels)

    def _stay(self, label: Label, leave_s: float, charge: float) -> tuple[float, float]:
        """Return the start of the use of the pad, always within its times, and the take-off before."""
        curve_s, curve_soc = self.route.curves[label.pad]
        potential, before_s = profile_at(label.z, leave_s)
        landed, landed_before_s = profile_at(label.h, leave_s)
        if landed >= charge - 1e-12:
            return -math.inf, landed_before_s
        arrived = charge_at(label.before, before_s) - self._taken(label, before_s)
        return interpolate(arrived, curve_soc, curve_s) - potential, before_s

    def _taken(self, label: Label, leave_s: float) -> float:
        """Charge used on the way to a label."""
        before = label.before
        if before is None:
            return 0.0
        route = self.route
        _, soc, _ = way(route.hops, route.slots, before.position, before.pad, label.position, label.pad, leave_s)
        return route.mean_ratio * float(soc)


def _surely_covers(z: tuple[list[float], list[float]], first_s: float, potential_s: float) -> bool:
    """Whether a profile of charging potential is as high at a time as the maximum of another one that begins then."""
    at = bisect_right(z[0], first_s) - 1
    return at >= 0 and z[1][at] >= potential_s - 1e-9


def packed(
    curves: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the kind of each pad, and seconds and SoC of each kind, filled up with their last points."""
    kinds: dict[tuple[bytes, bytes], int] = {}
    kind_of = np.array([kinds.setdefault((s.tobytes(), q.tobytes()), len(kinds)) for s, q in curves], dtype=np.int64)
    points = max(len(seconds) for seconds, _ in curves)
    filled = np.empty((2, len(kinds), points))
    for (seconds, soc), kind in zip(curves, kind_of.tolist(), strict=True):
        for values, row in zip((seconds, soc), filled[:, kind], strict=True):
            row[: len(values)], row[len(values) :] = values, values[-1]
    return kind_of, filled[0], filled[1]


def charge_at(label: Label | None, time_s: float) -> float:
    """Charge that a drone can leave with at a time."""
    return math.nan if label is None else _after(label.g, time_s)


def _after(g: NDArray[np.float64], time_s: float) -> float:
    """Value of a departure profile at a time, just after a jump there."""
    k = max(int(np.searchsorted(g[:, 0], time_s + 1e-9, side="right")) - 1, 0)
    if k == len(g) - 1 or g[k + 1, 0] <= g[k, 0]:
        return float(g[k, 1])
    part = (time_s - g[k, 0]) / (g[k + 1, 0] - g[k, 0])
    return float(g[k, 1] + min(max(part, 0.0), 1.0) * (g[k + 1, 1] - g[k, 1]))


def fastest(
    curves: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the curve that uses the fastest of some pads for each percent: SoC and seconds from empty, convex."""
    soc = np.unique(np.concatenate([points for _, points in curves]))
    slopes = [np.diff(np.interp(soc, points, seconds)) for seconds, points in curves]
    return soc, np.concatenate(([0.0], np.cumsum(np.min(slopes, axis=0))))
