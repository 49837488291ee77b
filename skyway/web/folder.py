"""The work folder: the only place that the page reads and writes files in."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.files import write_atomically

if TYPE_CHECKING:
    from collections.abc import Sequence

MISSIONS = (".plan", ".waypoints", ".mission", ".fence", ".rally", ".txt")
LOGS = (".tlog", ".bin", ".ulg", ".log", ".csv", ".jsonl")
REPORTS = (".html",)
"""Endings of missions, of logs and journals, and of reports."""
MOST_FILES = 5000
"""Limit of the files of a folder."""
MOST_NAME, MOST_BYTES = 1000, 255
"""Characters of a path within the folder, and bytes of each part of it: limits of file systems."""
MOST_SAFE = 180
"""Bytes of a name assigned by us: a number may be added to it."""
MOST_DEEP = 4
"""Folders within folders."""
_ODD = re.compile(r"[^\w.+=@-]+")
_RESERVED = frozenset({"", ".", ".."})


@dataclass(frozen=True, slots=True)
class Found:
    """A file of the folder."""

    name: str
    """Path within the folder, with slashes."""
    size: int
    """Bytes."""
    modified_s: float
    """POSIX seconds."""


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder that cannot be left by ``..``, an absolute path or a link."""

    root: Path

    def path(self, name: str) -> Path:
        """Return the path of a name within the folder. Raises an `InputError` for a path outside it, or an invalid name."""
        root = self.root.resolve()
        wrong = InputError("not a file of the work folder", field="file", value=name[:200])
        if not name or len(name) > MOST_NAME or "\0" in name or "\\" in name or Path(name).is_absolute():
            raise wrong
        try:
            longest = max(len(os.fsencode(part)) for part in name.split("/"))
            path = (root / name).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise wrong from error
        if longest > MOST_BYTES or not path.is_relative_to(root) or path == root:
            raise wrong
        return path

    def existing(self, name: str) -> Path:
        """Return the path of an existing file."""
        path = self.path(name)
        if not path.is_file():
            raise InputError("no such file in the work folder", field="file", value=name[:200])
        return path

    def files(self, *endings: str) -> list[Found]:
        """Return the files with some suffixes, the newest first; hidden folders and links are omitted."""
        found: list[Found] = []
        self._look(self.root.resolve(), 0, tuple(endings), found)
        return sorted(found, key=lambda one: (-one.modified_s, one.name))

    def _look(self, folder: Path, depth: int, endings: tuple[str, ...], found: list[Found]) -> None:
        root = self.root.resolve()
        try:
            entries = sorted(folder.iterdir())
        except OSError:
            return
        for entry in entries:
            if entry.name.startswith(".") or entry.is_symlink() or len(found) >= MOST_FILES:
                continue
            if entry.is_dir() and depth < MOST_DEEP:
                self._look(entry, depth + 1, endings, found)
            elif entry.name.lower().endswith(endings) and entry.is_file():
                state = entry.stat()
                found.append(Found(entry.relative_to(root).as_posix(), state.st_size, state.st_mtime))

    def write(self, name: str, content: bytes, *, force: bool = False) -> Path:
        """Write a file atomically; an existing one is replaced only with `force`."""
        path = self.path(name)
        if not path.parent.is_dir():
            raise InputError("no such folder in the work folder", field="file", value=name[:200])
        write_atomically(path, content, force=force)
        return path

    def free_name(self, wanted: str, taken: Sequence[str] = ()) -> str:
        """Return an unused file name: the requested one, otherwise with a number."""
        path = Path(safe_name(wanted))
        for number in range(1, 1000):
            name = path.name if number == 1 else f"{path.stem}-{number}{path.suffix}"
            if name not in taken and not self.path(name).exists():
                return name
        raise InputError("a thousand files of this name are there", field="file", value=wanted[:200])

    def free_names(self, wanted: Sequence[str]) -> list[str]:
        """Return unused names of files that belong together: as requested, otherwise all with the same number."""
        first = Path(safe_name(wanted[0])).stem
        for number in range(1, 1000):
            stem = first if number == 1 else f"{first}-{number}"
            names = [stem + safe_name(one).removeprefix(first) for one in wanted]
            if not any(self.path(name).exists() for name in names):
                return names
        raise InputError("a thousand files of this name are there", field="file", value=wanted[0][:200])


def stamp(folder: str | Path | None) -> tuple[tuple[str, int, int], ...]:
    """Return the state of the files of a folder: it changes with any file."""
    if folder is None or not Path(folder).is_dir():
        return ()
    states = ((one.name, one.stat()) for one in sorted(Path(folder).iterdir()) if one.is_file())
    return tuple((name, state.st_mtime_ns, state.st_size) for name, state in states)


def safe_name(name: str) -> str:
    """Return the name of a file without folders and special characters, at most its last 120 characters."""
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    kept = _ODD.sub("_", last).lstrip(".")
    path = Path(kept[-120:].encode()[-MOST_SAFE:].decode("utf-8", "ignore").lstrip("."))
    return "file" if path.name in _RESERVED else path.name
