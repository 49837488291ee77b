"""A gust that a drone has just measured, and what of it a flight from there still meets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.wind.gusts import GUST_LENGTH_M, GUST_TIME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class FeltGust:
    """The expected gust in a measured wind: what differs from the wind of a forecast, but fades within minutes and kilometres.

    Its correlation falls by exp(-t / tau - d / l), as in `models.wind.estimation.field.noise_covariance`.
    """

    time_s: float
    lat_deg: float
    lon_deg: float
    """When (POSIX seconds) and where it was measured."""
    north_mps: float
    east_mps: float

    def times(self, factor: float) -> FeltGust:
        """Return that of a wind stronger by a factor, as at another height."""
        return replace(self, north_mps=factor * self.north_mps, east_mps=factor * self.east_mps)

    def share_of(
        self,
        start: tuple[NDArray[np.float64], NDArray[np.float64]],
        length_m: NDArray[np.float64],
        begin_s: NDArray[np.float64],
        flight_s: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Share of the gust in the mean wind of straight flights, shape (n,) each; they begin at places (lat, lon), degrees.

        With the decay k before a flight and x during it, that is exp(-k) (1 - exp(-x)) / x.
        """
        away_m = geodesy.coarse_distance_m(*start, self.lat_deg, self.lon_deg)
        before = np.maximum(begin_s - self.time_s, 0.0) / GUST_TIME_S + away_m / GUST_LENGTH_M
        during = np.maximum(flight_s / GUST_TIME_S + length_m / GUST_LENGTH_M, 1e-9)
        return np.asarray(np.exp(-before) * -np.expm1(-during) / during)
