"""No-fly zones: polygons that no segment may cross and no station may lie in."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError, one_line, refuse
from skyway.models.base.files import read_text

if TYPE_CHECKING:
    from pathlib import Path

    import shapely
    from numpy.typing import NDArray

MAX_BYTES = 64 * 1024 * 1024
CHORD_M = 10_000.0
"""Geodesics are tested as chains of straight pieces in longitude and latitude, none longer than this.

At 10 km and 60 degrees of latitude such a piece lies within 4 m of the geodesic.
"""


@dataclass(frozen=True)
class NoFlyZones:
    """Named polygons in longitude and latitude (x, y), degrees."""

    names: tuple[str, ...]
    """One per polygon."""
    polygons: tuple[shapely.Geometry, ...]
    """Valid and not empty."""

    def crossed_by(
        self,
        lat1: NDArray[np.float64],
        lon1: NDArray[np.float64],
        lat2: NDArray[np.float64],
        lon2: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Return which geodesics touch any zone; shape (segments,)."""
        import shapely  # imported late: 60 ms

        length, _ = geodesy.inverse(lat1, lon1, lat2, lon2)
        crossed = np.zeros(len(length), dtype=bool)
        if not self.polygons or not len(length):
            return crossed
        short = length <= CHORD_M
        lines = np.empty(len(length), dtype=object)
        over = np.abs(lon2 - lon1) > 180.0  # across the antimeridian: go on beyond 180 degrees
        ends = np.stack((lon1, lat1, np.where(over, lon2 + np.copysign(360.0, lon1), lon2), lat2), axis=1)
        lines[short] = shapely.linestrings(ends[short].reshape(-1, 2, 2)) if short.any() else []
        for i in np.flatnonzero(~short):
            inner = geodesy.along(lat1[i], lon1[i], lat2[i], lon2[i], int(length[i] // CHORD_M))
            lon = np.unwrap([lon1[i], *(lon for _, lon in inner), lon2[i]], period=360.0)
            lines[i] = shapely.LineString(np.column_stack((lon, [lat1[i], *(lat for lat, _ in inner), lat2[i]])))
        crossed[np.unique(self._tree.query(lines, predicate="intersects")[0])] = True
        bounds = shapely.bounds(lines)
        for shift, beyond in ((-360.0, bounds[:, 2] > 180.0), (360.0, bounds[:, 0] < -180.0)):
            again = np.flatnonzero(beyond)
            moved = shapely.transform(lines[again], lambda xy, east=shift: xy + np.array((east, 0.0)))
            crossed[again[np.unique(self._tree.query(moved, predicate="intersects")[0])]] = True
        return crossed

    def contains(self, lat: float, lon: float) -> str | None:
        """Name of a zone that holds the point, or None."""
        return self.holding(np.array([lat]), np.array([lon])).get(0)

    def holding(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> dict[int, str]:
        """Name of a zone by the index of each point that lies in one, its border included."""
        import shapely

        points, polygons = self._tree.query(shapely.points(lon, lat), predicate="covered_by")
        return {int(i): self.names[int(k)] for i, k in zip(points, polygons, strict=True)}

    @cached_property
    def _tree(self) -> shapely.STRtree:
        import shapely

        return shapely.STRtree(np.array(self.polygons, dtype=object))


def read_zones(path: Path) -> NoFlyZones:
    """Read no-fly polygons from a GeoJSON FeatureCollection, Feature or bare geometry.

    An `InputError` lists everything that is no GeoJSON, or no valid polygon.
    """
    file = str(path)
    document = read_geojson(path)
    faults: list[Fault] = []
    names: list[str] = []
    polygons: list[shapely.Geometry] = []
    for number, feature in enumerate(features(document, file)):
        properties = feature.get("properties")
        labels = properties if isinstance(properties, dict) else {}
        name = one_line(str(labels.get("name") or labels.get("id") or f"zone {number + 1}"))
        polygon = _polygon(feature.get("geometry"), name, Fault("", file, None, f"features[{number}]"))
        if isinstance(polygon, Fault):
            faults.append(polygon)
        else:
            names.append(name)
            polygons.append(polygon)
    refuse(faults)
    return NoFlyZones(tuple(names), tuple(polygons))


def _polygon(geometry: object, name: str, place: Fault) -> shapely.Geometry | Fault:
    """Return the polygon of a GeoJSON geometry, or what is wrong with it."""
    import shapely
    from shapely.geometry import shape

    if not isinstance(geometry, dict) or geometry.get("type") not in {"Polygon", "MultiPolygon"}:
        kind = geometry.get("type") if isinstance(geometry, dict) else geometry
        return replace(place, problem="is not a polygon", value=kind, remedy="zones are Polygon or MultiPolygon")
    try:
        with np.errstate(invalid="ignore"):
            polygon = shape(geometry)
            reason = None if polygon.is_valid else shapely.is_valid_reason(polygon)
    except (ValueError, TypeError, ArithmeticError, AttributeError, LookupError, shapely.errors.ShapelyError) as error:
        return replace(place, problem=f"is not a valid polygon: {error}", value=name)
    if polygon.is_empty:
        return replace(place, problem="is empty", value=name)
    west, south, east, north = polygon.bounds
    if not (-180 <= west <= east <= 180 and -90 <= south <= north <= 90):
        remedy = "GeoJSON has longitude first, then latitude"
        return replace(place, problem="has coordinates out of range", value=name, remedy=remedy)
    if reason is not None:
        return replace(place, problem=f"is not valid: {reason}", value=name)
    return polygon


def read_geojson(path: Path) -> dict[str, Any]:
    """Read a file that must hold one GeoJSON object."""
    try:
        document = json.loads(read_text(path, max_bytes=MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", str(path)) from error
    if not isinstance(document, dict) or "type" not in document:
        raise InputError("is not GeoJSON", str(path), remedy="expected a FeatureCollection")
    return document


def features(document: dict[str, Any], file: str) -> list[dict[str, Any]]:
    """Return the features of a GeoJSON object of any kind; an `InputError` for a collection without a list of them."""
    if document["type"] == "FeatureCollection":
        found = document.get("features")
        if not isinstance(found, list):
            raise InputError("must be a list", file, None, "features", found)
        return [feature if isinstance(feature, dict) else {} for feature in found]
    if document["type"] == "Feature":
        return [document]
    return [{"type": "Feature", "geometry": document, "properties": {}}]
