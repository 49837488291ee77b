"""Spans in which a vehicle reports that it does not trust its position."""

from __future__ import annotations

import math

SETTLE_S = 5.0
"""A filter that has just been given its receiver back needs so long."""
BEFORE_S = 3.0
"""A vehicle says so only after so long."""
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
        """Take what a line says; doubts of different reasons are ended each by its own."""
        if doubts is None or math.isnan(time_s):
            return
        if doubts:
            self._open.setdefault(why, time_s - BEFORE_S)
        elif why in self._open and len(self._spans) < MAX_SPANS:
            self._spans.append((self._open.pop(why), time_s + SETTLE_S))

    def spans(self) -> tuple[tuple[float, float], ...]:
        """Spans found, unordered."""
        return (*self._spans, *((begin, math.inf) for begin in self._open.values()))
