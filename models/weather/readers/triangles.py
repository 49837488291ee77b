"""Grids with positions in separate fields: ICON's triangles, by the latitudes and longitudes of CLAT and CLON.

Source: DWD, "ICON Database Reference Manual" (2023), section 5: the time-invariant fields, discipline 0, category 191, numbers 1 and 2, degrees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.weather.weather import Places

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.weather.weather import Box

KIND = "unstructured_grid"
COORDINATES = {(0, 191, 1): "lat", (0, 191, 2): "lon"}
MARGIN_DEG = 0.5
"""Margin around the region in which points are kept: more than the width of the coarsest global ICON (40 km)."""


class UnknownPlacesError(InputError):
    """The fields with the positions of a grid have not been read."""


class TriangleGrids:
    """Latitudes and longitudes of such grids, of all files that were read so far."""

    def __init__(self) -> None:
        self._told: dict[str, dict[str, NDArray[np.float64]]] = {}

    def take(self, ec: Any, handle: int) -> bool:
        """Take a field with places; returns whether it is one."""
        names = ("discipline", "parameterCategory", "parameterNumber")
        discipline, category, number = (int(ec.codes_get(handle, name)) for name in names)
        axis = COORDINATES.get((discipline, category, number))
        if axis is None:
            return False
        self._told.setdefault(_identity(ec, handle), {})[axis] = np.asarray(
            ec.codes_get_values(handle), dtype=np.float64
        )
        return True

    def cut(self, ec: Any, handle: int, box: Box | None, file: str) -> tuple[Places, NDArray[np.int64]]:
        """Return the places of a grid in a region, and the indices of its points. Raises an `UnknownPlacesError` if they are unknown."""
        told = self._told.get(_identity(ec, handle), {})
        points = int(ec.codes_get(handle, "numberOfDataPoints"))
        if len(told) < len(COORDINATES) or any(len(values) != points for values in told.values()):
            problem = f"is on triangles ({points:,} points), whose places are in other files"
            remedy = "add the files CLAT and CLON of this grid with it (time-invariant, from the same service), or the fields on a latitude-longitude grid"
            raise UnknownPlacesError(problem, file, remedy=remedy)
        lat, lon = told["lat"], np.mod(told["lon"] + 180.0, 360.0) - 180.0
        if not (np.abs(lat) <= 90.0 + 1e-6).all():
            raise InputError("its file of latitudes has impossible values", file)
        chosen = np.arange(points) if box is None else np.flatnonzero(box.wider(MARGIN_DEG).holds(lat, lon))
        here = lat[chosen], lon[chosen]
        return Places(*here, f"triangles, {points:,} points", _apart_m(*here)), chosen


def _identity(ec: Any, handle: int) -> str:
    return f"{ec.codes_get(handle, 'uuidOfHGrid')} {ec.codes_get(handle, 'numberOfDataPoints')}"


def _apart_m(lat: NDArray[np.float64], lon: NDArray[np.float64]) -> float:
    """Median distance from a point to its nearest neighbour; NaN for one point."""
    from scipy.spatial import cKDTree

    if len(lat) < 2:
        return float("nan")
    north, east = 111_195.0 * lat, 111_195.0 * lon * np.cos(np.radians(lat))
    points = np.column_stack((north, east))
    apart = np.asarray(cKDTree(points).query(points[:20_000], k=2)[0])
    return float(np.median(apart[:, 1]))
