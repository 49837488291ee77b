"""Finding the messages of a ULog."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@compiled
def find_messages(
    data: NDArray[np.uint8],
    final: bool,
    known: NDArray[np.bool_],
    sync: NDArray[np.uint8],
    place: NDArray[np.int64],
    kind: NDArray[np.uint8],
    size: NDArray[np.int64],
) -> tuple[int, int, int]:
    """Find every message; after damage, go on with the next sync message.

    Parameters
    ----------
    data : ndarray of uint8
        Part of a log, beginning at a message.
    final : bool
        Whether the log ends with it.
    known : ndarray of bool, shape (256,)
        Types of message.
    sync : ndarray of uint8
        A whole sync message.
    place, kind, size : ndarray
        Filled with the place, type and length of the body of each message.

    Returns
    -------
    count, used, skipped : int
        Messages; bytes done with; those of them that lie in no message.
    """
    count = at = skipped = 0
    end = len(data)
    while at + 3 <= end and count < len(place):
        length = int(data[at]) + 256 * int(data[at + 1])
        if known[data[at + 2]] and at + 3 + length <= end:
            place[count], kind[count], size[count] = at + 3, data[at + 2], length
            count += 1
            at += 3 + length
            continue
        if known[data[at + 2]] and not final and at + 3 + length > end:
            return count, at, skipped
        step = at
        while step + len(sync) <= end:
            same = 0
            while same < len(sync) and data[step + same] == sync[same]:
                same += 1
            if same == len(sync):
                break
            step += 1
        if step + len(sync) > end and final:
            return count, end, skipped + end - at
        skipped += step - at
        at = step
        if step + len(sync) > end:
            return count, at, skipped
    if final:
        skipped += end - at
        at = end
    return count, at, skipped
