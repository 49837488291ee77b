"""Areas of zones: polygons from published rings, circles and arcs, in longitude and latitude."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import shapely
    from numpy.typing import NDArray

    from skyway.models.airspace.notes import Notes

MAX_VERTICES = 1_000_000
"""Of one area."""
CORNERS = 96
"""Of a circle; its polygon lies outside the circle, by 0.05 % of the radius at most."""
THIN_M = 100.0
"""Lines and points are widened by this."""
MAX_RADIUS_M = 1_000_000.0
WIDER = 1.011
"""Margins are enlarged by this, for the arcs of 32 corners about a corner (1 / cos(pi / 32)), and degrees of latitude of 110.6 km."""
Place = tuple[float, float]
"""Longitude and latitude, degrees."""


def circle(lon: float, lat: float, radius_m: float, notes: Notes) -> shapely.Geometry | None:
    """Return the polygon of a circle; None, with a fault, if the circle is impossible."""
    import shapely

    if not _sound([(lon, lat)], notes):
        return None
    if not 0.0 < radius_m <= MAX_RADIUS_M:
        notes.wrong("radius", "out of range", radius_m, f"above 0 and up to {distance_text(MAX_RADIUS_M)}")
        return None
    bearing = np.linspace(0.0, 360.0, CORNERS, endpoint=False)
    return shapely.Polygon(_around(lon, lat, radius_m / math.cos(math.pi / CORNERS), bearing))


def arc(lon: float, lat: float, radius_m: float, from_deg: float, to_deg: float, *, clockwise: bool) -> list[Place]:
    """Return places on an arc about a point, its ends included; a whole circle where both bearings are the same."""
    turn = (to_deg - from_deg if clockwise else from_deg - to_deg) % 360.0 or 360.0
    count = max(2, math.ceil(turn / 360.0 * CORNERS) + 1)
    bearing = from_deg + np.linspace(0.0, turn, count) * (1.0 if clockwise else -1.0)
    return [(float(x), float(y)) for x, y in _around(lon, lat, radius_m, bearing)]


def _around(lon: float, lat: float, radius_m: float, bearing_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places at a distance from a point, shape (bearings, 2), their longitudes next to that of the point."""
    places = np.array([geodesy.direct(lat, lon, float(bearing), radius_m)[::-1] for bearing in bearing_deg])
    places[:, 0] = lon + (places[:, 0] - lon + 180.0) % 360.0 - 180.0
    return places


def polygon(rings: Sequence[Sequence[Place]], notes: Notes) -> shapely.Geometry | None:
    """Return the area of an outer ring and its holes; None, with a fault, if it is not on the Earth.

    An open ring is closed. A ring that crosses itself, or encloses nothing, is replaced by its convex hull, which
    contains every possible meaning of it, with a note. Fewer than three corners are a fault: the area may lie on any side of them.
    """
    import shapely

    if not rings or not rings[0]:
        notes.wrong("geometry", "has no coordinates", None, "give the zone an area, or take it out of the file")
        return None
    if sum(map(len, rings)) > MAX_VERTICES:
        notes.wrong("geometry", "has too many vertices", sum(map(len, rings)), f"up to {MAX_VERTICES}")
        return None
    if not all(_sound(ring, notes) for ring in rings):
        return None
    if len(set(rings[0])) < 3:
        remedy = "give the zone its outline, or take it out of the file"
        notes.wrong("geometry", "has fewer than three different corners", None, remedy)
        return None
    closed = [_next_to_each_other(ring) for ring in rings]
    holes = [hole for hole in closed[1:] if len({tuple(place) for place in hole.tolist()}) >= 3]
    area = shapely.Polygon(closed[0], holes)
    if area.is_valid and not area.is_empty:
        return area
    outline = shapely.MultiPoint(closed[0]).convex_hull
    if not isinstance(outline, shapely.Polygon):
        lat = float(np.abs(closed[0][:, 1]).max())
        outline = _widened(outline, THIN_M, lat)
    counted = "counted as the convex hull of its corners; put them in order"
    notes.closed("geometry", "is not a valid polygon", shapely.is_valid_reason(area), counted)
    return outline


def joined(areas: Iterable[shapely.Geometry]) -> shapely.Geometry:
    """Return all of some areas as one."""
    import shapely

    parts = list(areas)
    return parts[0] if len(parts) == 1 else shapely.union_all(parts)


def widened(areas: Sequence[shapely.Geometry], margin_m: float) -> NDArray[np.object_]:
    """Return areas widened by at least a margin on all sides."""
    import shapely

    found = np.array(areas, dtype=object)
    if margin_m <= 0.0 or not len(found):
        return found
    # Degrees of longitude are scaled to the length of those of latitude where they are shortest, then buffered, and scaled back.
    bounds = shapely.bounds(found)
    cos_lat = np.cos(np.radians(np.minimum(np.maximum(np.abs(bounds[:, 1]), np.abs(bounds[:, 3])) + 0.01, 89.0)))
    xy, of = shapely.get_coordinates(found, return_index=True)
    scaled = shapely.set_coordinates(found.copy(), xy * np.column_stack((cos_lat[of], np.ones(len(of)))))
    wide = shapely.buffer(scaled, WIDER * margin_m / geodesy.M_PER_DEG, quad_segs=8)
    xy, of = shapely.get_coordinates(wide, return_index=True)
    result = shapely.set_coordinates(wide, xy / np.column_stack((cos_lat[of], np.ones(len(of)))))
    return np.asarray(result, dtype=object)


def _widened(area: shapely.Geometry, margin_m: float, lat: float) -> shapely.Geometry:
    import shapely

    cos_lat = max(math.cos(math.radians(lat)), 0.01)
    scaled = shapely.transform(area, lambda xy: xy * (cos_lat, 1.0))
    wide = scaled.buffer(margin_m / geodesy.M_PER_DEG)
    return shapely.transform(wide, lambda xy: xy / (cos_lat, 1.0))


def _sound(ring: Sequence[Place], notes: Notes) -> bool:
    """Whether all places are on the Earth; a place that is not is a fault."""
    places = np.array(ring, dtype=np.float64).reshape(-1, 2)
    wrong = ~((np.abs(places[:, 0]) <= 180.0) & (np.abs(places[:, 1]) <= 90.0))
    if not wrong.any():
        return True
    lon, lat = places[int(np.argmax(wrong))].tolist()
    swapped = abs(lat) <= 180.0 and abs(lon) <= 90.0
    remedy = "lat and lon look swapped: GeoJSON has longitude first" if swapped else "degrees, longitude first"
    notes.wrong("coordinates", "has coordinates out of range", (lon, lat), remedy)
    return False


def _next_to_each_other(ring: Sequence[Place]) -> NDArray[np.float64]:
    """Places of a ring with their longitudes continued across the 180th meridian, shape (places, 2)."""
    places = np.array(ring, dtype=np.float64).reshape(-1, 2)
    if np.ptp(places[:, 0]) > 180.0:
        unwrapped: Any = np.unwrap(places[:, 0], period=360.0)
        if abs(unwrapped[-1] - unwrapped[0]) < 180.0:  # otherwise it goes around a pole
            places = np.column_stack((unwrapped, places[:, 1]))
    return places
