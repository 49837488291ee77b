"""Flights through changing wind: their rules, and the arrays that kernels read.

A flight is a take-off, a climb, one or more segments and a descent to a landing. Wind is constant within a time slot
and a flight integrates across slot boundaries; using only the slot of departure would let a later departure arrive
earlier. A flight is flyable when none of its segments is over the limits (`models.wind.triangle.ground_speed` above 0) in any
slot that the flight touches, and no zone closes it in one; otherwise the drone holds on the ground. With both rules arrival never gets earlier by
leaving later (FIFO).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.errors import Fault, refuse
from skyway.models.drones.weather_limits import NO_LIMITS, WeatherLimits
from skyway.models.flight.clearance import Clearance
from skyway.models.flight.closures import closures
from skyway.models.flight.heights import above_factors, wind_factors
from skyway.models.flight.weather_closures import closed_slots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.flight.energy import FlightPower
    from skyway.models.network.network import Network
    from skyway.models.wind.forecast import WindEnsemble

STEP_MPS2 = 2.0
"""A vehicle that climbs or descends on its way stops for it: braking and accelerating cost this long at a ground speed equal to it. Flown over the example
`hills` by both simulated autopilots at their usual accelerations: 11 s for each stop from 20 m/s."""


@dataclass(frozen=True, slots=True)
class FlightRules:
    """How every flight is flown.

    Attributes
    ----------
    cruise_height_m : float
        Above the higher of the grounds at the two ends of a segment (`models.flight.heights`).
    climb_rate_mps, descent_rate_mps : float
        Vertical speeds of take-off and landing.
    wind_profile_exponent : float
        Of the power law that carries wind to cruise height.
    clearance : Clearance
        Required clearance over terrain and obstacles, where a terrain model is known (`models.flight.way_heights`).
    limits : WeatherLimits
        Of the weather besides the wind, for all drones.
    """

    cruise_height_m: float = 60.0
    climb_rate_mps: float = 5.0
    descent_rate_mps: float = 3.0
    wind_profile_exponent: float = 0.2
    clearance: Clearance = field(default_factory=Clearance)
    limits: WeatherLimits = NO_LIMITS

    @property
    def climb_s(self) -> float:
        """Time from take-off to cruise height."""
        return self.cruise_height_m / self.climb_rate_mps

    @property
    def descent_s(self) -> float:
        """Time from cruise height to touch-down."""
        return self.cruise_height_m / self.descent_rate_mps


class SegmentWind(NamedTuple):
    """Segments and the wind over them, as arrays for compiled kernels."""

    start_s: float
    slot_s: float
    """POSIX seconds of the first slot and length of a slot; the last slot holds on forever."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    """Shape (members, slots, sites) each. Wind at cruise height, m/s, where the air moves TOWARDS."""
    weight: NDArray[np.float64]
    """Shape (segments, sites). Inverse-distance weights of the sites at each segment's midpoint, times what the wind is
    more as high as the segment is flown."""
    cos_bearing: NDArray[np.float64]
    sin_bearing: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    """Shape (segments,) each. Of the segments."""
    airspeed_mps: float
    wind_limit_mps: float
    max_ground_speed_mps: float
    """Of the drone on this delivery."""
    climb_s: float
    descent_s: float
    """Spent at the start and the end of each flight."""
    shut_of: NDArray[np.int64]
    """Shape (segments,). Column of `shut` of each."""
    shut: NDArray[np.bool_]
    """Shape (slots, columns). Whether a zone closes the segments of a column in a slot; none those of column 0."""


def air_over(
    network: Network,
    ensemble: WindEnsemble,
    drone: Drone,
    rules: FlightRules,
    *,
    airspeed_mps: float | None = None,
    power: FlightPower | None = None,
) -> SegmentWind:
    """Lay the ensemble's wind, carried to the height at which each is flown, over the segments of a network.

    Over a terrain model segments are longer by the climbs and descents beyond the cruise height, see `lifts_s`: by the distance
    flown meanwhile at the drone's greatest ground speed, so that no wind makes it take less.

    Without a planned airspeed it is the drone's for cruising. An `InputError` refuses a speed, height or length that is
    not finite and above 0: kernels would never end, or read beyond their arrays.
    """
    airspeed_mps = drone.cruise_airspeed_mps if airspeed_mps is None else airspeed_mps
    _check_flown(network, drone, rules, airspeed_mps)
    wind = ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    factors = segment_factors(network, rules, np.arange(len(network.tail)))
    weight = network.site_weights(wind.site_lat, wind.site_lon, wind.lattice) * factors[:, None]
    distance_m = network.distance_m
    if network.flown is not None:
        extra_m = network.flown.up_m - rules.cruise_height_m, network.flown.down_m - rules.cruise_height_m
        stopped_s = network.flown.stops * drone.max_ground_speed_mps / STEP_MPS2
        distance_m = distance_m + drone.max_ground_speed_mps * (lifts_s(rules, *extra_m, power) + stopped_s)
    raised = network.raised(rules.cruise_height_m)
    if raised is not None:
        stopped_s = np.where(raised.lift_m > 0.0, 2.0 * drone.max_ground_speed_mps / STEP_MPS2, 0.0)
        lift_s = lifts_s(rules, raised.lift_m, raised.lift_m, power) + stopped_s
        distance_m = distance_m + drone.max_ground_speed_mps * lift_s
    air = _air(wind, weight, network.bearing_deg, distance_m, airspeed_mps, drone.max_ground_speed_mps)
    too_high = None
    if math.isfinite(drone.max_height_m):
        too_high = network.highest_agl_m(rules.cruise_height_m) > drone.max_height_m + 1e-6
    shut_of, shut = closures(network, wind.start_s, wind.slot_s, wind.slots, too_high)
    return air._replace(
        wind_limit_mps=float(drone.wind_limit_mps),
        climb_s=rules.climb_s,
        descent_s=rules.descent_s,
        shut_of=shut_of,
        shut=shut | closed_slots(wind, drone, rules)[:, None],
    )


def segment_factors(network: Network, rules: FlightRules, segments: NDArray[np.int64]) -> NDArray[np.float64]:
    """Wind on segments as high as they are flown, over that at the cruise height, shape (segments,)."""
    if network.flown is not None:
        return above_factors(rules, network.flown.mean_above_m[segments])
    ground_m = network.ground_m
    found = wind_factors(rules, (ground_m[network.tail[segments]], ground_m[network.head[segments]]))
    raised = network.raised(rules.cruise_height_m)
    if raised is None:
        return found
    return np.where(raised.lift_m[segments] > 0.0, above_factors(rules, raised.mean_above_m[segments]), found)


def lifts_s(
    rules: FlightRules, up_m: NDArray[np.float64], down_m: NDArray[np.float64], power: FlightPower | None = None
) -> NDArray[np.float64]:
    """Duration of cruise equivalent to climbs and descents: their time or, if longer, the time in which a cruise takes their energy."""
    climb_s, descent_s = np.maximum(up_m, 0.0) / rules.climb_rate_mps, np.maximum(down_m, 0.0) / rules.descent_rate_mps
    if power is None:
        return climb_s + descent_s
    as_cruise_s = (power.climb_w * climb_s + power.descent_w * descent_s) / power.cruise_w
    return np.maximum(climb_s + descent_s, as_cruise_s)


def air_between(
    wind: WindEnsemble,
    middle: tuple[NDArray[np.float64], NDArray[np.float64]],
    bearing_deg: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    airspeed_mps: float,
    max_ground_speed_mps: float,
    factor: NDArray[np.float64],
) -> SegmentWind:
    """Lay the wind over given straight ways; without climb, descent and limits of the wind.

    The wind is that at cruise height; `factor` converts it to the height at which each way is flown
    (`models.flight.heights.wind_factors`). Middles of the ways (lat, lon), degrees, their courses, lengths and factors
    have the shape (ways,) each.
    """
    weight = wind.weights(*middle) * factor[:, None]
    return _air(wind, weight, bearing_deg, distance_m, airspeed_mps, max_ground_speed_mps)


def _air(
    wind: WindEnsemble,
    weight: NDArray[np.float64],
    bearing_deg: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    airspeed_mps: float,
    max_ground_speed_mps: float,
) -> SegmentWind:
    bearing = np.radians(bearing_deg)
    return SegmentWind(
        start_s=float(wind.start_s),
        slot_s=float(wind.slot_s),
        north=np.ascontiguousarray(wind.north),
        east=np.ascontiguousarray(wind.east),
        weight=np.ascontiguousarray(weight),
        cos_bearing=np.cos(bearing),
        sin_bearing=np.sin(bearing),
        distance_m=np.ascontiguousarray(distance_m),
        airspeed_mps=float(airspeed_mps),
        wind_limit_mps=math.inf,
        max_ground_speed_mps=float(max_ground_speed_mps),
        climb_s=0.0,
        descent_s=0.0,
        shut_of=np.zeros(len(distance_m), dtype=np.int64),
        shut=np.zeros((wind.slots, 1), dtype=bool),
    )


def _check_flown(network: Network, drone: Drone, rules: FlightRules, airspeed_mps: float) -> None:
    """Refuse values with which no flight can be computed."""
    above_0 = {
        f"{drone.id}.airspeed_mps": airspeed_mps,
        f"{drone.id}.max_airspeed_mps": drone.max_airspeed_mps,
        f"{drone.id}.battery_j": drone.battery_j,
        f"{drone.id}.recharge_full_s": drone.recharge_full_s,
        f"{drone.id}.wind_limit_mps": drone.wind_limit_mps,
        f"{drone.id}.max_ground_speed_mps": drone.max_ground_speed_mps,
        "rules.cruise_height_m": rules.cruise_height_m,
        "rules.climb_rate_mps": rules.climb_rate_mps,
        "rules.descent_rate_mps": rules.descent_rate_mps,
    }
    remedy = "finite and above 0"
    faults = [
        Fault("out of range", field=name, value=value, remedy=remedy)
        for name, value in above_0.items()
        if not 0.0 < value < math.inf
    ]
    if not math.isfinite(rules.wind_profile_exponent):
        value = rules.wind_profile_exponent
        faults.append(Fault("out of range", field="rules.wind_profile_exponent", value=value, remedy="a number"))
    if not (np.isfinite(network.distance_m).all() and (network.distance_m > 0.0).all()):
        faults.append(Fault("out of range", field="network.distance_m", remedy=remedy))
    refuse(faults)
