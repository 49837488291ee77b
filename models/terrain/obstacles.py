"""Obstacles: towers, cranes, lines and buildings, as points with a height, from CSV or GeoJSON.

A height is above the ground or above mean sea level, in metres or feet, according to the name of its column or property.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError, one_line
from skyway.models.base.fields import finite
from skyway.models.base.files import read_text
from skyway.models.base.table import FaultCollector, read_table

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

FOOT_M = 0.3048
ABOVE_GROUND = {"height_m": 1.0, "agl_m": 1.0, "height_agl_m": 1.0, "height_ft": FOOT_M, "agl_ft": FOOT_M, "height_agl_ft": FOOT_M}  # fmt: skip
ABOVE_SEA = {"top_m": 1.0, "amsl_m": 1.0, "elevation_m": 1.0, "top_ft": FOOT_M, "amsl_ft": FOOT_M, "elevation_ft": FOOT_M}  # fmt: skip
"""Columns and properties that hold a height, with the length of its unit."""
UNITLESS = ("height", "agl", "amsl", "top", "elevation", "hgt", "height_agl", "height_amsl")
_LATITUDE, _LONGITUDE = ("lat", "latitude", "latdec"), ("lon", "lng", "longitude", "londec")
_NAMES = ("name", "id", "oas")
TALLEST_M = 900.0
"""No structure is taller: a greater height is in feet, or above the sea."""
HIGHEST_M = 10_000.0
MOST_RADIUS_M = 5_000.0
_MEASURE = re.compile(r"\s*([0-9.]+)\s*(m|ft|')\s*")
MAX_BYTES = 256 * 1024 * 1024
MAX_POINTS = 2_000_000
EVERY_M = 20.0
"""Spacing of points on lines and outlines."""
_ARRAYS = ("lat", "lon", "agl_m", "amsl_m", "radius_m")
_FIX = "name the column or property height_m, height_ft (above ground), top_m or top_ft (above sea level)"


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Points with a height.

    Attributes
    ----------
    names : tuple of str
        Of each point.
    lat, lon : ndarray
        Degrees.
    agl_m, amsl_m : ndarray
        Height above ground and of the top above mean sea level; NaN if not given.
    radius_m : ndarray
        Its extent about the point, such as the jib of a crane.
    files : tuple of (str, int)
        Files in the order of the points, with the number of points of each.
    """

    names: tuple[str, ...] = ()
    lat: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    lon: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    agl_m: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    amsl_m: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    radius_m: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    files: tuple[tuple[str, int], ...] = ()

    def by_file(self) -> Iterator[tuple[str, Obstacles]]:
        """Yield each file with its points."""
        start = 0
        for file, count in self.files:
            part = slice(start, start + count)
            lat, lon, agl_m, amsl_m, radius_m = (getattr(self, one)[part] for one in _ARRAYS)
            yield file, Obstacles(self.names[part], lat, lon, agl_m, amsl_m, radius_m, ((file, count),))
            start += count

    def __len__(self) -> int:
        return len(self.names)

    def tops_m(self, points: NDArray[np.int64], ground_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tops above mean sea level of some points over the ground there: the higher where both are given; infinite where unknown."""
        top = np.fmax(self.amsl_m[points], ground_m + self.agl_m[points])
        return np.where(np.isnan(top), np.inf, top)

    def within(self, lat: NDArray[np.float64], lon: NDArray[np.float64], radius_m: float) -> NDArray[np.int64]:
        """Numbers of the points that may lie within a radius of some places."""
        if not len(self) or not len(lat):
            return np.empty(0, dtype=np.int64)
        reach = (radius_m + self.radius_m) / 110_000.0
        middle = float(lon[0])
        here, there = geodesy.about(lon, middle), geodesy.about(self.lon, middle)
        wide = reach / math.cos(math.radians(min(float(np.abs(lat).max()) + 1.0, 89.0)))
        near = (self.lat >= lat.min() - reach) & (self.lat <= lat.max() + reach)
        return np.flatnonzero(near & (there >= here.min() - wide) & (there <= here.max() + wide))

    def highest(
        self, points: NDArray[np.int64], lat: NDArray[np.float64], lon: NDArray[np.float64], radius_m: float,
        tops_m: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # fmt: skip
        """Highest top of some points within a radius of places, and its number; NaN and -1 where there is none, shape (places,)."""
        top, which = np.full(len(lat), np.nan), np.full(len(lat), -1, dtype=np.int64)
        if not len(points):
            return top, which
        from scipy.spatial import cKDTree

        places = cKDTree(geodesy.earth_xyz(np.column_stack((lat, lon))))
        there = geodesy.earth_xyz(np.column_stack((self.lat[points], self.lon[points])))
        found = places.query_ball_point(there, radius_m + self.radius_m[points])
        for number in np.argsort(tops_m[points], kind="stable").tolist():  # the highest last
            reached = found[number]
            top[reached], which[reached] = tops_m[points[number]], points[number]
        return top, which


def joined(parts: Sequence[Obstacles]) -> Obstacles:
    """All points of several files."""
    if len(parts) == 1:
        return parts[0]
    names = tuple(name for part in parts for name in part.names)
    lat, lon, agl_m, amsl_m, radius_m = (
        np.concatenate([np.empty(0), *(getattr(part, one) for part in parts)]) for one in _ARRAYS
    )
    files = tuple(file for part in parts for file in part.files)
    return Obstacles(names, lat, lon, agl_m, amsl_m, radius_m, files)


def read_obstacles(path: Path) -> Obstacles:
    """Read obstacles from CSV, or GeoJSON by its suffix; an `InputError` lists every one without a place or a height."""
    if path.suffix.lower() in (".geojson", ".json"):
        return _of_geojson(path)
    return _of_csv(path)


@dataclass(frozen=True, slots=True)
class _Where:
    """Location of an obstacle in its file: a line, or a feature."""

    line: int | None = None
    feature: str | None = None

    def field(self, key: str | None) -> str | None:
        """Name of a field of it."""
        return ".".join(one for one in (self.feature, key) if one is not None) or None


class _Points:
    """Points found so far, and the faults of others."""

    def __init__(self, file: str) -> None:
        self.faults = FaultCollector(file)
        self.names: list[str] = []
        self.rows: list[tuple[float, float, float, float, float]] = []

    def fault(self, where: _Where, problem: str, remedy: str, key: str | None = None, value: object = None) -> None:
        """Note a fault."""
        self.faults.add(problem, remedy, line=where.line, field=where.field(key), value=value)

    def height(self, given: Mapping[str, Any], where: _Where) -> tuple[float, float, float] | None:
        """Height above ground, above the sea, and the radius, metres; a fault and None if there is none."""
        given = _with_units(given)
        found = [math.nan, math.nan]
        for place, table in enumerate((ABOVE_GROUND, ABOVE_SEA)):
            for key, unit_m in table.items():
                if _empty(given.get(key)):
                    continue
                metres = (finite(given[key]) or math.nan) * unit_m if finite(given[key]) != 0.0 else 0.0
                low, high = (0.0, TALLEST_M) if place == 0 else (-500.0, HIGHEST_M)
                if not low <= metres <= high:
                    tall = "; is it in feet, or above sea level? " + _FIX if metres > high else ""
                    self.fault(where, "is not a height of an obstacle", f"{low:g} to {high:g} m{tall}", key, given[key])
                    return None
                found[place] = metres
        if math.isnan(found[0]) and math.isnan(found[1]):
            bare = next((key for key in UNITLESS if not _empty(given.get(key))), None)
            if bare is None:
                self.fault(where, "has no height", _FIX)
            else:
                problem = "has no unit and no datum"
                self.fault(where, problem, _FIX, bare, given[bare])
            return None
        radius = 0.0 if _empty(given.get("radius_m")) else finite(given["radius_m"])
        if radius is None or not 0.0 <= radius <= MOST_RADIUS_M:
            self.fault(where, "is not a radius", f"0 to {MOST_RADIUS_M:g} m", "radius_m", given["radius_m"])
            return None
        return found[0], found[1], radius

    def place(self, lat: Any, lon: Any, where: _Where) -> tuple[float, float] | None:
        """Latitude and longitude; a fault and None if they are invalid."""
        found = finite(lat), finite(lon)
        if found[0] is None or found[1] is None:
            self.fault(where, "has no place", "degrees: lat and lon", value=f"{lat},{lon}")
            return None
        faults = geodesy.coordinate_faults(found[0], found[1])
        for fault in faults:
            self.fault(where, fault.problem, fault.remedy or "", fault.field, fault.value)
        return None if faults else (found[0], found[1])

    def add(self, name: str, at: tuple[float, float], height: tuple[float, float, float]) -> None:
        """Add a point."""
        if len(self.rows) >= MAX_POINTS:
            raise InputError(f"holds more than {MAX_POINTS:,} points", self.faults.file, remedy="cut it to the region wanted")  # fmt: skip
        self.names.append(name)
        self.rows.append((*at, *height))

    def done(self) -> Obstacles:
        """Return the points; all faults are raised together."""
        self.faults.raise_if_any()
        columns = np.array(self.rows, dtype=np.float64).reshape(-1, 5).T
        lat, lon, agl_m, amsl_m, radius_m = (np.ascontiguousarray(column) for column in columns)
        files = ((self.faults.file or "", len(self.names)),)
        return Obstacles(tuple(self.names), lat, lon, agl_m, amsl_m, radius_m, files)


def _empty(value: object) -> bool:
    return value is None or (isinstance(value, str) and not value.strip())


def _with_units(given: Mapping[str, Any]) -> dict[str, Any]:
    """Heights with their unit beside the number, ``400 ft``, under the name of a column that contains it."""
    read = dict(given)
    for key in UNITLESS:
        found = _MEASURE.fullmatch(str(given.get(key, "")))
        if found is not None:
            kind = "top" if key in ("amsl", "top", "elevation", "height_amsl") else "height"
            read[f"{kind}_{'m' if found[2] == 'm' else 'ft'}"] = found[1]
    return read


def _of_csv(path: Path) -> Obstacles:
    points = _Points(str(path))
    for chunk in read_table(path, None, points.faults):
        low = {name.strip().lower(): name for name in chunk.columns}
        if "oas" in low and "latdec" in low:  # the FAA's Digital Obstacle File is in feet
            low |= {f"{kind}_ft": low.pop(kind) for kind in ("agl", "amsl") if kind in low}
        lat, lon, name = (next((one for one in names if one in low), None) for names in (_LATITUDE, _LONGITUDE, _NAMES))
        if lat is None or lon is None:
            has = "the file has the columns " + ", ".join(chunk.columns)
            raise InputError("no such column", str(path), 1, "lat" if lat is None else "lon", remedy=has)
        for row, line in enumerate(chunk.lines):
            given, where = {key: chunk.columns[column][row] for key, column in low.items()}, _Where(line)
            at, height = points.place(given[lat], given[lon], where), points.height(given, where)
            if at is not None and height is not None:
                label = one_line(given[name].strip()) if name is not None else ""
                points.add(label or f"line {line}", at, height)
        points.faults.raise_if_hopeless()
    return points.done()


def _of_geojson(path: Path) -> Obstacles:
    points = _Points(str(path))
    try:
        document = json.loads(read_text(path, max_bytes=MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", str(path)) from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise InputError("is not a FeatureCollection of GeoJSON", str(path))
    for number, feature in enumerate(features):
        where = _Where(feature=f"features[{number}]")
        given = feature.get("properties") if isinstance(feature, dict) else None
        given = {str(key).lower(): value for key, value in given.items()} if isinstance(given, dict) else {}
        name = one_line(
            str(next((given[key] for key in _NAMES if not _empty(given.get(key))), f"feature {number + 1}"))
        )
        height = points.height(given, where)
        try:
            for lon, lat in _outline(feature.get("geometry")):
                at = points.place(lat, lon, where)
                if at is None or height is None:
                    break
                points.add(name, at, height)
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            points.fault(where, f"has no geometry that is read: {error}", "Point, LineString or Polygon")
        points.faults.raise_if_hopeless()
    return points.done()


def _outline(geometry: Any) -> Iterator[tuple[Any, Any]]:
    """Points (lon, lat) of a geometry: along a line at a spacing, over an area on a grid."""
    kind, coordinates = geometry["type"], geometry.get("coordinates")
    if kind == "Point":
        yield coordinates[0], coordinates[1]
    elif kind == "LineString":
        yield coordinates[0][0], coordinates[0][1]
        for start, end in pairwise(coordinates):
            length = geodesy.distance_m(float(start[1]), float(start[0]), float(end[1]), float(end[0]))
            for lat, lon in geodesy.along(start[1], start[0], end[1], end[0], min(int(length / EVERY_M), MAX_POINTS)):
                yield lon, lat
            yield end[0], end[1]
    elif kind == "Polygon":
        for ring in coordinates:
            yield from _outline({"type": "LineString", "coordinates": ring})
        yield from _inside(geometry)
    elif kind.startswith("Multi"):
        for part in coordinates:
            yield from _outline({"type": kind[5:], "coordinates": part})
    elif kind == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from _outline(part)
    else:
        raise ValueError(kind)


def _inside(geometry: Any) -> Iterator[tuple[float, float]]:
    """Points of a grid within a polygon."""
    import shapely
    from shapely.geometry import shape

    polygon = shape(geometry)
    west, south, east, north = polygon.bounds
    lat_step = EVERY_M / 111_000.0
    lon_step = lat_step / math.cos(math.radians(min(abs(south), 85.0)))
    if (north - south) / lat_step * (east - west) / lon_step > MAX_POINTS:
        raise ValueError("larger than an obstacle")
    lon, lat = np.meshgrid(np.arange(west, east, lon_step), np.arange(south, north, lat_step))
    within = shapely.contains_xy(polygon, lon, lat)
    yield from zip(lon[within].tolist(), lat[within].tolist(), strict=True)
