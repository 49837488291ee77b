"""Layouts of MAVLink messages: packing and unpacking payloads.

The tables (field order, checksum seeds) come from pymavlink's generated dialect; frames are built and taken apart
here, so that a fault of that library does not hide on both sides of the wire.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

_EXTENSIONS = {
    # First extension field of each message that we send and that has any: absent from MAVLink 1 frames.
    "AUTOPILOT_VERSION": "uid2",
    "ATTITUDE_QUATERNION": "repr_offset_q",
    "BATTERY_STATUS": "time_remaining",
    "COMMAND_ACK": "progress",
    "GPS_GLOBAL_ORIGIN": "time_usec",
    "GPS_RAW_INT": "alt_ellipsoid",
    "HOME_POSITION": "time_usec",
    "MISSION_ACK": "mission_type",
    "MISSION_CLEAR_ALL": "mission_type",
    "MISSION_COUNT": "mission_type",
    "MISSION_CURRENT": "total",
    "MISSION_ITEM": "mission_type",
    "MISSION_ITEM_INT": "mission_type",
    "MISSION_REQUEST": "mission_type",
    "MISSION_REQUEST_INT": "mission_type",
    "MISSION_REQUEST_LIST": "mission_type",
    "MISSION_WRITE_PARTIAL_LIST": "mission_type",
    "RAW_IMU": "id",
    "STATUSTEXT": "id",
    "SYS_STATUS": "onboard_control_sensors_present_extended",
    "FENCE_STATUS": "breach_mitigation",
}
_NEWER_FIELDS = {
    # Extensions of the message set that the dialect of pymavlink 2.4.50 does not know yet.
    "MISSION_ACK": (("opaque_id", "I"),),
    "MISSION_COUNT": (("opaque_id", "I"),),
    "MISSION_CURRENT": (("mission_id", "I"), ("fence_id", "I"), ("rally_points_id", "I")),
}


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """One message of the dialect.

    Attributes
    ----------
    id, name : int, str
        MAVLink id and name.
    crc_extra : int
        Seed that both sides add to the checksum.
    layout : struct.Struct
        The payload on the wire.
    fields : tuple of (name, first, count)
        In wire order: index of the first unpacked value; count 0 is a scalar, -1 text, else an array.
    base_size : int
        Bytes without extension fields, as in MAVLink 1.
    """

    id: int
    name: str
    crc_extra: int
    layout: struct.Struct
    fields: tuple[tuple[str, int, int], ...]
    base_size: int

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Fields of a payload; bytes that a sender cut off or does not know are zero."""
        size = self.layout.size
        if len(payload) < size:
            payload += bytes(size - len(payload))
        values = self.layout.unpack_from(payload)
        fields: dict[str, Any] = {}
        for name, first, count in self.fields:
            if count == 0:
                fields[name] = values[first]
            elif count < 0:
                fields[name] = values[first].split(b"\0", 1)[0].decode("ascii", "replace")
            else:
                fields[name] = values[first : first + count]
        return fields

    def pack(self, values: dict[str, Any]) -> bytes:
        """Payload of the named fields, zero where not named; integers out of range are clipped to it."""
        flat: list[Any] = []
        for name, _, count in self.fields:
            value = values.get(name)
            if count == 0:
                flat.append(0 if value is None else value)
            elif count < 0:
                flat.append(b"" if value is None else value.encode("ascii", "replace"))
            else:
                flat.extend((0,) * count if value is None else value)
        try:
            return self.layout.pack(*flat)
        except (struct.error, OverflowError, ValueError):
            return self.layout.pack(*_clip(self.layout.format, flat))


def _clip(layout: str, values: list[Any]) -> list[Any]:
    """Bring numbers into the range of their wire type; what is not a number becomes 0."""
    clipped = []
    for code, value in zip(_codes(layout), values, strict=True):
        if code == "s":
            clipped.append(value)
        elif code in "fd":
            number = float(value)
            clipped.append(max(-3.4e38, min(3.4e38, number)) if number == number else number)  # noqa: PLR0124
        else:
            size = struct.calcsize("<" + code) * 8
            low, high = (-(1 << size - 1), (1 << size - 1) - 1) if code.islower() else (0, (1 << size) - 1)
            number = float(value)
            whole = int(number) if abs(number) < 1e30 else (high if number > 0 else low)
            clipped.append(max(low, min(high, whole)))
    return clipped


@cache
def _codes(layout: str) -> tuple[str, ...]:
    codes: list[str] = []
    digits = ""
    for character in layout[1:]:
        if character.isdigit():
            digits += character
            continue
        codes.extend([character] if character == "s" else [character] * int(digits or 1))
        digits = ""
    return tuple(codes)


@cache
def specs() -> tuple[dict[int, MessageSpec], dict[str, MessageSpec]]:
    """Every message of the dialect, by id and by name."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    by_id: dict[int, MessageSpec] = {}
    for number, cls in dialect.mavlink_map.items():
        by_id[number] = _spec(number, cls)
    # Two messages of the standard that pymavlink's dialect lacks.
    cancel = (("command", 0, 0), ("target_system", 1, 0), ("target_component", 2, 0))
    by_id[80] = MessageSpec(80, "COMMAND_CANCEL", 14, struct.Struct("<HBB"), cancel, 4)
    by_id[300] = MessageSpec(
        300,
        "PROTOCOL_VERSION",
        217,
        struct.Struct("<HHH8B8B"),
        (
            ("version", 0, 0),
            ("min_version", 1, 0),
            ("max_version", 2, 0),
            ("spec_version_hash", 3, 8),
            ("library_version_hash", 11, 8),
        ),
        22,
    )
    return by_id, {spec.name: spec for spec in by_id.values()}


def _spec(number: int, cls: Any) -> MessageSpec:
    name: str = cls.msgname
    layout: str = cls.unpacker.format
    fields: list[tuple[str, int, int]] = []
    index = base = 0
    base_values = None
    for field, array, length in zip(cls.ordered_fieldnames, cls.array_lengths, cls.lengths, strict=True):
        if _EXTENSIONS.get(name) == field:
            base_values = len(fields)
            base = index
        text = length == 1 and array > 0
        fields.append((field, index, -1 if text else (length if array else 0)))
        index += 1 if text else length
    codes = _codes(layout)
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    if base_values is None:
        base_size = cls.unpacker.size
    else:
        texts = [lengths[f] for f, _, count in fields[:base_values] if count < 0]
        base_size = sum(struct.calcsize("<" + c) for c in codes[:base] if c != "s") + sum(texts)
    for field, code in _NEWER_FIELDS.get(name, ()):
        if field not in cls.ordered_fieldnames:
            fields.append((field, index, 0))
            layout += code
            index += 1
    return MessageSpec(number, name, cls.crc_extra, struct.Struct(layout), tuple(fields), base_size)


def spec(name: str) -> MessageSpec:
    """Layout of one message by name."""
    return specs()[1][name]
