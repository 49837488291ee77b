"""Consistency of a filter: normalised innovations against their 95 % band.

Source: Y. Bar-Shalom et al. (2001), section 5.4.
"""

from __future__ import annotations

import math

HEALTH_WINDOW, HEALTH_CORRELATION = 120, 5.0
"""Number of innovations for the health check, and of neighbouring ones that count as one independent value."""
CALM_COUNT, CALM_MEAN = 20, 3.0
"""After a failure the filter is trusted again when the mean of this many innovations is below the second figure."""


class ConsistencyMonitor:
    """Monitor of the normalised innovations squared, before the gate; after it they would be too small.

    A rejected one counts as the gate (`WindFilter`). So two seconds of a manoeuvre do not outweigh two minutes of good
    measurements, and measurements that are rejected again and again still show that the filter is wrong. `window`
    measurements are evaluated together; `correlation` neighbouring ones count as one, since innovations of real
    logs are not independent.
    """

    def __init__(self, window: int = 60, correlation: float = 1.0) -> None:
        self.window = window
        self.correlation = correlation
        self._values: list[float] = []
        self._shaken = False

    def add(self, nis: float) -> None:
        """Add one value."""
        self._values.append(nis)
        if len(self._values) > self.window:
            del self._values[0]
        if self._shaken and len(self._values) >= min(CALM_COUNT, self.window) and self._calm:
            self._shaken = False

    def restart(self) -> None:
        """Judge again, as after a failure: not trusted until the innovations are small."""
        self._values.clear()
        self._shaken = True

    @property
    def _calm(self) -> bool:
        latest = self._values[-CALM_COUNT:]
        return sum(latest) / len(latest) < CALM_MEAN

    @property
    def mean(self) -> float:
        """Mean over the window; 2 for a correct filter, NaN before the first."""
        return sum(self._values) / len(self._values) if self._values else math.nan

    @property
    def band(self) -> tuple[float, float]:
        """Range of the mean in 95 of 100 windows of a correct filter."""
        return chi2_band(len(self._values) / self.correlation)

    @property
    def verdict(self) -> str:
        """``consistent``, ``overconfident`` (errors larger than predicted), ``underconfident``, or ``unknown`` as yet.

        After `restart` it is ``overconfident`` until there are enough values, and they are small enough.
        """
        if self._shaken:
            return "overconfident"
        if len(self._values) < min(10, self.window):
            return "unknown"
        low, high = self.band
        return "overconfident" if self.mean > high else "underconfident" if self.mean < low else "consistent"


def chi2_band(count: float) -> tuple[float, float]:
    """95 % band of the mean of `count` independent chi-squared values with two degrees of freedom."""
    from scipy.special import gammaincinv  # scipy.stats takes ten times as long to import

    if count <= 0.0:
        return 0.0, math.inf
    return float(gammaincinv(count, 0.025)) * 2.0 / count, float(gammaincinv(count, 0.975)) * 2.0 / count
