"""Kernels that decode message payloads into table rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray


def table_of(
    data: NDArray[np.uint8],
    place: NDArray[np.int64],
    layout: np.dtype[np.void],
    length: NDArray[np.int64] | None = None,
) -> NDArray[np.void]:
    """Return the payloads at some places, all packed alike, as a structured array, shape (places,).

    With `length` some may be cut short; what is missing is 0.
    """
    table = np.empty((len(place), layout.itemsize), dtype=np.uint8)
    gather(data, place, np.full(len(place), layout.itemsize) if length is None else length, table)
    return np.asarray(table.view(layout).reshape(len(place)))


@compiled
def gather(
    data: NDArray[np.uint8], payload: NDArray[np.int64], length: NDArray[np.int64], out: NDArray[np.uint8]
) -> None:
    """Copy payloads into the rows of a table.

    out[r, k] = data[payload[r] + k] for k < length[r], 0 from there on.
    MAVLink 2 cuts off the zeros that end a payload; here they are put back. What is longer than a row is cut.

    Takes places and lengths of payloads inside the bytes, and a table with a row for each.

    Parameters
    ----------
    data : ndarray of uint8, shape (bytes,)
        A log or a piece of one.
    payload, length : ndarray of int64, shape (rows,)
        Where each payload begins in `data`, and its bytes.
    out : ndarray of uint8, shape (rows, bytes of a row)
        Filled.
    """
    for row in range(len(payload)):
        count = min(length[row], out.shape[1])
        for step in range(count):
            out[row, step] = data[payload[row] + step]
        for step in range(count, out.shape[1]):
            out[row, step] = 0
