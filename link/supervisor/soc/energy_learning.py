"""How much energy flights take, learnt from each flight, and again when a pad has measured what they really took."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

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


class _Taught(NamedTuple):
    """What a flight has taught."""

    used_soc: float
    modelled_soc: float
    whole: bool
    """It was flown to its end; else it tells of its own part too, for the way that was given up."""

    def told(self, belief: EnergyBelief, share: float = 1.0) -> EnergyBelief:
        """Return a belief after it, where it took so many times what it was told to."""
        learn = belief.learnt if self.whole else belief.in_flight
        return learn(share * self.used_soc, self.modelled_soc)


@dataclass(slots=True)
class EnergyLearning:
    """The belief of one delivery, from all flights that have ended."""

    belief: EnergyBelief = field(default_factory=EnergyBelief)
    _before: EnergyBelief | None = None
    """What was believed when a pad measured the charge last; None where nothing was learnt since."""
    _since: list[_Taught] = field(default_factory=list)
    """What flights have taught since, as the vehicle told their charge."""

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
        if leg is None or leg.modelled is None or not leg.soc_start - soc > LEARN_SOC:
            self.belief = self.now(leg, soc)
        else:
            self._take(_Taught(leg.soc_start - soc, leg.modelled.total, whole=False))

    def learn(self, ctx: Context, leg: Leg) -> None:
        """Learn from a whole flight."""
        used, expected = leg.soc_start - ctx.battery.soc, 0.0 if leg.modelled is None else leg.modelled.total
        if not (used > LEARN_SOC and expected > 0.0):
            return
        self._take(_Taught(used, expected, whole=True))
        self._note(
            ctx, used, expected, f"the flight used {percent(used)} of charge, the model expected {percent(expected)}"
        )

    def settle(self, ctx: Context, share: float) -> None:
        """Learn again from the flights since the last pad: a pad has measured that they took so many times what was told.

        A battery that holds less than its nameplate tells too little; what was learnt from it would make the next flights too short of charge.
        """
        before, since = self._before, self._since
        self._before, self._since = None, []
        if before is None or share == 1.0:
            return
        for one in since:
            before = one.told(before, share)
        self.belief = before
        used, expected = share * sum(one.used_soc for one in since), sum(one.modelled_soc for one in since)
        said = f"by the pad the flights since the last one used {percent(used)} of charge, the model expected {percent(expected)}"
        self._note(ctx, used, expected, said)

    def _take(self, taught: _Taught) -> None:
        if self._before is None:
            self._before = self.belief
        self._since.append(taught)
        self.belief = taught.told(self.belief)

    def _note(self, ctx: Context, used: float, expected: float, said: str) -> None:
        learnt = EnergyLearnt(
            used_soc=used, modelled_soc=expected, factor=self.belief.mean_ratio, sigma=self.belief.sd_between
        )
        ctx.note(learnt, said)

    def restore(self, belief: Mapping[str, float]) -> None:
        """Bring back what a journal says."""
        told = {_FORMER_NAMES.get(name, name): value for name, value in belief.items()}
        self.belief = replace(self.belief, **{name: told[name] for name in asdict(self.belief) if name in told})
