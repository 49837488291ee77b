"""The belief about the times of work flown battery by battery, besides its winds, its energy and its queues."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

GROUND_S = 20.0
"""On the ground at each stop, beside waiting and charging: the landing is detected, the next mission uploaded and read back, the checklist completed,
the motors armed. It takes 6 to 7 s with a simulated drone and no questions to a person."""

QUADRATURE = 25
"""Nodes of sums over the distribution of manoeuvres."""


class TimeFactors(NamedTuple):
    """Ratios of actual to expected times, for each run."""

    flights: NDArray[np.float64]
    """Shape (flights, runs)."""
    manoeuvres: NDArray[np.float64]
    charging: NDArray[np.float64]
    """Shape (runs,) each."""
    ground: NDArray[np.float64]
    """Shape (flights, runs); of the stop behind each flight."""


@dataclass(frozen=True, slots=True)
class TimeBelief:
    """Standard deviations of times, as shares of the expected times; log-normal."""

    flights_sd: float = 0.015
    """Common to all flights: how fast this aircraft flies at a commanded speed."""
    each_flight_sd: float = 0.015
    """Of each flight by itself: gusts, and winds that are unlike the hour's."""
    manoeuvres_sd: float = 0.3
    """Of turns, take-offs and landings (`missions.checks.manoeuvres`), of all flights together."""
    charging_sd: float = 0.04
    """Of all charging: the age of the battery, its warmth, the charger."""
    ground_sd: float = 0.6
    """Of each time on the ground."""

    def manoeuvre_factors(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return factors of manoeuvres and their weights: weighted sums over them are means over the distribution (Gauss and Hermite)."""
        deviates, weights = np.polynomial.hermite_e.hermegauss(QUADRATURE)
        sigma = np.sqrt(np.log1p(self.manoeuvres_sd**2))
        return np.exp(sigma * deviates - 0.5 * sigma * sigma), weights / weights.sum()

    def sampled(self, rng: np.random.Generator, runs: int, flights: int) -> TimeFactors:
        """Draw ratios of actual to expected times."""

        def drawn(sd: float, *shape: int) -> NDArray[np.float64]:
            sigma = np.sqrt(np.log1p(sd * sd))
            return np.asarray(np.exp(sigma * rng.standard_normal(shape) - 0.5 * sigma * sigma))

        together = drawn(self.flights_sd, runs)
        return TimeFactors(
            together * drawn(self.each_flight_sd, flights, runs),
            drawn(self.manoeuvres_sd, runs),
            drawn(self.charging_sd, runs),
            drawn(self.ground_sd, flights, runs),
        )


EXACT = TimeBelief(0.0, 0.0, 0.0, 0.0, 0.0)
"""Every time equals its expectation."""
