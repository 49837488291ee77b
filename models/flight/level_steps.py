"""Level steps over terrain: the fewest levels of a segment that keep the clearance and, if it allows, the maximum height.

The vehicle climbs and descends vertically at the steps, so their cost does not depend on the wind. Each level continues as
long as one height serves, and is the nearest to the level before.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.way_heights import Over

Place = tuple[float, float]
Least = tuple[float, float]
"""Least heights at which a place is flown over, above mean sea level and above the ground; minus infinity where there is none."""
NO_LEAST: Least = (-math.inf, -math.inf)
STEP_M = 0.1
"""Levels are rounded up to this: missions round heights to centimetres."""
SLACK_M = 20.0
"""If the clearance alone exceeds the maximum height, a level may be this much higher; otherwise every fold of the ground would be a step."""


class Samples(NamedTuple):
    """Points along segments, one segment after the other, with the terrain there."""

    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    share: NDArray[np.float64]
    first: NDArray[np.int64]
    """Index of the first sample of each segment, shape (segments + 1,)."""
    length_m: NDArray[np.float64]
    """Of each segment, shape (segments,)."""
    ground_m: NDArray[np.float64]
    top_m: NDArray[np.float64]
    obstacle: NDArray[np.int64]


def samples(
    lat1: NDArray[np.float64], lon1: NDArray[np.float64], lat2: NDArray[np.float64], lon2: NDArray[np.float64],
    over: Over,
) -> Samples:  # fmt: skip
    """Sample segments between places at the spacing of the terrain model."""
    every_m = max(over.terrain.spacing_m, 5.0)
    length, bearing = geodesy.inverse(lat1, lon1, lat2, lon2)
    count = np.ceil(length / every_m).astype(np.int64) + 1
    first = np.concatenate(([0], np.cumsum(count)))
    of = np.repeat(np.arange(len(length)), count)
    share = (np.arange(first[-1]) - first[of]) / np.maximum(count - 1, 1)[of]
    lat, lon = geodesy.ahead(lat1[of], lon1[of], bearing[of], share * length[of])
    # half of the distance between two samples lies beyond each
    radius_m = over.clearance.radius_m + 0.5 * every_m
    top, (_, obstacle) = over.terrain.top_m(lat, lon, radius_m), over.terrain.obstacles_near(lat, lon, radius_m)
    return Samples(lat, lon, share, first, length, over.terrain.ground_m(lat, lon), top, obstacle)


class Steps(NamedTuple):
    """One segment in level steps."""

    knots: tuple[tuple[float, float], ...]
    """(share, height) in order."""
    level_m: NDArray[np.float64]
    """At each sample."""
    up_m: float
    down_m: float
    mean_above_m: float
    unknown: Place | None
    stops: int = 0
    """Changes of height on the way."""


def level_steps(
    found: Samples,
    number: int,
    ends_m: NDArray[np.float64],
    over: Over,
    *,
    back: bool = False,
    least: Least = NO_LEAST,
) -> Steps:
    """Steps of a segment between two stations whose ground is `ends_m`; `back`: flown from the second to the first."""
    these = slice(int(found.first[number]), int(found.first[number + 1]))
    ground, top, share = found.ground_m[these], found.top_m[these], found.share[these]
    clearance, cruise_height_m = over.clearance, over.cruise_height_m
    floor = np.maximum(top + clearance.least_m, ground + cruise_height_m)
    floor[[0, -1]] = np.fmax(floor[[0, -1]], ends_m + cruise_height_m)
    floor = np.maximum(floor, np.maximum(ground + least[1], least[0]))
    missing = np.flatnonzero(np.isnan(floor) | np.isnan(ground))
    if len(missing) or np.isnan(ends_m).any() or not np.isfinite(floor).all():
        at = int(missing[0]) if len(missing) else int(np.argmax(~np.isfinite(floor)))
        place = float(found.lat[these][at]), float(found.lon[these][at])
        return Steps((), np.full(len(floor), np.nan), math.nan, math.nan, math.nan, place)
    ceiling = np.maximum(floor + SLACK_M, ground + clearance.max_height_m)
    order = np.s_[::-1] if back else np.s_[:]
    begin_m, end_m = (float(one) for one in ends_m[order])
    levels = _levels(floor[order], ceiling[order])
    share = share if not back else 1.0 - share[order]
    knots = [(0.0, levels[0][1])]
    level_m = np.empty(len(floor))
    for (start, level), (until, following) in pairwise([*levels, (len(floor), math.nan)]):
        level_m[start:until] = level
        if until < len(floor):  # up before the higher part begins, down when it has ended
            step = float(share[until - 1 if following > level else until])
            knots += [(step, level), (step, following)]
    knots.append((1.0, levels[-1][1]))
    rises = np.diff([height for _, height in knots])
    up = levels[0][1] - begin_m + float(np.maximum(rises, 0.0).sum())
    down = levels[-1][1] - end_m + float(np.maximum(-rises, 0.0).sum())
    above = float((level_m - ground[order]).mean())
    return Steps(tuple(knots), level_m, up, down, above, None, len(levels) - 1)


def _levels(floor: NDArray[np.float64], ceiling: NDArray[np.float64]) -> list[tuple[int, float]]:
    """Fewest levels between a floor and a ceiling: where each begins, and its height.

    A level continues until the greatest floor since its beginning is above the least ceiling.
    """
    levels: list[tuple[int, float]] = []
    begin = 0
    while begin < len(floor):
        low, high = np.maximum.accumulate(floor[begin:]), np.minimum.accumulate(ceiling[begin:])
        over = np.flatnonzero(low > high)
        length = int(over[0]) if len(over) else len(low)
        least, most = float(low[length - 1]), float(high[length - 1])
        wanted = least if not levels else min(max(levels[-1][1], least), most)
        levels.append((begin, math.ceil(round(wanted / STEP_M, 6)) * STEP_M))
        begin += length
    return levels
