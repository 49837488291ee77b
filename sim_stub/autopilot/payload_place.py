"""ArduPilot's NAV_PAYLOAD_PLACE: sink until the thrust falls, open the gripper, climb back (mode_auto.cpp, Copter 4.5 to 4.8).

Where no ground is felt within the greatest descent it climbs back with the package, and the mission goes on as after a release.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.behaviours import steer

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot
    from skyway.sim_stub.plant.physics import Demand

_FELT_S, _DELAY_S = 0.5, 1.0
_STANDS_M = 0.5
"""So far below the drone the package hangs: at this height it stands."""
_PREFIX = "PayloadPlace:"


@dataclass(slots=True)
class Place:
    """Place the package at a place, from the height at which it gets there."""

    lat: float
    lon: float
    most_m: float
    """Greatest descent; 0 is no limit."""
    top_m: float | None = None
    """Where the descent began, above sea level."""
    felt_s: float | None = None
    climbs: bool = False
    done: bool = False

    def step(self, pilot: Autopilot) -> Demand:
        """To the place, down, and up again."""
        body = pilot.body
        demand, distance, _ = steer(pilot, self.lat, self.lon, body.alt_m, pilot.cruise_mps)
        if self.top_m is None:
            if distance > 1.0:
                return demand
            self.top_m = body.alt_m
        if not self.climbs:
            self._sink(pilot)
        if self.climbs:
            demand, _, rise = steer(pilot, self.lat, self.lon, self.top_m, pilot.cruise_mps)
            self.done = rise < 0.6
            return demand
        demand.up_mps = 0.0 if self.felt_s is not None else -pilot.speeds.land_mps
        return demand

    def _sink(self, pilot: Autopilot) -> None:
        body, now = pilot.body, pilot.sim_s
        top_m = body.alt_m if self.top_m is None else self.top_m
        if self.felt_s is None:
            blind_m = pilot.vehicle.faults.value("place-blind")
            if self.most_m > 0.0 and top_m - body.alt_m > (blind_m or self.most_m):
                pilot.say(4, f"{_PREFIX} Reached maximum descent")
                self.climbs = True
            elif body.alt_m - pilot.ground_m <= _STANDS_M and not blind_m:
                self.felt_s = now
            return
        if now >= self.felt_s + _FELT_S and pilot.gripper_closed:
            pilot.say(6, f"{_PREFIX} Releasing the gripper")
            pilot.move_gripper(close=False)
        self.climbs = now >= self.felt_s + _FELT_S + _DELAY_S and (not pilot.gripper_closed or not pilot.has_gripper)
