"""A sudden fall of the power in flight, as when a package is lost on the way."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from statistics import fmean, pstdev

STEP_S = 8
"""Seconds before and after a moment that are compared to detect a lost package."""
SHORT_S, BESIDE_S, _CLEAN_SHARE = 4, 3, 0.1
"""A fall between stretches that are as steady as this share of it is accepted in a drifting wind: then the first number of seconds before it is enough, and the drone
must fly alike only within the second number on either side."""
_STEP_SHARE, _STEADY_SHARE, _STEP_WAIT_S = 0.6, 0.3, 4.0
_PER_RAD, _PER_MPS = 2.5, 0.03
"""Greatest share of the power that a reduction of lean by a radian, or a change of airspeed by 1 m/s, may explain: the fall must be deeper by it.
A drone that has lost its package leans as before or more; one that brakes, or meets a gust from behind, leans less, and has less drag."""
_LEAST_FALL, _MOST_SHARE, _STEEP_RAD = 0.1, 1.5, 0.35
"""A package with a smaller share of the power is not distinguished from gusts; a fall of more than this multiple has another cause; and at a greater lean
most of the power is drag."""
_SAME_AIRSPEED_MPS, _SAME_CLIMB_MPS = 4.0, 0.5
"""Greatest differences of airspeed and climb that are compared: the model is too inaccurate beyond."""
_AIRSPEED, _LEAN, _CLIMB_RATE = 2, 3, 4

Point = tuple[float, float, float, float, float]
"""Time, power in units of the model, airspeed, lean and climb; one a second."""
Points = list[Point]


@dataclass(slots=True)
class PowerFall:
    """The last seconds of a flight, and whether power fell in the middle of them."""

    at_s: float | None = None
    """Time of a sudden and lasting fall, POSIX seconds; None if there was none."""
    _steady: deque[Point] = field(default_factory=lambda: deque(maxlen=2 * STEP_S))

    def clear(self) -> None:
        """Reset: the drone has just taken off."""
        self.at_s = None
        self._steady.clear()

    def hear(self, point: Point, wanted: float) -> None:
        """Take a second of flight; `wanted` is the share of the power due to the package's weight."""
        self._steady.append(point)
        self.at_s = self._look(wanted)

    def _look(self, wanted: float) -> float | None:
        points = list(self._steady)
        if len(points) < 2 * STEP_S or not wanted > 0.0:
            return None
        before, after = points[: STEP_S - 1], points[STEP_S + 1 :]
        clean = before[-SHORT_S:], after
        beside = before[-BESIDE_S:], after[:BESIDE_S]
        if _fell(before, after, wanted, _STEADY_SHARE, (before, after)) or _fell(*clean, wanted, _CLEAN_SHARE, beside):
            return points[STEP_S][0]
        return None


def _fell(before: Points, after: Points, wanted: float, steady_share: float, alike: tuple[Points, Points]) -> bool:
    """Whether power fell between two stretches, each as steady as a share of the fall; with `alike` the drone flew alike before and after."""
    if after[-1][0] - before[0][0] > len(before) + len(after) + 2 + _STEP_WAIT_S:
        return False  # no stretch of steady flight
    for column, most in ((_AIRSPEED, _SAME_AIRSPEED_MPS), (_CLIMB_RATE, _SAME_CLIMB_MPS)):
        found = [point[column] for some in alike for point in some]
        if max(found) - min(found) > most:
            return False
    speeds, leans = ([fmean(point[column] for point in some) for some in alike] for column in (_AIRSPEED, _LEAN))
    explained = max(_PER_RAD * (leans[0] - leans[1]), _PER_MPS * abs(speeds[1] - speeds[0]))
    old, new = (fmean(one for _, one, *_ in some) for some in (before, after))
    fell = 1.0 - new / old
    detectable = wanted >= _LEAST_FALL and max(leans) < _STEEP_RAD and fell < _MOST_SHARE * wanted
    if not (detectable and fell - explained > _STEP_SHARE * wanted):
        return False
    spread = max(pstdev(one for _, one, *_ in some) for some in (before, after))
    return spread < steady_share * fell * old
