"""Rasters: one file of heights each, its metadata, and windows of it in metres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

WGS84 = "EPSG:4326"
LOWEST_M, HIGHEST_M = -500.0, 9_500.0
"""No ground is lower (the shore of the Dead Sea: -430 m) or higher: such values are undeclared voids, mostly -9999, or the sea floor."""


class Pixels(Protocol):
    """Source of the pixels of a raster."""

    def read(self, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
        """Values of rows and columns [from, to), shape (rows, columns), as they are stored; NaN if there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Heights on a grid, of one file.

    Attributes
    ----------
    file, format : str
        Name of the file and its kind: ``SRTM .hgt``, ``GeoTIFF``, ``BigTIFF``, …
    rows, columns : int
        Of heights.
    origin : tuple of float
        (x, y) of the first height: of its node, or of the centre of its cell.
    step : tuple of float
        (x, y) from one column, and from one row, to the next; y is negative where the first row is the northern one.
    crs : str
        Code of the coordinate reference system that x and y are in.
    registration : str
        ``node``: a height is that of a point; ``cell``: that of a cell about it.
    datum : str
        Datum of the heights: ``EGM96``, ``EGM2008``, ``ellipsoid``, another name, or ``unknown``.
    unit_m : float
        Length of the unit of the heights.
    pixels : Pixels
        Source of the heights.
    packed : str
        Their storage, in words.
    geoid : Raster, optional
        Heights of the geoid above the ellipsoid, if the heights are above the ellipsoid; without it EGM96 counts.
    """

    file: str
    format: str
    rows: int
    columns: int
    origin: tuple[float, float]
    step: tuple[float, float]
    crs: str
    registration: str
    datum: str
    unit_m: float
    pixels: Pixels
    packed: str
    geoid: Raster | None = None

    @property
    def is_geographic(self) -> bool:
        """Whether x and y are longitude and latitude in degrees."""
        return bool(_crs(self.crs).is_geographic)

    def at(self, lat: ArrayLike, lon: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions of places in the grid: (row, column); a whole number is a node or the centre of a cell."""
        lat, lon = np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)
        if self.crs == WGS84:
            x, y = lon, lat
        else:
            x, y = (np.asarray(one) for one in _transformer(self.crs).transform(lon, lat))
        if self.is_geographic:
            middle = self.origin[0] + 0.5 * self.step[0] * (self.columns - 1)
            x = geodesy.about(x, middle)
        return (y - self.origin[1]) / self.step[1], (x - self.origin[0]) / self.step[0]

    def place(self, row: float, column: float) -> tuple[float, float]:
        """Latitude and longitude of a place in the grid, degrees."""
        x, y = self.origin[0] + column * self.step[0], self.origin[1] + row * self.step[1]
        if self.crs == WGS84:
            return y, geodesy.wrapped(x)
        lon, lat = _transformer(self.crs).transform(x, y, direction="INVERSE")
        return float(lat), float(lon)

    def bounds(self) -> tuple[float, float, float, float]:
        """South, west, north, east of the heights, degrees; of a projected grid those of its outline."""
        rows = np.linspace(0.0, self.rows - 1.0, 9)
        columns = np.linspace(0.0, self.columns - 1.0, 9)
        edge = [(row, column) for row in rows for column in columns if row in (rows[0], rows[-1]) or column in (columns[0], columns[-1])]  # fmt: skip
        lat, lon = np.array([self.place(row, column) for row, column in edge]).T
        lon = geodesy.about(lon, float(lon[0]))
        return float(lat.min()), float(lon.min()), float(lat.max()), float(lon.max())

    def spacing_m(self) -> tuple[float, float]:
        """Distance of neighbouring heights in the middle of the grid, metres: north to south, west to east."""
        row, column = 0.5 * (self.rows - 1), 0.5 * (self.columns - 1)
        here, below, beside = self.place(row, column), self.place(row + 1, column), self.place(row, column + 1)
        return geodesy.distance_m(*here, *below), geodesy.distance_m(*here, *beside)

    def heights_m(self, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
        """Heights of rows and columns [from, to) in metres above the raster's datum; NaN if there is none."""
        values = self.pixels.read(rows, columns)
        if self.unit_m != 1.0:
            values = values * np.float32(self.unit_m)
        with np.errstate(invalid="ignore"):
            wrong = ~((values >= LOWEST_M) & (values <= HIGHEST_M))
        if wrong.any():
            values = np.where(wrong, np.float32(np.nan), values)
        return values

    def bilinear_m(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights at places, between those of the grid; NaN beyond it and beside voids."""
        row, column = self.at(lat, lon)
        r0, c0 = (
            np.clip(np.floor(one).astype(np.int64), 0, count - 2)
            for one, count in ((row, self.rows), (column, self.columns))
        )
        top, left = int(r0.min()), int(c0.min())
        heights = self.heights_m((top, int(r0.max()) + 2), (left, int(c0.max()) + 2)).astype(np.float64)
        down, right = row - r0, column - c0
        r0, c0 = r0 - top, c0 - left
        upper = (1.0 - right) * heights[r0, c0] + right * heights[r0, c0 + 1]
        lower = (1.0 - right) * heights[r0 + 1, c0] + right * heights[r0 + 1, c0 + 1]
        inside = (np.minimum(down, right) >= -1e-9) & (np.maximum(down, right) <= 1.0 + 1e-9)
        return np.where(inside, (1.0 - down) * upper + down * lower, np.nan)


@cache
def _crs(code: str) -> Any:
    import pyproj

    return pyproj.CRS.from_user_input(code)


@cache
def _transformer(code: str) -> Any:
    """From longitude and latitude, WGS-84, to the coordinates of a system, x first."""
    import pyproj

    return pyproj.Transformer.from_crs(WGS84, _crs(code), always_xy=True)


def checked_crs(code: str, file: str) -> str:
    """Return a code that pyproj accepts; an `InputError` refuses others."""
    import pyproj

    try:
        found = _crs(code)
        if not (found.is_geographic or found.is_projected):
            raise pyproj.exceptions.CRSError("neither geographic nor projected")
        _transformer(code)
    except pyproj.exceptions.ProjError as error:
        remedy = "gdalwarp -t_srs EPSG:4326 writes it in longitude and latitude"
        raise InputError(f"is in a coordinate system that is not known: {error}", file, value=code, remedy=remedy) from None  # fmt: skip
    return code


@cache
def crs_name(code: str) -> str:
    """Name of a coordinate reference system by its code; the code alone where it is unknown."""
    import pyproj

    try:
        return f"{_crs(code).name} ({code})"
    except pyproj.exceptions.ProjError:
        return code


@cache
def vertical_unit_m(code: int) -> float | None:
    """Length of the unit of a vertical coordinate reference system by its EPSG code; None if it is unknown."""
    import pyproj

    try:
        return float(_crs(f"EPSG:{code}").axis_info[-1].unit_conversion_factor)
    except (pyproj.exceptions.ProjError, IndexError):
        return None
