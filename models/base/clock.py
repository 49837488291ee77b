"""Clocks that are passed as arguments: the same code runs in real and in virtual time."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock with a wait function.

    A simulated clock advances the simulation during the wait, so no real time passes.
    """

    def now_s(self) -> float:
        """Seconds since some start; never goes back."""
        ...

    def posix_s(self) -> float:
        """Present time, POSIX seconds."""
        ...

    def sleep_until(self, instant_s: float) -> None:
        """Wait until `now_s` reaches an instant."""
        ...


class WallClock:
    """The real time."""

    def now_s(self) -> float:
        """Seconds since some start; never goes back."""
        return time.monotonic()

    def posix_s(self) -> float:
        """Present time, POSIX seconds."""
        return time.time()

    def sleep_until(self, instant_s: float) -> None:
        """Wait until `now_s` reaches an instant."""
        while (left := instant_s - time.monotonic()) > 0.0:
            time.sleep(left)
