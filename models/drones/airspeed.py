"""Calibration of a plane's airspeed sensor and heading: a scale factor and an offset.

An uncalibrated pitot tube is a few per cent off (ArduPilot's ARSPD_RATIO), and a compass, or a fuselage that flies askew, a
few degrees; at 20 m/s each of them causes an apparent wind of 1 to 3 m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from skyway.models.base.errors import InputError

FLIGHT_TO_FLIGHT_FACTOR, FLIGHT_TO_FLIGHT_HEADING_RAD = 0.03, math.radians(3.0)
"""Difference of sensor and heading of one aircraft between flights: the probe's place in the flow, the compass beside its load."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AirspeedModel:
    """From sensors to the velocity through the air."""

    factor: float = 1.0
    """True airspeed is the reading of the sensor times this."""
    heading_offset_rad: float = 0.0
    """The vehicle moves through the air where its heading points plus this, clockwise."""
    sigma_mps: float = 0.7
    """Standard deviation of the airspeed."""
    slip_sigma_rad: float = math.radians(5.0)
    """Standard deviation of the heading and of side slip."""
    factor_sigma: float = 0.0
    heading_sigma_rad: float = 0.0
    """Standard deviation of the factor (relative) and of the offset themselves, the same through a flight."""

    def another_flight(self) -> AirspeedModel:
        """Return the same calibration with its uncertainty for another flight of the same aircraft."""
        return replace(
            self,
            factor_sigma=math.hypot(self.factor_sigma, FLIGHT_TO_FLIGHT_FACTOR),
            heading_sigma_rad=math.hypot(self.heading_sigma_rad, FLIGHT_TO_FLIGHT_HEADING_RAD),
        )

    def __post_init__(self) -> None:
        if not (0.2 <= self.factor <= 5.0 and abs(self.heading_offset_rad) <= math.pi):
            value = (self.factor, self.heading_offset_rad)
            raise InputError("is not an airspeed calibration", field="airspeed", value=value)
        if not (self.sigma_mps > 0.0 and self.slip_sigma_rad > 0.0):
            value = (self.sigma_mps, self.slip_sigma_rad)
            raise InputError("must be above 0", field="airspeed sigma", value=value)
