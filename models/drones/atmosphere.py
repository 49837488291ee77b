"""The standard atmosphere below 11 km (ISO 2533): pressure and density by height, and density by temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import AIR_DENSITY_KG_M3

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

PRESSURE_PA, TEMPERATURE_K = 101_325.0, 288.15
"""At sea level."""
LAPSE_K_M = 0.0065
PER_M = LAPSE_K_M / TEMPERATURE_K
"""Share of the temperature at sea level that is lost with each metre."""
EXPONENT = 5.25588
"""Of the pressure: gravity over gas constant and lapse."""
HIGHEST_M = 11_000.0


def pressure_pa(height_m: ArrayLike) -> NDArray[np.float64]:
    """Pressure at heights above sea level."""
    return np.asarray(PRESSURE_PA * (1.0 - PER_M * np.asarray(height_m, dtype=np.float64)) ** EXPONENT)


def height_of_pressure_m(pressure: ArrayLike) -> NDArray[np.float64]:
    """Height above sea level at which a pressure, Pa, is met."""
    share = np.asarray(pressure, dtype=np.float64) / PRESSURE_PA
    return np.asarray((1.0 - share ** (1.0 / EXPONENT)) / PER_M)


def density_ratio(height_m: ArrayLike) -> NDArray[np.float64]:
    """Density at heights above sea level over that at sea level."""
    return np.asarray((1.0 - PER_M * np.asarray(height_m, dtype=np.float64)) ** (EXPONENT - 1.0))


def density_kg_m3(height_m: float, temperature_k: float | None = None) -> float:
    """Density of dry air at a height above sea level: at a temperature, or at the standard one of that height."""
    ratio = float(density_ratio(height_m))
    if temperature_k is None:
        return AIR_DENSITY_KG_M3 * ratio
    return AIR_DENSITY_KG_M3 * ratio * (TEMPERATURE_K - LAPSE_K_M * height_m) / temperature_k
