"""Finding the messages of an ArduPilot DataFlash log, by the rules that pymavlink reads them by."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

HEAD_1, HEAD_2 = 0xA3, 0x95
FORMAT_TYPE = 0x80
FORMAT_LENGTH = 89


@compiled
def find_messages(
    data: NDArray[np.uint8],
    final: bool,
    length: NDArray[np.int64],
    offset: NDArray[np.int64],
    kind: NDArray[np.uint8],
) -> tuple[int, int, int]:
    """Find every message of a piece.

    Parameters
    ----------
    data : ndarray of uint8
        The piece.
    final : bool
        Whether the log ends with it.
    length : ndarray of int64, shape (256,)
        Bytes of each type of message, 0 where it is not known yet; format messages fill it in.
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
        if data[at] != HEAD_1 or data[at + 1] != HEAD_2 or length[data[at + 2]] == 0:
            at += 1
            skipped += 1
            continue
        number = data[at + 2]
        if size - at < length[number]:
            break
        offset[count] = at
        kind[count] = number
        count += 1
        if number == FORMAT_TYPE and data[at + 4] >= 3:
            length[data[at + 3]] = data[at + 4]
        at += length[number]
    if final:
        return count, size, skipped + size - at
    return count, at, skipped
