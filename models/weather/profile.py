"""Wind at a height from the winds at the heights of a forecast.

Between two heights the speed follows the power law through both, and the direction turns with the logarithm of the height, as components
do in the logarithmic law; above and below all of them the nearest two are extrapolated. With one height the profile's exponent is used.

Source: IEC 61400-1:2019, section 6.3.2.2 (power law); R. B. Stull, "An Introduction to Boundary Layer Meteorology" (1988), section 9.7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

MAX_EXPONENT = 0.6
"""Limit of the exponent beyond the given heights: steeper profiles (a nocturnal jet) do not continue."""
LIGHT_MPS = 0.5
"""A weaker wind has no profile."""


def wind_at_height(
    heights_m: Sequence[float],
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    height_m: float,
    exponent: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) at a height above ground, from components at ascending heights, shape (heights, …) each."""
    heights = np.asarray(heights_m, dtype=np.float64)
    if len(heights) == 1:
        factor = height_factor(height_m, heights[0], exponent)
        return north[0] * factor, east[0] * factor
    upper = int(np.clip(np.searchsorted(heights, height_m), 1, len(heights) - 1))
    low, high = heights[upper - 1], heights[upper]
    share = np.log(height_m / low) / np.log(high / low)
    speeds = np.hypot(north[upper - 1], east[upper - 1]), np.hypot(north[upper], east[upper])
    windy = (speeds[0] > LIGHT_MPS) & (speeds[1] > LIGHT_MPS)
    ratio = np.where(windy, speeds[1], 1.0) / np.where(windy, speeds[0], 1.0)
    if 0.0 <= share <= 1.0:
        parts = [(1.0 - share) * part[upper - 1] + share * part[upper] for part in (north, east)]
        straight = np.hypot(*parts)
        wanted = speeds[0] * ratio**share
        stretch = np.where(windy & (straight > 0.0), wanted / np.where(straight > 0.0, straight, 1.0), 1.0)
        return parts[0] * stretch, parts[1] * stretch
    nearest = upper if share > 1.0 else upper - 1
    steep = np.where(windy, np.log(ratio) / np.log(high / low), exponent)
    stretch = (height_m / heights[nearest]) ** np.clip(steep, 0.0, MAX_EXPONENT)
    return north[nearest] * stretch, east[nearest] * stretch
