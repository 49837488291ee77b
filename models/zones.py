"""No-fly zones: polygons that no segment may cross and no station may lie in."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models import geodesy
from models.errors import Fault, InputError
from models.files import read_bytes

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
    """Named polygons in longitude and latitude (x, y), degrees.

    Attributes
    ----------
    names : tuple of str
        One per polygon.
    polygons : tuple of shapely Polygon or MultiPolygon
        Valid and not empty.
    """

    names: tuple[str, ...]
    polygons: tuple[shapely.Geometry, ...]

    def crossed_by(
        self,
        lat1: NDArray[np.float64],
        lon1: NDArray[np.float64],
        lat2: NDArray[np.float64],
        lon2: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Tell which geodesics touch any zone; shape (segments,)."""
        import shapely  # imported late: 60 ms

        length, _ = geodesy.inverse(lat1, lon1, lat2, lon2)
        crossed = np.zeros(len(length), dtype=bool)
        if not self.polygons or not len(length):
            return crossed
        short = length <= CHORD_M
        lines = np.empty(len(length), dtype=object)
        ends = np.stack((np.column_stack((lon1, lat1)), np.column_stack((lon2, lat2))), axis=1)
        lines[short] = shapely.linestrings(ends[short]) if short.any() else []
        for i in np.flatnonzero(~short):
            inner = geodesy.along(lat1[i], lon1[i], lat2[i], lon2[i], int(length[i] // CHORD_M))
            points = [(lon1[i], lat1[i]), *((lon, lat) for lat, lon in inner), (lon2[i], lat2[i])]
            lines[i] = shapely.LineString(points)
        tree = shapely.STRtree(np.array(self.polygons, dtype=object))
        crossed[np.unique(tree.query(lines, predicate="intersects")[0])] = True
        return crossed

    def contains(self, lat: float, lon: float) -> str | None:
        """Name of a zone that holds the point, or None."""
        import shapely

        point = shapely.Point(lon, lat)
        for name, polygon in zip(self.names, self.polygons, strict=True):
            if polygon.covers(point):
                return name
        return None


def read_zones(path: Path) -> NoFlyZones:
    """Read no-fly polygons from a GeoJSON FeatureCollection, Feature or bare geometry.

    Raises
    ------
    InputError
        Not GeoJSON, or with geometries that are no valid polygons; every fault is listed.
    """
    import shapely
    from shapely.geometry import shape

    file = str(path)
    document = read_geojson(path)
    names: list[str] = []
    polygons: list[shapely.Geometry] = []
    faults: list[Fault] = []
    for number, feature in enumerate(features(document)):
        field = f"features[{number}]"
        geometry = feature.get("geometry")
        properties = feature.get("properties") or {}
        name = str(properties.get("name") or properties.get("id") or f"zone {number + 1}")
        if not isinstance(geometry, dict) or geometry.get("type") not in ("Polygon", "MultiPolygon"):
            kind = geometry.get("type") if isinstance(geometry, dict) else geometry
            faults.append(Fault("is not a polygon", file, None, field, kind, "zones are Polygon or MultiPolygon"))
            continue
        try:
            polygon = shape(geometry)
        except (
            ValueError,
            TypeError,
            AttributeError,
            IndexError,
            KeyError,
            shapely.errors.ShapelyError,
        ) as error:
            faults.append(Fault(f"is not a valid polygon: {error}", file, None, field))
            continue
        if polygon.is_empty or not polygon.is_valid:
            reason = "is empty" if polygon.is_empty else f"is not valid: {shapely.is_valid_reason(polygon)}"
            faults.append(Fault(reason, file, None, field, name))
            continue
        west, south, east, north = polygon.bounds
        if not (-180 <= west <= east <= 180 and -90 <= south <= north <= 90):
            remedy = "GeoJSON has longitude first, then latitude"
            faults.append(Fault("has coordinates out of range", file, None, field, name, remedy))
            continue
        names.append(name)
        polygons.append(polygon)
    if faults:
        raise InputError(faults)
    return NoFlyZones(tuple(names), tuple(polygons))


def read_geojson(path: Path) -> dict[str, Any]:
    """Read a file that must hold one GeoJSON object."""
    try:
        document = json.loads(read_bytes(path, max_bytes=MAX_BYTES).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(Fault(f"is not JSON: {error}", str(path))) from None
    if not isinstance(document, dict) or "type" not in document:
        raise InputError(Fault("is not GeoJSON", str(path), remedy="expected a FeatureCollection"))
    return document


def features(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the features of a GeoJSON object, whatever of the three kinds it is."""
    if document["type"] == "FeatureCollection":
        found = document.get("features")
        return [f if isinstance(f, dict) else {} for f in found] if isinstance(found, list) else []
    if document["type"] == "Feature":
        return [document]
    return [{"type": "Feature", "geometry": document, "properties": {}}]
