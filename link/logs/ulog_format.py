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

from link.logs import ulog_kernels as kernels
from link.logs.vehicle_kind import KindEvidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
KINDS = b"BFIMPQADRLCSO"
"""Types of message."""
MAX_TEXTS = 5000
SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""A whole sync message."""
_SYNC = np.frombuffer(SYNC, dtype=np.uint8)
_KNOWN = np.isin(np.arange(256), list(KINDS))
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
    """What is known of a log: its formats and subscriptions, and counts of what was seen of it.

    Attributes
    ----------
    formats : dict of str to str
        Fields of each type of topic, as the log writes them.
    topics : dict of int to (str, int)
        Name and instance behind each number of a subscription.
    number : dict of int to int
        Data messages of each subscription.
    lengths : dict of int to int
        Bytes of the shortest of them.
    texts : list of (int, str)
        Logged messages: microseconds, text.
    dropouts, dropouts_ms : int
        How often the logger lost data, and for how long in all.
    skipped : int
        Bytes that lie in no message.
    evidence : KindEvidence
        What its parameters say of the vehicle.
    """

    formats: dict[str, str] = field(default_factory=dict)
    topics: dict[int, tuple[str, int]] = field(default_factory=dict)
    number: dict[int, int] = field(default_factory=dict)
    lengths: dict[int, int] = field(default_factory=dict)
    texts: list[tuple[int, str]] = field(default_factory=list)
    dropouts: int = 0
    dropouts_ms: int = 0
    skipped: int = 0
    evidence: KindEvidence = field(default_factory=KindEvidence)

    def counts(self) -> dict[str, int]:
        """Messages of each topic, all its instances together."""
        named: dict[str, int] = {}
        for number, count in self.number.items():
            name = self.topics[number][0]
            named[name] = named.get(name, 0) + count
        return dict(sorted(named.items()))

    def see(self, data: NDArray[np.uint8], found: Messages) -> None:
        """Take notice of the messages of a piece."""
        for row in np.flatnonzero(found.kind != ord("D")):
            at, size = int(found.place[row]), int(found.size[row])
            self._see_one(int(found.kind[row]), data[at : at + size].tobytes())
        for number in np.unique(found.number[found.number >= 0]).tolist():
            if number in self.topics:
                mine = found.number == number
                self.number[number] = self.number.get(number, 0) + int(mine.sum())
                shortest = int(found.size[mine].min()) - 2
                self.lengths[number] = min(self.lengths.get(number, shortest), shortest)

    def _see_one(self, kind: int, body: bytes) -> None:
        if kind == ord("F"):
            name, _, fields = body.decode("ascii", "replace").partition(":")
            self.formats[name] = fields
        elif kind == ord("A") and len(body) > 3:
            self.topics[body[1] + 256 * body[2]] = (body[3:].decode("ascii", "replace"), body[0])
        elif kind in {ord("L"), ord("C")} and len(self.texts) < MAX_TEXTS:
            head = 9 if kind == ord("L") else 11
            if len(body) >= head:
                (time_us,) = struct.unpack_from("<Q", body, head - 8)
                self.texts.append((time_us, body[head:].decode("utf-8", "replace")))
        elif kind == ord("P") and body:
            self._see_parameter(body)
        elif kind == ord("O") and len(body) >= 2:
            self.dropouts += 1
            self.dropouts_ms += body[0] + 256 * body[1]

    def _see_parameter(self, body: bytes) -> None:
        """Take a parameter: the length of its key, the key (type and name), the value."""
        kind, _, name = body[1 : 1 + body[0]].decode("ascii", "replace").partition(" ")
        value = body[1 + body[0] :]
        if kind in _TYPES and len(value) == np.dtype(_TYPES[kind]).itemsize:
            self.evidence.parameter(name, float(np.frombuffer(value, dtype=_TYPES[kind])[0]))

    def columns(
        self, topic: str, data: NDArray[np.uint8], found: Messages
    ) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
        """Return places and fields of the first instance of a topic in a piece; none where it is not there, or makes no sense."""
        nothing = np.empty(0, dtype=np.int64)
        for number, (name, instance) in self.topics.items():
            if (name, instance) != (topic, 0) or number not in self.lengths:
                continue
            rows = found.place[found.number == number] + 2
            layout = self._layout(topic)
            if not len(rows) or layout is None or layout.itemsize > self.lengths[number]:
                return nothing, {}
            table = np.ascontiguousarray(data[rows[:, None] + np.arange(layout.itemsize)]).view(layout)[:, 0]
            return rows, {str(name): table[name] for name in layout.names or ()}
        return nothing, {}

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


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """The messages of a piece of a log.

    Attributes
    ----------
    place, kind, size : ndarray, shape (messages,)
        Where the body of each begins in the piece, its type, and its bytes.
    number : ndarray, shape (messages,)
        Subscription of each data message; -1 for other messages.
    skipped : int
        Bytes of the piece that lie in no message.
    """

    place: NDArray[np.int64]
    kind: NDArray[np.uint8]
    size: NDArray[np.int64]
    number: NDArray[np.int64]
    skipped: int


def find_in_piece(data: NDArray[np.uint8], *, final: bool) -> tuple[Messages, int]:
    """Find the messages of a piece that begins at one; returns them and the bytes done with."""
    most = len(data) // 3 + 1
    place, kind, size = np.empty(most, np.int64), np.empty(most, np.uint8), np.empty(most, np.int64)
    count, used, skipped = kernels.find_messages(data, final, _KNOWN, _SYNC, place, kind, size)
    place, kind, size = place[:count], kind[:count], size[:count]
    mine = (kind == ord("D")) & (size >= 2)
    number = np.full(count, -1, dtype=np.int64)
    number[mine] = data[place[mine]] + 256 * data[place[mine] + 1].astype(np.int64)
    return Messages(place, kind, size, number, skipped), used
