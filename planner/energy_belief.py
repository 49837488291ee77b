"""How much more energy flights take than the model says: believed with an uncertainty, and learnt in flight."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

PRIOR_FACTOR, PRIOR_SIGMA = 1.08, 0.08
"""Before the first flight. Published endurances are hovered in still air with new batteries; a cruise at 20 m/s, a climb and
an older battery take more."""
LEG_SIGMA = 0.025
"""From flight to flight the factor differs by so much: other speeds, other shares of climb and descent."""
SOC_SIGMA = 0.006
"""Of a state of charge told in whole percent."""


@dataclass(frozen=True, slots=True)
class EnergyBelief:
    """The factor between the energy that flights take and what the model says.

    Attributes
    ----------
    factor, sigma : float
        Mean and standard deviation.
    """

    factor: float = PRIOR_FACTOR
    sigma: float = PRIOR_SIGMA

    def learnt(self, used_soc: float, expected_soc: float) -> EnergyBelief:
        """Return the belief after a stretch of flight.

        Parameters
        ----------
        used_soc, expected_soc : float
            Charge that it took, and that the model says for its time; both fractions of nameplate.
        """
        if not (expected_soc > 0.0 and math.isfinite(used_soc)):
            return self
        noise = math.hypot(math.sqrt(2.0) * SOC_SIGMA / expected_soc, LEG_SIGMA)
        gain = self.sigma**2 / (self.sigma**2 + noise**2)
        return EnergyBelief(
            self.factor + gain * (used_soc / expected_soc - self.factor), math.sqrt(1.0 - gain) * self.sigma
        )

    def next_flight(self) -> EnergyBelief:
        """Return the belief about another flight than those it was learnt from."""
        return replace(self, sigma=math.hypot(self.sigma, LEG_SIGMA))

    def cautious(self, sigmas: float) -> float:
        """Factor that so many standard deviations exceed the mean."""
        return self.factor + sigmas * self.sigma
