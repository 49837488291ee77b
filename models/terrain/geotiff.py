"""GeoTIFF and COG: position and datum of the heights of a TIFF.

Source: OGC GeoTIFF 1.1 (19-008r4); GDAL's tags 42112 and 42113. Of the tags that place an image those without rotation are read.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.terrain.raster import WGS84, Raster, checked_crs, vertical_unit_m
from skyway.models.terrain.tiff import nodata_of, read_tiff

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.terrain.tiff import TiffImage

_SCALE, _TIE, _TRANSFORM, _KEYS, _DOUBLES, _METADATA = 33550, 33922, 34264, 34735, 34736, 42112
_MODEL, _RASTER, _GEOGRAPHIC, _PROJECTED, _VERTICAL, _VERTICAL_UNIT = 1024, 1025, 2048, 3072, 4096, 4099
_POINT, _USER = 2, 32767
_DATUMS = {5171: "EGM96", 5773: "EGM96", 1027: "EGM2008", 3855: "EGM2008", 4979: "ellipsoid", 5030: "ellipsoid", 4326: "ellipsoid", 5019: "ellipsoid"}  # fmt: skip
_VERTICAL_METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0}
_UNITS_M = {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us-ft": 1200.0 / 3937.0, "us survey foot": 1200.0 / 3937.0}  # fmt: skip
_LIKE_WGS84 = frozenset({4326, 4979})
COPERNICUS = re.compile(r"^Copernicus_DSM_", re.IGNORECASE)
"""Names of tiles of the Copernicus model; according to its handbook they count from EGM2008."""


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The pixels of a GeoTIFF in a file, by GDAL's scale and offset."""

    path: Path
    image: TiffImage
    scale: float
    offset: float

    def read(self, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
        """Heights as stored, NaN for no data."""
        try:
            with self.path.open("rb") as stream:
                stored = self.image.window(stream, rows, columns)
        except OSError as error:
            raise file_error("read", self.path, error) from error
        values = stored.astype(np.float32)
        nodata = nodata_of(self.image.tags)
        if nodata is not None and not math.isnan(nodata):
            values[stored == np.float64(nodata) if stored.dtype.kind != "f" else values == np.float32(nodata)] = np.nan
        if self.image.left_out() and nodata is None and stored.dtype.kind != "f":
            values[stored == self.image.empty_value()] = np.nan
        return values if (self.scale, self.offset) == (1.0, 0.0) else values * np.float32(self.scale) + np.float32(self.offset)  # fmt: skip


def read_geotiff(path: Path) -> Raster:
    """Read the header of a GeoTIFF. Raises an `InputError` with the missing or unsupported feature, and the remedy."""
    file = str(path)
    try:
        with path.open("rb") as stream:
            image = read_tiff(stream, file)
    except OSError as error:
        raise file_error("read", path, error) from error
    keys = _geo_keys(image)
    origin, step = _placed(image)
    registration = "node" if keys.get(_RASTER) == _POINT else "cell"
    if registration == "cell":  # the tie point is the corner of a cell, the height that of its middle
        origin = origin[0] + 0.5 * step[0], origin[1] + 0.5 * step[1]
    crs = _crs_of(keys, file)
    scale, offset = _scaled(image)
    packed = f"{image.dtype.name}, {'tiles' if image.tiled else 'strips'}, {image.compression}" + (
        f", predictor {image.predictor}" if image.predictor > 1 else ""
    )
    raster = Raster(
        file, "BigTIFF" if image.big else "GeoTIFF", image.rows, image.columns, origin, step, crs, registration,
        _datum(keys, path), _unit_m(keys, image), _Pixels(path, image, scale, offset), packed,
    )  # fmt: skip
    _check_place(raster)
    return raster


def _geo_keys(image: TiffImage) -> dict[int, int]:
    """Keys of the file that are whole numbers."""
    directory = image.tags.get(_KEYS)
    if not isinstance(directory, tuple) or len(directory) < 4:
        remedy = "gdal_translate -a_srs EPSG:… -a_ullr … says where it lies"
        raise InputError("does not state its position on the Earth (no GeoTIFF keys)", image.file, remedy=remedy)
    entries = np.array(directory[4 : 4 + 4 * int(directory[3])], dtype=np.int64)
    entries = entries[: len(entries) // 4 * 4].reshape(-1, 4)
    return {int(key): int(value) for key, place, _, value in entries if place == 0}


def _placed(image: TiffImage) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (x, y) of the tie point moved to the first pixel, and the steps of columns and rows."""
    tags = image.tags
    scale, tie, matrix = tags.get(_SCALE), tags.get(_TIE), tags.get(_TRANSFORM)
    if isinstance(matrix, tuple) and len(matrix) == 16:
        if matrix[1] or matrix[4]:
            remedy = "gdalwarp -t_srs EPSG:4326 writes it with rows from west to east"
            raise InputError("is rotated: its rows do not follow the axes", image.file, remedy=remedy)
        origin, step = (matrix[3], matrix[7]), (matrix[0], matrix[5])
    elif isinstance(scale, tuple) and isinstance(tie, tuple) and len(scale) >= 2 and len(tie) >= 6:
        step = scale[0], -scale[1]
        origin = tie[3] - tie[0] * step[0], tie[4] - tie[1] * step[1]
    else:
        remedy = "gdal_translate -a_ullr … says where it lies"
        raise InputError("does not state its position on the Earth (no scale and tie point)", image.file, remedy=remedy)
    if not (all(map(math.isfinite, (*origin, *step))) and step[0] > 0.0 and step[1] != 0.0):
        raise InputError("has an impossible scale", image.file, value=step, remedy="gdal_translate -a_ullr … says where it lies")  # fmt: skip
    return origin, step


def _crs_of(keys: dict[int, int], file: str) -> str:
    code = keys.get(_PROJECTED) if keys.get(_MODEL) == 1 else keys.get(_GEOGRAPHIC)
    if keys.get(_MODEL) not in (1, 2) or code in (None, 0, _USER):
        remedy = "gdalwarp -t_srs EPSG:4326 writes it in longitude and latitude"
        raise InputError("is in a coordinate system without an EPSG code", file, remedy=remedy)
    return WGS84 if code in _LIKE_WGS84 else checked_crs(f"EPSG:{code}", file)


def _datum(keys: dict[int, int], path: Path) -> str:
    """Datum of the heights, from the file or its publisher."""
    code = keys.get(_VERTICAL)
    if code is not None and code not in (0, _USER):
        return _DATUMS.get(code, f"EPSG:{code}")
    if keys.get(_MODEL) == 2 and keys.get(_GEOGRAPHIC) == 4979:
        return "ellipsoid"
    return "EGM2008" if COPERNICUS.match(path.name) else "unknown"


def _unit_m(keys: dict[int, int], image: TiffImage) -> float:
    """Length of the unit of the heights: that of the vertical system, else that of GDAL's metadata, else a metre."""
    text = image.tags.get(_METADATA)
    match = re.search(r'role="unittype"[^>]*>\s*([^<]+?)\s*<', text) if isinstance(text, str) else None
    vertical = keys.get(_VERTICAL, 0)
    name: object
    if _VERTICAL_UNIT not in keys and vertical not in (0, _USER):
        found, name = vertical_unit_m(vertical), vertical
    elif _VERTICAL_UNIT in keys:
        found, name = _VERTICAL_METRES.get(keys[_VERTICAL_UNIT]), keys[_VERTICAL_UNIT]
    else:
        word = match[1] if match is not None else "m"
        found, name = _UNITS_M.get(word.lower()), word
    if found is None:
        remedy = "write the heights in metres: gdal_calc.py -A FILE --calc=A*FACTOR"
        raise InputError("has heights in a unit that is not known", image.file, value=name, remedy=remedy)
    return found


def _scaled(image: TiffImage) -> tuple[float, float]:
    """Scale and offset of the stored numbers, from GDAL's metadata."""
    text = image.tags.get(_METADATA)
    found = [1.0, 0.0]
    for place, role in enumerate(("scale", "offset")):
        match = re.search(rf'role="{role}"[^>]*>\s*([-+0-9.eE]+)\s*<', text) if isinstance(text, str) else None
        if match is not None:
            found[place] = float(match[1])
    return found[0], found[1]


def _check_place(raster: Raster) -> None:
    """Refuse a geographic grid beyond the Earth: usually latitude and longitude are exchanged."""
    if not raster.is_geographic:
        return
    x0, y0 = raster.origin
    x1, y1 = x0 + raster.step[0] * (raster.columns - 1), y0 + raster.step[1] * (raster.rows - 1)
    edge = 1.0  # a cell may extend beyond a pole
    if min(y0, y1) < -90.0 - edge or max(y0, y1) > 90.0 + edge or x0 < -360.0 or x1 > 360.0 + edge:
        box = f"x {x0:g} to {x1:g}, y {min(y0, y1):g} to {max(y0, y1):g}"
        remedy = "x is the longitude: latitude and longitude look swapped"
        raise InputError("lies beyond the Earth", raster.file, value=box, remedy=remedy)
