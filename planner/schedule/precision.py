"""Standard errors and confidence intervals for runs that share days and queues.

Runs are crossed: those in the same member of the forecast share its wind, those with the same set of queues share the
other drones. With r(i) = w(i) (x(i) - mean) the variance of a weighted mean is V(days) + V(queues) - V(runs), each the
sum of squares of the sums of r over one day, one set, one run, times n / (n - 1) for n of them (two-way clustering;
Cameron, Gelbach and Miller 2011, "Robust inference with multiway clustering"). So the days of the forecast count as a
sample of possible days: the interval is about the mean over very many days and queues. The effect of another seed
is smaller: the days stay the same, only the queues, gusts and vehicles differ.

Queues have rare sets: in most no drone waits for room at the next station, in one of a hundred all deliveries wait for an hour. If none
of n sets shows it, its probability may still be 1 / n and more. So one more set is counted, which costs as much as the
worst of those seen or `Crossed.rare_s`; it makes deliveries later, never earlier, so that only the upper end moves. Without
it an interval held the mean of very many seeds in 25 to 93 % of the seeds, by the request; with it in 95 % on average.

The uncertainty of a quantile follows from that of the share of the runs below it (Woodruff 1952): Wilson's interval of that share, with as many
runs as independent ones would have the same variance, is mapped back through the distribution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.statistics import CONFIDENCE, Figure, student, weighted_quantile, wilson

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Crossed:
    """Runs in days and queues."""

    weight: NDArray[np.float64]
    """Shape (runs,). Weight of each, with any sum."""
    day: NDArray[np.int64]
    queue: NDArray[np.int64]
    """Shape (runs,) each. Member of the forecast and set of queues of each."""
    rare_s: float = 0.0
    """Approximate cost of a set of queues in which a station is full, for a delivery; 0: no other drones."""
    control: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    """Shape (runs, any). The variables on which the weights were calibrated, less their mean on each day: the part of a value that is linear in them is the same for all seeds."""

    def of(self, runs: NDArray[np.int64]) -> Crossed:
        """Some of the runs."""
        return Crossed(
            self.weight[runs],
            self.day[runs],
            self.queue[runs],
            self.rare_s,
            self.control[runs] if len(self.control) else self.control,
        )

    def mean(self, values: NDArray[np.float64]) -> Figure:
        """Weighted mean of positive values; its interval is symmetric in the logarithm, which suits long tails."""
        share = self.weight / self.weight.sum()
        value = float(share @ values)
        error, seed_error, tail = self._errors(share, values - value)
        rare = self._rare(share, values - value)
        above = math.hypot(error, rare)
        if value <= 0.0:
            low, high = value - tail * error, value + tail * above
        else:
            low, high = (value * math.exp(min(side / value, 50.0)) for side in (-tail * error, tail * above))
        return Figure(value, low, high, error, math.hypot(seed_error, rare))

    def difference(self, values: NDArray[np.float64], others: NDArray[np.float64]) -> Figure:
        """Mean of values less others of the same runs; a rare set of queues may delay either."""
        share = self.weight / self.weight.sum()
        value = float(share @ (values - others))
        off = values - others - value
        error, seed_error, tail = self._errors(share, off)
        rare = max(self._rare(share, off), self._rare(share, -off)) if (values != others).any() else 0.0
        half = tail * math.hypot(error, rare)
        return Figure(value, value - half, value + half, error, math.hypot(seed_error, rare))

    def quantile(self, values: NDArray[np.float64], q: float) -> Figure:
        """Smallest value at or below which at least a share q of the runs lies."""
        share = self.weight / self.weight.sum()
        value = weighted_quantile(values, share, q)
        below = values <= value
        share_error, seed_error, tail = self._errors(share, below - float(share @ below))
        low_q, high_q = self._wilson(q, share_error, tail)
        low, high = (weighted_quantile(values, share, end) for end in (low_q, high_q))
        slope = (high - low) / max(high_q - low_q, 1e-12)
        error = slope * share_error
        if 0.0 < low < value and q > 0.5:  # few days rarely include the rare ones: the tail is extrapolated (Pareto)
            steps = math.log((1.0 - q) / max(1.0 - high_q, 1e-9)) / math.log((1.0 - low_q) / (1.0 - q))
            high = max(high, value * (value / low) ** min(steps, 3.0))
        return Figure(value, min(low, value), max(high, value), error, slope * seed_error)

    def rate(self, flags: NDArray[np.bool_]) -> Figure:
        """Share of the runs with a property; if all or none of n runs have it, the interval is that of n draws."""
        share = self.weight / self.weight.sum()
        value = min(max(float(share @ flags), 0.0), 1.0)
        error, seed_error, tail = self._errors(share, flags - value)
        if error > 0.0 and 0.0 < value < 1.0:
            low, high = self._wilson(value, error, tail)
        else:
            edge = 1.0 - (1.0 - CONFIDENCE) ** (1.0 / len(flags))
            low, high = (0.0, edge) if value < 0.5 else (1.0 - edge, 1.0)
        return Figure(value, low, high, error, seed_error)

    def _errors(self, share: NDArray[np.float64], off: NDArray[Any]) -> tuple[float, float, float]:
        """Standard error, the part that changes with the seed, and the quantile of Student's t for the interval."""
        part = share * off
        by_day, days = _between(part, self.day)
        by_queue, queues = _between(part, self.queue)
        by_run = float(part @ part) * len(part) / max(len(part) - 1, 1)
        if days < 2:
            variance, by_day = by_queue, 0.0
        elif queues < 2:
            variance, by_queue = by_day, 0.0
        else:
            variance = max(by_day + by_queue - by_run, by_day, by_queue)
        seed_part = self._of_a_seed(share, part)
        by_seed = _between(seed_part, self.queue)[0] if queues > 1 else float(seed_part @ seed_part)
        groups = min(count for count in (days, queues, len(part)) if count > 1) if len(part) > 1 else 2
        freedom = float(groups - 1)
        return math.sqrt(variance), math.sqrt(by_seed), student(max(freedom, 1.0))

    def _of_a_seed(self, share: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
        """Parts of a sum that change with the seed: without the common part of all runs of a day, and the part explained by `control`."""
        within = np.bincount(self.day, weights=part)[self.day]
        mass = np.bincount(self.day, weights=share)[self.day]
        rest = part - share * within / np.maximum(mass, 1e-300)
        if not self.control.size:
            return rest
        weighted = self.control * share[:, None]
        slope = np.linalg.lstsq(weighted.T @ self.control, self.control.T @ rest, rcond=1e-9)[0]
        return np.asarray(rest - weighted @ slope)

    def _rare(self, share: NDArray[np.float64], off: NDArray[np.float64]) -> float:
        """Shift of a mean by one more set of queues of the rare kind."""
        if self.rare_s <= 0.0:
            return 0.0
        _, number = np.unique(self.queue, return_inverse=True)
        sums = np.bincount(number, weights=self._of_a_seed(share, share * off))
        return max(float(sums.max()), self.rare_s / len(sums))

    @staticmethod
    def _wilson(value: float, error: float, tail: float) -> tuple[float, float]:
        """Wilson's interval of a share whose standard error is known."""
        if error <= 0.0:
            return value, value
        return wilson(value, max(value * (1.0 - value), 1e-12) / error**2, tail)


def _between(part: NDArray[np.float64], group: NDArray[np.int64]) -> tuple[float, int]:
    """Sum of squares of the sums over groups, times n / (n - 1), and the number n of groups."""
    _, number = np.unique(group, return_inverse=True)
    sums = np.bincount(number, weights=part)
    count = len(sums)
    return float(sums @ sums) * count / max(count - 1, 1), count
