"""Kernels of how a flight fares in wind that is not known for sure: gusts, and members that say too little of later hours."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import along_across, cross, forward_mps, slot_of, slots_of, speed_in, wind_on
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.models.wind.gusts import gust_mean_variance
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS
from skyway.planner.robust.normal_kernels import capped
from skyway.planner.schedule.gust_kernels import LATERAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind
    from skyway.planner.robust.information_kernels import Known


@compiled_lean
def gust_mean(known: Known, flight_s: float) -> float:
    """Standard deviation of the mean of a flight's gusts, as a share of the wind; `flight_s` is how long it lasts.

    Takes any length of flight; what is not above 0 has the gust of a moment.
    """
    return known.gust_sd * math.sqrt(gust_mean_variance(known.gust_time_s / max(flight_s, 1.0)))


@compiled_lean
def wind_felt(air: SegmentWind, member: int, slot: int, segment: int) -> tuple[float, float, float]:
    """Ground speed (equations 1-5), and what gusts as strong as the wind itself change it by; m/s, without limits.

    With the wind (a, c) along and across the way, gusts of the shares x along the wind and y across it make it

        (a + a x - c y,  c + c x + a y)

    so that the ground speed v = a + sqrt(S^2 - c^2) changes by (a - c t) x - (c + a t) y to first order, with the
    tangent of the crab angle t = c / sqrt(S^2 - c^2). Returned are v, a - c t, and c + a t times `LATERAL`.
    """
    north, east = wind_on(air, member, slot, segment)
    return felt_in(air, segment, north, east)


@compiled_lean
def felt_in(air: SegmentWind, segment: int, north: float, east: float) -> tuple[float, float, float]:
    """Return `wind_felt` in a wind (north, east), m/s."""
    along, across = along_across(north, east, air.cos_bearing[segment], air.sin_bearing[segment])
    forward = forward_mps(air.airspeed_mps, across)
    crab = across / max(forward, MIN_GROUND_SPEED_MPS)
    return along + forward, along - across * crab, LATERAL * (across + along * crab)


@compiled_lean
def wind_variance(known: Known, ahead_s: float) -> float:
    """Variance of a wind component around a member's value, `ahead_s` after the hour of the measurement, m2/s2.

    (b sigma)^2 (1 - exp(-2 t / tau)): the variance that a residual has gained by then, times the square of b =
    `smoothing`.
    """
    unsure = known.sigma_mps * known.smoothing
    return unsure * unsure * (1.0 - math.exp(-2.0 * ahead_s / known.tau_s))


@compiled_lean
def _slow_speed(wind: tuple[Known, SegmentWind, int, int, float], slot: int, segment: int) -> float:
    """Ground speed of `slow_land` as `models.flight.kernels.cross` takes it, m/s.

    v - `steady_sigmas` sqrt(gust^2 f^2 + variance of the wind), v and f (what a gust of the wind's own strength does) of
    `wind_felt`; then the mean under the greatest ground speed, with the rest of the gusts, which vary about their mean.

    `wind` is (known, air, member, slot of the take-off, gust).
    """
    known, air, member, first, gust = wind
    speed, with_wind, across_wind = wind_felt(air, member, slot, segment)
    felt = math.hypot(with_wind, across_wind)
    # What is uncertain all the way: the mean gust and, after the hour of the take-off, the wind.
    square = gust * gust * felt * felt
    if slot > first:
        square += wind_variance(known, (slot - first) * air.slot_s)
    # What varies about that.
    about = felt * math.sqrt(max(known.gust_sd * known.gust_sd - gust * gust, 0.0))
    return max(
        capped(speed - known.steady_sigmas * math.sqrt(square), about, air.max_ground_speed_mps), MIN_GROUND_SPEED_MPS
    )


@compiled_lean
def slow_land(
    known: Known, air: SegmentWind, member: int, segments: NDArray[np.int64], depart_s: float, gust: float
) -> float:
    """Touch-down of a flight in wind worse than the member's all the way, by `Known.steady_sigmas` deviations.

    Of the wind itself after the hour of the take-off, and of the mean of gusts, `gust` as a share of the wind. About
    their mean gusts come and go: where the ground speed is capped, lulls slow a flight and squalls from behind give
    nothing back. Whether the flight is flyable, `land` decides.
    """
    now = depart_s + air.climb_s
    wind = known, air, member, slot_of(air, depart_s), gust
    for segment in segments:
        now = cross(_slow_speed, wind, slots_of(air), air.distance_m[segment], segment, now)
    return now + air.descent_s


@compiled
def careful_speeds(
    air: SegmentWind, member: int, slots: NDArray[np.int64], segments: NDArray[np.int64], gust: float
) -> NDArray[np.float64]:
    """Ground speeds with a gust against every flight, m/s, shape (slots, segments); 0 where closed.

    v - `gust` f, v and f of `wind_felt`, `gust` as a share of the wind.

    Takes a member, slots and segments of the air, any number of them, and a finite gust.
    """
    out = np.zeros((len(slots), len(segments)))
    for row in range(len(slots)):
        for column in range(len(segments)):
            segment = segments[column]
            if air.shut[slots[row], air.shut_of[segment]]:
                continue
            north, east = wind_on(air, member, slots[row], segment)
            if speed_in(air, segment, north, east) > 0.0:
                speed, with_wind, across_wind = felt_in(air, segment, north, east)
                felt = math.sqrt(with_wind * with_wind + across_wind * across_wind)
                out[row, column] = min(max(speed - gust * felt, MIN_GROUND_SPEED_MPS), air.max_ground_speed_mps)
    return out
