"""Logs by LOG_REQUEST_LIST and LOG_REQUEST_DATA, for vehicles without file transfers.

A vehicle sends one part at a time; some ignore requests meanwhile, others abort the current part. So a log is
requested in long parts, and lost pieces of a part are requested when it has ended: singly, one request after the other at the
pace of the link, without waiting for each answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.files.reading import Reading
from skyway.link.protocol.exchange import Exchange, Question

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.files.part_file import Pieces
    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

STALL_S = 8.0
"""After this time without data, the transfer is stalled."""
PIECE_BYTES = 90
"""Data of one LOG_DATA."""
LEAST_PART_BYTES, MOST_PART_BYTES, PART_S = 512 * PIECE_BYTES, 40_000 * PIECE_BYTES, 10.0
"""Duration of a part, within limits."""
_LAST = 0xFFFF
_LEAST_PACE_S, _SLOWER = 0.01, 1.3
_LEAST_SILENCE_S, _SILENT_PIECES = 0.6, 8.0


@dataclass(frozen=True, slots=True)
class LogEntry:
    """A log as reported by LOG_ENTRY."""

    number: int
    size_bytes: int
    time_utc: int
    """When it started or ended, POSIX seconds; 0 if the vehicle does not know."""


class ListLogs(Exchange):
    """Lists all logs, or the one of a number, and repeats the request for missing entries."""

    transfers = "LOG_"

    def __init__(self, target: Target, only: int | None = None) -> None:
        super().__init__(target)
        self._only = only
        self.found: dict[int, LogEntry] = {}
        """By number."""
        self.complete = False
        """Whether all have arrived."""
        self._count = self._last = 0
        self._heard_s = 0.0

    def begin(self, now_s: float) -> None:
        """Request all."""
        self._heard_s = now_s
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        first = self._last - self._count + 1
        missing = [number for number in range(first, self._last + 1) if number not in self.found] if self._count else []
        begin, end = (missing[0], missing[-1]) if missing and self.found else (0, _LAST)
        if self._only is not None:
            begin = end = self._only
        self.send("LOG_REQUEST_LIST", start=begin, end=end)
        self.next_s = now_s + max(self.round_trip.retry_s(1), 0.5)

    def hear(self, message: Message, now_s: float) -> None:
        """Process one."""
        if message.name != "LOG_ENTRY":
            return
        number = message["id"]
        if number not in self.found:  # an entry that comes again and again is no progress
            self._heard_s = now_s
        self.next_s = min(now_s + max(self.round_trip.retry_s(1), 0.5), self._heard_s + STALL_S)
        self._count = message["num_logs"]
        self._last = max(self._last, message["last_log_num"])
        if self._count:
            self.found[number] = LogEntry(number, message["size"], message["time_utc"])
        if len(self.found) >= self._count or number == self._only:
            self.complete = True
            self.finish()

    def tick(self, now_s: float) -> None:
        """Repeat the request."""
        if now_s >= self._heard_s + STALL_S:
            self.finish()
        else:
            self._ask(now_s)


class EndLogs(Question):
    """Ends log transfers, so that the vehicle logs again; there is no answer."""

    give_up_s = 0.0

    def __init__(self, target: Target) -> None:
        super().__init__(target, "LOG_REQUEST_END")

    def begin(self, now_s: float) -> None:
        """Send the request twice: one may be lost."""
        for _ in range(2):
            self.ask()
        self.next_s = now_s

    def hear(self, message: Message, now_s: float) -> None:
        """There is no answer."""


class ReadLog(Reading):
    """Reads a log from the end of the local part up to its size."""

    transfers = "LOG_"

    def __init__(
        self,
        target: Target,
        number: int,
        pieces: Pieces,
        size_bytes: int,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        super().__init__(target, pieces, size_bytes, progress)
        self._number = number
        self._part: tuple[int, int] | None = None
        self._part_bytes = LEAST_PART_BYTES
        self._begun_s = self._data_s = self._heard_s = 0.0
        self._came_bytes = 0
        self._pace_s = _LEAST_PACE_S
        self._asked_s: dict[int, float] = {}
        self._short: int | None = None

    def begin(self, now_s: float) -> None:
        """Request the first part."""
        self._heard_s = now_s
        self._more(now_s)

    def _more(self, now_s: float) -> None:
        """Request the missing pieces of the last part, otherwise the next part."""
        if self.pieces.end >= self.size_bytes:
            self.finish()
            return
        hole = self._hole(now_s)
        if hole is not None:
            self._request(*hole)
            self._asked_s[hole[0]] = now_s
            self.next_s = now_s + self._pace_s
        elif self.pieces.end < self.pieces.top:
            self.next_s = now_s + self._pace_s  # all missing pieces are requested
        elif self._short is not None and self._short <= self.pieces.end:
            self.ended_early = True
            self._end(f"the log ends at byte {self._short}, but should have {self.size_bytes}")
        else:
            self._asked_s.clear()
            first = self.pieces.top
            self._part = first, min(first + self._part_bytes, self.size_bytes)
            self._begun_s = self._data_s = now_s
            self._came_bytes = 0
            self._request(first, self._part[1] - first)
            self.next_s = now_s + self._silence_s()

    def _hole(self, now_s: float) -> tuple[int, int] | None:
        """Missing parts that were not requested recently."""
        patience_s = max(self.round_trip.retry_s(1), 4.0 * self._pace_s)
        for offset, size in self.pieces.holes(4 * PIECE_BYTES):
            if now_s > self._asked_s.get(offset, -1e9) + patience_s:
                return offset, size
        return None

    def _request(self, offset: int, size: int) -> None:
        self.send("LOG_REQUEST_DATA", id=self._number, ofs=offset, count=size)

    def _silence_s(self) -> float:
        first = self._came_bytes == 0
        return max(_LEAST_SILENCE_S, _SILENT_PIECES * self._pace_s, self.round_trip.retry_s(1) if first else 0.0)

    def hear(self, message: Message, now_s: float) -> None:
        """Process a piece."""
        if message.name != "LOG_DATA" or message["id"] != self._number:
            return
        offset, count = message["ofs"], min(message["count"], PIECE_BYTES)
        data = bytes(message["data"][:count])
        self._heard_s = self._data_s = now_s
        if self._part is not None and self._came_bytes == 0:
            self.round_trip.learn(now_s - self._begun_s)
            self._begun_s = now_s
        self._take(offset, data)
        if count < PIECE_BYTES and offset + count < self.size_bytes and not self._asked_exactly(offset + count):
            self._short = offset + count
        if self._part is None:
            if self.pieces.end >= self.size_bytes:
                self.finish()
            return
        self._came_bytes += count
        if offset + count >= self._part[1] or count < PIECE_BYTES:
            self._end_part(now_s)
        else:
            self.next_s = now_s + self._silence_s()

    def _asked_exactly(self, end: int) -> bool:
        """Whether a piece is short because no more was requested."""
        return (self._part is not None and end == self._part[1]) or any(
            offset < end <= offset + 4 * PIECE_BYTES for offset in self._asked_s
        )

    def _end_part(self, now_s: float) -> None:
        """Learn the pace of the link from a received part."""
        took_s = now_s - self._begun_s
        if self._came_bytes > 10 * PIECE_BYTES:
            self._pace_s = max(_SLOWER * took_s * PIECE_BYTES / self._came_bytes, _LEAST_PACE_S)
            rate = self._came_bytes / max(took_s, 0.01)
            part = int(min(max(rate * PART_S, LEAST_PART_BYTES), MOST_PART_BYTES))
            self._part_bytes = part - part % PIECE_BYTES
        self._part = None
        self._more(now_s)

    def tick(self, now_s: float) -> None:
        """Continue: the part has ended early, or the next request is due."""
        if now_s >= self._heard_s + STALL_S:
            self._end(f"nothing came for {STALL_S:g} s")
        elif self._part is not None:
            self._end_part(now_s)
        else:
            self._more(now_s)
