"""Reading a file by MAVLink FTP at the full rate of the link.

Several reads are outstanding at a time, as many as the link holds: their number grows as long as answers are not delayed,
and shrinks when they queue (as in TCP Vegas). A link that is not full with a few reads is fast or long: there the number grows as long as the rate
does (`wide_window`). At most two requests are sent per answer, since vehicles queue few (ArduPilot five). If many reads do not fill it either, bursts
are requested, and their lost parts are read singly. If a burst is slower than reads were (one autopilot leaves two thirds of a link without flow
control to others), no further burst is requested.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.files.ftp_words import DATA_BYTES, ERRORS, FtpMessage, Nak, Op, payload, read_payload
from skyway.link.files.reading import Reading
from skyway.link.files.wide_window import WideWindow
from skyway.link.protocol.exchange import RoundTrip

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.files.ftp import Numbers
    from skyway.link.files.part_file import Pieces
    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

STALL_S = 8.0
"""After this time without data, the transfer is stalled."""
LEAST_WINDOW, MOST_WINDOW = 2, 16
QUEUE_LOW, QUEUE_HIGH = 1.5, 4.0
"""Number of reads that wait in the link's queue: with fewer the window grows, with more it shrinks."""
PASSED = 3
"""A read counts as lost when this many later ones have been answered."""
UNFILLED = 1.6
"""Round trips up to this multiple of the shortest, with most reads outstanding, show that the link is not full."""
SLOWER = 0.9
"""Bursts slower than this share of the rate of reads are not requested again."""
PER_ANSWER, PER_TICK = 2, 4
"""Greatest number of requests sent per answer, and without an answer: vehicles queue few."""
_FULL_ROUNDS = 2
_LEAST_RTT_S = 1e-3
_BURST_SILENCE_S, _SILENT_PIECES = 1.0, 6.0
_BURST_WINDOW = 0x4000
_LATE = 256


@dataclass(slots=True)
class _Read:
    offset: int
    size: int
    sent_s: float
    again: bool
    passed: int = 0
    """Number of later reads that were answered."""


class ReadFtp(Reading):
    """Reads an open file from the end of the local part up to its size."""

    transfers = "FILE_TRANSFER"

    def __init__(
        self,
        target: Target,
        numbers: Numbers,
        session: int,
        pieces: Pieces,
        size_bytes: int,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        super().__init__(target, pieces, size_bytes, progress)
        self.session_lost = False
        """The vehicle has closed the file."""
        self._numbers, self._session = numbers, session
        self._reads: dict[int, _Read] = {}
        self._late: dict[int, _Read] = {}
        self._again: list[tuple[int, int]] = []
        self._ahead = pieces.end
        self._window, self._least_rtt_s, self._recent_s = float(LEAST_WINDOW * 2), math.inf, 0.0
        self._trip = RoundTrip()
        self._round_s, self._full_rounds = 0.0, 0
        self._wide: WideWindow | None = None
        self._bursts_help, self._bursting = True, False
        self._burst: int | None = None
        self._burst_first = self._burst_length = 0
        self._burst_begun_s = self._burst_data_s = self._heard_s = 0.0
        self._burst_bytes = 0

    # Requests

    def begin(self, now_s: float) -> None:
        """Request the first pieces."""
        self._heard_s = self._round_s = now_s
        self._more(now_s, PER_TICK)

    def _more(self, now_s: float, most: int) -> None:
        """Request as much as the window allows, but only a limited number at once."""
        if self.pieces.end >= self.size_bytes:
            self.finish()
            return
        if self._bursting:
            asked = {read.offset for read in self._reads.values()}
            self._again = [hole for hole in self.pieces.holes(DATA_BYTES) if hole[0] not in asked]
            if self._burst is None and self.pieces.top < self.size_bytes:
                self._ask_burst(self.pieces.top, now_s)
        for _ in range(min(most, int(self._window) - len(self._reads))):
            if self._again:
                offset, size = self._again.pop(0)
                self._ask(offset, size, now_s, again=True)
            elif not self._bursting and self._ahead < self.size_bytes:
                size = min(DATA_BYTES, self.size_bytes - self._ahead)
                self._ask(self._ahead, size, now_s, again=False)
                self._ahead += size
            else:
                break
        self.next_s = now_s + max(self._patience_s() / 4.0, 0.02)

    def _ask(self, offset: int, size: int, now_s: float, *, again: bool) -> None:
        number = self._numbers.take()
        self._reads[number] = _Read(offset, size, now_s, again)
        self._send(number, Op.READ, offset, size)

    def _ask_burst(self, offset: int, now_s: float) -> None:
        self._burst = self._numbers.take()
        self._burst_first, self._burst_bytes = offset, 0
        self._burst_begun_s = self._burst_data_s = now_s
        self._send(self._burst, Op.BURST, offset, DATA_BYTES)

    def _ask_ahead(self, offset: int, now_s: float) -> None:
        """Request the next burst a round trip before this one ends, if the duration of bursts is known."""
        came, took_s = offset - self._burst_first, now_s - self._burst_begun_s
        following = self._burst_first + self._burst_length
        if self._burst_length and took_s > 0.0 and following < self.size_bytes:
            on_the_way = came / took_s * self._least_rtt_s
            if came + on_the_way >= self._burst_length:
                self._ask_burst(following, now_s)

    def _send(self, number: int, op: Op, offset: int, size: int) -> None:
        asked = payload(number, op, session=self._session, offset=offset, size=size)
        self.send("FILE_TRANSFER_PROTOCOL", payload=asked)

    # Answers

    def hear(self, message: Message, now_s: float) -> None:
        """Process a piece."""
        if message.name != "FILE_TRANSFER_PROTOCOL":
            return
        told = read_payload(bytes(message["payload"]))
        if told is None:
            return
        if told.asked == Op.BURST:
            self._hear_burst(told, now_s)
        elif told.asked == Op.READ:
            self._hear_read(told, now_s)

    def _hear_read(self, told: FtpMessage, now_s: float) -> None:
        number = (told.sequence - 1) & 0xFFFF
        read = self._reads.pop(number, None)
        late = read is None
        read = read or self._late.pop(number, None)
        if read is None:
            return
        self._heard_s = now_s
        if not late:
            self._count_passed(read)
        if told.error is not None:
            self._refused(told.error, read.offset)
        else:
            self._take(read.offset, told.data[: read.size])
            if 0 < len(told.data) < read.size:
                self._again.insert(0, (read.offset + len(told.data), read.size - len(told.data)))
            elif not told.data:
                self._refused(Nak.EOF, read.offset)
            if not late and not read.again:
                self._learn(now_s - read.sent_s, now_s)
        if not self.done:
            self._more(now_s, PER_ANSWER)

    def _count_passed(self, answered: _Read) -> None:
        """Count as lost the requests sent well before an answered request."""
        for number, read in list(self._reads.items()):
            if read.sent_s > answered.sent_s or (read.sent_s == answered.sent_s and read.offset > answered.offset):
                break
            read.passed += 1
            if read.passed >= PASSED:
                self._give_up(number)

    def _give_up(self, number: int) -> None:
        """Repeat lost requests; the data may still come late."""
        read = self._late[number] = self._reads.pop(number)
        if self._wide is not None:
            self._wide.lost += 1
        self._again.append((read.offset, read.size))
        while len(self._late) > _LATE:
            del self._late[next(iter(self._late))]

    def _learn(self, took_s: float, now_s: float) -> None:
        """Adapt the number of outstanding reads, once each round trip."""
        self._trip.learn(took_s)
        took_s = max(took_s, _LEAST_RTT_S)
        self._least_rtt_s = min(self._least_rtt_s, took_s)
        self._recent_s = took_s if not self._recent_s else self._recent_s + 0.3 * (took_s - self._recent_s)
        if self._bursting or now_s < self._round_s + self._recent_s:
            return
        self._round_s = now_s
        if self._wide is not None:
            self._widen(self._wide, now_s)
            return
        queued = self._window * (1.0 - self._least_rtt_s / self._recent_s)
        if queued < QUEUE_LOW:
            self._window = min(self._window * 2.0, MOST_WINDOW)
        elif queued > QUEUE_HIGH:
            self._window = max(self._window - 1.0, LEAST_WINDOW)
        unfilled = self._window >= MOST_WINDOW and self._recent_s < UNFILLED * self._least_rtt_s
        self._full_rounds = self._full_rounds + 1 if unfilled else 0
        if self._full_rounds >= _FULL_ROUNDS:
            self._wide = WideWindow(self._window, now_s, self.came_bytes)

    def _widen(self, wide: WideWindow, now_s: float) -> None:
        """Increase the number of outstanding reads as long as the rate grows; use bursts if there is no sign of a full link, or many are lost."""
        self._window = wide.learn(now_s, self.came_bytes, self._recent_s, self._least_rtt_s)
        if wide.settled and self._bursts_help and (wide.crowded or not wide.full):
            self._bursting = True

    def _hear_burst(self, told: FtpMessage, now_s: float) -> None:
        if self._burst is None or (told.sequence - self._burst - 1 + _BURST_WINDOW) & 0xFFFF >= 2 * _BURST_WINDOW:
            return
        self._heard_s = self._burst_data_s = now_s
        if told.error is None:
            new, earlier = self._take(told.offset, told.data), told.offset < self._burst_first
            self._burst_bytes += 0 if earlier else new
            if earlier:
                pass  # of the previous one, whose end was not waited for
            elif told.complete:
                self._burst_length = told.offset + len(told.data) - self._burst_first
                self._end_burst(now_s)
            else:
                self._ask_ahead(told.offset, now_s)
        elif told.error == Nak.EOF and self.pieces.top >= self.size_bytes:
            self._end_burst(now_s)
        elif told.error in (Nak.UNKNOWN, Nak.EOF):
            self._end_burst(now_s)
            self._bursts_help, self._bursting = told.error == Nak.EOF and self._bursts_help, False
            self._ahead = self.pieces.top
        else:
            self._refused(told.error, told.offset)
        if not self.done:
            self._more(now_s, PER_ANSWER)

    def _end_burst(self, now_s: float) -> None:
        """Check whether it was faster than reads."""
        self._burst = None
        took_s = max(now_s - self._burst_begun_s, _LEAST_RTT_S)
        by_reads = 0.0 if self._wide is None else self._wide.best_byteps
        if self.pieces.top < self.size_bytes and self._burst_bytes / took_s < SLOWER * by_reads:
            self._bursts_help = self._bursting = False
            self._ahead = self.pieces.top

    def _refused(self, error: int, offset: int) -> None:
        if error == Nak.EOF:
            self.ended_early = True
            self._end(f"the file ends before byte {offset}, but should have {self.size_bytes}")
        else:
            self.session_lost = error in (Nak.BAD_SESSION, Nak.NOT_FOUND, Nak.FAIL)
            self._end(f"the vehicle stopped the transfer: {ERRORS.get(error, f'error {error}')}")

    # Time

    def _patience_s(self) -> float:
        return self._trip.retry_s(1)

    def tick(self, now_s: float) -> None:
        """Repeat requests without an answer."""
        if now_s >= self._heard_s + STALL_S:
            self._end(f"nothing came for {STALL_S:g} s")
            return
        if self._burst is not None:
            pieces = max(self._burst_bytes / DATA_BYTES, 1.0)
            usual_s = (self._burst_data_s - self._burst_begun_s) / pieces
            if now_s > self._burst_data_s + max(_BURST_SILENCE_S, _SILENT_PIECES * usual_s):
                self._burst = None
        streaming = self._burst is not None and now_s < self._burst_data_s + _BURST_SILENCE_S
        if not streaming:  # during a burst some vehicles do not answer
            patience_s = self._patience_s()
            for number in [n for n, read in self._reads.items() if now_s > read.sent_s + patience_s]:
                self._trip.unclear()
                self._give_up(number)
        self._more(now_s, PER_TICK)
