"""When the wind of a flight was known: the filter's estimates count where they are consistent, and for a while after."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.estimation.filter import FilteredWind

KEPT_S = 10.0
"""For so long after a measurement the wind counts as known, if none since then was inconsistent."""
MEASURED_S = 1.0
"""What a measurement counts if none follows within `KEPT_S`."""
MAX_DOUBTS = 10_000


def kept_s(time_s: NDArray[np.float64]) -> float:
    """Return for how long a measured wind counts among rows at these times: `KEPT_S`, or three rows where these are farther apart."""
    steps_s = np.diff(time_s)
    return max(KEPT_S, 3.0 * float(np.median(steps_s))) if len(steps_s) else KEPT_S


@dataclass(frozen=True, slots=True)
class KnownWind:
    """What of a flight's wind was known, and whether it was at the end."""

    share: float
    """Of the time in the air, 0 to 1; NaN if the vehicle did not fly."""
    last: FilteredWind
    """The last consistent estimate: one row, or none."""
    at_end: bool
    """Whether that still counts at the end of the last flight."""
    doubts: tuple[tuple[float, float], ...]
    """Begin and end of each time in which the filter was inconsistent, as in the log."""

    def doubted(self, time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the filter was inconsistent at these times."""
        begins, ends = np.array(self.doubts).reshape(-1, 2).T
        place = np.searchsorted(begins, time_s, side="right") - 1
        within = np.append(ends, -math.inf)[place] > time_s
        return np.asarray((place >= 0) & within)


class KnownWindWatch:
    """Adds up the time in which the wind is known, estimate by estimate."""

    def __init__(self) -> None:
        self._known_s = 0.0
        self._last: FilteredWind | None = None
        self._heard_s = math.nan
        self._sure = False
        self._doubts: list[tuple[float, float]] = []
        self._doubted_from: float | None = None

    def add(self, measured: FilteredWind) -> None:
        """Take the next estimates to which something was measured, consistent or not."""
        for time_s, sure in zip(measured.time_s.tolist(), measured.trusted.tolist(), strict=True):
            if self._sure:
                self._known_s += self._counted(time_s - self._heard_s)
            if not sure and self._doubted_from is None:
                self._doubted_from = time_s
            elif sure and self._doubted_from is not None:
                self._close(time_s)
            self._heard_s, self._sure = time_s, sure
        if (rows := np.flatnonzero(measured.trusted)).size:
            self._last = measured.part(rows[-1:])

    def found(self, nothing: FilteredWind, airborne_s: float, end_s: float) -> KnownWind:
        """Return what was known of so many seconds in the air, which ended at a time; `nothing` is a course without rows."""
        known_s = self._known_s + (MEASURED_S if self._sure else 0.0)
        doubts = list(self._doubts)
        if self._doubted_from is not None:
            doubts.append((self._doubted_from, math.inf))
        return KnownWind(
            share=min(known_s / airborne_s, 1.0) if airborne_s > 0.0 else math.nan,
            last=nothing if self._last is None else self._last,
            at_end=self._sure and not end_s - self._heard_s > KEPT_S,
            doubts=tuple(doubts),
        )

    @staticmethod
    def _counted(step_s: float) -> float:
        return step_s if step_s <= KEPT_S else MEASURED_S

    def _close(self, time_s: float) -> None:
        if self._doubted_from is not None and len(self._doubts) < MAX_DOUBTS:
            self._doubts.append((self._doubted_from, time_s))
        self._doubted_from = None
