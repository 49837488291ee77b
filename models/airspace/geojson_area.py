"""Areas of GeoJSON geometries, with circles as ED-318 writes them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.airspace import areas

if TYPE_CHECKING:
    import shapely

    from skyway.models.airspace.areas import Place
    from skyway.models.airspace.notes import Notes


def number(value: object) -> float:
    """Return a number, NaN for any other value."""
    if isinstance(value, bool):
        return math.nan
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def places(value: object, notes: Notes) -> list[Place]:
    """Return positions as (longitude, latitude); an empty list, with a fault, if one is not a position."""
    found: list[Place] = []
    for one in value if isinstance(value, list) else [value]:
        if not isinstance(one, list | tuple) or len(one) < 2:
            notes.wrong("coordinates", "is not a position", one, "longitude and latitude, degrees")
            return []
        lon, lat = number(one[0]), number(one[1])
        if not (math.isfinite(lon) and math.isfinite(lat)):
            notes.wrong("coordinates", "is not a position", one, "longitude and latitude, degrees")
            return []
        found.append((lon, lat))
    return found


def area(geometry: object, notes: Notes, radius_m: float | None = None) -> shapely.Geometry | None:
    """Return the area of a Polygon, MultiPolygon, collection of those, or Point with a radius.

    None, with a fault, if it has none. The radius of a point is that of its ``extent``, or the given one.
    """
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind not in ("Polygon", "MultiPolygon", "GeometryCollection", "Point"):
        remedy = "zones are Polygon, MultiPolygon, or Point with a radius"
        notes.wrong("geometry", "is not a polygon", kind or geometry, remedy)
        return None
    if kind == "GeometryCollection":
        members = geometry.get("geometries")
        parts = [area(part, notes, radius_m) for part in (members if isinstance(members, list) else [])]
        return _all(parts, notes)
    coordinates = geometry.get("coordinates")
    if kind == "Point":
        return _circle(geometry, coordinates, notes, radius_m)
    polygons = coordinates if kind == "MultiPolygon" else [coordinates]
    if not isinstance(polygons, list):
        notes.wrong("coordinates", "is not a list of polygons", polygons)
        return None
    return _all([_polygon(one, notes) for one in polygons], notes)


def _all(parts: list[shapely.Geometry | None], notes: Notes) -> shapely.Geometry | None:
    whole = [part for part in parts if part is not None]
    if not parts:
        notes.wrong("geometry", "is empty", None, "give the zone an area, or take it out of the file")
    return areas.joined(whole) if whole and len(whole) == len(parts) else None


def _polygon(rings: object, notes: Notes) -> shapely.Geometry | None:
    if not isinstance(rings, list) or not rings:
        notes.wrong("geometry", "is empty", None, "give the zone an area, or take it out of the file")
        return None
    if rings and isinstance(rings[0], list) and rings[0] and not isinstance(rings[0][0], list | tuple):
        rings = [rings]  # a ring without the list of rings about it
    if not all(isinstance(ring, list) and ring for ring in rings):
        notes.wrong("geometry", "has no coordinates", rings, "a ring is a list of positions")
        return None
    found = [places(ring, notes) for ring in rings]
    return areas.polygon(found, notes) if all(found) else None


def _circle(
    geometry: dict[str, object], coordinates: object, notes: Notes, radius_m: float | None
) -> shapely.Geometry | None:
    extent = geometry.get("extent")
    told = extent.get("radius") if isinstance(extent, dict) else geometry.get("radius", radius_m)
    if told is None:
        notes.wrong("geometry", "is a point without a radius", coordinates, "give it an extent with a radius in metres")
        return None
    at = places([coordinates], notes)
    return areas.circle(*at[0], number(told), notes) if at else None
