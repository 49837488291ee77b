"""Energy of flights, learnt from each flight, and the gauge of the battery, learnt at pads."""

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
"""Names in journals of version 1 and before."""
GAUGE_SD, FLIGHT_GAUGE_SD = 0.07, 0.02
"""Standard deviations of the ratio of used to reported charge: between batteries (one that has lost a tenth of its
capacity and assumes all of it reports a tenth too little), and between flights."""
LEARN_SOC = 0.04
"""Charge used from which the energy of the present flight is counted in."""


@dataclass(slots=True)
class EnergyLearning:
    """The belief of one delivery, from all flights that have ended.

    Flights are learnt in charge as counted by the vehicle; the ratio of battery charge to counted charge is learnt at pads: a battery with less capacity
    than its nameplate uses a greater share for the same flight, which is known once a pad has measured it.
    """

    counted: EnergyBelief = field(default_factory=EnergyBelief)
    """Belief in charge as counted by the vehicle."""
    gauge: float = 1.0
    """Ratio of battery charge to counted charge; learnt at pads, which measure."""
    _gauge_sd: float = GAUGE_SD

    @property
    def belief(self) -> EnergyBelief:
        """Return the belief in charge of the battery; a ratio below 1 is not relied upon."""
        return self.counted.times(self._takes)

    @property
    def _takes(self) -> float:
        return max(self.gauge, 1.0)

    def measured(self, used_soc: float, counted_soc: float) -> None:
        """Learn from a pad: the charge of the battery, and the counted one."""
        ratio = min(max(used_soc / counted_soc, 0.7), 1.5)
        noise = math.hypot(FLIGHT_GAUGE_SD, math.sqrt(2.0) * SOC_SD / counted_soc)
        gain = self._gauge_sd**2 / (self._gauge_sd**2 + noise**2)
        self.gauge += gain * (ratio - self.gauge)
        self._gauge_sd *= math.sqrt(1.0 - gain)

    def now(self, leg: Leg | None, soc: float) -> EnergyBelief:
        """Return the belief with the present flight counted in, if it has used enough."""
        if leg is None or not math.isfinite(leg.soc_start):
            return self.belief.next_flight()
        used = leg.soc_start - soc
        if leg.modelled is None or not used > LEARN_SOC:
            return self.belief.next_flight()
        return self.counted.in_flight(used / self._takes, leg.modelled.total).times(self._takes)

    def keep(self, leg: Leg | None, soc: float) -> None:
        """Keep what was learnt from the present flight so far."""
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
        stored = {_FORMER_NAMES.get(name, name): value for name, value in belief.items()}
        known = replace(self.belief, **{name: stored[name] for name in asdict(self.counted) if name in stored})
        self.counted = known.times(1.0 / self._takes)
