"""MAVLink messages as pymavlink makes and reads them, and a few that its dialect does not have yet.

The ground side frames, checks and signs by code of its own (`link.wire.frames`): here it meets the code of others.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

UNSIGNED_ALLOWED = frozenset({109, 166})
"""RADIO_STATUS and RADIO: radios cannot sign."""
_MAGIC_2 = 0xFD
_SIGNING_EPOCH_S = 1_420_070_400.0
"""1 January 2015 UTC: signing time counts from here in 10 microseconds."""
_CODES = {
    "char": "s", "uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I", "int32_t": "i", "uint64_t": "Q",
    "int64_t": "q", "float": "f", "double": "d",
}  # fmt: skip
_NEWER_FIELDS = {
    # Extensions of the message set that the dialect of pymavlink 2.4.50 does not know yet.
    "MISSION_ACK": ("opaque_id",),
    "MISSION_COUNT": ("opaque_id",),
    "MISSION_CURRENT": ("mission_id", "fence_id", "rally_points_id"),
}
_COMMAND_CANCEL, _ESC_INFO, _PROTOCOL_VERSION, _CONTROL_STATUS = 80, 290, 300, 512


class _Newer(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no types
    """A message that pymavlink does not know, made as it makes its own."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(type(self).id, self.msgname)
        self._fieldnames = self.fieldnames
        for name in self.fieldnames:
            setattr(self, name, fields[name])

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:  # noqa: FBT001, FBT002  as pymavlink has it
        """Frame of the message."""
        values: list[Any] = []
        for name, count in zip(self.ordered_fieldnames, self.lengths, strict=True):
            value = getattr(self, name)
            values.extend([value] if count == 1 else value)
        payload = self.unpacker.pack(*values)
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


def _newer(number: int, name: str, crc_extra: int, fields: dict[str, tuple[str, int]]) -> type[_Newer]:
    """Class of a message, of its fields in the order of the wire with their types and array lengths (0 is a scalar)."""
    layout = "<" + "".join(f"{count or ''}{_CODES[kind]}" for kind, count in fields.values())
    own = {
        "id": number,
        "msgname": name,
        "crc_extra": crc_extra,
        "fieldnames": list(fields),
        "ordered_fieldnames": list(fields),
        "fieldtypes": [kind for kind, _ in fields.values()],
        "array_lengths": [count for _, count in fields.values()],
        "lengths": [count or 1 for _, count in fields.values()],
        "unpacker": struct.Struct(layout),
    }
    return type(name, (_Newer,), own)


def _longer(known: Any, names: tuple[str, ...]) -> type[_Newer]:
    """Class of a message of scalars with more extension fields, of 32 bits each."""
    kinds = dict(zip(known.fieldnames, known.fieldtypes, strict=True))
    fields = {name: (kinds[name], 0) for name in known.ordered_fieldnames} | dict.fromkeys(names, ("uint32_t", 0))
    return _newer(known.id, known.msgname, known.crc_extra, fields)


@cache
def classes() -> dict[str, Any]:
    """Class of every message by its name."""
    found = {known.msgname: known for known in dialect.mavlink_map.values()}
    found |= {name: _longer(found[name], names) for name, names in _NEWER_FIELDS.items()}
    bytes_8 = ("uint8_t", 8)
    address = {"target_system": ("uint8_t", 0), "target_component": ("uint8_t", 0)}
    versions = dict.fromkeys(("version", "min_version", "max_version"), ("uint16_t", 0))
    hashes = {"spec_version_hash": bytes_8, "library_version_hash": bytes_8}
    found["COMMAND_CANCEL"] = _newer(_COMMAND_CANCEL, "COMMAND_CANCEL", 14, {"command": ("uint16_t", 0), **address})
    control = {"gcs_main": ("uint8_t", 0), "flags": ("uint8_t", 0), "gcs_secondary": ("uint8_t", 10)}
    found["CONTROL_STATUS"] = _newer(_CONTROL_STATUS, "CONTROL_STATUS", 2, control)
    esc = {
        "time_usec": ("uint64_t", 0),
        "error_count": ("uint32_t", 4),
        "counter": ("uint16_t", 0),
        "failure_flags": ("uint16_t", 4),
    }
    esc |= {
        "temperature": ("int16_t", 4),
        **dict.fromkeys(("index", "count", "connection_type", "info"), ("uint8_t", 0)),
    }
    found["ESC_INFO"] = _newer(_ESC_INFO, "ESC_INFO", 251, esc)
    found["PROTOCOL_VERSION"] = _newer(_PROTOCOL_VERSION, "PROTOCOL_VERSION", 217, {**versions, **hashes})
    return found


def message_id(name: str) -> int:
    """Id of a message."""
    return int(classes()[name].id)


def message_name(number: int) -> str | None:
    """Name of a message; None for an unknown one."""
    known = dialect.mavlink_map.get(number) or _newer_by_id().get(number)
    return None if known is None else str(known.msgname)


@cache
def _newer_by_id() -> dict[int, type[_Newer]]:
    """Classes that pymavlink does not know, by id."""
    return {one.id: one for one in classes().values() if issubclass(one, _Newer)}


@cache
def _zeros(name: str) -> tuple[Any, dict[str, Any], tuple[str, ...]]:
    """Class of a message, its fields with nothing in them, and which of them are text."""
    known = classes()[name]
    lengths = dict(zip(known.ordered_fieldnames, known.array_lengths, strict=True))
    zeros: dict[str, Any] = {}
    for field, kind in zip(known.fieldnames, known.fieldtypes, strict=True):
        zeros[field] = b"" if kind == "char" else (0,) * lengths[field] if lengths[field] else 0
    return known, zeros, tuple(field for field, zero in zeros.items() if zero == b"")


def message(name: str, /, **fields: Any) -> Any:
    """Make a message of the named fields, zero where not named."""
    known, zeros, texts = _zeros(name)
    filled = zeros | fields
    for field in texts:
        if isinstance(filled[field], str):
            filled[field] = filled[field].encode("ascii", "replace")
    return known(**filled)


def is_version_2(received: Any) -> bool:
    """Whether a message came as MAVLink 2."""
    return bool(received.get_msgbuf()[0] == _MAGIC_2)


def payload_of(received: Any) -> bytes:
    """Payload of a message as it came, padded: whole numbers that travel as the bytes of a float are read from here."""
    frame = received.get_msgbuf()
    start = 10 if is_version_2(received) else 6
    return bytes(frame[start : start + frame[1]]).ljust(received.unpacker.size, b"\0")


class Mavlink(dialect.MAVLink):  # type: ignore[misc]  # pymavlink has no types
    """One side of a link, as pymavlink speaks it."""

    def __init__(self, system: int, component: int = 1) -> None:
        super().__init__(None, system, component)
        self.robust_parsing = True
        self.seq: int = 0

    def frame(self, sent: Any, version: int = 2) -> bytes | None:
        """Return a message as a frame, numbers out of range clipped; None for one that MAVLink 1 cannot carry."""
        if version == 1 and sent.get_msgId() > 255:
            return None
        try:
            frame = bytes(sent.pack(self, force_mavlink1=version == 1))
        except (struct.error, OverflowError):
            _clip(sent)
            frame = bytes(sent.pack(self, force_mavlink1=version == 1))
        if version == 1:  # pymavlink leaves the extension fields in
            base = sent._payload[: base_bytes(sent.msgname)]  # noqa: SLF001
            frame = bytes(sent._pack(self, sent.crc_extra, base, force_mavlink1=True))  # noqa: SLF001
        self.seq = (self.seq + 1) & 0xFF
        return frame

    def hear(self, data: bytes, *, whole: bool) -> list[Any]:
        """Return the messages that bytes complete; `whole` where frames never continue in the next ones."""
        if whole:
            self.buf, self.buf_index = bytearray(), 0
        found = self.parse_buffer(data) or []
        del self.buf[: self.buf_index]  # a stream of halves does not make it grow
        self.buf_index = 0
        return [one for one in found if one.get_msgId() >= 0]  # others are what it could not read

    def sign(self, key: bytes | None, timestamp: int, posix_s: float) -> None:
        """Sign, and take only what is signed, from the later of a signing time and now on; None stops it."""
        signing = self.signing = dialect.MAVLinkSigning()
        signing.secret_key, signing.sign_outgoing = key, key is not None
        signing.timestamp = max(timestamp, int((posix_s - _SIGNING_EPOCH_S) * 1e5))
        signing.allow_unsigned_callback = lambda _, number: number in UNSIGNED_ALLOWED

    def check_signature(self, frame: bytearray, system: int, component: int) -> bool:
        """Check a signature; a forged one must not move the time of its sender, as pymavlink lets it."""
        times, sender = self.signing.stream_timestamps, (frame[-13], system, component)
        before = times.get(sender)
        good = bool(super().check_signature(frame, system, component))
        if not good and before is None:
            times.pop(sender, None)
        elif not good:
            times[sender] = before
        return good

    def decode(self, frame: bytearray) -> Any:
        """Read a frame; of the messages that pymavlink does not know, the one that a vehicle obeys."""
        read = super().decode(frame)
        if (
            read.get_msgId() != dialect.MAVLINK_MSG_ID_UNKNOWN
            or self.signing.secret_key is not None
            or frame[0] != _MAGIC_2
        ):
            return read
        cancel = classes()["COMMAND_CANCEL"]
        if int.from_bytes(frame[7:10], "little") != cancel.id:
            return read
        if dialect.x25crc(bytes(frame[1:-2]) + bytes([cancel.crc_extra])).crc != int.from_bytes(frame[-2:], "little"):
            return read
        payload = bytes(frame[10:-2]).ljust(cancel.unpacker.size, b"\0")[: cancel.unpacker.size]
        known = cancel(**dict(zip(cancel.fieldnames, cancel.unpacker.unpack(payload), strict=True)))
        known._header = dialect.MAVLink_header(cancel.id, srcSystem=frame[5], srcComponent=frame[6])  # noqa: SLF001
        known._msgbuf = frame  # noqa: SLF001
        return known


@cache
def base_bytes(name: str) -> int:
    """Bytes of a message without its extension fields, as in MAVLink 1.

    pymavlink does not tell which fields are extensions; but the seed of the checksum is made of the others alone.
    """
    known = classes()[name]
    kinds = dict(zip(known.fieldnames, known.fieldtypes, strict=True))
    seeds, layouts = [], []
    crc, layout = dialect.x25crc(f"{name} ".encode()), "<"
    for field, count in zip(known.ordered_fieldnames, known.array_lengths, strict=True):
        crc.accumulate(f"{kinds[field]} {field} ".encode() + (bytes([count]) if count else b""))
        layout += f"{count or ''}{_CODES[kinds[field]]}"
        seeds.append(crc.crc & 0xFF ^ crc.crc >> 8)
        layouts.append(layout)
    last = max(number for number, seed in enumerate(seeds) if seed == known.crc_extra)
    return struct.calcsize(layouts[last])


def _clip(sent: Any) -> None:
    """Bring the numbers of a message into the range of their types; NaN becomes the minimum."""
    for name, kind in zip(sent.fieldnames, sent.fieldtypes, strict=True):
        value = getattr(sent, name)
        if kind != "char":
            many = isinstance(value, (tuple, list))
            setattr(sent, name, [_within(kind, one) for one in value] if many else _within(kind, value))


def _within(kind: str, value: float) -> float:
    if kind == "double":
        return value
    if kind == "float":
        return max(-3.4e38, min(3.4e38, value)) if value == value else value  # noqa: PLR0124  NaN stays
    bits = 8 * struct.calcsize(f"<{_CODES[kind]}")
    low, high = (0, (1 << bits) - 1) if kind.startswith("u") else (-(1 << bits - 1), (1 << bits - 1) - 1)
    whole = int(value) if abs(value) < 1e30 else high if value > 0 else low
    return max(low, min(high, whole))
