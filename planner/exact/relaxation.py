"""Bounds on any composition, computed on a grid of times: the guide of the exact search.

Time is cut into cells of some seconds, and everything in a cell is taken at its best: a drone that is over a node at any
time in a cell is as good as one there at its beginning that leaves at its end. On this grid two passes cost little: one
forward in time finds the most charge that the drone can have at each node in each cell, and with it the earliest
arrival; one backward from a deadline finds the least charge with which it can still be on time. Both know of wind hour
by hour, overflight, queues, reserve, the charging curve and a full battery. Of the rule that a segment must be open in all
slots that its flight touches they know what follows from two of these: no flight is over a segment that was closed when it
took off, and none is over one that closes before it can have landed. Whatever lies outside either of the passes cannot be
part of a composition that arrives by the deadline.

Gains by rounding must not feed themselves: charging for the whole of a cell and flying on within it gains nothing while a
cell is shorter than the charging that a take-off and landing ask for (`longest_cell_s`), or than the shortest segment takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.relaxation_backward_kernels import backward_pass
from skyway.planner.exact.relaxation_grid_kernels import TIE_S, Cells, Waits, least_times
from skyway.planner.exact.relaxation_kernels import Pass, forward_pass, in_time, needed_where
from skyway.planner.exact.subnetwork import narrowed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Costs
    from skyway.planner.exact.subnetwork import Subnetwork


@dataclass(frozen=True, eq=False)
class Start:
    """How the delivery begins: see `planner.exact.relaxation_kernels.forward_pass`."""

    time_s: float
    soc: float
    pad_s: float
    at_once: bool


@dataclass(frozen=True, eq=False)
class Forward:
    """What can be had: most charge over nodes and on leaving them, shape (cells, nodes), and the earliest arrival.

    `least_s` is the least cruise time from each node to the destination.
    """

    cells: Cells
    over: NDArray[np.float64]
    leave: NDArray[np.float64]
    arrive_s: float
    least_s: NDArray[np.float64]

    def over_nodes(self, keep: NDArray[np.bool_]) -> Forward:
        """Return the same for some of the nodes, as in `planner.exact.subnetwork.narrowed`."""
        over, leave = (np.compress(keep, rows, axis=1) for rows in (self.over, self.leave))
        return Forward(self.cells, over, leave, self.arrive_s, self.least_s[keep])


@dataclass(frozen=True, eq=False)
class Guide:
    """What a composition that arrives by a deadline needs."""

    cells: Cells
    """The grid."""
    leave: NDArray[np.float64]
    """Shape (cells, nodes). Least charge to leave each node with; infinite where there is no way."""
    need: NDArray[np.float64]
    """Shape (cells, nodes). Least charge to be over each node with on such a way; infinite where there is none."""
    window: NDArray[np.int64]
    """Shape (nodes, 2). First and last cell in which it can leave each node; the last is before the first where it
    cannot."""

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """Which nodes such a way can lead over at all, shape (nodes,)."""
        return np.asarray(np.isfinite(self.need.min(axis=0, initial=np.inf)))

    @property
    def over(self) -> NDArray[np.bool_]:
        """Where the drone can be over a node on such a way, shape (cells, nodes)."""
        return np.isfinite(self.need)

    def over_nodes(self, keep: NDArray[np.bool_]) -> Guide:
        """Return the same for some of the nodes, as in `planner.exact.subnetwork.narrowed`."""
        leave, need = (np.compress(keep, rows, axis=1) for rows in (self.leave, self.need))
        return Guide(self.cells, leave, need, self.window[keep])


def longest_cell_s(subnetwork: Subnetwork, costs: Costs) -> float:
    """Longest cell in which rounding cannot feed itself."""
    stop = (costs.soc_per_s * costs.landing_s + costs.soc_fixed) / costs.rate_per_s
    speed = subnetwork.table.speed_mps.max(axis=0)
    with np.errstate(divide="ignore"):
        shortest = float(np.min(subnetwork.table.distance_m / speed, initial=math.inf))
    return max(0.95 * stop, 0.95 * shortest, 0.5)


def cells_for(subnetwork: Subnetwork, start: Start, step_s: float, until_s: float) -> Cells:
    """Grid from the start to a deadline; its cells do not straddle slots, of which each has a whole number."""
    table = subnetwork.table
    step = table.slot_s / math.ceil(table.slot_s / step_s)
    over = start.time_s + table.climb_s
    begin = table.start_s + math.floor((over - table.start_s) / step + 1e-9) * step
    return Cells(begin, step, max(int((until_s - begin) / step) + 1, 1))


def needed_in(cells: Cells, descent_s: float, needed: NDArray[np.float64], until_s: float) -> NDArray[np.float64]:
    """Least charge on touch-down at the destination in each cell; infinite in those after the deadline."""
    begin = cells.over_s + descent_s + cells.step_s * np.arange(cells.length + 1)
    low = np.interp(begin, needed[:, 0], needed[:, 1])
    least: NDArray[np.float64] = np.minimum(low[:-1], low[1:])
    where = np.searchsorted(begin, needed[:, 0], side="right") - 1
    for cell in (where, np.searchsorted(begin, needed[:, 0], side="left") - 1):  # at a jump between cells, in both
        inside = (cell >= 0) & (cell < cells.length)
        np.minimum.at(least, cell[inside], needed[inside, 1])
    least[begin[:-1] > until_s] = np.inf
    return least


def _pass(
    subnetwork: Subnetwork,
    costs: Costs,
    cells: Cells,
    needed: NDArray[np.float64],
    allowed: NDArray[np.bool_],
    ratio: int,
    landed_by: int = -1,
) -> Pass:
    table = subnetwork.table
    waits = subnetwork.waits(cells)
    if landed_by >= 0:
        waits = Waits(waits.pad_s.copy(), waits.spot_s.copy(), waits.pad_cell.copy(), waits.spot_cell.copy())
        landed = waits.spot_cell <= landed_by
        waits.pad_s[landed] = waits.spot_s[landed] = np.inf
        waits.pad_cell[landed] = waits.spot_cell[landed] = cells.length
    return Pass(
        table,
        subnetwork.grounds,
        costs,
        cells,
        waits,
        subnetwork.has_pads,
        subnetwork.destination,
        needed,
        allowed,
        ratio,
    )


def run_forward(
    subnetwork: Subnetwork,
    costs: Costs,
    start: Start,
    cells: Cells,
    needed: NDArray[np.float64],
    deadline_s: float,
    *,
    after: float,
    allowed: tuple[NDArray[np.bool_], int] | None = None,
) -> Forward:
    """Find what can be had by a deadline; `after` is how far to go on after the first arrival, as a share."""
    table = subnetwork.table
    mask, ratio = allowed if allowed is not None else (np.empty((0, 0), dtype=np.bool_), 1)
    least_s = least_times(table, subnetwork.destination)
    over, leave, over_goal_s, last = forward_pass(
        _pass(subnetwork, costs, cells, needed_in(cells, table.descent_s, needed, deadline_s), mask, ratio),
        (subnetwork.origin, start.soc, start.time_s, start.pad_s, start.at_once),
        (least_s, deadline_s),
        after,
    )
    arrive = over_goal_s - TIE_S + table.descent_s
    kept = cells._replace(length=last + 1)
    # Copies, so that the work of the pass is let go.
    return Forward(kept, over[: last + 1].copy(), leave[: last + 1].copy(), arrive, least_s)


def run_backward(
    subnetwork: Subnetwork,
    costs: Costs,
    forward: Forward,
    needed: NDArray[np.float64],
    deadline_s: float,
    landed_by: int = -1,
) -> Guide:
    """Find what is needed to arrive by a deadline, where the forward pass on the same grid has been.

    By ways on which no drone lands in time to leave again in the cell `landed_by`.
    """
    allowed = _in_time(subnetwork, costs, forward, deadline_s)
    return _backward(subnetwork, costs, forward, needed, deadline_s, allowed, landed_by)


def guided(
    subnetwork: Subnetwork,
    costs: Costs,
    forward: Forward,
    needed: NDArray[np.float64],
    deadline_s: float,
    within: NDArray[np.bool_] | None = None,
    landed_by: int = -1,
) -> tuple[Subnetwork, Guide, Forward]:
    """Find the same, and narrow all to the nodes that such ways lead over, where these are clearly fewer; origin and destination stay.

    By ways `within` cells and nodes alone, shape (cells, nodes), if they are given.
    """
    allowed = _in_time(subnetwork, costs, forward, deadline_s)
    if within is not None:
        allowed &= within
    # Nodes that are reached too late everywhere are no part of the pass.
    keep = _with_ends(subnetwork, np.asarray(allowed.any(axis=0)))
    if 2 * np.count_nonzero(keep) <= len(keep):
        subnetwork, forward, allowed = (
            narrowed(subnetwork, keep),
            forward.over_nodes(keep),
            np.compress(keep, allowed, axis=1),
        )
    guide = _backward(subnetwork, costs, forward, needed, deadline_s, allowed, landed_by)
    keep = _with_ends(subnetwork, guide.used)
    if 4 * np.count_nonzero(keep) >= 3 * len(keep):
        return subnetwork, guide, forward
    return narrowed(subnetwork, keep), guide.over_nodes(keep), forward.over_nodes(keep)


def _with_ends(subnetwork: Subnetwork, keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
    keep = keep.copy()
    keep[[subnetwork.origin, subnetwork.destination]] = True
    return keep


def _in_time(subnetwork: Subnetwork, costs: Costs, forward: Forward, deadline_s: float) -> NDArray[np.bool_]:
    return in_time(forward.over, forward.cells, subnetwork.table.descent_s, costs, forward.least_s, deadline_s)


def _backward(
    subnetwork: Subnetwork,
    costs: Costs,
    forward: Forward,
    needed: NDArray[np.float64],
    deadline_s: float,
    allowed: NDArray[np.bool_],
    landed_by: int,
) -> Guide:
    cells = forward.cells
    least_charge = needed_in(cells, subnetwork.table.descent_s, needed, deadline_s)
    over, leave = backward_pass(_pass(subnetwork, costs, cells, least_charge, allowed, 1, landed_by))
    need, window = needed_where(over, leave, forward.over, forward.leave)
    return Guide(cells, leave.copy(), need, window)
