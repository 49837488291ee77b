"""What a drone in the air can still reach: straight flights from any point, under every member of the forecast.

The wind is that at the middle of each straight flight, slot by slot (`models.flight.kernels.cross`).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.airspace.ways import columns, level_flights, level_ways
from skyway.models.base import geodesy
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.heights import above_factors, cleared_grounds_m, wind_factors
from skyway.models.flight.kernels import airborne_times
from skyway.models.flight.rules import STEP_MPS2, air_between
from skyway.models.flight.way_heights import level_over_m, straight_ways, way_heights, way_steps
from skyway.models.wind.triangle import along_across
from skyway.planner.parameters.planner import USUAL
from skyway.planner.reach.wind_ahead import drifted_s, slower_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.models.drones.drone import Drone
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.flight.rules import SegmentWind
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.felt_gust import FeltGust
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.online import OnlineParameters
    from skyway.planner.reach.wind_ahead import WindAhead

SOC_SD = 0.005
"""Of a state of charge as vehicles tell it, that landings are judged by."""
MIN_LOAD = 0.6
"""Power over that of hover is nowhere less in forward flight (`models.drones.airspeed_load`)."""
NEAREST = 60
"""So many stations about a place are looked at."""
_NO_LIFT = np.zeros(1), np.zeros(1)
_NEVER_SOC = 10.0
"""Ten full batteries: what a way over unknown ground is taken to cost."""
MOST = 0.5
"""Least probability of the members in which the wind lets a drone fly, for these alone to count."""
DIVERT_S = 1800.0
"""A divert has landed by then: zones that become active later do not count."""
Place = tuple[float, float]
"""Latitude and longitude, degrees."""


class Flown(NamedTuple):
    """Flights in every member of the forecast, shape (members, n) each."""

    time_s: NDArray[np.float64]
    """How long they take."""
    soc: NDArray[np.float64]
    """Charge that they take by the model, without the factor that is believed."""
    doubt: NDArray[np.float64]
    """Standard deviation of that because the wind ahead is not quite known; 0 where nothing is said of it."""


class Reach:
    """Flights of one drone, with a package, from wherever it is, by a forecast at any height.

    The belief is how its energy differs from the model's, `load` how its power changes with airspeed; by default it
    does not. The planned airspeed is by default the drone's cruise airspeed. A real flight is `watched`: it takes
    `manoeuvres_s` longer, most of it before the touch-down. Its wind is known as `ahead` says; without that it is what the members say. A
    drone in the air clears ground up to `cleared_m` above sea level by the cruise height: it comes no lower before it lands.
    """

    def __init__(
        self,
        scenario: Scenario,
        forecast: WindEnsemble,
        drone: Drone,
        payload_kg: float,
        belief: EnergyBelief,
        *,
        airspeed_mps: float | None = None,
        load: AirspeedLoad | None = None,
        parameters: OnlineParameters = USUAL.online,
        watched: bool = False,
        cleared_m: float = -math.inf,
        ahead: WindAhead | None = None,
    ) -> None:
        self.load, self.parameters = load, parameters
        self.network, self.rules = scenario.network, scenario.rules
        self.wind = forecast.at_height(self.rules.cruise_height_m, self.rules.wind_profile_exponent)
        self.drone, self.belief, self.cleared_m = drone, belief, cleared_m
        self.airspeed_mps = airspeed_mps if airspeed_mps is not None else drone.cruise_airspeed_mps
        self.power = power = FlightPower.of(drone, payload_kg)
        self.soc_per_s = power.soc_per_s
        manoeuvres_s = parameters.manoeuvres_s if watched else 0.0
        self.ahead = ahead
        self._soc_sd = SOC_SD if watched else 0.0
        self.descent_s = self.rules.descent_s + manoeuvres_s
        self.soc_climb = power.soc_climb(self.rules.climb_s)
        self.soc_descent = power.soc_descent(self.rules.descent_s) + power.soc_per_s * manoeuvres_s
        self.pads = np.flatnonzero(self.network.pads > 0)

    def winds(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Wind of every member at places and times, at cruise height: (north, east), shape (members, n) each.

        `time_s` has shape (n,) or (members, n).
        """
        return self.wind.at_times(lat, lon, time_s)

    def at_airspeed(self, airspeed_mps: float) -> Reach:
        """Return the same at another planned airspeed."""
        same = copy(self)
        same.airspeed_mps = airspeed_mps
        return same

    def flying_over(self, cleared_m: float) -> Reach:
        """Return the same where ground of a height is cleared by the cruise height."""
        same = copy(self)
        same.cleared_m = max(cleared_m, self.cleared_m)
        return same

    def cleared_on(self, way: Sequence[Place]) -> float:
        """Ground that the highest part of a way of a leg clears by the cruise height, above sea level."""
        ground_m = self.network.ground_at_m(*np.array(way).T)
        least = self.network.least_at(way)
        if self.network.over is None and least is None:
            return float(ground_m.max())
        heights = way_heights(way, ground_m.tolist(), self.rules.cruise_height_m, self.network.over, least)
        top_m = heights.top_height_m - self.rules.cruise_height_m
        return top_m if math.isfinite(top_m) else float(ground_m.max())

    def factor_at(self, place: Place) -> float:
        """Wind at a place as high as it flies there now, over that at cruise height."""
        ground_m = self.network.ground_at_m(*place)
        above_m = np.maximum(ground_m, self.cleared_m)
        return float(wind_factors(self.rules, (ground_m, ground_m), (above_m, above_m))[0])

    def _cruise(
        self, start: tuple[NDArray[np.float64], NDArray[np.float64]], bearing: NDArray[np.float64],
        length_m: NDArray[np.float64], time_s: ArrayLike, factor: NDArray[np.float64], *, in_turn: bool,
    ) -> Flown:  # fmt: skip
        """Fly straight at the planned airspeed, with at least 1 m/s over the ground; no climb, no descent.

        Each flight alone from `time_s` on, a time or shape (n,), or one after the other from a time on. Limits of the wind do not count: whoever is in the air has
        to fly on.
        """
        middle = geodesy.midpoint(*start, bearing, length_m)
        most = self.drone.max_ground_speed_mps
        air = air_between(self.wind, middle, bearing, length_m, self.airspeed_mps, most, factor)
        begin_s = np.full(len(length_m), time_s, dtype=np.float64)
        flight_s = airborne_times(air, begin_s, in_turn)
        share, gust = np.zeros_like(length_m), self.wind.gust
        if gust is not None:
            mean_s = self.expected(flight_s)
            off_s = begin_s + (np.cumsum(mean_s) - mean_s if in_turn else 0.0)
            share = factor * gust.share_of(start, length_m, off_s, mean_s)
            flight_s = airborne_times(_gusty(air, gust, share), begin_s, in_turn)
        doubt = np.zeros_like(flight_s)
        if self.load is None and self.ahead is None:
            return Flown(flight_s, self.soc_per_s * flight_s, doubt)
        half_s = 0.5 * flight_s + (np.cumsum(flight_s, axis=1) - flight_s if in_turn else 0.0)
        north, east = self.winds(*middle, begin_s + half_s)
        north, east = factor * north, factor * east
        if gust is not None:
            north, east = north + share * gust.north_mps, east + share * gust.east_mps
        along, across = along_across(north, east, air.cos_bearing, air.sin_bearing)
        soc_per_s = np.full_like(flight_s, self.soc_per_s)
        if self.load is not None:  # a drone that must not be faster over the ground flies slower through the air
            speed = np.divide(length_m, flight_s, out=np.full_like(flight_s, most), where=flight_s > 0.0)
            soc_per_s *= self.load.factor(np.hypot(speed - along, across))
        if self.ahead is not None:
            end_m = np.cumsum(length_m) if in_turn else length_m
            whole_s = flight_s.sum(axis=1, keepdims=True) if in_turn else flight_s
            speed_mps = np.hypot(north, east)
            sd_mps = self.ahead.sd_mps(end_m - length_m, end_m, speed_mps, self.expected(whole_s))
            given = length_m, (along, across), self.airspeed_mps, most, sd_mps
            doubt = soc_per_s * np.hypot(slower_s(*given), drifted_s(*given))  # the components are independent
        return Flown(flight_s, soc_per_s * flight_s, doubt)

    def to_stations(self, here: Place, time_s: float, nodes: NDArray[np.int64]) -> Flown:
        """Fly from a point at cruise height to touch-down at stations."""
        return self.all_to_stations([here], np.array([time_s]), nodes)

    def all_to_stations(self, places: Sequence[Place], times_s: NDArray[np.float64], nodes: NDArray[np.int64]) -> Flown:
        """Fly from each of some points at cruise height, from its time on, to touch-down at each of some stations, shape (members, points * stations)."""
        count = len(nodes)
        here = np.repeat(np.array(places), count, axis=0)
        start, time_s = (here[:, 0], here[:, 1]), np.repeat(times_s, count)
        lat, lon = (np.tile(one[nodes], len(places)) for one in (self.network.lat, self.network.lon))
        length, bearing = geodesy.inverse(*start, lat, lon)
        begin_m = np.concatenate([self.network.ground_at_m(*place) for place in places])
        ground_m = np.repeat(begin_m, count), np.tile(self.network.ground_m[nodes], len(places))
        above_m = np.maximum(np.maximum(*ground_m), self.cleared_m)
        factor = wind_factors(self.rules, ground_m, (above_m, above_m))
        over, lift = self.network.over, _NO_LIFT
        if over is not None:  # climbs to the least level that clears the way, and goes on at it
            levels = [level_over_m(place, lat[:count], lon[:count], over) for place in places]
            level_m = np.maximum(np.concatenate(levels), self.cleared_m + over.cruise_height_m)
            factor = above_factors(self.rules, level_m - 0.5 * (ground_m[0] + ground_m[1]))
            lift = self._lift(
                level_m - ground_m[0] - over.cruise_height_m, level_m - ground_m[1] - over.cruise_height_m
            )
        flown = self._cruise(start, bearing, length, time_s, factor, in_turn=False)
        return Flown(flown.time_s + self.descent_s + lift[0], flown.soc + self.soc_descent + lift[1], flown.doubt)

    def _lift(
        self, up_m: NDArray[np.float64], down_m: NDArray[np.float64], stops: ArrayLike = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Seconds and charge of climbs and descents beyond those of the cruise height, and of stops for them; over unknown ground nothing can be flown."""
        climb_s, descent_s = (
            np.maximum(up_m, 0.0) / self.rules.climb_rate_mps,
            np.maximum(down_m, 0.0) / self.rules.descent_rate_mps,
        )
        stopped_s = np.asarray(stops) * self.drone.max_ground_speed_mps / STEP_MPS2
        time_s = np.nan_to_num(climb_s + descent_s + stopped_s)
        soc = self.power.climb_w * climb_s + self.power.descent_w * descent_s + self.power.cruise_w * stopped_s
        return time_s, np.nan_to_num(soc / self.power.battery_j, nan=_NEVER_SOC)

    def along(self, points: Sequence[Place], time_s: float) -> Flown:
        """Fly along a way: to each of its points after the first, shape (members, points - 1); no climb, no descent but those of steps."""
        flown, lift = self.pieces(points, time_s)
        return Flown(*(np.cumsum(one, axis=1) for one in (flown.time_s + lift[0], flown.soc + lift[1], flown.doubt)))

    def pieces(
        self, points: Sequence[Place], time_s: float
    ) -> tuple[Flown, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return the cruise over each piece of a way, and seconds and charge of the steps of each over terrain."""
        places = np.array(points)
        length, bearing = geodesy.inverse(places[:-1, 0], places[:-1, 1], places[1:, 0], places[1:, 1])
        ground_m = self.network.ground_at_m(*places.T)
        above_m = np.maximum(cleared_grounds_m(ground_m.tolist()), self.cleared_m)
        factor, lift = wind_factors(self.rules, (ground_m[:-1], ground_m[1:]), (above_m[:-1], above_m[1:])), _NO_LIFT
        if self.network.over is not None:
            steps = way_steps(points, self.network.over)
            factor, lift = (
                above_factors(self.rules, steps.mean_above_m),
                self._lift(steps.up_m, steps.down_m, steps.stops),
            )
        return self._cruise((places[:-1, 0], places[:-1, 1]), bearing, length, time_s, factor, in_turn=True), lift

    def ends(self, way: Sequence[Place]) -> tuple[tuple[float, float], tuple[float, float]]:
        """Seconds and charge of the climb with which a way begins on the ground, and of the descent with which it ends."""
        begin_s, begin_soc, end_s, end_soc = self.rules.climb_s, self.soc_climb, self.descent_s, self.soc_descent
        if self.network.over is not None:
            steps = way_steps(way, self.network.over)
            cruise_m = self.network.ground_at_m(*np.array((way[0], way[-1])).T) + self.network.over.cruise_height_m
            lift_s, lift_soc = self._lift(
                np.array([steps.begin_m - cruise_m[0], 0.0]), np.array([0.0, steps.end_m - cruise_m[1]])
            )
            begin_s, begin_soc = begin_s + float(lift_s[0]), begin_soc + float(lift_soc[0])
            end_s, end_soc = end_s + float(lift_s[1]), end_soc + float(lift_soc[1])
        return (begin_s, begin_soc), (end_s, end_soc)

    def to_the_end(self, way: Sequence[Place], time_s: float, *, climbs: bool = False) -> Flown:
        """Fly a way to touch-down at its end, shape (members,): with a climb first where it begins on the ground."""
        begin, (descent_s, descent_soc) = self.ends(way)
        climb_s, climb_soc = begin if climbs else (0.0, 0.0)
        flown = self.along(way, time_s + climb_s)
        soc = flown.soc[:, -1] + climb_soc + descent_soc
        return Flown(flown.time_s[:, -1] + climb_s + descent_s, soc, flown.doubt[:, -1])

    def ground_speed_mps(self, way: Sequence[Place], distance_m: float, time_s: float) -> float:
        """Mean ground speed of the planned airspeed along a way of a length, at most the drone's greatest."""
        cruise_s = float(self.expected(self.pieces(way, time_s)[0].time_s.sum(axis=1)))
        return min(distance_m / max(cruise_s, 1.0), self.drone.max_ground_speed_mps)

    def mean_load(self, way: Sequence[Place], time_s: float) -> float:
        """Power over that of the model, averaged over the cruise of a way."""
        flown = self.pieces(way, time_s)[0]
        time_mean = float(self.expected(flown.time_s.sum(axis=1)))
        return float(self.expected(flown.soc.sum(axis=1))) / (self.soc_per_s * time_mean) if time_mean > 0.0 else 1.0

    def p_below(
        self, soc: float, cost: NDArray[np.float64], floor_soc: float, doubt: ArrayLike = 0.0
    ) -> NDArray[np.float64]:
        """Probability of landing below a charge, over members and energy, shape (n,); `cost` and `doubt` as of `Flown`, shape (members, n)."""
        return np.asarray(np.einsum("m,m...->...", self.wind.probability, self.below(soc, cost, floor_soc, doubt)))

    def below(
        self, soc: float, cost: NDArray[np.float64], floor_soc: float, doubt: ArrayLike = 0.0
    ) -> NDArray[np.float64]:
        """Probability of landing below a charge in each member, shape of `cost`."""
        from scipy.special import ndtr

        wind = self.belief.mean_ratio * np.asarray(doubt)
        spread = np.maximum(np.sqrt((cost * self.belief.sd_between) ** 2 + wind**2 + self._soc_sd**2), 1e-9)
        return np.asarray(
            ndtr(self.belief.normal_deviate((cost * self.belief.mean_ratio - (soc - floor_soc)) / spread))
        )

    def expected(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean over the members of something of shape (members, …)."""
        return np.asarray(np.einsum("m,m...->...", self.wind.probability, values))

    def soc_sd(self, flown: Flown) -> float:
        """Standard deviation of the charge that a flight takes: the members', the energy's and that of the wind ahead together."""
        mean, ratio = float(self.expected(flown.soc)), self.belief.mean_ratio
        members = max(float(self.expected(flown.soc**2)) - mean**2, 0.0)
        ahead = float(self.expected(flown.doubt**2))
        return math.sqrt((members + ahead) * ratio**2 + (mean * self.belief.sd_between) ** 2 + self._soc_sd**2)

    def pads_near(self, places: Sequence[Place], soc: float) -> NDArray[np.int64]:
        """Return stations with pads that can at best be flown to from any of some places with so much charge: the nearest ones of each."""
        most_m = soc / (MIN_LOAD * self.soc_per_s) * self.drone.max_ground_speed_mps
        lat, lon = self.network.lat[self.pads], self.network.lon[self.pads]
        near = np.zeros(len(self.pads), dtype=bool)
        here = np.array(places)[:, :, None]
        for distance_m in geodesy.coarse_distance_m(here[:, 0], here[:, 1], lat, lon):
            nearest = np.argpartition(distance_m, NEAREST - 1)[:NEAREST] if len(distance_m) > NEAREST else slice(None)
            near[nearest] |= distance_m[nearest] <= geodesy.COARSE * most_m
        return np.asarray(self.pads[near])

    def clear(self, here: Place, nodes: NDArray[np.int64], from_s: float) -> NDArray[np.bool_]:
        """Whether the straight way to each station, and the descent there, come into no zone that is closed then, shape (n,).

        Within `DIVERT_S` from a time on, POSIX seconds.
        """
        zones = self.network.zones
        free = np.ones(len(nodes), dtype=bool)
        if zones is None:
            return free
        lat, lon, ground_m = self.network.lat[nodes], self.network.lon[nodes], self.network.ground_m[nodes]
        cruise_m = self.rules.cruise_height_m
        if self.network.over is None:
            above_m = np.maximum(self.network.ground_at_m(*here), self.cleared_m)
            ways = (
                level_flights((*here, lat, lon), (above_m, ground_m), cruise_m),
                columns(lat, lon, ground_m, cruise_m),
            )
        else:
            below = straight_ways(here, lat, lon, self.network.over)
            level_m = np.maximum(below.level_m, self.cleared_m + cruise_m)
            grounds = below.low_ground_m, below.high_ground_m
            ways = (
                level_ways((*here, lat, lon), level_m, grounds),
                columns(lat, lon, ground_m, level_m - ground_m),
            )
        for part in ways:
            free[[one.way for one in zones.conflicts(part, from_s, from_s + DIVERT_S)]] = False
        return free

    # Legs

    def where_flown(self, way: Sequence[Place], time_s: float) -> Reach:
        """Return the same for those members alone in which the wind along this way, or at this place, lets the drone fly now.

        In the others it waits on the ground, or would not have come here. Where these are the more probable ones, the wind is about the
        limit or above it, and all count: the few that are below by a hair would be outliers.
        """
        places = np.array(way)
        north, east = self.winds(places[:, 0], places[:, 1], np.full(len(places), time_s))
        open_now = np.hypot(north, east).max(axis=1) <= self.drone.wind_limit_mps
        return self.in_members(open_now) if float(self.wind.probability @ open_now) >= MOST else self

    def in_members(self, count: NDArray[np.bool_]) -> Reach:
        """Return the same for those members of the forecast alone that count; where none does, all do."""
        if not float(self.wind.probability @ count) > 0.0:
            return self
        same = copy(self)
        same.wind = self.wind.weighted(count.astype(np.float64))
        return same

    def measured_before(self, age_s: float) -> Reach:
        """Return the same for a flight before which the wind was measured so long ago; NaN: it never was."""
        if self.ahead is None or not age_s > 0.0:
            return self
        same = copy(self)
        same.ahead = replace(self.ahead, age_s=age_s)
        return same

    def way(self, origin: str | Place, via: Sequence[str], destination: str) -> list[Place]:
        """Return the points of a leg: where it begins, stations overflown, its end."""
        index, lat, lon = self.network.index, self.network.lat, self.network.lon
        first = (float(lat[index[origin]]), float(lon[index[origin]])) if isinstance(origin, str) else origin
        return [first, *((float(lat[index[s]]), float(lon[index[s]])) for s in (*via, destination))]


def _gusty(air: SegmentWind, gust: FeltGust, share: NDArray[np.float64]) -> SegmentWind:
    """Return the same with a share of a gust in the wind of each flight, as a site of its own."""
    one_more = (*air.north.shape[:2], 1)
    north, east = (
        np.concatenate((wind, np.full(one_more, more)), axis=2)
        for wind, more in ((air.north, gust.north_mps), (air.east, gust.east_mps))
    )
    return air._replace(north=north, east=east, weight=np.column_stack((air.weight, share)))
