"""The simulated airframe: an M200-class quadrotor with its own figures.

Mass, battery, published endurances, wind limit and recharge time are the maker's (`models.drones.drone`). Drag and the split
of the power are not published; they are chosen here so that the published hovering endurances are met exactly and the
drone needs about 20 degrees of tilt at its published top speed of 22.5 m/s.
"""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.drone import M200_V2, Drone


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """What flies."""

    drone: Drone = M200_V2
    drag_area_m2: float = 0.0395
    """Quadratic drag: coefficient times area."""
    payload_drag_area_m2: float = 0.006
    """Added by a package under the drone."""
    rotor_drag_ns_m: float = 0.20
    """Linear drag of the rotors, N per m/s."""
    disc_area_m2: float = 0.586
    """Area swept by all propellers."""
    blade_tip_mps: float = 110.0
    """Tip speed of the propellers in hover."""
    attitude_lag_s: float = 0.22
    """Time constant with which the attitude follows what is asked."""
    max_tilt_deg: float = 25.0
    """The flight controller asks for no more."""
    max_accel_mps2: float = 2.5
    """Horizontal acceleration that it asks for at most."""
    yaw_rate_dps: float = 60.0
    """How fast it turns."""

    def mass_kg(self, payload_kg: float) -> float:
        """All-up mass."""
        return self.drone.mass_kg + payload_kg

    def drag_n_per_speed(self, airspeed_mps: float, payload_kg: float) -> float:
        """Drag divided by airspeed, N per m/s, at sea level: multiply by the air velocity."""
        area = self.drag_area_m2 + (self.payload_drag_area_m2 if payload_kg > 0.0 else 0.0)
        return 0.6125 * area * airspeed_mps + self.rotor_drag_ns_m

    @property
    def weight_n(self) -> float:
        """Weight without a package."""
        return self.drone.mass_kg * GRAVITY_MPS2
