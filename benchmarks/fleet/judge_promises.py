"""Plans of a fleet flown by a simulation that shares no code with the planner, to validate the probabilities of its promises.

Flights go over the shortest ways of the network, segment by segment, in the recorded wind of the day, which changes during the flight, with gusts;
energy is power from the published endurances times a ratio of Student's t distribution; pads charge with constant rate and then with an exponential.
Drones are processes (Python generators) that wait for each other at pads. Before a take-off a drone requires the charge of the flight in the present
wind, times the 0.999 quantile of the energy ratio. In the air, as under supervision, it returns to its origin when the wind has become too strong.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import date, datetime

    from skyway.models.orders.fitting import Work
    from skyway.planner.dispatch.result import Route, Step

EARTH_M = 6_371_008.8
MASS_KG, EMPTY_S, FULL_S, PAYLOAD_KG = 4.69, 38.0 * 60.0, 24.0 * 60.0, 1.45
AIRSPEED_MPS, MOST_MPS, WIND_LIMIT_MPS = 20.0, 20.0, 12.0
LIFT_OFF_S, TOUCH_DOWN_S, ACCELERATION_MPS2 = 3.0, 12.0, 2.0
CLIMB_S = 60.0 / 5.0 + 60.0 / 3.0 + LIFT_OFF_S + TOUCH_DOWN_S + AIRSPEED_MPS / ACCELERATION_MPS2
"""Climb and descent, with the slow parts of both, and accelerating and braking at half the speed."""
GROUND_S = 21.0
"""On the ground before and after a flight."""
BULK_S, WHOLE_S, KNEE = 1.28 * 3600.0, 2.24 * 3600.0, 0.8
GUST_SD = 0.1
"""Standard deviation of the wind over one segment, as a share of it."""
MEAN, BETWEEN, WITHIN, FREEDOM = 0.99, 0.062, 0.06, 15.0
SURE = 3.733
"""The 0.999 quantile of Student's t distribution, in standard deviations."""
WIND_MARGIN = 0.12
"""Margin on the energy of a flight for changes of the wind: the planner's setting `margin`."""
SLOWEST_MPS, SHORT_M = 1.0, 1e-6
AGAIN_S, LONGEST_S, BELOW = 600.0, 12 * 3600.0, 0.005
Wait: TypeAlias = "Iterator[tuple[str, float]]"
Way: TypeAlias = "tuple[float, float, np.ndarray]"
"""A segment of a flight: its length, bearing, and weights of the sites at its middle."""


@dataclass(frozen=True)
class Flight:
    """A flight of a drone."""

    ways: list[Way]
    soc: float
    """At the take-off."""
    rate: float
    """Charge that it uses per second."""
    reserve: float
    may_return: bool
    """Whether its origin is a station with pads, to which it returns when the wind has become too strong."""


@dataclass
class Pads:
    """Pads of one station: a queue, first come, first served."""

    free: int
    line: deque[Wait] = field(default_factory=deque)


class Day:
    """A day of the record, and the conditions of the drones on it."""

    def __init__(self, work: Work, day: date, begin: datetime, seed: int, *, supervised: bool = True) -> None:
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import shortest_path

        self.work, self.begin_s = work, begin.timestamp()
        network = work.scenario.network
        wind = work.scenario.truth(day, begin, 48)
        high = (60.0 / wind.height_m) ** 0.2
        self.wind = np.stack((wind.north[0], wind.east[0]), axis=2) * high  # slots, sites, components
        self.sites = np.stack((wind.site_lat, wind.site_lon), axis=1)
        self.random = np.random.default_rng((seed, 9))
        self.lat_lon = np.array([(one.lat, one.lon) for one in network.stations])
        self.index = {one.id: number for number, one in enumerate(network.stations)}
        far = np.array([self._far(int(a), int(b))[0] for a, b in zip(network.tail, network.head, strict=True)])
        graph = csr_array((far, (network.tail, network.head)), shape=(len(self.index), len(self.index)))
        _, self.before = shortest_path(graph, return_predecessors=True)
        self.pads = {one.id: Pads(one.pads) for one in network.stations if one.pads}
        self.delivered_s: dict[str, float] = {}
        self.landings: list[float] = []
        self.supervised, self.returned = supervised, 0
        self.others = {station: self._strangers(station) for station in self.pads}
        self.now_s = self.begin_s

    def _strangers(self, station: str) -> list[tuple[float, float]]:
        """Arrival times of other drones, and the charging time of each; from two days before on."""
        found: list[tuple[float, float]] = []
        load = self.work.scenario.load
        for hour in range(-48, 13):
            arrivals, stay = load.hourly(self.index[station], self.begin_s + 3600.0 * hour, 1)
            count = int(self.random.poisson(float(arrivals[0]) * 3600.0))
            come_s = self.begin_s + 3600.0 * (hour + self.random.random(count))
            found += zip(come_s.tolist(), self.random.exponential(stay[0], count).tolist(), strict=True)
        return sorted(found)

    def present(self) -> dict[str, int]:
        """Other drones on the pads and in the queue when the day begins, by station."""
        found = {}
        for station, others in self.others.items():
            free, leave = [-math.inf] * self.pads[station].free, []
            for come_s, lasts_s in others:
                if come_s > self.begin_s:
                    break
                leave.append(max(heapq.heappop(free), come_s) + lasts_s)
                heapq.heappush(free, leave[-1])
            found[station] = sum(one > self.begin_s for one in leave)
        return found

    def _far(self, tail: int, head: int) -> tuple[float, float]:
        """Distance and bearing on a sphere, m and radians."""
        (a, b), (c, d) = np.radians(self.lat_lon[[tail, head]])
        x, y = math.cos(c) * math.sin(d - b), math.cos(a) * math.sin(c) - math.sin(a) * math.cos(c) * math.cos(d - b)
        half = math.sin((c - a) / 2) ** 2 + math.cos(a) * math.cos(c) * math.sin((d - b) / 2) ** 2
        return 2.0 * EARTH_M * math.asin(math.sqrt(half)), math.atan2(x, y)

    def ways(self, origin: str, destination: str) -> list[Way]:
        """Segments of a flight."""
        nodes, end = [self.index[destination]], self.index[origin]
        while nodes[-1] != end:
            nodes.append(int(self.before[end, nodes[-1]]))
        found = []
        for head, tail in itertools.pairwise(nodes):
            middle = self.lat_lon[[tail, head]].mean(axis=0)
            far2 = (((self.sites - middle) * (1.0, math.cos(math.radians(middle[0])))) ** 2).sum(axis=1) + 1e-9
            found.append((*self._far(tail, head), (1.0 / far2) / (1.0 / far2).sum()))
        return found[::-1]

    def wind_at(self, weight: np.ndarray, at_s: float) -> np.ndarray:
        """Wind on a segment, m/s to north and east."""
        return np.asarray(weight @ self.wind[min(int((at_s - self.begin_s) // 3600.0), len(self.wind) - 1)])

    def speed(self, way: Way, at_s: float, gust: float = 1.0) -> float:
        """Ground speed on a segment, m/s; a drone in the air does not stand still."""
        _, bearing, weight = way
        north, east = gust * self.wind_at(weight, at_s)
        along, across = north * math.cos(bearing) + east * math.sin(bearing), east * math.cos(bearing) - north * math.sin(bearing)  # fmt: skip
        forward = math.sqrt(max(AIRSPEED_MPS**2 - across**2, 0.0))
        return float(np.clip(forward + along, SLOWEST_MPS, MOST_MPS))

    def expected_s(self, ways: Sequence[Way], at_s: float) -> float:
        """Time over segments in the present wind, without gusts."""
        return float(sum(way[0] / self.speed(way, at_s) for way in ways))

    def prohibited(self, ways: Sequence[Way], at_s: float) -> bool:
        """Whether the wind prohibits to take off."""
        return any(
            math.hypot(*self.wind_at(way[2], at_s)) > WIND_LIMIT_MPS or self.speed(way, at_s) <= SLOWEST_MPS
            for way in ways
        )

    def flown(self, flight: Flight, from_s: float) -> tuple[float, float, bool]:
        """Fly: its end, s, the charge then, and whether it is at the destination; else it has returned.

        On each segment and at each change of the wind, a drone that may return compares its charge with what the rest takes, in the wind that it meets and at
        the power that it measures.
        """
        now_s, soc = from_s + CLIMB_S, flight.soc - flight.rate * CLIMB_S
        behind: list[Way] = []
        ahead, returns = list(flight.ways), False
        while ahead:
            (far_m, bearing, weight), gust = ahead.pop(0), 1.0 + GUST_SD * float(self.random.standard_normal())
            while far_m > SHORT_M:
                way = (far_m, bearing, weight)
                if flight.may_return and not returns and self.should_return(flight, soc, now_s, [way, *ahead], behind):
                    returns, ahead = True, behind[::-1]
                    break
                ends_s = self.begin_s + 3600.0 * (1 + (now_s - self.begin_s) // 3600.0)
                speed = self.speed(way, now_s, gust)
                lasts_s = min(far_m / speed, max(ends_s - now_s, 1e-3))
                flown_m = lasts_s * speed
                far_m, now_s, soc = far_m - flown_m, now_s + lasts_s, soc - lasts_s * flight.rate
                behind.append((flown_m, bearing + math.pi, weight))
        self.returned += returns
        return now_s, soc, not returns

    def should_return(
        self, flight: Flight, soc: float, at_s: float, ahead: Sequence[Way], behind: Sequence[Way]
    ) -> bool:
        """Whether the rest, with the margin for other wind, takes more than is above the reserve, and the way back takes less."""
        onward_s = self.expected_s(ahead, at_s)
        return (
            soc - (1.0 + WIND_MARGIN) * flight.rate * onward_s < flight.reserve
            and self.expected_s(behind, at_s) < onward_s
        )

    def power(self, mass_kg: float) -> float:
        """Share of a battery used per second with a package."""
        growth = math.log(EMPTY_S / FULL_S) / math.log((MASS_KG + PAYLOAD_KG) / MASS_KG)
        return float(((MASS_KG + mass_kg) / MASS_KG) ** growth / EMPTY_S)

    def drone(self, route: Route, reserve: float) -> Wait:
        """Simulate the day of one drone; yields a requested pad, a released one, or a time to sleep until."""
        mass = {one.id: one.mass_kg for one in self.work.orders}
        ready = {one.id: one.ready.timestamp() for one in self.work.orders}
        usual = MEAN + BETWEEN * float(self.random.standard_t(FREEDOM))
        checked = MEAN * (1.0 + math.hypot(WIND_MARGIN, SURE * math.hypot(BETWEEN, WITHIN) / MEAN))
        soc, now_s = route.steps[0].soc_begin, self.begin_s
        taken: set[str] = set()
        last = {one.order: number for number, one in enumerate(route.steps) if one.phase == "with the package"}

        def rate(step: Step) -> float:
            return self.power(mass[step.order] if step.phase == "with the package" and step.order else 0.0)

        def wants(number: int) -> float:
            flight = next((one for one in route.steps[number:] if one.kind == "fly"), None)
            if flight is None:
                return 0.0
            ways = self.ways(flight.origin, flight.destination)
            if self.prohibited(ways, now_s):
                return math.inf
            return reserve + checked * rate(flight) * (CLIMB_S + self.expected_s(ways, now_s))

        for number, step in enumerate(route.steps):
            carried = step.phase == "with the package" and step.order is not None
            if carried and step.order not in taken and step.order is not None:
                taken.add(step.order)
                if now_s < ready[step.order]:
                    now_s = ready[step.order]
                    yield "until", now_s
            while True:
                wanted = wants(number)
                goal = min(wanted, 1.0) if math.isfinite(wanted) else 0.0
                if step.kind == "charge":
                    goal = max(goal, step.soc_end)
                if step.kind == "fly" and (not math.isfinite(wanted) or (wanted > 1.0 and step.origin in self.pads)):
                    if now_s > self.begin_s + LONGEST_S:
                        return
                    now_s += AGAIN_S
                    yield "until", now_s
                    continue
                if goal > soc + 1e-6 and step.origin in self.pads:
                    yield f"pad {step.origin}", now_s
                    now_s = self.now_s
                    now_s, soc = now_s + filled_s(goal) - filled_s(soc), goal
                    yield "until", now_s
                    yield f"left {step.origin}", now_s
                    if step.kind == "fly":
                        continue
                if step.kind == "fly":
                    ratio = max(usual + WITHIN * float(self.random.standard_t(FREEDOM)), 0.2)
                    flight = Flight(
                        self.ways(step.origin, step.destination), soc, ratio * rate(step), reserve,
                        may_return=self.supervised and step.origin in self.pads,
                    )  # fmt: skip
                    now_s, soc, arrived = self.flown(flight, now_s + GROUND_S)
                    self.landings.append(soc)
                    if soc < 0.0:
                        return
                    yield "until", now_s
                    if not arrived:
                        continue
                break
            if carried and step.order is not None and last[step.order] == number:
                self.delivered_s[step.order] = now_s

    def stranger(self, station: str, lasts_s: float) -> Wait:
        """Charge, and leave."""
        yield f"pad {station}", self.now_s
        yield "until", self.now_s + lasts_s
        yield f"left {station}", self.now_s

    def run(self, routes: Sequence[Route], reserve: float) -> None:
        """Simulate the day."""
        todo: list[tuple[float, int, Wait]] = []
        count = 0

        def put(at_s: float, who: Wait) -> None:
            nonlocal count
            count += 1
            heapq.heappush(todo, (at_s, count, who))

        for station, others in self.others.items():
            for come_s, lasts_s in others:
                put(come_s, self.stranger(station, lasts_s))
        for route in routes:
            if route.steps:
                put(self.begin_s, self.drone(route, reserve))
        while todo:
            self.now_s, _, who = heapq.heappop(todo)
            for what, at_s in who:
                word, _, station = what.partition(" ")
                if word == "until":
                    put(at_s, who)
                    break
                pads = self.pads[station]
                if word == "pad":
                    if not pads.free:
                        pads.line.append(who)
                        break
                    pads.free -= 1
                elif pads.line:
                    put(self.now_s, pads.line.popleft())
                else:
                    pads.free += 1


def filled_s(soc: float) -> float:
    """Time from empty to a charge: constant rate, then exponential, cut at the last hundredth."""
    if soc <= KNEE:
        return BULK_S * soc / KNEE
    slow = (1.0 - KNEE) * BULK_S / KNEE
    tail = slow * math.log((1.0 - KNEE) / max(1.0 - soc, 0.05 * (1.0 - KNEE)))
    whole = slow * math.log(1.0 / 0.05)
    return BULK_S + tail * (WHOLE_S - BULK_S) / whole
