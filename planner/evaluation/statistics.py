"""Figures with confidence intervals by block bootstrap over days: runs that share a day are not independent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.parameters.evaluation import EvaluationParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

CONFIDENCE = 0.95
USUAL = EvaluationParameters()
_CELLS = 5_000_000  # weights held at a time


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its 95 % interval."""

    value: float
    """NaN where there is nothing to compute it from."""
    low: float = math.nan
    high: float = math.nan
    """NaN where one day alone cannot tell."""

    def scaled(self, factor: float) -> Estimate:
        """The figure in another unit."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)

    def text(self, form: str = ".1f") -> str:
        """``12.3 [11.9, 12.8]``; a dash for what is unknown."""
        if math.isnan(self.value):
            return "-"
        if math.isnan(self.low):
            return f"{self.value:{form}}"
        return f"{self.value:{form}} [{self.low:{form}}, {self.high:{form}}]"

    def document(self) -> dict[str, float | None]:
        """For a JSON file; None is unknown."""
        parts = {"value": self.value, "low": self.low, "high": self.high}
        return {name: value if math.isfinite(value) else None for name, value in parts.items()}


class DayBootstrap:
    """Resamples whole days; `block` is the day of each run, shape (runs,).

    Percentile intervals, expanded for few days: with n days the percentiles are those of t(n - 1) sqrt(n / (n - 1))
    instead of the normal ones (Hesterberg 2015, "What teachers should know about the bootstrap"). A rate of 0 in all
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
        """Smallest value at or below which a share q of the runs lies; NaN runs are omitted."""
        known = np.flatnonzero(np.isfinite(values))
        if not len(known):
            return Estimate(math.nan)
        order = known[np.argsort(values[known], kind="stable")]
        ascending, day = values[order], self.block[order]
        found = np.empty(len(self.weight))
        chunk = max(1, _CELLS // len(order))
        for low in range(0, len(found), chunk):
            share = np.cumsum(self.weight[low : low + chunk][:, day], axis=1)
            at = np.argmax(share >= q * share[:, -1:] - 1e-9, axis=1)
            found[low : low + chunk] = np.where(share[:, -1] > 0, ascending[at], np.nan)
        value = ascending[min(max(math.ceil(q * len(order) - 1e-9) - 1, 0), len(order) - 1)]
        return self._interval(float(value), found)

    def mean_error(self, kept: NDArray[np.bool_], promised: NDArray[np.float64]) -> Estimate:
        """Mean over levels of the absolute difference between frequency and mean promise, both of shape (runs, levels)."""
        if not len(kept):
            return Estimate(math.nan)
        off = kept - promised
        sums = np.column_stack([self._by_day(column) for column in off.T])
        number = self._by_day(np.ones(len(kept)))
        value = float(np.abs(sums.sum(axis=0) / number.sum()).mean())
        found = np.abs((self.weight @ sums) / (self.weight @ number)[:, None]).mean(axis=1)
        return self._interval(value, found)

    @property
    def _alpha(self) -> float:
        return 1.0 - CONFIDENCE

    def _by_day(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(self.block, weights=values, minlength=len(self.days)).astype(np.float64)

    def _interval(self, value: float, found: NDArray[np.float64]) -> Estimate:
        found = found[np.isfinite(found)]
        if len(self.days) < 2 or not len(found):
            return Estimate(value)
        low, high = np.quantile(found, [self._tail, 1.0 - self._tail])
        return Estimate(value, float(low), float(high))


def _tail(days: int) -> float:
    """Share of resamples beyond each end of an interval."""
    if days < 2:
        return math.nan
    from scipy.special import ndtr, stdtrit

    half = (1.0 - CONFIDENCE) / 2.0
    return float(ndtr(stdtrit(days - 1, half) * math.sqrt(days / (days - 1))))
