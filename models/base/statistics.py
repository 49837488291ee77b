"""Sampled figures with their uncertainty, and weighted statistics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

CONFIDENCE = 0.95
"""Of every interval: with very many simulated deliveries, it contains the figure about this often."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure and its uncertainty."""

    value: float
    low: float
    high: float
    """95 % interval; both are the value if nothing was sampled."""
    error: float = 0.0
    """Standard error; the days of a forecast are treated as a sample of possible days."""
    seed_error: float = 0.0
    """The part of it that changes with the seed: queues, gusts and vehicles, for the same days of the
    forecast."""

    @property
    def half_width(self) -> float:
        """Distance from the value to the farther end of the interval."""
        return max(self.high - self.value, self.value - self.low)

    @property
    def rest(self) -> Figure:
        """The complementary probability."""
        return Figure(1.0 - self.value, 1.0 - self.high, 1.0 - self.low, self.error, self.seed_error)

    def scaled(self, factor: float) -> Figure:
        """The figure in another unit."""
        low, high = sorted((factor * self.low, factor * self.high))
        return Figure(factor * self.value, low, high, abs(factor) * self.error, abs(factor) * self.seed_error)


def certain(value: float) -> Figure:
    """Return a figure without sampling error."""
    return Figure(value, value, value)


def weighted_quantile(values: NDArray[np.float64], weights: NDArray[np.float64], q: float) -> float:
    """Smallest value at or below which at least a share q of the weight lies."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    index = int(np.searchsorted(share, q * share[-1] * (1.0 - 1e-12)))
    return float(values[order][min(index, len(order) - 1)])


def drawn_evenly(rng: np.random.Generator, groups: int, each: int) -> NDArray[np.float64]:
    """Numbers between 0 and 1, one for each of a number of draws of every group, in order (group, draw).

    Each is uniform, but together they are stratified: one in each interval of 1 / each within every group, and one in each of
    1 / (groups each) over all. Source: McKay, Beckman and Conover, "A comparison of three methods for selecting values of input
    variables", Technometrics 21 (1979).
    """
    interval = np.argsort(rng.random((groups, each)), axis=1)
    within = np.argsort(rng.random((each, groups)), axis=1)[interval, np.arange(groups)[:, None]]
    return np.asarray(((interval + (within + rng.random((groups, each))) / groups) / each).ravel())


def student(freedom: float) -> float:
    """Return the number of standard errors from a mean to each end of its interval: Student's t with so many degrees of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + CONFIDENCE / 2.0))


def wilson(share: float, runs: float, sigmas: float) -> tuple[float, float]:
    """Return Wilson's interval of a share in so many independent runs, so many standard errors to each side (Wilson 1927)."""
    square = sigmas * sigmas / runs
    middle = (share + square / 2.0) / (1.0 + square)
    half = sigmas / (1.0 + square) * math.sqrt(share * (1.0 - share) / runs + square / (4.0 * runs))
    return max(middle - half, 0.0), min(middle + half, 1.0)
