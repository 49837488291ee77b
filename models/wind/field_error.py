"""Error of the wind interpolated between the sites.

The wind differs from place to place, increasingly with their distance and with the wind speed. Half the mean square of the
difference of one component between places a distance d apart (the semivariogram) is, at a wind speed s,

    gamma(d, s) = c (1 + s / S) (d / D)^(2/3),     D = `REFERENCE_M`, S = `GUSTY_MPS`

with the exponent of the structure function of winds from kilometres to some hundred kilometres. The interpolation with weights a_i
from sites x_i, whose sum is 1, has at places x and y errors with the covariance

    sum a_i(x) gamma(x_i - y) + sum a_j(y) gamma(x - x_j) - sum sum a_i(x) a_j(y) gamma(x_i - x_j) - gamma(x - y)

Sources: G. D. Nastrom and K. S. Gage, "A climatology of atmospheric wavenumber spectra of wind and temperature observed by commercial
aircraft", Journal of the Atmospheric Sciences 42 (1985); N. Cressie, "Statistics for Spatial Data" (1993), section 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import refuse
from skyway.models.base.ranges import range_faults

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from skyway.models.wind.history import WindHistory

REFERENCE_M = 25_000.0
EXPONENT = 2.0 / 3.0
GUSTY_MPS = 2.0
"""At this speed the variance is twice that in calm air. New York 2013, three airports 19 to 35 km apart: 1.2 to 5.5 m/s, by pair."""
TWO_MINUTES_SD = 0.123
"""Of gusts (15 % of the wind along it, 12 % across, correlated for 3 minutes) in a mean of two minutes, as airports report: no error between sites."""
SHORTEST_M = 1.0
"""Shorter stretches count as this long."""
MIN_HOURS = 240
"""A record with fewer hours in which two sites measured determines no values of its own."""


@dataclass(frozen=True, slots=True)
class FieldError:
    """The error of the interpolated wind, at the height of the measurement."""

    variance: float = 0.62
    """c: of one component in calm air between places `REFERENCE_M` apart, m2/s2. New York 2013."""
    tau_s: float = 6 * 3600.0
    """Its correlation fades by exp(-t / tau). New York: 0.52, 0.41, 0.31, 0.14 after 1, 2, 3, 6 h, the first step the noise of 2 minutes' means."""
    gusty_mps: float = GUSTY_MPS
    """S, for winds at the same height as `variance`."""

    def __post_init__(self) -> None:
        faults = range_faults("variance", self.variance, 0.0, 1e4, "m2/s2, from 0")
        faults += range_faults("tau_s", self.tau_s, 1.0, 1e9, "s, from 1")
        faults += range_faults("gusty_mps", self.gusty_mps, 0.01, 1e4, "m/s, from 0.01")
        refuse(faults)

    @classmethod
    def of(cls, history: WindHistory) -> FieldError:
        """Return that of a record of several sites; the default where there are too few."""
        found, weight = 0.0, 0
        for i, j in combinations(range(len(history.sites)), 2):
            first, second = history.sites[i], history.sites[j]
            north, east = (part[:, i] - part[:, j] for part in (history.north, history.east))
            speed = np.hypot(history.north[:, [i, j]], history.east[:, [i, j]]).mean(axis=1)
            known = np.isfinite(speed)
            distance_m = geodesy.distance_m(first.lat, first.lon, second.lat, second.lon)
            if known.sum() >= MIN_HOURS and distance_m > 1.0:
                noise = (TWO_MINUTES_SD * speed[known]) ** 2
                gamma = (0.25 * (north[known] ** 2 + east[known] ** 2) - noise) / (1.0 + speed[known] / GUSTY_MPS)
                found += float(gamma.mean()) * (REFERENCE_M / distance_m) ** EXPONENT
                weight += 1
        return cls(found / weight) if weight and found > 0.0 else cls()

    def at_height(self, factor: float) -> FieldError:
        """Return the same for winds stronger by a factor than at the height of the measurement."""
        return replace(self, variance=self.variance * factor**2, gusty_mps=self.gusty_mps * factor)

    def in_wind(self, speed_mps: ArrayLike) -> NDArray[np.float64]:
        """Variance in wind of a speed over that in calm air."""
        return np.asarray(1.0 + np.asarray(speed_mps) / self.gusty_mps)

    def gamma(self, distance_m: ArrayLike) -> NDArray[np.float64]:
        """Semivariogram in calm air, m2/s2."""
        return np.asarray(self.variance * (np.asarray(distance_m) / REFERENCE_M) ** EXPONENT)

    def gamma_of_stretch(self, begin_m: ArrayLike, end_m: ArrayLike) -> NDArray[np.float64]:
        """Semivariogram between a place and the mean over a straight stretch, in calm air, m2/s2.

        The stretch leads away from the place, from a distance a to a distance b: with gamma(d) = g d^p that is

            g (b^(p+1) - a^(p+1)) / ((p + 1) (b - a)) - g (b - a)^p / ((p + 1) (p + 2))

        the mean of gamma over the stretch, less the half mean of gamma within it (Cressie, section 3.2.5: block kriging).
        """
        begin, end = np.asarray(begin_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
        length = np.maximum(end - begin, SHORTEST_M)
        to = ((begin + length) ** (EXPONENT + 1.0) - begin ** (EXPONENT + 1.0)) / ((EXPONENT + 1.0) * length)
        within = length**EXPONENT / ((EXPONENT + 1.0) * (EXPONENT + 2.0))
        return np.asarray(self.variance * (to - within) / REFERENCE_M**EXPONENT)

    def gamma_of_neighbours(self, apart_m: ArrayLike) -> NDArray[np.float64]:
        """Semivariogram between the means over two adjoining straight stretches whose middles are this far apart, in calm air, m2/s2.

        With gamma(d) = g d^p that is g d^p (2^(p+2) - 4) / ((p + 1) (p + 2)).
        """
        share = (2.0 ** (EXPONENT + 2.0) - 4.0) / ((EXPONENT + 1.0) * (EXPONENT + 2.0))
        return np.asarray(share * self.gamma(apart_m))

    def covariance(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], weight: NDArray[np.float64],
        site_lat: NDArray[np.float64], site_lon: NDArray[np.float64],
    ) -> NDArray[np.float64]:  # fmt: skip
        """Covariance of the errors at n places in calm air, m2/s2, shape (n, n); `weight`, shape (n, sites), sums to 1 in each row."""
        between = self.gamma(_distances(lat, lon, lat, lon))
        to_sites = weight @ self.gamma(_distances(site_lat, site_lon, lat, lon))
        of_sites = weight @ self.gamma(_distances(site_lat, site_lon, site_lat, site_lon)) @ weight.T
        return np.asarray(to_sites + to_sites.T - of_sites - between)

    def variances(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], weight: NDArray[np.float64],
        site_lat: NDArray[np.float64], site_lon: NDArray[np.float64],
    ) -> NDArray[np.float64]:  # fmt: skip
        """The diagonal of `covariance`, shape (n,)."""
        to_sites = (weight * self.gamma(_distances(site_lat, site_lon, lat, lon).T)).sum(axis=1)
        of_sites = np.einsum(
            "ni,ij,nj->n", weight, self.gamma(_distances(site_lat, site_lon, site_lat, site_lon)), weight
        )
        return np.asarray(np.maximum(2.0 * to_sites - of_sites, 0.0))


EXACT_FIELD = FieldError(0.0)
"""No error between the sites."""


def _distances(
    lat: NDArray[np.float64], lon: NDArray[np.float64], lats: NDArray[np.float64], lons: NDArray[np.float64]
) -> NDArray[np.float64]:
    return geodesy.coarse_distance_m(np.asarray(lat)[:, None], np.asarray(lon)[:, None], lats, lons)
