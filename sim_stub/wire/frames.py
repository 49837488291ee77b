"""MAVLink 1 and 2 frames: build them, find them in a stream of bytes, sign and check them."""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from fastcrc.crc16 import mcrf4xx

from skyway.sim_stub.wire.messages import MessageSpec, specs

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC_1 = 0xFE
MAGIC_2 = 0xFD
_SIGNED = 0x01
_HEADER_2 = struct.Struct("<BBBBBBBBB")
_HEADER_1 = struct.Struct("<BBBBBB")
_SIGNATURE_BYTES = 13
_SIGNING_EPOCH_S = 1_420_070_400.0
"""1 January 2015 UTC: signing time counts from here in 10 microseconds."""
_NEW_STREAM_WINDOW = 6_000_000
"""A signer not heard before may be at most a minute behind the newest time we know."""
_UNSIGNED_ALLOWED = frozenset({109, 166})  # RADIO_STATUS, RADIO: radios cannot sign


@dataclass(frozen=True, slots=True)
class Message:
    """A message received whole.

    Attributes
    ----------
    spec : MessageSpec
        Which message.
    system, component : int
        Who sent it.
    fields : dict
        Its fields by name.
    version : int
        MAVLink 1 or 2.
    payload : bytes
        As it came: integers that travel as the bytes of a float are read from here.
    """

    spec: MessageSpec
    system: int
    component: int
    fields: dict[str, Any]
    version: int = 2
    payload: bytes = b""

    @property
    def name(self) -> str:
        """Name of the message."""
        return self.spec.name

    def __getitem__(self, field_name: str) -> Any:
        return self.fields[field_name]


@dataclass(slots=True)
class Signing:
    """The signing state of one link.

    Attributes
    ----------
    key : bytes
        32 bytes.
    timestamp : int
        Newest signing time seen or used.
    last_seen : dict
        Newest time by (system, component, link id): older ones are replays.
    """

    key: bytes
    timestamp: int = 0
    link_id: int = 0
    last_seen: dict[tuple[int, int, int], int] = field(default_factory=dict)

    def sign(self, frame: bytes) -> bytes:
        """Signature block of a frame that ends with its checksum."""
        self.timestamp += 1
        tail = struct.pack("<BQ", self.link_id, self.timestamp)[:7]
        return tail + hashlib.sha256(self.key + frame + tail).digest()[:6]

    def accepts(self, frame: bytes, signature: bytes) -> bool:
        """Check a signature block, and that it is newer than the last of the same sender."""
        wanted = hashlib.sha256(self.key + frame + signature[:7]).digest()[:6]
        if not hmac.compare_digest(wanted, signature[7:]):
            return False
        stamp = int.from_bytes(signature[1:7], "little")
        sender = (frame[5], frame[6], signature[0])
        last = self.last_seen.get(sender)
        if stamp <= last if last is not None else stamp + _NEW_STREAM_WINDOW < self.timestamp:
            return False
        if len(self.last_seen) < 64 or last is not None:
            self.last_seen[sender] = stamp
        self.timestamp = max(self.timestamp, stamp)
        return True

    def advance_to(self, posix_s: float) -> None:
        """Bring the signing time up to an instant."""
        self.timestamp = max(self.timestamp, int((posix_s - _SIGNING_EPOCH_S) * 1e5))


@dataclass(slots=True)
class FrameWriter:
    """Builds the frames of one sender on one link.

    Attributes
    ----------
    system, component : int
        The sender.
    version : int
        MAVLink 1 or 2.
    """

    system: int
    component: int
    version: int = 2
    sequence: int = 0
    signing: Signing | None = None

    def frame(self, message: MessageSpec, payload: bytes) -> bytes | None:
        """Return a whole frame; None for a message that MAVLink 1 cannot carry."""
        sequence = self.sequence
        self.sequence = (sequence + 1) & 0xFF
        seed = message.crc_extra.to_bytes(1, "little")
        if self.version == 1:
            if message.id > 255:
                return None
            payload = payload[: message.base_size]
            head = _HEADER_1.pack(MAGIC_1, len(payload), sequence, self.system, self.component, message.id)
            body = head + payload
            return body + mcrf4xx(body[1:] + seed).to_bytes(2, "little")
        payload = payload.rstrip(b"\0") or b"\0"
        number = message.id
        head = _HEADER_2.pack(
            MAGIC_2,
            len(payload),
            _SIGNED if self.signing else 0,
            0,
            sequence,
            self.system,
            self.component,
            number & 0xFF,
            number >> 8 & 0xFF,
        ) + (number >> 16).to_bytes(1, "little")
        body = head + payload
        body += mcrf4xx(body[1:] + seed).to_bytes(2, "little")
        return body if self.signing is None else body + self.signing.sign(body)


@dataclass(slots=True)
class FrameReader:
    """Finds messages in bytes; whatever is no message is skipped, and nothing makes it grow.

    Attributes
    ----------
    whole : bool
        The bytes come as datagrams: a frame never continues in the next one.
    rejected : int
        Frames dropped for their checksum or signature.
    """

    whole: bool = False
    rejected: int = 0
    signing: Signing | None = None
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that the bytes complete."""
        if self._rest:
            data = self._rest + data
            self._rest = b""
        by_id = specs()[0]
        position, end = 0, len(data)
        while position < end:
            magic = data[position]
            if magic not in (MAGIC_1, MAGIC_2):
                position = _next_magic(data, position + 1)
                continue
            size = self._frame_size(data, position, end)
            if size is None or position + size > end:
                if not self.whole:
                    self._rest = data[position:]
                    return
                position = _next_magic(data, position + 1)
                continue
            message = self._take(by_id, data[position : position + size])
            if message is None:
                position = _next_magic(data, position + 1)
                continue
            position += size
            yield message

    def _trusted(self, body: bytes, signature: bytes) -> bool:
        """Whether a frame may pass: with a key, only well signed ones."""
        return self.signing is None or (bool(signature) and self.signing.accepts(body, signature))

    @staticmethod
    def _frame_size(data: bytes, position: int, end: int) -> int | None:
        if end - position < 3:
            return None
        length = data[position + 1]
        if data[position] == MAGIC_1:
            return length + 8
        return length + 12 + (_SIGNATURE_BYTES if data[position + 2] & _SIGNED else 0)

    def _take(self, by_id: dict[int, MessageSpec], frame: bytes) -> Message | None:
        version = 1 if frame[0] == MAGIC_1 else 2
        if version == 1:
            number, head = frame[5], 6
            system, component, tail = frame[3], frame[4], 0
        else:
            if frame[2] & ~_SIGNED:
                self.rejected += 1
                return None
            number, head = frame[7] | frame[8] << 8 | frame[9] << 16, 10
            system, component = frame[5], frame[6]
            tail = _SIGNATURE_BYTES if frame[2] & _SIGNED else 0
        message = by_id.get(number)
        if message is None:
            return None
        body = frame[: len(frame) - tail]
        crc = mcrf4xx(body[1:-2] + message.crc_extra.to_bytes(1, "little"))
        if crc != int.from_bytes(body[-2:], "little"):
            self.rejected += 1
            return None
        if not (number in _UNSIGNED_ALLOWED or self._trusted(body, frame[len(body) :])):
            self.rejected += 1
            return None
        payload = body[head:-2]
        return Message(message, system, component, message.unpack(payload), version, payload)


def _next_magic(data: bytes, start: int) -> int:
    first = data.find(MAGIC_2, start)
    second = data.find(MAGIC_1, start)
    if first < 0:
        return second if second >= 0 else len(data)
    return first if second < 0 else min(first, second)
