"""Time, energy and state of charge of every flight of a mission, in the wind.

The vehicle holds the commanded ground speed as long as its airspeed |ground - wind| allows, and flies slower where it
does not. The probability of keeping the reserve follows from its energy belief, `models.drones.energy_belief`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.hops import SAME_PLACE_M, Hops, hop_times
from skyway.missions.checks.manoeuvres import manoeuvres_s
from skyway.missions.checks.near_stations import NearStations
from skyway.missions.checks.weather import SteadyWind, Weather
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS
from skyway.models.base import geodesy
from skyway.models.base.json_text import HIDDEN
from skyway.models.base.units import J_PER_WH
from skyway.models.drones.time_belief import TimeBelief
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.rules import STEP_MPS2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.missions.checks.route import Route, RouteLeg
    from skyway.missions.items.mission import Mission
    from skyway.models.drones.drone import Drone
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.network.station import Station


@dataclass(frozen=True, slots=True)
class FlightConditions:
    """Conditions of a mission check: drone, load, wind.

    Attributes
    ----------
    drone : Drone
        The vehicle.
    payload_kg : float
        Package carried until it is released.
    soc_start : float
        State of charge at the first take-off.
    reserve_soc : float
        No landing below it.
    climb_rate_mps, descent_rate_mps : float
        Vertical speeds.
    weather : Weather
        At flying height.
    stations : tuple of Station
        Stations with pads; if empty, nothing is known of pads, and any hold on the ground charges.
    drone_is_assumed : bool
        The vehicle was not named: a violation of its limits is a warning, not an error, unless it follows from what was
        stated (`is_stated`).
    manoeuvres : bool
        Turns, the gain of speed, and the last metres of landings count (`missions.checks.manoeuvres`).
    """

    drone: Drone
    payload_kg: float = 0.0
    soc_start: float = 1.0
    reserve_soc: float = 0.2
    climb_rate_mps: float = 5.0
    descent_rate_mps: float = 3.0
    weather: Weather = field(default_factory=SteadyWind)
    stations: tuple[Station, ...] = ()
    drone_is_assumed: bool = False
    manoeuvres: bool = False

    @property
    def is_stated(self) -> bool:
        """Whether a package, a wind or a charge was stated, rather than an empty, full vehicle in still air."""
        return self.payload_kg > 0.0 or self.soc_start < 1.0 or self.weather != SteadyWind()


@dataclass(frozen=True, slots=True)
class LegEnergy:
    """One flight of a mission.

    Attributes
    ----------
    item_from, item_to : int
        First and last item.
    distance_m : float
        Along the route.
    time_s, energy_wh, soc_end : float or None
        Mean over the winds in which it is flyable; None if there are none, or the flight has no end. The charge is also
        None if that at take-off is unknown.
    p_reserve : float or None
        Probability that the landing keeps the reserve.
    soc_start : float
        State of charge at take-off; NaN where the battery or the wind does not let the flight before reach its end.
    p_flyable : float
        Probability that the wind lets it fly.
    least_airspeed_margin_mps : float
        Remaining airspeed at the worst place; negative: the commanded ground speed is not held.
    worst_item : int
        The item of that place.
    pad : str or None
        Station that the leg ends at.
    """

    item_from: int
    item_to: int
    distance_m: float
    time_s: float | None
    energy_wh: float | None
    soc_end: float | None
    p_reserve: float | None
    soc_start: float = field(metadata=HIDDEN)
    p_flyable: float = field(metadata=HIDDEN)
    least_airspeed_margin_mps: float = field(metadata=HIDDEN)
    worst_item: int = field(metadata=HIDDEN)
    pad: str | None = field(default=None, metadata=HIDDEN)

    @property
    def energy_j(self) -> float | None:
        """The energy in joules."""
        return None if self.energy_wh is None else self.energy_wh * J_PER_WH


@dataclass(frozen=True, slots=True)
class Flown:
    """Arrays over members: time and energy of one leg, and whether it is flyable in the wind."""

    distance_m: float
    time_s: NDArray[np.float64]
    energy_j: NDArray[np.float64]
    flyable: NDArray[np.bool_]
    margin_mps: float
    worst_item: int
    turns_s: float = 0.0
    """Part of the time for manoeuvres."""


def _or_typical(
    values: NDArray[np.float64], flyable: NDArray[np.bool_], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values per member; on days without flights the drone waits, and then flies as on the other days."""
    share = np.where(flyable, weight, 0.0)
    total = float(share.sum())
    typical = float(share @ np.where(flyable, values, 0.0)) / total if total > 0.0 else 0.0
    return np.where(flyable, values, typical)


def leg_energies(mission: Mission, route: Route, conditions: FlightConditions) -> tuple[LegEnergy, ...]:
    """Compute every flight of a route, with charging on the ground between them."""
    weight = conditions.weather.probability
    near = NearStations(conditions.stations)
    soc = conditions.soc_start
    spent_j, turns_j = np.zeros(len(weight)), 0.0  # since the state of charge was last known
    clock_s = np.zeros(len(weight))
    height_m, released = 0.0, False
    legs: list[LegEnergy] = []
    for leg in route.legs:
        payload_kg = 0.0 if released else conditions.payload_kg
        flown = fly_leg(mission, leg, conditions, payload_kg, clock_s, height_m)
        spent_j = spent_j + _or_typical(flown.energy_j, flown.flyable, weight)
        turns_j += flown.turns_s * FlightPower.of(conditions.drone, payload_kg).cruise_w
        pad = _pad_at(leg, near)
        legs.append(_leg_energy(leg, flown, conditions, soc, (spent_j, turns_j), pad.name if pad else None))
        released = released or leg.released or leg.released_after is not None
        clock_s = clock_s + _or_typical(flown.time_s, flown.flyable, weight) + (leg.ground_hold_s or 0.0)
        end = legs[-1].soc_end
        height_m = leg.next_ground_m
        if end is None or end <= 0.0:
            soc, end = math.nan, math.nan
        if leg.ground_hold_s != 0.0 and (pad is not None or not conditions.stations):
            power_w = pad.recharge_power_w if pad else None
            soc = charged(conditions.drone, end, leg.ground_hold_s, power_w)
            spent_j, turns_j = np.zeros(len(weight)), 0.0
    return tuple(legs)


def charged(drone: Drone, soc: float, hold_s: float | None, pad_power_w: float | None = None) -> float:
    """State of charge after a hold on a pad; a hold that a person ends is assumed to end with a full battery.

    NaN if the charge before is unknown, and a timed hold does not tell.
    """
    if hold_s is None:
        return 1.0
    if math.isnan(soc):
        return math.nan
    curve = drone.charging_curve(pad_power_w)
    return float(curve.soc(float(curve.time_from_empty_s(max(soc, 0.0))) + hold_s))


def _pad_at(leg: RouteLeg, near: NearStations) -> Station | None:
    if not leg.steps or leg.landing == "none":
        return None
    return next((station for station in near.at(leg.steps[-1].point) if station.pads), None)


def _leg_energy(
    leg: RouteLeg,
    flown: Flown,
    conditions: FlightConditions,
    soc: float,
    spent: tuple[NDArray[np.float64], float],
    pad: str | None,
) -> LegEnergy:
    spent_j, turns_j = spent
    weight = np.where(flown.flyable, conditions.weather.probability, 0.0)
    p_flyable = float(weight.sum())
    time_s = energy_wh = soc_end = p_reserve = None
    if p_flyable > 0.0 and np.isfinite(flown.time_s[flown.flyable]).all():
        weight = weight / p_flyable
        time_s = float(weight @ np.where(flown.flyable, flown.time_s, 0.0))
        energy_wh = float(weight @ np.where(flown.flyable, flown.energy_j, 0.0)) / J_PER_WH
        if not math.isnan(soc):
            soc_end = soc - float(weight @ spent_j) / conditions.drone.battery_j
            budget_j = (soc - conditions.reserve_soc) * conditions.drone.battery_j
            p_reserve = float(weight @ p_within(spent_j, turns_j, budget_j, conditions.drone.energy_belief))
    return LegEnergy(
        leg.item_from,
        leg.item_to,
        flown.distance_m,
        time_s,
        energy_wh,
        soc_end,
        None if p_reserve is None else min(p_reserve, 1.0),
        soc,
        min(p_flyable, 1.0),
        flown.margin_mps,
        flown.worst_item,
        pad,
    )


def p_within(
    energy_j: NDArray[np.float64], turns_j: float, budget_j: float, belief: EnergyBelief
) -> NDArray[np.float64]:
    """Probability that an estimate of the modelled energy stays within a budget.

    `turns_j` of it are of manoeuvres, which have an uncertainty of their own (`models.drones.time_belief`), unless the model is exact.
    """
    if not turns_j > 0.0 or belief.leg_sd == 0.0:
        factors, weights = np.ones(1), np.ones(1)
    else:
        factors, weights = TimeBelief().manoeuvre_factors()
    left_j = budget_j - turns_j * (factors[:, None] - 1.0)
    with np.errstate(divide="ignore"):
        ratio = np.where(energy_j > 0.0, left_j / np.maximum(energy_j, 1e-9), np.where(left_j >= 0.0, math.inf, -1.0))
    return np.asarray(weights @ belief.p_at_most(ratio))


def fly_leg(
    mission: Mission,
    leg: RouteLeg,
    conditions: FlightConditions,
    payload_kg: float,
    clock_s: NDArray[np.float64],
    height_m: float,
    ground_m: float | None = None,
) -> Flown:
    """Fly one leg in every wind; the slots of a forecast depend on times, so it is computed twice.

    `ground_m`: the ground below where it begins, above home, of one that begins in the air; else that is `height_m`.
    """
    members = len(conditions.weather.probability)
    start = leg.start
    if not leg.steps or start is None:
        none = np.zeros(members)
        return Flown(0.0, none, none, np.ones(members, dtype=bool), math.inf, leg.item_to)
    hops = _straight_hops(mission, leg, conditions, height_m, ground_m)
    turns_s = _turns_s(hops, leg, conditions, lifts_off=ground_m is None)
    hops = hops._replace(hold_s=hops.hold_s + turns_s)
    elapsed = np.broadcast_to(clock_s[:, None], (members, len(hops.length_m)))
    for _ in range(2):
        step_s, possible, needed = hop_times(hops, conditions, elapsed)
        elapsed = clock_s[:, None] + np.cumsum(np.insert(step_s[:, :-1], 0, 0.0, axis=1), axis=1)
    length, climb_s, descent_s = hops.length_m, hops.climb_s, hops.descent_s
    flyable = np.all((possible > 0.0) | (length <= SAME_PLACE_M), axis=1)
    margins = np.where(length > SAME_PLACE_M, conditions.drone.max_airspeed_mps - needed, math.inf)
    margin = (margins[flyable] if flyable.any() else margins).min(axis=0)
    worst = int(np.argmin(margin))
    cruise_s = step_s - climb_s - descent_s
    carried = np.array(leg.payloads_kg(payload_kg))
    energy_j = np.zeros(members)
    for mass in np.unique(carried).tolist():
        part = carried == mass
        times = float(climb_s[part].sum()), cruise_s[:, part].sum(axis=1), float(descent_s[part].sum())
        energy_j = energy_j + np.asarray(FlightPower.of(conditions.drone, mass).energy_j(*times))
    return Flown(
        float(length.sum()),
        step_s.sum(axis=1),
        energy_j,
        flyable,
        float(margin[worst]),
        leg.steps[worst].item,
        float(turns_s.sum()),
    )


def hops_of_leg(
    mission: Mission, leg: RouteLeg, conditions: FlightConditions, height_m: float, ground_m: float | None = None
) -> Hops:
    """Return the hops of one leg that begins at a height above home: one to each of its steps; `ground_m` as in `fly_leg`."""
    hops = _straight_hops(mission, leg, conditions, height_m, ground_m)
    return hops._replace(hold_s=hops.hold_s + _turns_s(hops, leg, conditions, lifts_off=ground_m is None))


def _straight_hops(
    mission: Mission, leg: RouteLeg, conditions: FlightConditions, height_m: float, ground_m: float | None
) -> Hops:
    places = [leg.start or leg.steps[0].point, *(step.point for step in leg.steps)]
    lat, lon = np.array([p.lat for p in places]), np.array([p.lon for p in places])
    length, bearing = geodesy.inverse(lat[:-1], lon[:-1], lat[1:], lon[1:])
    mid_lat, mid_lon = geodesy.midpoint(lat[:-1], lon[:-1], bearing, length)
    commanded = np.array([max(step.speed_mps, 0.1) for step in leg.steps])
    hold = np.array([step.hold_s for step in leg.steps])
    climb_s, descent_s, apart, flown_m = _vertical_times(mission, leg, conditions, height_m)
    moves = length > SAME_PLACE_M
    stops = ~moves & (climb_s + descent_s > 0.0) & ~apart  # it brakes, climbs vertically, and accelerates again
    stops[1:-1] &= moves[:-2] & moves[2:]
    stops[[0, -1]] = False
    hold = hold + np.where(stops, np.minimum(commanded, conditions.drone.max_ground_speed_mps) / STEP_MPS2, 0.0)
    above_ground_m = flown_m - _ground_m(leg, length, height_m if ground_m is None else ground_m)
    return Hops(mid_lat, mid_lon, length, bearing, commanded, hold, climb_s, descent_s, apart, above_ground_m)


def _turns_s(hops: Hops, leg: RouteLeg, conditions: FlightConditions, *, lifts_off: bool) -> NDArray[np.float64]:
    """Manoeuvres at the end of each hop, if included."""
    if not conditions.manoeuvres:
        return np.zeros(len(hops.length_m))
    most_mps, lands = conditions.drone.max_ground_speed_mps, leg.landing != "none"
    return manoeuvres_s(hops, most_mps, lifts_off=lifts_off, touches_down=lands)


def _vertical_times(
    mission: Mission, leg: RouteLeg, conditions: FlightConditions, height_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Climb and descent of each step, whether it comes before or after the way instead of on it, and the mean height of the way."""
    climb, descent, apart, flown = [], [], [], []
    for index, step in enumerate(leg.steps):
        height = height_m if math.isnan(step.height_m) else step.height_m
        command = mission.items[step.item].command
        change = height - height_m
        returns = index == len(leg.steps) - 1 and leg.landing == "return"
        if returns:
            change = -height_m
        climb.append(max(change, 0.0) / conditions.climb_rate_mps)
        descent.append(max(-change, 0.0) / conditions.descent_rate_mps)
        apart.append(command in TAKEOFF_COMMANDS or command in LAND_COMMANDS or returns)
        on_way = 0.5 * (height_m + height)
        flown.append(height if command in TAKEOFF_COMMANDS else height_m if apart[-1] else on_way)
        height_m = height
    return np.array(climb), np.array(descent), np.array(apart), np.array(flown)


def _ground_m(leg: RouteLeg, length_m: NDArray[np.float64], start_m: float) -> NDArray[np.float64]:
    """Mean ground below the way of each step, above home: from the start to the landing it is taken to change linearly."""
    along_m = np.concatenate(([0.0], np.cumsum(length_m)))
    middle = 0.5 * (along_m[:-1] + along_m[1:]) / max(float(along_m[-1]), 1.0)
    end_m = leg.steps[-1].height_m if leg.landing == "land" else start_m
    return np.asarray(start_m + middle * ((start_m if math.isnan(end_m) else end_m) - start_m))
