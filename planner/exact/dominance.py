"""Dominance: a stop label that settled labels of the same station cover is dropped.

One label covers another if the other's charge is nowhere higher at any time: whatever the drone does from the other one, it can do
from this one at the same time with no less charge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.stop_label_kernels import Offered
from skyway.planner.schedule.profile_kernels import covers, upper_profile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_labels import StopLabel


@dataclass(frozen=True, eq=False)
class Envelope:
    """The best of all settled labels of a station, at each time."""

    z: NDArray[np.float64]
    h: NDArray[np.float64]
    g: NDArray[np.float64]

    def covers_parts(self, stop_label: StopLabel) -> bool:
        """Return whether neither the potential nor the landed charge of a stop label is anywhere higher."""
        if len(stop_label.z) and (not len(self.z) or not covers(self.z[:, :2], stop_label.z[:, :2], 0.0)):
            return False
        return bool(covers(self.h[:, :2], stop_label.h[:, :2], 0.0))


def _upper(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper envelope of two profiles either of which may be empty."""
    if not len(a) or not len(b):
        return b if len(b) else a
    return upper_profile(a, b)


class Settled:
    """The settled labels of all stations, of so many nodes."""

    def __init__(self, nodes: int) -> None:
        self._of: dict[int, Envelope] = {}
        self._points = np.empty((1024, 2))
        self._size = 0
        self._at = np.zeros((nodes, 2), dtype=np.int64)

    @property
    def offered(self) -> Offered:
        """Charge that settled labels offer to leave each node with, as kernels read it."""
        return Offered(self._points, self._at)

    def add(self, stop_label: StopLabel) -> bool:
        """Add a stop label to what is known of its station; false where that covers it already."""
        known = self._of.get(stop_label.node)
        if known is None:
            self._keep(stop_label.node, Envelope(stop_label.z, stop_label.h, stop_label.g))
            return True
        # Potential and landed charge are cheap to compare and settle most; the charge to leave with decides.
        if known.covers_parts(stop_label) or covers(known.g, stop_label.g, 0.0):
            return False
        upper = (
            _upper(known.z, stop_label.z),
            upper_profile(known.h, stop_label.h),
            upper_profile(known.g, stop_label.g),
        )
        self._keep(stop_label.node, Envelope(*upper))
        return True

    def _keep(self, node: int, envelope: Envelope) -> None:
        self._of[node] = envelope
        size = self._size + len(envelope.g)
        if size > len(self._points):
            self._points = np.concatenate((self._points[: self._size], np.empty((size, 2))))
        self._points[self._size : size] = envelope.g
        self._at[node] = self._size, len(envelope.g)
        self._size = size
