"""Shares and means with their intervals; runs that share a day of the record are not independent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Z95 = 1.959_964
RESAMPLES = 1000


def wilson(hits: float, count: int) -> tuple[float, float]:
    """95 % interval of a share of independent trials (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    share, z = hits / count, Z95
    middle = share + z * z / (2.0 * count)
    half = z * math.sqrt(share * (1.0 - share) / count + z * z / (4.0 * count * count))
    whole = 1.0 + z * z / count
    low = 0.0 if hits == 0 else (middle - half) / whole
    return max(low, 0.0), 1.0 if hits == count else min((middle + half) / whole, 1.0)


def over_days(
    values: NDArray[np.float64],
    day: NDArray[np.int64],
    weight: NDArray[np.float64] | None = None,
    *,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> tuple[float, float]:
    """95 % interval of a (weighted) mean by block bootstrap: whole days are resampled. NaN from one day, and where nothing is to be averaged."""
    known = np.isfinite(values)
    days, block = np.unique(day[known], return_inverse=True)
    if len(days) < 2:
        return math.nan, math.nan
    weights = np.ones(len(block)) if weight is None else weight[known]
    total = np.bincount(block, weights=weights * values[known])
    number = np.bincount(block, weights=weights)
    pick = np.random.default_rng(seed).integers(0, len(days), (resamples, len(days)))
    means = total[pick].sum(axis=1) / number[pick].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def percent(share: float, interval: tuple[float, float], form: Callable[[float], str] = "{:.2f}".format) -> str:
    """A share with its interval, for people."""
    return f"{form(100.0 * share)} [{form(100.0 * interval[0])}, {form(100.0 * interval[1])}]"
