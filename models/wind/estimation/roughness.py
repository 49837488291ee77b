"""Roughness of the air along the way of a drone: changes of the wind from slot to slot, relative to their usual size."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.models.base import geodesy
from skyway.models.wind.estimation.forecast_update import MEASURED_S
from skyway.models.wind.gusts import GUST_LENGTH_M, GUST_TIME_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.wind.estimation.field import WindObservation
    from skyway.models.wind.field_error import FieldError

PRIOR_COUNT = 6.0
"""Weight of the usual value, as a number of changes of one component."""
ONE_FLIGHT_S = 2.0 * MEASURED_S
"""Observations closer together than this are of one flight."""


def roughness(observations: Sequence[WindObservation], field: FieldError) -> float:
    """Return the variance of changes of the wind along flights, as a multiple of the usual one.

    The observations are those of one drone in order, means over slots, at the height of `field`. A component changes between two whose middles are
    a distance d and a time t apart with the variance

        2 gamma'(d, s) + (v_1 + v_2) (1 - exp(-t / tau - d / l))

    of the error between the sites, averaged over either slot (`FieldError.gamma_of_neighbours`), and of the gusts in the two observations, whose variances are v. The scale of that has the inverse chi-square
    distribution as its prior; its mean after n changes z, in their standard deviations, is (nu + sum z^2) / (nu + n).

    Source: A. Gelman et al., "Bayesian Data Analysis" (2013), section 2.6.
    """
    total, count = PRIOR_COUNT, PRIOR_COUNT
    for one, two in pairwise(observations):
        apart_s = two.time_s - one.time_s
        if not 0.0 < apart_s <= ONE_FLIGHT_S:
            continue
        apart_m = geodesy.distance_m(one.lat_deg, one.lon_deg, two.lat_deg, two.lon_deg)
        speed = 0.5 * (math.hypot(one.north_mps, one.east_mps) + math.hypot(two.north_mps, two.east_mps))
        unlike = 1.0 - math.exp(-apart_s / GUST_TIME_S - apart_m / GUST_LENGTH_M)
        usual = 2.0 * field.gamma_of_neighbours(apart_m) * field.in_wind(speed) + (one.variance + two.variance) * unlike
        total += ((two.north_mps - one.north_mps) ** 2 + (two.east_mps - one.east_mps) ** 2) / float(usual)
        count += 2.0
    return total / count
