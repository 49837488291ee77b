"""The flight journal: one JSON object per line, appended, and on disk before the action that it records.

``docs/reference/journal.md`` describes its contents. Only the last line can be incomplete, if the program was
killed while it wrote; such a line is omitted in reading, and cut off before writing continues.
"""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from skyway.link.supervisor.journal.entry import Entry
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import read_bytes
from skyway.models.base.units import from_posix, iso, parse_instant

if TYPE_CHECKING:
    from collections.abc import Callable
    from io import BufferedRandom
    from pathlib import Path

E = TypeVar("E", bound=Entry)
SCHEMA = "skyway.journal/1"
MAX_BYTES = 256 * 1024 * 1024
UNSYNCED = frozenset({"track", "truth"})
"""Events on which no decision depends: flushed, but not forced to the disk."""


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """One line."""

    n: int
    """Number, from 1."""
    time: str
    """ISO 8601, UTC."""
    state: str
    """State of the delivery, see `link.supervisor.states.State`."""
    event: str
    """Type of the record."""
    flight: int = 0
    """Number of the flight of the delivery, from 1; 0 before the first."""
    reason: str | None = None
    """Reason, a sentence."""
    data: dict[str, Any] = msgspec.field(default_factory=dict)
    """Data of the event: inputs and decision."""

    @property
    def time_s(self) -> float:
        """POSIX seconds."""
        return parse_instant(self.time).timestamp()

    def entry(self, kind: type[E]) -> E | None:
        """Return its data as an entry of a kind; None if it has another schema."""
        return kind.read(self.data) if self.event == kind.event() else None


_DECODER = msgspec.json.Decoder(Record)


@dataclass(frozen=True, slots=True)
class ReadJournal:
    """Contents of a journal."""

    records: tuple[Record, ...]
    whole_bytes: int
    """Length of the complete lines, bytes; an incomplete one follows."""


def read_journal(path: Path) -> ReadJournal:
    """Read a journal; an incomplete last line is omitted.

    Raises an `InputError` if the file is missing, is not a journal, or is damaged before its end.
    """
    data = read_bytes(path, max_bytes=MAX_BYTES)
    records: list[Record] = []
    at = 0
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        try:
            record = _DECODER.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            if at + len(line) + 1 == len(data):
                break  # incomplete, though a line end was on the disk before it
            if not records and SCHEMA.encode() not in line:
                raise _not_a_journal(path) from None
            raise InputError(Fault(f"not a record of a journal: {error}", str(path), number)) from error
        records.append(record)
        at += len(line) + 1
    if not records or records[0].event != "start" or records[0].data.get("schema") != SCHEMA:
        raise _not_a_journal(path)
    return ReadJournal(tuple(records), at)


def _not_a_journal(path: Path) -> InputError:
    return InputError("is not a flight journal", str(path), remedy="name a journal (.jsonl) that skyway fly wrote")


@dataclass(slots=True)
class Journal:
    """Writes the journal.

    With `resume` it continues an existing file, with an incomplete last line cut off; otherwise the file must not exist. If
    it cannot be written, an `InputError` ends the program: no flight without a journal.
    """

    path: Path
    posix_s: Callable[[], float]
    resume: bool = False
    listeners: list[Callable[[Record], None]] = field(default_factory=list)
    count: int = 0
    _file: BufferedRandom | None = None

    def __post_init__(self) -> None:
        try:
            if self.resume:
                found = read_journal(self.path)
                self.count = found.records[-1].n
                self._file = self.path.open("r+b")
                self._file.truncate(found.whole_bytes)
                self._file.seek(0, os.SEEK_END)
            else:
                self._file = self.path.open("x+b")
        except FileExistsError:
            remedy = "choose another name, or continue it with --resume"
            raise InputError(Fault("already exists", str(self.path), field="--journal", remedy=remedy)) from None
        except OSError as error:
            raise self._failed(error) from error

    @classmethod
    def beside_others(cls, path: Path, posix_s: Callable[[], float]) -> Journal:
        """Begin a journal under this name; if another flight of the same second has it, under the next free one, `NAME-2`, `NAME-3` and so on."""
        for number in itertools.count(1):
            free = path.with_stem(f"{path.stem}-{number}") if number > 1 else path
            try:
                return cls(free, posix_s)
            except InputError:
                if not free.exists():
                    raise
        raise AssertionError

    def _failed(self, error: OSError) -> InputError:
        return InputError(Fault(f"the journal cannot be written: {error.strerror or error}", str(self.path)))

    def write(self, state: str, entry: Entry, reason: str | None = None, *, flight: int = 0) -> Record:
        """Append a record; it is on the disk when this returns."""
        if self._file is None:
            raise InputError(Fault("the journal is closed", str(self.path)))
        self.count += 1
        record = Record(
            n=self.count,
            time=iso(from_posix(round(self.posix_s(), 3))),
            state=str(state),
            event=entry.event(),
            flight=flight,
            reason=reason,
            data=entry.to_json(),
        )
        try:
            self._file.write(msgspec.json.encode(record) + b"\n")
            self._file.flush()
            if record.event not in UNSYNCED:
                os.fsync(self._file.fileno())
        except OSError as error:
            raise self._failed(error) from error
        for listener in self.listeners:
            listener(record)
        return record

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
