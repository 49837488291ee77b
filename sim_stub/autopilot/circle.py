"""Flying circles about a place, for NAV_LOITER_TURNS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.behaviours import Fly
from skyway.sim_stub.plant.physics import Demand, metres_per_degree, offset_m

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot

_LEAD_S = 1.0
"""The velocity follows its demand with about this lag, so the demand is that of a point ahead."""
_CLOSING_PER_S = 0.5


@dataclass(slots=True)
class Circle:
    """Go to the nearest point of the edge, fly the turns, looking at the centre.

    Attributes
    ----------
    lat, lon, alt_m : float
        Centre, degrees, and height above mean sea level.
    radius_m, speed_mps : float
        Of the circle, and along it.
    turns : float
        How many.
    clockwise : bool
        Seen from above.
    """

    lat: float
    lon: float
    alt_m: float
    radius_m: float
    speed_mps: float
    turns: float
    clockwise: bool = True
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
        inwards = _CLOSING_PER_S * (away - self.radius_m)
        return Demand(
            -way * self.speed_mps * math.sin(ahead) - inwards * math.cos(angle),
            way * self.speed_mps * math.cos(ahead) - inwards * math.sin(angle),
            yaw_deg=math.degrees(angle) + 180.0,
        )
