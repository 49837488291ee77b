"""Quality of a radio: packets lost by their sequence numbers, RADIO_STATUS, delay."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.wire.layout import MAGIC_1, SENDER_AT_1, SENDER_AT_2
from skyway.models.base.formatting import percent, spent

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

STATUS = frozenset(("RADIO", "RADIO_STATUS"))
"""Reports of radios on themselves."""
_COUNTED_S = 5.0
"""Time over which `loss` is counted."""
_MAX_SENDERS = 1024
_UNKNOWN = 255
"""Value of an unknown RSSI or noise."""


@dataclass(slots=True)
class RadioQuality:
    """Quality of one radio."""

    name: str
    heard_s: float = -math.inf
    received: int = 0
    lost: int = 0
    """`received`, `lost`: packets, and gaps in their numbers, since the beginning."""
    delay_s: float = math.nan
    """Mean delay of its packets after those of the fastest radio; NaN if it is the fastest, or the only one."""
    signal: int | None = None
    noise: int | None = None
    remote_signal: int | None = None
    remote_noise: int | None = None
    """`signal`, `noise`, `remote_signal`, `remote_noise`: RSSI and noise at this end and at the vehicle's, by RADIO_STATUS, in the radio's own units;
    None if it reports none."""
    _numbers: dict[tuple[int, int], int] = field(default_factory=dict)
    _window: deque[tuple[float, int, int]] = field(default_factory=deque)

    def count(self, frame: bytes, now_s: float) -> None:
        """Count a packet, and the gap before it."""
        at = SENDER_AT_1 if frame[0] == MAGIC_1 else SENDER_AT_2
        sender, sequence = (frame[at], frame[at + 1]), frame[at - 1]
        before = self._numbers.get(sender)
        gap = 0 if before is None else (sequence - before - 1) & 0xFF
        gap = gap if gap < 128 else 0
        if before is not None or len(self._numbers) < _MAX_SENDERS:
            self._numbers[sender] = sequence
        self.received, self.lost, self.heard_s = self.received + 1, self.lost + gap, now_s
        self._window.append((now_s, 1, gap))
        while self._window and self._window[0][0] < now_s - _COUNTED_S:
            self._window.popleft()

    def hear_status(self, message: Message) -> None:
        """Process a RADIO_STATUS."""
        told = (message[name] for name in ("rssi", "noise", "remrssi", "remnoise"))
        found = [None if value == _UNKNOWN else int(value) for value in told]
        self.signal, self.noise, self.remote_signal, self.remote_noise = found

    def delayed(self, delay_s: float) -> None:
        """Record the delay of a packet after another radio."""
        self.delay_s = delay_s if math.isnan(self.delay_s) else self.delay_s + 0.1 * (delay_s - self.delay_s)

    @property
    def loss(self) -> float:
        """Share of its recent packets that were lost, 0-1; 1 if none arrived."""
        came, gone = sum(one[1] for one in self._window), sum(one[2] for one in self._window)
        return gone / (came + gone) if came else 1.0

    def __str__(self) -> str:
        parts = [f"{percent(self.loss)} lost"]
        if math.isfinite(self.delay_s) and self.delay_s > 0.001:
            parts.append(f"{spent(self.delay_s)} later")
        if self.signal is not None:
            parts.append(f"RSSI {self.signal}, noise {'unknown' if self.noise is None else self.noise}")
        if self.remote_signal is not None:
            parts.append(f"at the vehicle RSSI {self.remote_signal}")
        return f"{self.name}: {', '.join(parts)}"
