"""A vehicle's trust in its own navigation, from any kind of message.

Limits of the receiver are those that both autopilots require before they fly on it (ArduPilot's EKF checks, PX4's
``EKF2_REQ_*``); a test ratio of 1 is where either filter rejects a measurement.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MIN_FIX, MIN_SATELLITES, MAX_HDOP, MAX_SPEED_ERROR_MPS = 3, 6, 3.0, 1.5
"""A three-dimensional fix; satellites in use; dilution of precision; reported accuracy of the velocity."""
REJECTED = 1.0
"""Ratio of an innovation to the gate of the autopilot's filter."""
VELOCITY_GOOD, CONSTANT_POSITION = 1 << 1, 1 << 7
"""Bits of EKF_STATUS_REPORT, ESTIMATOR_STATUS and of PX4's and ArduPilot's logs alike."""


def _column(values: Any) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)


def receiver_ok(
    fix: Any, satellites: Any = math.nan, hdop: Any = math.nan, speed_error_mps: Any = math.nan
) -> NDArray[np.float64]:
    """Whether a receiver is trusted, 1 or 0; NaN figures are ignored.

    A fix from 3 on has three dimensions. The others are satellites in use, horizontal dilution of precision, and the
    accuracy of the velocity reported by the receiver.
    """
    bad = _column(fix) < MIN_FIX
    bad = bad | (_column(satellites) < MIN_SATELLITES) | (_column(hdop) > MAX_HDOP)
    bad = bad | (_column(speed_error_mps) > MAX_SPEED_ERROR_MPS)
    return np.where(bad, 0.0, 1.0)


def estimate_ok(
    velocity_ratio: Any = 0.0, position_ratio: Any = 0.0, flags: Any = VELOCITY_GOOD, glitch_bit: int = 0
) -> NDArray[np.float64]:
    """Whether the autopilot's filter trusts its horizontal velocity, 1 or 0.

    The ratios are innovations over their gates; from 1 on the filter rejects the receiver. The flags are its solution
    status: without horizontal velocity, or with a position held constant, it is not trusted. `glitch_bit` is
    the flag of a receiver's glitch.
    """
    status = np.asarray(flags).astype(np.int64)
    bad = (_column(velocity_ratio) >= REJECTED) | (_column(position_ratio) >= REJECTED)
    bad = bad | ((status & VELOCITY_GOOD) == 0) | ((status & (CONSTANT_POSITION | glitch_bit)) != 0)
    return np.where(bad, 0.0, 1.0)


SETTLE_S = 5.0
"""Recovery time of a filter after its receiver returns."""
BEFORE_S = 3.0
"""Delay until a vehicle reports it."""
MAX_SPANS = 1000
_BEGIN = (
    "gps glitch",
    "ekf variance",
    "ekf failsafe",
    "gps failure",
    "gps lost",
    "dead reckoning started",
    "gnss data fusion stopped",
    "gps data fusion stopped",
    "gps quality poor",
    "global position lost",
    "local position lost",
    "no gps",
    "gps: no fix",
)
_END = (
    "glitch cleared",
    "ekf failsafe cleared",
    "ekf variance cleared",
    "gps data fusion started",
    "gnss data fusion started",
    "dead reckoning ended",
    "dead reckoning stopped",
    "position regained",
)


def doubt_in(text: str) -> bool | None:
    """Whether a text starts (True) or ends (False) a span of untrusted position; None: neither."""
    said = text.lower()
    if any(phrase in said for phrase in _END):
        return False
    return True if any(phrase in said for phrase in _BEGIN) else None


class DoubtedSpans:
    """Collects spans from the texts that start and end them. A span without an end lasts to the end of the log."""

    def __init__(self) -> None:
        self._spans: list[tuple[float, float]] = []
        self._open: dict[str, float] = {}

    def hear(self, time_s: float, why: str, *, doubts: bool | None) -> None:
        """Take a line; doubts for different reasons end independently."""
        if doubts is None or math.isnan(time_s):
            return
        if doubts:
            self._open.setdefault(why, time_s - BEFORE_S)
        elif why in self._open and len(self._spans) < MAX_SPANS:
            self._spans.append((self._open.pop(why), time_s + SETTLE_S))

    def spans(self) -> tuple[tuple[float, float], ...]:
        """Spans found, unordered."""
        return (*self._spans, *((begin, math.inf) for begin in self._open.values()))
