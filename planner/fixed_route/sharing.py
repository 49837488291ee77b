"""Pads shared by several drones: each drone plans in the windows left by the earlier ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.charging_stops import charging_stops
from skyway.planner.fixed_route.pad_windows import ALWAYS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.planner.fixed_route.charging_stops import ChargingPlan, FixedRoute
    from skyway.planner.fixed_route.pad_windows import Window

APART_S = 30.0
"""Between two drones on one pad: time to leave it, and to clear the air above it, before the next one arrives."""
SHORTEST_S = 30.0
"""A shorter window is not used."""


@dataclass(frozen=True, slots=True)
class Stay:
    """A stay on one numbered pad."""

    pad: int
    number: int
    from_s: float
    until_s: float


def free_windows(stays: Sequence[Window], within: Window = ALWAYS) -> list[Window]:
    """Return when one pad is free between the stays on it."""
    found: list[Window] = []
    begin = within[0]
    for first, last in sorted(stays):
        if first - APART_S - begin >= SHORTEST_S:
            found.append((begin, first - APART_S))
        begin = max(begin, last + APART_S)
    if within[1] - begin >= SHORTEST_S:
        found.append((begin, within[1]))
    return found


def windows_left(count: int, stays: Sequence[Stay], within: Sequence[Window]) -> list[tuple[Window, int]]:
    """Return the free windows of interchangeable pads between stays, each with the number of its pad; none nested in another."""
    found: list[tuple[Window, int]] = []
    for number in range(count):
        here = [(stay.from_s, stay.until_s) for stay in stays if stay.number == number]
        found += [(window, number) for one in within for window in free_windows(here, one)]
    found.sort(key=lambda one: (one[0][0], -one[0][1], one[1]))
    kept: list[tuple[Window, int]] = []
    until = -math.inf
    for window, number in found:
        if window[1] > until:
            kept.append((window, number))
            until = window[1]
    return kept


def number_of(stay: Window, windows: Sequence[tuple[Window, int]]) -> int:
    """Return the number of the pad whose window contains a stay."""
    return min(windows, key=lambda one: max(one[0][0] - stay[0], stay[1] - one[0][1], 0.0))[1]


def window_of(stay: Stay, windows: Sequence[tuple[Window, int]]) -> Window:
    """Return the window of its numbered pad that contains a stay."""
    own = [window for window, number in windows if number == stay.number]
    return min(own, key=lambda one: max(one[0] - stay.from_s, stay.until_s - one[1], 0.0))


def shared(
    routes: Sequence[FixedRoute], counts: Sequence[int], *, below_s: float = math.inf
) -> list[ChargingPlan] | None:
    """Plan routes one after the other, the longest first; None if one has no plan, or ends at `below_s` or later.

    No two drones are on one pad within `APART_S` of each other; the pads of the plans are those of the routes.
    """
    plans: dict[int, ChargingPlan] = {}
    stays: list[Stay] = []
    lengths = [float(route.hops.work_s[0].sum()) for route in routes]
    for drone in sorted(range(len(routes)), key=lambda one: -lengths[one]):
        made = _within(routes[drone], counts, stays, below_s)
        if made is None or made[0].end_s >= below_s:
            return None
        plans[drone] = made[0]
        stays += made[1]
    return [plans[drone] for drone in range(len(routes))]


def _within(
    route: FixedRoute, counts: Sequence[int], stays: Sequence[Stay], below_s: float
) -> tuple[ChargingPlan, list[Stay]] | None:
    """Plan a route in the windows between stays; return the plan and its own stays."""
    own = route.windows or (ALWAYS,) * len(counts)
    left: Mapping[int, list[tuple[Window, int]]] = {
        pad: windows_left(counts[pad], [one for one in stays if one.pad == pad], [own[pad]])
        for pad in range(len(counts))
    }
    usable = [(pad, window) for pad, windows in left.items() for window, _ in windows]
    if all(window == ALWAYS for _, window in usable) and len(usable) == len(counts):
        plan = charging_stops(replace(route, windows=()), below_s=below_s)
        pads = list(range(len(counts)))
    else:
        pads = [pad for pad, _ in usable]
        plan = charging_stops(on_windows(route, usable), below_s=below_s)
    if plan is None:
        return None
    stops = tuple(replace(stop, pad=pads[stop.pad]) for stop in plan.stops)
    taken = [
        Stay(stop.pad, number_of((stop.arrive_s, stop.leave_s), left[stop.pad]), stop.arrive_s, stop.leave_s)
        for stop in stops
    ]
    return replace(plan, stops=stops), taken


def on_windows(route: FixedRoute, usable: Sequence[tuple[int, Window]]) -> FixedRoute:
    """Return a route whose pads are windows of pads: each pad once per window."""
    pads = [pad for pad, _ in usable]
    hops = route.hops
    of_pads = {
        name: np.ascontiguousarray(getattr(hops, name)[:, :, pads]) for name in ("to_s", "to_soc", "from_s", "from_soc")
    }
    between = {
        name: np.ascontiguousarray(getattr(hops, name)[:, pads][:, :, pads]) for name in ("between_s", "between_soc")
    }
    return replace(
        route,
        hops=hops._replace(**of_pads, **between),
        curves=tuple(route.curves[pad] for pad in pads),
        waits=tuple(route.waits[pad] for pad in pads),
        windows=tuple(window for _, window in usable),
    )
