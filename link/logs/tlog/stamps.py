"""Time stamps of a tlog: the recorder's clock, which may be set or damaged."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


class StampCheck:
    """Makes stamps into times that never decrease.

    A stamp is accepted within 30 days of the last accepted one (the first: of the median of its chunk), within a minute of
    the median of five, and if it does not break an order that continues without it; otherwise it is replaced by the one
    before. A first stamp long before all others is also rejected. Steps back of up to `JITTER_S` are held; if the
    clock was set back by more, the following stamps are shifted, and `shift_s` is the shift in force at the start of the reading.
    """

    REACH_S = 30 * 86_400.0
    JITTER_S = 1.0
    SPIKE_S = 60.0
    FIRST_GAP_S = 5.0

    def __init__(self, shift_s: float = 0.0) -> None:
        self.shift_s = shift_s
        self.last_s = math.nan
        self.highest_s = -math.inf
        self.disbelieved = 0
        self.held = 0
        self.set_back: list[float] = []
        self._before_last_s = math.nan

    def clean(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the times of stamps, shape (messages,)."""
        if not len(time_s):
            return time_s
        self._doubt_last(float(time_s[0]))
        good = self._believed(time_s)
        self.disbelieved += int((~good).sum())
        first = float(time_s[np.argmax(good)]) if good.any() else float(np.median(time_s))
        before = first if math.isnan(self.last_s) else self.last_s
        place = np.maximum.accumulate(np.where(good, np.arange(len(time_s)), -1))
        filled = np.where(place >= 0, time_s[place], before)
        step = np.diff(filled, prepend=before)
        jumps = np.where(step < -self.JITTER_S, -step, 0.0)
        self.set_back += jumps[jumps > 0.0].tolist()
        self.held += int(((step < 0.0) & (jumps == 0.0)).sum())
        times = filled + self.shift_s + np.cumsum(jumps)
        times = np.maximum.accumulate(np.maximum(times, self.highest_s))
        self.shift_s += float(jumps.sum())
        self.highest_s = float(times[-1])
        self._before_last_s = float(filled[-2]) if len(filled) > 1 else self.last_s
        self.last_s = float(filled[-1])
        return np.asarray(times)

    def _doubt_last(self, next_s: float) -> None:
        """Reject the last stamp of the previous chunk if it broke an order that continues without it."""
        before, last, slack = self._before_last_s, self.last_s, self.JITTER_S
        if before > next_s + slack or not (last > next_s + slack or last < before - slack):  # false for NaN
            return
        if last < before - slack:  # it was taken for a clock that was set back
            self.shift_s -= self.set_back.pop()
        self.last_s = before
        self.disbelieved += 1

    def _believed(self, time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which stamps are plausible."""
        begins = math.isnan(self.last_s)
        step = np.diff(time_s, prepend=time_s[0] if begins else self.last_s)
        if (
            len(step) * self.FIRST_GAP_S < self.REACH_S
            and ((step > 0.01 - self.JITTER_S) & (step < self.FIRST_GAP_S)).all()
        ):
            return np.ones(len(time_s), dtype=np.bool_)  # as below, but faster
        good = np.abs(time_s - (float(np.median(time_s)) if begins else self.last_s)) <= self.REACH_S
        if len(time_s) < 3:
            return np.asarray(good)
        before = np.concatenate([[-math.inf if begins else self.last_s], time_s[:-1]])
        after = np.concatenate([time_s[1:], [math.nan]])
        in_order = after >= before - self.JITTER_S
        good &= ~(in_order & ((time_s > after + self.JITTER_S) | (time_s < before - self.JITTER_S)))
        if len(time_s) >= 5:
            around = np.lib.stride_tricks.sliding_window_view(np.pad(time_s, 2, mode="reflect"), 5)
            good &= np.abs(time_s - np.median(around, axis=1)) <= self.SPIKE_S
            if begins and good[:3].all() and time_s[1] - time_s[0] > self.FIRST_GAP_S:
                usual = float(np.median(np.diff(time_s[1:21])))
                good[0] = time_s[1] - time_s[0] <= max(self.FIRST_GAP_S, 20.0 * usual)
        return np.asarray(good)
