"""95 % intervals of sums over simulated days; days with the wind of the same day of the record are not independent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import student, wilson

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MANY = 10**6 - 1
"""Degrees of freedom with which Student's t is a normal distribution."""


def ratio_error(top: NDArray[np.float64], bottom: NDArray[np.float64], wind: NDArray[np.int64]) -> float:
    """Standard error of sum(top) / sum(bottom) over days; `wind` is the day of the record of each. NaN with the wind of one day alone."""
    total = float(bottom.sum())
    rest = np.bincount(wind, weights=top - float(top.sum()) / total * bottom) if total else np.zeros(0)
    if len(rest) < 2:
        return math.nan
    return math.sqrt(len(rest) / (len(rest) - 1) * float(rest @ rest)) / total


def share_interval(
    some: NDArray[np.float64], orders: NDArray[np.float64], wind: NDArray[np.int64]
) -> tuple[float, float]:
    """Interval of the share of some orders among all.

    It is at least Wilson's interval of as many independent orders: days that are alike by chance do not make it narrow, and a share of 0 or 1 is not certain.
    NaN without orders, and with the wind of one day alone.
    """
    error = ratio_error(some, orders, wind)
    if math.isnan(error):
        return math.nan, math.nan
    count = float(orders.sum())
    share, half = float(some.sum()) / count, student(len(np.unique(wind)) - 1) * error
    low, high = wilson(share, count, student(_MANY))
    return max(min(share - half, low), 0.0), min(max(share + half, high), 1.0)


def difference_half_width(more: NDArray[np.float64], hours: NDArray[np.float64], wind: NDArray[np.int64]) -> float:
    """Half of the interval of a number of orders per hour more or less, which is counted on the same days.

    Numbers that are the same on all days are not certain for that: the standard error is at least that of one order on one of the days.
    """
    error = ratio_error(more, hours, wind)
    if math.isnan(error):
        return math.nan
    return student(len(np.unique(wind)) - 1) * max(error, 1.0 / float(hours.sum()))
