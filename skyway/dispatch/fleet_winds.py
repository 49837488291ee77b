"""Winds that the drones of a worker measure, for those that fly beside them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.wind.estimation.field import WindObservation

KEPT_S = 3600.0
"""Older measurements tell others nothing."""


class FleetWinds:
    """What each drone has measured last; for several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: dict[int, WindObservation] = {}

    def tell(self, system: int, measured: Sequence[WindObservation]) -> None:
        """Take what a drone has measured; its last one counts."""
        if measured:
            with self._lock:
                self._last[system] = max(measured, key=lambda one: one.time_s)

    def of_others(self, system: int, at_s: float) -> tuple[WindObservation, ...]:
        """What the other drones have measured by an instant, POSIX seconds, and not long before."""
        with self._lock:
            last = sorted(self._last.items())
        return tuple(one for name, one in last if name != system and at_s - KEPT_S < one.time_s <= at_s)
