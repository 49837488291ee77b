"""Electrical power of the simulated drone: induced, profile and parasite power, and losses that grow with load.

Momentum theory (Glauert) with the shares of an M200-class quadrotor; Leishman, *Principles of Helicopter
Aerodynamics*, ch. 2 and 5. This is not the planner's model (`models.drones.power` is never imported here): it dips at
medium speed and rises beyond it, where the planner's default is flat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.units import AIR_DENSITY_KG_M3

if TYPE_CHECKING:
    from skyway.sim_stub.plant.airframe import Airframe

AVIONICS_W = 15.0
_INDUCED_FACTOR = 1.15
_PROFILE_RISE = 4.65  # growth of profile power with the square of the advance ratio


@dataclass(frozen=True, slots=True)
class PowerModel:
    """Power of one airframe; the two hovering endurances fix its two free constants."""

    airframe: Airframe
    profile_w: float
    induced_scale: float
    """Electrical watts for one watt of induced or profile power: what the motors lose."""
    loss_w: float
    """Losses in hover without a package that grow with the cube of the load."""
    error: float = 1.0
    """Factor of this very vehicle, 1 on average."""

    @classmethod
    def of(cls, airframe: Airframe, error: float = 1.0) -> PowerModel:
        """Fit to the published endurances in hover."""
        drone = airframe.drone
        empty_w = drone.battery_j / drone.endurance_empty_s - AVIONICS_W
        full_w = drone.battery_j / drone.endurance_full_s - AVIONICS_W
        load = (drone.mass_kg + drone.max_payload_kg) / drone.mass_kg
        # a + b = empty, a load^1.5 + b load^3 = full
        loss = (full_w - load**1.5 * empty_w) / (load**3 - load**1.5)
        rest = empty_w - loss
        hover = airframe.weight_n
        ideal = hover * math.sqrt(hover / (2.0 * AIR_DENSITY_KG_M3 * airframe.disc_area_m2))
        profile = 0.32 * rest
        scale = (rest - profile) / (_INDUCED_FACTOR * ideal)
        return cls(airframe, profile, scale, loss, error)

    def electrical_w(self, thrust_n: float, airspeed_mps: float, climb_mps: float, drag_power_w: float) -> float:
        """Power drawn from the battery in flight; `drag_power_w` is drag times airspeed, which the thrust works against."""
        frame = self.airframe
        load = max(thrust_n, 0.0) / frame.weight_n
        hover_speed_sq = thrust_n / (2.0 * AIR_DENSITY_KG_M3 * frame.disc_area_m2)
        half = airspeed_mps * airspeed_mps / (2.0 * max(hover_speed_sq, 1e-6))
        # Glauert: v_i^4 + v_i^2 V^2 = v_h^4, in units of v_h
        inflow = math.sqrt(max(math.sqrt(half * half + 1.0) - half, 0.0))
        induced = _INDUCED_FACTOR * thrust_n * math.sqrt(max(hover_speed_sq, 0.0)) * inflow
        advance = airspeed_mps / frame.blade_tip_mps
        profile = self.profile_w * load * math.sqrt(load) * (1.0 + _PROFILE_RISE * advance * advance)
        climb = thrust_n * climb_mps * (1.0 if climb_mps > 0.0 else 0.35)
        shaft = (induced + drag_power_w + climb) * self.induced_scale
        return self.error * max(shaft + profile + self.loss_w * load * load * load, 60.0) + AVIONICS_W
