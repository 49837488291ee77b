"""Predicted energy of a recorded flight, next to the measured energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.drones.power import PHASES
from skyway.models.flight.energy import FlightPower

if TYPE_CHECKING:
    from skyway.link.replay.replay import Replay
    from skyway.models.drones.drone import Drone
    from skyway.models.drones.power import Phase


@dataclass(frozen=True, slots=True)
class Prediction:
    """Energy of a flight by a drone file."""

    drone: Drone
    mass_kg: float
    """Take-off mass."""
    predicted_j: dict[Phase, float]
    """By the time in each phase."""
    measured_j: float
    """What the log says; NaN where it has no power."""
    predicted_soc: float
    measured_soc: float
    """`predicted_soc`, `measured_soc`: share of the nameplate energy that was used; the measured one is NaN where the
    log has no state of charge."""

    @property
    def total_j(self) -> float:
        """Energy predicted for the whole flight."""
        return sum(self.predicted_j.values())

    @property
    def error(self) -> float:
        """Prediction over measurement, minus 1; NaN where nothing was measured."""
        return self.total_j / self.measured_j - 1.0 if self.measured_j > 0.0 else math.nan


def predict(found: Replay, drone: Drone, payload_kg: float) -> Prediction:
    """Predict the energy of a replayed flight with a drone's energy model.

    Raises an `InputError` if the package is heavier than the drone carries, or if the log has no flight.
    """
    if not 0.0 <= payload_kg <= drone.max_payload_kg:
        remedy = f"{drone.id} carries 0 to {drone.max_payload_kg:g} kg"
        raise InputError(Fault("out of range", field="--payload", value=payload_kg, remedy=remedy))
    if not any(phase.time_s > 0.0 for phase in found.phases.values()):
        raise InputError(Fault("the log has no flight to predict", remedy="choose a log with a flight in it"))
    power = FlightPower.of(drone, payload_kg)
    predicted = {name: power.power_w(name) * found.phases[name].time_s for name in PHASES if name in found.phases}
    measured = sum(phase.energy_j for phase in found.phases.values() if phase.time_s > 0.0)
    begin, end = found.soc
    return Prediction(
        drone, drone.mass_kg + payload_kg, predicted, measured, sum(predicted.values()) / drone.battery_j, begin - end
    )
