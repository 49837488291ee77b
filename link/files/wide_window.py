"""The number of parallel reads on a fast or long link: it grows as long as the data rate grows.

Late answers mean little there: with many reads outstanding, the jitter of the link alone delays some. So the criterion is the rate of data. A number of
reads is tried for a few round trips; it grows while a greater one is faster, then it stays at the best, and is checked again at intervals.
"""

from __future__ import annotations

from skyway.link.files.ftp_words import DATA_BYTES

MOST = 512
"""Greatest number of outstanding reads."""
GROWS, GAINS = 1.4, 1.07
"""Growth of the number, and required growth of the rate."""
ROUNDS, LEAST_S = 4.0, 0.15
"""A window size is judged over this many round trips, and this long."""
TRIES = 2
"""A greater number that was not faster this often is too great."""
WORSE, HOLD = 0.8, 40
"""If the rate is below this share of the best this often, the link has changed; after this many checks a larger window is tried again."""
CROWDED = 0.2
"""Share of lost reads at the best number that means: they come bundled, and the vehicle queues too few."""
LOSSY, LATER = 0.02, 1.25
"""A larger share of lost reads, or round trips above this multiple of the shortest, show that the vehicle or link is full."""


class WideWindow:
    """Finds the number of reads with the highest rate."""

    def __init__(self, window: float, now_s: float, came_bytes: int) -> None:
        self.window = self.best_window = window
        """`window`, `best_window`: reads to have outstanding; and the number with the highest rate so far."""
        self.best_byteps = 0.0
        """The highest rate, bytes a second."""
        self.settled = self.full = self.crowded = False
        """`settled`, `full`, `crowded`: a greater number was not faster; there was no room for more; and even this number has losses."""
        self.lost = 0
        """Reads lost since the last check."""
        self._begun_s, self._begun_bytes, self._fresh = now_s, came_bytes, True
        self._trying, self._failed, self._held = True, 0, 0

    def learn(self, now_s: float, came_bytes: int, round_s: float, least_s: float) -> float:
        """Process the data received so far, and the usual and minimum answer times; returns the number of reads to have outstanding."""
        took_s = now_s - self._begun_s
        if took_s < max((1.0 if self._fresh else ROUNDS) * round_s, LEAST_S):
            return self.window
        came, lost = came_bytes - self._begun_bytes, self.lost
        self._begun_s, self._begun_bytes, self.lost = now_s, came_bytes, 0
        if self._fresh:  # the data until now were requested with the previous number
            self._fresh = False
        elif self._trying:
            self._judge(came / took_s, full=lost > LOSSY * came / DATA_BYTES or round_s > LATER * least_s)
        else:
            self._hold(came / took_s, crowded=lost > CROWDED * came / DATA_BYTES)
        return self.window

    def _judge(self, byteps: float, *, full: bool) -> None:
        """Evaluate a number that was tried."""
        if byteps > GAINS * self.best_byteps:
            self.best_byteps, self.best_window, self._failed = byteps, self.window, 0
            if self.window < MOST:
                self._put(min(GROWS * self.window, MOST))
                return
        self._failed += 1
        if self._failed >= TRIES or self.window >= MOST:
            self.settled, self.full = True, full
            self._trying, self._failed, self._held = False, 0, 0
            self._put(self.best_window)

    def _hold(self, byteps: float, *, crowded: bool) -> None:
        """Keep the best number."""
        self.crowded = crowded
        self._held += 1
        self._failed = self._failed + 1 if byteps < WORSE * self.best_byteps else 0
        if self._failed >= TRIES or self._held >= HOLD:
            self.best_byteps, self._trying, self._failed = byteps, True, 0
            self._put(min(GROWS * self.window, MOST))

    def _put(self, window: float) -> None:
        self.window, self._fresh = window, True
