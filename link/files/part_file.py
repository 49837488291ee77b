"""A file that arrives in pieces, some late and some twice: the complete part from the beginning is written at once."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from collections.abc import Iterator

_AHEAD_BYTES = 8_000_000
"""Limit of the data that wait for an earlier piece; further pieces must be sent again."""


class Pieces:
    """Pieces of one file, written to a stream in order; only whole beginnings are ever written."""

    def __init__(self, stream: BinaryIO, end: int = 0) -> None:
        self._stream = stream
        self.end = end
        """Everything before is written."""
        self.top = end
        """No data have arrived after this."""
        self._holes: list[tuple[int, int]] = []
        self._waiting: list[tuple[int, bytes]] = []
        self._waiting_bytes = 0

    def put(self, offset: int, data: bytes) -> int:
        """Store a piece; returns how many of its bytes are new. Raises an `OSError` if it cannot be written."""
        last = offset + len(data)
        if not data or last <= self.end or self._waiting_bytes > _AHEAD_BYTES < offset - self.end:
            return 0
        new = max(last - max(offset, self.top), 0)
        if offset > self.top:
            self._holes.append((self.top, offset))
        if self._holes and offset < self.top:
            new += self._fill(offset, last)
        self.top = max(self.top, last)
        if new and offset > self.end:
            heapq.heappush(self._waiting, (offset, data))
            self._waiting_bytes += len(data)
        elif new:
            self._write(offset, data)
        return new

    def _fill(self, first: int, last: int) -> int:
        left, filled = [], 0
        for begin, end in self._holes:
            if last <= begin or first >= end:
                left.append((begin, end))
                continue
            filled += min(end, last) - max(begin, first)
            if begin < first:
                left.append((begin, first))
            if last < end:
                left.append((last, end))
        self._holes = left
        return filled

    def _write(self, offset: int, data: bytes) -> None:
        self._stream.write(data[self.end - offset :])
        self.end = offset + len(data)
        while self._waiting and self._waiting[0][0] <= self.end:
            begin, piece = heapq.heappop(self._waiting)
            self._waiting_bytes -= len(piece)
            if begin + len(piece) > self.end:
                self._stream.write(piece[self.end - begin :])
                self.end = begin + len(piece)

    def holes(self, piece_bytes: int) -> Iterator[tuple[int, int]]:
        """Yield offset and length of the missing parts before `top`, in pieces of at most the given size."""
        for begin, end in self._holes:
            for offset in range(begin, end, piece_bytes):
                yield offset, min(piece_bytes, end - offset)
