"""Sydney's centre in a published study of drones that compete for pads (ICSOC 2025), rebuilt: roofs, requests and queues.

The study's map came from OpenStreetMap and is not stored with it, so roofs are drawn here: 33 sources and 26 blocks of flats about one
centre, 1,210 segments by line of sight, five times as long as they are. Speed, energy, charging, thresholds, pads by roof area, waiting
pads, hovering and the measure of quality are those of the study; packages weigh nothing in it (grams that are taken for kilograms, divided by
1,000). Where it processes first stops before second ones, all drones meet here at all their stops.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SOURCES, FLATS, SEGMENTS = 33, 26, 1210
WITHIN_M, ROOF_M2 = (1200.0, 800.0), 1000.0
"""Greatest distance of sources and of flats from the centre, and the median area of the roofs: chosen so that the
study's rule has about its published results without growth."""
LONGEST_M, STRETCH = 2000.0, 5.0
SPEED_MPS, WH_PER_KM, BATTERY_WH = 16.0, (1.216 / (3600.0 / 9.81 * 1.5) + 0.1 / 57.6) * 1000.0, 68.1
HOVER_W, MOST_HOVERED = 159.01, 0.8
TAU_S = 0.2 * 80.0 * 60.0
"""Charging follows 1 - exp(-t / tau)."""
FINALS = {0.2: 0.33, 0.3: 0.44, 0.4: 0.55, 0.5: 0.66, 0.6: 0.77, 0.7: 0.88, 0.8: 0.99}
"""Final charge by the charge used at which a drone recharges; it must have the final charge at the end, too."""
MIN_S = 60.0


@dataclass(frozen=True)
class City:
    """Roofs, first the sources, then the flats; times and charges of flights between them over segments."""

    time_s: NDArray[np.float64]
    need: NDArray[np.float64]
    before: NDArray[np.int64]
    pads: NDArray[np.int64]
    """Charging pads; there are as many waiting pads."""

    def way(self, begin: int, end: int) -> list[int]:
        """Return the roofs on the shortest way."""
        found = [end]
        while found[-1] != begin:
            found.append(int(self.before[begin, found[-1]]))
        return found[::-1]


@dataclass(frozen=True)
class Request:
    """One delivery, by its own drone, which is fully charged."""

    origin: int
    destination: int
    ready_s: float
    threshold: float


@dataclass(frozen=True)
class Flown:
    """Outcome of a request, beyond its expected way alone."""

    expected_s: float
    expected: float
    late_s: float
    extra: float
    """Charge used beyond that of the expected way."""
    hovered: float
    """Part of it used in hovering, for lack of a pad."""

    @property
    def quality(self) -> float:
        """The study's measure: half time, half charge."""
        score = 1.0 - 0.5 * self.extra / self.expected - 0.5 * self.late_s / self.expected_s
        return min(max(score, 0.0), 1.0)

    @property
    def served(self) -> bool:
        """A request whose drone has waited and hovered is, in the study, not served."""
        return not (self.late_s > 1.0 and self.hovered > 1e-9)


def city(seed: int) -> City:
    """Draw the roofs, and the segments among them."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    rng = np.random.default_rng(seed)
    count = SOURCES + FLATS
    radius = np.where(np.arange(count) < SOURCES, *WITHIN_M) * np.sqrt(rng.uniform(0.0, 1.0, count))
    angle = rng.uniform(0.0, 2.0 * math.pi, count)
    xy = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    height = np.where(np.arange(count) < SOURCES, 80.0, rng.uniform(30.0, 120.0, count))
    far = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    seen = []
    for one in range(count):
        for other in range(one + 1, count):
            over = (far[one] + far[other] - far[one, other] < 1.0) & (height > max(height[one], height[other]))
            over[[one, other]] = False
            if far[one, other] < LONGEST_M and not over.any():
                seen.append((one, other))
    kept = rng.permutation(len(seen))[:SEGMENTS]  # the crossings of segments are unknown without the study's map
    tail, head = np.array([seen[number] for number in kept]).T
    length = csr_array((STRETCH * far[tail, head], (tail, head)), shape=(count, count))
    way_m, before = dijkstra(length, directed=False, return_predecessors=True)
    roof_m2 = np.minimum(rng.lognormal(math.log(ROOF_M2), 0.7, count), 100.0 / 0.064)
    pads = np.maximum((roof_m2 * 0.064 / 2.0 / 2.35**2).astype(np.int64), 2)
    return City(way_m / SPEED_MPS, way_m / 1000.0 * WH_PER_KM / BATTERY_WH, before.astype(np.int64), pads)


def requests(seed: int, each: int) -> list[Request]:
    """Draw a number of requests of each provider within an hour."""
    rng = np.random.default_rng(1000 + seed)
    thresholds = list(FINALS)
    return [
        Request(provider, SOURCES + int(rng.integers(FLATS)), MIN_S * int(rng.integers(60)), float(rng.choice(thresholds)))
        for provider in range(SOURCES)
        for _ in range(each)
    ]  # fmt: skip


def charging_s(soc: float, up_to: float) -> float:
    """Return the charging time, s."""
    return TAU_S * math.log((1.0 - soc) / (1.0 - up_to)) if up_to > soc else 0.0


@dataclass
class _Drone:
    stops: list[tuple[float, float, float]]
    """Stops: flight time to each, charge that it takes, and charge at departure."""
    places: list[int]
    soc: float = 1.0
    at: int = 0
    come_s: float = 0.0
    seen_s: float = 0.0
    hovered: float = 0.0


def expected(town: City, one: Request) -> _Drone:
    """Return where a drone of the study charges on its shortest way, and how much."""
    way, final = town.way(one.origin, one.destination), FINALS[one.threshold]
    legs = [(float(town.time_s[tail, head]), float(town.need[tail, head])) for tail, head in itertools.pairwise(way)]
    soc, used, stops, places, flown_s, taken = 1.0, 0.0, [], [], 0.0, 0.0
    for number, (time_s, need) in enumerate(legs):
        soc, used, flown_s, taken = soc - need, used + need, flown_s + time_s, taken + need
        last = number == len(legs) - 1
        if last or used >= one.threshold or used + legs[number + 1][1] >= one.threshold:
            stops.append((flown_s, taken, max(soc, final)))
            places.append(way[number + 1])
            soc, used, flown_s, taken = max(soc, final), 0.0, 0.0, 0.0
    return _Drone(stops, places)


def alone(town: City, one: Request) -> tuple[float, float]:
    """Return time and charge of the expected way without other drones."""
    drone = expected(town, one)
    soc, time_s, used = 1.0, 0.0, 0.0
    for flown_s, need, up_to in drone.stops:
        soc -= need
        time_s += flown_s + charging_s(soc, up_to)
        used, soc = used + need, up_to
    return time_s, used


def queued(town: City, given: list[Request], first: Callable[[float, float], float]) -> tuple[list[Flown], float]:
    """Simulate the study's rule: the drone with the least `first` of its wait and its charging time, both in minutes, gets the next pad.

    A drone without a pad waits on a waiting pad, or hovers. Returns the outcome of each, and the mean wait at a roof in minutes.
    """
    drones = [expected(town, one) for one in given]
    done_s = [0.0] * len(drones)
    queue: dict[int, list[int]] = defaultdict(list)
    busy = dict.fromkeys(range(len(town.pads)), 0)
    congested = 0.0
    since: dict[int, float] = {}
    events = [(one.ready_s + drones[number].stops[0][0], number, True) for number, one in enumerate(given)]
    heapq.heapify(events)
    while events:
        now_s, number, comes = heapq.heappop(events)
        drone = drones[number]
        place = drone.places[drone.at]
        if comes:
            _, need, up_to = drone.stops[drone.at]
            drone.soc -= need
            drone.come_s = drone.seen_s = now_s
            if charging_s(drone.soc, up_to) == 0.0:
                _leave(drone, number, now_s, events, done_s)
                continue
            queue[place].append(number)
        else:
            busy[place] -= 1
            _leave(drone, number, now_s, events, done_s)
        while queue[place] and busy[place] < town.pads[place]:
            _hover(drones, queue[place], int(town.pads[place]), now_s)
            chosen = min(queue[place], key=lambda one: (_rank(drones[one], now_s, first), drones[one].come_s))
            queue[place].remove(chosen)
            busy[place] += 1
            up_to = drones[chosen].stops[drones[chosen].at][2]
            heapq.heappush(events, (now_s + charging_s(drones[chosen].soc, up_to), chosen, False))
        if queue[place]:
            since.setdefault(place, now_s)
        elif place in since:
            congested += now_s - since.pop(place)
    found = []
    for number, one in enumerate(given):
        expected_s, use = alone(town, one)
        late_s = max(done_s[number] - one.ready_s - expected_s, 0.0)
        hovered = min(drones[number].hovered, MOST_HOVERED)
        found.append(Flown(expected_s, use, late_s, hovered, hovered))
    return found, congested / MIN_S / len(town.pads)


def _rank(drone: _Drone, now_s: float, first: Callable[[float, float], float]) -> float:
    return first((now_s - drone.come_s) / MIN_S, charging_s(drone.soc, drone.stops[drone.at][2]) / MIN_S)


def _hover(drones: list[_Drone], waiting: list[int], pads: int, now_s: float) -> None:
    """Subtract the charge of hovering since the last call: for all except the first to come, which stand on the waiting pads."""
    for place, number in enumerate(sorted(waiting, key=lambda one: drones[one].come_s)):
        drone = drones[number]
        if place >= pads:
            used = min(HOVER_W * (now_s - drone.seen_s) / 3600.0 / BATTERY_WH, MOST_HOVERED)
            drone.hovered += used
            drone.soc = max(drone.soc - used, 0.0)
        drone.seen_s = now_s


def _leave(
    drone: _Drone, number: int, now_s: float, events: list[tuple[float, int, bool]], done_s: list[float]
) -> None:
    drone.soc = max(drone.soc, drone.stops[drone.at][2])
    drone.at += 1
    if drone.at == len(drone.stops):
        done_s[number] = now_s
    else:
        heapq.heappush(events, (now_s + drone.stops[drone.at][0], number, True))
