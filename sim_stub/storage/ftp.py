"""MAVLink FTP of the families: sessions, bursts at the rate of the link, and their error codes.

After ``mavlink_ftp.cpp`` of PX4 and ``GCS_FTP.cpp`` of ArduPilot. Only what reads is served. ArduPilot's has a thread and a short queue of its own: its main loop
puts requests there 400 times a second, those for which there is no room are lost, and the thread looks there every 2 ms once it is empty, and
waits where the link does not take its answer.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections import deque
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from skyway.sim_stub.storage.card import StoredFile
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

DATA_BYTES = 239
_HEAD = struct.Struct("<HBBBBBxI")
_FRAME_BYTES = 280
_TICK_S, _PER_TICK = 0.01, 40
_PAYLOAD_BYTES = 251
_BURST_FRAME_BYTES = 254 + 12
_LOOP_S, _WAKES_S, _CARD_S, _RETRY_S = 0.0025, 0.002, 0.0005, 0.001
"""Of the queue: its main loop; how often the thread looks; what one answer takes; when it looks for room again."""
_ERRNO_NO_ENTRY = 2
_SKIPPED = b"S\0"


class Op(IntEnum):
    """Opcodes that are known."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CRC32 = 14
    BURST = 15
    ACK = 128
    NAK = 129


class Nak(IntEnum):
    """Error codes."""

    FAIL = 1
    FAIL_ERRNO = 2
    BAD_SIZE = 3
    BAD_SESSION = 4
    NO_SESSIONS = 5
    EOF = 6
    UNKNOWN = 7
    PROTECTED = 9
    NOT_FOUND = 10


class Habits(NamedTuple):
    """A family's FTP behaviour."""

    sessions: int
    """Files open at a time, over all clients."""
    numbers_sessions: bool
    """It gives sessions numbers of its own from 1 on; otherwise every session is that of the request."""
    burst_bytes: int
    """A burst ends after so much."""
    queues: bool
    """Requests wait in a queue for a thread, and for the end of a burst; otherwise each is answered as it comes."""
    open_refused: Nak
    """Its answer where no further file can be opened."""
    no_file: Nak
    """Its answer to a read without an open file."""
    empty_is_end: bool
    """An empty folder is answered as one that has ended; otherwise by nothing in it."""
    lists_skipped: bool
    """It lists what it does not name."""
    reads_asked: bool
    """It reads as many bytes as are requested; otherwise as many as there is room for."""
    idle_s: float
    """A session that asks nothing for so long is closed."""
    waiting: int
    """Requests that wait there at most; more are lost."""


class Request(NamedTuple):
    """A request."""

    sequence: int
    session: int
    op: int
    size: int
    asked: int
    complete: int
    offset: int
    data: bytes

    @property
    def text(self) -> str:
        """Its path."""
        return self.data[: self.size].split(b"\0", 1)[0].decode("utf-8", "replace")


def _request(payload: bytes) -> Request:
    sequence, session, op, size, asked, complete, offset = _HEAD.unpack_from(payload)
    return Request(sequence, session, op, size, asked, complete, offset, payload[_HEAD.size : _PAYLOAD_BYTES])


@dataclass(slots=True)
class Session:
    """A file that is open."""

    who: Partner
    number: int
    file: StoredFile
    told_bytes: int
    used_s: float


@dataclass(slots=True)
class Burst:
    """A burst under way."""

    session: Session
    sequence: int
    offset: int
    size: int
    sent: int = 0
    next_s: float = 0.0


class FtpServer:
    """Answers FILE_TRANSFER_PROTOCOL."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.habits: Habits = vehicle.autopilot.ftp_habits(vehicle.config.version)
        self._sessions: list[Session] = []
        self._burst: Burst | None = None
        self._waiting: deque[tuple[Partner, Request]] = deque()
        self._work_s = 0.0
        self._last: tuple[Partner, bytes] | None = None
        self._next_number = 1

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {"FILE_TRANSFER_PROTOCOL": self.hear}

    def forget(self) -> None:
        """Forget sessions and bursts."""
        self._sessions.clear()
        self._waiting.clear()
        self._burst = self._last = None

    def next_wall_s(self) -> float:
        """Next time at which a burst continues, or a request is handled."""
        if self._burst is not None:
            return self._burst.next_s
        return self._work_s if self._waiting else math.inf

    def hear(self, port: Port, message: Any) -> None:
        """Answer a request, at once or after a burst."""
        faults = self.vehicle.faults.active
        if "no-ftp" in faults or "log-stall" in faults:
            return
        payload = bytes(message.payload)
        request = _request(payload)
        who = Partner.of(port, message)
        if not self.habits.queues:
            self._answer(who, request)
        elif len(self._waiting) < self.habits.waiting:
            if not self._waiting:
                loop_s = math.ceil(self.vehicle.wall_s / _LOOP_S) * _LOOP_S
                self._work_s = max(self._work_s, loop_s + _WAKES_S / 2.0)
            self._waiting.append((who, request))

    def _work(self, now: float) -> None:
        """Answer what waits, one after the other, where the link takes it."""
        while self._waiting and self._burst is None and now >= self._work_s:
            if self._waiting[0][0].port.room() < _FRAME_BYTES:
                self._work_s = now + _RETRY_S
                return
            self._answer(*self._waiting.popleft())
            self._work_s += _CARD_S

    def _answer(self, who: Partner, request: Request) -> None:
        last = self._last
        if last is not None and last[0] == who and _HEAD.unpack_from(last[1])[0] == (request.sequence + 1) & 0xFFFF:
            self._send(who, last[1])
            return
        self._last = None
        if request.size > DATA_BYTES:
            self._nak(who, request, Nak.BAD_SIZE)
            return
        self._close_idle()
        match request.op:
            case Op.NONE:
                self._ack(who, request)
            case Op.TERMINATE:
                self._terminate(who, request)
            case Op.RESET:
                mine = [one for one in self._sessions if not self.habits.numbers_sessions or one.who == who]
                for one in mine:
                    self._close(one)
                self._ack(who, request)
            case Op.LIST:
                self._list(who, request)
            case Op.OPEN:
                self._open(who, request)
            case Op.READ:
                self._read(who, request)
            case Op.CRC32:
                self._crc32(who, request)
            case Op.BURST:
                self._begin_burst(who, request)
            case _:
                self._nak(who, request, Nak.UNKNOWN)

    # Sessions

    def _close_idle(self) -> None:
        now = self.vehicle.wall_s
        for one in list(self._sessions):
            if now > one.used_s + self.habits.idle_s:
                self._close(one)

    def _close(self, session: Session) -> None:
        self._sessions.remove(session)
        if self._burst is not None and self._burst.session is session:
            self._burst = None

    def _session(self, who: Partner, number: int) -> Session | None:
        for one in self._sessions:
            if one.number == number and (not self.habits.numbers_sessions or one.who == who):
                one.used_s = self.vehicle.wall_s
                return one
        return None

    def _terminate(self, who: Partner, request: Request) -> None:
        found = self._session(who, request.session)
        if found is not None:
            self._close(found)
        elif not self.habits.queues:
            self._nak(who, request, Nak.BAD_SESSION)
            return
        self._ack(who, request)

    def _open(self, who: Partner, request: Request) -> None:
        if len(self._sessions) >= self.habits.sessions:
            self._nak(who, request, self.habits.open_refused)
            return
        found = self._file(request.text)
        if found is None:
            self._nak(who, request, Nak.NOT_FOUND)
            return
        number = request.session
        if self.habits.numbers_sessions:
            number, self._next_number = self._next_number, self._next_number % 255 + 1
        told = self.told_bytes(found)
        self._sessions.append(Session(who, number, found, told, self.vehicle.wall_s))
        self._ack(who, request, struct.pack("<I", told), session=number)

    def _file(self, path: str) -> StoredFile | None:
        return None if "log-gone" in self.vehicle.faults.active else self.vehicle.card.files.get("/" + path.strip("/"))

    def told_bytes(self, file: StoredFile) -> int:
        """Reported size of a file."""
        return int(len(file.content) * self.vehicle.faults.value("log-size", 1.0))

    # Folders

    def _list(self, who: Partner, request: Request) -> None:
        entries = self.vehicle.card.entries(request.text)
        if entries is None or "log-gone" in self.vehicle.faults.active:
            self._nak(who, request, Nak.NOT_FOUND)
            return
        lines = [_SKIPPED, _SKIPPED] if self.habits.lists_skipped else []
        for name, file in entries:
            size = b"" if file is None else b"\t%d" % self.told_bytes(file)
            lines.append((b"D" if file is None else b"F") + name.encode() + size + b"\0")
        data = b""
        for line in lines[request.offset :]:
            if len(data) + len(line) > DATA_BYTES:
                break
            data += line
        if not data and (request.offset or self.habits.empty_is_end):
            self._nak(who, request, Nak.EOF)
        else:
            self._ack(who, request, data)

    def _crc32(self, who: Partner, request: Request) -> None:
        found = self._file(request.text)
        if found is None:
            self._nak(who, request, Nak.NOT_FOUND)
            return
        crc = zlib.crc32(bytes(found.content), 0xFFFFFFFF) ^ 0xFFFFFFFF  # from 0, and not inverted at the end
        self._ack(who, request, struct.pack("<I", crc))

    # Reading

    def _bytes(self, file: StoredFile, offset: int, size: int) -> bytes:
        data = bytes(file.content[offset : offset + size])
        if "log-rot" in self.vehicle.faults.active and offset // 100_000 != (offset + size) // 100_000:
            return bytes([data[0] ^ 1]) + data[1:]
        return data

    def _read(self, who: Partner, request: Request) -> None:
        session = self._session(who, request.session)
        if session is None:
            self._nak(who, request, self.habits.no_file)
            return
        size = min(request.size, DATA_BYTES) if self.habits.reads_asked else DATA_BYTES
        data = self._bytes(session.file, request.offset, size)
        if data:
            self._ack(who, request, data)
        else:
            self._nak(who, request, Nak.EOF)

    def _begin_burst(self, who: Partner, request: Request) -> None:
        session = self._session(who, request.session)
        if session is None:
            self._nak(who, request, self.habits.no_file)
            return
        size = (request.size or DATA_BYTES) if self.habits.reads_asked else DATA_BYTES
        self._burst = Burst(
            session, request.sequence + 1, request.offset, min(size, DATA_BYTES), 0, self.vehicle.wall_s
        )

    def tick(self) -> None:
        """Send the next pieces of the burst, as many as the link takes now."""
        burst, now = self._burst, self.vehicle.wall_s
        if burst is None:
            self._work(now)
            return
        if now < burst.next_s:
            return
        port = burst.session.who.port
        frame_bytes = _BURST_FRAME_BYTES - DATA_BYTES + burst.size
        paced_s = (
            math.floor(3000 * frame_bytes / port.paced_byteps) / 1e3
            if self.habits.queues and port.paced_byteps
            else 0.0
        )
        for _ in range(1 if paced_s else _PER_TICK):
            if port.room() < _FRAME_BYTES:
                break
            self._piece(burst)
            if self._burst is not burst:
                break
        burst.next_s = now + (paced_s or _TICK_S)
        if not self.habits.queues and now > burst.session.used_s + self.habits.idle_s:
            self._close(burst.session)  # PX4 counts requests only
        if self._burst is None:
            self._work_s = now

    def _piece(self, burst: Burst) -> None:
        session = burst.session
        if "log-stall" in self.vehicle.faults.active or session.who.port.closed:
            self._burst = None
            return
        request = Request(burst.sequence - 1, session.number, Op.BURST, 0, 0, 0, burst.offset, b"")
        burst.sequence = (burst.sequence + 1) & 0xFFFF
        data = self._bytes(session.file, burst.offset, burst.size)
        if self.habits.queues:
            session.used_s = self.vehicle.wall_s
        if not data:
            self._burst = None
            self._nak(session.who, request, Nak.EOF, complete=self.habits.queues)
            return
        burst.offset += len(data)
        burst.sent += len(data)
        over = burst.sent >= self.habits.burst_bytes
        self._burst = None if over else burst
        self._ack(session.who, request, data, complete=over)

    # Answering

    def _ack(
        self, who: Partner, request: Request, data: bytes = b"", *, session: int | None = None, complete: bool = False
    ) -> None:
        self._reply(who, request, Op.ACK, data, session, complete=complete)

    def _nak(self, who: Partner, request: Request, error: Nak, *, complete: bool = False) -> None:
        data = bytes([error, _ERRNO_NO_ENTRY]) if error is Nak.FAIL_ERRNO else bytes([error])
        self._reply(who, request, Op.NAK, data, None, complete=complete)

    def _reply(
        self, who: Partner, request: Request, op: Op, data: bytes, session: int | None, *, complete: bool
    ) -> None:
        number = request.session if session is None else session
        head = _HEAD.pack(
            (request.sequence + 1) & 0xFFFF, number, op, len(data), request.op, int(complete), request.offset
        )
        payload = (head + data).ljust(_PAYLOAD_BYTES, b"\0")
        if len(data) <= 4 or self.habits.queues:  # what it has said last is said again to the same question
            self._last = replace(who), payload
        self._send(who, payload)

    @staticmethod
    def _send(who: Partner, payload: bytes) -> None:
        who.tell("FILE_TRANSFER_PROTOCOL", target_network=0, payload=tuple(payload))
