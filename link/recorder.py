"""Recording: every frame of a connection, received and sent, in a ``.tlog`` that every ground station opens."""

from __future__ import annotations

import os
import struct
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from models.errors import Fault, InputError

if TYPE_CHECKING:
    from io import BufferedWriter
    from pathlib import Path

    from models.clock import Clock

MAX_BYTES = 100_000_000
"""A file is closed and the next one begun beyond this."""
FLUSH_S = 0.5
_STAMP = struct.Struct(">Q")
_MAX_NAMES = 10_000


class Recorder:
    """Writes ``YYYY-mm-dd-HHMMSS-NAME.tlog``: before each frame its time in microseconds, UTC, big-endian.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    clock : Clock
        Times of the frames.
    name : str
        Part of the file's name.
    max_bytes : int
        Size at which the next file is begun.

    Raises
    ------
    InputError
        The file cannot be written: better no flight than one without a record.
    """

    def __init__(self, folder: Path, clock: Clock, *, name: str = "link", max_bytes: int = MAX_BYTES) -> None:
        self.folder, self.max_bytes = folder, max_bytes
        self._clock = clock
        self._name = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-") or "link"
        self._flushed_s = clock.now_s()
        self._written = 0
        self._last_us = 0
        self._dirty = False
        self.paths: list[Path] = []
        self._file: BufferedWriter | None = self._open()

    def _open(self) -> BufferedWriter:
        begun = datetime.fromtimestamp(self._clock.posix_s(), UTC)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for number in range(_MAX_NAMES):
                suffix = f"-{number}" if number else ""
                path = self.folder / f"{begun:%Y-%m-%d-%H%M%S}-{self._name}{suffix}.tlog"
                try:
                    opened = path.open("xb")
                except FileExistsError:
                    continue
                self.paths.append(path)
                self._written = 0
                return opened
        except OSError as error:
            problem = f"the recording cannot be written: {error.strerror or error}"
            raise InputError(Fault(problem, str(self.folder), remedy="choose another folder with --record")) from None
        raise InputError(Fault("too many recordings of the same second", str(self.folder)))

    def frame(self, data: bytes) -> None:
        """Record one frame that came, or that is about to be sent."""
        if self._file is None:
            return
        self._last_us = max(self._last_us, int(self._clock.posix_s() * 1e6))
        self._write(_STAMP.pack(self._last_us) + data)
        self._dirty = True
        self.tend()
        if self._written >= self.max_bytes:
            self._close()
            self._file = self._open()

    def _write(self, data: bytes) -> None:
        if self._file is None:
            return
        try:
            self._file.write(data)
        except OSError as error:
            raise self._failed(error) from None
        self._written += len(data)

    def _failed(self, error: OSError) -> InputError:
        problem = f"the recording cannot be written: {error.strerror or error}"
        return InputError(Fault(problem, str(self.paths[-1]), remedy="make room on the disk"))

    def tend(self) -> None:
        """Hand to the system what is older than half a second; a killed process loses less than a second."""
        if self._file is None or not self._dirty or self._clock.now_s() < self._flushed_s + FLUSH_S:
            return
        try:
            self._file.flush()
        except OSError as error:
            raise self._failed(error) from None
        self._dirty = False
        self._flushed_s = self._clock.now_s()

    def _close(self) -> None:
        if self._file is None:
            return
        try:
            with self._file:
                self._file.flush()
                os.fsync(self._file.fileno())
        except OSError as error:
            raise self._failed(error) from None
        finally:
            self._file = None

    def close(self) -> None:
        """End the recording."""
        self._close()
