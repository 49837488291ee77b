"""The log that an autopilot writes of its own flight: started at arming, stored on its card."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from skyway.sim_stub.storage.card import StoredFile
    from skyway.sim_stub.vehicle import Vehicle

FAST_S, SLOW_S = 0.2, 1.0
"""So far apart are attitude and place in a log, and battery and receiver."""


class LogFormat(Protocol):
    """A family's log format; all values are the truth of the simulation."""

    LOG_FOR_EACH_ARMING: ClassVar[bool]
    """A log ends when it disarms; otherwise the log of a boot goes on when it arms again."""

    def head(self, v: Vehicle) -> bytes:
        """Header: formats, version, parameters."""
        ...

    def arming(self, v: Vehicle) -> bytes:
        """That it has armed, or disarmed."""
        ...

    def fast(self, v: Vehicle) -> bytes:
        """Attitude and place."""
        ...

    def slow(self, v: Vehicle) -> bytes:
        """Receiver, battery, mode, state of the filter."""
        ...

    def text(self, v: Vehicle, severity: int, text: str) -> bytes:
        """Give what it said."""
        ...


class FlightLog:
    """Logs of one vehicle; `room_bytes` is what its card holds of them, after which nothing more is written."""

    def __init__(self, vehicle: Vehicle, writes: LogFormat, room_bytes: int) -> None:
        self.vehicle, self._writes, self._room = vehicle, writes, room_bytes
        self._file: StoredFile | None = None
        self._armed = False
        self._fast_s = self._slow_s = 0.0

    def step(self) -> None:
        """Look whether it is armed, and write what is due."""
        v = self.vehicle
        if v.autopilot.armed != self._armed:
            self._switched(armed=v.autopilot.armed)
        if not self._armed or v.sim_s < self._fast_s:
            return
        self._fast_s = v.sim_s + FAST_S - 1e-6
        self._add(self._writes.fast(v))
        if v.sim_s >= self._slow_s:
            self._slow_s = v.sim_s + SLOW_S - 1e-6
            self._add(self._writes.slow(v))

    def text(self, severity: int, text: str) -> None:
        """Log a message of the vehicle."""
        if self._file is not None:
            self._add(self._writes.text(self.vehicle, severity, text))

    def restarted(self) -> None:
        """Begin another log when it arms next."""
        self._file, self._armed = None, False

    def _switched(self, *, armed: bool) -> None:
        self._armed = armed
        v = self.vehicle
        if armed and self._file is None:
            path = v.autopilot.log_path(len(v.card.logs(v.autopilot.LOG_ENDINGS)) + 1, v.posix_s)
            self._file = v.card.put(path, b"", int(v.posix_s))
            self._add(self._writes.head(v))
        self._fast_s = self._slow_s = v.sim_s
        self._add(self._writes.arming(v))
        if not armed and self._writes.LOG_FOR_EACH_ARMING:
            self._file = None

    def _add(self, data: bytes) -> None:
        """Write as long as there is room: what is no longer whole is omitted."""
        if self._file is not None and len(data) <= self._room:
            self._room -= len(data)
            self._file.content += data
