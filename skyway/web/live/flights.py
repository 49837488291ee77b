"""Flights in separate processes: found by their files in the work folder, shown, commanded, started.

All state here comes from the files. A page that was killed and restarted has the same state.
"""

from __future__ import annotations

import math
import os
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.flights import starting
from skyway.flights.live import LIVE, Live, read_live
from skyway.flying import journal_name
from skyway.link.supervisor.command.request_file import Request, request
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.base.files import write_atomically
from skyway.models.base.json_text import plain
from skyway.web.live.journal_tail import JournalTail

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Sequence

    from skyway.web.folder import Folder

KEPT_S = 3600.0
"""A flight that has ended is shown for this long."""
SILENT_S = 10.0
"""A flight whose program has written nothing for this long may have lost it."""
LOOK_S = 0.4
MOST = 64
_DRAWN = ("lat", "lon", "course_deg", "silent_s")
_TAIL = 40
"""Number of output lines of a failed program that are shown."""


class Flights:
    """All flights of a work folder."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self._looked_s = -1.0
        self._known: dict[str, tuple[float, Live]] = {}
        self._tails: dict[str, JournalTail] = {}
        self._started: list[subprocess.Popen[bytes]] = []

    # State

    def known(self) -> dict[str, Live]:
        """Return the flights in progress, and those that have ended recently, by the name of their journal without its suffix."""
        now_s = time.monotonic()
        if now_s >= self._looked_s + LOOK_S:
            self._looked_s = now_s
            self._look()
        return {name: live for name, (_, live) in self._known.items()}

    def _look(self) -> None:
        self._started = [one for one in self._started if one.poll() is None]  # otherwise they stay as zombies
        found: dict[str, tuple[float, Live]] = {}
        try:
            with os.scandir(self.folder.root) as entries:
                files = [one for one in entries if one.name.endswith(LIVE) and not one.name.startswith(".")]
        except OSError:
            files = []
        oldest_s = time.time() - KEPT_S
        for entry in files[: 4 * MOST]:
            try:
                changed_s = entry.stat(follow_symlinks=False).st_mtime
                if entry.is_symlink() or not entry.is_file():
                    continue
                journal = self.folder.path(f"{entry.name.removesuffix(LIVE)}.jsonl")
                if journal.exists() and not journal.is_file():
                    continue
                before = self._known.get(entry.name.removesuffix(LIVE))
                live = before[1] if before is not None and before[0] == changed_s else read_live(Path(entry.path))
            except (OSError, SkywayError):
                continue
            if changed_s >= oldest_s or (not live.ended and _runs(live.pid)):
                found[entry.name.removesuffix(LIVE)] = changed_s, live
        newest = sorted(found.items(), key=lambda one: -one[1][0])[:MOST]
        self._known = dict(sorted(newest))
        self._tails = {name: tail for name, tail in self._tails.items() if name in self._known}

    def digest(self) -> list[dict[str, Any]]:
        """Return a row for each flight."""
        wall_s = time.time()
        return [
            {
                "name": name, "state": live.state, "doing": live.doing, "ended": live.ended, "problem": live.problem,
                "origin": live.origin, "destination": live.destination, "question": live.question, "holder": live.holder,
                "silent": not live.ended and wall_s - live.wall_s > SILENT_S,
                "vehicle": live.vehicle | {one: _number(live.vehicle.get(one)) for one in _DRAWN},
                "track": self._tail(name).course(), "way": _places((live.leg or {}).get("way")), "to": (live.leg or {}).get("to"),
            }
            for name, live in self.known().items()
        ]  # fmt: skip

    def _tail(self, name: str) -> JournalTail:
        tail = self._tails.get(name)
        if tail is None:
            tail = self._tails[name] = JournalTail(self.folder.path(f"{name}.jsonl"))
        tail.read()
        return tail

    def told(self, name: str, seen: int, session: str) -> dict[str, Any]:
        """Return all known data of a flight, and its journal's entries since a given record."""
        live = self.known().get(name)
        if live is None:
            raise InputError("no such flight in the work folder", field="flight", value=name[:100])
        runs = not live.ended and _runs(live.pid)
        return {
            "name": name, "live": plain(live) | {"words": []}, "runs": runs, "age_s": round(time.time() - live.wall_s, 1),
            "mine": live.holder is not None and live.holder.get("id") == session, "me": session,
            "printed": "" if runs else self._printed(name), **self._tail(name).since(seen),
        }  # fmt: skip

    def _printed(self, name: str) -> str:
        try:
            with self.folder.path(f"{name}{starting.OUTPUT}").open("rb") as file:
                file.seek(max(file.seek(0, os.SEEK_END) - 8192, 0))
                text = file.read().decode("utf-8", "replace")
        except OSError:
            return ""
        return "\n".join(text.splitlines()[-_TAIL:])

    # Actions

    def order(self, name: str, asked: Request) -> None:
        """Send a command to a flight; its supervisor decides whether it is accepted, and answers in the journal."""
        live = self.known().get(name)
        if live is None or live.ended:
            raise InputError("is not a flight under way", field="flight", value=name[:100])
        orders, _, _ = starting.files_of(self.folder.path(f"{name}.jsonl"))
        request(orders, asked)

    def begin(self, options: starting.FlightOptions, origin: str, destination: str) -> str:
        """Start a flight; returns its name. It requires a confirmation before the take-off."""
        words = options.words()
        wanted = journal_name(origin, destination, datetime.now(UTC))
        journal = self.folder.path(self.folder.free_name(wanted))
        self._start([*words, *starting.channel(journal)], journal)
        return journal.stem

    def resume(self, name: str) -> None:
        """Continue a flight whose program has ended before its delivery was complete."""
        live = self.known().get(name)
        if live is None or (not live.ended and _runs(live.pid)):
            raise InputError("is under way, or was never started", field="flight", value=name[:100])
        journal = self.folder.existing(f"{name}.jsonl")
        self._start(starting.resumed(live.words, journal), journal)

    def _start(self, words: Sequence[str], journal: Path) -> None:
        _, live, output = starting.files_of(journal)
        process = starting.start(words, output)
        self._started.append(process)
        if not live.exists():  # until it reports its state
            write_atomically(live, _first(process.pid, words, journal), force=True)
        self._looked_s = -1.0


def _number(value: object) -> float | None:
    return value if isinstance(value, (int, float)) and math.isfinite(value) else None


def _places(way: object) -> list[list[float]]:
    """Return the valid places of a way: the map draws all flights, and one damaged file must not prevent that."""
    pairs = [one for one in (way if isinstance(way, list) else []) if isinstance(one, list) and len(one) == 2]
    return [one for one in pairs if None not in map(_number, one)]


def _first(pid: int, words: Sequence[str], journal: Path) -> bytes:
    import msgspec

    first = Live(
        pid=pid, words=list(words), journal=journal.name, wall_s=time.time(), doing="the program of the flight starts"
    )
    return msgspec.json.encode(first)


def _runs(pid: int) -> bool:
    """Whether a process exists; one that has ended but was not yet waited for counts as gone."""
    try:
        os.kill(pid, 0)
        return " Z " not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[-1][:4]
    except (PermissionError, FileNotFoundError):
        return pid > 0
    except (OSError, OverflowError):
        return False
