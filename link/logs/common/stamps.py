"""Detection of implausible time stamps in an autopilot's log."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SPIKE_S = 2.0
"""A stamp this far from the median of five about it is damaged: neighbours in a log are that close, or in order."""
EDGE_S = 60.0
"""The same at the ends of a stretch, where a pause of the log looks like a spike."""


class SteadyTimes:
    """Decides which time stamps of a log, in the order written, are plausible; fed piece by piece."""

    def __init__(self) -> None:
        self.latest_s = math.nan
        self.odd = 0

    def of_tables(
        self, places: Sequence[NDArray[np.int64]], times_s: Sequence[NDArray[np.float64]]
    ) -> list[NDArray[np.bool_]]:
        """Return which stamps of several types of message are plausible, judged in the order of their places."""
        if not places:
            return []
        order, together = np.argsort(np.concatenate(places), kind="stable"), np.concatenate(times_s)
        good = np.empty(len(order), dtype=np.bool_)
        good[order] = self.believed(together[order])
        self.odd += int((~good).sum())
        return np.split(good, np.cumsum([len(part) for part in places])[:-1])

    def believed(self, time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of the next stamps are plausible, shape (stamps,)."""
        count = len(time_s)
        if not count:
            return np.zeros(0, dtype=np.bool_)
        near = self.latest_s if math.isfinite(self.latest_s) else float(time_s[0])
        if (np.abs(np.diff(time_s, prepend=near)) <= SPIKE_S).all():  # false for NaN
            self.latest_s = float(time_s[-1])
            return np.ones(count, dtype=np.bool_)
        if count < 5:
            near = self.latest_s if math.isfinite(self.latest_s) else float(np.median(time_s))
            good = np.abs(time_s - near) <= EDGE_S * 60.0
        else:
            around = np.lib.stride_tricks.sliding_window_view(np.pad(time_s, 2, mode="reflect"), 5)
            off = np.abs(time_s - np.partition(around, 2, axis=1)[:, 2])
            good = off <= SPIKE_S
            good[:2], good[-2:] = off[:2] <= EDGE_S, off[-2:] <= EDGE_S
        if good.any():
            self.latest_s = float(time_s[good][-1])
        return np.asarray(good, dtype=np.bool_)
