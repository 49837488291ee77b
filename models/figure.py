"""A figure that was sampled, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

CONFIDENCE = 0.95
"""Of every interval: it holds the figure of very many simulated deliveries about that often."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure and how sure it is.

    Attributes
    ----------
    value : float
        Estimate.
    low, high : float
        95 % interval; both are the value where nothing was sampled.
    error : float
        Standard error, the days of a forecast being a sample of those that may come.
    seed_error : float
        The part of it that another seed would show: queues, gusts and vehicles, with the days of the forecast as they are.
    """

    value: float
    low: float
    high: float
    error: float = 0.0
    seed_error: float = 0.0

    @property
    def half_width(self) -> float:
        """How far the farther end of the interval is from the value."""
        return max(self.high - self.value, self.value - self.low)

    def scaled(self, factor: float) -> Figure:
        """The same in another unit."""
        parts = (self.value, self.low, self.high, self.error, self.seed_error)
        return Figure(*(factor * part for part in parts))


def certain(value: float) -> Figure:
    """Return a figure that nothing sampled goes into."""
    return Figure(value, value, value)
