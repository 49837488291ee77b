"""Geodesic courses, split so finely that flying straight from item to item follows them.

Autopilots fly straight in some flat projection of their own, all of which lie near the straight line in latitude and
longitude. The sagitta between that line and the geodesic grows with the square of the length, about
d^2 tan(latitude) / (8 R) for an easterly course: 15 m for 30 km at 40 degrees.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_OFFSET_M = 5.0
"""Half of the 10 m that are allowed: the projections of the autopilots differ among each other."""
MAX_PIECES = 1000


def split_count(lat1: float, lon1: float, lat2: float, lon2: float) -> int:
    """Return the number of equal pieces into which a geodesic must be split to be followed within `MAX_OFFSET_M`."""
    length, _ = geodesy.inverse(lat1, lon1, lat2, lon2)
    if float(length) < 1.0:
        return 1
    offset = max(
        _offset_m(lat1, lon1, *geodesy.along(lat1, lon1, lat2, lon2, 1)[0], lat2, lon2),
        _curvature_bound_m(lat1, lat2, float(length)),
    )
    return min(max(1, math.ceil(math.sqrt(offset / MAX_OFFSET_M))), MAX_PIECES)


def _offset_m(lat1: float, lon1: float, lat_mid: float, lon_mid: float, lat2: float, lon2: float) -> float:
    """Distance from the middle of the geodesic to the middle of the line in latitude and longitude."""
    across = (lon2 - lon1 + 180.0) % 360.0 - 180.0
    lon_flat = (lon1 + across / 2.0 + 180.0) % 360.0 - 180.0
    return geodesy.distance_m(lat_mid, lon_mid, (lat1 + lat2) / 2.0, lon_flat)


def _curvature_bound_m(lat1: float, lat2: float, length_m: float) -> float:
    """Offset of a due easterly course at the highest latitude: the largest for a straight line of this length."""
    steepest = math.tan(math.radians(min(max(abs(lat1), abs(lat2)), 89.0)))
    return length_m**2 * steepest / (8.0 * geodesy.EARTH_RADIUS_M)


def pieces(lat1: float, lon1: float, lat2: float, lon2: float) -> Iterator[tuple[float, float, float]]:
    """Yield the points that end each piece of a geodesic, with the fraction of its length, the end included."""
    count = split_count(lat1, lon1, lat2, lon2)
    for number, (lat, lon) in enumerate(geodesy.along(lat1, lon1, lat2, lon2, count - 1), start=1):
        yield lat, lon, number / count
    yield lat2, lon2, 1.0
