"""Segments and the zones that they enter: which are removed, and which are closed at times."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.airspace.ways import Ways, chosen, columns, level_flights
from skyway.models.base.errors import Fault
from skyway.models.flight.level_steps import STEP_M

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.flight.way_heights import SegmentHeights
    from skyway.models.network.station import Station


def ground_of(stations: Sequence[Station]) -> NDArray[np.float64]:
    """Ground above mean sea level at each station, metres; NaN if it is unknown."""
    heights = [station.elevation_m for station in stations]
    return np.array([math.nan if one is None else one for one in heights], dtype=np.float64)


def least_of(stations: Sequence[Station]) -> NDArray[np.float64] | None:
    """Least heights of places that are flown over, above mean sea level and above the ground, shape (nodes, 2); None if no place has any."""
    found = np.array([(one.least_m, one.least_agl_m) for one in stations], dtype=np.float64).reshape(-1, 2)
    return found if np.isfinite(found).any() else None


class Raised(NamedTuple):
    """Extra height of segments above the cruise height, shape (segments,) each, without a terrain model."""

    lift_m: NDArray[np.float64]
    """Climbed at the begin, and descended at the end, beyond the cruise height."""
    level_m: NDArray[np.float64]
    """Above mean sea level; where `lift_m` is above 0."""
    mean_above_m: NDArray[np.float64]
    """Mean height above the ground below; likewise."""


def raised(stations: Sequence[Station], pairs: NDArray[np.int64], cruise_height_m: float) -> Raised:
    """Return how much higher segments between places with minimum heights are flown: see `models.flight.way_heights`."""
    least, ground_m = least_of(stations), ground_of(stations)
    first, last = (ground_m[pairs[:, end]] for end in (0, 1))
    usual = np.maximum(first, last) + cruise_height_m
    if least is None:
        return Raised(np.zeros(len(pairs)), usual, usual - 0.5 * (first + last))
    low, low_agl = least[pairs].min(axis=1).T
    wanted = np.maximum(low, np.maximum(first, last) + low_agl)
    level = np.where(wanted > usual, np.ceil(np.round(wanted / STEP_M, 6)) * STEP_M, usual)
    return Raised(np.where(level > usual, level - usual, 0.0), level, level - 0.5 * (first + last))


def raised_ways(ways: Ways, stations: Sequence[Station], pairs: NDArray[np.int64], cruise_height_m: float) -> Ways:
    """Return ways between nodes, those between places with minimum heights raised to these."""
    if least_of(stations) is None:
        return ways
    found, ground_m = raised(stations, pairs, cruise_height_m), ground_of(stations)
    ends = np.stack([ground_m[pairs[:, end]] for end in (0, 1)])
    higher = found.lift_m > 0.0
    heights = found.level_m, found.level_m, found.level_m - ends.max(axis=0), found.level_m - ends.min(axis=0)
    known = ways.low_m, ways.high_m, ways.low_agl_m, ways.high_agl_m
    return Ways(*ways[:4], *(np.where(higher, new, old) for new, old in zip(heights, known, strict=True)))


def flown_ways(
    stations: Sequence[Station], pairs: NDArray[np.int64], cruise_height_m: float, flown: SegmentHeights | None = None
) -> tuple[Ways, Ways]:
    """Return segments, as high as they are flown, and the climbs and descents at all stations.

    Over a terrain model `flown` gives the heights of the segments.
    """
    lat, lon = np.array([s.lat for s in stations]), np.array([s.lon for s in stations])
    ground_m = ground_of(stations)
    a, b = pairs[:, 0], pairs[:, 1]
    level = level_flights((lat[a], lon[a], lat[b], lon[b]), (ground_m[a], ground_m[b]), cruise_height_m)
    top_m = np.full(len(stations), cruise_height_m)
    if flown is None:
        level = raised_ways(level, stations, pairs, cruise_height_m)
    else:
        heights = (flown.low_m, flown.high_m, flown.low_above_m, flown.high_above_m)
        level = Ways(*level[:4], *heights)
        for ends in (a, b):
            np.maximum.at(top_m, ends, flown.high_m - ground_m[ends])
    return level, columns(lat, lon, ground_m, top_m)


def flyable(
    stations: Sequence[Station], pairs: NDArray[np.int64], zones: Airspace, flown: SegmentHeights | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the pairs that are neither closed at all times nor too high, and their `Network.restricted`.

    If a zone forbids the climb or descent at a station, it forbids the segments of the station. Without a terrain model a segment has the same
    heights in both directions, and is checked once.
    """
    ends, way_of = pairs, np.arange(len(pairs))
    if flown is None:
        ends, inverse = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        way_of = inverse.ravel()
    level, climbs = flown_ways(stations, ends, zones.cruise_height_m, flown)
    way, volume = zones.hits(level)
    used = np.unique(ends)
    used = used[[not stations[node].flyover for node in used.tolist()]]
    at, over = zones.hits(chosen(climbs, used))
    by_node = np.argsort(ends.T.ravel(), kind="stable")
    low, touching = _matches(ends.T.ravel()[by_node], used[at])
    way, volume = np.concatenate((way, by_node[touching] % len(ends))), np.concatenate((volume, over[low]))
    closed = zones.too_high(level)
    if flown is not None:  # their clearance has a greatest height, which those that are flown over zones keep as well
        least = least_of(stations)
        lifted = np.zeros(len(stations), dtype=bool)
        if least is not None:
            lifted = np.asarray(np.isfinite(least).any(axis=1))
        closed &= lifted[ends].all(axis=1)
    closed[way[zones.always_closed[volume]]] = True
    found = np.unique(np.column_stack((way, volume)), axis=0)
    found = found[~closed[found[:, 0]]]
    kept = np.flatnonzero(~closed[way_of])
    order = np.argsort(way_of[kept], kind="stable")
    of, position = _matches(way_of[kept][order], found[:, 0])
    restricted = np.column_stack((order[position], found[of, 1]))
    return kept, restricted[np.lexsort((restricted[:, 1], restricted[:, 0]))]


def _matches(ascending: NDArray[np.int64], wanted: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of each wanted value, and every position at which it stands in an ascending array."""
    first, last = np.searchsorted(ascending, wanted), np.searchsorted(ascending, wanted, side="right")
    count = last - first
    which = np.repeat(np.arange(len(wanted)), count)
    return which, np.repeat(first - (np.cumsum(count) - count), count) + np.arange(count.sum())


def renumbered(
    old: NDArray[np.int64], new: NDArray[np.int64], segments: int, order: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return `Network.restricted` of old and new segments, the new ones behind, in another order."""
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    both = np.concatenate((old, new + np.array((segments, 0))))
    both = np.column_stack((rank[both[:, 0]], both[:, 1]))
    return both[np.lexsort((both[:, 1], both[:, 0]))]


def inside(zones: Airspace, lat: float, lon: float) -> list[Fault]:
    """Refuse a place of delivery in a zone that is closed at all times where a flight comes down to it."""
    _, volume = zones.hits(columns(np.array([lat]), np.array([lon]), math.nan, zones.cruise_height_m))
    for number in volume.tolist():
        zone = zones.zones[zones.volumes[number][0]]
        if zone.kind == "prohibited" and zone.activation.is_permanent:
            remedy = f"{zones.volumes[number][1]}: choose a place outside of it"
            return [Fault(f"lies in the no-fly zone {zone.name}", field="target", value=f"{lat},{lon}", remedy=remedy)]
    return []
