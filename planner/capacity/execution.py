"""Execution of plans of a fleet, with pads taken first come, first served, by our drones and by others."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.base.units import S_PER_H

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.result import Route, Step

HORIZON_S = 12 * 3600.0
"""Time from the beginning for which other drones come and ours wait for better wind, if no orders are due later."""
WARM_UP_S = 48 * 3600.0
"""Other drones arrive from this time before on: at 0.7 of five pads a line forgets its beginning with a time constant of five hours."""
SLACK_SOC = 1e-6
AGAIN_S = 600.0
"""Interval at which a flight that is closed by the wind, or for which no charge is sufficient, is checked again."""


class Truth(Protocol):
    """Actual times and charges of flights and charges, if they differ from the plan."""

    def flight(self, drone: str, step: Step, begin_s: float) -> tuple[float, float]:
        """Time of a flight that begins then, s, and its charge; infinite if the wind has closed it."""
        ...

    def wanted(self, drone: str, step: Step, begin_s: float) -> float:
        """Charge required by the check before the take-off beyond the reserve; infinite if the wind has closed it."""
        ...

    def charging_s(self, drone: str, place: str, soc: float, up_to: float) -> float:
        """Time of a charge."""
        ...


@dataclass(frozen=True)
class Outcome:
    """Result of a plan."""

    delivered_s: dict[str, float]
    """Delivery time of each order, POSIX seconds; without undelivered ones."""
    waited_s: dict[str, float]
    """Waits of its drone for pads on the way to it and with it, without charging."""
    lowest: list[float] = field(default_factory=list)
    """Charge at each landing, if a truth is given."""


@dataclass
class _Drone:
    route: Route
    soc: float
    at: int = 0

    @property
    def step(self) -> Step:
        return self.route.steps[self.at]

    def begun(self) -> bool:
        """Whether the order of this step has been picked up before it."""
        order = self.step.order
        return any(one.order == order and one.phase == "with the package" for one in self.route.steps[: self.at])

    def next_flight(self) -> Step | None:
        return next((one for one in self.route.steps[self.at :] if one.kind == "fly"), None)


def strangers(arrivals_per_s: NDArray[np.float64], charging_s: NDArray[np.float64], begin_s: float, seed: int, horizon_s: float = HORIZON_S) -> list[list[tuple[float, float]]]:  # fmt: skip
    """Draw other drones at each station until a horizon: arrivals and charging times; from `WARM_UP_S` before on, so that pads are as busy as usual.

    The rates and mean times of the hours from then on have the shape (stations, hours); one hour stands for all.
    """
    rng = np.random.default_rng(seed)
    hours = int((WARM_UP_S + horizon_s) / S_PER_H)
    drawn = []
    for rates, means in zip(arrivals_per_s, charging_s, strict=True):
        count = rng.poisson(np.broadcast_to(rates, hours) * S_PER_H)
        hour = np.repeat(np.arange(hours), count)
        times = np.sort(begin_s - WARM_UP_S + S_PER_H * (hour + rng.uniform(size=len(hour))))
        lasts = rng.exponential(np.broadcast_to(means, hours)[hour])
        drawn.append(list(zip(times.tolist(), lasts.tolist(), strict=True)))
    return drawn


def carry_out(
    routes: Sequence[Route],
    ready_s: Mapping[str, float],
    pads: Mapping[str, int],
    others: Mapping[str, list[tuple[float, float]]],
    begin_s: float,
    truth: Truth | None = None,
    reserve: float = 0.0,
    horizon_s: float = HORIZON_S,
) -> Outcome:
    """Let all drones fly their routes, in order of time; each charge waits for the first free pad.

    With a truth flights have their actual time and charge, and charging continues to the requirement of the check before the next take-off. A drone with less at a take-off charges
    first, and waits for better wind if no charge is sufficient, as the supervisor of a flight does. A drone whose charge does not last is lost with its packages.
    """
    drones = [_Drone(route, route.steps[0].soc_begin if route.steps else 1.0) for route in routes]
    events: list[tuple[float, int, int, float]] = []  # time, drone (-1: another one), station number, duration
    free = {station: [-np.inf] * count for station, count in pads.items()}
    names = list(pads)
    for number, station in enumerate(names):
        for come_s, lasts_s in others.get(station, []):
            heapq.heappush(events, (come_s, -1, number, lasts_s))
    for number, route in enumerate(routes):
        if route.steps:
            heapq.heappush(events, (begin_s, number, 0, 0.0))
    done = Outcome({}, {})
    while events:
        time_s, whose, where, lasts_s = heapq.heappop(events)
        if whose < 0:
            queue = free[names[where]]
            heapq.heapreplace(queue, max(queue[0], time_s) + lasts_s)
            continue
        drone = drones[whose]
        step = drone.step
        carried = step.order is not None and step.phase == "with the package"
        if step.order is not None and carried and not drone.begun() and time_s < ready_s[step.order]:
            heapq.heappush(events, (ready_s[step.order], whose, 0, 0.0))  # others may come before
            continue
        wanted = _wanted(drone, time_s, truth, reserve)
        short = truth is not None and wanted > drone.soc + SLACK_SOC and step.origin in free
        if step.kind == "charge" or (short and wanted <= 1.0 + SLACK_SOC):
            time_s = _on_a_pad(done, free[step.origin], step, time_s, _charge(drone, wanted, truth))
            if step.kind != "charge":  # the flight is checked again then
                heapq.heappush(events, (time_s, whose, 0, 0.0))
                continue
        else:
            length_s, takes = (step.end - step.begin).total_seconds(), 0.0
            if truth is not None:
                length_s, takes = truth.flight(drone.route.drone, step, time_s)
            if short or not length_s < math.inf:
                if time_s < begin_s + horizon_s:
                    heapq.heappush(events, (time_s + AGAIN_S, whose, 0, 0.0))
                continue
            time_s += length_s
            drone.soc -= takes
            if truth is not None:
                done.lowest.append(drone.soc)
                if drone.soc < 0.0:
                    continue
        if step.order is not None and carried:
            done.delivered_s[step.order] = time_s
        drone.at += 1
        if drone.at < len(drone.route.steps):
            heapq.heappush(events, (time_s, whose, 0, 0.0))
    return _whole(done, routes, drones)


def _on_a_pad(done: Outcome, free: list[float], step: Step, time_s: float, length_s: float) -> float:
    """Take the first pad that is free for the duration, and count the wait; returns when the charge is done."""
    if not length_s > 0.0:
        return time_s
    start_s = max(free[0], time_s)
    heapq.heapreplace(free, start_s + length_s)
    if step.order is not None:
        done.waited_s[step.order] = done.waited_s.get(step.order, 0.0) + start_s - time_s
    return start_s + length_s


def _wanted(drone: _Drone, time_s: float, truth: Truth | None, reserve: float) -> float:
    """Charge required by the check before the next take-off; none without a flight."""
    flight = drone.next_flight()
    return 0.0 if truth is None or flight is None else reserve + truth.wanted(drone.route.drone, flight, time_s)


def _charge(drone: _Drone, wanted: float, truth: Truth | None) -> float:
    """Charging time of a drone; its charge becomes that at departure."""
    step = drone.step
    if truth is None:
        return (step.end - step.begin).total_seconds()
    planned = step.soc_end if step.kind == "charge" else 0.0
    up_to = max(planned, min(wanted, 1.0)) if wanted < math.inf else planned
    if up_to <= drone.soc + SLACK_SOC:
        return 0.0
    length_s = truth.charging_s(drone.route.drone, step.origin, drone.soc, up_to)
    drone.soc = up_to
    return length_s


def _whole(done: Outcome, routes: Sequence[Route], drones: Sequence[_Drone]) -> Outcome:
    """Omit orders that were carried only a part of their way."""
    for route, drone in zip(routes, drones, strict=True):
        for step in route.steps[drone.at :]:
            if step.order is not None and step.phase == "with the package":
                done.delivered_s.pop(step.order, None)
    return done
