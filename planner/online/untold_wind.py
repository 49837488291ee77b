"""Wind that no site tells and no member of a forecast holds, for the figures of told arrivals.

Between the sites the wind differs from what is interpolated (`models.wind.field_error`), and the longer ago it was measured, the more it differs from the
members of an updated forecast (`planner.reach.wind_ahead`). Both hold for about a flight, and change until the next one.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import slot_of
from skyway.models.wind.gusts import gust_mean_variance
from skyway.planner.between_sites import pieces_of
from skyway.planner.reach.wind_ahead import aged_variance
from skyway.planner.schedule.schedule_kernels import TAKE_OFF, TOUCH_DOWN
from skyway.planner.uncertainties import record_days

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary, Leg

LAST_S = 1800.0
"""Time constant of gusts that stand for it: they hold for a flight, and two flights with a charge between meet different ones."""
MOST = 1.0
"""Greatest standard deviation of these, as a share of the wind."""


def with_untold_wind(p: Problem, itinerary: Itinerary, course: NDArray[np.float64], errors: Errors) -> Errors:
    """Return errors whose gusts slow a flight as much as theirs and this wind do together; theirs where there are none, and where no record is forecast from.

    The standard deviation is that of the mean wind of a flight on a `course` (`itinerary.typical_member`), over all flights.
    """
    if not record_days(p.ensemble) or not errors.gust_sd > 0.0:
        return errors
    off_s, flight_s = course[:, TAKE_OFF], course[:, TOUCH_DOWN] - course[:, TAKE_OFF]
    found = [_untold(p, leg, float(at_s)) for leg, at_s in zip(itinerary, off_s, strict=True)]
    untold, speed = (sum(one) for one in zip(*found, strict=True))
    mean_s = max(float(flight_s.mean()), 1.0)
    short = errors.gust_sd**2 * gust_mean_variance(errors.gust_time_s / mean_s)
    wanted = (untold / max(speed, 1e-9) + short) / gust_mean_variance(LAST_S / mean_s)
    return replace(errors, gust_sd=min(math.sqrt(wanted), MOST), gust_time_s=LAST_S)


def _untold(p: Problem, leg: Leg, off_s: float) -> tuple[float, float]:
    """Variance of a component of the mean of this wind over a flight, and the mean square of the forecast wind's speed there, m2/s2."""
    pieces, field, slot = pieces_of(p, leg.segments), p.scenario.field_error, slot_of(p.air, off_s)
    share = pieces.length_m / pieces.length_m.sum()
    weight = share @ p.air.weight[pieces.of]
    speed = np.hypot(p.air.north[:, slot] @ weight, p.air.east[:, slot] @ weight)
    square = float(p.probability @ speed**2)
    apart = float(share @ pieces.covariance @ share) * float(field.in_wind(math.sqrt(square)))
    return max(apart, 0.0) + float(aged_variance(off_s - p.depart_s, square)), square
