"""Gusts about the wind of an hour, as a drone meets them: how strong they usually are, and what is left of them in a mean."""

from __future__ import annotations

import math

from skyway.models.jit.compiled import compiled_lean

GUST_SD = 0.15
"""Standard deviation of gusts along the wind, as a share of the hourly speed."""
GUST_TIME_S = 180.0
"""Their time constant."""
GUST_LENGTH_M = 5_000.0
"""Gusts of places this far apart are unlike."""


@compiled_lean
def gust_mean_variance(x: float) -> float:
    """Variance of the mean of a flight's gusts as a share of that of one, for a time constant of x times the flight.

    The mean of an Ornstein-Uhlenbeck process of time constant tau over T has, with x = tau / T,

        2 x (1 - x (1 - exp(-1 / x)))

    Takes any x above 0.
    """
    return 2.0 * x * (1.0 - x * (1.0 - math.exp(-1.0 / x)))
