"""Energy of flights, learnt from each flight, and charge of the battery for it, learnt at pads."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import EnergyLearnt
from skyway.models.base.formatting import percent
from skyway.models.drones.energy_belief import SOC_SD, EnergyBelief

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.legs import Leg

_FORMER_NAMES = {"factor": "mean_ratio", "sigma": "sd_between", "leg_sigma": "sd_within"}
"""In journals of version 1 and before."""
GAUGE_SD, FLIGHT_GAUGE_SD = 0.07, 0.02
"""Standard deviations of the charge that batteries really use about what they say: from battery to battery (one that has lost a tenth of its
capacity and counts on all of it says a tenth too little), and from flight to flight."""
LEARN_SOC = 0.04
"""From so much charge used on, the energy of this very flight is counted in."""


@dataclass(slots=True)
class EnergyLearning:
    """The belief of one delivery, from all flights that have ended.

    Flights are learnt from as the vehicle counts their charge, and what a battery takes for what is counted is learnt at pads: one that holds less
    than its nameplate takes more for the same flight, and that is known as soon as a pad has measured it.
    """

    counted: EnergyBelief = field(default_factory=EnergyBelief)
    """Of charge as the vehicle counts it."""
    gauge: float = 1.0
    """Charge that the battery takes for what is counted; learnt at pads, which measure."""
    _gauge_sd: float = GAUGE_SD

    @property
    def belief(self) -> EnergyBelief:
        """Of charge of the battery; one that seems to take less than is counted is not trusted to."""
        return self.counted.times(self._takes)

    @property
    def _takes(self) -> float:
        return max(self.gauge, 1.0)

    def measured(self, used_soc: float, counted_soc: float) -> None:
        """Learn from a pad: the battery took so much where so much was counted."""
        ratio = min(max(used_soc / counted_soc, 0.7), 1.5)
        noise = math.hypot(FLIGHT_GAUGE_SD, math.sqrt(2.0) * SOC_SD / counted_soc)
        gain = self._gauge_sd**2 / (self._gauge_sd**2 + noise**2)
        self.gauge += gain * (ratio - self.gauge)
        self._gauge_sd *= math.sqrt(1.0 - gain)

    def now(self, leg: Leg | None, soc: float) -> EnergyBelief:
        """Return the belief with the flight under way counted in, where it has used enough."""
        if leg is None or not math.isfinite(leg.soc_start):
            return self.belief.next_flight()
        used = leg.soc_start - soc
        if leg.modelled is None or not used > LEARN_SOC:
            return self.belief.next_flight()
        return self.counted.in_flight(used / self._takes, leg.modelled.total).times(self._takes)

    def keep(self, leg: Leg | None, soc: float) -> None:
        """Keep what the flight under way has taught so far."""
        self.counted = self.now(leg, soc).times(1.0 / self._takes)

    def learn(self, ctx: Context, leg: Leg) -> None:
        """Learn from a whole flight."""
        used, expected = leg.soc_start - ctx.battery.soc, 0.0 if leg.modelled is None else leg.modelled.total
        if not (used > LEARN_SOC and expected > 0.0):
            return
        self.counted = self.counted.learnt(used / self._takes, expected)
        learnt = EnergyLearnt(
            used_soc=used, modelled_soc=expected, factor=self.belief.mean_ratio, sigma=self.belief.sd_between
        )
        ctx.note(learnt, f"the flight used {percent(used)} of charge, the model expected {percent(expected)}")

    def restore(self, belief: Mapping[str, float], gauge: float) -> None:
        """Restore the learned energy from a journal."""
        self.gauge = gauge
        told = {_FORMER_NAMES.get(name, name): value for name, value in belief.items()}
        known = replace(self.belief, **{name: told[name] for name in asdict(self.counted) if name in told})
        self.counted = known.times(1.0 / self._takes)
