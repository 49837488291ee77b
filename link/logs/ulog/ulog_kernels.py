"""Kernels that find the messages of a ULog, as pyulog does.

A message is the length of its body (2 bytes, least significant first), a letter for its type, and the body. Definitions
come first: flag bits (B), formats (F), information (I, M) and parameters (P, Q). The data section begins with the first
subscription (A) or logged text (L, C); it holds data (D), and may hold I, M, P, Q, dropouts (O), ends of subscriptions
(R) and sync sequences (S), at which a reader resumes after damage.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html; `pyulog.core`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

IN_DATA, SEEKING, ENDED, BASE, LAST_SYNC = range(5)
"""Places in the state: whether the definitions are over; whether a sync is being looked for; whether reading is over;
where in the log the piece begins; where the last sync sequence of the log is, -1: nowhere."""
STATE_SIZE = 5
MAX_PLAUSIBLE = 10_000
"""An unknown message that is longer is damage, else one of a later version, which is passed over."""
SYNC_BYTES = 8
A, B, C, D, F, I, L, M, O, P, Q, R, S = (ord(letter) for letter in "ABCDFILMOPQRS")  # noqa: E741  the format's


@compiled
def find_sync(data: NDArray[np.uint8], begin: int, end: int, sync: NDArray[np.uint8]) -> int:
    """Position after the first sync sequence that lies entirely between `begin` and `end`; -1 for none."""
    for at in range(begin, end - SYNC_BYTES + 1):
        same = 0
        while same < SYNC_BYTES and data[at + same] == sync[same]:
            same += 1
        if same == SYNC_BYTES:
            return at + SYNC_BYTES
    return -1


@compiled
def least_bytes(kind: int) -> int:
    """Minimum size of a message of a type in bytes; with fewer left reading ends, as at the end of a cut log."""
    # Number of the subscription.
    if kind == D:
        return 2
    # Instance, number of the subscription.
    if kind == A:
        return 3
    # Level, time.
    if kind == L:
        return 9
    # Level, tag, time.
    if kind == C:
        return 11
    # Length of a key; the same after a flag, or a duration.
    return 1 if kind in {I, P} else 2 if kind in {M, O, Q} else 0


@compiled
def find_messages(
    data: NDArray[np.uint8],
    final: bool,
    sync: NDArray[np.uint8],
    state: NDArray[np.int64],
    place: NDArray[np.int64],
    kind: NDArray[np.uint8],
    size: NDArray[np.int64],
) -> tuple[int, int, int]:
    """Find every message of a piece.

    Takes any bytes, and arrays of one length to be filled.

    Parameters
    ----------
    data : ndarray of uint8, shape (bytes,)
        Part of a log, beginning where the one before was left.
    final : bool
        Whether the log ends with it.
    sync : ndarray of uint8, shape (`SYNC_BYTES`,)
        The sync sequence.
    state : ndarray of int64, shape (`STATE_SIZE`,)
        What is remembered between pieces, by the names of its places in this module.
    place, kind, size : ndarray, shape (messages,)
        Filled with the place, type and length of the body of each message.

    Returns
    -------
    count, used, skipped : int
        Messages; bytes done with; those of them that lie in no message.
    """
    count = at = skipped = 0
    end = len(data)
    while at + 3 <= end and count < len(place) and not state[ENDED]:
        # After damage: go to the end of the next sync sequence; the last bytes of the piece may begin one.
        if state[SEEKING]:
            found = find_sync(data, at, end, sync)
            state[SEEKING] = found < 0
            step = found - at if found >= 0 else max(end - SYNC_BYTES + 1 - at, 0)
            at, skipped = at + step, skipped + step
            if found < 0:
                state[BASE] += at
                return count, at, skipped
            continue
        # The head of a message.
        length = int(data[at]) + 256 * int(data[at + 1])
        letter = int(data[at + 2])
        stop = at + 3 + length
        # Its body goes beyond the piece: the next piece begins with it, and cut data end the log.
        if stop > end:
            if not final:
                break
            if state[IN_DATA]:
                state[ENDED] = 1
                break
        # Definitions, until a message begins the data. Damage is skipped byte by byte, an unknown message as a whole.
        if not state[IN_DATA]:
            state[IN_DATA] = letter in {A, L, C}
            if state[IN_DATA]:
                continue
            whole = letter in {I, M, F, P, Q, B}
            if whole:
                place[count], kind[count], size[count] = at + 3, letter, min(stop, end) - at - 3
                count += 1
            damage = not whole and (letter == 0 or length == 0 or length > MAX_PLAUSIBLE)
            step = 1 if damage else min(stop, end) - at
            at, skipped = at + step, skipped + (0 if whole else step)
            continue
        if letter == D or letter in {A, C, I, L, M, O, P, Q, S}:  # data first: a set is made for each question
            # A message of the data; one that is too short for its type ends the log.
            state[ENDED] = length < least_bytes(letter) or (letter == O and length != 2)
            if state[ENDED]:
                break
            place[count], kind[count], size[count] = at + 3, letter, length
            count, at = count + 1, stop
        elif letter == 0 or length == 0 or length > MAX_PLAUSIBLE:
            # Damage: skip a byte or, if a sync sequence is still to come, go to that.
            at, skipped = at + 1, skipped + 1
            state[SEEKING] = state[BASE] + at <= state[LAST_SYNC]
        else:
            # An unknown message: skipped, unless a sync sequence inside it shows that its length is damaged.
            found = find_sync(data, at + 3, stop, sync) if state[LAST_SYNC] >= 0 else -1
            step = (found if found >= 0 else stop) - at
            at, skipped = at + step, skipped + (step if letter != R else 0)
    # What is left of a log that is over lies in no message.
    if final or state[ENDED]:
        skipped += end - at
        at = end
    state[BASE] += at
    return count, at, skipped
