"""Gates: times at which it is known where drones are, for example the end of a storm.

Until a gate, the forward pass of the relaxation says how much charge a drone can have at most at each station; from there on, flights are exact. A
search that begins at the gate, at all stations at once and with these charges, bounds the arrival from below, and exactly so where there was time to
charge until the gate: then it is only left to find one way to the station where its best delivery begins. Two times are used:

- The end of the last time in which the whole network is shut for longer than a battery lasts: every delivery that arrives afterwards stands
  at some station when it opens.
- The last opening of any segment. Drones may be in the air then. They took off no longer before than a battery lasts, each from a station where the
  forward pass says what charge it can have had: so the search begins that much earlier, and on the ground each drone only charges
  until the gate. Where the surroundings of the destination open last, hundreds of stations are reached in time to spare, and the few flights
  after the gate alone decide.

What lands at a station before the last opening, or in its cell, has no more charge then than the drone that the search begins with there. So the
guide of that search leaves out such landings: few stations remain from which a drone that is in the air at the opening arrives in time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.relaxation import Forward
from skyway.planner.exact.stop_labels import StopLabel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.relaxation import Guide
    from skyway.planner.exact.stop_labels import StopLabels
    from skyway.planner.exact.subnetwork import Subnetwork

_EARLY_S = 1e-3
"""What can be had in a cell can be had this much before it: rounding is much less."""


@dataclass(frozen=True, eq=False)
class Gate:
    """A time at which every drone is on the ground, or in the air from where it stood within the cells before."""

    time_s: float
    """POSIX seconds."""
    cell: int
    """Cell of the forward pass that holds take-offs at that time."""
    shut: bool
    """Whether no drone is in the air, and none lands in the cell before it."""
    before: int
    """Cells before it with take-offs of drones that may be in the air at that time; one where all is shut, for where drones stand."""
    forward: Forward
    """Of that pass, what can be had from these cells on."""

    @property
    def landed_by(self) -> int:
        """Cell of the grid of `forward` in which drones that have landed have no more charge than the stop labels of `roots`; none if shut."""
        return -1 if self.shut else self.before

    def roots(self, stop_labels: StopLabels, guide: Guide) -> list[StopLabel]:
        """Return the best stop label that a drone can have at each station that may be left in time after the gate, or to be in the air then."""
        part = stop_labels.subnetwork
        most = np.maximum.accumulate(self.forward.leave[: self.before + 1])
        may_stand = part.has_pads.copy()
        may_stand[part.origin] = not stop_labels.problem.in_flight
        # If all is shut, a drone that is not there in the cell before comes after the gate.
        wanted = may_stand & np.isfinite(most[0 if self.shut else -1]) & (guide.window[:, 1] >= guide.window[:, 0])
        return [self._root(stop_labels, node, most[:, node]) for node in np.flatnonzero(wanted).tolist()]

    def _root(self, stop_labels: StopLabels, node: int, most: NDArray[np.float64]) -> StopLabel:
        curve_s, curve_soc = stop_labels.curve(node)
        if self.shut:
            charged_s = float(np.interp(most[0], curve_soc, curve_s)) + self.forward.cells.step_s
            most = np.minimum(most[-1:], np.interp(charged_s, curve_s, curve_soc))
        potential = float(np.interp(most[-1], curve_soc, curve_s)) - self.time_s
        on_pad = np.array([[self.time_s, potential, self.time_s]])
        if not stop_labels.subnetwork.has_pads[node]:
            on_pad = np.empty((0, 3))
        cells, first = self.forward.cells, int(np.argmax(np.isfinite(most)))
        begin_s = (
            cells.over_s
            - stop_labels.table.climb_s
            - _EARLY_S
            + cells.step_s * np.arange(first, len(most), dtype=np.float64)
        )
        begin_s[-1] = self.time_s if len(begin_s) == 1 else min(begin_s[-1], self.time_s)
        return StopLabel(node, on_pad, _steps(begin_s, most[first:]), (curve_s, curve_soc))

    def only_over(self, nodes: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return a mask, shape (cells, nodes), that leaves only some nodes to be flown over after the gate."""
        mask = np.ones(shape, dtype=bool)
        mask[self.cell + 1 :] = False
        mask[:, nodes] = True
        return mask


def _steps(begin_s: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a profile h, see `planner.schedule.profile_kernels`, of values that each hold from some time on; they never decrease."""
    rises = np.concatenate(([True], np.diff(value) > 0.0))
    begin_s, value = begin_s[rises], value[rises]
    time_s = np.repeat(begin_s, 2)[1:]
    return np.column_stack((time_s, np.repeat(value, 2)[:-1], time_s))


def last_gates(part: Subnetwork, forward: Forward, before_s: float, longest_s: float, *, in_flight: bool) -> list[Gate]:
    """Return the last opening of any segment before a time in a part of a network, and the last end of a time in which all is shut.

    The later one first, and that alone if all is shut before it. No flight and no hover lasts longer than `longest_s`. A drone that is `in_flight` at
    the beginning stands nowhere before it has landed.
    """
    table, cells = part.table, forward.cells
    is_open = table.speed_mps > 0.0
    opens = np.flatnonzero((is_open[1:] & ~is_open[:-1]).any(axis=1)) + 1
    used = np.flatnonzero(is_open.any(axis=1))
    gates: list[Gate] = []
    for slot in opens[::-1].tolist():
        time_s = table.start_s + slot * table.slot_s
        cell = int((time_s + table.climb_s - cells.over_s) / cells.step_s + 1e-9)
        if time_s >= before_s or not 0 < cell < cells.length:
            continue
        flown = used[used < slot]
        shut = bool(slot - 1 - (flown[-1] if len(flown) else -1) >= longest_s / table.slot_s)
        aloft = 1 if shut else int(longest_s / cells.step_s) + 1
        if not shut and (gates or (in_flight and aloft >= cell)):
            continue
        before = min(aloft, cell)
        first = cell - before
        later = cells._replace(over_s=cells.over_s + first * cells.step_s, length=cells.length - first)
        kept = Forward(later, forward.over[first:], forward.leave[first:], forward.arrive_s, forward.least_s)
        gates.append(Gate(time_s, cell, shut, before, kept))
        if shut:
            break
    return gates
