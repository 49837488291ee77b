"""What a battery of some age and temperature really holds, and what its fuel gauge says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

if TYPE_CHECKING:
    from numpy.typing import NDArray

OLDEST = 0.8
WARM_C, COLD_LOSS_PER_C, COLD_MOST = 20.0, 0.005, 0.2
"""Below the first a lithium battery gives half a percent less for each degree."""
GAUGE_SEES = 0.5
"""Share of the loss by cold that the gauge has learned; age it knows."""
GAUGE_SD = 0.01
KNEE_SOC, KNEE_SHARE = 0.8, 1.28 / 2.24
"""80 % are charged after 1.28 h of 2.24 h (the paper's drone)."""


@dataclass(frozen=True, eq=False)
class Batteries:
    """One battery for each run.

    Attributes
    ----------
    holds_j : ndarray, shape (runs,)
        Energy between full and empty.
    gauge_j : ndarray, shape (runs,)
        What the gauge takes it to be.
    """

    holds_j: NDArray[np.float64]
    gauge_j: NDArray[np.float64]

    def told_one(self, run: int, soc: float) -> float:
        """What the gauge of a run says at a true charge: 1 less what was used, as a share of what it believes in."""
        return min(max(1.0 - (1.0 - soc) * float(self.holds_j[run] / self.gauge_j[run]), 0.0), 1.0)

    def true_one(self, run: int, told: float) -> float:
        """True charge at which the gauge of a run says so much."""
        return min(max(1.0 - (1.0 - told) * float(self.gauge_j[run] / self.holds_j[run]), 0.0), 1.0)


def new(runs: int, nameplate_j: float) -> Batteries:
    """As the data sheet says."""
    full = np.full(runs, nameplate_j)
    return Batteries(full, full)


def old(rngs: list[np.random.Generator], nameplate_j: float) -> Batteries:
    """Of any age; the gauge has learned what is left."""
    holds = nameplate_j * np.array([rng.uniform(OLDEST, 1.0) for rng in rngs])
    return Batteries(holds, holds)


def cold(rngs: list[np.random.Generator], nameplate_j: float, temp_c: NDArray[np.float64]) -> Batteries:
    """Of any age and as cold as the air, of which the gauge knows half; and it errs a little."""
    aged = old(rngs, nameplate_j)
    error = np.array([rng.normal(0.0, GAUGE_SD) for rng in rngs])
    loss = np.clip(COLD_LOSS_PER_C * (WARM_C - temp_c), 0.0, COLD_MOST)
    return Batteries(aged.holds_j * (1.0 - loss), aged.gauge_j * (1.0 - GAUGE_SEES * loss) * (1.0 + error))


class Charging:
    """Constant current to 80 %, then a current that falls exponentially; full at the data sheet's time."""

    def __init__(self, full_s: float) -> None:
        self.full_s, self.knee_s = full_s, KNEE_SHARE * full_s
        rate = KNEE_SOC / self.knee_s
        rest = full_s - self.knee_s
        missing = 1.0 - KNEE_SOC
        self._tau = brentq(lambda tau: rate * tau * -np.expm1(-rest / tau) - missing, 1e-3 * rest, 100.0 * rest)
        self._end = KNEE_SOC + rate * self._tau

    def soc(self, time_s: float) -> float:
        """Charge after so long from empty."""
        if time_s <= self.knee_s:
            return KNEE_SOC * max(time_s, 0.0) / self.knee_s
        return float(min(self._end - (self._end - KNEE_SOC) * np.exp(-(time_s - self.knee_s) / self._tau), 1.0))

    def time_s(self, soc: float) -> float:
        """Time from empty to a charge."""
        if soc <= KNEE_SOC:
            return max(soc, 0.0) / KNEE_SOC * self.knee_s
        left = (self._end - min(soc, 1.0)) / (self._end - KNEE_SOC)
        return float(self.knee_s - self._tau * np.log(left))
