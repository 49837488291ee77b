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
    """Return the payloads at some places, all packed alike, as a structured array, shape (places,); of a `length` where some are cut short."""
    table = np.empty((len(place), layout.itemsize), dtype=np.uint8)
    gather(data, place, np.full(len(place), layout.itemsize) if length is None else length, table)
    return np.asarray(table.view(layout).reshape(len(place)))


@compiled
def gather(
    data: NDArray[np.uint8], payload: NDArray[np.int64], length: NDArray[np.int64], out: NDArray[np.uint8]
) -> None:
    """Copy payloads, one a row; what is shorter than a row is filled with zeros (MAVLink 2 cuts trailing zeros).

    Takes places and lengths of payloads inside the bytes, and a table with a row for each.
    """
    for row in range(len(payload)):
        count = min(length[row], out.shape[1])
        for step in range(count):
            out[row, step] = data[payload[row] + step]
        for step in range(count, out.shape[1]):
            out[row, step] = 0
