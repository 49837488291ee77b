"""A point-mass multirotor that holds a ground velocity by tilting into the wind.

The flight controller asks for a specific force: acceleration towards the wanted ground velocity plus what drag takes,
which it learns like an integrator, with a lag. The attitude follows with a first-order lag and gives that force; drag
is quadratic plus a linear rotor term, of the velocity through the air. So tilt, ground velocity and wind agree:
in steady flight m g tan(tilt) is the drag of (ground velocity - wind).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from skyway.models.base.units import GRAVITY_MPS2

if TYPE_CHECKING:
    from skyway.sim_stub.plant.airframe import Airframe

STEP_S = 0.05
"""Physics is advanced in steps of this length; the lag of the attitude is exact over a step."""
FINE_STEP_S = 0.02
"""The same for a vehicle of which somebody asks for messages more often than that."""
_A = 6_378_137.0
_E2 = 0.006694379990141
_DRAG_LAG_S = 0.8
_GAIN_PER_S = 1.1
_VERTICAL_LAG_S = 0.45
_MAX_VERTICAL_ACCEL = 3.0


@dataclass(slots=True)
class Demand:
    """Demand of the flight controller on the airframe for one step."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    up_mps: float = 0.0
    """`north_mps`, `east_mps`, `up_mps`: wanted ground velocity."""
    yaw_deg: float | None = None
    """Wanted heading; None leaves it."""
    level: bool = False
    """Keep level instead of holding a horizontal velocity: there is no position to hold."""
    motors: bool = True
    """Off means falling."""
    max_lean_deg: float = 80.0
    """The autopilot's own limit."""


@lru_cache(maxsize=16)  # asked several times in a step
def metres_per_degree(lat: float) -> tuple[float, float]:
    """Metres in one degree of latitude and of longitude at a latitude (WGS-84)."""
    sine = math.sin(math.radians(lat))
    root = 1.0 - _E2 * sine * sine
    return (
        math.radians(_A * (1.0 - _E2) / (root * math.sqrt(root))),
        math.radians(_A / math.sqrt(root) * math.cos(math.radians(lat))),
    )


def offset_m(lat: float, lon: float, to_lat: float, to_lon: float) -> tuple[float, float]:
    """(north, east) metres from one point to a near one; good to 1e-5 within 30 km."""
    north, east = metres_per_degree((lat + to_lat) / 2.0)
    return (to_lat - lat) * north, ((to_lon - lon + 180.0) % 360.0 - 180.0) * east


@dataclass(slots=True)
class Body:
    """Position and motion of the airframe."""

    airframe: Airframe
    lat: float
    lon: float
    alt_m: float
    """`lat`, `lon`, `alt_m`: degrees, and metres above mean sea level."""
    payload_kg: float = 0.0
    north_mps: float = 0.0
    east_mps: float = 0.0
    up_mps: float = 0.0
    """`north_mps`, `east_mps`, `up_mps`: velocity over the ground."""
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    """`roll`, `pitch`, `yaw`: radians, NED convention: nose down is negative pitch."""
    roll_rate: float = 0.0
    pitch_rate: float = 0.0
    yaw_rate: float = 0.0
    grounded: bool = True
    """Stands on the ground."""
    impact_mps: float = 0.0
    thrust_n: float = 0.0
    airspeed_mps: float = 0.0
    drag_w: float = 0.0
    """`thrust_n`, `airspeed_mps`, `drag_w`: of the last step: thrust, horizontal speed through the air, drag times
    airspeed."""
    _force_north: float = 0.0
    _force_east: float = 0.0
    _known_drag_north: float = 0.0
    _known_drag_east: float = 0.0

    @property
    def ground_speed_mps(self) -> float:
        """Horizontal speed over the ground."""
        return math.hypot(self.north_mps, self.east_mps)

    def rest(self) -> None:
        """Stand still and level."""
        self.north_mps = self.east_mps = self.up_mps = 0.0
        self.roll = self.pitch = self.roll_rate = self.pitch_rate = self.yaw_rate = 0.0
        self._force_north = self._force_east = self._known_drag_north = self._known_drag_east = 0.0
        self.thrust_n = self.airspeed_mps = self.drag_w = 0.0
        self.grounded = True

    def step(
        self, demand: Demand, wind_north_mps: float, wind_east_mps: float, ground_m: float, dt: float = STEP_S
    ) -> None:
        """Advance by one step in a wind (towards); the ground is met at `ground_m`."""
        if self.grounded and (not demand.motors or demand.up_mps <= 0.0):
            self.rest()
            return
        mass = self.airframe.mass_kg(self.payload_kg)
        air_north, air_east = self.north_mps - wind_north_mps, self.east_mps - wind_east_mps
        airspeed = math.hypot(air_north, air_east)
        drag_rate = self.airframe.drag_n_per_speed(airspeed, self.payload_kg)
        drag_north, drag_east = -drag_rate * air_north / mass, -drag_rate * air_east / mass
        if demand.motors:
            self._lean(demand, drag_north, drag_east, dt)
            wanted = (demand.up_mps - self.up_mps) / _VERTICAL_LAG_S
            rise = max(-_MAX_VERTICAL_ACCEL, min(_MAX_VERTICAL_ACCEL, wanted))
        else:
            self._force_north = self._force_east = 0.0
            rise = -GRAVITY_MPS2 + 0.02 * self.up_mps * self.up_mps
        force_north, force_east = self._force_north, self._force_east
        old_north, old_east, old_up = self.north_mps, self.east_mps, self.up_mps
        self.north_mps += (force_north + drag_north) * dt
        self.east_mps += (force_east + drag_east) * dt
        self.up_mps += rise * dt
        north_scale, east_scale = metres_per_degree(self.lat)
        self.lat += (old_north + self.north_mps) * 0.5 * dt / north_scale
        self.lon = (self.lon + (old_east + self.east_mps) * 0.5 * dt / east_scale + 180.0) % 360.0 - 180.0
        self.alt_m += (old_up + self.up_mps) * 0.5 * dt
        self.airspeed_mps, self.drag_w = airspeed, drag_rate * airspeed * airspeed
        vertical = GRAVITY_MPS2 + rise if demand.motors else 0.0
        self.thrust_n = mass * math.sqrt(force_north**2 + force_east**2 + vertical * vertical)
        self._turn(demand, vertical, dt)
        self.grounded = False
        if self.alt_m <= ground_m and self.up_mps <= 0.0:
            self.impact_mps = math.hypot(self.up_mps, 0.3 * self.ground_speed_mps)
            self.alt_m = ground_m
            self.rest()

    def _lean(self, demand: Demand, drag_north: float, drag_east: float, dt: float) -> None:
        """Let the attitude, and with it the horizontal force, follow what the controller asks for."""
        if demand.level:
            want_north = want_east = 0.0
        else:
            learn = 1.0 - math.exp(-dt / _DRAG_LAG_S)
            self._known_drag_north += (drag_north - self._known_drag_north) * learn
            self._known_drag_east += (drag_east - self._known_drag_east) * learn
            push_north = _GAIN_PER_S * (demand.north_mps - self.north_mps)
            push_east = _GAIN_PER_S * (demand.east_mps - self.east_mps)
            push = math.hypot(push_north, push_east)
            scale = min(1.0, self.airframe.max_accel_mps2 / push) if push > 0.0 else 1.0
            want_north = push_north * scale - self._known_drag_north
            want_east = push_east * scale - self._known_drag_east
            size = math.hypot(want_north, want_east)
            most = GRAVITY_MPS2 * math.tan(math.radians(min(self.airframe.max_tilt_deg, demand.max_lean_deg)))
            if size > most:
                want_north *= most / size
                want_east *= most / size
        follow = 1.0 - math.exp(-dt / self.airframe.attitude_lag_s)
        self._force_north += (want_north - self._force_north) * follow
        self._force_east += (want_east - self._force_east) * follow

    def _turn(self, demand: Demand, vertical: float, dt: float) -> None:
        """Turn towards the wanted heading, and express the thrust direction as roll and pitch."""
        old_roll, old_pitch, old_yaw = self.roll, self.pitch, self.yaw
        if demand.yaw_deg is not None:
            error = (math.radians(demand.yaw_deg) - self.yaw + math.pi) % (2.0 * math.pi) - math.pi
            most = math.radians(self.airframe.yaw_rate_dps) * dt
            self.yaw = (self.yaw + max(-most, min(most, error)) + math.pi) % (2.0 * math.pi) - math.pi
        if demand.motors:
            cos_yaw, sin_yaw = math.cos(self.yaw), math.sin(self.yaw)
            ahead = self._force_north * cos_yaw + self._force_east * sin_yaw
            right = self._force_east * cos_yaw - self._force_north * sin_yaw
            total = math.sqrt(ahead * ahead + right * right + vertical * vertical)
            self.pitch = -math.atan2(ahead, vertical)
            self.roll = math.asin(max(-1.0, min(1.0, right / total))) if total > 0.0 else 0.0
        self.roll_rate = (self.roll - old_roll) / dt
        self.pitch_rate = (self.pitch - old_pitch) / dt
        self.yaw_rate = ((self.yaw - old_yaw + math.pi) % (2.0 * math.pi) - math.pi) / dt
