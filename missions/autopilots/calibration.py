"""Calibrations that an autopilot stores in its parameters: the sensors, the names, and the values without a calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Calibration:
    """One slot for the calibration of a sensor."""

    sensor: str
    """``compass``, ``accelerometer`` or ``gyro``."""
    identified: str
    """Parameter with the id of the calibrated sensor; 0 if the slot is empty."""
    used: str = ""
    """Parameter that is 0 if the sensor is not used; empty if there is none."""
    offsets: tuple[str, ...] = ()
    """Parameters that are subtracted from each axis."""
    zero_is_none: bool = False
    """Offsets of exactly 0 mean that it was never calibrated."""
    most: float = math.inf
    """Longer offsets do not count as a calibration, in the autopilot's unit."""

    @property
    def names(self) -> tuple[str, ...]:
        """All its parameters."""
        return tuple(name for name in (self.identified, self.used, *self.offsets) if name)
