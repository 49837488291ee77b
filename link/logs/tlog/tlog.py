"""MAVLink telemetry logs (``.tlog``): messages found and checked at millions per second, with little memory.

A log is read in chunks, so that one of any size needs the memory of a chunk. The definition of a message is that of pymavlink
(`link.logs.tlog.tlog_kernels`).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.common.table_kernels import table_of
from skyway.link.logs.tlog import tlog_kernels as kernels
from skyway.link.logs.tlog.beginning import beginning
from skyway.link.logs.tlog.dialect import crc_extras, message_type, name_of
from skyway.link.logs.tlog.set_forward import SetForward
from skyway.link.logs.tlog.stamps import StampCheck
from skyway.link.wire import layout
from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

CHUNK_BYTES = 4 * 1024 * 1024
SEEK_EVERY = 64 * 1024
"""Bytes between the points that a replay can jump to."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """The messages of one chunk of a log, in the order they were recorded."""

    data: NDArray[np.uint8]
    """The chunk."""
    base: int
    """Position of its first byte in the log."""
    offset: NDArray[np.int64]
    """Position of each frame in the log, shape (messages,); -1 if it is not contiguous there."""
    time_s: NDArray[np.float64]
    """Stamp of the recorder's clock, POSIX seconds, unchecked, shape (messages,)."""
    number: NDArray[np.int32]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    length: NDArray[np.int32]
    """`number`, `system`, `component`, `length`: message id, sender, and bytes of the frame."""

    def __len__(self) -> int:
        return len(self.offset)

    def rows_of(self, name: str) -> NDArray[np.int64]:
        """Rows of one type of message whose payload can be read."""
        return np.flatnonzero((self.number == message_type(name).id) & (self.offset >= 0))

    def decoded(self, name: str, rows: NDArray[np.int64]) -> NDArray[np.void]:
        """Fields of messages of one type, as a structured array, shape (rows,)."""
        fields = message_type(name).layout
        start = self.offset[rows] - self.base
        second = self.data[start] == layout.MAGIC_2
        signed = second & ((self.data[np.minimum(start + layout.FLAGS_AT, len(self.data) - 1)] & layout.SIGNED) != 0)
        payload = start + np.where(second, layout.HEADER_2_BYTES, layout.HEADER_1_BYTES)
        around = np.where(second, layout.AROUND_2_BYTES, layout.AROUND_1_BYTES)
        length = self.length[rows] - around - np.where(signed, layout.SIGNATURE_BYTES, 0)
        return table_of(self.data, payload.astype(np.int64), fields, length.astype(np.int64))


def _fresh_state() -> NDArray[np.int64]:
    state = np.zeros(kernels.STATE_SIZE, dtype=np.int64)
    state[kernels.EXPECTED] = layout.AROUND_1_BYTES
    return state


@dataclass(slots=True)
class ScanState:
    """State of the parser between chunks; a copy of it at a position lets reading continue there."""

    state: NDArray[np.int64] = field(default_factory=_fresh_state)
    clock: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    kept: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(2048, dtype=np.uint8))

    def copy(self) -> ScanState:
        """Return a mutable copy."""
        return ScanState(self.state.copy(), self.clock.copy(), self.kept.copy())


def read_frames(
    path: Path, *, chunk_bytes: int = CHUNK_BYTES, begin: int = 0, memory: ScanState | None = None
) -> Iterator[Frames]:
    """Read the messages of a log in chunks of at least 64 kB.

    They begin at the stamp before a frame; 0 is the start of the log. `memory` is the state of the parser at the
    beginning; it is updated with the counts of skipped bytes. Raises an `InputError` if the file cannot be read.
    """
    memory = memory or ScanState()
    extras = crc_extras()
    buffer = np.empty(max(chunk_bytes, 1 << 16), dtype=np.uint8)
    try:
        with path.open("rb") as stream:
            stream.seek(begin)
            base, held = begin, 0
            while not memory.state[kernels.ENDED]:
                got = stream.readinto(memoryview(buffer)[held:])  # type: ignore[arg-type]
                size = held + got
                final = size < len(buffer)
                out = _rows(size // 8 + 64)
                count = kernels.scan_chunk(
                    buffer, size, base, final, memory.state, memory.clock, memory.kept, extras, out
                )
                yield Frames(buffer, base, *(column[:count] for column in out))
                cut = max(int(memory.state[kernels.POS]) - kernels.KEPT_BACK, 0)
                buffer[: size - cut] = buffer[cut:size].copy()
                held = size - cut
                base += cut
                memory.state[kernels.POS] -= cut
    except OSError as error:
        raise file_error("read", path, error) from error


def _rows(most: int) -> tuple[NDArray[Any], ...]:
    kinds = (np.int64, np.float64, np.int32, np.uint8, np.uint8, np.int32)
    return tuple(np.empty(most, dtype=kind) for kind in kinds)


@dataclass(frozen=True, slots=True, eq=False)
class TlogIndex:
    """Contents of a log, and its index by time."""

    messages: int
    """Valid messages, in pymavlink's count without BAD_DATA."""
    by_type: dict[str, int]
    """By name."""
    by_system: dict[int, int]
    """By MAVLink system id."""
    skipped_bytes: int
    bad_records: int
    """`skipped_bytes`, `bad_records`: bytes outside messages, including one that is cut off at the end, and the
    number of pieces."""
    first_s: float
    last_s: float
    """`first_s`, `last_s`: first and last plausible stamp; NaN if there is none."""
    seek_time_s: NDArray[np.float64]
    seek_offset: NDArray[np.int64]
    seek_shift_s: NDArray[np.float64]
    """`seek_time_s`, `seek_offset`, `seek_shift_s`: times, never decreasing; positions from which the log can be read;
    how far the clock had been set back by then; shape (points,). Steps forward are taken out by `forward`."""
    stamps: StampCheck
    """Problems of the stamps."""
    forward: SetForward
    """Where the recorder's clock was set forward."""
    beginning: ScanState
    """State of the parser at the start of the log."""

    def offset_at(self, time_s: float) -> tuple[int, float]:
        """Return a position in the log before everything recorded at `time_s` or later, and the clock's shift there."""
        point = int(np.searchsorted(self.seek_time_s, time_s, side="left")) - 1
        return (int(self.seek_offset[point]), float(self.seek_shift_s[point])) if point >= 0 else (0, 0.0)


def scan(
    path: Path,
    *,
    chunk_bytes: int = CHUNK_BYTES,
    watch: Callable[[Frames, NDArray[np.float64]], None] | None = None,
) -> TlogIndex:
    """Find and count every message of a log; memory does not grow with its size.

    `watch` is called with the messages of each chunk and their times.
    """
    memory, check, forward = beginning(path, ScanState()), StampCheck(), SetForward()
    begun = memory.copy()
    types: Counter[int] = Counter()
    systems = np.zeros(256, dtype=np.int64)
    points = [np.empty((3, 0))]
    first_s = math.nan
    for frames in read_frames(path, chunk_bytes=chunk_bytes, memory=memory):
        if not len(frames):
            continue
        times = check.clean(forward.see(frames))
        first_s = float(times[0]) if math.isnan(first_s) else first_s
        dense = frames.number < kernels.DENSE_IDS
        counted = np.bincount(frames.number[dense])
        types.update({int(number): int(counted[number]) for number in np.flatnonzero(counted)})
        types.update(frames.number[~dense].tolist())
        systems += np.bincount(frames.system, minlength=256)
        points.append(_seek_points(frames, times, forward))
        if watch is not None:
            watch(frames, times)
    state = memory.state
    seek_time_s, seek_offset, seek_shift_s = np.concatenate(points, axis=1)
    return TlogIndex(
        messages=sum(types.values()),
        by_type={name_of(number): count for number, count in sorted(types.items())},
        by_system={int(system): int(systems[system]) for system in np.flatnonzero(systems)},
        skipped_bytes=int(state[[kernels.BAD_BYTES, kernels.STAMP_BYTES, kernels.BUFFERED]].sum()),
        bad_records=int(state[kernels.BAD]),
        first_s=first_s,
        last_s=check.highest_s + forward.ended() if math.isfinite(check.highest_s) else math.nan,
        seek_time_s=seek_time_s,
        seek_offset=seek_offset.astype(np.int64),
        seek_shift_s=seek_shift_s,
        stamps=check,
        forward=forward,
        beginning=begun,
    )


def _seek_points(frames: Frames, times: NDArray[np.float64], forward: SetForward) -> NDArray[np.float64]:
    """One frame for every so many bytes: time, place of the stamp before it, shift of the clock there, shape (3, points)."""
    shift = times - forward.undone(frames)
    whole = np.flatnonzero((frames.offset >= 8) & (np.abs(shift) < StampCheck.REACH_S))
    first = whole[np.flatnonzero(np.diff(frames.offset[whole] // SEEK_EVERY, prepend=-1))]
    return np.stack([times[first], frames.offset[first] - 8.0, shift[first]])
