"""Plans of a fleet carried out where pads are taken first come, first served, by our drones and by strangers."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.result import Route

HORIZON_S = 12 * 3600.0


@dataclass(frozen=True)
class Outcome:
    """What became of a plan."""

    delivered_s: dict[str, float]
    """When each order was delivered, POSIX seconds."""
    waited_s: dict[str, float]
    """How long its drone waited for pads on the way to it and with it, beside charging."""


@dataclass
class _Drone:
    steps: Sequence[tuple[str, str, str | None, bool, float]]
    """Kind, station, order, whether it carries it, and how long."""
    at: int = 0


def strangers(arrivals_per_s: NDArray[np.float64], charging_s: NDArray[np.float64], begin_s: float, seed: int) -> list[list[tuple[float, float]]]:  # fmt: skip
    """Draw strangers at each station: when they come and how long they charge; from some hours before on, so that pads are as busy as usual."""
    rng = np.random.default_rng(seed)
    drawn = []
    for rate, mean in zip(arrivals_per_s, charging_s, strict=True):
        span = 2.0 * HORIZON_S
        count = rng.poisson(rate * span)
        times = np.sort(rng.uniform(begin_s - HORIZON_S, begin_s + HORIZON_S, count))
        drawn.append(list(zip(times.tolist(), rng.exponential(mean, count).tolist(), strict=True)))
    return drawn


def carry_out(
    routes: Sequence[Route],
    ready_s: dict[str, float],
    pads: dict[str, int],
    others: dict[str, list[tuple[float, float]]],
    begin_s: float,
) -> Outcome:
    """Let all drones fly their routes, in order of time; each charge waits for the first pad that is free."""
    drones = []
    events: list[tuple[float, int, int, float]] = []  # time, whose (-1 is a stranger), station number, how long
    free = {station: [-np.inf] * count for station, count in pads.items()}
    names = list(pads)
    for number, station in enumerate(names):
        for come_s, lasts_s in others.get(station, []):
            heapq.heappush(events, (come_s, -1, number, lasts_s))
    for number, route in enumerate(routes):
        steps = [
            (one.kind, one.origin, one.order, one.phase == "with the package", (one.end - one.begin).total_seconds())
            for one in route.steps
        ]
        drones.append(_Drone(steps))
        heapq.heappush(events, (begin_s, number, 0, 0.0))
    delivered: dict[str, float] = {}
    waited: dict[str, float] = {}
    while events:
        time_s, whose, where, lasts_s = heapq.heappop(events)
        if whose < 0:
            queue = free[names[where]]
            heapq.heapreplace(queue, max(queue[0], time_s) + lasts_s)
            continue
        drone = drones[whose]
        kind, place, order, carried, length_s = drone.steps[drone.at]
        if order is not None and carried and not _begun(drone):
            time_s = max(time_s, ready_s[order])
        if kind == "charge":
            queue = free[place]
            start_s = max(queue[0], time_s)
            heapq.heapreplace(queue, start_s + length_s)
            if order is not None:
                waited[order] = waited.get(order, 0.0) + start_s - time_s
            time_s = start_s
        time_s += length_s
        if order is not None and carried:
            delivered[order] = time_s
        drone.at += 1
        if drone.at < len(drone.steps):
            heapq.heappush(events, (time_s, whose, 0, 0.0))
    return Outcome(delivered, waited)


def _begun(drone: _Drone) -> bool:
    """Whether the order of this step has been taken up before it."""
    order = drone.steps[drone.at][2]
    return any(step[2] == order and step[3] for step in drone.steps[: drone.at])
