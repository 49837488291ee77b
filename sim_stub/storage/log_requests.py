"""LOG_REQUEST_LIST and LOG_REQUEST_DATA of the families."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.sim_stub.storage.card import StoredFile
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_DATA_BYTES = 90
_FRAME_BYTES = 112
_TICK_S, _PER_TICK = 0.01, 80
_PER_TICK_BLIND = 10
"""ArduPilot on a link without flow control: one piece each millisecond (``handle_log_sending``: num_sends 1)."""


@dataclass(slots=True)
class _Listing:
    port: Port
    number: int
    last: int


@dataclass(slots=True)
class _Sending:
    port: Port
    number: int
    file: StoredFile
    offset: int
    left: int


class LogServer:
    """Answers LOG_REQUEST_LIST, LOG_REQUEST_DATA and LOG_REQUEST_END."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self._busy: _Listing | _Sending | None = None
        self._listed = False
        self._warned = False
        self.next_s = math.inf

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "LOG_REQUEST_LIST": self.request_list,
            "LOG_REQUEST_DATA": self.request_data,
            "LOG_REQUEST_END": self.request_end,
        }

    def forget(self) -> None:
        """Forget what is under way."""
        self._busy, self._listed, self.next_s = None, False, math.inf

    def next_wall_s(self) -> float:
        """Next time at which more is sent."""
        return self.next_s

    def _logs(self) -> list[StoredFile]:
        if "log-gone" in self.vehicle.faults.active:
            return []
        return [one for _, one in self.vehicle.card.logs(self.vehicle.autopilot.LOG_ENDINGS)]

    def _refused(self, port: Port) -> bool:
        """Whether it does not serve now."""
        pilot = self.vehicle.autopilot
        if "log-stall" in self.vehicle.faults.active:
            return True
        if not (pilot.armed and pilot.LOGS_WHEN_DISARMED):
            self._warned = False
            return False
        if not self._warned:
            self._warned = True
            port.reply("STATUSTEXT", severity=3, text="Disarm for log download")
        return True

    def request_list(self, port: Port, message: Any) -> None:
        """Begin to tell the logs, one at a time."""
        if self._refused(port) or (self.vehicle.autopilot.LOGS_WHEN_DISARMED and self._busy is not None):
            return
        first = self.vehicle.autopilot.FIRST_LOG
        count = len(self._logs())
        last = min(message.end, count - 1 + first) if count else 0
        self._listed = True
        self._busy = _Listing(port, min(max(message.start, first), last) if count else 0, last)
        self.next_s = self.vehicle.wall_s

    def request_data(self, port: Port, message: Any) -> None:
        """Begin to send a part of a log."""
        pilot = self.vehicle.autopilot
        if self._refused(port):
            return
        if pilot.LOGS_WHEN_DISARMED and self._busy is not None:
            return  # silently, as long as it is the same link
        if not pilot.LOGS_WHEN_DISARMED and not self._listed:
            return
        logs, number = self._logs(), message.id - pilot.FIRST_LOG
        if not 0 <= number < len(logs):
            return
        file = logs[number]
        size = self.vehicle.ftp.told_bytes(file)
        left = min(max(size - message.ofs, 0), message.count)
        self._busy = _Sending(port, message.id, file, message.ofs, left)
        self.next_s = self.vehicle.wall_s

    def request_end(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Stop."""
        self.forget()

    def tick(self) -> None:
        """Send what the link takes now."""
        self.next_s = self.vehicle.wall_s + _TICK_S
        busy = self._busy
        blind = busy is not None and busy.port.paced_byteps > 0.0 and self.vehicle.autopilot.LOGS_WHEN_DISARMED
        for _ in range(_PER_TICK_BLIND if blind else _PER_TICK):
            busy = self._busy
            if busy is None or busy.port.closed or "log-stall" in self.vehicle.faults.active:
                self._busy = None
                break
            if busy.port.room() < _FRAME_BYTES:
                return
            if isinstance(busy, _Listing):
                self._entry(busy)
            else:
                self._data(busy)
        if self._busy is None:
            self.next_s = math.inf

    def _entry(self, listing: _Listing) -> None:
        logs, number = self._logs(), listing.number
        place = number - self.vehicle.autopilot.FIRST_LOG
        known = logs[place] if 0 <= place < len(logs) else None
        listing.port.reply(
            "LOG_ENTRY",
            id=number,
            num_logs=len(logs),
            last_log_num=listing.last,
            time_utc=0 if known is None else known.time_utc,
            size=0 if known is None else self.vehicle.ftp.told_bytes(known),
        )
        listing.number += 1
        if listing.number > listing.last:
            self._busy = None

    def _data(self, sending: _Sending) -> None:
        data = bytes(sending.file.content[sending.offset : sending.offset + min(_DATA_BYTES, sending.left)])
        sending.port.reply(
            "LOG_DATA",
            id=sending.number,
            ofs=sending.offset,
            count=len(data),
            data=tuple(data.ljust(_DATA_BYTES, b"\0")),
        )
        sending.offset += len(data)
        sending.left -= len(data)
        if len(data) < _DATA_BYTES or sending.left <= 0:
            self._busy = None
