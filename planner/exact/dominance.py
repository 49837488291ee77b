"""Dominance: a stop label that settled labels of the same station cover is dropped.

One label covers another if the other's charge is nowhere higher at any time: whatever the drone does from the other one, it can do
from this one at the same time with no less charge.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.stop_label_kernels import Offered
from skyway.planner.schedule.profile_kernels import covers, upper_profile

if TYPE_CHECKING:
    from skyway.planner.exact.stop_labels import StopLabel


class Settled:
    """The best charge that settled labels offer to leave each of so many nodes with, at each time."""

    def __init__(self, nodes: int) -> None:
        self._points = np.empty((1024, 2))
        self._size = 0
        self._at = np.zeros((nodes, 2), dtype=np.int64)

    @property
    def offered(self) -> Offered:
        """Charge that settled labels offer to leave each node with, as kernels read it."""
        return Offered(self._points, self._at)

    def add(self, stop_label: StopLabel) -> bool:
        """Add a stop label to what is known of its station; false where that covers it already."""
        node = stop_label.node
        begin, size = self._at[node].tolist()
        envelope = stop_label.g
        if size:
            known = self._points[begin : begin + size]
            if covers(known, envelope, 0.0):
                return False
            envelope = upper_profile(known, envelope)
        end = self._size + len(envelope)
        if end > len(self._points):
            self._points = np.concatenate((self._points[: self._size], np.empty((end, 2))))
        self._points[self._size : end] = envelope
        self._at[node] = self._size, len(envelope)
        self._size = end
        return True
