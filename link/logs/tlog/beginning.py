"""The start of a tlog as read by pymavlink: the first message of each type.

The resulting state of its parser, mainly the time of a good message, determines how a log with missing first bytes is read, so the
same is done here. It walks from header to header and reads ten bytes a message.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.common.pieces import PIECE_BYTES
from skyway.link.logs.tlog import tlog_kernels as kernels
from skyway.link.logs.tlog.dialect import crc_extras
from skyway.link.wire.layout import ID_AT_1, ID_AT_2, MAGIC_1, MAGIC_2, MAX_FRAME_BYTES
from skyway.models.base.files import file_error

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

    from skyway.link.logs.tlog.tlog import ScanState

WINDOW_BYTES = 1 << 16


def beginning(path: Path, fresh: ScanState) -> ScanState:
    """Return the parser's state at the start of a log."""
    seen = np.zeros(kernels.DENSE_IDS, dtype=np.bool_)
    extras = crc_extras()
    try:
        with path.open("rb") as stream, path.open("rb") as beside:
            place, buffer = 0, np.empty(PIECE_BYTES, dtype=np.uint8)
            while True:
                stream.seek(place)
                size = stream.readinto(memoryview(buffer))  # type: ignore[arg-type]
                at, step, final = 0, 1, size < PIECE_BYTES
                while step > 0:
                    at, step = kernels.walk(buffer, size, at, final, extras, seen)
                    if step > 0 and not _hear(beside, place + at, fresh):
                        return type(fresh)()  # pymavlink does not open such a log: begin without a state
                    at += max(step, 0)
                if final or step < 0:
                    break
                place += at
    except OSError as error:
        raise file_error("read", path, error) from error
    state = fresh.state
    state[[kernels.POS, kernels.ENDED, kernels.BAD, kernels.BAD_BYTES, kernels.STAMP_BYTES]] = 0
    return fresh


def _hear(stream: BinaryIO, place: int, memory: ScanState) -> bool:
    """Let the parser read one message at a position; False if it finds none until the end of the log."""
    wanted = WINDOW_BYTES
    while True:
        stream.seek(place)
        data = np.frombuffer(stream.read(wanted), dtype=np.uint8)
        state, clock, kept = memory.state.copy(), memory.clock.copy(), memory.kept.copy()
        state[kernels.POS] = 0
        found = kernels.read_one(data, state, clock, kept, crc_extras())
        if state[kernels.POS] < len(data) - kernels.MARGIN or len(data) < wanted:
            memory.state[:], memory.clock[:], memory.kept[:] = state, clock, kept
            return bool(found >= 0)
        wanted *= 4


def frame_within(head: bytes) -> bool:
    """Return whether a complete frame follows a time stamp anywhere: a tlog whose beginning is cut or damaged."""
    extras, data = crc_extras(), np.frombuffer(head, dtype=np.uint8)
    for at in np.flatnonzero((data == MAGIC_1) | (data == MAGIC_2)).tolist():
        if at < kernels.STAMP_SIZE or at + MAX_FRAME_BYTES > len(data):
            continue
        total = kernels.announced(data, at)
        number = (
            data[at + ID_AT_1] if data[at] == MAGIC_1 else data[at + ID_AT_2] | data[at + ID_AT_2 + 1].astype(int) << 8
        )
        if (
            data[at - kernels.STAMP_SIZE] == 0
            and extras[number] >= 0
            and kernels.frame_is_good(data, at, total, extras)
        ):
            return True
    return False
