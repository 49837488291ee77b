"""Gusts about the wind of an hour, at a moving drone: their usual size, and their mean over a time."""

from __future__ import annotations

import math

from skyway.models.jit.compiled import compiled_lean

GUST_SD = 0.15
"""Standard deviation of gusts along the wind, as a share of the hourly speed."""
GUST_TIME_S = 180.0
"""Their time constant."""
GUST_LENGTH_M = 5_000.0
"""Gusts of places this far apart are unlike."""
PEAK_FACTOR = 3.0
"""A gust as it is forecast, the strongest 3 s of an hour, is so many standard deviations above the mean: 2.5 to 3.5 (Davenport, "Note on the distribution of
the largest value of a random function", ICE 28, 1964; WMO/TD-1555, 2010)."""
LEAST_GUST_SD, MOST_GUST_SD = 0.05, 0.5
"""Bounds of what a forecast is believed to say of them: in light winds its gusts are showers, and no share of the wind."""


@compiled_lean
def gust_mean_variance(x: float) -> float:
    """Variance of the mean of a flight's gusts as a share of that of one, for a time constant of x times the flight.

    The mean of an Ornstein-Uhlenbeck process of time constant tau over T has, with x = tau / T,

        2 x (1 - x (1 - exp(-1 / x)))

    Takes any x above 0.
    """
    return 2.0 * x * (1.0 - x * (1.0 - math.exp(-1.0 / x)))
