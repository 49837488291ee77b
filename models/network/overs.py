"""Ways over zones: a segment that a zone closes is flown above the zone's ceiling, if the maximum height allows.

The vehicle climbs vertically before the widened outline begins, flies level over it, and descends behind it. The places where it does are nodes
without landings, so that planners choose between such a way, one around, and waiting.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.airspace.ways import Ways, lines
from skyway.models.base import geodesy
from skyway.models.network.bends import MAX_PAIRS
from skyway.models.network.zoned import flown_ways, ground_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.network.station import Station

BESIDE_M = 10.0
"""The vehicle climbs and descends this far before and behind the widened outline: straight lines on the map and geodesics differ by less."""
USUAL_MOST_M = 120.0
"""Above the ground: ways over zones are no higher if the region states no greatest height."""
ABOVE_M = 1.0
"""More than the margin: heights of missions are rounded."""
Joined = tuple[tuple["Station", ...], "NDArray[np.int64]"]


class _Span(NamedTuple):
    """A part of a segment that is flown over zones."""

    begin: float
    end: float
    """Shares of the segment."""
    least_m: float
    least_agl_m: float
    volume: int


def with_overs(airspace: Airspace, stations: tuple[Station, ...], pairs: NDArray[np.int64]) -> Joined:
    """Add ways over the zones that close segments; returns nodes and pairs, the new ones behind.

    None is added that would be too high above the ground, or come into another zone. The straight segments stay. Of more than
    `models.network.bends.MAX_PAIRS` closed segments the longer ones get none.
    """
    ends = np.unique(np.sort(pairs, axis=1), axis=0)
    level, _ = flown_ways(stations, ends, airspace.cruise_height_m)
    way, volume = airspace.hits(level)
    counts = airspace.closed[volume]
    way, volume = way[counts], volume[counts]
    closed = np.unique(way)
    length_m = geodesy.inverse(*(values[closed] for values in level[:4]))[0]
    nodes, added = list(stations), []
    names = {station.id for station in stations}
    for number in np.sort(closed[np.argsort(length_m, kind="stable")[:MAX_PAIRS]]).tolist():
        spans = _spans(
            airspace, Ways(*(values[number : number + 1] for values in level)), volume[way == number].tolist()
        )
        if spans is None:
            continue
        a, b = (stations[node] for node in ends[number].tolist())
        fresh = list(_places(airspace, spans, a, b, names))
        chain = [int(ends[number, 0]), *range(len(nodes), len(nodes) + len(fresh)), int(ends[number, 1])]
        if _free(airspace, [a, *fresh, b]):
            nodes += fresh
            names |= {one.id for one in fresh}
            added += [pair for one in pairwise(chain) for pair in (one, one[::-1])]
    if not added:
        return stations, pairs
    return tuple(nodes), np.concatenate((pairs, np.array(added, dtype=np.int64)))


def joined_pairs(first: Joined, second: Joined, known: int) -> Joined:
    """Return the nodes and pairs of two that added to the same `known` nodes, those that the second added last."""
    (stations, pairs), (others, more) = first, second
    rank = np.concatenate((np.arange(known), len(stations) + np.arange(len(others) - known)))
    return (*stations, *others[known:]), np.unique(np.concatenate((pairs, rank[more])), axis=0)


def _spans(airspace: Airspace, way: Ways, volumes: Sequence[int]) -> list[_Span] | None:
    """Return the parts of a way over some volumes, those that touch together; None if it cannot be flown over all."""
    import shapely

    line = lines(way)[0]
    length_m = float(geodesy.inverse(way.lat1, way.lon1, way.lat2, way.lon2)[0][0])
    if shapely.length(line) <= 0.0 or length_m <= 4.0 * BESIDE_M:
        return None
    beside = BESIDE_M / length_m
    found: list[_Span] = []
    for number in volumes:
        least, agl = airspace.volumes[number][1].ceiling.highest()
        least += airspace.height_margin_m + ABOVE_M
        inside = shapely.intersection(line, airspace.wide[number])
        points = shapely.points(shapely.get_coordinates(inside))
        if not math.isfinite(least) or not len(points):
            return None
        share = shapely.line_locate_point(line, points, normalized=True)
        span = _Span(
            float(share.min()) - beside, float(share.max()) + beside,
            -math.inf if agl else least, least if agl else -math.inf, number,
        )  # fmt: skip
        if span.begin <= 0.0 or span.end >= 1.0:  # it would have to climb or descend inside
            return None
        found.append(span)
    joined: list[_Span] = []
    for span in sorted(found):
        if joined and span.begin <= joined[-1].end + beside:
            last = joined[-1]
            joined[-1] = _Span(
                last.begin, max(last.end, span.end), max(last.least_m, span.least_m), max(last.least_agl_m, span.least_agl_m), last.volume,
            )  # fmt: skip
        else:
            joined.append(span)
    return joined


def _places(airspace: Airspace, spans: Sequence[_Span], a: Station, b: Station, names: set[str]) -> Iterator[Station]:
    """Nodes where the way from one station to another climbs and descends; their ground is taken to be as high as that of these, the higher."""
    kind = type(a)
    known = [ground for ground in (a.elevation_m, b.elevation_m) if ground is not None]
    length_m, bearing = (float(value) for value in geodesy.inverse(a.lat, a.lon, b.lat, b.lon))
    taken = set(names)
    for span in spans:
        zone = airspace.zones[airspace.volumes[span.volume][0]]
        for share in (span.begin, span.end):
            number = next(k for k in range(1, len(taken) + 2) if f"over-{zone.id}-{k}" not in taken)
            identity = f"over-{zone.id}-{number}"
            taken.add(identity)
            lat, lon = geodesy.direct(a.lat, a.lon, bearing, share * length_m)
            yield kind(
                identity, f"over {zone.name}", float(lat), float(lon), max(known, default=None), 0, 0, flyover=True,
                least_m=span.least_m, least_agl_m=span.least_agl_m,
            )  # fmt: skip


def _free(airspace: Airspace, chain: Sequence[Station]) -> bool:
    """Whether a way over places keeps the greatest height, and comes into no zone that is closed; climbs and descents on the way included."""
    pairs = np.array(list(pairwise(range(len(chain)))))
    level, _ = flown_ways(chain, pairs, airspace.cruise_height_m)
    if airspace.too_high(level, math.inf if math.isfinite(airspace.max_height_m) else USUAL_MOST_M).any():
        return False
    ground_m = ground_of(chain)[1:-1]
    lat, lon = (np.array([getattr(one, name) for one in chain[1:-1]]) for name in ("lat", "lon"))
    low, high = (pick(level[k][:-1], level[k][1:]) for k, pick in ((4, np.minimum), (5, np.maximum)))
    steps = Ways(lat, lon, lat, lon, low, high, low - ground_m, high - ground_m)
    steps = steps._replace(
        low_agl_m=np.minimum(level.low_agl_m[:-1], level.low_agl_m[1:]),
        high_agl_m=np.maximum(level.high_agl_m[:-1], level.high_agl_m[1:]),
    )
    return not any(airspace.closed[airspace.hits(part)[1]].any() for part in (level, steps))
