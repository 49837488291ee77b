"""The ULog container: its messages found, damaged or not, and the topics in them as columns.

pyulog reads good logs well, but on some damaged ones it never comes back, so the container is read here; on good logs the
counts are the same.

Source: ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
KINDS = frozenset(b"BFIMPQADRLCSO")
"""Types of message."""
SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""A whole sync message."""
MAX_FIELDS = 2000
MAX_DEPTH = 8
_TYPES = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
    "char": "u1",
}
_FIELD = re.compile(r"^([A-Za-z]\w*)(?:\[(\d{1,4})\])? +(\w+)$")


@dataclass(slots=True)
class ULogContents:
    """What a log holds.

    Attributes
    ----------
    data : bytes
        The log.
    formats : dict of str to str
        Fields of each type of topic, as the log writes them.
    topics : dict of int to (str, int)
        Name and instance behind each number of a subscription.
    places : dict of int to list of int
        Where the data of each subscription begin.
    lengths : dict of int to int
        Bytes of the shortest of them.
    texts : list of (int, str)
        Logged messages: microseconds, text.
    dropouts_ms : list of int
        How long the logger lost data, each time.
    skipped : int
        Bytes that lie in no message.
    """

    data: bytes
    formats: dict[str, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, int]] = field(default_factory=dict)
    places: dict[int, list[int]] = field(default_factory=dict)
    lengths: dict[int, int] = field(default_factory=dict)
    texts: list[tuple[int, str]] = field(default_factory=list)
    dropouts_ms: list[int] = field(default_factory=list)
    skipped: int = 0

    def counts(self) -> dict[str, int]:
        """Messages of each topic, all its instances together."""
        named: dict[str, int] = {}
        for number, places in self.places.items():
            name = self.topics[number][0]
            named[name] = named.get(name, 0) + len(places)
        return dict(sorted(named.items()))

    def columns(self, topic: str) -> dict[str, NDArray[Any]]:
        """Fields of the first instance of a topic, shape (messages,) each; empty where it is not there or makes no sense."""
        for number, places in self.places.items():
            if self.topics[number] == (topic, 0):
                layout = self._layout(topic)
                if layout is None or layout.itemsize > self.lengths[number]:
                    return {}
                table = np.frombuffer(self.data, dtype=np.uint8)
                rows = np.array(places)[:, None] + np.arange(layout.itemsize)
                found = np.ascontiguousarray(table[rows]).view(layout)[:, 0]
                return {str(name): found[name] for name in layout.names or ()}
        return {}

    def _layout(self, topic: str) -> np.dtype[np.void] | None:
        fields: list[tuple[str, str]] = []
        if not self._add_fields(topic, "", fields, 0):
            return None
        while fields and fields[-1][0].rsplit(".", 1)[-1].startswith("_padding"):
            fields.pop()
        names = [name for name, _ in fields]
        return np.dtype(fields) if fields and len(set(names)) == len(names) else None

    def _add_fields(self, topic: str, before: str, fields: list[tuple[str, str]], depth: int) -> bool:
        """Add the fields of a type, those of the types within it in their places."""
        if topic not in self.formats or depth > MAX_DEPTH:
            return False
        for part in self.formats[topic].split(";"):
            if not part.strip():
                continue
            match = _FIELD.match(part.strip())
            if match is None:
                return False
            kind, count, name = match.groups()
            names = [f"{before}{name}"] if count is None else [f"{before}{name}[{step}]" for step in range(int(count))]
            for one in names:
                if len(fields) >= MAX_FIELDS:
                    return False
                if kind in _TYPES:
                    fields.append((one, _TYPES[kind]))
                elif not self._add_fields(kind, f"{one}.", fields, depth + 1):
                    return False
        return True


def read_contents(data: bytes) -> ULogContents:
    """Read the container of a log."""
    found = ULogContents(data)
    for kind, at, size in _messages(found):
        if kind == ord("D") and size >= 2:
            number = data[at] + 256 * data[at + 1]
            if number in found.topics:
                found.places.setdefault(number, []).append(at + 2)
                found.lengths[number] = min(found.lengths.get(number, size), size - 2)
        elif kind == ord("F"):
            name, _, fields = data[at : at + size].decode("ascii", "replace").partition(":")
            found.formats[name] = fields
        elif kind == ord("A") and size > 3:
            name = data[at + 3 : at + size].decode("ascii", "replace")
            found.topics[data[at + 1] + 256 * data[at + 2]] = (name, data[at])
        elif kind in {ord("L"), ord("C")}:
            head = 9 if kind == ord("L") else 11
            if size >= head:
                (time_us,) = struct.unpack_from("<Q", data, at + head - 8)
                found.texts.append((time_us, data[at + head : at + size].decode("utf-8", "replace")))
        elif kind == ord("O") and size >= 2:
            found.dropouts_ms.append(data[at] + 256 * data[at + 1])
    return found


def _messages(found: ULogContents) -> Iterator[tuple[int, int, int]]:
    """Type, place and size of each message; what lies between damage and the next sync message is skipped and counted."""
    data = found.data
    at, end = HEADER_BYTES, len(data)
    while at + 3 <= end:
        size = data[at] + 256 * data[at + 1]
        if data[at + 2] in KINDS and at + 3 + size <= end:
            yield data[at + 2], at + 3, size
            at += 3 + size
            continue
        sync = data.find(SYNC, at)
        if sync < 0:
            break
        found.skipped += sync - at
        at = sync
    found.skipped += max(end - at, 0)
