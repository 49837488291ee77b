"""Messages of a GRIB file, framed and checked before a library decodes them.

A file may contain anything between messages, and several fields in one message (GRIB2). This module finds the position of each message, whether it
is complete, and, of a plain GRIB2 field, the octets that change from field to field of one series (issue, lead, member, packing).

Source: WMO-No. 306, Manual on Codes, volume I.2, FM 92 GRIB edition 2 (sections 0 to 8, templates 4.0 and 4.1) and FM 92 GRIB edition 1.
"""

from __future__ import annotations

import struct
from calendar import timegm
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

LEAD_UNIT_S = {0: 60.0, 1: 3600.0, 2: 86_400.0, 10: 10_800.0, 11: 21_600.0, 12: 43_200.0, 13: 1.0}
"""Seconds in each unit of the forecast time (code table 4.4)."""
LEAST_OCTETS = {1: 21, 3: 14, 4: 9, 5: 11, 6: 6, 7: 5}
MAX_POINTS = 20_000_000
"""Of a field; the finest global models have 7 million."""
PLAIN_TEMPLATES = (0, 1)
"""Product definition templates of a field at one instant: of a forecast, and of a member of an ensemble."""


@dataclass(frozen=True, slots=True)
class Plain:
    """A GRIB2 message with one field at one instant, from its octets."""

    kind: bytes
    """Common properties of the fields of one series: centre, grid, parameter, level."""
    issued_s: float
    lead_s: float
    member: int | None
    """Its perturbation number; None: no ensemble."""
    packing: int
    """Data representation template; -1: a constant, which has no octets."""


@dataclass(frozen=True, slots=True)
class Message:
    """A complete message with one field."""

    number: int
    """Counted from 1."""
    begin: int
    octets: bytes
    edition: int


def messages(data: bytes, file: str) -> Iterator[Message]:
    """Yield the messages of a file, one for each field. Raises an `InputError` naming one that is cut off or damaged."""
    begin, number = data.find(b"GRIB"), 0
    if begin < 0:
        raise InputError("has no GRIB message", file)
    while begin >= 0:
        number += 1
        where = f"message {number}, byte {begin}"
        edition = data[begin + 7] if begin + 8 <= len(data) else 0
        if begin + 16 > len(data):
            raise _cut(where, file)
        if edition == 1:
            length = _length_1(data, begin)
        elif edition == 2:
            (length,) = struct.unpack_from(">Q", data, begin + 8)
        else:
            raise InputError(f"{where}: is GRIB of an unknown edition", file, value=edition, remedy="edition 1 or 2")
        if begin + length > len(data):
            raise _cut(where, file, begin + length - len(data))
        if length < 16 or data[begin + length - 4 : begin + length] != b"7777":
            raise InputError(
                f"{where}: does not end as a GRIB message must (7777)", file, remedy="download the file again"
            )
        octets = data[begin : begin + length]
        if edition == 1:
            _check_1(octets, where, file)
        for one in [octets] if edition == 1 else _fields(octets, where, file):
            yield Message(number, begin, one, edition)
        begin = data.find(b"GRIB", begin + length)


def _cut(where: str, file: str, missing: int = 0) -> InputError:
    lost = f", {missing:,} bytes are missing" if missing else ""
    return InputError(f"{where}: is cut off{lost}", file, remedy="download the file again")


def _length_1(data: bytes, begin: int) -> int:
    """Length of a message of edition 1; a large one is given in units of 120 octets (ECMWF)."""
    length = int.from_bytes(data[begin + 4 : begin + 7], "big")
    if not length & 0x800000 or data[begin + length - 4 : begin + length] == b"7777":
        return length
    at = begin + 8
    for present in (True, bool(data[at + 7] & 0x80), bool(data[at + 7] & 0x40)):
        if present:
            at += int.from_bytes(data[at : at + 3], "big")
    return (length & 0x7FFFFF) * 120 - int.from_bytes(data[at : at + 3], "big") + 4


def _fields(octets: bytes, where: str, file: str) -> list[bytes]:
    """Cut a GRIB2 message into messages of one field each: sections 2 to 7 may be repeated, and remain valid until then."""
    at, kept, found = 16, {1: b"", 2: b"", 3: b"", 4: b"", 5: b"", 6: b""}, []
    bitmap = b""
    while at < len(octets) - 4:
        length, section = int.from_bytes(octets[at : at + 4], "big"), octets[at + 4]
        if length < LEAST_OCTETS.get(section, 5) or at + length > len(octets) - 4 or not 1 <= section <= 7:
            raise InputError(f"{where}: its section {section} does not fit", file, remedy="download the file again")
        part = octets[at : at + length]
        at += length
        if section < 7:
            kept[section] = part
            if section == 6 and part[5] == 254:  # the bitmap of the field before
                kept[6] = bitmap
            elif section == 6:
                bitmap = part
            continue
        if not all(kept[number] for number in (1, 3, 4, 5, 6)):
            raise InputError(f"{where}: a section is missing", file, remedy="download the file again")
        points, values = (int.from_bytes(kept[number][begin : begin + 4], "big") for number, begin in ((3, 6), (5, 5)))
        if not values <= points <= MAX_POINTS:
            problem = f"{where}: claims {values:,} values at {points:,} points"
            raise InputError(problem, file, remedy=f"at most {MAX_POINTS:,} points, and no more values than points")
        body = b"".join((*kept.values(), part, b"7777"))
        found.append(octets[:8] + struct.pack(">Q", len(body) + 16) + body)
    return found


def _check_1(octets: bytes, where: str, file: str) -> None:
    """Check that the sections of a message of edition 1 fill it."""
    at, flags = 8, octets[15]
    for number, present in enumerate((True, bool(flags & 0x80), bool(flags & 0x40), True), start=1):
        if not present:
            continue
        length = int.from_bytes(octets[at : at + 3], "big")
        large = number == 4 and len(octets) > 0x7FFFFF
        if not large and (length < 8 or at + length > len(octets) - 4):
            raise InputError(f"{where}: its section {number} does not fit", file, remedy="download the file again")
        at += length


def plain(message: Message) -> Plain | None:
    """Read the octets of a plain GRIB2 field; None if a library must decode it."""
    octets, at = message.octets, 16
    sections: dict[int, bytes] = {}
    while message.edition == 2 and at + 5 <= len(octets) - 4:
        length = int.from_bytes(octets[at : at + 4], "big")
        sections[octets[at + 4]] = octets[at : at + length]
        at += length
    one, four, five = sections.get(1, b""), sections.get(4, b""), sections.get(5, b"")
    if message.edition != 2 or len(one) < 21 or len(four) < 34 or len(five) < 20:
        return None
    template = int.from_bytes(four[7:9], "big")
    unit = LEAD_UNIT_S.get(four[17])
    if template not in PLAIN_TEMPLATES or unit is None or (template == 1 and len(four) < 37) or four[18] & 0x80:
        return None
    year, month, day, hour, minute, second = struct.unpack(">HBBBBB", one[12:19])
    if not (1 <= year <= 9999 and 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 60):
        return None
    member = four[35] if template == 1 else None
    shared = four[:18] + four[22:34] + (four[34:35] + four[36:] if template == 1 else b"")
    packing = int.from_bytes(five[9:11], "big") if five[19] or int.from_bytes(five[9:11], "big") == 4 else -1
    return Plain(
        b"|".join((octets[6:7], one[:12], one[19:], sections.get(2, b""), sections.get(3, b""), shared)),
        float(timegm((year, month, day, hour, minute, second))),
        unit * int.from_bytes(four[18:22], "big"),
        member,
        packing,
    )
