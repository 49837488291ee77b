"""Geometry of patterns on a plane around their first vertex: x metres east, y metres north."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.missions.patterns.items import Place


def to_plane(places: Sequence[Place], origin: Place) -> NDArray[np.float64]:
    """Return the places as rows of x, y."""
    lat, lon = np.array(places, dtype=np.float64).T
    north, east = geodesy.local_offsets_m(lat, lon, *origin)
    return np.column_stack((east, north))


def to_place(x: float, y: float, origin: Place) -> Place:
    """Return the position on the map of a point of the plane."""
    return geodesy.direct(*origin, math.degrees(math.atan2(x, y)), math.hypot(x, y))


def is_clockwise(polygon: NDArray[np.float64]) -> bool:
    """Whether the vertices of a polygon are in clockwise order, seen from above."""
    x, y = polygon.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) < 0.0


def offset(line: NDArray[np.float64], distance_m: float, *, closed: bool) -> NDArray[np.float64] | None:
    """Move the edges of a line to their left; None if two neighbours are parallel, or an edge has no length.

    Every corner of the result is the intersection of two moved edges, extended; vertices have the shape (n, 2). A negative
    distance is to the right of the direction of each edge. Of a closed line the last vertex is joined to the first.
    """
    following = np.roll(line, -1, axis=0)
    edges = (following - line) if closed else (following - line)[:-1]
    length = np.hypot(edges[:, 0], edges[:, 1])
    if not np.all(length > 0.0):
        return None
    along = edges / length[:, None]
    left = np.column_stack((-along[:, 1], along[:, 0])) * distance_m
    start = line[: len(edges)] + left
    # corner i: start[i - 1] + s * along[i - 1] lies on the moved edge i; cross products give s
    before = np.roll(np.arange(len(edges)), 1)
    turn = _cross(along[before], along)
    corners = range(len(edges)) if closed else range(1, len(edges))
    moved = []
    for i in corners:
        straight_on = abs(turn[i]) < _PARALLEL
        if straight_on and closed:
            return None
        s = length[before[i]] if straight_on else _cross(start[i] - start[before[i]], along[i]) / turn[i]
        moved.append(start[before[i]] + s * along[before[i]])
    if not closed:
        moved = [start[0], *moved, start[-1] + edges[-1]]
    return np.array(moved)


_PARALLEL = 1e-12


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def sweep(polygon: NDArray[np.float64], heading_deg: float, spacing_m: float) -> list[NDArray[np.float64]]:
    """Return the parallel lines over a polygon: the first is the westernmost of a heading of 0, all run the same way.

    Lines lie `spacing_m` apart, counted from 1,000 m and half the extent beside the centre of the bounding box, as
    QGroundControl counts them. Each runs from the outermost edge of the polygon to the other, across what a concave
    polygon omits. Fewer than two become one line through the centre.
    """
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    centre = (low + high) / 2.0
    half = float(max(high - low)) / 2.0 + _MARGIN_M
    heading = math.radians(heading_deg)
    along = np.array([math.sin(heading), math.cos(heading)])
    across = np.array([math.cos(heading), -math.sin(heading)])
    u, v = (polygon - centre) @ along, (polygon - centre) @ across
    first = max(0, math.ceil((float(v.min()) + half) / spacing_m))
    last = min(math.ceil(2.0 * half / spacing_m) - 1, math.floor((float(v.max()) + half) / spacing_m))
    offsets = [-half + k * spacing_m for k in range(first, last + 1)]
    lines = [(t, cut) for t in offsets if (cut := _cut(u, v, t, half)) is not None]
    if len(lines) < 2:
        lines = [(0.0, cut) for cut in [_cut(u, v, 0.0, half)] if cut is not None]
    if not lines:
        return []
    ascending = lines[0][1][0] < lines[0][1][1]
    return [
        np.array([centre + along * at + across * t for at in sorted(cut, reverse=not ascending)]) for t, cut in lines
    ]


_MARGIN_M = 1000.0


def line_count(polygon: NDArray[np.float64], spacing_m: float) -> float:
    """Return the approximate largest number of lines of `sweep`."""
    return float(np.hypot(*(polygon.max(axis=0) - polygon.min(axis=0)))) / spacing_m


def _cut(u: NDArray[np.float64], v: NDArray[np.float64], t: float, half: float) -> tuple[float, float] | None:
    """Return where the line at `t` first and last meets the polygon, in the order of the edges it meets."""
    after_u, after_v = np.roll(u, -1), np.roll(v, -1)
    crossed = ((v - t) * (after_v - t) <= 0.0) & (v != after_v)
    if not crossed.any():
        return None
    u, after_u, v, after_v = u[crossed], after_u[crossed], v[crossed], after_v[crossed]
    at = u + (t - v) / (after_v - v) * (after_u - u)
    at = at[np.abs(at) <= half]
    if len(at) < 2 or float(at.max() - at.min()) < _SAME_POINT_M:
        return None
    ends = sorted((int(np.argmin(at)), int(np.argmax(at))))
    return float(at[ends[0]]), float(at[ends[1]])


_SAME_POINT_M = 1e-6
