"""Kernels that find and check the frames of a tlog.

A tlog is a row of 8-byte time stamps (big-endian microseconds) each followed by one MAVLink frame. What counts as
a message where bytes are damaged is decided as pymavlink does, byte for byte: it takes a stamp, then as many bytes as
the parser asks for, and keeps what the parser has not used for the next message. Agreement matters more here
than cleverness, for people compare counts.

Frames, by bytes (n is the length of the payload, id is least significant byte first; places: `link.wire.layout`):

- MAVLink 1: 0xFE, n, sequence, system, component, id, payload (n), checksum (2): n + 8;
- MAVLink 2: 0xFD, n, incompatible flags, compatible flags, sequence, system, component, id (3), payload (n), checksum
  (2) and, where bit 0 of the incompatible flags is set, a signature (13): n + 12 or n + 25.

The checksum is CRC-16/MCRF4XX, least significant byte first, of all bytes between the first and itself and then of one
extra byte of the message type: from c = 0xFFFF, c <- (c >> 8) xor T[(c xor byte) & 0xFF], T the table of the polynomial
0x8408.

Source: MAVLink 2 serialisation (https://mavlink.io/en/guide/serialization.html); `mavutil.mavlogfile` of pymavlink.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.wire.layout import (
    AROUND_1_BYTES,
    AROUND_2_BYTES,
    CHECKSUM_BYTES,
    FLAGS_AT,
    HEADER_2_BYTES,
    ID_AT_1,
    ID_AT_2,
    LENGTH_AT,
    MAGIC_1,
    MAGIC_2,
    MAX_FRAME_BYTES,
    SENDER_AT_1,
    SENDER_AT_2,
    SIGNATURE_BYTES,
    SIGNED,
)
from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

STAMP_SIZE = 8
"""Bytes of a time stamp."""
MARGIN = 8192
"""A chunk is left this far before its end, unless it is the last: no step of the parser looks further."""
KEPT_BACK = 1024
"""Bytes before the next one that a new chunk repeats, so that frames in the parser's buffer are found in it."""
DENSE_IDS = 65536
"""Every message type of the dialects lies below this id."""
STAMP_REACH_S = 3 * 24 * 3600.0
"""After bad bytes a stamp further than this from the last good one is not believed."""
POS, BUFFERED, EXPECTED, HAVE_LAST, LAST_BAD, ENDED, BAD, BAD_BYTES, STAMP_BYTES = range(9)
"""Places in the state: next byte of the chunk, bytes kept back, bytes the parser wants, whether a good message came
yet, whether the last one was bad, whether the log is over, bad records, their bytes, bytes passed looking for a
stamp."""
STATE_SIZE = 9
HEADER = STAMP_SIZE + HEADER_2_BYTES
"""Bytes from a stamp to the end of the longest header."""
FRAME = 1024
"""Where in the parser's memory a complete frame is laid."""


def _crc_table() -> NDArray[np.int64]:
    """Return T of the checksum: each byte value shifted out bit by bit."""
    table = np.zeros(256, dtype=np.int64)
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
        table[value] = crc
    return table


CRC_TABLE = _crc_table()


@compiled
def _message_id(data: NDArray[np.uint8], at: int) -> int:
    """Id of the message in the frame that begins at `at`, whose header is whole."""
    if data[at] == MAGIC_1:
        return int(data[at + ID_AT_1])
    return int(data[at + ID_AT_2]) | (int(data[at + ID_AT_2 + 1]) << 8) | (int(data[at + ID_AT_2 + 2]) << 16)


@compiled
def frame_is_good(data: NDArray[np.uint8], at: int, total: int, crc_extra: NDArray[np.int16]) -> bool:
    """Whether a frame that begins at `at` and has `total` bytes passes the checks; an unknown type always does.

    Takes any bytes, and any place in them: a frame that is cut off is not good. `crc_extra` is that of `scan_chunk`.
    """
    # Bytes behind the payload, and the message type, by version; unknown incompatible flags are refused.
    tail = CHECKSUM_BYTES
    if data[at] == MAGIC_2:
        if data[at + FLAGS_AT] & ~SIGNED:
            return False
        if data[at + FLAGS_AT] & SIGNED:
            tail += SIGNATURE_BYTES
    number = _message_id(data, at)
    # An unknown type has no extra byte, so its checksum cannot be computed.
    extra = int(crc_extra[number]) if number < DENSE_IDS else -1
    if extra < 0:
        return True
    # The checksum over all bytes after the first, then over the extra byte.
    crc = 0xFFFF
    end = at + total - tail
    for place in range(at + 1, end):
        crc = (crc >> 8) ^ CRC_TABLE[(crc ^ data[place]) & 0xFF]
    crc = (crc >> 8) ^ CRC_TABLE[(crc ^ extra) & 0xFF]
    # As it is sent, least significant byte first.
    return (int(data[end]) | (int(data[end + 1]) << 8)) == crc


@compiled
def stamp(data: NDArray[np.uint8], at: int) -> float:
    """Seconds of the 8-byte stamp at `at`."""
    value = np.uint64(0)
    for place in range(at, at + 8):
        value = (value << np.uint64(8)) | np.uint64(data[place])
    return float(value) * 1.0e-6


@compiled
def _take_stamp(
    data: NDArray[np.uint8], stop: int, size: int, state: NDArray[np.int64], clock: NDArray[np.float64]
) -> bool:
    """Take the stamp before a message; after bad bytes search for a plausible one. False: continue in the next chunk.

    A stamp is plausible if it is at most `STAMP_REACH_S` from that of the last good message, ``clock[1]``.
    Arguments as of `scan_chunk`; `stop` is where a chunk ends that is not the last.
    """
    # Too few bytes for a stamp: the log is over.
    if size - state[POS] < 8:
        state[POS] = size
        return True
    at = state[POS] + 8
    time_s = stamp(data, at - 8)
    # After a bad record: byte by byte until a stamp is plausible.
    if state[HAVE_LAST] and state[LAST_BAD]:
        while abs(time_s - clock[1]) > STAMP_REACH_S and at < size:
            if stop < size and at > stop:
                state[POS] = at - 8
                return False
            at += 1
            state[STAMP_BYTES] += 1
            time_s = stamp(data, at - 8)
    state[POS] = at
    clock[0] = time_s
    return True


@compiled
def _record(
    data: NDArray[np.uint8],
    at: int,
    total: int,
    place: int,
    row: int,
    state: NDArray[np.int64],
    clock: NDArray[np.float64],
    out: tuple[NDArray[Any], ...],
) -> None:
    """Write a good frame, which begins at `at` of `data` and at `place` of the log, into a row of `out`."""
    offset, times, number, system, component, length = out
    offset[row] = place
    times[row] = clock[0]
    length[row] = total
    number[row] = _message_id(data, at)
    sender = at + (SENDER_AT_2 if data[at] == MAGIC_2 else SENDER_AT_1)
    system[row] = data[sender]
    component[row] = data[sender + 1]
    state[HAVE_LAST] = 1
    state[LAST_BAD] = 0
    clock[1] = clock[0]


@compiled
def _bad(state: NDArray[np.int64], count: int) -> None:
    """Count a bad record of a number of bytes."""
    state[LAST_BAD] = 1
    state[BAD] += 1
    state[BAD_BYTES] += count


@compiled
def _drop(kept: NDArray[np.uint8], used: int, have: int, state: NDArray[np.int64]) -> None:
    """Forget the first `used` of the `have` bytes in the parser's buffer."""
    for step in range(used, have):
        kept[step - used] = kept[step]
    state[BUFFERED] = have - used


@compiled
def _buffered_message(
    data: NDArray[np.uint8],
    size: int,
    state: NDArray[np.int64],
    kept: NDArray[np.uint8],
    crc_extra: NDArray[np.int16],
) -> int:
    """Read one message through the parser's buffer; a good frame ends up at kept[FRAME:].

    The steps of pymavlink's parser: take the bytes it asks for; discard bytes before a start marker; ask for the rest
    of the frame once its head gives the length; check it when it is complete. Arguments as of `scan_chunk`.

    Returns the length of a good frame, 0 for a bad record, -1 where the bytes end.
    """
    while True:
        # Take the bytes that the parser asks for, at least one, as far as there are any.
        have = state[BUFFERED]
        new = min(max(state[EXPECTED] - have, 1), size - state[POS])
        for step in range(new):
            kept[have + step] = data[state[POS] + step]
        state[POS] += new
        have += new
        state[BUFFERED] = have
        # No frame begins here: all bytes up to the next start marker are one bad record.
        if have >= 1 and kept[0] != MAGIC_2 and kept[0] != MAGIC_1:
            used = 1
            while used < have and kept[used] != MAGIC_2 and kept[used] != MAGIC_1:
                used += 1
            state[EXPECTED] = AROUND_1_BYTES
            _drop(kept, used, have, state)
            _bad(state, used)
            return 0
        # The head gives the length of the frame.
        shortest = AROUND_2_BYTES if have >= 1 and kept[0] == MAGIC_2 else AROUND_1_BYTES
        if have >= 3:
            state[EXPECTED] = int(kept[LENGTH_AT]) + shortest
            if kept[0] == MAGIC_2 and kept[FLAGS_AT] & SIGNED:
                state[EXPECTED] += SIGNATURE_BYTES
        # A complete frame: set it aside, keep what follows for the next message, and check it.
        if state[EXPECTED] >= shortest and have >= max(state[EXPECTED], 3):
            total = state[EXPECTED]
            state[EXPECTED] = shortest
            for step in range(total):
                kept[FRAME + step] = kept[step]
            _drop(kept, total, have, state)
            if frame_is_good(kept, FRAME, total, crc_extra):
                return total
            _bad(state, total)
            return 0
        # Nothing more to take.
        if new == 0:
            return -1


@compiled
def _place_of(data: NDArray[np.uint8], kept: NDArray[np.uint8], found: int, state: NDArray[np.int64]) -> int:
    """Return where in the chunk a buffered frame lies in one piece, or -1.

    The frame ends where the bytes still in the buffer begin, unless a stamp was taken in between; so the bytes are
    compared.
    """
    place = state[POS] - state[BUFFERED] - found
    if place < 0:
        return -1
    for step in range(found):
        if data[place + step] != kept[FRAME + step]:
            return -1
    return place


@compiled
def announced(data: NDArray[np.uint8], at: int) -> int:
    """Bytes of the frame whose header begins at `at`; 0 where none does.

    Takes any bytes, and any place in them.
    """
    if data[at] == MAGIC_2:
        return int(data[at + LENGTH_AT]) + AROUND_2_BYTES + SIGNATURE_BYTES * (int(data[at + FLAGS_AT]) & SIGNED)
    return int(data[at + LENGTH_AT]) + AROUND_1_BYTES if data[at] == MAGIC_1 else 0


@compiled
def scan_chunk(
    data: NDArray[np.uint8],
    size: int,
    base: int,
    final: bool,
    state: NDArray[np.int64],
    clock: NDArray[np.float64],
    kept: NDArray[np.uint8],
    crc_extra: NDArray[np.int16],
    out: tuple[NDArray[Any], ...],
) -> int:
    """Find the messages of a chunk.

    A complete frame in the chunk, with the parser's buffer empty, is checked in place; any other goes through the
    buffer, byte for byte as in pymavlink. Both leave the parser in the same state.

    Takes any bytes, and a state of `STATE_SIZE`.

    Parameters
    ----------
    data, size : ndarray of uint8, int
        The bytes, and how many of them count.
    base : int
        Place of the first of them in the log.
    final : bool
        Whether the log ends with them.
    state : ndarray of int64, shape (`STATE_SIZE`,)
        What the parser remembers, by the names of its places in this module.
    clock : ndarray of float64, shape (2,)
        Times of the last stamp and of the last good message, POSIX seconds.
    kept : ndarray of uint8, shape (2048,)
        The parser's buffer; a complete frame is laid from `FRAME` on.
    crc_extra : ndarray of int16, shape (65536,)
        Extra byte of each message type, -1 where the type is unknown.
    out : tuple of ndarray
        Filled, each of one length: offset in the log (-1 where a frame is not in one piece), time in POSIX seconds, id,
        system, component, length of each frame.

    Returns
    -------
    int
        Messages found; ``state[POS]`` says how far the parser came.
    """
    row = 0
    stop = size if final else size - MARGIN
    while not state[ENDED] and (final or state[POS] < stop) and row < len(out[0]):
        if not _take_stamp(data, stop, size, state, clock):
            break
        # The usual case, an empty buffer and room for the longest frame: check it in place.
        at = state[POS]
        if state[BUFFERED] == 0 and size - at >= MAX_FRAME_BYTES:
            total = announced(data, at)
            if total >= state[EXPECTED]:
                state[POS] = at + total
                state[EXPECTED] = AROUND_2_BYTES if data[at] == MAGIC_2 else AROUND_1_BYTES
                if frame_is_good(data, at, total, crc_extra):
                    _record(data, at, total, base + at, row, state, clock, out)
                    row += 1
                else:
                    _bad(state, total)
                continue
        # Otherwise through the buffer: damage, or the ends of a chunk.
        found = _buffered_message(data, size, state, kept, crc_extra)
        if found < 0:
            state[ENDED] = 1
        elif found > 0:
            place = _place_of(data, kept, found, state)
            _record(kept, FRAME, found, base + place if place >= 0 else -1, row, state, clock, out)
            row += 1
    return row


@compiled
def read_one(
    data: NDArray[np.uint8],
    state: NDArray[np.int64],
    clock: NDArray[np.float64],
    kept: NDArray[np.uint8],
    crc_extra: NDArray[np.int16],
) -> int:
    """Read one message, stamp and all, as `scan_chunk` does.

    Returns its length, 0 for a bad record, -1 where there is none.

    Takes any bytes. Arguments as of `scan_chunk`; the frame is left at ``kept[FRAME:]``.
    """
    size = len(data)
    _take_stamp(data, size, size, state, clock)
    found = _buffered_message(data, size, state, kept, crc_extra)
    if found > 0:
        state[HAVE_LAST] = 1
        state[LAST_BAD] = 0
        clock[1] = clock[0]
    return found


@compiled
def walk(
    data: NDArray[np.uint8], size: int, at: int, final: bool, known: NDArray[np.int16], seen: NDArray[np.bool_]
) -> tuple[int, int]:
    """Go from header to header; return a place and the bytes to the next one where a type is met first.

    Where none is any more, return the place where it ends; the bytes are 0 where the piece is over, and -1 where the
    log is. Nothing is checked: this finds one message of each type in a log that is mostly undamaged.

    Takes any bytes.

    Parameters
    ----------
    data, size, final
        As of `scan_chunk`.
    at : int
        Place of a stamp to begin with.
    known : ndarray of int16, shape (65536,)
        -1 where a type is unknown; these are skipped.
    seen : ndarray of bool, shape (65536,)
        Types met so far; written to.
    """
    while at + 14 < size:
        if not final and at + HEADER > size:
            break
        # The frame behind the stamp, and its bytes.
        frame = at + STAMP_SIZE
        total = announced(data, frame)
        # No frame follows this stamp: try the next byte.
        if total == 0:
            at += 1
            continue
        # A header that is cut off ends the log.
        if data[frame] == MAGIC_2 and at + HEADER > size:
            return at, -1
        length, number = STAMP_SIZE + total, _message_id(data, frame)
        # The first message of a known type.
        if number < DENSE_IDS and known[number] >= 0 and not seen[number]:
            seen[number] = True
            return at, length
        at += length
    return at, 0
