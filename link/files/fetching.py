"""Downloading a log into a file ``….part`` that resumes after an interruption and gets its final name when verified."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

from skyway.link.files.ftp_words import crc32
from skyway.link.files.part_file import Pieces
from skyway.models.base.errors import CommandRefusedError, InputError, LinkError, VehicleTimeoutError
from skyway.models.base.files import file_error
from skyway.models.base.formatting import bytes_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from skyway.link.files.aboard import LogAboard, LogStore

TRIES = 3
"""Consecutive transfers without new data after which it is abandoned."""
GROWS, GROWS_S = 15, 2.0
"""Number of times that a log that is still being written is followed to its new end, and the interval."""
SAMPLE_BYTES = 180
"""Bytes compared at both ends of local data without a checksum."""
_CHUNK_BYTES = 1_000_000
_SPARE_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Fetched:
    """A log that is available locally."""

    path: Path
    size_bytes: int
    crc32: int
    """CRC of the file, as computed by autopilots."""
    by_crc: bool
    """Whether the vehicle reports the same checksum; otherwise only its size was compared, and the packets' checksums."""
    came_bytes: int
    """Bytes transferred by this call."""
    took_s: float
    notes: tuple[str, ...] = ()
    """Irregularities."""
    grows: bool = False
    """The vehicle still writes the log: this is its beginning, whose checksum the vehicle cannot report."""

    @property
    def verified_by(self) -> str:
        """Method by which the copy was verified."""
        if self.by_crc:
            return f"size and CRC-32 {self.crc32:08x}"
        return f"size ({'the log still grows' if self.grows else 'this vehicle reports no checksum'})"

    @property
    def rate_byteps(self) -> float:
        """Bytes a second, of those transferred by this call."""
        return self.came_bytes / self.took_s if self.took_s > 0.0 else 0.0


def local_name(log: LogAboard, system: int) -> str:
    """Name of the file of a log, which is unique among vehicles of one fleet."""
    return f"vehicle{system}-{log.name.replace('/', '-').replace(' ', '_').lower()}"


def fetch(
    store: LogStore,
    log: LogAboard,
    folder: Path,
    *,
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Fetched:
    """Fetch one log into a folder.

    An existing file is extended if the log has grown since. Of a log that grows all the time, the beginning is kept, with a note. Raises an `InputError` if it cannot be written or
    has other content, a `LinkError` if the vehicle, or the link, failed: then the received part is kept, and the same call continues
    from there.
    """
    if store.vehicle.armed:
        raise CommandRefusedError(
            "give its logs", "the vehicle is armed: logs are downloaded only on the ground, disarmed"
        )
    path = folder / local_name(log, store.vehicle.system)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        there = path.exists() and not force
        if there and path.stat().st_size >= log.size_bytes:
            return _already(store, log, path)
        if there and not part.exists():
            shutil.copyfile(path, part)
        fetched = _Fetching(store, log, part, progress, path if there else None).run()
        _finish(part, path)
    except OSError as error:
        raise file_error("written", path, error) from error
    finally:
        store.end()
    return Fetched(path, *fetched)


def _already(store: LogStore, log: LogAboard, path: Path) -> Fetched:
    """Compare an existing file."""
    size, ours = path.stat().st_size, file_crc32(path)
    theirs = store.crc32(log, log.size_bytes)
    if size != log.size_bytes:
        raise _other(path, f"{size} bytes, and {log.size_bytes} on the vehicle")
    if theirs not in (None, ours):
        raise _other(path, "another checksum")
    if theirs is None and not _same_ends(store, log, path, size):
        raise _other(path, "the same size, but other data")
    return Fetched(path, size, ours, theirs is not None, 0, 0.0, ("it was already here",))


def _same_ends(store: LogStore, log: LogAboard, path: Path, size_bytes: int) -> bool:
    """Whether the vehicle's log has the same data at both ends of so many bytes of a file; a `LinkError` if they do not arrive."""
    length = min(SAMPLE_BYTES, size_bytes)
    with path.open("rb") as stream:
        return all(
            _sample(store, log, offset, length) == _at(stream, offset, length)
            for offset in sorted({0, size_bytes - length})
        )


def _sample(store: LogStore, log: LogAboard, offset: int, length: int) -> bytes:
    """Return some bytes of the log on the vehicle; fewer where it ends there."""
    kept = BytesIO()
    pieces = Pieces(kept, offset)
    problem = ""
    for _ in range(TRIES):
        try:
            read = store.read(log, pieces, offset + length)
        except VehicleTimeoutError as error:
            problem = str(error)
            continue
        if pieces.end >= offset + length or read.ended_early:
            return kept.getvalue()
        problem = read.problem
    raise LinkError(f"{log.name}: {problem}; what was received before is kept: run the same command to continue")


def _at(stream: BinaryIO, offset: int, length: int) -> bytes:
    stream.seek(offset)
    return stream.read(length)


def _other(path: Path, differs: str) -> InputError:
    problem = f"exists already and differs from the vehicle's log ({differs})"
    return InputError(problem, str(path), remedy="move it, or give --force")


def _finish(part: Path, path: Path) -> None:
    """Give a complete file its final name."""
    with part.open("rb") as stream:
        os.fsync(stream.fileno())
    part.replace(path)


def file_crc32(path: Path, size_bytes: int | None = None) -> int:
    """Checksum of a file, or of a number of bytes at its beginning, as computed by autopilots."""
    found = 0
    with path.open("rb") as stream:
        left = path.stat().st_size if size_bytes is None else size_bytes
        while left > 0 and (chunk := stream.read(min(_CHUNK_BYTES, left))):
            found = crc32(chunk, found)
            left -= len(chunk)
    return found


class _Fetching:
    """One log in transfer."""

    def __init__(
        self,
        store: LogStore,
        log: LogAboard,
        part: Path,
        progress: Callable[[int, int], None] | None,
        earlier: Path | None,
    ) -> None:
        self._store, self._log, self._part, self._progress = store, log, part, progress
        self._earlier = earlier
        self._clock = store.vehicle.connection.clock
        self._size = log.size_bytes
        self._came = 0
        self._notes: list[str] = []
        self._anew = self._lied = False

    def run(self) -> tuple[int, int, bool, int, float, tuple[str, ...], bool]:
        """Transfer it, compare it, and follow its growth; returns the fields of `Fetched` after the path."""
        self._enough_room()
        begin = self._resumable()
        self._anew = begin == 0
        self._refuse_other(begin)
        transferring_s, followed = 0.0, 0
        while True:
            began_s = self._clock.now_s()
            self._transfer(begin)
            transferring_s += self._clock.now_s() - began_s
            ours, theirs = file_crc32(self._part), None
            size = self._size_now()
            if size <= self._size:
                theirs = self._store.crc32(self._log, self._size)
                size = size if theirs in (None, ours) else self._size_now()  # it may have grown meanwhile
            grows = size > self._size
            if grows and followed < GROWS:
                self._notes.append("it was still being written")
                begin, self._size, followed = self._size, size, followed + 1
                self._store.vehicle.connection.run_for(GROWS_S)
            elif grows or theirs in (None, ours):
                if grows:
                    self._refuse_armed()
                    self._notes.append("it still grows: this is its beginning; to add the rest, fetch it again")
                notes = tuple(dict.fromkeys(self._notes))
                return self._size, ours, theirs == ours, self._came, transferring_s, notes, grows
            else:
                begin = self._differs(ours, theirs)

    def _size_now(self) -> int:
        """Present size of the log; 0 if the vehicle reports wrong sizes of it."""
        return 0 if self._lied else self._store.size_bytes(self._log)

    def _refuse_armed(self) -> None:
        """Do not take the beginning of the log of a flight for the log."""
        if self._store.vehicle.armed:
            raise LinkError(f"{self._log.name} grows, and the vehicle is armed: disarm it, then try again")

    def _refuse_other(self, whole_bytes: int) -> None:
        """Refuse to replace a file that is not the beginning of this log: it is of another vehicle, or another card."""
        if self._earlier is None:
            return
        size = self._earlier.stat().st_size
        if whole_bytes < size or file_crc32(self._part, size) != file_crc32(self._earlier):
            self._part.unlink()
            raise _other(self._earlier, "it is not its beginning")

    def _differs(self, ours: int, theirs: int | None) -> int:
        """Handle a wrong checksum: once again from the beginning, then fail."""
        if self._anew and "from the beginning" in " ".join(self._notes):
            self._part.unlink()
            raise LinkError(
                f"{self._log.name} differs from the vehicle's log: its checksum is {ours:08x}, the vehicle's {theirs or 0:08x}; "
                "nothing was kept. Check its card"
            )
        self._anew = True
        if self._earlier is not None:
            self._part.unlink()
            raise _other(self._earlier, "it is not its beginning")
        self._notes.append("its checksum differed; downloaded again from the beginning")
        self._part.unlink()
        return 0

    def _enough_room(self) -> None:
        there = self._part.stat().st_size if self._part.exists() else 0
        free = shutil.disk_usage(self._part.parent).free
        if self._size - there + _SPARE_BYTES > free:
            need = f"{bytes_text(self._size - there)} needed, {bytes_text(free)} free"
            raise InputError(f"the disk is full: {need}", str(self._part.parent), remedy="another folder with --to")

    def _resumable(self) -> int:
        """Bytes of an earlier attempt that are the beginning of this log, checked at both of its ends."""
        if not self._part.exists():
            return 0
        there = self._part.stat().st_size
        if 0 < there <= self._size and _same_ends(self._store, self._log, self._part, there):
            self._notes.append(f"resumed after {bytes_text(there)}")
            return there
        self._notes.append("an earlier part belonged to another log; downloaded from the start")
        return 0

    def _transfer(self, begin: int) -> None:
        """Read up to the size; broken transfers are resumed as long as they bring new data."""
        failures = 0
        with self._part.open("r+b" if begin else "wb") as stream:
            stream.truncate(begin)
            stream.seek(begin)
            pieces = Pieces(stream, begin)
            while pieces.end < self._size:
                before, problem = pieces.end, ""
                try:
                    read = self._store.read(self._log, pieces, self._size, self._tell)
                    problem = read.problem
                    if read.ended_early:
                        self._ended_early(pieces, problem)
                        break
                except VehicleTimeoutError as error:
                    problem = str(error)
                finally:
                    stream.flush()
                    self._came += pieces.end - before
                failures = 0 if pieces.end > before else failures + 1
                if failures >= TRIES:
                    self._give_up(pieces.end, problem)
                pieces = Pieces(stream, pieces.end)

    def _give_up(self, end: int, problem: str) -> None:
        """Report the kept part; an empty part is not kept."""
        kept = f"{bytes_text(end)} of {bytes_text(self._size)} are kept in {self._part.name}: run the same command to continue"
        if not end:
            self._part.unlink()
            kept = "nothing came"
        raise LinkError(f"{self._log.name}: {problem}; {kept}")

    def _ended_early(self, pieces: Pieces, problem: str) -> None:
        """For a vehicle that reported a wrong size: the received data are accepted if the checksum confirms that they are complete."""
        theirs = self._store.crc32(self._log, pieces.end)
        self._size, self._lied = pieces.end, True
        if theirs is None:
            kept = f"the {bytes_text(pieces.end)} that came are in {self._part.name}"
            raise LinkError(f"{self._log.name}: {problem}; without a checksum its completeness is unknown; {kept}")
        self._notes.append(f"the vehicle reported a wrong size: {problem}")

    def _tell(self, end: int) -> None:
        if self._progress is not None:
            self._progress(end, self._size)
