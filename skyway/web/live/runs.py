"""Commands of skyway that the page runs in separate processes: an upload, a watch. The page only reads their output.

Such a process continues when the page ends or is restarted, like the supervisor of a flight, whose journal the page reads.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import tempfile
from collections import deque
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

KEPT = 400
"""Number of lines of a run that are kept."""
LONGEST = 64 * 1024
"""Bytes of a line."""
FOLLOW_S = 0.1
"""Interval between reads of a command's output."""
PROGRESS = "SKYWAY_PROGRESS"
"""If set, a command prints its progress line by line although its output is not a terminal."""


@dataclass(slots=True)
class Run:
    """A running command.

    Attributes
    ----------
    words : sequence of str
        After ``skyway``.
    told : callable
        Called with each line of its output.
    outlives : bool
        Whether it continues when the page is killed, as an upload must: then it prints to a file. Otherwise it ends then: it prints to a pipe.
    lines : deque of str
        The newest lines.
    code : int or None
        Exit code, once it has ended.
    """

    words: Sequence[str]
    told: Callable[[str], None]
    outlives: bool = False
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT))
    code: int | None = None
    _process: asyncio.subprocess.Process | None = None

    async def finished(self) -> int:
        """Run it until its end; returns the exit code."""
        if self.outlives:
            with tempfile.TemporaryFile() as output:
                return await self._run(output.fileno(), output)
        return await self._run(asyncio.subprocess.PIPE, None)

    async def _run(self, stdout: int, output: IO[bytes] | None) -> int:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "skyway", *self.words, stdin=asyncio.subprocess.DEVNULL, stdout=stdout,
            stderr=asyncio.subprocess.STDOUT, env={**os.environ, PROGRESS: "1"}, start_new_session=True, limit=LONGEST,
        )  # fmt: skip
        self._process = process
        if output is None and process.stdout is not None:
            with contextlib.suppress(ValueError):  # a line that is too long ends the reading, not the command
                async for line in process.stdout:
                    self._take(line)
        elif output is not None:
            await self._follow(process, output)
        self.code = await process.wait()
        return self.code

    async def _follow(self, process: asyncio.subprocess.Process, output: IO[bytes]) -> None:
        """Read the additions to a file until the process has ended; the process writes through a position of its own."""
        at, rest, ended = 0, b"", False
        while not ended:
            ended = process.returncode is not None
            found = os.pread(output.fileno(), LONGEST, at)
            at += len(found)
            *whole, rest = (rest + found).split(b"\n")
            for line in whole:
                self._take(line)
            if found:
                ended = False
            elif not ended:
                await asyncio.sleep(FOLLOW_S)
        if rest:
            self._take(rest)

    def _take(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace").rstrip("\n")
        self.lines.append(text)
        self.told(text)

    def stop(self) -> None:
        """Request its end, as Ctrl-C does."""
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGINT)
