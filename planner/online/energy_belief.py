"""How much more energy flights take than the model says: believed with an uncertainty, and learnt in flight."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

PRIOR_FACTOR, PRIOR_SIGMA = 1.08, 0.08
"""Before the first flight, where the model's power is the same at any airspeed. Published endurances are hovered in still air with
new batteries; a cruise at 20 m/s, a climb and an older battery take more."""
LEG_SIGMA = 0.09
"""From flight to flight the factor differs by so much: real power depends on airspeed, so that a flight against the wind takes a
fifth more than one with it."""
LOADED_FACTOR, LOADED_SIGMA, LOADED_LEG_SIGMA = 1.04, 0.07, 0.05
"""The same where the power over airspeed is known (`models.drones.airspeed_load`): what is left is the battery's age, the climb, and what
momentum theory leaves out, some percent each."""
WITHIN_SIGMA = 0.02
"""Between the parts of one flight."""
SOC_SIGMA = 0.006
"""Of a state of charge told in whole percent, as flights are learnt from."""
TOLD_SIGMA = 0.005
"""The same as landings are judged by."""


@dataclass(frozen=True, slots=True)
class EnergyBelief:
    """The factor between the energy that flights take and what the model says.

    Attributes
    ----------
    factor, sigma : float
        Mean and standard deviation.
    leg_sigma : float
        By how much it differs from flight to flight.
    soc_sigma : float
        Standard deviation of the state of charge that is told.
    """

    factor: float = PRIOR_FACTOR
    sigma: float = PRIOR_SIGMA
    leg_sigma: float = LEG_SIGMA
    soc_sigma: float = TOLD_SIGMA

    @classmethod
    def first(cls, *, loaded: bool) -> EnergyBelief:
        """Return the belief before the first flight; `loaded` where the model counts the airspeed."""
        return cls(LOADED_FACTOR, LOADED_SIGMA, LOADED_LEG_SIGMA) if loaded else cls()

    @classmethod
    def evenly(cls, share: float, factor: float = 1.0) -> EnergyBelief:
        """Return the belief in a factor that lies evenly within a share of another, the same in all flights; the charge is known."""
        return cls(factor, factor * share / math.sqrt(3.0), 0.0, 0.0)

    @property
    def share(self) -> float:
        """By which share of the mean it may be more or less: of an even distribution of the same standard deviation."""
        return math.sqrt(3.0) * self.sigma / self.factor

    def learnt(self, used_soc: float, expected_soc: float) -> EnergyBelief:
        """Return the belief about the drone after a whole flight.

        Parameters
        ----------
        used_soc, expected_soc : float
            Charge that it took, and that the model says for it; both fractions of nameplate.
        """
        return _updated(self, used_soc, expected_soc, self.leg_sigma)

    def in_flight(self, used_soc: float, expected_soc: float) -> EnergyBelief:
        """Return the belief about the rest of a flight of which so much has been flown."""
        return _updated(self.next_flight(), used_soc, expected_soc, WITHIN_SIGMA)

    def times(self, load: float) -> EnergyBelief:
        """Return the same belief about a model that says `load` times less."""
        return EnergyBelief(load * self.factor, load * self.sigma, load * self.leg_sigma, self.soc_sigma)

    def next_flight(self) -> EnergyBelief:
        """Return the belief about another flight than those it was learnt from."""
        return replace(self, sigma=math.hypot(self.sigma, self.leg_sigma))

    def cautious(self, sigmas: float) -> float:
        """Factor that so many standard deviations exceed the mean."""
        return self.factor + sigmas * self.sigma


def _updated(belief: EnergyBelief, used_soc: float, expected_soc: float, spread: float) -> EnergyBelief:
    """Weigh a belief with one measurement (a scalar Kalman step)."""
    if not (expected_soc > 0.0 and math.isfinite(used_soc)):
        return belief
    noise = math.hypot(math.sqrt(2.0) * SOC_SIGMA / expected_soc, spread)
    gain = belief.sigma**2 / (belief.sigma**2 + noise**2)
    mean = belief.factor + gain * (used_soc / expected_soc - belief.factor)
    return replace(belief, factor=mean, sigma=math.sqrt(1.0 - gain) * belief.sigma)
