"""Check of the route against its fence.

Autopilots test fences in the plane of latitude and longitude, and so does this check.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.items.fence_items import CLAIMED_COUNT
from skyway.missions.items.finding import Finding
from skyway.missions.items.geofence import FencePolygon
from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import shapely
    from numpy.typing import NDArray

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.route import Route
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.geofence import FenceCircle, Geofence

MAX_FINDINGS = 20
_CIRCLE_CORNERS = 128


def check_fence(document: MissionDocument, route: Route, autopilot: Family | None) -> Iterator[Finding]:
    """Check the fence itself, and that route, rally points and the ways to them lie in it.

    Whether several inclusion areas mean all of them or any depends on the autopilot; without one it is any.
    """
    import shapely

    every = autopilot is not None and autopilot.within_every_inclusion_area
    fence = document.fence
    if not fence.areas:
        return
    broken = list(_broken_areas(fence))
    yield from broken
    if any(finding.severity == "error" for finding in broken):
        return
    inside = [_shape(area) for area in fence.areas if area.inclusion]
    outside = [_shape(area) for area in fence.areas if not area.inclusion]
    allowed = None
    if inside:
        allowed = shapely.intersection_all(inside) if every else shapely.union_all(inside)
    forbidden = shapely.union_all(outside) if outside else None
    ends, items = _segments(route)
    which = "all inclusion areas at once" if every else "any inclusion area"
    breaches = _outside(_lines(ends), allowed)
    message = f"the way to this item leaves {which}" if len(inside) > 1 else "the way to this item leaves the fence"
    yield from breach_findings(items, breaches, "outside-fence", message, "move the item, or widen the fence")
    crossings = _crossing(_lines(ends), forbidden)
    message = "the way to this item enters an exclusion area of the fence"
    yield from breach_findings(items, crossings, "in-exclusion-area", message, "go around it")
    yield from _check_rally(document, route, allowed, forbidden)


def fence_shapes(fence: Geofence, *, every: bool) -> tuple[shapely.Geometry | None, shapely.Geometry | None]:
    """Return the allowed and the prohibited areas of a fence; None for either if it has none."""
    import shapely

    inside = [_shape(area) for area in fence.areas if area.inclusion]
    outside = [_shape(area) for area in fence.areas if not area.inclusion]
    allowed = None
    if inside:
        allowed = shapely.intersection_all(inside) if every else shapely.union_all(inside)
    return allowed, shapely.union_all(outside) if outside else None


def leaves_fence(ends: NDArray[np.float64], fence: Geofence, *, every: bool) -> NDArray[np.bool_]:
    """Whether straight ways leave a fence, whose ends are (lon, lat), shape (ways, 2, 2); result of shape (ways,).

    `every`: several inclusion areas mean all of them at once, otherwise any of them.
    """
    if not fence.areas:
        return np.zeros(len(ends), dtype=bool)
    allowed, forbidden = fence_shapes(fence, every=every)
    lines = _lines(ends)
    return _outside(lines, allowed) | _crossing(lines, forbidden)


def _broken_areas(fence: Geofence) -> Iterator[Finding]:
    for number, area in enumerate(fence.areas):
        if not isinstance(area, FencePolygon):
            continue
        claimed = area.extra.get(CLAIMED_COUNT)
        if claimed is not None:
            message = (
                f"fence polygon {number} states {claimed:g} vertices but has {len(area.vertices)}: vehicles"
                " acknowledge such a fence but do not store it"
            )
            yield Finding("error", None, "fence-vertex-count", message, "add the missing vertex, or correct the count")
        elif not _shape(area).is_valid:
            message = f"the outline of fence polygon {number} crosses itself"
            yield Finding("error", None, "fence-crosses-itself", message, "put its vertices in order")


def _shape(area: FencePolygon | FenceCircle) -> shapely.Polygon:
    import shapely

    if isinstance(area, FencePolygon):
        return shapely.Polygon([(vertex.lon, vertex.lat) for vertex in area.vertices])
    angle = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_CORNERS, endpoint=False)
    # corners of a polygon of the same area, so that it lies within 0.02 % of the radius of the circle
    radius = area.radius_m * math.sqrt(2 * np.pi / _CIRCLE_CORNERS / math.sin(2 * np.pi / _CIRCLE_CORNERS))
    north = radius * np.cos(angle) / geodesy.M_PER_DEG
    east = radius * np.sin(angle) / geodesy.M_PER_DEG / max(math.cos(math.radians(area.center.lat)), 1e-6)
    return shapely.Polygon(np.column_stack((area.center.lon + east, area.center.lat + north)))


def _segments(route: Route) -> tuple[NDArray[np.float64], list[int]]:
    """Ends of every segment as (lon, lat), shape (segments, 2, 2), and the item each leads to."""
    ends: list[tuple[tuple[float, float], tuple[float, float]]] = []
    items: list[int] = []
    for leg in route.legs:
        before = leg.start
        for step in leg.steps:
            here = (step.point.lon, step.point.lat)
            ends.append(((before.lon, before.lat) if before else here, here))
            items.append(step.item)
            before = step.point
    return np.array(ends, dtype=np.float64).reshape(-1, 2, 2), items


def ways_to_rally(document: MissionDocument, route: Route) -> NDArray[np.float64]:
    """Ends of the straight way from each place on the route to the nearest rally point, shape (steps, 2, 2)."""
    import shapely

    rally, steps = document.rally.points, route.steps
    if not rally or not steps:
        return np.empty((0, 2, 2))
    at = np.array([(p.point.lon, p.point.lat) for p in rally])
    here = np.array([(step.point.lon, step.point.lat) for step in steps])
    scale = (math.cos(math.radians(float(here[0, 1]))), 1.0)
    nearest = at[shapely.STRtree(shapely.points(at * scale)).nearest(shapely.points(here * scale))]
    return np.stack((here, nearest), axis=1)


def _lines(ends: NDArray[np.float64]) -> NDArray[np.object_]:
    import shapely

    return np.asarray(shapely.linestrings(ends), dtype=object) if len(ends) else np.empty(0, dtype=object)


def _outside(shapes: NDArray[np.object_], allowed: shapely.Geometry | None) -> NDArray[np.bool_]:
    return np.zeros(len(shapes), dtype=bool) if allowed is None else ~_tested("covers", allowed, shapes)


def _crossing(shapes: NDArray[np.object_], forbidden: shapely.Geometry | None) -> NDArray[np.bool_]:
    return np.zeros(len(shapes), dtype=bool) if forbidden is None else _tested("intersects", forbidden, shapes)


def _tested(relation: str, area: shapely.Geometry, shapes: NDArray[np.object_]) -> NDArray[np.bool_]:
    import shapely

    shapely.prepare(area)
    return np.asarray(getattr(shapely, relation)(area, shapes), dtype=bool)


def breach_findings(
    items: Sequence[int], breached: NDArray[np.bool_], code: str, message: str, remedy: str
) -> Iterator[Finding]:
    """Return an error for each item on whose way the fence is breached, up to a number of them."""
    found = list(dict.fromkeys(items[int(index)] for index in np.flatnonzero(breached)))
    for item in found[:MAX_FINDINGS]:
        yield Finding("error", item, code, message, remedy)
    if len(found) > MAX_FINDINGS:
        yield Finding("error", None, code, f"{message}: so do {len(found) - MAX_FINDINGS} more items", remedy)


def _check_rally(
    document: MissionDocument,
    route: Route,
    allowed: shapely.Geometry | None,
    forbidden: shapely.Geometry | None,
) -> Iterator[Finding]:
    """Rally points must lie in the fence, and so must the straight way to the nearest from everywhere."""
    import shapely

    rally = document.rally.points
    if not rally:
        return
    at = np.array([(p.point.lon, p.point.lat) for p in rally])
    spots = np.asarray(shapely.points(at), dtype=object)
    bad = _outside(spots, allowed) | _crossing(spots, forbidden)
    for number in np.flatnonzero(bad)[:MAX_FINDINGS]:
        message = f"rally point {number} lies outside the fence: flying there breaches the fence"
        yield Finding("error", None, "rally-outside-fence", message, "move it, or widen the fence")
    if bad.any() or not route.steps:
        return
    ways = _lines(ways_to_rally(document, route))
    leaving = _outside(ways, allowed) | _crossing(ways, forbidden)
    steps = route.steps
    found = list(dict.fromkeys(steps[int(index)].item for index in np.flatnonzero(leaving)))
    if found:
        message = f"the straight way to the nearest rally point leaves the fence from {len(found)} items"
        yield Finding(
            "warning", found[0], "divert-outside-fence", message, "widen the fence: a diverting vehicle would breach it"
        )
