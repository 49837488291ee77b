"""The card of a simulated vehicle: folders and files with their contents, and the location of the family's logs."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(slots=True)
class StoredFile:
    """One file."""

    content: bytearray
    time_utc: int = 0
    """When it was written, POSIX seconds; 0 where the vehicle did not know the time."""


@dataclass(slots=True)
class Card:
    """Files by their paths, which begin with a slash."""

    files: dict[str, StoredFile] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)
    """Folders that are there, also without files."""

    def put(self, path: str, content: bytes, time_utc: int = 0) -> StoredFile:
        """Write a file, with its parent folders."""
        made = self.files[path] = StoredFile(bytearray(content), time_utc)
        parts = path.split("/")
        self.folders.update("/".join(parts[:end]) for end in range(2, len(parts)))
        return made

    def entries(self, folder: str) -> list[tuple[str, StoredFile | None]] | None:
        """Names in a folder, folders first (without a file); None where the folder does not exist."""
        head = folder.rstrip("/") + "/"
        if head != "/" and head[:-1] not in self.folders:
            return None
        inner = sorted(f[len(head) :] for f in self.folders if f.startswith(head) and "/" not in f[len(head) :])
        here = sorted(f[len(head) :] for f in self.files if f.startswith(head) and "/" not in f[len(head) :])
        found: list[tuple[str, StoredFile | None]] = [(name, None) for name in inner]
        return found + [(name, self.files[head + name]) for name in here]

    def logs(self, endings: Sequence[str]) -> list[tuple[str, StoredFile]]:
        """Files with such endings, in the order in which they were written."""
        return [(path, one) for path, one in self.files.items() if path.lower().endswith(tuple(endings))]


def filler(size: int, head: bytes, seed: str) -> bytes:
    """Bytes that look like a log: its first bytes, and noise."""
    noise = random.Random(seed).randbytes(max(size - len(head), 0))  # noqa: S311
    return (head + noise)[:size]
