"""Flights that may turn back: the charges worth trying, and their results.

A charge that is enough in all but one of a thousand gusts is a third more than one that is enough in half of them, and in a strong
wind more than a battery holds. A drone that can turn back need not carry it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import NEVER, slot_end, slot_of
from skyway.planner.online.turn_back_kernels import TurnBack, later_speeds, trials
from skyway.planner.robust.information_kernels import MIN_CHANCE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.information_kernels import Known

USUAL_FLIGHT_S = 500.0
"""Gusts average out over a flight; over this one about so much."""
GUSTS = 64
"""In which a flight is tried."""
SHARES = (0.1, 0.3, 0.5, 0.75)
"""Charges that are tried, from what the flight takes without gusts (0) to what it may need (1)."""
MAX_MORE = 0.5
"""Of what the flight takes: what it may need counts as no more than this beyond it."""
SPARE = 0.01
"""So much more energy than a flight takes without gusts is what is tried at least: so well is the wind known."""
CHANCES = 2.0
"""A flight's epsilon is shared out among so many: it is judged again and again on the way out."""
ENERGY_SIGMAS = 2.0
"""A flight that is not watched is charged for so many standard deviations of its energy more."""
LIKELY = 0.5
"""Least chance to get there that is worth a try."""


@dataclass(frozen=True)
class Trial:
    """What comes of a flight that may turn back."""

    there: float
    """Share of the gusts in which it gets to its end."""
    back_s: float
    soc: float
    """Mean time in the air of those that turn back, and mean charge that they land with."""


class TurnBacks:
    """Flights from the origin of a problem that may turn back to it.

    The problem's costs are the vehicle's as far as they are known; the belief is about the energy of the flight.
    `known` says how sure it must be.
    """

    def __init__(self, problem: Problem, known: Known, belief: EnergyBelief) -> None:
        self._problem, self._known = problem, known
        self._more = belief.mean_ratio + ENERGY_SIGMAS * belief.leg_sd
        self._risk = known.epsilon / CHANCES
        energies = [belief.quantile((k + 0.5) / GUSTS) / self._more for k in range(GUSTS)]
        rng = np.random.default_rng(GUSTS)
        self._energies = rng.permutation(energies)
        share = np.cumsum(problem.probability) / problem.probability.sum()
        self._trials: dict[tuple[int, float, float], Trial | None] = {}
        self._members = rng.permutation(np.searchsorted(share, (np.arange(GUSTS) + 0.5) / GUSTS))

    def over(self, segment: int) -> TurnBack | None:
        """Options to turn back on a flight over a segment; None where no segment leads back."""
        p, known = self._problem, self._known
        network = p.network
        there = int(network.head[segment])
        if there == p.destination and p.needs_escape:
            return None  # it must be able to fly on from there
        out = np.arange(network.first[there], network.first[there + 1])
        back = out[network.head[out] == p.origin]
        if not len(back):
            return None
        more = self._more
        members = p.probability > MIN_CHANCE
        likely = known._replace(air=p.air._replace(north=p.air.north[members], east=p.air.east[members]))
        slot = min(slot_of(p.air, p.depart_s) + 1, p.air.north.shape[1] - 1)
        return TurnBack(
            int(back[0]),
            self._risk,
            NormalDist().inv_cdf(1.0 - self._risk),
            p.reserve,
            more * p.soc_per_s,
            more * p.soc_fixed,
            known.gust_sd,
            known.gust_time_s,
            *later_speeds(likely, slot, segment, USUAL_FLIGHT_S),
            *later_speeds(likely, slot, int(back[0]), USUAL_FLIGHT_S),
            p.probability[members] / p.probability[members].sum(),
        )

    def charges(self, taken: float, least: float) -> list[float]:
        """Charges worth trying for a flight that takes so much SoC without gusts, and is safe with the charge `least`."""
        usual = (1.0 + SPARE) * taken
        if not usual < NEVER:
            return []
        more = min(least - self._problem.reserve - usual, MAX_MORE * usual)
        return [self._problem.reserve + usual + share * more for share in SHARES] if more > 0.0 else []

    def in_time(self, how: TurnBack, charge: float, off_s: float) -> bool:
        """Whether a flight lands again before the wind has changed twice, whatever its outcome."""
        air = self._problem.air
        longest_s = (charge - how.reserve - how.soc_fixed) / how.soc_per_s
        return off_s + longest_s <= float(slot_end(air, slot_of(air, off_s))) + air.slot_s

    def trial(self, segment: int, how: TurnBack, charge: float, off_s: float) -> Trial | None:
        """Outcome of a flight with a charge; None where it is not worth trying."""
        key = segment, charge, off_s
        if key not in self._trials:
            found = None
            if self.in_time(how, charge, off_s):
                air = self._problem.air
                found = Trial(*trials(air, self._members, segment, off_s, charge, self._energies, _keys(), how))
            self._trials[key] = found if found is not None and found.there >= LIKELY else None
        return self._trials[key]


@lru_cache(maxsize=1)
def _keys() -> NDArray[np.uint64]:
    return np.random.default_rng(GUSTS).integers(0, 2**64, GUSTS, dtype=np.uint64)
