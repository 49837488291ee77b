"""Heights of legs: one rule, for missions and for the wind on the way.

From one station to the next a vehicle is nowhere lower than the cruise height above the higher of the two grounds, since the
ground need not fall or rise where the vehicle does. Over the lower one it is higher than the cruise height, in more wind. The
ground is taken to change linearly between two stations.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.flight.rules import FlightRules


def cleared_grounds_m(grounds_m: Sequence[float]) -> tuple[float, ...]:
    """Ground that a leg clears by the cruise height as it passes each of its stations: the highest one next to it.

    Its own counts too. All are in metres above sea level.
    """
    segments = [max(ends) for ends in pairwise(grounds_m)]
    return tuple(max(neighbours) for neighbours in pairwise((segments[0], *segments, segments[-1])))


def wind_factors(
    rules: FlightRules, ground_m: tuple[ArrayLike, ArrayLike], cleared_m: tuple[ArrayLike, ArrayLike] | None = None
) -> NDArray[np.float64]:
    """Wind on ways as high as they are flown, over that at the cruise height.

    It is that of the profile at their mean height above ground. The ground at begin and end is in metres above sea
    level, broadcast; where it is unknown (NaN) the way is taken to be level. So is the ground that is cleared by the
    cruise height there, by default that of a leg of this way alone. The factor is 1 where both ends are of one height.
    """
    first, last = (np.asarray(one, dtype=np.float64) for one in ground_m)
    top = np.maximum(first, last)
    begin, end = (top, top) if cleared_m is None else (np.asarray(one, dtype=np.float64) for one in cleared_m)
    height_m = rules.cruise_height_m + 0.5 * ((begin - first) + (end - last))
    return above_factors(rules, height_m)


def above_factors(rules: FlightRules, height_m: ArrayLike) -> NDArray[np.float64]:
    """Wind at mean heights above the ground, over that at the cruise height; 1 where the height is unknown (NaN)."""
    height_m = np.where(np.isfinite(height_m), height_m, rules.cruise_height_m)
    return np.asarray(height_factor(height_m, rules.cruise_height_m, rules.wind_profile_exponent))
