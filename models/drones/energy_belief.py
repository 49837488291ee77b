"""The energy belief: the ratio of measured to modelled energy of a leg, and how it is updated.

The ratio of a leg is r = m + a + b: a mean m, a part a that persists (this aircraft, its battery and package on this delivery),
and a part b that is fresh on each leg (manoeuvres, head or tail wind at the same airspeed, turbulence). Planners promise with it,
checks judge with it, and flights start from it and learn a, not b:

    a | r_1 ... r_n  has  mean K (mean(r) - m),  variance (1 - K) sd_between^2,  K = sd_between^2 / (sd_between^2 + sd_within^2 / n)

Both parts have Student's t distribution, for their standard deviations come from few flights.

Fitted to data by `python -m benchmarks.tables.energy_error`, which prints every number below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.ranges import range_faults

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

FLIGHT_SD, LEG_SD, PART_SD = 0.015, 0.03, 0.025
"""Standard deviations of the ratio where a model was fitted to other flights of the same aircraft: between flights, between the straight legs
of a flight, and between the halves of a leg of 15 s or more. Five flights of a Matrice 100 with 0 to 500 g at 4 to 12 m/s, 20 legs."""
PUBLISHED_MEAN, PUBLISHED_SD = 0.99, 0.062
"""For aircraft whose power is that of their published endurance at any airspeed. Measured: 0.83 of it at 6 to 10 m/s (the same Matrice 100);
momentum theory at 20 m/s: 1.15. 98 % of all aircraft are assumed to be between the two. One aircraft: the least certain number here."""
PUBLISHED_LEG_SD = 0.06
"""Between the legs of a delivery of such an aircraft: those of `LEG_SD` and, by momentum theory in the wind record of New York, 0.055 because the
airspeed changes from leg to leg (the ground speed is capped in a tail wind)."""
AIRSPEED_SD = 0.04
"""Between aircraft if momentum theory gives the power over airspeed (`models.drones.airspeed_load`): that of the flights of the Matrice 100."""
AIRSPEED_LEG_SD = 0.04
"""Between the legs of a delivery of such an aircraft: `LEG_SD`, and 0.027 because the wind is known in flight to 0.4 m/s, and the power at 20 m/s grows by 0.067 of
itself with each m/s (`airspeed_slope` of `benchmarks.tables.energy_error`)."""
DEGREES_OF_FREEDOM = 15.0
"""Of the standard deviation between legs: 20 legs of five flights. They themselves have no heavy tails: kurtosis 2.2, that of normal ones is 3."""
PRIOR_FLIGHTS = 4.0
"""Number of flights of the measured aircraft that count for another aircraft, besides its own flights: one fewer than there were."""
SOC_SD = 0.006
"""For a state of charge reported in whole percent."""
LEAST_RATIO = 0.2
"""No sampled leg takes less: 8 standard deviations below the mean."""

RANGES = {
    "mean_ratio": (0.1, 10.0),
    "sd_between": (0.0, 2.0),
    "sd_within": (0.0, 2.0),
    "degrees_of_freedom": (5.0, 1e6),
}
"""Least and greatest value of each field, in a program as in a fleet file."""


@dataclass(frozen=True, slots=True)
class EnergyBelief:
    """The ratio of measured to modelled energy of a leg; the default is that of a drone without measurements."""

    mean_ratio: float = PUBLISHED_MEAN
    sd_between: float = PUBLISHED_SD
    """Standard deviation of the part that persists over the legs of a delivery."""
    sd_within: float = PUBLISHED_LEG_SD
    """Standard deviation of the part that is fresh on each leg."""
    degrees_of_freedom: float = DEGREES_OF_FREEDOM
    """Of Student's t distribution of both parts; the fewer, the heavier the tails."""

    def __post_init__(self) -> None:
        faults: list[Fault] = []
        for name, (low, high) in RANGES.items():
            faults += range_faults(name, getattr(self, name), low, high, f"from {low:g} to {high:g}")
        if faults:
            raise InputError(faults)

    @classmethod
    def calibrated(cls, left_out_error: Sequence[float] = ()) -> EnergyBelief:
        """Return that of a drone whose model was fitted to its own flights.

        The errors are those of the energy of each flight by a model fitted to the others, relative; NaN counts as
        unknown. They are combined with `FLIGHT_SD`, which has the weight of `PRIOR_FLIGHTS` flights.
        """
        error = np.array([one for one in left_out_error if math.isfinite(one)])
        variance = (PRIOR_FLIGHTS * FLIGHT_SD**2 + float((error**2).sum())) / (PRIOR_FLIGHTS + len(error))
        fitted_to = max(len(left_out_error), 1)
        return cls(1.0, math.sqrt(variance * (1.0 + 1.0 / fitted_to)), LEG_SD)

    def counting_airspeed(self) -> EnergyBelief:
        """Return the same where the model includes the power over airspeed: more of the error persists, so a leg is more informative."""
        return replace(
            self, sd_between=min(self.sd_between, AIRSPEED_SD), sd_within=min(self.sd_within, AIRSPEED_LEG_SD)
        )

    @property
    def leg_sd(self) -> float:
        """Standard deviation of the ratio of a leg: of both parts."""
        return math.hypot(self.sd_between, self.sd_within)

    def p_at_most(self, ratio: ArrayLike) -> NDArray[np.float64]:
        """Probability that a leg takes at most a multiple of the model's energy."""
        over = np.asarray(ratio, dtype=np.float64) - self.mean_ratio
        if self.leg_sd == 0.0:
            return np.asarray(over >= 0.0, dtype=np.float64)
        below = np.vectorize(NormalDist().cdf, otypes=[np.float64])
        return np.asarray(below(self.normal_deviate(over / self.leg_sd)))

    def quantile(self, probability: float) -> float:
        """Ratio that a leg stays at or below with a probability."""
        return self.mean_ratio + self.leg_sd * self.sigmas(probability)

    def sigmas(self, probability: float) -> float:
        """Number of standard deviations of that ratio above the mean."""
        nu = self.degrees_of_freedom
        z = NormalDist().inv_cdf(probability) * (8.0 * nu + 3.0) / (8.0 * nu + 1.0)
        return math.copysign(math.sqrt(nu * math.expm1(z * z / nu)), z)

    def normal_deviate(self, sigmas: ArrayLike) -> NDArray[np.float64]:
        """Return the normal deviate as probable as a number of standard deviations of this belief: the inverse of `sigmas`.

        Source: D. L. Wallace, "Bounds on normal approximations to Student's and the chi-square distributions", Annals of
        Mathematical Statistics 30 (1959).
        """
        t, nu = np.asarray(sigmas, dtype=np.float64), self.degrees_of_freedom
        z = (8.0 * nu + 1.0) / (8.0 * nu + 3.0) * np.sqrt(nu * np.log1p(np.minimum(np.abs(t), 1e6) ** 2 / nu))
        return np.asarray(np.copysign(z, t))

    def sampled(self, rng: np.random.Generator, deliveries: int, legs: int) -> NDArray[np.float64]:
        """Draw the ratios of the legs of deliveries, shape (deliveries, legs); a larger number of deliveries begins with the same ones."""
        deviate = rng.standard_t(self.degrees_of_freedom, (deliveries, 1 + legs))
        ratio = self.mean_ratio + self.sd_between * deviate[:, :1] + self.sd_within * deviate[:, 1:]
        return np.maximum(ratio, LEAST_RATIO)

    def ratios(self, shares: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Ratios of the legs of deliveries from shares of the distributions, 0 to 1: (what persists, shape (deliveries,); shape (deliveries, legs)).

        The shares, shape (deliveries, 1 + legs), are those of the part that persists, and of the part that is fresh on each leg.
        """
        from scipy.special import ndtri

        nu = self.degrees_of_freedom
        z = ndtri(shares) * (8.0 * nu + 3.0) / (8.0 * nu + 1.0)
        sigmas = np.copysign(np.sqrt(nu * np.expm1(z * z / nu)), z)
        usual = self.mean_ratio + self.sd_between * sigmas[:, 0]
        return usual, np.maximum(usual[:, None] + self.sd_within * sigmas[:, 1:], LEAST_RATIO)

    def p_leg_above(self, ratio: NDArray[np.float64], usual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probability that a leg of a delivery takes more than a multiple of the model's energy, given what persists of it."""
        from scipy.special import ndtr

        if self.sd_within == 0.0:
            return np.asarray(usual > ratio, dtype=np.float64)
        return np.asarray(ndtr(-self.normal_deviate((ratio - usual) / self.sd_within)))

    def learnt(self, used_soc: float, expected_soc: float, soc_sd: float = SOC_SD) -> EnergyBelief:
        """Return the belief after a whole leg: about the part that persists.

        The measured charge, and the modelled one, are fractions of nameplate; `soc_sd` is the standard
        deviation of a reported state of charge.
        """
        return _updated(self, used_soc, expected_soc, self.sd_within, soc_sd)

    def in_flight(self, used_soc: float, expected_soc: float, soc_sd: float = SOC_SD) -> EnergyBelief:
        """Return the belief about the rest of a leg of which a part has been flown; see `learnt`."""
        return _updated(self.next_flight(), used_soc, expected_soc, PART_SD, soc_sd)

    def next_flight(self) -> EnergyBelief:
        """Return the belief about the next leg as that about a part which persists: both parts in one."""
        return replace(self, sd_between=self.leg_sd)

    def times(self, load: float) -> EnergyBelief:
        """Return the same belief about a model with values `load` times lower."""
        return replace(
            self, mean_ratio=load * self.mean_ratio, sd_between=load * self.sd_between, sd_within=load * self.sd_within
        )


EXACT = EnergyBelief(1.0, 0.0, 0.0)
"""The model is right."""


def _updated(belief: EnergyBelief, used_soc: float, expected_soc: float, spread: float, soc_sd: float) -> EnergyBelief:
    """Update a belief with one measurement: a scalar Kalman step."""
    if not (expected_soc > 0.0 and math.isfinite(used_soc)):
        return belief
    noise = math.hypot(math.sqrt(2.0) * soc_sd / expected_soc, spread)
    known = belief.sd_between**2 + noise**2
    gain = belief.sd_between**2 / known if known > 0.0 else 0.0
    mean = belief.mean_ratio + gain * (used_soc / expected_soc - belief.mean_ratio)
    return replace(belief, mean_ratio=min(max(mean, 0.1), 10.0), sd_between=math.sqrt(1.0 - gain) * belief.sd_between)
