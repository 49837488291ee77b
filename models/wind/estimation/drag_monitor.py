"""Monitor that detects a wrong drag in flight.

With a wrong drag every air velocity is too long, or too short, by the same factor. On a constant course, the error is hidden
in the wind; after a turn, ground velocity ``v = w + s a`` shows the factor s of the air velocity a. It is fitted over the last
minutes together with a wind assumed steady: a on v, because v is known well (the other way round the
noise of a would make s too small), including the correlation of the residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import percent
from skyway.models.wind.estimation.blocks import MIN_SPREAD_DEG, course_spread_deg

if TYPE_CHECKING:
    from numpy.typing import NDArray

MIN_POINTS = 30
TOLERANCE = 0.10
"""A factor closer to 1 than this is not reported."""


@dataclass(frozen=True, slots=True)
class DragCheck:
    """Check of the drag in use against a stretch of flight."""

    factor: float
    sigma: float
    """Correction factor of air velocities, and its standard deviation; NaN if it cannot be determined."""
    course_spread_deg: float
    """Range of the courses of the stretch."""

    @property
    def wrong(self) -> bool:
        """Whether the drag in use is certainly (3 sigma), and by more than the tolerance, wrong."""
        off = abs(self.factor - 1.0)
        return off > TOLERANCE and off > 3.0 * self.sigma

    @property
    def advice(self) -> str:
        """One sentence for the operator."""
        if not math.isfinite(self.factor):
            return f"the drag cannot be checked (the courses differ by {self.course_spread_deg:.0f}°)"
        if not self.wrong:
            return "the drag fits"
        return (
            f"airspeeds by tilt are {percent(abs(self.factor - 1.0))} too {'low' if self.factor > 1.0 else 'high'}: "
            "the drag in use is wrong, run skyway calibrate wind"
        )


def check_drag(velocity: NDArray[np.float64], through_air: NDArray[np.float64]) -> DragCheck:
    """Compare ground and air velocities of a stretch of flight, shape (n, 2), one a second or so, in the order of time.

    Air velocities are those by the drag in use.
    """
    good = np.isfinite(velocity).all(axis=1) & np.isfinite(through_air).all(axis=1)
    velocity, through_air = velocity[good], through_air[good]
    spread = course_spread_deg(velocity)
    if len(velocity) < MIN_POINTS or spread < MIN_SPREAD_DEG:
        return DragCheck(math.nan, math.nan, spread)
    air, ground = through_air - through_air.mean(axis=0), velocity - velocity.mean(axis=0)
    energy = float((ground**2).sum())
    slope = float((air * ground).sum()) / energy
    left = air - slope * ground
    rho = float(np.clip((left[1:] * left[:-1]).sum() / max((left**2).sum(), 1e-12), 0.0, 0.98))
    variance = float((left**2).mean()) * (1.0 + rho) / (1.0 - rho)
    sigma = math.sqrt(variance / energy)
    if slope < 3.0 * sigma:
        return DragCheck(math.nan, math.nan, spread)
    return DragCheck(1.0 / slope, sigma / slope**2, spread)
