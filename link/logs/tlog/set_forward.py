"""A recorder's clock that was set forward while a vehicle's clock ran on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.tlog.stamps import StampCheck

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.link.logs.tlog.tlog import Frames

STEP_S = StampCheck.SPIKE_S
"""Steps of stamps that are longer than this are compared with the vehicle's clock."""
WITNESSES = ("ATTITUDE", "GLOBAL_POSITION_INT")
"""Messages that hold the time since the vehicle started, `time_boot_ms`."""
NEIGHBOURS = 5
"""So many stamps before and after a step must lie on its two sides: fewer are damaged stamps."""


class SetForward:
    """Finds the places where the recorder's clock was set forward, and takes the steps out of the stamps.

    A companion computer without a battery for its clock starts at some old date, and is set when it finds a network. The stamps alone
    look like a pause of the recording; in a pause, the clock of the vehicle goes on as well. If the vehicle restarted in
    between, nothing is known of the step, and it stays.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[int, float]] = []
        """Position in the log of the first frame after a step, and the seconds taken out there."""
        self._clocks: dict[int, tuple[float, float]] = {}  # by system: time since its start, stamp
        self._tail = np.empty(0)
        self._open: tuple[float, dict[int, tuple[float, float]]] | None = None

    def see(self, frames: Frames) -> NDArray[np.float64]:
        """Look for steps in the next chunk of the log; return its stamps without them."""
        steps = np.flatnonzero(self._steps_of(frames.time_s) > STEP_S).tolist()
        if self._open is not None:
            self._settle(frames, *self._open)
        for row in steps:
            self._judge(frames, row)
        self._clocks |= _last_told(frames, len(frames))
        self._tail = np.concatenate([self._tail, frames.time_s])[-NEIGHBOURS:]
        return self.undone(frames)

    def undone(self, frames: Frames) -> NDArray[np.float64]:
        """Return the stamps of any chunk without the steps that were found."""
        if not self.steps:
            return frames.time_s
        at, by_s = (np.array(column) for column in zip(*self.steps, strict=True))
        passed = np.searchsorted(at, np.maximum.accumulate(frames.offset), side="right")
        return np.asarray(frames.time_s - np.concatenate([[0.0], np.cumsum(by_s)])[passed])

    def ended(self) -> float:
        """Give up a last step that no clock of a vehicle confirmed; return its seconds."""
        if self._open is None:
            return 0.0
        self._open = None
        return self.steps.pop()[1]

    def _steps_of(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.diff(time_s, prepend=self._tail[-1:] if len(self._tail) else time_s[:1])

    def _judge(self, frames: Frames, row: int) -> None:
        """Decide on a step before a row; one at the end of a chunk stays open until the vehicle speaks again."""
        before, after = np.concatenate([self._tail, frames.time_s[:row]])[-NEIGHBOURS:], frames.time_s[row:]
        middle = (before[-1] + after[0]) / 2.0
        if len(before) < NEIGHBOURS or not (before < middle).all() or not (after[:NEIGHBOURS] > middle).all():
            return
        at = np.flatnonzero(frames.offset[row:] >= 0)
        if self._open is not None or not len(at):
            return
        step_s, last = float(after[0] - before[-1]), self._clocks | _last_told(frames, row)
        by_s = _unconfirmed(frames, row, last, step_s)
        if math.isnan(by_s):  # taken for a clock that was set until a vehicle speaks
            self._open, by_s = (step_s, last), step_s
        if by_s > 0.0:
            self.steps.append((int(frames.offset[row + at[0]]), by_s))

    def _settle(self, frames: Frames, step_s: float, last: dict[int, tuple[float, float]]) -> None:
        """Decide on the step at the end of an earlier chunk."""
        by_s = _unconfirmed(frames, 0, last, step_s)
        if math.isnan(by_s):
            return
        self._open = None
        place, _ = self.steps.pop()
        if by_s > 0.0:
            self.steps.append((place, by_s))


def _last_told(frames: Frames, before: int) -> dict[int, tuple[float, float]]:
    """Last time since its start that each vehicle told in the rows before one, and its stamp."""
    found: dict[int, tuple[int, float]] = {}
    for name in WITNESSES:
        rows = frames.rows_of(name)
        rows = rows[rows < before]
        systems, backwards = np.unique(frames.system[rows][::-1], return_index=True)
        last = rows[::-1][backwards]
        told_s = frames.decoded(name, last)["time_boot_ms"] / 1000.0
        for system, row, own_s in zip(systems.tolist(), last.tolist(), told_s.tolist(), strict=True):
            found[system] = max((row, own_s), found.get(system, (-1, 0.0)))
    return {system: (own_s, float(frames.time_s[row])) for system, (row, own_s) in found.items()}


def _unconfirmed(frames: Frames, first: int, last: dict[int, tuple[float, float]], step_s: float) -> float:
    """Seconds of a step that the clock of a vehicle did not make, 0 if it made it; NaN if no vehicle spoke before and after."""
    told = [(int(row), name) for name in WITNESSES for row in frames.rows_of(name) if row >= first]
    for row, name in sorted(told):
        if int(frames.system[row]) in last:
            own_before_s, stamp_s = last[int(frames.system[row])]
            own_s = float(frames.decoded(name, np.array([row]))["time_boot_ms"][0]) / 1000.0 - own_before_s
            recorder_s = float(frames.time_s[row]) - stamp_s
            certain = -StampCheck.JITTER_S <= own_s < STEP_S < recorder_s - own_s
            return min(recorder_s - own_s, step_s) if certain else 0.0
    return math.nan
