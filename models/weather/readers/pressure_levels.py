"""Winds at pressure levels, as winds at heights above ground, for forecasts without winds near the ground.

The height of a level is the geopotential height in the file less the orography in it, averaged over region, members and times; without the geopotential height, that of the
standard atmosphere; without the orography, above sea level. The choice is reported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import height_text
from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.atmosphere import height_of_pressure_m
from skyway.models.weather.weather import EAST, FROM, NORTH, SPEED, FieldKey

if TYPE_CHECKING:
    from numpy.typing import NDArray

LOWEST_HPA = 800.0
"""About 2,000 m: higher levels are irrelevant to the wind that a drone flies in."""
LEAST_M, MOST_M = 10.0, 2000.0
"""Relevant heights above ground."""
ALTITUDE, GEOPOTENTIAL = "geopotential height", "geopotential"
WINDS = (NORTH, EAST, SPEED, FROM)
Fields = dict[FieldKey, "NDArray[np.float64]"]


def level_key_m(hpa: float) -> float:
    """Mark a level among heights: minus its pressure, hPa."""
    return -hpa


def at_heights(fields: Fields) -> tuple[Fields, list[str], list[str]]:
    """Return fields at heights above ground only, the names of omitted fields, and notes."""
    levels = sorted({-key.height_m for key in fields if key.height_m < 0.0}, reverse=True)
    ground = _ground_m(fields)
    found = {
        key: values
        for key, values in fields.items()
        if key.height_m >= 0.0 and key.quantity not in (ALTITUDE, GEOPOTENTIAL)
    }
    if not levels:
        return found, [], []
    names = [f"{key.quantity} at {-key.height_m:g} hPa" for key in fields if key.height_m < 0.0]
    if any(key.quantity in WINDS for key in found) or not any(
        key.quantity in WINDS and key.height_m < 0.0 for key in fields
    ):
        return found, names, []
    told = []
    measured = False
    for hpa in levels:
        altitude = _altitude_m(fields, level_key_m(hpa))
        measured = measured or altitude is not None
        above = round((float(height_of_pressure_m(100.0 * hpa)) if altitude is None else altitude) - (ground or 0.0), 1)
        if not LEAST_M <= above <= MOST_M:
            continue
        told.append(f"{hpa:g} hPa as {height_text(above)}")
        for key, values in fields.items():
            if key.height_m == level_key_m(hpa) and key.quantity in WINDS:
                found[FieldKey(key.quantity, above)] = values
    by = "the geopotential in the file" if measured else "the standard atmosphere"
    over = "above the model's ground" if ground is not None else "above sea level, for its ground is not in the file"
    return found, [], [f"its winds are at pressure levels: {', '.join(told) or 'none low enough'}, by {by}, {over}"]


def _ground_m(fields: Fields) -> float | None:
    """Mean of the model's orography; None if it is not in the file."""
    for quantity, factor in ((ALTITUDE, 1.0), (GEOPOTENTIAL, 1.0 / GRAVITY_MPS2)):
        values = fields.get(FieldKey(quantity, 0.0))
        if values is not None and np.isfinite(values).any():
            return factor * float(np.nanmean(values))
    return None


def _altitude_m(fields: Fields, key_m: float) -> float | None:
    """Mean height of a level above sea level, by the geopotential in the file."""
    for quantity, factor in ((ALTITUDE, 1.0), (GEOPOTENTIAL, 1.0 / GRAVITY_MPS2)):
        values = fields.get(FieldKey(quantity, key_m))
        if values is not None and np.isfinite(values).any():
            return factor * float(np.nanmean(values))
    return None
