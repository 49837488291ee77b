"""Corridors: the inclusion fence around a route and around the ways to its divert stations.

One simple polygon of few vertices, because several inclusion areas mean different things to the two autopilots (PX4:
inside any, ArduPilot: inside all). A diverting vehicle flies straight from wherever it is, so that each segment is
fenced together with the whole triangle to each of its divert stations. Autopilots test fences in the plane of
latitude and longitude; the corridor is built in the same plane, scaled to metres.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.missions.items.coordinates import Point
from skyway.missions.items.geofence import FencePolygon
from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import shapely

LatLon = tuple[float, float]

DEFAULT_WIDTH_M = 400.0
MAX_VERTICES = 70
"""The capacity of the smallest boards of both autopilots, with a margin."""


def corridor(
    route: Sequence[LatLon],
    diverts: Sequence[tuple[Sequence[LatLon], LatLon]] = (),
    *,
    width_m: float = DEFAULT_WIDTH_M,
    max_vertices: int = MAX_VERTICES,
) -> FencePolygon:
    """Return the inclusion polygon around a route, places flown in order, and its diverts.

    Each divert is a part of the route and the station that stays in reach from there. The width is half on either side,
    and is kept everywhere. Raises an `InputError` if it is not between 20 m and 100 km, or if the route crosses the
    180th meridian (neither autopilot has fences across it).
    """
    import shapely

    if not 20.0 <= width_m <= 100_000.0:
        raise InputError(Fault("is not between 20 and 100000 m", field="corridor width", value=width_m))
    places = [*route, *(station for _, station in diverts)]
    scale = geodesy.M_PER_DEG * math.cos(math.radians(min(max(abs(lat) for lat, _ in places), 89.0)))
    west, east = min(lon for _, lon in places), max(lon for _, lon in places)
    if east - west > 180.0:
        raise InputError(
            Fault("the route crosses the 180th meridian, where fences end", remedy="export it without a fence")
        )

    def plane(points: Sequence[LatLon]) -> list[tuple[float, float]]:
        return [
            (round((lon - west) * scale, 3), round(lat * geodesy.M_PER_DEG, 3)) for lat, lon in points
        ]  # to the millimetre

    shapes: list[shapely.Geometry] = [_line(plane(route))]
    for part, station in diverts:
        shapes += [shapely.MultiPoint(plane([*pair, station])).convex_hull for pair in pairwise(part)]
    area = _outline(shapely.union_all(shapes), width_m / 2.0, max_vertices)
    vertices = tuple(
        Point.of_degrees(y / geodesy.M_PER_DEG, x / scale + west) for x, y in list(area.exterior.coords)[:-1]
    )
    return FencePolygon(vertices)


def _line(points: list[tuple[float, float]]) -> shapely.Geometry:
    import shapely

    distinct = [point for i, point in enumerate(points) if i == 0 or point != points[i - 1]]
    return shapely.LineString(distinct) if len(distinct) > 1 else shapely.Point(distinct[0])


def _outline(core: shapely.Geometry, half_width_m: float, max_vertices: int) -> shapely.Polygon:
    """Widen the core and simplify its outline, never below the half width; holes are filled.

    Simplifying moves the outline by at most the tolerance, so the core is first widened by as much.
    """
    import shapely

    for tolerance in (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0):
        slack = tolerance * half_width_m
        wide = core.buffer(half_width_m + slack, quad_segs=2, join_style="mitre", mitre_limit=1.5, cap_style="square")
        outline = shapely.Polygon(wide.exterior).simplify(slack, preserve_topology=True)
        if len(outline.exterior.coords) - 1 <= max_vertices and outline.is_valid:
            return outline
    hull = core.buffer(half_width_m, quad_segs=2, join_style="mitre", cap_style="square").convex_hull
    return hull if len(hull.exterior.coords) - 1 <= max_vertices else hull.envelope
