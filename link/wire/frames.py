"""MAVLink 1 and 2 frames: found in bytes, checked, decoded, built and signed.

Framing is our own: every frame is recorded as it came. The messages in them are in `link.wire.messages`, signatures in
`link.wire.signing`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from fastcrc.crc16 import mcrf4xx

from skyway.link.wire.layout import (
    AROUND_1_BYTES,
    AROUND_2_BYTES,
    HEADER_1_BYTES,
    HEADER_2_BYTES,
    ID_AT_1,
    ID_AT_2,
    MAGIC_1,
    MAGIC_2,
    SIGNATURE_BYTES,
    SIGNED,
)
from skyway.link.wire.messages import Message, kinds, kinds_by_name, pack, unpack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.link.wire.signing import Signing

_MAX_REST_BYTES = 512
_UNSIGNED_ALLOWED = frozenset({109, 166})
"""RADIO_STATUS and RADIO: radios cannot sign."""


@dataclass(slots=True)
class FrameWriter:
    """Builds our frames on one connection."""

    system: int
    component: int
    """`system`, `component`: ours."""
    version: int = 2
    """MAVLink 1 or 2."""
    sequence: int = 0
    signing: Signing | None = None

    def frame(self, name: str, fields: dict[str, Any], version: int | None = None) -> bytes:
        """Return a complete frame."""
        kind = kinds_by_name()[name]
        payload = pack(kind, fields)
        sequence = self.sequence
        self.sequence = (sequence + 1) & 0xFF
        if (version or self.version) == 1:
            payload = payload[: kind.base_bytes]
            body = bytes([MAGIC_1, len(payload), sequence, self.system, self.component, kind.id]) + payload
            return body + mcrf4xx(body[1:] + kind.crc_extra).to_bytes(2, "little")
        payload = payload.rstrip(b"\0") or b"\0"
        flags = 0 if self.signing is None else SIGNED
        head = bytes([MAGIC_2, len(payload), flags, 0, sequence, self.system, self.component])
        body = head + kind.id.to_bytes(3, "little") + payload
        body += mcrf4xx(body[1:] + kind.crc_extra).to_bytes(2, "little")
        return body if self.signing is None else body + self.signing.sign(body)


@dataclass(slots=True)
class Rejected:
    """Rejected packets, counted by reason."""

    checksum: int = 0
    """Damaged in transit."""
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    """`unsigned`, `forged`, `replayed`: without a signature, with a wrong one, with an old one."""
    elsewhere: int = 0
    """In the name of a vehicle, but from another address."""

    @property
    def untrusted(self) -> int:
        """Frames that another sender may have forged."""
        return self.unsigned + self.forged + self.replayed + self.elsewhere

    @property
    def total(self) -> int:
        """All of them."""
        return self.checksum + self.untrusted


@dataclass(slots=True)
class FrameReader:
    """Finds messages in bytes; other bytes are skipped, and memory is bounded."""

    signing: Signing | None = None
    datagrams: bool = False
    """Frames never continue in the next bytes: an apparent begin of a frame there does not delay the next one."""
    heard_signed: bool = False
    """Whether any sender signs."""
    rejected: Rejected = field(default_factory=Rejected)
    """Rejected packets."""
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[tuple[bytes, Message | None]]:
        """Yield each complete frame with its message; None for an unknown message."""
        if self._rest:
            data = self._rest + data
            self._rest = b""
        position, end = 0, len(data)
        while position < end:
            position = _next_magic(data, position)
            size = _frame_size(data, position, end)
            if size is None or position + size > end:
                if self.datagrams:
                    position += 1
                    continue
                self._rest = data[position : position + _MAX_REST_BYTES]
                return
            frame = data[position : position + size]
            whole, taken, message = self._take(frame)
            position += size if whole else 1
            if taken:
                yield frame, message

    def _take(self, frame: bytes) -> tuple[bool, bool, Message | None]:
        """Whether it is a frame, whether it is accepted, and its message."""
        version = 1 if frame[0] == MAGIC_1 else 2
        if version == 1:
            number, head, tail = frame[ID_AT_1], HEADER_1_BYTES, 0
            sequence, system, component = frame[2], frame[3], frame[4]
        else:
            number, head = int.from_bytes(frame[ID_AT_2:HEADER_2_BYTES], "little"), HEADER_2_BYTES
            sequence, system, component = frame[4], frame[5], frame[6]
            tail = SIGNATURE_BYTES if frame[2] & SIGNED else 0
            if frame[2] & ~SIGNED:
                return False, False, None
        kind = kinds().get(number)
        if kind is None:
            taken = self.signing is None and version == 2
            return taken, taken, None
        body = frame[: len(frame) - tail] if tail else frame
        checksum = int.from_bytes(body[-2:], "little")
        if mcrf4xx(body[1:-2] + kind.crc_extra) != checksum:
            older = kind.older
            if older is None or mcrf4xx(body[1:-2] + older.crc_extra) != checksum:
                self.rejected.checksum += 1
                return False, False, None
        if not self._trusted(number, body, frame[len(body) :]):
            return True, False, None
        payload = body[head:-2]
        return True, True, Message(kind.name, system, component, unpack(kind, payload), payload, version, sequence)

    def _trusted(self, number: int, body: bytes, signature: bytes) -> bool:
        self.heard_signed = self.heard_signed or bool(signature)
        if self.signing is None or number in _UNSIGNED_ALLOWED:
            return True
        if not signature:
            self.rejected.unsigned += 1
            return False
        wrong = self.signing.accepts(body, signature)
        if wrong == "forged":
            self.rejected.forged += 1
        elif wrong == "replayed":
            self.rejected.replayed += 1
        return wrong is None


def _frame_size(data: bytes, position: int, end: int) -> int | None:
    if end - position < 3:
        return None
    length = data[position + 1]
    if data[position] == MAGIC_1:
        return length + AROUND_1_BYTES
    return length + AROUND_2_BYTES + (SIGNATURE_BYTES if data[position + 2] & SIGNED else 0)


def _next_magic(data: bytes, start: int) -> int:
    first = data.find(MAGIC_2, start)
    second = data.find(MAGIC_1, start)
    if first < 0:
        return second if second >= 0 else len(data)
    return first if second < 0 else min(first, second)
