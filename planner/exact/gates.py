"""Gates: times at which no drone can be in the air, for example at the end of a storm.

Where a whole network is closed for longer than a battery lasts, every delivery that arrives afterwards stands at some station when it
opens, with no more charge than the forward pass of the relaxation says that it can have there. A search that begins at the gate, at
all of these stations at once and with these charges, therefore bounds the arrival from below, and exactly so where the pause was long
enough to charge: then it is only left to find one way to the station where its best delivery begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.relaxation import Forward
from skyway.planner.exact.stop_labels import StopLabel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.relaxation import Guide
    from skyway.planner.exact.stop_labels import StopLabels
    from skyway.planner.exact.subnetwork import Subnetwork


@dataclass(frozen=True, eq=False)
class Gate:
    """A time at which every drone is on the ground."""

    time_s: float
    """POSIX seconds."""
    cell: int
    """Cell of the forward pass that holds take-offs at that time."""
    forward: Forward
    """Of that pass, what can be had from this cell on."""

    def roots(self, stop_labels: StopLabels, guide: Guide) -> list[StopLabel]:
        """Return the best stop label that a drone can have at each station that may be left in time after the gate."""
        part = stop_labels.subnetwork
        most = self.forward.leave[0]
        may_stand = part.has_pads.copy()
        may_stand[part.origin] = not stop_labels.problem.in_flight
        wanted = may_stand & np.isfinite(most) & (guide.window[:, 1] >= guide.window[:, 0])
        return [self._root(stop_labels, node, float(most[node])) for node in np.flatnonzero(wanted).tolist()]

    def _root(self, stop_labels: StopLabels, node: int, soc: float) -> StopLabel:
        curve_s, curve_soc = stop_labels.curve(node)
        potential = float(np.interp(soc, curve_soc, curve_s)) - self.time_s
        on_pad = np.array([[self.time_s, potential, self.time_s]])
        if not stop_labels.subnetwork.has_pads[node]:
            on_pad = np.empty((0, 3))
        return StopLabel(node, on_pad, np.array([[self.time_s, soc, self.time_s]]), (curve_s, curve_soc))

    def only_over(self, nodes: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return a mask, shape (cells, nodes), that leaves only some nodes to be flown over after the gate."""
        mask = np.ones(shape, dtype=bool)
        mask[self.cell + 1 :] = False
        mask[:, nodes] = True
        return mask


def last_gate(part: Subnetwork, forward: Forward, before_s: float, longest_s: float) -> Gate | None:
    """Return the last gate before a time in a part of a network, in which no flight and no hover lasts longer than `longest_s`."""
    table, cells = part.table, forward.cells
    shut = np.append(~(table.speed_mps[:-1] > 0.0).any(axis=1), False)  # the last slot holds on
    edges = np.flatnonzero(np.diff(np.concatenate(([False], shut, [False])).astype(np.int8)))
    for first, end in reversed(list(pairwise(edges.tolist()))[::2]):
        time_s = table.start_s + end * table.slot_s
        cell = int((time_s + table.climb_s - cells.over_s) / cells.step_s + 1e-9)
        if time_s < before_s and (end - first) * table.slot_s >= longest_s and 0 < cell < cells.length:
            later = cells._replace(over_s=cells.over_s + cell * cells.step_s, length=cells.length - cell)
            kept = Forward(later, forward.over[cell:], forward.leave[cell:], forward.arrive_s, forward.least_s)
            return Gate(time_s, cell, kept)
    return None
