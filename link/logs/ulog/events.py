"""Events of a PX4 log: messages, modes, arming, failsafes, failures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.log import MAX_EVENTS
from skyway.link.logs.common.stamps import EDGE_S
from skyway.link.logs.common.trust import SETTLE_S, DoubtedSpans, doubt_in
from skyway.link.logs.ulog.messages import ARMED
from skyway.link.logs.ulog.px4_events import EventReports
from skyway.models.base.errors import one_line
from skyway.models.base.formatting import speed_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import KindEvidence
    from skyway.link.logs.ulog.px4_events import EventWords

SAME_US = 20_000.0
"""Greatest time between a text and the event with the same content."""
RESET_MPS, BEFORE_RESET_S = 1.0, 60.0
"""A velocity corrected by this much has drifted before; it is not trusted for this long."""
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
_NAV_STATES = {
    0: "manual",
    1: "altitude",
    2: "position",
    3: "mission",
    4: "hold",
    5: "return",
    6: "position slow",
    8: "altitude cruise",
    9: "landing after GPS failure",
    10: "acro",
    11: "land",
    12: "descend",
    13: "termination",
    14: "offboard",
    15: "stabilized",
    17: "takeoff",
    18: "land",
    19: "follow",
    20: "precision land",
    21: "orbit",
    22: "VTOL takeoff",
    **{number: f"external {number - 22}" for number in range(23, 31)},
}
"""``vehicle_status.nav_state``."""
_SWITCHES = {
    "failsafe": ("failsafe", "failsafe over"),
    "in_transition_mode": ("transition begun", "transition over"),
    "landed": ("landed", "has left the ground"),
}
"""Meaning of a field that is no longer 0, or is 0 again."""
_LASTING = {"nav_state": "mode", "arming_state": "armed", "landed": "landed"}
_WATCHED = ("nav_state", "arming_state", "failsafe", "failure_detector_status", "in_transition_mode")


def _near(times_us: NDArray[np.float64], time_us: float) -> bool:
    """Whether one of some times, in order, is near this one."""
    place = int(np.searchsorted(times_us, time_us))
    return any(abs(near - time_us) <= SAME_US for near in times_us[max(place - 1, 0) : place + 1].tolist())


class ULogEvents:
    """Collects changes in the topics of state, piece by piece."""

    def __init__(self) -> None:
        self._told: list[tuple[float, str]] = []
        self._state: dict[str, float] = {}
        self._lasting: dict[str, float] = {}
        self._happened: list[tuple[float, int, bytes]] = []
        self._wrong: list[tuple[float, float]] = []

    def happened(self, columns: dict[str, NDArray[Any]], latest_us: float) -> None:
        """Take messages ``event``; those from before the log are written at its beginning.

        One that is far after `latest_us`, the latest known time of the log, is assigned to that time.
        """
        if not {"timestamp", "id", "arguments[0]"} <= columns.keys():
            return
        stamps_us = columns["timestamp"].astype(np.float64)
        if math.isfinite(latest_us):
            stamps_us = np.where(stamps_us > latest_us + EDGE_S * 1e6, latest_us, stamps_us)
        given = sorted((name for name in columns if name.startswith("arguments[")), key=lambda name: int(name[10:-1]))
        arguments = np.stack([columns[name].astype(np.uint8) for name in given], axis=1)
        rows = zip(stamps_us.tolist(), columns["id"].tolist(), arguments, strict=True)
        self._happened += [(time_us, number, row.tobytes()) for time_us, number, row in rows][
            : MAX_EVENTS - len(self._happened)
        ]

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
            self.changes(name, stamps_us, columns)

    def resets(self, stamps_us: NDArray[np.float64], columns: dict[str, NDArray[Any]]) -> None:
        """Take messages ``vehicle_local_position``: a filter that resets its velocity by much was wrong for some time before."""
        if not {"vxy_reset_counter", "delta_vxy[0]", "delta_vxy[1]"} <= columns.keys():
            return
        counter = columns["vxy_reset_counter"].astype(np.float64)
        changed = np.diff(counter, prepend=self._state.get("vxy_reset_counter", counter[0])) != 0.0
        self._state["vxy_reset_counter"] = float(counter[-1])
        step = np.hypot(columns["delta_vxy[0]"], columns["delta_vxy[1]"])
        for row in np.flatnonzero(changed & (step >= RESET_MPS) & np.isfinite(stamps_us)).tolist():
            if len(self._told) < MAX_EVENTS:
                at_us = float(stamps_us[row])
                self._told.append((at_us, f"the filter corrects its velocity by {speed_text(step[row])}"))
                self._wrong.append((at_us * 1e-6 - BEFORE_RESET_S, at_us * 1e-6 + SETTLE_S))

    def lasting(self) -> dict[str, float]:
        """Latest lasting values, by the names of `models.drones.telemetry`."""
        return dict(self._lasting)

    def texts(
        self, texts: Sequence[tuple[float, str]], words: EventWords
    ) -> tuple[list[tuple[float, str]], tuple[tuple[float, float], ...]]:
        """Return times, microseconds, and words in the order of time, and spans in which the position was doubted, s.

        A text that ends in a tab also stands for an event, where the event is logged.
        """
        doubts = DoubtedSpans()
        events, checks, in_words = self._events_told(words)
        times_us = np.sort(np.array(in_words))
        lines = [
            (float(time_us), one_line(text).rstrip())
            for time_us, text in texts
            if not (text.endswith("\t") and _near(times_us, float(time_us)))
        ]
        lines = sorted([*lines, *events], key=lambda one: one[0])
        for time_us, text in lines:
            doubts.hear(time_us * 1e-6, "position", doubts=doubt_in(text))
        return sorted([*lines, *checks, *self._told], key=lambda one: one[0])[:MAX_EVENTS], (
            *doubts.spans(),
            *self._wrong,
        )

    def _events_told(self, words: EventWords) -> tuple[list[tuple[float, str]], list[tuple[float, str]], list[float]]:
        """Return events; of the reports of checks each line that was not in the previous report; times of the events that have texts."""
        events: list[tuple[float, str]] = []
        checks: list[tuple[float, str]] = []
        in_words: list[float] = []
        reports = EventReports(words)
        for time_us, number, arguments in self._happened:
            text, check = reports.hear(number, arguments)
            if text:
                (checks if check else events).append((time_us, text))
            if text and not check and words.describes(number):
                in_words.append(time_us)
        return events, checks, in_words

    def changes(self, name: str, stamps_us: NDArray[np.float64], columns: dict[str, NDArray[Any]]) -> None:
        """Report the changes of one field."""
        good = np.flatnonzero(np.isfinite(stamps_us))
        if name not in columns or not len(good):
            return
        values = columns[name].astype(np.float64)
        before = self._state.get(name, math.nan)
        changed = good[np.flatnonzero(np.diff(values[good], prepend=before) != 0.0)]  # true for NaN, the first
        for row in changed.tolist():
            text = self._text(name, values[row], self._state.get(name, math.nan), columns, row)
            self._state[name] = float(values[row])
            if text and len(self._told) < MAX_EVENTS:
                self._told.append((float(stamps_us[row]), text))
        if name in _LASTING:
            now = self._state[name]
            self._lasting[_LASTING[name]] = float(now == ARMED) if name == "arming_state" else now

    def _text(self, name: str, value: float, before: float, columns: dict[str, NDArray[Any]], row: int) -> str:
        """Meaning of a change; empty if it is only the first value, and the usual one."""
        number = int(value)
        if name == "nav_state":
            return f"mode {_NAV_STATES.get(number, f'number {number}')}"
        if name == "arming_state":
            if value == ARMED:
                return "armed"
            reason = _DISARMED_BY.get(int(columns.get("latest_disarming_reason", np.zeros(row + 1))[row]), "")
            return f"disarmed {reason}".strip() if before == ARMED else ""
        if name == "failure_detector_status":
            failed = [what for bit, what in enumerate(_FAILURES) if number >> bit & 1]
            return f"failure detected: {', '.join(failed)}" if failed else "failure cleared" if before > 0.0 else ""
        begun, over = _SWITCHES[name]
        if math.isnan(before) and name == "landed":
            return ""
        return begun if number else over if before > 0.0 else ""
