"""A flight in stretches of similar airspeed and climb: the measured power in each, relative to the model."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum
from statistics import fmean, median, pstdev
from typing import NamedTuple

MOST_SINK_MPS = 1.3
"""Greatest descent rate at which the drone is weighed: the power recovered beyond it is unknown."""
SLOW_MPS, SLOW_CLIMB_MPS = 2.0, 1.2
"""Greatest ground speed and vertical speed of hover or slow descent."""
_MOST_ACCELERATION_MPS2 = 1.0
_LONGEST_S, _LONGEST_SLOW_S, _PAUSE_S = 20.0, 7.0, 5.0
_LIKE_CLIMB_MPS, _LIKE_AIRSPEED_MPS = 0.7, 4.0
_LEAST_S, _KEPT_SHARE = 3, 0.75
_STEP = 0.05
"""Relative change of power that, if it persists, begins another stretch."""


class Aboard(IntEnum):
    """Knowledge about the package in a stretch."""

    PACKAGE = 0
    """It is on board, unless it was lost."""
    UNKNOWN = 1
    """It is being released."""
    RELEASED = 2
    """It was released, as reported."""


class Second(NamedTuple):
    """Means over a second of flight."""

    time_s: float
    log_ratio: float
    """Logarithm of the ratio of power to the model."""
    airspeed: float
    climb: float
    sink: float
    package: float
    """`airspeed`, `climb`, `sink`, `package`: see `power_units.Units`."""
    airspeed_mps: float
    climb_mps: float
    ground_mps: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """Consecutive seconds of similar flight."""

    flight: int
    aboard: Aboard
    begin_s: float
    end_s: float
    seconds: int
    mean: Second
    """Mean over the three quarters of the seconds that are nearest to the median: the others contain gusts, or
    changes of climb."""
    spread: float = 0.0
    """Standard deviation of the logarithm of the ratio over all of the seconds."""

    @property
    def slow(self) -> bool:
        """Whether the drone hovered or descended slowly."""
        return self.mean.ground_mps < SLOW_MPS and abs(self.mean.climb_mps) < SLOW_CLIMB_MPS


@dataclass(slots=True)
class Stretches:
    """All stretches of one drone in a delivery."""

    closed: list[Stretch] = field(default_factory=list)
    flight: int = -1
    aboard: Aboard = Aboard.PACKAGE
    _open: list[Second] = field(default_factory=list)
    _was: tuple[float, float, float] | None = None
    """Time and ground velocity one second before."""
    _newest_s: float = -math.inf

    def begin(self, aboard: Aboard, *, taken_off: bool) -> None:
        """Begin another flight, or another part of one."""
        self.close()
        self.aboard, self._was = aboard, None
        self.flight += taken_off

    def hear(self, second: Second, velocity: tuple[float, float]) -> None:
        """Take a second, and the ground velocity at its end, (north, east)."""
        was, self._was = self._was, (second.time_s, *velocity)
        self._newest_s = second.time_s
        if was is not None and second.time_s - was[0] < _PAUSE_S:
            gained = math.hypot(velocity[0] - was[1], velocity[1] - was[2])
            if gained > _MOST_ACCELERATION_MPS2 * max(second.time_s - was[0], 0.5):
                return
        if second.climb_mps < -MOST_SINK_MPS:
            return
        if self._open and not _alike(self._open, second):
            self.close()
        self._open.append(second)

    def close(self) -> None:
        """End the present stretch."""
        found, self._open = self._open, []
        for part in _steady(found):
            middle = median(one.log_ratio for one in part)
            kept = sorted(part, key=lambda one: abs(one.log_ratio - middle))[: math.floor(_KEPT_SHARE * len(part))]
            mean = Second(*map(fmean, zip(*kept, strict=True)))
            spread = pstdev(one.log_ratio for one in part)
            begin_s, end_s = part[0].time_s, part[-1].time_s
            self.closed.append(Stretch(self.flight, self.aboard, begin_s, end_s, len(part), mean, spread))

    def borrow(self, mean: Second, seconds: int) -> None:
        """Add a flight with the package that another observer recorded, as one stretch."""
        self.flight += 1
        self.closed.append(Stretch(self.flight, Aboard.PACKAGE, mean.time_s, mean.time_s, seconds, mean))

    def recent(self, seconds: float) -> list[int]:
        """Return the slow stretches of the last seconds of slow flight; none if it flew on otherwise for that long."""
        self.close()
        last = next((one for one in reversed(self.closed) if one.slow), None)
        if last is None or last.flight != self.flight or last.end_s < self._newest_s - seconds:
            return []
        return [
            k
            for k, one in enumerate(self.closed)
            if one.slow and one.flight == last.flight and one.aboard == last.aboard and one.end_s > last.end_s - seconds
        ]

    def mark(self, which: list[int], aboard: Aboard) -> None:
        """Label some stretches afterwards with the present knowledge of the package."""
        for k in which:
            self.closed[k] = replace(self.closed[k], aboard=aboard)


def _steady(found: list[Second]) -> list[list[Second]]:
    """Return the seconds as one stretch, or two if power stepped between them; none if they are too few."""
    ratios = [one.log_ratio for one in found]
    places = range(_LEAST_S, len(found) - _LEAST_S + 1)
    step, place = max(((abs(fmean(ratios[:k]) - fmean(ratios[k:])), k) for k in places), default=(0.0, 0))
    parts = [found[:place], found[place:]] if step > _STEP else [found]
    return [part for part in parts if len(part) >= _LEAST_S]


def _alike(found: list[Second], second: Second) -> bool:
    first, last = found[0], found[-1]
    slow = max(first.ground_mps, second.ground_mps) < SLOW_MPS and abs(second.climb_mps) < SLOW_CLIMB_MPS
    return (
        second.time_s - first.time_s < (_LONGEST_SLOW_S if slow else _LONGEST_S)
        and second.time_s - last.time_s < _PAUSE_S
        and abs(second.climb_mps - first.climb_mps) < _LIKE_CLIMB_MPS
        and abs(second.airspeed_mps - first.airspeed_mps) < _LIKE_AIRSPEED_MPS
        and (second.ground_mps < SLOW_MPS) == (first.ground_mps < SLOW_MPS)
    )
