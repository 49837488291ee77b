"""Geometry at the antimeridian, where longitudes jump from 180 to -180 degrees."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray


def about(lon: ArrayLike, centre: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Longitudes as they lie on a map about a centre: each within 180 degrees of it, some beyond 180 or below -180."""
    values = np.asarray(lon, dtype=np.float64)
    off = np.mod(values - centre + 180.0, 360.0) - 180.0
    return np.where(np.abs(values - centre) <= 180.0, values, centre + off)


def wrapped(lon: float) -> float:
    """The same longitude from -180 up to 180 degrees."""
    return lon if -180.0 <= lon <= 180.0 else (lon + 180.0) % 360.0 - 180.0


def middle_longitude(lon: ArrayLike) -> float:
    """Middle of the shortest arc that holds all longitudes, from -180 up to 180 degrees; 0 without any."""
    values = np.unique(np.mod(np.asarray(lon, dtype=np.float64).ravel(), 360.0))
    if not len(values):
        return 0.0
    gaps = np.diff(values, append=values[0] + 360.0)
    widest = int(np.argmax(gaps))
    begin = values[(widest + 1) % len(values)]
    return wrapped(float(begin + (360.0 - gaps[widest]) / 2.0) % 360.0)


def line_geometry(places: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return a line through places (lat, lon) as GeoJSON, cut where it crosses the antimeridian (RFC 7946, 3.1.9).

    Returns
    -------
    dict
        A ``LineString``, or a ``MultiLineString`` with a part on each side.
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
            beyond = lon + 2.0 * side  # the end as seen from the side that the line comes from
            share = (side - before[1]) / (beyond - before[1]) if beyond != before[1] else 0.0
            cross = before[0] + share * (lat - before[0])
            if [side, cross] != parts[-1][-1]:
                parts[-1].append([side, cross])
            parts.append([] if [-side, cross] == [lon, lat] else [[-side, cross]])
        parts[-1].append([lon, lat])
        before = lat, lon
    return [part for part in parts if len(part) > 1] or [[[lon, lat] for lat, lon in places]]
