"""Events of a DataFlash log: messages, errors, modes, arming."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.link.logs.common.log import MAX_EVENTS
from skyway.link.logs.common.trust import DoubtedSpans
from skyway.link.logs.dataflash.messages import (
    ARMED,
    CRASH_CHECK,
    DISARMED,
    EVENTS,
    FLYING,
    LANDED,
    doubt_of,
    error_text,
    mode_numbers,
)
from skyway.missions.autopilots.ardupilot.modes import MODES
from skyway.models.base.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import Kind, KindEvidence

    Stamped = tuple[NDArray[np.int64], NDArray[np.float64], dict[str, NDArray[Any]]]
    Told = Callable[[Kind], str]

EVENT_TYPES = ("MSG", "ERR", "EV", "MODE", "ARM", "VER")


class DataFlashEvents:
    """Collects events piece by piece; numbers are interpreted once the kind of the vehicle is known."""

    def __init__(self) -> None:
        self._told: list[tuple[float, Told]] = []
        self._doubts = DoubtedSpans()
        self._lasting: dict[str, float] = {}

    def see(self, stamped: Mapping[str, Stamped], evidence: KindEvidence) -> None:
        """Take the messages of a piece."""
        rows: list[tuple[int, float, str, int]] = []
        for name in EVENT_TYPES:
            if name in stamped:
                place, times, _ = stamped[name]
                rows += [(int(at), float(times[row]), name, row) for row, at in enumerate(place)]
        for _, time_s, name, row in sorted(rows):
            fields = stamped[name][2]
            getattr(self, f"_see_{name.lower()}")(time_s, fields, row, evidence)

    def lasting(self) -> dict[str, float]:
        """Latest lasting values, by the names of `models.drones.telemetry`."""
        return dict(self._lasting)

    def texts(self, kind: Kind) -> list[tuple[float, str]]:
        """Times since the start (NaN: unknown) and texts, in the order of the log."""
        return [(time_s, text(kind)) for time_s, text in self._told]

    def doubted(self) -> tuple[tuple[float, float], ...]:
        """Spans in which the vehicle did not trust its position."""
        return self._doubts.spans()

    def _say(self, time_s: float, text: str | Told) -> None:
        if len(self._told) < MAX_EVENTS:
            self._told.append((time_s, (lambda _: text) if isinstance(text, str) else text))

    def _see_msg(self, time_s: float, fields: dict[str, Any], row: int, evidence: KindEvidence) -> None:
        if "Message" in fields:
            text = one_line(bytes(fields["Message"][row]).split(b"\0")[0].decode("utf-8", "replace"))
            evidence.text(text)
            self._say(time_s, text)

    def _see_ver(self, _: float, fields: dict[str, Any], row: int, evidence: KindEvidence) -> None:
        if "FWS" in fields:
            evidence.text(bytes(fields["FWS"][row]).split(b"\0")[0].decode("utf-8", "replace"))

    def _see_err(self, time_s: float, fields: dict[str, Any], row: int, _: KindEvidence) -> None:
        if not {"Subsys", "ECode"} <= fields.keys():
            return
        subsystem, code = int(fields["Subsys"][row]), int(fields["ECode"][row])
        self._say(time_s, lambda kind: f"error: {error_text(kind, subsystem, code)}")
        self._doubts.hear(time_s, f"ERR {subsystem}", doubts=doubt_of(subsystem, code))
        if subsystem == CRASH_CHECK and code in (1, 2):
            self._lasting["landed"] = 1.0

    def _see_ev(self, time_s: float, fields: dict[str, Any], row: int, _: KindEvidence) -> None:
        number = int(fields["Id"][row]) if "Id" in fields else 0
        if number in EVENTS and not (number in (ARMED, DISARMED) and self._armed(armed=number == ARMED)):
            self._say(time_s, EVENTS[number])
        if number in (LANDED, FLYING):
            self._lasting["landed"] = float(number == LANDED)

    def _see_arm(self, time_s: float, fields: dict[str, Any], row: int, _: KindEvidence) -> None:
        if "ArmState" in fields:
            armed = bool(fields["ArmState"][row])
            if not self._armed(armed=armed):
                self._say(time_s, "armed" if armed else "disarmed")

    def _armed(self, *, armed: bool) -> bool:
        """Note it; returns whether it was already in this state: EV and ARM report the same."""
        before, self._lasting["armed"] = self._lasting.get("armed"), float(armed)
        return before == float(armed)

    def _see_mode(self, time_s: float, fields: dict[str, Any], row: int, _: KindEvidence) -> None:
        if "Mode" not in fields and "ModeNum" not in fields:
            return
        number = float(mode_numbers({name: column[row : row + 1] for name, column in fields.items()})[0])
        if math.isnan(number) or self._lasting.get("mode") == number:
            return
        self._lasting["mode"] = number
        self._say(time_s, lambda kind: f"mode {MODES.log_name(kind, int(number))}")
