"""How much energy flights take, learnt from each flight."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import EnergyLearnt
from skyway.models.base.formatting import percent
from skyway.models.drones.energy_belief import EnergyBelief

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.legs import Leg

_FORMER_NAMES = {"factor": "mean_ratio", "sigma": "sd_between", "leg_sigma": "sd_within"}
"""In journals of version 1 and before."""
LEARN_SOC = 0.04
"""From so much charge used on, the energy of this very flight is counted in."""


@dataclass(slots=True)
class EnergyLearning:
    """The belief of one delivery, from all flights that have ended."""

    belief: EnergyBelief = field(default_factory=EnergyBelief)

    def now(self, leg: Leg | None, soc: float) -> EnergyBelief:
        """Return the belief with the flight under way counted in, where it has used enough."""
        if leg is None or not math.isfinite(leg.soc_start):
            return self.belief.next_flight()
        used = leg.soc_start - soc
        if leg.modelled is None or not used > LEARN_SOC:
            return self.belief.next_flight()
        return self.belief.in_flight(used, leg.modelled.total)

    def keep(self, leg: Leg | None, soc: float) -> None:
        """Keep what the flight under way has taught so far."""
        self.belief = self.now(leg, soc)

    def learn(self, ctx: Context, leg: Leg) -> None:
        """Learn from a whole flight."""
        used, expected = leg.soc_start - ctx.battery.soc, 0.0 if leg.modelled is None else leg.modelled.total
        if not (used > LEARN_SOC and expected > 0.0):
            return
        self.belief = self.belief.learnt(used, expected)
        learnt = EnergyLearnt(
            used_soc=used, modelled_soc=expected, factor=self.belief.mean_ratio, sigma=self.belief.sd_between
        )
        ctx.note(learnt, f"the flight used {percent(used)} of charge, the model expected {percent(expected)}")

    def restore(self, belief: Mapping[str, float]) -> None:
        """Bring back what a journal says."""
        told = {_FORMER_NAMES.get(name, name): value for name, value in belief.items()}
        self.belief = replace(self.belief, **{name: told[name] for name in asdict(self.belief) if name in told})
