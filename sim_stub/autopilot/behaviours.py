"""Flight behaviours: each gives, step by step, the wanted motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from skyway.sim_stub.plant.physics import Demand, metres_per_degree, offset_m

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot

_BRAKING_MPS2 = 1.6
_CLOSING_PER_S = 0.6
_ALTITUDE_PER_S = 0.9
_LAND_SLOWLY_BELOW_M = 10.0
_HOLD_SPEED_MPS = 5.0
_LEAD_S = 1.0
"""The velocity follows its demand with about this lag, so the demand is that of a point ahead."""
_INWARDS_PER_S = 0.5


@dataclass(frozen=True, slots=True)
class Speeds:
    """Limits that the parameters set, m/s."""

    cruise_mps: float
    up_mps: float
    down_mps: float
    land_mps: float
    most_mps: float


def steer(
    pilot: Autopilot, lat: float, lon: float, alt_m: float, speed_mps: float, pass_mps: float = 0.0
) -> tuple[Demand, float, float]:
    """Head for a place; returns the demand, the horizontal distance and the height still to go."""
    body, speeds = pilot.body, pilot.speeds
    north, east = offset_m(pilot.lat, pilot.lon, lat, lon)
    distance = math.hypot(north, east)
    rise = alt_m - body.alt_m
    speed = min(speed_mps, math.sqrt(2.0 * _BRAKING_MPS2 * distance + pass_mps * pass_mps))
    speed = min(speed, _CLOSING_PER_S * distance + pass_mps)
    share = speed / distance if distance > 1e-6 else 0.0
    up = max(-speeds.down_mps, min(speeds.up_mps, _ALTITUDE_PER_S * rise))
    return Demand(north * share, east * share, up, level=not pilot.position_known), distance, rise


@dataclass(slots=True)
class Idle:
    """On the ground with the motors turning."""

    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:  # noqa: ARG002
        """Nothing."""
        return Demand(up_mps=-0.1)


@dataclass(slots=True)
class Climb:
    """Go straight up to a height above mean sea level."""

    lat: float
    lon: float
    alt_m: float
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """Upwards, over the same place."""
        demand, _, rise = steer(pilot, self.lat, self.lon, self.alt_m, _HOLD_SPEED_MPS)
        if pilot.body.grounded and rise > 0.0:
            demand.up_mps = max(demand.up_mps, 0.3)
        self.done = rise < 0.6 and not pilot.body.grounded
        return demand


@dataclass(slots=True)
class Fly:
    """Go to a place, and stay there for a while where that is asked."""

    lat: float
    lon: float
    alt_m: float
    radius_m: float = 2.0
    """The place counts as reached within it."""
    stay_s: float = 0.0
    """Time to stay once there; infinite is forever."""
    yaw_deg: float | None = None
    """Heading to take; None looks along the way."""
    pass_mps: float = 0.0
    """Speed to keep when it is reached, for a waypoint that is only passed."""
    speed_mps: float | None = None
    arrived_s: float | None = None
    distance_m: float = math.inf
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """Towards the place, or hold it."""
        speed = pilot.cruise_mps if self.speed_mps is None else self.speed_mps
        demand, self.distance_m, rise = steer(
            pilot, self.lat, self.lon, self.alt_m, speed, self.pass_mps if self.arrived_s is None else 0.0
        )
        if pilot.body.grounded:
            demand.up_mps = max(demand.up_mps, 0.5)
        demand.yaw_deg = self.yaw_deg
        if self.yaw_deg is None and self.distance_m > 5.0:
            demand.yaw_deg = math.degrees(math.atan2(demand.east_mps, demand.north_mps))
        if self.arrived_s is None and self.distance_m <= self.radius_m and abs(rise) <= 1.0:
            self.arrived_s = pilot.sim_s
        if self.arrived_s is not None:
            self.done = pilot.sim_s - self.arrived_s >= self.stay_s
        return demand


@dataclass(slots=True)
class Wait:
    """Stay as one is, on the ground or in the air, until an instant of simulated time."""

    until_s: float
    hover: Fly | None = None
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """Nothing, or hover."""
        self.done = pilot.sim_s >= self.until_s
        if pilot.body.grounded:
            return Demand(up_mps=-0.1)
        if self.hover is None:
            self.hover = pilot.hover_here()
        return self.hover.step(pilot)


@dataclass(slots=True)
class Land:
    """Come down at a place; None is straight down from here."""

    lat: float | None = None
    lon: float | None = None
    approach_m: float = 1.0
    arrived: bool = False
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """Over the place first at the present height, then down, slowly near the ground."""
        body = pilot.body
        if self.lat is None or self.lon is None or not pilot.position_known:
            self.lat, self.lon, self.arrived = pilot.lat, pilot.lon, True
        if body.grounded:
            self.done = pilot.landed
            return Demand(up_mps=-pilot.speeds.land_mps)
        demand, distance, _ = steer(pilot, self.lat, self.lon, body.alt_m, pilot.cruise_mps)
        if distance <= self.approach_m:
            self.arrived = True
        if self.arrived:
            slow = body.alt_m - pilot.ground_m < _LAND_SLOWLY_BELOW_M
            demand.up_mps = -(pilot.speeds.land_mps if slow else pilot.speeds.down_mps)
        else:
            demand.yaw_deg = math.degrees(math.atan2(demand.east_mps, demand.north_mps))
        return demand


@dataclass(slots=True)
class ReturnHome:
    """Climb, fly to a safe place, come down there and land."""

    lat: float
    lon: float
    cruise_alt_m: float
    loiter_s: float = 0.0
    stage: Climb | Fly | Land | None = None
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """Stage by stage."""
        body = pilot.body
        if body.grounded and not isinstance(self.stage, Land):
            self.stage = Land()
        if self.stage is None:
            self.stage = Climb(pilot.lat, pilot.lon, max(self.cruise_alt_m, body.alt_m))
        if self.stage.done:
            if isinstance(self.stage, Climb):
                self.stage = Fly(self.lat, self.lon, self.stage.alt_m, 2.0, self.loiter_s)
            elif isinstance(self.stage, Fly):
                self.stage = Land(self.lat, self.lon)
            else:
                self.done = True
        return self.stage.step(pilot)


@dataclass(slots=True)
class Circle:
    """Go to the nearest point of the edge, fly the turns, looking at the centre."""

    lat: float
    lon: float
    alt_m: float
    """`lat`, `lon`, `alt_m`: centre, degrees, and height above mean sea level."""
    radius_m: float
    speed_mps: float
    """`radius_m`, `speed_mps`: of the circle, and along it."""
    turns: float
    clockwise: bool = True
    """Seen from above."""
    turned_rad: float = 0.0
    edge: Fly | None = None
    done: bool = False
    _last_rad: float | None = None

    def step(self, pilot: Autopilot) -> Demand:
        """To the edge, then along it."""
        north, east = offset_m(self.lat, self.lon, pilot.lat, pilot.lon)
        if self.edge is None:
            self.edge = self._nearest_edge(north, east)
        if not self.edge.done:
            return self.edge.step(pilot)
        angle = math.atan2(east, north)
        if self._last_rad is not None:
            self.turned_rad += (angle - self._last_rad + math.pi) % (2.0 * math.pi) - math.pi
        self._last_rad = angle
        self.done = abs(self.turned_rad) >= self.turns * 2.0 * math.pi
        demand = self._along(angle, math.hypot(north, east))
        demand.up_mps = max(-pilot.speeds.down_mps, min(pilot.speeds.up_mps, 0.9 * (self.alt_m - pilot.body.alt_m)))
        demand.level = not pilot.position_known
        return demand

    def _nearest_edge(self, north: float, east: float) -> Fly:
        away = math.hypot(north, east)
        share = self.radius_m / away if away > 0.5 else 0.0
        if share == 0.0:
            north, share = -self.radius_m, 1.0
        north_scale, east_scale = metres_per_degree(self.lat)
        return Fly(self.lat + north * share / north_scale, self.lon + east * share / east_scale, self.alt_m, 2.0)

    def _along(self, angle: float, away: float) -> Demand:
        """Velocity of a point ahead on the circle, and back to the edge."""
        way = 1.0 if self.clockwise else -1.0
        ahead = angle + way * self.speed_mps / self.radius_m * _LEAD_S
        inwards = _INWARDS_PER_S * (away - self.radius_m)
        return Demand(
            -way * self.speed_mps * math.sin(ahead) - inwards * math.cos(angle),
            way * self.speed_mps * math.cos(ahead) - inwards * math.sin(angle),
            yaw_deg=math.degrees(angle) + 180.0,
        )


Behaviour: TypeAlias = Idle | Climb | Fly | Wait | Land | ReturnHome | Circle
"""One thing to do: `step` gives the motion wanted now, until it is `done`."""
