"""Plans of a fleet carried out where pads are taken first come, first served, by our drones and by strangers."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.result import Route, Step

HORIZON_S = 12 * 3600.0
AGAIN_S = 600.0
"""A flight that the wind has closed is looked at again so often."""


class Truth(Protocol):
    """What flights and charges really take, where that is not what was planned."""

    def flight(self, drone: str, step: Step, begin_s: float) -> tuple[float, float]:
        """Time of a flight that begins then, s, and the charge that it takes; infinite where the wind has closed it."""
        ...

    def charging_s(self, drone: str, place: str, soc: float, up_to: float) -> float:
        """Time of a charge."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What became of a plan."""

    delivered_s: dict[str, float]
    """When each order was delivered, POSIX seconds; without those that were not."""
    waited_s: dict[str, float]
    """How long its drone waited for pads on the way to it and with it, beside charging."""
    lowest: list[float] = field(default_factory=list)
    """Charge at each landing, where the truth is told."""


@dataclass
class _Drone:
    route: Route
    soc: float
    at: int = 0

    @property
    def step(self) -> Step:
        return self.route.steps[self.at]

    def begun(self) -> bool:
        """Whether the order of this step has been taken up before it."""
        order = self.step.order
        return any(one.order == order and one.phase == "with the package" for one in self.route.steps[: self.at])

    def next_flight(self) -> Step | None:
        return next((one for one in self.route.steps[self.at :] if one.kind == "fly"), None)


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
    ready_s: Mapping[str, float],
    pads: Mapping[str, int],
    others: Mapping[str, list[tuple[float, float]]],
    begin_s: float,
    truth: Truth | None = None,
    reserve: float = 0.0,
) -> Outcome:
    """Let all drones fly their routes, in order of time; each charge waits for the first pad that is free.

    With a truth flights take what they take then, and a charge goes on to what the flight after it takes, so that it lands with the reserve: as
    the supervisor of a flight does before each take-off. A drone whose charge does not last is lost with what it carries.
    """
    drones = [_Drone(route, route.steps[0].soc_begin if route.steps else 1.0) for route in routes]
    events: list[tuple[float, int, int, float]] = []  # time, whose (-1 is a stranger), station number, how long
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
        if step.order is not None and carried and not drone.begun():
            time_s = max(time_s, ready_s[step.order])
        if step.kind == "charge":
            length_s = _charge(drone, time_s, truth, reserve)
            queue = free[step.origin]
            start_s = max(queue[0], time_s)
            heapq.heapreplace(queue, start_s + length_s)
            if step.order is not None:
                done.waited_s[step.order] = done.waited_s.get(step.order, 0.0) + start_s - time_s
            time_s = start_s + length_s
        else:
            length_s, takes = (step.end - step.begin).total_seconds(), 0.0
            if truth is not None:
                length_s, takes = truth.flight(drone.route.drone, step, time_s)
            if not length_s < math.inf:
                if time_s < begin_s + HORIZON_S:
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


def _charge(drone: _Drone, time_s: float, truth: Truth | None, reserve: float) -> float:
    """How long a drone charges; its charge is what it leaves with."""
    step = drone.step
    if truth is None:
        return (step.end - step.begin).total_seconds()
    up_to = step.soc_end
    flight = drone.next_flight()
    if flight is not None:
        takes = truth.flight(drone.route.drone, flight, time_s)[1]
        up_to = max(up_to, min(takes + reserve, 1.0)) if takes < math.inf else up_to
    if up_to <= drone.soc:
        return 0.0
    length_s = truth.charging_s(drone.route.drone, step.origin, drone.soc, up_to)
    drone.soc = up_to
    return length_s


def _whole(done: Outcome, routes: Sequence[Route], drones: Sequence[_Drone]) -> Outcome:
    """Leave out orders that came only a part of their way."""
    for route, drone in zip(routes, drones, strict=True):
        for step in route.steps[drone.at :]:
            if step.order is not None and step.phase == "with the package":
                done.delivered_s.pop(step.order, None)
    return done
