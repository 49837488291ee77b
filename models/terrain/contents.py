"""Contents of a terrain or obstacle file: ``skyway.terrain/1``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.terrain.files import datum_note, read_raster
from skyway.models.terrain.obstacles import read_obstacles
from skyway.models.terrain.raster import WGS84, crs_name

if TYPE_CHECKING:
    from numpy.typing import NDArray

SCHEMA = "skyway.terrain/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class TerrainContents:
    """Contents of a terrain file.

    Attributes
    ----------
    file, format, packed : str
        Name, description, and storage of the heights.
    rows, columns : int
        Of heights.
    south, west, north, east : float
        Outermost heights, degrees.
    crs, registration, datum : str
        As in `Raster`.
    unit_m : float
        Length of the unit of the stored heights.
    spacing_m : tuple of float
        North to south and west to east, in the middle.
    spacing_arcsec : tuple of float or None
        The same of a grid in longitude and latitude.
    voids : int
        Points without a height.
    least_m, greatest_m : float or None
        Of the heights that are known, metres above the datum; None if none is.
    note : str or None
        Note for a person.
    """

    file: str
    format: str
    packed: str
    rows: int
    columns: int
    south: float
    west: float
    north: float
    east: float
    crs: str
    registration: str
    datum: str
    unit_m: float
    spacing_m: tuple[float, float]
    spacing_arcsec: tuple[float, float] | None
    voids: int
    least_m: float | None
    greatest_m: float | None
    note: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleContents:
    """Contents of an obstacle file: points and their box; the greatest height above ground and top above sea level."""

    file: str
    points: int
    south: float | None
    west: float | None
    north: float | None
    east: float | None
    tallest_m: float | None
    highest_m: float | None


def terrain_contents(text: str) -> TerrainContents:
    """Read all of a terrain file. Raises an `InputError` with its problem."""
    raster = read_raster(text)
    south, west, north, east = raster.bounds()
    least, greatest, voids = np.inf, -np.inf, 0
    band = max(1, 8_000_000 // raster.columns)
    for row in range(0, raster.rows, band):
        part = raster.heights_m((row, min(row + band, raster.rows)), (0, raster.columns))
        known = part[np.isfinite(part)]
        voids += part.size - len(known)
        if len(known):
            least, greatest = min(least, float(known.min())), max(greatest, float(known.max()))
    return TerrainContents(
        file=raster.file, format=raster.format, packed=raster.packed, rows=raster.rows, columns=raster.columns,
        south=south, west=west, north=north, east=east,
        crs=raster.crs if raster.crs == WGS84 else crs_name(raster.crs), registration=raster.registration,
        datum=raster.datum, unit_m=raster.unit_m, spacing_m=raster.spacing_m(),
        spacing_arcsec=(abs(raster.step[1]) * 3600.0, raster.step[0] * 3600.0) if raster.is_geographic else None,
        voids=voids, least_m=least if np.isfinite(least) else None, greatest_m=greatest if np.isfinite(greatest) else None,
        note=datum_note(raster),
    )  # fmt: skip


def obstacle_contents(text: str) -> ObstacleContents:
    """Read an obstacle file; an `InputError` lists its faults."""
    found = read_obstacles(Path(text))

    def most(values: NDArray[np.float64]) -> float | None:
        return float(np.nanmax(values)) if np.isfinite(values).any() else None

    box: tuple[float | None, ...] = (None, None, None, None)
    if len(found):
        box = float(found.lat.min()), float(found.lon.min()), float(found.lat.max()), float(found.lon.max())
    return ObstacleContents(
        file=text, points=len(found), south=box[0], west=box[1], north=box[2], east=box[3],
        tallest_m=most(found.agl_m), highest_m=most(found.amsl_m),
    )  # fmt: skip
