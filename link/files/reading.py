"""Common parts of reading a file and reading a log: the destination of the pieces, and the reason for the end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.protocol.exchange import Exchange

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.files.part_file import Pieces
    from skyway.link.protocol.exchange import Target


class Reading(Exchange):
    """Reads from the end of the local part up to a size."""

    def __init__(
        self, target: Target, pieces: Pieces, size_bytes: int, progress: Callable[[int], None] | None = None
    ) -> None:
        super().__init__(target)
        self.pieces, self.size_bytes = pieces, size_bytes
        self.problem = ""
        """The reason for an early end; empty if it was complete."""
        self.ended_early = False
        """The vehicle reports an end before its size."""
        self.came_bytes = 0
        """Bytes received, each counted once."""
        self._progress = progress

    def _take(self, offset: int, data: bytes) -> int:
        """Store a piece; returns how many of its bytes were new."""
        new = self.pieces.put(offset, data[: max(self.size_bytes - offset, 0)])
        self.came_bytes += new
        if new and self._progress is not None:
            self._progress(self.pieces.end)
        return new

    def _end(self, problem: str) -> None:
        self.problem = problem
        self.finish()
