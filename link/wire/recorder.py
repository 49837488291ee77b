"""Recording of every frame of a connection in a ``.tlog``."""

from __future__ import annotations

import contextlib
import os
import struct
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from io import FileIO
    from pathlib import Path

    from skyway.models.base.clock import Clock

MAX_BYTES = 100_000_000
"""Size at which a file is closed and the next one begun."""
_STAMP = struct.Struct(">Q")
_MAX_NAMES = 10_000


class Recorder:
    """Writes ``YYYY-mm-dd-HHMMSS-NAME.tlog``: before each frame its time in microseconds, UTC, big-endian.

    The folder is created if missing; the next file starts at `max_bytes`. If it cannot be written, an
    `InputError` is raised: a flight without a record is not allowed.
    """

    def __init__(self, folder: Path, clock: Clock, *, name: str = "link", max_bytes: int = MAX_BYTES) -> None:
        self.folder, self.max_bytes = folder, max_bytes
        self._clock = clock
        self._name = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-") or "link"
        self._written = 0
        self._last_us = 0
        self.problem = ""
        """Reason for an early end; empty if there was none."""
        self.paths: list[Path] = []
        self._file: FileIO | None = self._open()

    def _open(self) -> FileIO:
        begun = datetime.fromtimestamp(self._clock.posix_s(), UTC)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for number in range(_MAX_NAMES):
                suffix = f"-{number}" if number else ""
                path = self.folder / f"{begun:%Y-%m-%d-%H%M%S}-{self._name}{suffix}.tlog"
                try:
                    opened = path.open("xb", buffering=0)
                except FileExistsError:
                    continue
                self.paths.append(path)
                self._written = 0
                return opened
        except OSError as error:
            problem = f"the recording cannot be written: {error.strerror or error}"
            raise InputError(Fault(problem, str(self.folder), remedy="choose another folder with --record")) from error
        raise InputError(Fault("too many recordings of the same second", str(self.folder)))

    def frame(self, data: bytes) -> None:
        """Record one frame that was received, or is about to be sent; a killed process has lost none.

        A disk that fails ends the recording and not the link, since the vehicle may be in the air: see `problem`.
        """
        if self._file is None:
            return
        self._last_us = max(self._last_us, int(self._clock.posix_s() * 1e6))
        rest = _STAMP.pack(self._last_us) + data
        self._written += len(rest)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            if self._written >= self.max_bytes:
                self.close()
                self._file = self._open()
        except OSError as error:
            self._fail(f"the recording ends: {error.strerror or error}")
        except InputError as error:
            self._fail(str(error))

    def _fail(self, problem: str) -> None:
        self.problem = self.problem or problem
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()
        self._file = None

    def close(self) -> None:
        """End the recording."""
        if self._file is None:
            return
        try:
            with self._file:
                os.fsync(self._file.fileno())
        except OSError as error:
            self._fail(f"the recording may be incomplete: {error.strerror or error}")
        self._file = None
