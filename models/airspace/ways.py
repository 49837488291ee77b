"""Ways through the air, as arrays: straight pieces with the heights that they are flown at."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

CHORD_M = 10_000.0
"""Geodesics are tested as chains of straight pieces in longitude and latitude, none longer than this.

At 10 km and 60 degrees of latitude such a piece lies within 4 m of the geodesic.
"""


class Ways(NamedTuple):
    """Geodesics with heights, shape (ways,) each; a climb or a descent begins and ends at one place."""

    lat1: NDArray[np.float64]
    lon1: NDArray[np.float64]
    lat2: NDArray[np.float64]
    lon2: NDArray[np.float64]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    """Least and greatest height above sea level; infinite if they are unknown."""
    low_agl_m: NDArray[np.float64]
    high_agl_m: NDArray[np.float64]
    """Least and greatest height above the ground."""


def at_any_height(lat1: ArrayLike, lon1: ArrayLike, lat2: ArrayLike, lon2: ArrayLike) -> Ways:
    """Return ways that touch every zone below, above and around them."""
    ends = [np.array(one, dtype=np.float64) for one in np.broadcast_arrays(*np.atleast_1d(lat1, lon1, lat2, lon2))]
    low, high = np.full(ends[0].shape, -np.inf), np.full(ends[0].shape, np.inf)
    return Ways(ends[0], ends[1], ends[2], ends[3], low, high, low, high)


def flown_at(
    places: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike],
    heights_m: tuple[ArrayLike, ArrayLike],
    grounds_m: tuple[ArrayLike, ArrayLike],
) -> Ways:
    """Return ways between places (lat1, lon1, lat2, lon2) whose heights and grounds change linearly.

    Heights and grounds at begin and end are above sea level, NaN if unknown: then the way counts at any height.
    """
    level = at_any_height(*places)
    height = np.array(np.broadcast_arrays(*heights_m, level.lat1)[:2], dtype=np.float64)
    agl = height - np.array(np.broadcast_arrays(*grounds_m, level.lat1)[:2], dtype=np.float64)
    known, known_agl = np.isfinite(height).all(axis=0), np.isfinite(agl).all(axis=0)
    return level._replace(
        low_m=np.where(known, height.min(axis=0), -np.inf),
        high_m=np.where(known, height.max(axis=0), np.inf),
        low_agl_m=np.where(known_agl, agl.min(axis=0), -np.inf),
        high_agl_m=np.where(known_agl, agl.max(axis=0), np.inf),
    )


def level_flights(
    places: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike], grounds_m: tuple[ArrayLike, ArrayLike], cruise_m: float
) -> Ways:
    """Return ways at the heights of single segments: level, the cruise height above the higher of the two grounds.

    If a ground is unknown the way is assumed to be over level ground.
    """
    level = at_any_height(*places)
    first, last = (np.broadcast_to(np.asarray(one, dtype=np.float64), level.lat1.shape) for one in grounds_m)
    top = np.maximum(first, last) + cruise_m
    known = np.isfinite(top)
    return level._replace(
        low_m=np.where(known, top, -np.inf),
        high_m=np.where(known, top, np.inf),
        low_agl_m=np.full(level.lat1.shape, cruise_m),
        high_agl_m=np.where(known, top - np.minimum(first, last), cruise_m),
    )


def level_ways(
    places: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike],
    level_m: ArrayLike,
    grounds_m: tuple[ArrayLike, ArrayLike],
) -> Ways:
    """Return level ways at heights above sea level, over the lowest and the highest ground below each; NaN counts as any height."""
    anywhere = at_any_height(*places)
    level, low, high = (
        np.broadcast_to(np.asarray(one, dtype=np.float64), anywhere.lat1.shape) for one in (level_m, *grounds_m)
    )
    known = np.isfinite(level + low + high)
    return anywhere._replace(
        low_m=np.where(known, level, -np.inf),
        high_m=np.where(known, level, np.inf),
        low_agl_m=np.where(known, level - high, -np.inf),
        high_agl_m=np.where(known, level - low, np.inf),
    )


def columns(lat: ArrayLike, lon: ArrayLike, ground_m: ArrayLike, cruise_m: ArrayLike) -> Ways:
    """Return climbs or descents over places, between the ground and a height above it."""
    here = at_any_height(lat, lon, lat, lon)
    ground = np.broadcast_to(np.asarray(ground_m, dtype=np.float64), here.lat1.shape)
    height = np.broadcast_to(np.asarray(cruise_m, dtype=np.float64), here.lat1.shape)
    known = np.isfinite(ground)
    return here._replace(
        low_m=np.where(known, ground, -np.inf),
        high_m=np.where(known, ground + height, np.inf),
        low_agl_m=np.zeros(here.lat1.shape),
        high_agl_m=np.array(height),
    )


def chosen(ways: Ways, which: NDArray[np.int64] | NDArray[np.bool_]) -> Ways:
    """Return some of the ways."""
    return Ways(*(values[which] for values in ways))


def together(*parts: Ways) -> Ways:
    """Return the ways of several, one after the other."""
    return Ways(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def lines(ways: Ways) -> NDArray[np.object_]:
    """Return ways as lines in longitude and latitude, those without a length as points.

    Across the 180th meridian they continue beyond 180 degrees.
    """
    import shapely  # imported late: 60 ms

    length, _ = geodesy.inverse(ways.lat1, ways.lon1, ways.lat2, ways.lon2)
    found = np.empty(len(length), dtype=object)
    over = np.abs(ways.lon2 - ways.lon1) > 180.0
    lon2 = np.where(over, ways.lon2 + np.copysign(360.0, ways.lon1), ways.lon2)
    ends = np.stack((ways.lon1, ways.lat1, lon2, ways.lat2), axis=1)
    here = (ends[:, 0] == ends[:, 2]) & (ends[:, 1] == ends[:, 3])
    short = (length <= CHORD_M) & ~here
    found[here] = shapely.points(ends[here, :2]) if here.any() else []
    found[short] = shapely.linestrings(ends[short].reshape(-1, 2, 2)) if short.any() else []
    for i in np.flatnonzero(~short & ~here):
        lat1, lon1, lat2, end = (float(values[i]) for values in (ways.lat1, ways.lon1, ways.lat2, ways.lon2))
        inner = geodesy.along(lat1, lon1, lat2, end, int(length[i] // CHORD_M))
        lon = np.unwrap([lon1, *(lon for _, lon in inner), end], period=360.0)
        found[i] = shapely.LineString(np.column_stack((lon, [lat1, *(lat for lat, _ in inner), lat2])))
    return found
