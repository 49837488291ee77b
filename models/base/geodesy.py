"""Geodesics on the WGS-84 ellipsoid (Karney 2013, as implemented in PROJ), and lines across the antimeridian.

Source: C. F. F. Karney, "Algorithms for geodesics", J. Geodesy 87, 43-55 (2013).
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import Fault

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray
    from pyproj import Geod

SEMI_MAJOR_M = 6_378_137.0
ECCENTRICITY_SQUARED = 0.006_694_379_990_141_317
"""Of the WGS-84 ellipsoid."""
EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the Earth (IUGG), for bounding boxes and other coarse uses only."""
COARSE = 1.01
"""`coarse_distance_m` is no more than this multiple of the distance."""
M_PER_DEG = math.pi * EARTH_RADIUS_M / 180.0
"""Metres of a degree of latitude on that sphere."""


@cache
def _wgs84() -> Geod:
    from pyproj import Geod

    return Geod(ellps="WGS84")


def inverse(
    lat1: ArrayLike, lon1: ArrayLike, lat2: ArrayLike, lon2: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Length, metres, and initial bearing of the geodesics between points in degrees, broadcast against each other.

    Bearings are degrees clockwise from true north in [0, 360) at the start point.
    """
    a, b, c, d = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (lat1, lon1, lat2, lon2)))
    azimuth, _, distance = _wgs84().inv(b.ravel(), a.ravel(), d.ravel(), c.ravel())
    bearing = np.mod(np.asarray(azimuth), 360.0)
    bearing[bearing >= 360.0] = 0.0
    return np.asarray(distance).reshape(a.shape), bearing.reshape(a.shape)


def earth_xyz(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (lat, lon), shape (places, 2), as metres from the centre of the ellipsoid, shape (places, 3)."""
    lat, lon = np.radians(places).T
    normal = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    up = normal * (1.0 - ECCENTRICITY_SQUARED) * np.sin(lat)
    return np.column_stack((normal * np.cos(lat) * np.cos(lon), normal * np.cos(lat) * np.sin(lon), up))


def spatial_distance_m(points_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances on the ground between points in space (`earth_xyz`, last axis 3), broadcast against each other: the arcs over their chords.

    Within 4e-6 of `inverse` up to 500 km, 4e-5 up to 1,500 km, and twenty times as fast.
    """
    chord_m = np.sqrt(np.square(points_m - others_m).sum(axis=-1))
    return np.asarray(2.0 * SEMI_MAJOR_M * np.arcsin(np.minimum(chord_m / (2.0 * SEMI_MAJOR_M), 1.0)))


def coarse_distance_m(lat: ArrayLike, lon: ArrayLike, lats: ArrayLike, lons: ArrayLike) -> NDArray[np.float64]:
    """Distances between points, broadcast against each other, on a sphere: within 0.6 % of `inverse` and much faster, to exclude distant points."""
    here, there = (np.radians(np.asarray(one, dtype=np.float64)) for one in (lat, lats))
    half = 0.5 * np.radians(np.asarray(lons, dtype=np.float64) - np.asarray(lon, dtype=np.float64))
    square = np.sin(0.5 * (there - here)) ** 2 + np.cos(here) * np.cos(there) * np.sin(half) ** 2
    return np.asarray(2.0 * EARTH_RADIUS_M * np.arcsin(np.sqrt(np.minimum(square, 1.0))))


def perhaps_within(
    lat: ArrayLike, lon: ArrayLike, lats: ArrayLike, lons: ArrayLike, most_m: float
) -> NDArray[np.bool_]:
    """Whether points, broadcast against each other, may be at most so far apart, by `coarse_distance_m`: of those that are, none is left out."""
    return np.asarray(coarse_distance_m(lat, lon, lats, lons) <= COARSE * most_m)


def distance_m(lat1: float, lon1: float, lat2: float, lon2: float) -> float:
    """Length of the geodesic between two points, metres."""
    return way(lat1, lon1, lat2, lon2)[0]


def way(lat1: float, lon1: float, lat2: float, lon2: float) -> tuple[float, float]:
    """Length and initial bearing of the geodesic between two points: `inverse` for a single pair."""
    azimuth, _, length = _wgs84().inv(lon1, lat1, lon2, lat2)
    bearing = float(azimuth) % 360.0
    return float(length), 0.0 if bearing >= 360.0 else bearing


def bearing_deg(lat1: float, lon1: float, lat2: float, lon2: float) -> float:
    """Initial bearing of the geodesic from the first point to the second, degrees in [0, 360)."""
    return way(lat1, lon1, lat2, lon2)[1]


def direct(lat: float, lon: float, bearing: float, length_m: float) -> tuple[float, float]:
    """Point reached from (lat, lon) along a geodesic; returns (lat, lon) in degrees."""
    lon2, lat2, _ = _wgs84().fwd(lon, lat, bearing, length_m)
    return float(lat2), float(lon2)


def ahead(
    lat: ArrayLike, lon: ArrayLike, bearing: ArrayLike, length_m: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points reached from places along geodesics, arrays of one shape (points,); (lat, lon) in degrees."""
    a, b, c, d = (np.asarray(one, dtype=np.float64) for one in (lat, lon, bearing, length_m))
    lon2, lat2, _ = _wgs84().fwd(b, a, c, d)
    return np.asarray(lat2), np.asarray(lon2)


def along(lat1: float, lon1: float, lat2: float, lon2: float, count: int) -> list[tuple[float, float]]:
    """Return `count` points that divide the geodesic evenly, end points excluded, as (lat, lon)."""
    if count < 1:
        return []
    return [(lat, lon) for lon, lat in _wgs84().npts(lon1, lat1, lon2, lat2, count)]


def midpoint(
    lat: ArrayLike, lon: ArrayLike, bearing: ArrayLike, length_m: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half-way points of geodesics given by start, initial bearing and length; (lat, lon) in degrees."""
    a, b, c, d = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (lat, lon, bearing, length_m)))
    lon2, lat2, _ = _wgs84().fwd(b.ravel(), a.ravel(), c.ravel(), d.ravel() / 2.0)
    return np.asarray(lat2).reshape(a.shape), np.asarray(lon2).reshape(a.shape)


def local_offsets_m(
    lat: ArrayLike, lon: ArrayLike, lat0: float, lon0: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) metres of points from an origin, along the geodesics from the origin.

    Distances and bearings from the origin are exact; distances between two points are good to about
    1e-5 relative within 100 km.
    """
    length, bearing = inverse(lat0, lon0, lat, lon)
    angle = np.radians(bearing)
    return length * np.cos(angle), length * np.sin(angle)


def coordinate_faults(lat: float, lon: float, *, file: str | None = None) -> list[Fault]:
    """Return the problem with a position in degrees: out of range, or not a number; None if it is valid."""
    faults = []
    hint = "degrees, not ten-millionths of them" if 1e5 < abs(lat) < 1e9 else "degrees from -90 to 90"
    if not -90.0 <= lat <= 90.0:
        hint = "lat and lon may be swapped" if abs(lat) <= 180.0 and abs(lon) <= 90.0 else hint
        faults.append(Fault("latitude out of range", file, None, "lat", lat, hint))
    if not -180.0 <= lon <= 180.0:
        faults.append(Fault("longitude out of range", file, None, "lon", lon, "degrees from -180 to 180"))
    return faults


# The antimeridian, where longitudes jump from 180 to -180 degrees


def about(lon: ArrayLike, centre: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Longitudes as drawn on a map about a centre: each within 180 degrees of it, some beyond 180 or below -180."""
    values = np.asarray(lon, dtype=np.float64)
    off = np.mod(values - centre + 180.0, 360.0) - 180.0
    return np.where(np.abs(values - centre) <= 180.0, values, centre + off)


def wrapped(lon: float) -> float:
    """The same longitude from -180 up to 180 degrees."""
    return lon if -180.0 <= lon <= 180.0 else (lon + 180.0) % 360.0 - 180.0


def middle_longitude(lon: ArrayLike) -> float:
    """Middle of the shortest arc that contains all longitudes, from -180 up to 180 degrees; 0 if there are none."""
    values = np.unique(np.mod(np.asarray(lon, dtype=np.float64).ravel(), 360.0))
    if not len(values):
        return 0.0
    gaps = np.diff(values, append=values[0] + 360.0)
    widest = int(np.argmax(gaps))
    begin = values[(widest + 1) % len(values)]
    return wrapped(float(begin + (360.0 - gaps[widest]) / 2.0) % 360.0)


def line_geometry(places: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return a line through places (lat, lon) as GeoJSON, cut where it crosses the antimeridian (RFC 7946, 3.1.9).

    That is a ``LineString``, or a ``MultiLineString`` with a part on each side.
    """
    parts = _cut(places)
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _cut(places: Sequence[tuple[float, float]]) -> list[list[list[float]]]:
    parts: list[list[list[float]]] = [[]]
    before: tuple[float, float] | None = None
    for lat, lon in places:
        if before is not None and abs(lon - before[1]) > 180.0:
            side = 180.0 if before[1] > 0.0 else -180.0
            beyond = lon + 2.0 * side  # the end as seen from the side where the line starts
            share = (side - before[1]) / (beyond - before[1]) if beyond != before[1] else 0.0
            cross = before[0] + share * (lat - before[0])
            if [side, cross] != parts[-1][-1]:
                parts[-1].append([side, cross])
            parts.append([] if [-side, cross] == [lon, lat] else [[-side, cross]])
        parts[-1].append([lon, lat])
        before = lat, lon
    return [part for part in parts if len(part) > 1] or [[[lon, lat] for lat, lon in places]]
