"""Figures with confidence intervals over days: runs that share a day are not independent.

Means, ratios and rates: a block bootstrap, and with few days an interval of Student's t as well. Quantiles: Wilson's interval of the share of runs
below, mapped back through the distribution, as in `planner.schedule.precision`; an end that the days do not tell is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import CONFIDENCE, student, wilson
from skyway.planner.parameters.evaluation import EvaluationParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

USUAL = EvaluationParameters()
FEW_DAYS = 8
"""Resamples of fewer days than this hardly differ from each other: intervals are at least those of Student's t."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its 95 % interval."""

    value: float
    """NaN where there is nothing to compute it from."""
    low: float = math.nan
    high: float = math.nan
    """NaN where the days cannot tell."""

    def scaled(self, factor: float) -> Estimate:
        """The figure in another unit."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)

    def text(self, form: str = ".1f") -> str:
        """``12.3 [11.9, 12.8]``; a dash for what is unknown."""
        value, low, high = ("-" if math.isnan(one) else f"{one:{form}}" for one in (self.value, self.low, self.high))
        return value if low == high == "-" else f"{value} [{low}, {high}]"

    def document(self) -> dict[str, float | None]:
        """For a JSON file; None is unknown."""
        parts = {"value": self.value, "low": self.low, "high": self.high}
        return {name: value if math.isfinite(value) else None for name, value in parts.items()}


class DayBootstrap:
    """Resamples whole days; `block` is the day of each run, shape (runs,).

    Percentile intervals, expanded for few days: with n days the percentiles are those of t(n - 1) sqrt(n / (n - 1))
    instead of the normal ones (Hesterberg 2015, "What teachers should know about the bootstrap"). No resample is beyond the least and the
    greatest of the days: of two days, an interval between them would hold the mean in half of the cases. So with fewer than `FEW_DAYS`
    it is also at least t(n - 1) standard errors to each side. A rate of 0 in all
    days has the upper end 1 - 0.025 ** (1 / n): with a probability above it per day, n days without one event would be
    rarer than 2.5 %; a rate of 1 likewise.
    """

    def __init__(self, block: NDArray[np.int64], *, replicates: int = USUAL.replicates, seed: int = 0) -> None:
        self.days, self.block = np.unique(block, return_inverse=True)
        rng = np.random.default_rng(seed)
        count = len(self.days)
        self.weight: NDArray[np.int64] = rng.multinomial(count, np.full(count, 1.0 / max(count, 1)), replicates)
        self._tail = _tail(count)

    def mean(self, values: NDArray[np.float64]) -> Estimate:
        """Mean over the runs where the value is not NaN."""
        return self.ratio(values, np.ones(len(values)))

    def ratio(self, values: NDArray[np.float64], others: NDArray[np.float64]) -> Estimate:
        """Sum of values over sum of others, over the runs where neither is NaN."""
        known = np.isfinite(values) & np.isfinite(others)
        if not known.any():
            return Estimate(math.nan)
        top, bottom = (self._by_day(np.where(known, part, 0.0)) for part in (values, others))
        with np.errstate(invalid="ignore", divide="ignore"):
            found = (self.weight @ top) / (self.weight @ bottom)
        return self._interval(float(top.sum() / bottom.sum()), found)

    def rate(self, flags: NDArray[np.bool_]) -> Estimate:
        """Share of the runs where it is so; see the class about 0 and 1."""
        found = self.mean(flags.astype(np.float64))
        days = len(self.days)
        if days > 1 and found.value in {0.0, 1.0}:
            edge = 1.0 - (self._alpha / 2.0) ** (1.0 / days)
            return Estimate(0.0, 0.0, edge) if found.value == 0.0 else Estimate(1.0, 1.0 - edge, 1.0)
        return Estimate(found.value, max(found.low, 0.0), min(found.high, 1.0))

    def quantile(self, values: NDArray[np.float64], q: float) -> Estimate:
        """Smallest value at or below which a share q of the runs lies; NaN runs are omitted.

        The days tell as much about the share below it as some number of independent runs. An end of the interval is NaN
        if the quantile may lie beyond all of so many runs.
        """
        known = np.flatnonzero(np.isfinite(values))
        if not len(known):
            return Estimate(math.nan)
        ascending = np.sort(values[known])
        value = _at_share(ascending, q)
        if len(self.days) < 2:
            return Estimate(value)
        runs = self._independent_runs(values[known] <= value, self.block[known], q)
        low_share, high_share = wilson(q, runs, student(len(self.days) - 1))
        rare = (1.0 - CONFIDENCE) / 2.0
        low = _at_share(ascending, low_share) if (1.0 - q) ** runs <= rare else math.nan
        high = _at_share(ascending, high_share) if q**runs <= rare else math.nan
        return Estimate(value, low, high)

    def _independent_runs(self, below: NDArray[np.bool_], block: NDArray[np.int64], q: float) -> float:
        """Number of independent runs that would tell a share q as well as these do; no more than there are."""
        sums = np.bincount(block, weights=below - below.mean(), minlength=len(self.days))
        days, runs = len(self.days), len(below)
        variance = days / (days - 1) * float(sums @ sums) / runs**2
        return min(q * (1.0 - q) / variance, runs) if variance > 0.0 else runs

    def mean_error(self, kept: NDArray[np.bool_], promised: NDArray[np.float64]) -> Estimate:
        """Mean over levels of the absolute difference between frequency and mean promise, both of shape (runs, levels)."""
        if not len(kept):
            return Estimate(math.nan)
        off = kept - promised
        sums = np.column_stack([self._by_day(column) for column in off.T])
        number = self._by_day(np.ones(len(kept)))
        value = float(np.abs(sums.sum(axis=0) / number.sum()).mean())
        found = np.abs((self.weight @ sums) / (self.weight @ number)[:, None]).mean(axis=1)
        between = self._interval(value, found)
        return Estimate(value, between.low, min(between.high, 1.0) if math.isfinite(between.high) else math.nan)

    @property
    def _alpha(self) -> float:
        return 1.0 - CONFIDENCE

    def _by_day(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(self.block, weights=values, minlength=len(self.days)).astype(np.float64)

    def _interval(self, value: float, found: NDArray[np.float64]) -> Estimate:
        found, days = found[np.isfinite(found)], len(self.days)
        if days < 2 or not len(found):
            return Estimate(value)
        low, high = np.quantile(found, [self._tail, 1.0 - self._tail]).tolist()
        if days < FEW_DAYS:
            half = student(days - 1) * float(found.std()) * math.sqrt(days / (days - 1))
            least = 0.0 if found.min() >= 0.0 else -math.inf  # no mean of such values is below 0
            low, high = min(low, max(value - half, least)), max(high, value + half)
        return Estimate(value, low, high)


def _at_share(ascending: NDArray[np.float64], share: float) -> float:
    """Smallest of some values at or below which a share of them lies."""
    return float(ascending[min(max(math.ceil(share * len(ascending) - 1e-9) - 1, 0), len(ascending) - 1)])


def _tail(days: int) -> float:
    """Share of resamples beyond each end of an interval."""
    if days < 2:
        return math.nan
    from scipy.special import ndtr

    return float(ndtr(-student(days - 1) * math.sqrt(days / (days - 1))))
