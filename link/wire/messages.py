"""MAVLink messages: their kinds (tables of pymavlink), and their fields packed into payloads and unpacked."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

_BASE_BYTES = {
    "COMMAND_ACK": 3,
    "MISSION_ACK": 3,
    "MISSION_CLEAR_ALL": 2,
    "MISSION_COUNT": 4,
    "MISSION_ITEM_INT": 37,
    "MISSION_REQUEST": 4,
    "MISSION_REQUEST_INT": 4,
    "MISSION_REQUEST_LIST": 2,
    "TIMESYNC": 16,
}
"""Length without extension fields, of messages that we send: MAVLink 1 frames end there."""


@dataclass(frozen=True, slots=True)
class MessageKind:
    """One kind of message: the layout of its payload on the wire."""

    id: int
    name: str
    crc_extra: bytes
    layout: struct.Struct
    fields: tuple[tuple[str, int, int], ...]
    """(name, first value, count): count 0 is a scalar, -1 text."""
    plain: tuple[str, ...] | None
    """The names if all fields are scalars."""
    base_bytes: int
    older: MessageKind | None = None
    """An earlier layout, which vehicles still send: distinguished by the checksum."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message received."""

    name: str
    system: int
    component: int
    """`system`, `component`: the sender."""
    fields: dict[str, Any]
    """By name, in the units of the wire."""
    payload: bytes = b""
    version: int = 2
    """MAVLink 1 or 2."""
    sequence: int = 0

    def __getitem__(self, name: str) -> Any:
        return self.fields[name]


@cache
def kinds() -> dict[int, MessageKind]:
    """Every kind of message of the dialect, by id."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    return {number: _kind(number, found) for number, found in dialect.mavlink_map.items()} | {
        290: _esc_info(),
        512: _control_status(),
    }


def _esc_info() -> MessageKind:
    """ESC_INFO, which pymavlink 2.4.50 omits, as it has been in common.xml since 2020."""
    fields = (
        ("time_usec", 0, 0), ("error_count", 1, 4), ("counter", 5, 0), ("failure_flags", 6, 4), ("temperature", 10, 4),
        ("index", 14, 0), ("count", 15, 0), ("connection_type", 16, 0), ("info", 17, 0),
    )  # fmt: skip
    return MessageKind(290, "ESC_INFO", bytes([251]), struct.Struct("<Q4IH4H4h4B"), fields, None, 46)


def _control_status() -> MessageKind:
    """CONTROL_STATUS, which pymavlink 2.4.50 does not know, and the layout that it had before 2026 (mavlink #2313)."""
    first, flags, others = ("gcs_main", 0, 0), ("flags", 1, 0), ("gcs_secondary", 2, 10)
    older = MessageKind(512, "CONTROL_STATUS", bytes([184]), struct.Struct("<12B"), (first, flags, others), None, 2)
    return MessageKind(512, "CONTROL_STATUS", bytes([2]), older.layout, older.fields, None, 12, older)


@cache
def kinds_by_name() -> dict[str, MessageKind]:
    """Every kind of message of the dialect, by name."""
    return {kind.name: kind for kind in kinds().values()}


def _kind(number: int, found: Any) -> MessageKind:
    fields, index = [], 0
    for name, array, length in zip(found.ordered_fieldnames, found.array_lengths, found.lengths, strict=True):
        text = length == 1 and array > 0
        fields.append((name, index, -1 if text else (length if array else 0)))
        index += 1 if text else length
    plain = tuple(found.ordered_fieldnames) if all(count == 0 for _, _, count in fields) else None
    base = _BASE_BYTES.get(found.msgname, found.unpacker.size)
    return MessageKind(number, found.msgname, bytes([found.crc_extra]), found.unpacker, tuple(fields), plain, base)


def unpack(kind: MessageKind, payload: bytes) -> dict[str, Any]:
    """Fields of a payload; bytes truncated by the sender are zero, unknown additional bytes are ignored."""
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
    """Payload of the given fields; others are zero."""
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
