"""Several radios to one vehicle: each packet once, on the better radio, with a switch when it falls silent.

A radio may carry the same channel of the vehicle as another (a copy, byte by byte), or a channel of its own (other packet numbers). Of copies every
packet is taken once, from whichever radio is first; of channels those of the active radio, since answers to requests come on the same channel.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.link.wire.frames import FrameReader
from skyway.link.wire.layout import MAGIC_1, SENDER_AT_1, SENDER_AT_2
from skyway.link.wire.radio_quality import STATUS, RadioQuality
from skyway.link.wire.transport import UdpSocket
from skyway.models.base.errors import LinkLostError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.wire.transport import Transport

SILENT_S = 1.3
"""A radio that receives nothing for this long is not used while another one receives."""
_POLL_S = 0.01
_COPIES_S, _MAX_SEEN = 3.0, 4000
_BETTER, _BETTER_S = 0.1, 5.0
"""A radio with a loss lower by this, for this long, becomes active."""
_JUDGED, _RECENT, _COPY_SHARE = 20, 80, 0.5
_OWN = 64


@dataclass(eq=False, slots=True)
class Radio:
    """One radio, with its quality."""

    quality: RadioQuality
    transport: Transport
    reader: FrameReader
    copies: int = 0
    others: int = 0
    """`copies`, `others`: packets that another radio also received, and those that none did; old ones have decreasing weight."""
    echoes: int = 0
    """Packets of our own that it has echoed."""
    told_silent: bool = False

    @property
    def name(self) -> str:
        """Its address, as given."""
        return self.quality.name

    @property
    def loss(self) -> float:
        """Share of its recent packets that were lost, 0-1."""
        return self.quality.loss

    def silent(self, now_s: float) -> bool:
        """Whether it has received nothing for a while."""
        return now_s > self.quality.heard_s + SILENT_S

    def compare(self, *, copy: bool) -> None:
        """Count a packet that another radio also received, or that none did."""
        if self.copies + self.others >= _RECENT:
            self.copies, self.others = self.copies // 2, self.others // 2
        self.copies, self.others = self.copies + copy, self.others + (not copy)

    @property
    def copies_others(self) -> bool:
        """Whether it carries the same channel as others."""
        total = self.copies + self.others
        return total >= _JUDGED and self.copies > _COPY_SHARE * total

    def __str__(self) -> str:
        return str(self.quality)


class RedundantTransport:
    """Several transports as one; `radios` are their names and the transports."""

    def __init__(self, radios: Sequence[tuple[str, Transport]], now_s: Callable[[], float] = time.monotonic) -> None:
        self.radios = [
            Radio(RadioQuality(name), one, FrameReader(datagrams=isinstance(one, UdpSocket))) for name, one in radios
        ]
        self.used = self.radios[0]
        """The radio on which commands are sent."""
        self._now_s = now_s
        self._seen: dict[bytes, tuple[float, Radio, bool]] = {}
        self._sent: deque[bytes] = deque(maxlen=_OWN)
        self._better_since_s = math.inf
        self._notes: deque[str] = deque(maxlen=100)

    def notes(self) -> list[str]:
        """Return the events since the last call, a sentence each."""
        found = list(self._notes)
        self._notes.clear()
        return found

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Return new complete frames; waits for at most a given time."""
        end = self._now_s() + timeout_s
        share_s = min(_POLL_S, timeout_s) / len(self.radios)
        while True:
            found = b"".join(self._read_one(radio, share_s) for radio in self.radios)
            self._choose(self._now_s())
            if found or self._now_s() >= end:
                return found

    def _read_one(self, radio: Radio, wait_s: float) -> bytes:
        try:
            data = radio.transport.read(wait_s)
        except LinkLostError:  # an unplugged device; the others continue
            return b""
        now, taken = self._now_s(), b""
        for frame, message in radio.reader.feed(data) if data else ():
            if frame in self._sent:
                self._echo(radio)
                continue
            if message is not None and message.name in STATUS:
                radio.quality.hear_status(message)
                taken += frame
                continue
            if isinstance(radio.transport, UdpSocket):
                radio.transport.learn(frame[SENDER_AT_1 if frame[0] == MAGIC_1 else SENDER_AT_2])
            radio.quality.count(frame, now)
            if self._new(radio, frame, now):
                taken += frame
        return taken

    def _echo(self, radio: Radio) -> None:
        radio.echoes += 1
        if radio.echoes == 1:
            self._notes.append(f"radio {radio.name} echoes packets: its echoes are dropped")

    def _new(self, radio: Radio, frame: bytes, now_s: float) -> bool:
        """Whether a frame is accepted: the first of copies, and of other channels those of the active radio."""
        first = self._seen.get(frame)
        if first is not None and now_s <= first[0] + _COPIES_S and first[1] is not radio:
            radio.compare(copy=True)
            radio.quality.delayed(now_s - first[0])
            late = not first[2] and radio is self.used
            if late:
                self._seen[frame] = (first[0], first[1], True)
            return late
        radio.compare(copy=False)
        taken = radio is self.used or radio.copies_others or self.used.copies_others
        self._seen[frame] = (now_s, radio, taken)
        if len(self._seen) > _MAX_SEEN:
            self._seen = {one: told for one, told in self._seen.items() if now_s <= told[0] + _COPIES_S}
            if len(self._seen) > _MAX_SEEN:
                self._seen.clear()
        return taken

    def _choose(self, now_s: float) -> None:
        """Switch to another radio if the active one is silent, or has been worse for long."""
        for radio in self.radios:
            silent = radio.silent(now_s) and math.isfinite(radio.quality.heard_s)
            if silent != radio.told_silent:
                radio.told_silent = silent
                self._notes.append(f"radio {radio.name} is {'silent' if silent else 'heard again'}")
        alive = [radio for radio in self.radios if not radio.silent(now_s)]
        if not alive:
            return
        best = min(alive, key=lambda radio: radio.loss)
        if self.used not in alive:
            self._use(best, "is used instead")
        elif self.used.loss - best.loss > _BETTER:
            self._better_since_s = min(self._better_since_s, now_s)
            if now_s >= self._better_since_s + _BETTER_S:
                self._use(best, "is used, which loses less")
        else:
            self._better_since_s = math.inf

    def _use(self, radio: Radio, why: str) -> None:
        self._notes.append(f"radio {radio} {why}")
        self.used, self._better_since_s = radio, math.inf

    def write(self, data: bytes) -> None:
        """Send on the active radio; the others get just enough to keep their path open and announce us."""
        self._sent.append(data)
        for radio in self.radios:
            if radio is self.used or self._is_heartbeat(data):
                try:
                    radio.transport.write(data)
                except LinkLostError:
                    continue

    @staticmethod
    def _is_heartbeat(frame: bytes) -> bool:
        if frame[:1] == bytes([MAGIC_1]):
            return frame[5] == 0
        return frame[7:10] == b"\0\0\0"

    def close(self) -> None:
        """Close all."""
        for radio in self.radios:
            radio.transport.close()
