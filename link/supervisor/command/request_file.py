"""Commands by file: the operator's page appends one line for each; the supervisor reads them.

A line persists if the page is killed. The supervisor executes each request once: it journals the id of the request first.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from skyway.link.supervisor.operators import Said
from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

ENDING = ".orders"
MAX_LINE = 2048
"""Maximum length of a request, bytes."""
_PIECE = 64 * 1024
_APPENDED = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
"""Open flags; a symbolic link at the path is not followed."""


class Request(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One line: a command or an answer of a person."""

    id: str
    """Unique id; a request that is written twice counts once."""
    word: str
    """Such as ``pause``, ``divert columbia`` or ``yes``."""
    who: str
    """Browser session."""
    name: str
    """Name of the person."""
    time_s: float
    """Time of the request by this computer's clock, POSIX seconds."""
    about: int | None = None
    """Number of the journal record with the question that it answers."""


_DECODER = msgspec.json.Decoder(Request)


def request(path: Path, wanted: Request) -> None:
    """Append a request; it is on disk on return. Raises an `InputError` if it cannot be written."""
    line = msgspec.json.encode(wanted) + b"\n"
    try:
        handle = os.open(path, _APPENDED, 0o600)
        try:
            os.write(handle, line)
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        raise file_error("written", path, error) from error


@dataclass(slots=True)
class RequestFile:
    """An operator whose commands come from a file; see `link.supervisor.operators.Operator`."""

    path: Path
    show: Callable[[str], None]
    """Displays a line."""
    interrupts: int = 0
    present: bool = True
    """Always true: a person may open the page at any time."""
    _at: int = 0
    _rest: bytes = b""
    _said: deque[Said] = field(default_factory=deque)

    def __post_init__(self) -> None:
        try:
            os.close(os.open(self.path, _APPENDED, 0o600))
        except OSError as error:
            raise file_error("written", self.path, error) from error

    def tell(self, line: str) -> None:
        """Show a line."""
        self.show(line)

    def ask(self, question: str) -> None:
        """Show a question."""
        self.show(f"? {question}")

    def next_input(self) -> Said | None:
        """Return the next request of the file, with its age; invalid lines are skipped."""
        self._read()
        return self._said.popleft() if self._said else None

    def _read(self) -> None:
        try:
            with self.path.open("rb") as file:
                file.seek(self._at)
                found = file.read(_PIECE)
        except OSError:
            return  # the supervisor checks again one second later
        self._at += len(found)
        *lines, rest = (self._rest + found).split(b"\n")
        self._rest = rest if len(rest) <= MAX_LINE else b""
        for line in lines:
            with contextlib.suppress(msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                if 0 < len(line) <= MAX_LINE:
                    self._said.append(_said(_DECODER.decode(line)))


def _said(requested: Request) -> Said:
    name = "".join(one for one in requested.name[:40] if one.isprintable()).strip()
    age_s = max(time.time() - requested.time_s, 0.0)
    return Said(
        requested.word[:120],
        id=requested.id[:64],
        who=requested.who[:64],
        name=name,
        about=requested.about,
        age_s=age_s,
    )
