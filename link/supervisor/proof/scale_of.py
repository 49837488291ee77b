"""The in-flight scale of one drone, from its data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.proof.power_units import USUAL_KAPPA
from skyway.link.supervisor.proof.tilt_airspeed import TiltAirspeed
from skyway.link.supervisor.proof.weighing import Scale
from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.models.drones.drag import DragModel
from skyway.models.drones.power import EnduranceEnergy

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone

USUAL_DRAG = DragModel(linear_per_s=0.03, quadratic_per_m=0.006)
"""Drag of a multirotor of 2 to 10 kg that nobody has measured; within 12 m/s the power hardly depends on it."""


def scale_of(drone: Drone, package_kg: float, drag: DragModel | None) -> Scale:
    """Build the scale of a drone with a package."""
    model = drone.energy_model
    held_back = drag or USUAL_DRAG
    kappa = model.kappa if isinstance(model, EnduranceEnergy) else USUAL_KAPPA
    return Scale(drone.mass_kg, package_kg, kappa, AirspeedLoad(held_back), TiltAirspeed(held_back))
