"""Heights of a way: the same code for plans, checks, missions, flights and reports.

Without a terrain model it is the rule of `models.flight.heights`: the cruise height above the higher ground next to each
station, linear between. Over a terrain model a way is flown in level steps: at the cruise height above the ground below or more,
nowhere lower than the clearance over anything in the corridor, and no higher above the ground than the clearance's greatest height as
far as the clearance allows. The vehicle climbs and descends vertically at the steps, so the cost of a step does not depend on
the wind. There are as few steps as possible: each level continues as long as one height is possible, and is the nearest to the level before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy
from skyway.models.flight.heights import cleared_grounds_m
from skyway.models.flight.level_steps import NO_LEAST, STEP_M, Least, Place, Samples, Steps, level_steps, samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.flight.clearance import Clearance
    from skyway.models.terrain.terrain import Terrain


TURN_EVERY_M = 150.0
"""Ways of turns and diverts, which are many, are sampled at this distance, and widened by as much."""


@dataclass(frozen=True, eq=False)
class Over:
    """A terrain model, the clearance over it, and the cruise height above the ground."""

    terrain: Terrain
    clearance: Clearance
    cruise_height_m: float
    notes: tuple[str, ...] = ()
    """Notes for plans made over it."""


class Knot(NamedTuple):
    """A point of a flown way."""

    segment: int
    """Which segment of the way it is on."""
    share: float
    """How far along that segment, 0 to 1."""
    height_m: float
    """Flown there, above mean sea level."""


@dataclass(frozen=True, eq=False)
class WayHeights:
    """Heights of a way over some places, from the end of the climb at the first to the beginning of the descent at the last.

    Attributes
    ----------
    knots : tuple of Knot
        In order, straight lines between; two of one place are a climb or descent there.
    up_m, down_m : float
        All climbs and descents together, from the ground at the begin to the ground at the end; NaN if it is unknown.
    mean_above_m : float
        Mean height above the ground below; NaN if it is unknown.
    along_m, ground_m, top_m, height_m : ndarray, shape (samples,)
        Distance along the way, and there: ground below, the highest in the corridor, and the height flown; empty without
        a terrain model.
    obstacle : ndarray of int, shape (samples,)
        Number of the highest obstacle in the corridor there; -1 where there is none.
    segment_m : ndarray, shape (segments,)
        Length of each segment; empty without a terrain model.
    unknown : Place or None
        Where on the way the ground is unknown, first.
    """

    knots: tuple[Knot, ...]
    up_m: float
    down_m: float
    mean_above_m: float
    along_m: NDArray[np.float64]
    ground_m: NDArray[np.float64]
    top_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    obstacle: NDArray[np.int64]
    segment_m: NDArray[np.float64]
    unknown: Place | None = None

    @property
    def top_height_m(self) -> float:
        """The greatest height flown."""
        return max(knot.height_m for knot in self.knots)


def way_heights(
    places: Sequence[Place],
    ground_m: Sequence[float],
    cruise_height_m: float,
    over: Over | None = None,
    least: Sequence[Least] | None = None,
) -> WayHeights:
    """Heights of a way straight from place to place.

    Parameters
    ----------
    places : sequence of (lat, lon)
        Begin, stations overflown, end; degrees.
    ground_m : sequence of float
        Above mean sea level, at each place; NaN if it is unknown and to be taken from the terrain.
    cruise_height_m : float
        Above the ground; over a terrain model its own counts.
    over : Over, optional
        The terrain model; without one the ground is taken to be linear between the places.
    least : sequence of Least, optional
        Of each place: between two the way is at least as high as the lower of theirs.
    """
    if over is None:
        return _over_stations(ground_m, cruise_height_m, least)
    lat, lon = np.array(places, dtype=np.float64).T
    found = samples(lat[:-1], lon[:-1], lat[1:], lon[1:], over)
    below = np.array(ground_m, dtype=np.float64)
    missing = np.isnan(below)
    if missing.any():
        below[missing] = over.terrain.ground_m(lat[missing], lon[missing])
    parts = [
        level_steps(found, number, below[number : number + 2], over, least=_between(least, number))
        for number in range(len(lat) - 1)
    ]
    return _joined(found, parts, below)


def _between(least: Sequence[Least] | None, number: int) -> Least:
    """Least heights of a segment of a way."""
    if least is None:
        return NO_LEAST
    (a, a_agl), (b, b_agl) = least[number : number + 2]
    return min(a, b), min(a_agl, b_agl)


class SegmentHeights(NamedTuple):
    """Heights of many segments, each flown alone, shape (segments,) each."""

    up_m: NDArray[np.float64]
    down_m: NDArray[np.float64]
    mean_above_m: NDArray[np.float64]
    """As in `WayHeights`; NaN if the ground is unknown throughout."""
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    low_above_m: NDArray[np.float64]
    high_above_m: NDArray[np.float64]
    """Least and greatest height flown, above mean sea level and above the ground below."""
    stops: NDArray[np.float64]
    """How often the vehicle stops on the way to climb or descend."""


def segment_heights(
    lat: NDArray[np.float64],
    lon: NDArray[np.float64],
    ground_m: NDArray[np.float64],
    pairs: NDArray[np.int64],
    over: Over,
    least: NDArray[np.float64] | None = None,
) -> SegmentHeights:
    """Heights of the segments of a network over a terrain model: those of `way_heights` for each.

    `lat`, `lon` and `ground_m` are those of nodes, `pairs` has begin and end of each segment, shape (segments, 2), `least` the `Least` of each
    node, shape (nodes, 2). Both directions of a segment are computed from one set of samples.
    """
    ends, which = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    a, b = ends.T
    found = samples(lat[a], lon[a], lat[b], lon[b], over)
    out = np.full((8, len(pairs)), np.nan)
    turned = pairs[:, 0] > pairs[:, 1]
    both: dict[tuple[int, bool], tuple[float, ...]] = {}
    for row, (number, back) in enumerate(zip(which.ravel().tolist(), turned.tolist(), strict=True)):
        if (number, back) not in both:
            these = NO_LEAST if least is None else tuple(least[ends[number]].min(axis=0).tolist())
            part = level_steps(found, number, ground_m[ends[number]], over, back=back, least=these)
            ground = found.ground_m[int(found.first[number]) : int(found.first[number + 1])]
            above = part.level_m - (ground[::-1] if back else ground)
            extremes = (one for values in (part.level_m, above) for one in (float(values.min()), float(values.max())))
            stops = part.stops + (
                2 if these != NO_LEAST else 1
            )  # where it meets the next, too: over a zone at both ends
            both[number, back] = (part.up_m, part.down_m, part.mean_above_m, *extremes, stops)
        out[:, row] = both[number, back]
    return SegmentHeights(*out)


class WaySteps(NamedTuple):
    """Steps of a way with many points, flown as one segment, by the pieces between its points."""

    up_m: NDArray[np.float64]
    down_m: NDArray[np.float64]
    mean_above_m: NDArray[np.float64]
    """Climbs, descents and the mean height above the ground of each piece, shape (pieces,); NaN if the ground is unknown."""
    begin_m: float
    end_m: float
    """Heights at which it begins and ends, above mean sea level."""
    stops: NDArray[np.float64]
    """How often the vehicle stops on each piece to climb or descend, shape (pieces,)."""


def way_steps(places: Sequence[Place], over: Over) -> WaySteps:
    """Steps of a way over a terrain model, by the pieces between its points."""
    lat, lon = np.array(places, dtype=np.float64).T
    found = samples(lat[:-1], lon[:-1], lat[1:], lon[1:], over)
    begin = np.concatenate(([0.0], np.cumsum(found.length_m)))
    count = np.diff(found.first)
    piece = np.repeat(np.arange(len(count)), count)
    along = (begin[piece] + found.share * found.length_m[piece]) / max(float(begin[-1]), 1e-9)
    whole = found._replace(share=along, first=np.array([0, len(along)]))
    part = level_steps(whole, 0, found.ground_m[[0, -1]], over)
    up, down, stops = (np.zeros(len(count)) for _ in range(3))
    if part.unknown is not None:
        nothing = np.full(len(count), math.nan)
        return WaySteps(nothing, nothing, nothing, math.nan, math.nan, nothing)
    for (share, before), (_, after) in pairwise(part.knots):
        at = min(int(np.searchsorted(begin, share * begin[-1], side="right")) - 1, len(count) - 1)
        (up if after > before else down)[at] += abs(after - before)
        stops[at] += after != before
    above = np.add.reduceat(part.level_m - found.ground_m, found.first[:-1]) / count
    return WaySteps(up, down, above, part.knots[0][1], part.knots[-1][1], stops)


class StraightWays(NamedTuple):
    """Straight ways from a place to others, shape (places,) each; NaN if the ground is unknown."""

    level_m: NDArray[np.float64]
    """Least height at which they are flown level, above mean sea level."""
    low_ground_m: NDArray[np.float64]
    high_ground_m: NDArray[np.float64]
    """Least and greatest ground below, seen from as far apart as the level is."""


def straight_ways(here: Place, lat: NDArray[np.float64], lon: NDArray[np.float64], over: Over) -> StraightWays:
    """Return the ground below straight ways from a place to others, and their heights of flight: those of diverts and of turns in flight."""
    length, bearing = geodesy.inverse(*here, lat, lon)
    count = np.ceil(length / TURN_EVERY_M).astype(np.int64) + 1
    first = np.concatenate(([0], np.cumsum(count)))
    of = np.repeat(np.arange(len(length)), count)
    share = (np.arange(first[-1]) - first[of]) / np.maximum(count - 1, 1)[of]
    start = np.full(len(of), here[0]), np.full(len(of), here[1])
    points = geodesy.ahead(*start, bearing[of], share * length[of])
    top = over.terrain.top_m(*points, over.clearance.radius_m + 0.5 * TURN_EVERY_M)
    ground = over.terrain.ground_m(*points)
    floor = np.maximum(top + over.clearance.least_m, ground + over.cruise_height_m)
    return StraightWays(
        np.asarray(np.maximum.reduceat(floor, first[:-1])),
        np.asarray(np.minimum.reduceat(ground, first[:-1])),
        np.asarray(np.maximum.reduceat(top, first[:-1])),
    )


def level_over_m(here: Place, lat: NDArray[np.float64], lon: NDArray[np.float64], over: Over) -> NDArray[np.float64]:
    """Least height at which straight ways from a place to others are flown level, see `straight_ways`."""
    return straight_ways(here, lat, lon, over).level_m


def level_within_m(corners: Sequence[Place], over: Over) -> float:
    """Least height at which any straight way within the hull of some places is flown level; NaN if the ground is unknown."""
    import shapely

    lat, lon = np.array(corners, dtype=np.float64).T
    middle = geodesy.middle_longitude(lon)
    hull = shapely.MultiPoint(np.column_stack((geodesy.about(lon, middle), lat))).convex_hull
    west, south, east, north = hull.bounds
    step = TURN_EVERY_M / 111_000.0
    wide = step / math.cos(math.radians(min(max(abs(south), abs(north)), 88.0)))
    x, y = np.meshgrid(np.arange(west, east + wide, wide), np.arange(south, north + step, step))
    inside = shapely.dwithin(shapely.points(x.ravel(), y.ravel()), hull, wide)
    points = y.ravel()[inside], x.ravel()[inside]
    return float(_floor_m(*points, over, 1.5 * TURN_EVERY_M).max())


def _floor_m(lat: NDArray[np.float64], lon: NDArray[np.float64], over: Over, every_m: float) -> NDArray[np.float64]:
    """Least height at places, and half as far as `every_m` about them, at which they are flown over; NaN if unknown."""
    top = over.terrain.top_m(lat, lon, over.clearance.radius_m + 0.5 * every_m)
    return np.maximum(top + over.clearance.least_m, over.terrain.ground_m(lat, lon) + over.cruise_height_m)


def _over_stations(ground_m: Sequence[float], cruise_height_m: float, least: Sequence[Least] | None) -> WayHeights:
    """Heights without a terrain model: straight up and down at the ends of a segment that is flown higher."""
    heights = [ground + cruise_height_m for ground in cleared_grounds_m(ground_m)]
    pieces = list(pairwise(heights))
    for number, ends in enumerate(pieces):
        low, low_agl = _between(least, number)
        level = max(low, max(ground_m[number : number + 2]) + low_agl)
        if level > min(ends):
            level = math.ceil(round(max(level, *ends) / STEP_M, 6)) * STEP_M
            pieces[number] = level, level
    knots = [Knot(0, 0.0, pieces[0][0])]
    for number, (begin, end) in enumerate(pieces):
        if begin != knots[-1].height_m:
            knots.append(Knot(number, 0.0, begin))
        knots.append(Knot(number, 1.0, end))
    rises = [after.height_m - before.height_m for before, after in pairwise(knots)]
    up = knots[0].height_m - ground_m[0] + sum(max(rise, 0.0) for rise in rises)
    down = knots[-1].height_m - ground_m[-1] + sum(max(-rise, 0.0) for rise in rises)
    above = [0.5 * (h0 - g0 + h1 - g1) for (h0, h1), (g0, g1) in zip(pieces, pairwise(ground_m), strict=True)]
    none = np.empty(0)
    return WayHeights(
        tuple(knots), up, down, math.fsum(above) / len(above), none, none, none, none, np.empty(0, dtype=np.int64), none
    )


def _joined(found: Samples, parts: Sequence[Steps], ground_m: NDArray[np.float64]) -> WayHeights:
    """One way of segments flown one after the other; over a station between two the height changes at once."""
    unknown = next((part.unknown for part in parts if part.unknown is not None), None)
    begin_m = np.concatenate(([0.0], np.cumsum(found.length_m)))
    along = found.share * np.repeat(found.length_m, np.diff(found.first)) + np.repeat(
        begin_m[:-1], np.diff(found.first)
    )
    flown = np.concatenate([part.level_m for part in parts])
    if unknown is not None:
        nan = math.nan
        return WayHeights(
            (), nan, nan, nan, along, found.ground_m, found.top_m, flown, found.obstacle, found.length_m, unknown
        )
    knots = [Knot(number, share, height) for number, part in enumerate(parts) for share, height in part.knots]
    rises = np.diff([knot.height_m for knot in knots])
    up = knots[0].height_m - ground_m[0] + np.maximum(rises, 0.0).sum()
    down = knots[-1].height_m - ground_m[-1] + np.maximum(-rises, 0.0).sum()
    weight = found.length_m / max(float(found.length_m.sum()), 1e-9)
    above = float(weight @ np.array([part.mean_above_m for part in parts]))
    return WayHeights(
        tuple(knots),
        float(up),
        float(down),
        above,
        along,
        found.ground_m,
        found.top_m,
        flown,
        found.obstacle,
        found.length_m,
    )
