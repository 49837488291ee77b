"""Kernels that find the messages of a DataFlash log, by pymavlink's rules.

A message is 0xA3 0x95, one byte of type, and its fields. A format message (FMT, type 0x80, 89 bytes) tells of another
type: after its own 3 bytes come the type it describes (1), the bytes of such a message with its head (1), name (4), one
letter for each field (16) and the fields' labels (64). Letters after the first zero are ignored.

Source: `DFReader` of pymavlink, which says what each letter is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

HEAD_1, HEAD_2 = 0xA3, 0x95
FORMAT_TYPE = 0x80
FORMAT_LENGTH = 89


LETTERS_AT, LETTERS = 9, 16
"""Where a format message has the letters of the fields, and how many at most."""
GARBAGE_BYTES = 528
"""A message that cannot be unpacked ends the log where fewer bytes than these are left: block devices end in
garbage."""


@compiled
def packed_bytes(data: NDArray[np.uint8], at: int, sizes: NDArray[np.int64]) -> int:
    """Bytes that the fields of the format message at `at` take, by its letters; -1 where a letter is none."""
    total = 0
    for place in range(at + LETTERS_AT, at + LETTERS_AT + LETTERS):
        if data[place] == 0:
            break
        if sizes[data[place]] < 0:
            return -1
        total += sizes[data[place]]
    return total


@compiled
def find_messages(
    data: NDArray[np.uint8],
    final: bool,
    length: NDArray[np.int64],
    packed: NDArray[np.int64],
    sizes: NDArray[np.int64],
    offset: NDArray[np.int64],
    kind: NDArray[np.uint8],
) -> tuple[int, int, int]:
    """Find every message of a piece.

    Takes any bytes; tables of 256 entries, and `offset` and `kind` of one length.

    Parameters
    ----------
    data : ndarray of uint8
        The piece.
    final : bool
        Whether the log ends with it.
    length : ndarray of int64, shape (256,)
        Bytes of each type of message, 0 where it is not known yet; format messages fill it in.
    packed : ndarray of int64, shape (256,)
        Bytes that its fields take; where they are not as many, such messages cannot be read. Filled in likewise.
    sizes : ndarray of int64, shape (256,)
        Bytes of each letter of a format, -1 where it is none.
    offset, kind : ndarray
        Filled with the place and type of each message.

    Returns
    -------
    count, used, skipped : int
        Messages; bytes done with; those of them that belong to none.
    """
    count = skipped = at = 0
    size = len(data)
    while size - at >= 3 and count < len(offset):
        # Skip byte by byte to the head of a message of a known type.
        if data[at] != HEAD_1 or data[at + 1] != HEAD_2 or length[data[at + 2]] == 0:
            at += 1
            skipped += 1
            continue
        number = data[at + 2]
        # A message that the piece cuts off: the next piece begins with it.
        if size - at < length[number]:
            break
        # A message whose fields do not fill its length cannot be unpacked. Near the end of the data it ends the log;
        # elsewhere, or where it is a format with an unknown letter, only its head is skipped.
        nonsense = number == FORMAT_TYPE and packed_bytes(data, at, sizes) < 0
        if nonsense or packed[number] != length[number] - 3:
            if not nonsense and size - at - 3 < GARBAGE_BYTES:
                break
            at += 3
            skipped += 3
            continue
        # A message.
        offset[count] = at
        kind[count] = number
        count += 1
        # A format message says how long messages of its type are from here on.
        if number == FORMAT_TYPE and data[at + 4] >= 3:
            length[data[at + 3]] = data[at + 4]
            packed[data[at + 3]] = packed_bytes(data, at, sizes)
        at += length[number]
    # What is left when the log is over belongs to no message.
    if final:
        return count, size, skipped + size - at
    return count, at, skipped
