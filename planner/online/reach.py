"""What a drone in the air can still reach: straight flights from any point, under every member of the forecast.

A leg is flown only when for every point of it a station is known that could be landed at with a margin, other than the one
that it is flown to. The wind is that at the middle of each straight flight, slot by slot (`models.flight.kernels.cross`).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.heights import cleared_grounds_m, wind_factors
from skyway.models.flight.kernels import airborne_times
from skyway.models.flight.rules import air_between
from skyway.models.wind.triangle import along_across
from skyway.planner.parameters.planner import USUAL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.models.drones.drone import Drone
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.online import OnlineParameters

SOC_SD = 0.005
"""Of a state of charge as vehicles tell it, that landings are judged by."""
Place = tuple[float, float]
"""Latitude and longitude, degrees."""


class Flown(NamedTuple):
    """Flights in every member of the forecast, shape (members, n) each."""

    time_s: NDArray[np.float64]
    """How long they take."""
    soc: NDArray[np.float64]
    """Charge that they take by the model, without the factor that is believed."""


@dataclass(frozen=True, slots=True)
class DivertCover:
    """Divert stations of a leg."""

    stations: tuple[str, ...]
    """Enough that every covered point of the leg has one; those that cover most come first."""
    gap_m: float | None
    """How far along the leg the first point lies that has none; None where all have one."""


class Reach:
    """Flights of one drone from wherever it is.

    Parameters
    ----------
    scenario : Scenario
        Stations, no-fly zones, rules of flight.
    forecast : WindEnsemble
        At any height.
    drone : Drone
        Which flies.
    payload_kg : float
        What it carries.
    belief : EnergyBelief
        How its energy differs from the model's.
    airspeed_mps : float, optional
        Planned airspeed; the drone's cruise airspeed by default.
    load : AirspeedLoad, optional
        How its power changes with airspeed; by default it does not.
    parameters : OnlineParameters
        Of the online policy.
    watched : bool
        A real flight: it takes `manoeuvres_s` longer, most of it before the touch-down, and its wind is not known better than `wind_spread`.
    cleared_m : float
        Ground above sea level that a drone in the air clears by the cruise height: it comes no lower before it lands.
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
    ) -> None:
        self.load, self.parameters = load, parameters
        self.network, self.rules = scenario.network, scenario.rules
        self.wind = forecast.at_height(self.rules.cruise_height_m, self.rules.wind_profile_exponent)
        self.drone, self.belief, self.cleared_m = drone, belief, cleared_m
        self.airspeed_mps = airspeed_mps if airspeed_mps is not None else drone.cruise_airspeed_mps
        self.power = power = FlightPower.of(drone, payload_kg)
        self.soc_per_s = power.soc_per_s
        manoeuvres_s = parameters.manoeuvres_s if watched else 0.0
        self._wind_spread = parameters.wind_spread if watched else 0.0
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

    def factor_at(self, place: Place) -> float:
        """Wind at a place as high as it flies there now, over that at cruise height."""
        ground_m = self.network.ground_at_m(*place)
        above_m = np.maximum(ground_m, self.cleared_m)
        return float(wind_factors(self.rules, (ground_m, ground_m), (above_m, above_m))[0])

    def _cruise(
        self, start: tuple[NDArray[np.float64], NDArray[np.float64]], bearing: NDArray[np.float64],
        length_m: NDArray[np.float64], time_s: float, factor: NDArray[np.float64], *, in_turn: bool,
    ) -> Flown:  # fmt: skip
        """Fly straight at the planned airspeed, with at least 1 m/s over the ground; no climb, no descent.

        Each flight alone from `time_s` on, or one after the other. Limits of the wind do not count: whoever is in the air has
        to fly on.
        """
        middle = geodesy.midpoint(*start, bearing, length_m)
        most = self.drone.max_ground_speed_mps
        air = air_between(self.wind, middle, bearing, length_m, self.airspeed_mps, most, factor)
        flight_s = airborne_times(air, time_s, in_turn)
        if self.load is None:
            return Flown(flight_s, self.soc_per_s * flight_s)
        # a drone that must not be faster over the ground flies slower through the air
        half_s = 0.5 * flight_s + (np.cumsum(flight_s, axis=1) - flight_s if in_turn else 0.0)
        north, east = self.winds(*middle, time_s + half_s)
        along, across = along_across(factor * north, factor * east, air.cos_bearing, air.sin_bearing)
        speed = np.divide(length_m, flight_s, out=np.full_like(flight_s, most), where=flight_s > 0.0)
        return Flown(flight_s, self.soc_per_s * self.load.factor(np.hypot(speed - along, across)) * flight_s)

    def to_stations(self, here: Place, time_s: float, nodes: NDArray[np.int64]) -> Flown:
        """Fly from a point at cruise height to touch-down at stations."""
        lat, lon = self.network.lat[nodes], self.network.lon[nodes]
        length, bearing = geodesy.inverse(*here, lat, lon)
        start = np.full(len(nodes), here[0]), np.full(len(nodes), here[1])
        ground_m = self.network.ground_at_m(*here), self.network.ground_m[nodes]
        above_m = np.maximum(np.maximum(*ground_m), self.cleared_m)
        factor = wind_factors(self.rules, ground_m, (above_m, above_m))
        flown = self._cruise(start, bearing, length, time_s, factor, in_turn=False)
        return Flown(flown.time_s + self.descent_s, flown.soc + self.soc_descent)

    def along(self, points: Sequence[Place], time_s: float) -> Flown:
        """Fly along a way: to each of its points after the first, shape (members, points - 1); no climb, no descent."""
        places = np.array(points)
        length, bearing = geodesy.inverse(places[:-1, 0], places[:-1, 1], places[1:, 0], places[1:, 1])
        ground_m = self.network.ground_at_m(*places.T)
        above_m = np.maximum(cleared_grounds_m(ground_m.tolist()), self.cleared_m)
        factor = wind_factors(self.rules, (ground_m[:-1], ground_m[1:]), (above_m[:-1], above_m[1:]))
        flown = self._cruise((places[:-1, 0], places[:-1, 1]), bearing, length, time_s, factor, in_turn=True)
        return Flown(np.cumsum(flown.time_s, axis=1), np.cumsum(flown.soc, axis=1))

    def to_the_end(self, way: Sequence[Place], time_s: float, *, climbs: bool = False) -> Flown:
        """Fly a way to touch-down at its end, shape (members,): with a climb first where it begins on the ground."""
        climb_s, climb_soc = (self.rules.climb_s, self.soc_climb) if climbs else (0.0, 0.0)
        flown = self.along(way, time_s + climb_s)
        return Flown(flown.time_s[:, -1] + climb_s + self.descent_s, flown.soc[:, -1] + climb_soc + self.soc_descent)

    def ground_speed_mps(self, way: Sequence[Place], distance_m: float, time_s: float) -> float:
        """Mean ground speed of the planned airspeed along a way of a length, at most the drone's greatest."""
        cruise_s = float(self.expected(self.along(way, time_s).time_s[:, -1]))
        return min(distance_m / max(cruise_s, 1.0), self.drone.max_ground_speed_mps)

    def mean_load(self, way: Sequence[Place], time_s: float) -> float:
        """Power over that of the model, averaged over the cruise of a way."""
        flown = self.along(way, time_s)
        time_mean = float(self.expected(flown.time_s[:, -1]))
        return float(self.expected(flown.soc[:, -1])) / (self.soc_per_s * time_mean) if time_mean > 0.0 else 1.0

    def p_below(self, soc: float, cost: NDArray[np.float64], floor_soc: float) -> NDArray[np.float64]:
        """Probability of landing below a charge, over members and energy, shape (n,); `cost` has shape (members, n)."""
        return np.asarray(np.einsum("m,m...->...", self.wind.probability, self._below(soc, cost, floor_soc)))

    def _below(self, soc: float, cost: NDArray[np.float64], floor_soc: float) -> NDArray[np.float64]:
        """Probability of landing below a charge in each member, shape of `cost`."""
        from scipy.special import ndtr

        sigma = math.hypot(self.belief.sd_between, self._wind_spread * self.belief.mean_ratio)
        spread = np.maximum(np.hypot(cost * sigma, self._soc_sd), 1e-9)
        return np.asarray(
            ndtr(self.belief.normal_deviate((cost * self.belief.mean_ratio - (soc - floor_soc)) / spread))
        )

    def expected(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean over the members of something of shape (members, …)."""
        return np.asarray(np.einsum("m,m...->...", self.wind.probability, values))

    def clear(self, here: Place, nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the straight way to each station crosses no zone, shape (n,)."""
        zones = self.network.zones
        if zones is None:
            return np.ones(len(nodes), dtype=bool)
        lat, lon = self.network.lat[nodes], self.network.lon[nodes]
        return ~zones.crossed_by(np.full(len(nodes), here[0]), np.full(len(nodes), here[1]), lat, lon)

    # Legs

    def where_flown(self, way: Sequence[Place], time_s: float) -> Reach:
        """Return the same for those members alone in which the wind along this way, or at this place, lets the drone fly now.

        In the others it waits on the ground, or would not have come here; where none is left, all count.
        """
        places = np.array(way)
        north, east = self.winds(places[:, 0], places[:, 1], np.full(len(places), time_s))
        open_now = np.hypot(north, east).max(axis=1) <= self.drone.wind_limit_mps
        if not float(self.wind.probability @ open_now) > 0.0:
            return self
        same = copy(self)
        same.wind = self.wind.weighted(open_now.astype(np.float64))
        return same

    def way(self, origin: str | Place, via: Sequence[str], destination: str) -> list[Place]:
        """Return the points of a leg: where it begins, stations overflown, its end."""
        index, lat, lon = self.network.index, self.network.lat, self.network.lon
        first = (float(lat[index[origin]]), float(lon[index[origin]])) if isinstance(origin, str) else origin
        return [first, *((float(lat[index[s]]), float(lon[index[s]])) for s in (*via, destination))]

    def cover(
        self, way: Sequence[Place], time_s: float, soc: float, *, floor_soc: float, epsilon: float,
        destination: str, not_at: frozenset[str] = frozenset(), climbs: bool = True, reserve_soc: float = 0.0,
    ) -> DivertCover:  # fmt: skip
        """Find divert stations for every point of a leg.

        The destination itself counts, where it has pads, from the point on from which no other station is nearer in time.
        The reserve is kept by the destination from the start, or by another station from each point, in the winds in which it is
        flown that far.

        Parameters
        ----------
        way : sequence of (lat, lon)
            From `way`.
        time_s, soc : float
            At the take-off.
        floor_soc, epsilon : float
            A divert lands below this charge with no more than this probability.
        destination : str
            Where the leg ends.
        not_at : frozenset of str
            Stations that do not count: those known to be unusable.
        reserve_soc : float
            The destination, or a divert from each point, lands below this with no more than `epsilon`.
        """
        points = _points(way, self.parameters.point_every_m)
        places = [place for place, _ in points]
        begins = time_s + (self.rules.climb_s if climbs else 0.0)
        high = self.flying_over(float(self.network.ground_at_m(*np.array(way).T).max()))
        flown = high.along(places, begins)
        spent, used = np.zeros((2, len(self.wind), len(points)))
        spent[:, 1:] = flown.time_s
        used[:, 1:] = flown.soc
        used += self.soc_climb if climbs else 0.0
        nodes = np.array([n for n in self.pads if self.network.stations[n].id not in not_at], dtype=np.int64)
        ends_at = self.network.index[destination]
        nodes = nodes[nodes != ends_at]
        safe = np.zeros((len(points), len(nodes)), dtype=bool)
        nearest = np.zeros(len(points), dtype=bool)
        at_end = used[:, -1:] + self.soc_descent
        keeps = self.p_below(soc, at_end, reserve_soc)[0] <= epsilon
        flown_on = self if keeps else self._not_hopeless(soc, at_end, reserve_soc)
        mean_s = self.expected(spent)
        for row, place in enumerate(places):
            if not len(nodes):
                break
            flight = high.to_stations(place, begins + float(mean_s[row]), nodes)
            left_s = float(mean_s[-1] - mean_s[row]) + self.descent_s
            nearest[row] = self.network.pads[ends_at] > 0 and left_s <= float(self.expected(flight.time_s).min())
            cost = used[:, row, None] + flight.soc
            sure = self.p_below(soc, cost, floor_soc) <= epsilon
            near = np.flatnonzero(sure & (keeps or flown_on.p_below(soc, cost, reserve_soc) <= epsilon))
            near = near[np.argsort(self.expected(cost)[near])][:12]
            safe[row, near[self.clear(place, nodes[near])]] = True
        uncovered = np.flatnonzero(~(safe.any(axis=1) | nearest))
        gap = float(points[uncovered[0]][1]) if len(uncovered) else None
        chosen = _fewest(safe, self.parameters.max_diverts)
        chosen += [k for k in self._beside(places, nodes, safe) if k not in chosen][
            : self.parameters.max_diverts - len(chosen)
        ]
        return DivertCover(tuple(self.network.stations[nodes[k]].id for k in chosen), gap)

    def _not_hopeless(self, soc: float, at_end: NDArray[np.float64], reserve_soc: float) -> Reach:
        """Return the same for those members alone in which a leg is flown to its end: in the others it is turned before."""
        hopeless = self._below(soc, at_end, reserve_soc)[:, 0] > self.parameters.p_hopeless
        if not float(self.wind.probability @ ~hopeless) > 0.0:
            return self
        same = copy(self)
        same.wind = self.wind.weighted((~hopeless).astype(np.float64))
        return same

    def _beside(self, places: Sequence[Place], nodes: NDArray[np.int64], safe: NDArray[np.bool_]) -> list[int]:
        """Return stations that lie beside a way and are safe from a part of it, the nearest first: a drone may recharge there."""
        lat, lon = np.array(places).T
        found = []
        for k in np.flatnonzero(safe.any(axis=0)):
            station = self.network.stations[nodes[k]]
            north, east = geodesy.local_offsets_m(lat, lon, station.lat, station.lon)
            off = float(np.hypot(north, east).min())
            if off <= self.parameters.beside_m:
                found.append((off, int(k)))
        return [k for _, k in sorted(found)]


def _points(way: Sequence[Place], every_m: float) -> list[tuple[Place, float]]:
    """Points of a way not farther apart than `every_m`, with the distance flown to each."""
    found: list[tuple[Place, float]] = [(way[0], 0.0)]
    flown = 0.0
    for before, after in pairwise(way):
        length = geodesy.distance_m(*before, *after)
        parts = max(1, math.ceil(length / every_m))
        inner = geodesy.along(*before, *after, parts - 1)
        found += [(point, flown + length * (k + 1) / parts) for k, point in enumerate(inner)]
        flown += length
        found.append((after, flown))
    return found


def _fewest(safe: NDArray[np.bool_], most: int) -> list[int]:
    """Return few columns that together cover every row that any column covers (greedily)."""
    left = safe.any(axis=1)
    chosen: list[int] = []
    while left.any() and len(chosen) < most:
        gain = safe[left].sum(axis=0)
        best = int(np.argmax(gain))
        chosen.append(best)
        left &= ~safe[:, best]
    return chosen
