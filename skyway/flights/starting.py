"""Starting flights in separate processes that survive the process that started them."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.flights.live import LIVE
from skyway.link.supervisor.command.request_file import ENDING
from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

OUTPUT = ".out"
"""Ending of the file with what a flight's program prints."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """Options of a flight, as typed; empty means default."""

    plan: str = ""
    """File of the plan."""
    connect: str = ""
    pads: str = "manual"
    drag: str = ""
    """File of the drone's drag."""
    release: str = ""
    """Else as planned."""
    scenario: str = ""
    """Folder of the scenario; else the one named in the plan."""
    elevation: str = ""
    """Heights of the ground that the plan lacks: ``STATION=METRES``, separated by commas or spaces."""
    each: bool = False
    """Ask before each take-off, not only before the first."""
    asks: bool = True
    """Ask at all: a demonstration departs by itself."""
    keep: bool = False
    """Set no parameters."""
    given: tuple[str, ...] = ()
    """More words, such as ``--forecast FILE``."""

    def words(self) -> list[str]:
        """Return the command, after ``skyway``."""
        if not self.plan:
            raise InputError("choose the plan to be flown", field="plan")
        for field, value in (
            ("plan", self.plan),
            ("connection", self.connect),
            ("pads", self.pads),
            ("drag", self.drag),
            ("ground heights", self.elevation),
        ):
            if value.startswith("-") or len(value) > 1000:
                raise InputError("cannot begin with a hyphen", field=field, value=value[:80])
        if not self.connect:
            remedy = "such as udpin:127.0.0.1:14540, tcp:127.0.0.1:5760 or /dev/ttyUSB0,57600"
            raise InputError("give the connection of the drone", field="connection", remedy=remedy)
        named = [("--pads", self.pads), ("--drag", self.drag), ("--scenario", self.scenario)]
        words = ["fly", self.plan, "--connect", self.connect]
        words += [word for option, value in named if value for word in (option, value)]
        words += [word for one in self.elevation.replace(",", " ").split() for word in ("--elevation", one)]
        words += ["--release", self.release] if self.release else []
        words += ["--manual"] if self.each else []
        words += [] if self.asks else ["--yes"]
        words += ["--keep-parameters"] if self.keep else []
        return [*words, *self.given]


def channel(journal: Path) -> list[str]:
    """Return the options that let a flight be commanded by a file, and have its journal there."""
    return [
        "--journal",
        str(journal),
        "--record",
        str(journal.parent / "recordings"),
        "--orders",
        str(journal.with_suffix(ENDING)),
    ]


def resumed(words: Sequence[str], journal: Path) -> list[str]:
    """Return the command that continues a flight, of the one that began it; an `InputError` refuses any other command."""
    if not words or words[0] != "fly" or str(journal) not in words:
        raise InputError(
            "was not started here, and cannot be continued here", str(journal), remedy="skyway fly --resume"
        )
    at = list(words).index(str(journal)) - 1
    if words[at] not in ("--journal", "--resume"):
        raise InputError(
            "was not started here, and cannot be continued here", str(journal), remedy="skyway fly --resume"
        )
    return [*words[:at], "--resume", *words[at + 1 :]]


def start(words: Sequence[str], output: Path) -> subprocess.Popen[bytes]:
    """Start a command of skyway that outlives this process, until its work is done; it prints into a file."""
    try:
        with open(output, "ab", opener=_plain) as file:
            return subprocess.Popen(  # noqa: S603  our own command, its words as a list
                [sys.executable, "-m", "skyway", *words], stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
                start_new_session=True, close_fds=True, env=dict(os.environ),
            )  # fmt: skip
    except OSError as error:
        raise file_error("written", output, error) from error


def _plain(path: str, flags: int) -> int:
    """Open a file, but no link that somebody has put there in its place."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o600)


def files_of(journal: Path) -> tuple[Path, Path, Path]:
    """Return the files of orders, of what is known now, and of what was printed, beside a journal."""
    return journal.with_suffix(ENDING), journal.with_suffix(LIVE), journal.with_suffix(OUTPUT)
