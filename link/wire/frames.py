"""MAVLink 1 and 2 frames: found in bytes, checked, decoded, built and signed.

The tables of the messages are pymavlink's. Framing and signatures are our own: every frame is recorded as it came, and
pymavlink's check of signatures takes over the time of a packet before it has checked who signed it, so that one
forged packet from the future would shut out the genuine sender.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass, field
from functools import cache
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
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

_SIGNING_EPOCH_S = 1_420_070_400.0
"""1 January 2015 UTC: signing time counts from here, in units of 10 microseconds."""
_NEW_SENDER_WINDOW = 6_000_000
_MAX_SENDERS = 64
_MAX_REST_BYTES = 512
_UNSIGNED_ALLOWED = frozenset({109, 166})
"""RADIO_STATUS and RADIO: radios cannot sign."""
_TYPED = (
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST_LIST",
)
_BASE_FIELDS = dict.fromkeys(_TYPED, "mission_type") | {"COMMAND_ACK": "progress", "TIMESYNC": "target_system"}
"""First extension field of what we send: MAVLink 1 frames end before it."""


@dataclass(frozen=True, slots=True)
class MessageKind:
    """One kind of message: how its payload lies on the wire."""

    id: int
    name: str
    crc_extra: bytes
    layout: struct.Struct
    fields: tuple[tuple[str, int, int], ...]
    """(name, first value, count): count 0 is a scalar, -1 text."""
    plain: tuple[str, ...] | None
    """The names where all fields are scalars."""
    base_bytes: int


@dataclass(frozen=True, slots=True)
class Message:
    """A message received.

    Attributes
    ----------
    name : str
        Such as ``HEARTBEAT``.
    system, component : int
        Who sent it.
    fields : dict
        By name, in the units of the wire.
    payload : bytes
        As it came.
    version : int
        MAVLink 1 or 2.
    """

    name: str
    system: int
    component: int
    fields: dict[str, Any]
    payload: bytes = b""
    version: int = 2
    sequence: int = 0

    def __getitem__(self, name: str) -> Any:
        return self.fields[name]


@cache
def kinds() -> dict[int, MessageKind]:
    """Every kind of message of the dialect, by id."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    return {number: _kind(number, found) for number, found in dialect.mavlink_map.items()}


@cache
def _by_name() -> dict[str, MessageKind]:
    return {kind.name: kind for kind in kinds().values()}


def _kind(number: int, found: Any) -> MessageKind:
    fields, index, base = [], 0, found.unpacker.size
    offset = 0
    for name, array, length in zip(found.ordered_fieldnames, found.array_lengths, found.lengths, strict=True):
        text = length == 1 and array > 0
        if _BASE_FIELDS.get(found.msgname) == name:
            base = offset
        fields.append((name, index, -1 if text else (length if array else 0)))
        index += 1 if text else length
        offset = struct.calcsize(_first_values(found.unpacker.format, index))
    plain = tuple(found.ordered_fieldnames) if all(count == 0 for _, _, count in fields) else None
    extra = bytes([found.crc_extra])
    return MessageKind(number, found.msgname, extra, found.unpacker, tuple(fields), plain, base)


def _first_values(layout: str, values: int) -> str:
    """The part of a layout that holds its first values."""
    part, digits, left = "<", "", values
    for code in layout[1:]:
        if code.isdigit():
            digits += code
            continue
        many = int(digits or 1)
        if left <= 0:
            break
        if code == "s":
            part += f"{many}s"
            left -= 1
        else:
            taken = min(many, left)
            part += f"{taken}{code}"
            left -= taken
        digits = ""
    return part


def unpack(kind: MessageKind, payload: bytes) -> dict[str, Any]:
    """Fields of a payload; bytes that the sender cut off are zero, bytes that skyway does not know are ignored."""
    size = kind.layout.size
    if len(payload) < size:
        payload += bytes(size - len(payload))
    values = kind.layout.unpack_from(payload)
    if kind.plain is not None:
        return dict(zip(kind.plain, values, strict=True))
    fields: dict[str, Any] = {}
    for name, first, count in kind.fields:
        if count == 0:
            fields[name] = values[first]
        elif count < 0:
            fields[name] = values[first].split(b"\0", 1)[0].decode("ascii", "replace")
        else:
            fields[name] = values[first : first + count]
    return fields


def pack(kind: MessageKind, given: dict[str, Any]) -> bytes:
    """Payload of the fields given; those not given are zero."""
    flat: list[Any] = []
    for name, _, count in kind.fields:
        value = given.get(name)
        if count == 0:
            flat.append(0 if value is None else value)
        elif count < 0:
            flat.append(b"" if value is None else value.encode("ascii", "replace"))
        else:
            flat.extend((0,) * count if value is None else value)
    return kind.layout.pack(*flat)


@dataclass(slots=True)
class Signing:
    """The signing state of one connection.

    Attributes
    ----------
    key : bytes
        32 bytes; never shown.
    timestamp : int
        Newest signing time seen or used.
    last : dict
        Newest time by (system, component, link): what is not newer is a replay.
    """

    key: bytes = field(repr=False)
    timestamp: int = 0
    link_id: int = 0
    last: dict[tuple[int, int, int], int] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if len(self.key) != 32:
            raise InputError(Fault("a signing key is not 32 bytes", remedy="64 hexadecimal digits, or 32 bytes"))

    def advance_to(self, posix_s: float) -> None:
        """Bring the signing time up to an instant."""
        self.timestamp = max(self.timestamp, int((posix_s - _SIGNING_EPOCH_S) * 1e5))

    def sign(self, frame: bytes) -> bytes:
        """Signature block of a frame that ends with its checksum."""
        self.timestamp += 1
        tail = struct.pack("<BQ", self.link_id, self.timestamp)[:7]
        return tail + hashlib.sha256(self.key + frame + tail).digest()[:6]

    def accepts(self, frame: bytes, signature: bytes) -> str | None:
        """Return None for a good signature, else ``forged`` or ``replayed``; only a good one moves the time."""
        wanted = hashlib.sha256(self.key + frame + signature[:7]).digest()[:6]
        if not hmac.compare_digest(wanted, signature[7:]):
            return "forged"
        stamp = int.from_bytes(signature[1:7], "little")
        sender = (frame[5], frame[6], signature[0])
        last = self.last.get(sender)
        if (stamp <= last) if last is not None else (stamp + _NEW_SENDER_WINDOW < self.timestamp):
            return "replayed"
        if last is None and len(self.last) >= _MAX_SENDERS:
            return "forged"
        self.last[sender] = stamp
        self.timestamp = max(self.timestamp, stamp)
        return None


@dataclass(slots=True)
class FrameWriter:
    """Builds our frames on one connection.

    Attributes
    ----------
    system, component : int
        Ours.
    version : int
        MAVLink 1 or 2.
    """

    system: int
    component: int
    version: int = 2
    sequence: int = 0
    signing: Signing | None = None

    def frame(self, name: str, fields: dict[str, Any], version: int | None = None) -> bytes:
        """Return a whole frame."""
        kind = _by_name()[name]
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
    """Packets not taken, counted by why.

    Attributes
    ----------
    checksum : int
        Damaged on the way.
    unsigned, forged, replayed : int
        Without a signature, with a wrong one, with an old one.
    elsewhere : int
        In the name of a vehicle that speaks from another address.
    """

    checksum: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    elsewhere: int = 0

    @property
    def untrusted(self) -> int:
        """Those that somebody else may have sent."""
        return self.unsigned + self.forged + self.replayed + self.elsewhere

    @property
    def total(self) -> int:
        """All of them."""
        return self.checksum + self.untrusted


@dataclass(slots=True)
class FrameReader:
    """Finds messages in bytes; what is no message is skipped, and nothing makes it grow.

    Attributes
    ----------
    rejected : Rejected
        What was not taken.
    heard_signed : bool
        Whether anybody signs.
    datagrams : bool
        Frames never go on in the next bytes: what looks like the beginning of one there does not hold up the next.
    """

    signing: Signing | None = None
    datagrams: bool = False
    heard_signed: bool = False
    rejected: Rejected = field(default_factory=Rejected)
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[tuple[bytes, Message | None]]:
        """Yield each whole frame with its message; None for a message that skyway does not know."""
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
        """Whether it is a frame, whether it is believed, and what it says."""
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
        if mcrf4xx(body[1:-2] + kind.crc_extra) != int.from_bytes(body[-2:], "little"):
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
