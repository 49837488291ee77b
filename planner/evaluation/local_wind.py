"""The wind that no site tells, as it may be: one sample of a random field with the covariance of `models.wind.field_error`.

An intrinsic random field Z with the semivariogram g(d) = c (d / D)^(2/3) is a sum of waves whose sizes k are spread evenly over ln k, with variances as k^(-2/3):

    Z(x, t) = sum a_j sqrt(2) cos(k_j . x + w_j t + phi_j),      sum a_j^2 (1 - J0(k_j D)) = c

J0 is the Bessel function that the mean over all directions makes of the cosine. Frequencies w are of Cauchy's distribution, so that the correlation fades as exp(-t / tau).
What the sites do not tell at x is Z(x) less what is interpolated from Z at the sites; it vanishes at a site.

Source: N. Cressie, "Statistics for Spatial Data" (1993), sections 2.3 and 3.6.1 (spectral simulation).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.geodesy import M_PER_DEG
from skyway.models.wind.field_error import EXPONENT, REFERENCE_M

if TYPE_CHECKING:
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.field_error import FieldError

WAVES = 128
LONGEST_M, SHORTEST_M = 3e6, 500.0
"""Lengths of the waves."""
FASTEST_RAD_S = math.pi / 600.0
"""No wave turns faster: Cauchy's distribution has no greatest frequency."""


class LocalWind:
    """How much the wind differs from what is interpolated between the sites of an ensemble, in one realization.

    `field` is at the height of the ensemble.
    """

    def __init__(self, field: FieldError, wind: WindEnsemble, rng: np.random.Generator) -> None:
        from scipy.special import j0

        self._field, self._wind = field, wind
        share = (np.arange(WAVES) + rng.random(WAVES)) / WAVES
        size = 2.0 * np.pi / (LONGEST_M * (SHORTEST_M / LONGEST_M) ** share)
        power = size**-EXPONENT
        power *= field.variance / float(power @ (1.0 - j0(size * REFERENCE_M)))
        course = 2.0 * np.pi * rng.random(WAVES)
        self._amplitude = np.sqrt(2.0 * power)
        self._wave = size * np.stack((np.cos(course), np.sin(course)))
        turns = np.tan(np.pi * (rng.random(WAVES) - 0.5)) / field.tau_s
        self._turns = np.clip(turns, -FASTEST_RAD_S, FASTEST_RAD_S)
        self._phase = 2.0 * np.pi * rng.random((2, WAVES))
        self._origin = float(np.mean(wind.site_lat)), float(np.mean(wind.site_lon))

    def at(self, lat: float, lon: float, time_s: float, speed_mps: float) -> tuple[float, float]:
        """(north, east) m/s at a place and POSIX time, in a wind of a speed there."""
        if not self._field.variance > 0.0:
            return 0.0, 0.0
        lats, lons = np.append(self._wind.site_lat, lat), np.append(self._wind.site_lon, lon)
        north_m = (lats - self._origin[0]) * M_PER_DEG
        east_m = (lons - self._origin[1]) * M_PER_DEG * math.cos(math.radians(self._origin[0]))
        angle = np.stack((north_m, east_m), axis=1) @ self._wave + self._turns * (time_s - self._wind.start_s)
        free = np.cos(angle + self._phase[:, None]) @ self._amplitude  # (component, place)
        weight = self._wind.weights(lat, lon)[0]
        north, east = (free[:, -1] - free[:, :-1] @ weight) * math.sqrt(float(self._field.in_wind(speed_mps)))
        return float(north), float(east)
