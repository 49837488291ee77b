"""Kernels of normal distributions: the mean of one that is cut off, and the quantile of a mixture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled_lean

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SURE = 6.5
"""Standard deviations beyond which nothing is expected: 4e-11."""
_CLOSE = 1e-3  # share of epsilon to which the chance is met that a flight needs more
_STRAIGHT, _ROUNDS = 10, 40  # rounds of that search by false position, and all


@compiled_lean
def capped(mean: float, deviation: float, most: float) -> float:
    """Mean of what is normally distributed but never above a limit.

    Of min(L, X), X ~ Normal(mean, deviation^2), L = `most`; with Phi and phi the standard normal distribution and
    density:

        mean Phi(q) + L (1 - Phi(q)) - deviation phi(q),     q = (L - mean) / deviation
    """
    if mean + SURE * deviation <= most:
        return mean
    if deviation <= 0.0:
        return most
    off = (most - mean) / deviation
    below = 0.5 * math.erfc(-off * math.sqrt(0.5))
    density = math.exp(-0.5 * off * off) / math.sqrt(2.0 * math.pi)
    return mean * below + most * (1.0 - below) - deviation * density


@compiled_lean
def _deviations(chance: float) -> float:
    """Standard deviations z that a normal deviate exceeds with a chance up to a half, to 5e-4.

        z = t - (2.515517 + 0.802853 t + 0.010328 t^2) / (1 + 1.432788 t + 0.189269 t^2 + 0.001308 t^3)
        t = sqrt(-2 ln chance)

    Source: Abramowitz and Stegun, "Handbook of Mathematical Functions", 26.2.23.
    """
    t = math.sqrt(-2.0 * math.log(chance))
    return t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))


@compiled_lean
def exceeded_by(
    least: float,
    total: float,
    mean: NDArray[np.float64],
    spread: NDArray[np.float64],
    share: NDArray[np.float64],
) -> float:
    """Find the value x that a mixture of normal distributions, of weight `total`, exceeds with weight `least`.

    Solves sum of share_m Q((x - mean_m) / spread_m) = least, Q(z) = erfc(z / sqrt(2)) / 2. None of its parts alone may
    exceed it with more, and where each does so with its share, so does the mixture: between these bounds the logarithm
    of the weight is all but straight, and is followed by false position (the Illinois rule: an end that stays counts
    half). O(parts) each round.

    `mean`, `spread` (above 0) and `share` have shape (parts,).
    """
    # The bounds: x where one part alone exceeds it with `least`, and where each does with its share.
    lowest, low, high = NEVER, -NEVER, -NEVER
    most = _deviations(min(least / total, 0.5)) + 1e-3
    for m in range(len(mean)):
        lowest, high = min(lowest, mean[m]), max(high, mean[m] + most * spread[m])
        if 2.0 * least < share[m]:
            low = max(low, mean[m] + (_deviations(least / share[m]) - 1e-3) * spread[m])
    low = max(low, lowest)
    below, above, side = math.nan, math.nan, 0
    x = low
    for done in range(_ROUNDS):
        # Weight beyond x; what is `SURE` deviations above a part has none of it.
        beyond = 0.0
        for m in range(len(mean)):
            off = (x - mean[m]) / spread[m]
            if off < SURE:
                beyond += share[m] * 0.5 * math.erfc(off * math.sqrt(0.5))
        miss = math.log(max(beyond, 1e-300) / least)
        if abs(miss) < _CLOSE:
            return x
        # The root is above x or below.
        if miss > 0.0:
            low, below = x, miss
            above = above / 2.0 if side > 0 else above
            side = 1
        else:
            high, above = x, miss
            below = below / 2.0 if side < 0 else below
            side = -1
        # First both ends, then between them.
        if math.isnan(above):
            x = high
        elif math.isnan(below):
            x = low
        else:  # halved where parts are so narrow that the weight falls in steps
            x = low + (high - low) * (below / (below - above) if done < _STRAIGHT else 0.5)
    return high
