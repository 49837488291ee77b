"""What a PX4 log tells of the flight: its own messages, modes, arming, failsafes, failures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.doubted import DoubtedSpans, doubt_in
from skyway.link.logs.log import MAX_EVENTS
from skyway.link.logs.modes import PX4_NAV_STATES
from skyway.link.logs.ulog_messages import ARMED
from skyway.models.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.link.logs.vehicle_kind import KindEvidence

_FAILURES = ("roll", "pitch", "altitude", "external", "ESC arming", "battery", "imbalanced propeller", "motor")
"""Bits of ``vehicle_status.failure_detector_status``."""
_DISARMED_BY = {
    1: "by stick",
    2: "by switch",
    4: "by command",
    7: "after landing",
    8: "before take-off",
    9: "by the kill switch",
    10: "by lockdown",
    11: "by the failure detector",
}
_WATCHED = ("nav_state", "arming_state", "failsafe", "failure_detector_status", "in_transition_mode")


class ULogEvents:
    """Collects what changes in the topics of state, piece by piece."""

    def __init__(self) -> None:
        self._told: list[tuple[float, str]] = []
        self._state: dict[str, float] = {}
        self._lasting: dict[str, float] = {}

    def status(self, stamps_us: NDArray[np.float64], columns: dict[str, NDArray[Any]], evidence: KindEvidence) -> None:
        """Take messages ``vehicle_status``."""
        for number in np.unique(columns.get("system_type", np.empty(0, np.int64)))[:8].tolist():
            evidence.types.setdefault(int(number), None)
        for number in np.unique(columns.get("vehicle_type", np.empty(0, np.int64)))[:8].tolist():
            evidence.rotary.add(int(number))
        if "vehicle_type" not in columns:
            for flag in np.unique(columns.get("is_rotary_wing", np.empty(0, np.int64)))[:2].tolist():
                evidence.rotary.add(1 if flag else 2)
        if np.any(columns.get("is_vtol", 0)):
            evidence.hovers = "is_vtol"
        evidence.tails |= bool(np.any(columns.get("is_vtol_tailsitter", 0)))
        for name in _WATCHED:
            if name in columns:
                self._changes(name, stamps_us, columns)

    def landing(self, stamps_us: NDArray[np.float64], columns: dict[str, NDArray[Any]]) -> None:
        """Take messages ``vehicle_land_detected``."""
        if "landed" in columns:
            self._changes("landed", stamps_us, columns)

    def lasting(self) -> dict[str, float]:
        """What was told last of what lasts, by the names of `models.telemetry`."""
        return dict(self._lasting)

    def told(
        self, texts: Sequence[tuple[float, str]]
    ) -> tuple[list[tuple[float, str]], tuple[tuple[float, float], ...]]:
        """Return times, microseconds, and words in the order of time, and spans in which the position was doubted, s."""
        doubts = DoubtedSpans()
        lines = [(float(time_us), one_line(text)) for time_us, text in texts]
        for time_us, text in lines:
            doubts.hear(time_us * 1e-6, "position", doubts=doubt_in(text))
        return sorted([*lines, *self._told], key=lambda one: one[0])[:MAX_EVENTS], doubts.spans()

    def _changes(self, name: str, stamps_us: NDArray[np.float64], columns: dict[str, NDArray[Any]]) -> None:
        """Find where one field changes, and say so."""
        values = columns[name].astype(np.float64)
        good = np.flatnonzero(np.isfinite(stamps_us))
        if not len(good):
            return
        before = self._state.get(name, math.nan)
        changed = good[np.flatnonzero(np.diff(values[good], prepend=before) != 0.0)]  # true for NaN, the first
        for row in changed.tolist():
            text = self._text(name, values[row], self._state.get(name, math.nan), columns, row)
            self._state[name] = float(values[row])
            if text and len(self._told) < MAX_EVENTS:
                self._told.append((float(stamps_us[row]), text))
        if name == "nav_state":
            self._lasting["mode"] = self._state[name]
        elif name == "arming_state":
            self._lasting["armed"] = float(self._state[name] == ARMED)
        elif name == "landed":
            self._lasting["landed"] = self._state[name]

    def _text(self, name: str, value: float, before: float, columns: dict[str, NDArray[Any]], row: int) -> str:
        """What a change means; empty where it is only the first value, and the usual one."""
        number = int(value)
        if name == "nav_state":
            return f"mode {PX4_NAV_STATES.get(number, f'number {number}')}"
        if name == "arming_state":
            if value == ARMED:
                return "armed"
            reason = _DISARMED_BY.get(int(columns.get("latest_disarming_reason", np.zeros(row + 1))[row]), "")
            return f"disarmed {reason}".strip() if before == ARMED else ""
        if name == "failure_detector_status":
            failed = [what for bit, what in enumerate(_FAILURES) if number >> bit & 1]
            return f"failure detected: {', '.join(failed)}" if failed else "failure cleared" if before > 0.0 else ""
        begun = {"failsafe": "failsafe", "in_transition_mode": "transition begun", "landed": "landed"}[name]
        over = {"failsafe": "failsafe over", "in_transition_mode": "transition over", "landed": "has left the ground"}[
            name
        ]
        if math.isnan(before) and name == "landed":
            return ""
        return begun if number else over if before > 0.0 else ""
