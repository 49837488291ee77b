"""Audit: every answer is recomputed by independent code before it is returned; a difference is an error.

The claim is a composition: legs and stops with times and states of charge. From each claimed take-off the leg is
flown, from each claimed landing the stop is spent, and the next claim must match; so errors neither accumulate nor hide
each other. The decisions (segments, charges, earliest take-offs) must be in the claim, the totals must equal its sums, and
the searches with perfect information must keep the reserve at every landing and arrive at their claimed time.

The code of the searches is not used here: the wind triangle, the walk through the slots of the wind, energy by phases of flight
and the charging curve in closed form are written out again, in plain Python. Only data are read: the network, the wind
over its segments, the rules, the drone's power and the times of the queues. The schedule of a composition is one in the wind of
one member of the forecast and one set of queues (`Realization`); under gusts and an energy different from the model's, only
its own sums can be compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.airspace.ways import chosen, together
from skyway.models.base.errors import AuditError
from skyway.models.drones.charging import ChargingCurve
from skyway.models.flight.weather_closures import weather_closures
from skyway.models.network.zoned import flown_ways
from skyway.models.queues.opening_hours import opening_hours
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS, height_factor

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService, Stop
    from skyway.models.network.station import Station
    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary, Leg

TIME_TOLERANCE_S = 0.02
"""Times are stated to the millisecond; the kernels keep 0.1 ms from the boundaries of slots and 1 ms from other drones."""
SOC_TOLERANCE = 1e-5
CURVE_TOLERANCE = 2.5e-4
"""SoC: the planners charge along 24 chords of the curve, which lie at most 0.00011 below it at either end of a charge."""
SPEED_TOLERANCE_MPS = 0.05
_EDGE_S = 2e-3
"""Slots that a flight touches for less than this are not counted: the take-off is stated to the millisecond."""


@dataclass(frozen=True, eq=False)
class Realization:
    """Realization in which the schedule of a composition was flown."""

    member: int
    """Of the forecast."""
    queues: Mapping[int, QueuePath] | None
    """At the node of each stop; None: the schedule has gusts, and is not flown again."""
    arrival_s: float | None = None
    """Arrival claimed by a search with perfect information, POSIX seconds."""


def audit(composition: Composition, problem: Problem, itinerary: Itinerary, realization: Realization) -> None:
    """Fly a composition and compare; an `AuditError` names the planner, the leg, and the figures claimed and flown."""
    one = _Audit(composition, problem, itinerary, realization)
    one.decisions()
    one.schedule()
    one.sums()
    if realization.arrival_s is not None:
        one.proven(realization.arrival_s)


class _Audit:
    """Audit of one composition; see `audit`."""

    def __init__(
        self, composition: Composition, problem: Problem, itinerary: Itinerary, realization: Realization
    ) -> None:
        self.composition, self.problem, self.itinerary, self.realization = composition, problem, itinerary, realization
        self.begin_s, self.soc = problem.request.state.time.timestamp(), problem.request.state.soc
        mass_kg = problem.drone.mass_kg + composition.payload_kg
        self.rates = self._rates(mass_kg)
        self._speeds: dict[tuple[int, int], float] = {}
        self._weather = weather_closures(problem.ensemble, problem.drone, problem.rules)
        origin = problem.network.stations[problem.origin].id
        stops = list(composition.stops)
        first = stops.pop(0) if len(stops) == len(itinerary) and stops[0].station == origin else None
        self.stops: list[Stop | None] = [first, *stops]

    def _rates(self, mass_kg: float) -> tuple[float, float, float]:
        """SoC per second in climb, cruise and descent."""
        drone = self.problem.drone
        climb, cruise, descent = (drone.energy_model.power_w(mass_kg, p) for p in ("climb", "cruise", "descent"))
        return climb / drone.battery_j, cruise / drone.battery_j, descent / drone.battery_j

    def _differ(self, number: int | None, what: str, claimed: object, flown: object) -> AuditError:
        return AuditError(self.composition.planner, number, what, claimed, flown)

    def _near(self, number: int | None, what: str, claimed: float, flown: float, tolerance: float) -> None:
        if not abs(claimed - flown) <= tolerance:  # also if either is not a number
            raise self._differ(number, what, claimed, flown)

    def decisions(self) -> None:
        """Compare legs and stops with the decisions: segments, charges, earliest take-offs."""
        network, services = self.problem.network, self.composition.services
        if len(services) != len(self.itinerary) or len(self.stops) != len(self.itinerary) or not services:
            counts = f"{len(services)} legs, {len(self.composition.stops)} stops"
            raise self._differ(None, "legs", counts, f"{len(self.itinerary)} decided")
        node = self.problem.origin
        for number, (service, leg) in enumerate(zip(services, self.itinerary, strict=True), 1):
            passed = [network.stations[node].id]
            for segment in leg.segments:
                if int(network.tail[segment]) != node:
                    raise self._differ(number, "segment", service.id, f"segment {segment} begins elsewhere")
                node = int(network.head[segment])
                passed.append(network.stations[node].id)
            claimed = [service.origin, *service.via, service.destination]
            if claimed != passed or not leg.segments:
                raise self._differ(number, "route", " > ".join(claimed), " > ".join(passed))
            length = sum(float(network.distance_m[segment]) for segment in leg.segments)
            self._near(number, "distance, m", service.distance_m, length, 0.01)
            if leg.charge_to is not None and service.soc_depart < leg.charge_to - SOC_TOLERANCE:
                raise self._differ(number, "charge decided", service.soc_depart, leg.charge_to)
            if service.depart.timestamp() < leg.not_before_s - TIME_TOLERANCE_S:
                raise self._differ(number, "take-off decided, POSIX s", service.depart.timestamp(), leg.not_before_s)
        if node != self.problem.destination:
            raise self._differ(len(services), "destination", services[-1].destination, network.stations[node].id)

    def schedule(self) -> None:
        """Spend each stop from the landing before it and fly each leg from its take-off."""
        time_s, soc, joined_s = self.begin_s, self.soc, self.begin_s
        node = self.problem.origin
        for number, (stop, service, leg) in enumerate(
            zip(self.stops, self.composition.services, self.itinerary, strict=True), 1
        ):
            self._stop(number, stop, node, (time_s, joined_s), soc, service)
            node = int(self.problem.network.head[leg.segments[-1]])
            joined_s = self._flight(number, service, leg, node)
            time_s, soc = service.arrive.timestamp(), service.soc_arrive

    def _stop(
        self, number: int, stop: Stop | None, node: int, landed: tuple[float, float], soc: float, service: DroneService
    ) -> None:
        """Compare the stop before a leg; `landed` is the touch-down and the time when the drone joined the queue there."""
        off_s = service.depart.timestamp()
        if stop is None:
            self._near(number, "take-off, POSIX s", off_s, landed[0], TIME_TOLERANCE_S)
            self._near(number, "SoC at take-off", service.soc_depart, soc, SOC_TOLERANCE)
            return
        if stop.station != self.problem.network.stations[node].id:
            raise self._differ(number, "stop", stop.station, self.problem.network.stations[node].id)
        self._near(number, "beginning of the stop, POSIX s", stop.arrive.timestamp(), landed[0], TIME_TOLERANCE_S)
        self._near(number, "SoC at the beginning of the stop", stop.soc_from, soc, SOC_TOLERANCE)
        self._near(number, "SoC at take-off", service.soc_depart, stop.soc_to, SOC_TOLERANCE)
        spent = stop.wait_s + stop.recharge_s + stop.hold_s
        self._near(number, "take-off, POSIX s", off_s, landed[0] + spent, TIME_TOLERANCE_S)
        parts = {"wait, s": stop.wait_s, "recharge, s": stop.recharge_s, "hold, s": stop.hold_s}
        for what, value in (parts | {"hold for capacity, s": stop.hold_room_s}).items():
            if not -1e-9 <= value <= spent + 1e-9:
                raise self._differ(number, what, value, f"from 0 to {spent:.3f}")
        self._pad(number, stop, node, landed)

    def _pad(self, number: int, stop: Stop, node: int, landed: tuple[float, float]) -> None:
        """Compare wait and charge of a stop."""
        if not stop.soc_to > stop.soc_from + 1e-12:
            self._near(number, "SoC after a stop without charging", stop.soc_to, stop.soc_from, SOC_TOLERANCE)
            self._near(number, "recharge, s", stop.recharge_s, 0.0, TIME_TOLERANCE_S)
            return
        station = self.problem.network.stations[node]
        if station.pads <= 0:
            raise self._differ(number, "recharge, s", stop.recharge_s, f"no pads at {station.id}")
        if self.realization.queues is not None:
            free_s = max(landed[0], float(self.realization.queues[node].pad_time(landed[1])))
            closed_s = self._closed_s(station, free_s, landed[0] + stop.wait_s + stop.recharge_s)
            self._near(number, "wait, s", stop.wait_s, free_s - landed[0] + closed_s, TIME_TOLERANCE_S)
        drone, power_w = self.problem.drone, station.recharge_power_w
        curve = ChargingCurve(drone.recharge_full_s, math.inf if power_w is None else power_w / drone.battery_j)
        charged = float(curve.soc(curve.time_from_empty_s(stop.soc_from) + stop.recharge_s))
        straight = stop.soc_to <= curve.knee_soc
        self._near(number, "charge, SoC", stop.soc_to, charged, SOC_TOLERANCE if straight else CURVE_TOLERANCE)

    def _closed_s(self, station: Station, begin_s: float, end_s: float) -> float:
        """Closed time of a station between two times; it must be open at the first."""
        if not station.open_hours or end_s <= begin_s:
            return 0.0
        closed = opening_hours(station.open_hours).closed_between(self.problem.load.timezone, begin_s, end_s)
        if len(closed) and closed[0, 0] <= begin_s + TIME_TOLERANCE_S and closed[0, 1] > begin_s + TIME_TOLERANCE_S:
            raise self._differ(None, "pad, POSIX s", begin_s, f"{station.id} is closed")
        return float((closed[:, 1] - closed[:, 0]).sum())

    def _flight(self, number: int, service: DroneService, leg: Leg, node: int) -> float:
        """Compare a leg; returns when it joins the queue of the stop it ends at."""
        rules = self.problem.rules
        off_s, soc = service.depart.timestamp(), service.soc_depart
        battery_j = self.problem.drone.battery_j
        self._near(
            number, "energy, J", service.energy_j, (soc - service.soc_arrive) * battery_j, SOC_TOLERANCE * battery_j
        )
        if self.realization.queues is None:
            return service.arrive.timestamp()
        climb, cruise, descent = self.rates
        if number == 1 and self.problem.in_flight:  # no further climb is needed
            off_s, soc = off_s - rules.climb_s, soc + climb * rules.climb_s
        over_s = off_s + rules.climb_s
        left_s = self._cruise(leg.segments, off_s)
        if left_s == math.inf:
            raise self._differ(number, "flight", "flown", "a segment is closed by the wind")
        flown_s = left_s - over_s
        if flown_s > 0.0:
            length_m = sum(float(self.problem.air.distance_m[segment]) for segment in leg.segments)
            self._near(number, "ground speed, m/s", service.ground_speed_mps, length_m / flown_s, SPEED_TOLERANCE_MPS)
        down_s = left_s + rules.descent_s
        soc -= climb * rules.climb_s + cruise * flown_s + descent * rules.descent_s
        spot_s = down_s
        if self.problem.has_pads(node):  # no place to land: it hovers, and keeps its place in the queue
            spot_s = max(down_s, float(self.realization.queues[node].land_time(down_s)))
            soc -= cruise * (spot_s - down_s)
        self._near(number, "touch-down, POSIX s", service.arrive.timestamp(), spot_s, TIME_TOLERANCE_S)
        self._near(number, "SoC at touch-down", service.soc_arrive, soc, SOC_TOLERANCE)
        return down_s

    def _cruise(self, segments: tuple[int, ...], off_s: float) -> float:
        """End of the cruise; infinite if a segment is closed in any slot from take-off to touch-down."""
        air = self.problem.air
        now_s = off_s + self.problem.rules.climb_s
        for segment in segments:
            left_m = float(air.distance_m[segment])
            while True:
                slot = self._slot(now_s)
                speed = self._speed_mps(segment, slot)
                if speed <= 0.0:
                    return math.inf
                ends_s = air.start_s + (slot + 1) * air.slot_s if slot < air.north.shape[1] - 1 else math.inf
                if now_s + left_m / speed <= ends_s:
                    now_s += left_m / speed
                    break
                left_m -= speed * (ends_s - now_s)
                now_s = ends_s
        last = self._slot(now_s + self.problem.rules.descent_s - _EDGE_S)
        touched = range(min(self._slot(off_s + _EDGE_S), last), last + 1)
        open_ = all(self._speed_mps(segment, slot) > 0.0 for slot in touched for segment in segments)
        return now_s if open_ else math.inf

    def _slot(self, time_s: float) -> int:
        air = self.problem.air
        return min(max(math.floor((time_s + 1e-6 - air.start_s) / air.slot_s), 0), int(air.north.shape[1]) - 1)

    def _speed_mps(self, segment: int, slot: int) -> float:
        """Ground speed over a segment in a slot, each computed once."""
        found = self._speeds.get((segment, slot))
        if found is None:
            found = self._speeds[segment, slot] = self._triangle_mps(segment, slot)
        return found

    def _in_closed_zone(self, segment: int, begin_s: float, end_s: float) -> bool:
        """Whether a zone closes a segment, with the climb and descent at its ends, between two times."""
        network = self.problem.network
        if network.zones is None or not len(network.restricted):
            return False
        pair = np.array([[network.tail[segment], network.head[segment]]])
        flown = network.flown
        if flown is not None:
            flown = type(flown)(*(values[[segment]] for values in flown))
        level, climbs = flown_ways(network.stations, pair, network.zones.cruise_height_m, flown)
        landed = np.array([not network.stations[node].flyover for node in pair[0].tolist()])
        return bool(network.zones.conflicts(together(level, chosen(climbs, pair[0][landed])), begin_s, end_s))

    def _triangle_mps(self, segment: int, slot: int) -> float:
        """Ground speed by the law of cosines, 0 if the wind forbids the segment."""
        problem = self.problem
        wind = problem.ensemble
        begin_s = wind.start_s + slot * wind.slot_s
        if self._in_closed_zone(segment, begin_s, begin_s + wind.slot_s):
            return 0.0
        if any(one.begin_s < begin_s + wind.slot_s and one.end_s > begin_s for one in self._weather):
            return 0.0
        factor = height_factor(problem.rules.cruise_height_m, wind.height_m, problem.rules.wind_profile_exponent)
        weight = problem.air.weight[segment].tolist()
        north = factor * sum(
            w * v for w, v in zip(weight, wind.north[self.realization.member, slot].tolist(), strict=True)
        )
        east = factor * sum(
            w * v for w, v in zip(weight, wind.east[self.realization.member, slot].tolist(), strict=True)
        )
        course = math.radians(float(problem.network.bearing_deg[segment]))
        blows, airspeed = math.hypot(north, east), self.composition.airspeed_mps
        off_course = math.atan2(east, north) - course
        rest = airspeed**2 - (blows * math.sin(off_course)) ** 2
        if rest <= 0.0 or blows > problem.drone.wind_limit_mps:
            return 0.0
        speed = blows * math.cos(off_course) + math.sqrt(rest)
        return min(speed, problem.drone.max_ground_speed_mps) if speed >= MIN_GROUND_SPEED_MPS else 0.0

    def sums(self) -> None:
        """Compare the totals with the sums of their parts."""
        composition, tolerance = self.composition, TIME_TOLERANCE_S * (1 + len(self.composition.services))
        landed_s = composition.services[-1].arrive.timestamp()
        self._near(None, "arrival, POSIX s", composition.arrive.timestamp(), landed_s, 0.0)
        self._near(None, "delivery time, s", composition.delivery_time_s, landed_s - self.begin_s, tolerance)
        flown = sum(_seconds(service.depart, service.arrive) for service in composition.services)
        self._near(None, "flight time, s", composition.flight_time_s, flown, tolerance)
        charged = sum(stop.recharge_s for stop in composition.stops)
        self._near(None, "recharge time, s", composition.recharge_time_s, charged, 1e-6)
        waited = landed_s - self.begin_s - flown - charged
        self._near(None, "waiting time, s", composition.wait_time_s, waited, tolerance)
        length = sum(float(self.problem.network.distance_m[s]) for leg in self.itinerary for s in leg.segments)
        self._near(None, "distance, m", composition.distance_m, length, 0.01 * len(composition.services))
        self._near(
            None, "lowest SoC", composition.min_soc, min(service.soc_arrive for service in composition.services), 0.0
        )

    def proven(self, arrival_s: float) -> None:
        """Compare with the answer of a search with perfect information: the arrival, and the reserve kept."""
        composition, problem = self.composition, self.problem
        last = len(composition.services)
        self._near(last, "arrival of the search, POSIX s", arrival_s, composition.arrive.timestamp(), TIME_TOLERANCE_S)
        for number, service in enumerate(composition.services, 1):
            if not service.soc_arrive >= problem.reserve - SOC_TOLERANCE:
                raise self._differ(number, "reserve, SoC", problem.reserve, service.soc_arrive)
        if problem.needs_escape:
            spare = composition.services[-1].soc_arrive - problem.reserve
            least = self._escape_soc(arrival_s)
            if not spare >= least - SOC_TOLERANCE:
                raise self._differ(last, "SoC above the reserve for the way on", spare, least)

    def _escape_soc(self, down_s: float) -> float:
        """Minimum charge to a station from the destination, after the time there, at once or when the wind allows it.

        Without the package, or with it if the charge for that is to be kept.
        """
        problem, air, rules = self.problem, self.problem.air, self.problem.rules
        loaded = problem.keeps_for_package
        climb, cruise, descent = self._rates(problem.drone.mass_kg + (problem.request.payload_kg if loaded else 0.0))
        least = math.inf
        for way in problem.ways_on:
            off_s = down_s + problem.request.dwell_s
            left_s = self._cruise(way, off_s)
            while left_s == math.inf and self._slot(off_s) < air.north.shape[1] - 1:
                off_s = air.start_s + (self._slot(off_s) + 1) * air.slot_s
                left_s = self._cruise(way, off_s)
            flown_s = left_s - off_s - rules.climb_s
            least = min(least, climb * rules.climb_s + cruise * flown_s + descent * rules.descent_s)
        hover_s = problem.request.dwell_s if problem.request.in_air else 0.0
        return least + cruise * hover_s


def _seconds(begin: datetime, end: datetime) -> float:
    return (end - begin).total_seconds()
