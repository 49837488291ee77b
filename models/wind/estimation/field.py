"""Winds measured by several drones, and how they differ from a forecast.

Measurements differ from the forecast by a residual that is correlated in space and time: its correlation falls as
``exp(-distance / length) exp(-time / tau)``, and by errors of their own.

Source: N. Cressie, "Statistics for Spatial Data" (1993), section 3.2 (simple kriging).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.wind.gusts import GUST_LENGTH_M, GUST_SD, GUST_TIME_S
from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

MIN_PROFILE_M = 5.0
"""Below this height the power law does not apply."""


@dataclass(frozen=True, slots=True)
class WindObservation:
    """A wind estimated by a filter, averaged over a slot of time."""

    time_s: float
    """POSIX seconds, middle of the slot."""
    lat_deg: float
    lon_deg: float
    """Mean position."""
    north_mps: float
    east_mps: float
    """TOWARDS, at the height of the forecast it is compared with (see `at_height`)."""
    variance: float
    """Of one component, m2/s2."""
    height_m: float = math.nan
    """Above ground, at the measurement; NaN if unknown."""

    def at_height(self, height_m: float, profile_exponent: float) -> WindObservation:
        """Return the equivalent at another height, by the power law; the same if its own height is unknown."""
        if math.isnan(self.height_m):
            return self
        factor = height_factor(height_m, max(self.height_m, MIN_PROFILE_M), profile_exponent)
        return replace(
            self,
            north_mps=self.north_mps * factor,
            east_mps=self.east_mps * factor,
            variance=self.variance * factor**2,
            height_m=height_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualModel:
    """Model of the difference between the wind and a forecast."""

    sigma_mps: float = 2.5
    """Standard deviation of one component."""
    tau_s: float = 6 * 3600.0
    length_m: float = 40_000.0

    def __post_init__(self) -> None:
        faults = [
            Fault("must be above 0", field=name, value=getattr(self, name))
            for name in ("sigma_mps", "tau_s", "length_m")
            if not 0.0 < getattr(self, name) < np.inf
        ]
        refuse(faults)

    def covariance(
        self,
        first: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        second: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    ) -> NDArray[np.float64]:
        """Covariance between (time, lat, lon) of n and of m points, shape (n, m), m2/s2."""
        distance, _ = geodesy.inverse(first[1][:, None], first[2][:, None], second[1][None], second[2][None])
        return np.asarray(self.sigma_mps**2 * np.exp(-distance / self.length_m) * self.fade(first[0], second[0]))

    def fade(self, first_s: NDArray[np.float64], second_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Correlation between n and m instants, shape (n, m)."""
        return np.asarray(np.exp(-np.abs(first_s[:, None] - second_s[None]) / self.tau_s))


def places(
    observations: Sequence[WindObservation],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(time, lat, lon) of observations, shape (n,) each."""
    table = np.array([(one.time_s, one.lat_deg, one.lon_deg) for one in observations], dtype=np.float64).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def noise_covariance(observations: Sequence[WindObservation]) -> NDArray[np.float64]:
    """Covariance of the observations' own errors, m2/s2, shape (n, n): of their gusts, and what else their variances say."""
    variance = np.array([one.variance for one in observations], dtype=np.float64)
    gusts = gust_covariance(observations)
    return gusts + np.diag(variance - np.diag(gusts))


def gust_covariance(observations: Sequence[WindObservation]) -> NDArray[np.float64]:
    """Covariance of the gusts in observations, m2/s2, shape (n, n).

    They are correlated if they were measured soon after each other and nearby: shorter slots do not average them out any better.
    """
    time_s, lat, lon = places(observations)
    variance = np.array([one.variance for one in observations], dtype=np.float64)
    speed = np.array([math.hypot(one.north_mps, one.east_mps) for one in observations], dtype=np.float64)
    gust = np.sqrt(np.minimum(variance, (GUST_SD * speed) ** 2))
    distance, _ = geodesy.inverse(lat[:, None], lon[:, None], lat[None], lon[None])
    alike = np.exp(-np.abs(time_s[:, None] - time_s) / GUST_TIME_S - distance / GUST_LENGTH_M)
    return np.asarray(alike * gust * gust[:, None])


def check_observations(observations: Sequence[WindObservation]) -> None:
    """Raise `InputError` for observations that are not finite or have no positive variance."""
    for one in observations:
        numbers = (one.time_s, one.lat_deg, one.lon_deg, one.north_mps, one.east_mps, one.variance)
        if not np.isfinite(numbers).all() or one.variance <= 0.0:
            raise InputError("is not a wind observation", field="observation", value=one)
