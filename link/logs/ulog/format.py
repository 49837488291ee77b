"""The ULog container: messages, intact or damaged, and topics as columns.

pyulog reads a log completely into memory, and on some damaged ones it never returns, so the container is read here, message by
message in the same way: on intact and on damaged logs the counts are the same.

Source: ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.table_kernels import table_of
from skyway.link.logs.common.vehicle_kind import WATCHED, KindEvidence
from skyway.link.logs.ulog import ulog_kernels as kernels
from skyway.link.logs.ulog.px4_events import MAX_PACKED

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
MAX_TEXTS = 5000
SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""A complete sync message."""
_DATA, _FORMAT, _PARAMETER, _SUBSCRIPTION, _TEXT, _TAGGED_TEXT, _DROPOUT, _PARTS = b"DFPALCOM"
_SYNC = np.frombuffer(SYNC, dtype=np.uint8)[3:]
LOOK_BYTES = 1024 * 1024
MAX_FIELDS = 2000
MAX_DEPTH = 8
TYPES = {f"{kind}{8 * size}_t": f"<{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4, 8)}
TYPES |= {"float": "<f4", "double": "<f8", "bool": "u1", "char": "u1"}
"""numpy's name of each type of a field."""
MAX_ARRAY = 0xFFFF

Fields = list[tuple[str, int, str]]
"""Type, length of an array (0: none) and name of each field."""


def _read_format(text: str) -> tuple[str, Fields] | None:
    """Read the fields of a type of topic as pyulog does; None if it refuses them."""
    parts = text.split(":")
    if len(parts) < 2:
        return None
    fields: Fields = []
    for one in filter(None, parts[1].split(";")):
        words = one.split(" ")
        if len(words) < 2:
            return None
        kind, bracket, rest = words[0].partition("[")
        count = 0
        if bracket:
            number = rest.split("]")[0] if "]" in rest else rest[:-1]
            if not number.strip().isdigit() or int(number) > MAX_ARRAY:
                return None
            count = int(number)
        fields.append((kind, count, words[1]))
    return parts[0], fields


@dataclass(slots=True)
class ULogContents:
    """State of a log: its formats and subscriptions, and counts of its contents so far."""

    formats: dict[str, Fields] = field(default_factory=dict)
    """Fields of each type of topic."""
    topics: dict[int, tuple[str, int]] = field(default_factory=dict)
    """Name and instance behind each number of a subscription."""
    number: dict[int, int] = field(default_factory=dict)
    """Data messages of each subscription."""
    layouts: dict[int, np.dtype[np.void]] = field(default_factory=dict)
    """Packing of the data of each subscription; messages of another length are damaged."""
    texts: list[tuple[int, str]] = field(default_factory=list)
    """Logged messages: microseconds, text."""
    dropouts: int = 0
    dropouts_ms: int = 0
    """`dropouts`, `dropouts_ms`: how often the logger lost data, and for how long in total."""
    skipped: int = 0
    """Bytes outside messages."""
    event_metadata: bytes = b""
    """The log's description of its events (`link.logs.ulog.px4_events`), packed."""
    evidence: KindEvidence = field(default_factory=KindEvidence)
    """Parameters relevant to the kind of vehicle."""
    _wanted: NDArray[np.int64] = field(default_factory=lambda: np.full(1 << 16, -1))
    """Bytes of the messages of each subscription, -1: none."""
    _packed: dict[str, np.dtype[np.void] | None] = field(default_factory=dict)
    """Layouts made so far, by topic."""

    def counts(self) -> dict[str, int]:
        """Messages of each topic, all its instances together."""
        named: dict[str, int] = {}
        for number, count in self.number.items():
            name = self.topics[number][0]
            named[name] = named.get(name, 0) + count
        return {name: count for name, count in sorted(named.items()) if count}

    def see(self, data: NDArray[np.uint8], found: Messages) -> None:
        """Process the messages of a piece."""
        since: dict[int, int] = {}
        other = np.flatnonzero(found.kind != _DATA)
        columns = (column[other].tolist() for column in (found.kind, found.place, found.size))
        for kind, at, size in zip(*columns, strict=True):
            subscribed = self._see_one(kind, data[at : at + size].tobytes())
            if subscribed is not None:
                since[subscribed] = at
                self._wanted[subscribed] = self.layouts[subscribed].itemsize + 2
        mine = np.flatnonzero((found.kind == _DATA) & (found.size == self._wanted[found.number]))
        if since:
            begun = np.full(len(self._wanted), -1)
            begun[list(since)] = list(since.values())
            mine = mine[found.place[mine] > begun[found.number[mine]]]
        counts = np.bincount(found.number[mine])
        for number in np.flatnonzero(counts).tolist():
            self.number[number] += int(counts[number])

    def _see_one(self, kind: int, body: bytes) -> int | None:
        """Process one message without data; returns the number of a subscription that it starts again."""
        if kind == _PARAMETER:
            self._see_parameter(body)
        elif kind == _FORMAT:
            found = _read_format(body.decode("utf-8", "ignore"))
            if found is not None:
                self.formats[found[0]] = found[1]
                self._packed.clear()
        elif kind == _SUBSCRIPTION and len(body) >= 3:
            number, topic = body[1] + 256 * body[2], body[3:].decode("utf-8", "ignore")
            if topic not in self._packed:
                self._packed[topic] = self._layout(topic)
            layout = self._packed[topic]
            if layout is not None:
                self.topics[number], self.layouts[number] = (topic, body[0]), layout
                self.number[number] = 0
                return number
        elif kind in {_TEXT, _TAGGED_TEXT} and len(self.texts) < MAX_TEXTS:
            head = 9 if kind == _TEXT else 11
            if len(body) >= head:
                (time_us,) = struct.unpack_from("<Q", body, head - 8)
                self.texts.append((time_us, body[head:].decode("utf-8", "replace")))
        elif kind == _PARTS:
            self._see_part(body)
        elif kind == _DROPOUT and len(body) >= 2:
            self.dropouts += 1
            self.dropouts_ms += body[0] + 256 * body[1]
        return None

    def _see_part(self, body: bytes) -> None:
        """Process a piece of information in several parts: whether it continues, the length of its key, the key, the part."""
        key_end = 2 + body[1] if len(body) > 2 else 0
        if body[2:key_end].endswith(b" metadata_events"):
            self.event_metadata = (self.event_metadata if body[0] else b"") + body[key_end:]
            self.event_metadata = self.event_metadata[: MAX_PACKED + 1]

    def _see_parameter(self, body: bytes) -> None:
        """Process a parameter: the length of its key, the key (type and name), the value."""
        size = body[0] if body else 0
        kind, _, name = body[1 : 1 + size].decode("ascii", "replace").partition(" ")
        if name not in WATCHED:
            return
        value = body[1 + size :]
        if kind in TYPES and len(value) == np.dtype(TYPES[kind]).itemsize:
            self.evidence.parameter(name, float(np.frombuffer(value, dtype=TYPES[kind])[0]))

    def columns(
        self, topic: str, data: NDArray[np.uint8], found: Messages
    ) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
        """Return positions and fields of the first instance of a topic in a piece; empty if it is missing or invalid."""
        nothing = np.empty(0, dtype=np.int64)
        for number, (name, instance) in self.topics.items():
            if (name, instance) != (topic, 0):
                continue
            layout = self.layouts[number]
            rows = found.place[(found.number == number) & (found.size == layout.itemsize + 2)] + 2
            if not len(rows):
                continue
            table = table_of(data, rows, layout)
            return rows, {str(name): table[name] for name in layout.names or ()}
        return nothing, {}

    def _layout(self, topic: str) -> np.dtype[np.void] | None:
        fields: list[tuple[str, str]] = []
        if not self._add_fields(topic, "", fields, 0):
            return None
        while fields and fields[-1][0].startswith("_padding"):
            fields.pop()
        names = [name for name, _ in fields]
        return np.dtype(fields) if fields and len(set(names)) == len(names) else None

    def _add_fields(self, topic: str, before: str, fields: list[tuple[str, str]], depth: int) -> bool:
        """Add the fields of a type, those of the types within it in their places."""
        if topic not in self.formats or depth > MAX_DEPTH:
            return False
        for kind, count, name in self.formats[topic]:
            names = [f"{before}{name}[{step}]" for step in range(count)] if count else [f"{before}{name}"]
            for one in names:
                if len(fields) >= MAX_FIELDS:
                    return False
                if kind in TYPES:
                    fields.append((one, TYPES[kind]))
                elif not self._add_fields(kind, f"{one}.", fields, depth + 1):
                    return False
        return True


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """The messages of a piece of a log."""

    place: NDArray[np.int64]
    kind: NDArray[np.uint8]
    size: NDArray[np.int64]
    """`place`, `kind`, `size`: position of the body of each in the piece, its type, and its bytes, shape
    (messages,)."""
    number: NDArray[np.int64]
    """Subscription of each data message, shape (messages,); -1 for other messages."""
    skipped: int
    """Bytes of the piece outside messages."""


class ULogScan:
    """Finds the messages of a log piece by piece (a `link.logs.common.pieces.Scan`).

    After damage reading resumes at the next sync sequence; `last_sync` is the position of the last one of the log, -1: none.
    """

    def __init__(self, last_sync: int) -> None:
        self._state = np.zeros(kernels.STATE_SIZE, dtype=np.int64)
        self._state[[kernels.BASE, kernels.LAST_SYNC]] = HEADER_BYTES, last_sync

    def copy(self) -> ULogScan:
        """Return a reader that continues from the same place."""
        other = ULogScan(-1)
        other._state[:] = self._state
        return other

    def __call__(self, data: NDArray[np.uint8], *, final: bool) -> tuple[Messages, int]:
        """Find the messages of the next piece; returns them and the bytes done with."""
        most = len(data) // 3 + 1
        place, kind, size = np.empty(most, np.int64), np.empty(most, np.uint8), np.empty(most, np.int64)
        count, used, skipped = kernels.find_messages(data, final, _SYNC, self._state, place, kind, size)
        place, kind, size = place[:count], kind[:count], size[:count]
        mine = kind == _DATA
        number = np.full(count, -1, dtype=np.int64)
        number[mine] = data[place[mine]] + 256 * data[place[mine] + 1].astype(np.int64)
        return Messages(place, kind, size, number, skipped), used


def last_sync(path: Path) -> int:
    """Position of the last sync sequence of a log, -1: none. Searched from the end if one is near."""
    sequence = _SYNC.tobytes()
    with path.open("rb") as stream:
        end = stream.seek(0, 2)
        while end > 0:
            begin = max(end - LOOK_BYTES, 0)
            stream.seek(begin)
            found = stream.read(end - begin + len(sequence) - 1).rfind(sequence)
            if found >= 0:
                return begin + found
            end = begin
    return -1
