"""How well a drone that has measured the wind where it is knows the wind ahead, and what a stronger one costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.wind.gusts import gust_mean_variance
from skyway.models.wind.triangle import forward_mps

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.field_error import FieldError
    from skyway.planner.problem.error_model import Errors

HERE_MPS = 0.5
"""Standard deviation of a component of the wind where it was measured just now."""
SIGMAS = 2.0
"""What a wind costs that is so many standard deviations more against a flight counts, for each of them: it grows faster than the wind."""
AGED_SHARE, AGED_TIME_S = 0.18, 4700.0
"""An updated forecast is off by more than its members tell: by a standard deviation of a component that grows, with the time since the wind was
measured, to this share of the wind's speed, and so fast. Fitted to 500 hours of 200 days (`benchmarks.tables.wind_aged`)."""
LEAST_MPS = 1.0
"""No flight is slower over the ground."""


@dataclass(frozen=True, slots=True)
class WindAhead:
    """The mean wind over a way ahead differs from that here by the structure function of winds, and by the gusts of the flight."""

    field: FieldError
    """At the height that is flown."""
    gust_sd: float
    gust_time_s: float
    roughness: float = 1.0
    """Variance of changes of the wind as a multiple of the usual one (`models.wind.estimation.roughness`)."""
    age_s: float = 0.0
    """How long before the flight the wind was measured last."""

    @classmethod
    def of(cls, scenario: Scenario, errors: Errors) -> WindAhead:
        """Return that of a scenario's region, at its cruise height."""
        return cls(scenario.field_error, errors.gust_sd, errors.gust_time_s)

    def sd_mps(
        self,
        begin_m: NDArray[np.float64],
        end_m: NDArray[np.float64],
        speed_mps: NDArray[np.float64],
        flight_s: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Standard deviation of a component of the mean wind of straight flights, shape (members, n).

        They begin and end so far along the way from here, shape (n,), in winds of a speed, shape (members, n), and last `flight_s`, shape (n,) or
        (1,).
        """
        gusts = np.array([gust_mean_variance(self.gust_time_s / max(one, 1.0)) for one in flight_s.tolist()])
        apart = 2.0 * self.field.gamma_of_stretch(begin_m, end_m) * self.field.in_wind(speed_mps)
        usual = HERE_MPS**2 + apart + (self.gust_sd * speed_mps) ** 2 * gusts
        return np.asarray(np.sqrt(self.roughness * usual + aged_variance(self.age_s, speed_mps**2)))


def aged_variance(age_s: float, square_mps: ArrayLike) -> NDArray[np.float64]:
    """Variance of a component by which an updated forecast is off beyond its members, so long after the last measurement; `square_mps`: of the wind's speed, m2/s2."""
    return np.asarray(-math.expm1(-age_s / AGED_TIME_S) * AGED_SHARE**2 * np.asarray(square_mps))


def slower_s(
    length_m: NDArray[np.float64],
    wind: tuple[NDArray[np.float64], NDArray[np.float64]],
    airspeed_mps: float,
    max_ground_speed_mps: float,
    sd_mps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Seconds that straight flights take longer for each standard deviation of the wind along them, shape (members, n).

    `wind` is that along and across, m/s.
    """
    along, across = wind
    forward = along + forward_mps(airspeed_mps, across)
    return _longer_s(length_m, (forward, forward - SIGMAS * sd_mps), max_ground_speed_mps)


def drifted_s(
    length_m: NDArray[np.float64],
    wind: tuple[NDArray[np.float64], NDArray[np.float64]],
    airspeed_mps: float,
    max_ground_speed_mps: float,
    sd_mps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Seconds that they take longer for each standard deviation of the wind across them, shape (members, n).

    That is the more the nearer this wind is to the airspeed: where it is 15 m/s of 20, more than for the wind along.
    """
    along, across = wind
    stronger = np.abs(across) + SIGMAS * sd_mps
    speeds = along + forward_mps(airspeed_mps, across), along + forward_mps(airspeed_mps, stronger)
    return _longer_s(length_m, speeds, max_ground_speed_mps)


def _longer_s(
    length_m: NDArray[np.float64], speeds: tuple[NDArray[np.float64], NDArray[np.float64]], max_ground_speed_mps: float
) -> NDArray[np.float64]:
    """Return the seconds more of the second of two ground speeds, for each standard deviation between them."""
    expected, against = (np.clip(one, LEAST_MPS, max_ground_speed_mps) for one in speeds)
    return np.asarray((length_m / against - length_m / expected) / SIGMAS)
