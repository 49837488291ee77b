"""Power of a multirotor over airspeed, relative to hover.

In forward flight less power goes into holding the drone up, and more into drag and into the blades: the power dips at medium
speed and rises beyond it. The energy models (`models.drones.power`) are those of hover or of a mean cruise, without this dependence; the missing
quantity is drag, which follows from the drone's own lean (`models.drones.drag`).

Source: momentum theory in forward flight (Glauert), blades and their rise with the advance ratio from J. G. Leishman,
*Principles of Helicopter Aerodynamics*, 2nd ed., sections 2.14 and 5.4; the share of blades in hover, 30 %, from there as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import GRAVITY_MPS2

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from skyway.models.drones.drag import DragModel

INFLOW_MPS = 5.7
"""Speed of the air through the propellers in hover at a disc loading of 80 N/m2, usual for drones of 2 to 10 kg."""
BLADE_SHARE = 0.3
"""Share of the blades' own drag in the power of hover."""
BLADE_RISE, TIP_MPS = 4.65, 110.0
"""Its growth with the square of the advance ratio; speed of the blades' tips."""
INDUCED_FACTOR = 1.15
"""Induced power over that of an ideal propeller."""


@dataclass(frozen=True, slots=True)
class AirspeedLoad:
    """Power over airspeed of one kind of multirotor."""

    drag: DragModel
    """Drag of the drone."""

    def factor(self, airspeed_mps: ArrayLike) -> NDArray[np.float64]:
        """Power at an airspeed over that in hover."""
        speed = np.abs(np.asarray(airspeed_mps, dtype=np.float64))
        drag = speed * (self.drag.linear_per_s + self.drag.quadratic_per_m * speed)
        half = speed * speed / (2.0 * INFLOW_MPS**2)
        inflow = np.sqrt(np.sqrt(half * half + 1.0) - half)
        thrust = np.sqrt(1.0 + (drag / GRAVITY_MPS2) ** 2)
        lifting = thrust * inflow + drag * speed / (INDUCED_FACTOR * GRAVITY_MPS2 * INFLOW_MPS)
        blades = 1.0 + BLADE_RISE * (speed / TIP_MPS) ** 2
        return np.asarray((1.0 - BLADE_SHARE) * lifting + BLADE_SHARE * blades)
