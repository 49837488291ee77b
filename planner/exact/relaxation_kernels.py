"""Kernels of the relaxation: forward and backward passes over a grid of times; see `planner.exact.relaxation`.

Cell i of the grid begins at x_i and lasts `step_s`. With F the charging curve from empty of a station, c the charge
that a second of flight takes and k what a flight costs beyond that, everything in a cell is taken at its best: a drone
over a node at any time of cell i is there at x_i and leaves at x_(i+1). So the state is one number, the most charge
E_i(v) over node v:

    leave_i(v) = max(H, F(x_(i+1) - climb + Z)),  H = max of landed_j(v) and Z = max of onto_j(v) over j <= i
    E_i(v)     = max(arrivals, leave_i(v) - k - c climb)
    arrivals:    E_i(v) - c T at node w, in each cell in which a flight over the segment (v, w) that began in
                 cell i can end; T is the least time of one
    landed:      E_i(v) - c (hover + descent), in the cell in which there is a place to land
    onto:        F^-1(that charge) - pad time, in the cell in which there is a pad

`forward_pass` solves this in the order of i. `backward_pass` solves the mirror image, with least charges in place of
most.

With a margin m (charge that a second of flight asks for on top, on touch-down) a second number goes along: the charge
less m for each second since take-off, which must cover the reserve. The code calls it `rest` (`left`, `lesser`); it
falls by c + m (`strict`) a second.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled
from skyway.planner.exact.relaxation_grid_kernels import (
    LOOSE,
    Cells,
    cell_of,
    charge_after,
    crossed,
    nearest_first,
    open_in,
    time_from_empty,
)
from skyway.planner.problem.flight_table import table_slot, table_slot_end

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.stop_label_kernels import Costs, Grounds
    from skyway.planner.problem.flight_table import FlightTable

_NONE = -math.inf


class Pass(NamedTuple):
    """What both passes read: see `planner.exact.relaxation`."""

    table: FlightTable
    grounds: Grounds
    costs: Costs
    cells: Cells
    """Flights, stations, what flights and charging cost, and the grid."""
    pad_s: NDArray[np.float64]
    spot_s: NDArray[np.float64]
    """Shape (cells, nodes) each. Of `queue_cells`, POSIX seconds."""
    has_pads: NDArray[np.bool_]
    """Shape (nodes,). Where a drone can land on its way."""
    goal: int
    """The destination."""
    needed: NDArray[np.float64]
    """Shape (cells,). Least charge on touch-down there; infinite in cells that are too late."""
    allowed: NDArray[np.bool_]
    """Shape (coarse cells, nodes). Where it is worth asking; elsewhere there is no way. With no cells: everywhere."""
    ratio: int
    """Cells in a coarse cell."""


@compiled
def forward_pass(  # noqa: PLR0915  one loop: taking it apart costs more than the work that is done in it
    one: Pass, origin: tuple[int, float, float, float, bool], remaining: tuple[NDArray[np.float64], float], after: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, int]:
    """Most charge that a drone can have over each node, and leave it with, in each cell: see this module.

    A drone over a node with charge E at x is dropped when it cannot be at the destination by the deadline D even at the
    best: with L the least time of flight left and r the greatest rate of charging, it arrives no earlier than x + L,
    nor than reserve / r + L (1 + c / r) - (E / r - x) (see `planner.exact.stop_label_kernels.stop_label_bound`).

    Within a cell, nodes are looked at again as long as a segment that is flown within the cell (one of `inner`) brings
    more charge (`stale`, `again`); then all segments are flown once. O(cells x segments) apart from these.

    Takes a `Pass` of `planner.exact.relaxation` of a cell or more, a finite start, and any pad time, deadline and
    `after` from 0 up, infinite included.

    Parameters
    ----------
    one : Pass
        Where and when.
    origin : (node, soc, time_s, pad_s, at_once)
        Where and when the delivery starts, and when there is a pad; ``at_once``: it cannot stay.
    remaining : (least_s, deadline_s)
        Least cruise time from each node to the destination; nothing is followed that cannot be there by the deadline.
    after : float
        How far to go on after the first arrival, as a share of the time until then.

    Returns
    -------
    over, leave : ndarray, shape (cells, nodes)
        E and leave; -inf where there is no way.
    first, last : int
        Cell of the first touch-down at the destination (beyond all cells: none) and the last one filled.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    pad_s, spot_s, has_pads = one.pad_s, one.spot_s, one.has_pads
    allowed, goal, ratio = one.allowed, one.goal, one.ratio
    nodes = len(table.first) - 1
    rows = np.full((5, cells.length, nodes), _NONE)
    over, rest, leave, landed, onto = rows[0], rows[1], rows[2], rows[3], rows[4]
    h, z = np.full(nodes, _NONE), np.full(nodes, _NONE)  # most charge landed and potential reached so far
    seen = np.zeros(nodes, dtype=np.bool_)
    start, soc, depart_s, first_pad_s, at_once = origin
    seen[start] = True
    # The start: landed with its charge and, where it has a pad, on it; seen from the cells of take-offs.
    begin = min(cell_of(cells, -table.climb_s, depart_s), cells.length - 1)
    landed[begin, start] = soc
    cell = cell_of(cells, -table.climb_s, first_pad_s)
    if cell < cells.length:
        onto[cell, start] = time_from_empty(grounds, start, soc) - first_pad_s
    least_s, deadline = remaining
    last, found = cells.length - 1, cells.length
    per_s, strict = costs.soc_per_s, costs.soc_per_s + costs.margin_soc_per_s
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    # Charge of a climb; least charge to land with; terms of the bound that drops what is late.
    climb = costs.soc_fixed + per_s * table.climb_s
    enough = costs.reserve - LOOSE + strict * table.descent_s
    full_s = costs.reserve / costs.rate_per_s
    drain = (per_s + costs.rate_per_s) / costs.rate_per_s
    known = table_slot(table, cells.over_s)
    open_now = open_in(table, known, cells.step_s)
    inner = nearest_first(open_now, cells.step_s)
    i = begin - 1
    while i < last:
        i += 1
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        if slot != known:
            known = slot
            open_now = open_in(table, slot, cells.step_s)
            inner = nearest_first(open_now, cells.step_s)
        ends = table_slot_end(table, slot)
        inside = ends - x - cells.step_s
        down_by = x + cells.step_s + table.descent_s
        # Every node reached so far is looked at in each cell: the drone may have charged meanwhile.
        stale = seen.copy()
        again = True
        while again:
            again = False
            for node in range(nodes):
                if not stale[node]:
                    continue
                stale[node] = False
                barred = len(allowed) > 0 and not allowed[i // ratio, node]
                # Drop what is not allowed here, is late or cannot land.
                flight = least_s[node] + table.descent_s
                charge = over[i, node]
                left = rest[i, node] if margin else charge
                late = max(x + flight, full_s + flight * drain - (charge / costs.rate_per_s - x)) > deadline
                if barred or late or left < enough:
                    charge = left = _NONE
                elif node == goal:
                    # The destination: the first landing with what is asked for there brings the end nearer.
                    landing = min(charge - per_s * table.descent_s, left - strict * table.descent_s)
                    if landing >= one.needed[i] - LOOSE and found > i:
                        found = i
                        elapsed_s = max(x + table.descent_s - depart_s, cells.step_s)  # the first cell begins before it
                        more_s = min(after * elapsed_s, 1e9) + 60.0
                        last = min(last, i + 1 + int(more_s / cells.step_s))
                        deadline = min(deadline, down_by + more_s)
                elif has_pads[node]:
                    # A station: down, hovering until there is a place, then landed and onto the pad.
                    hover = max(0.0, spot_s[i, node] - down_by) + table.descent_s
                    down = charge - per_s * hover
                    if left - strict * hover >= costs.reserve - LOOSE:
                        cell = cell_of(cells, -table.climb_s, spot_s[i, node])
                        if cell < cells.length:
                            landed[cell, node] = max(landed[cell, node], down)
                        cell = cell_of(cells, -table.climb_s, pad_s[i, node])
                        if cell < cells.length:
                            u = time_from_empty(grounds, node, down) - pad_s[i, node]
                            onto[cell, node] = max(onto[cell, node], u)
                # H, Z and leave.
                h[node], z[node] = max(h[node], landed[i, node]), max(z[node], onto[i, node])
                off = h[node]
                if z[node] > _NONE:
                    off = max(off, charge_after(grounds, node, x + cells.step_s - table.climb_s + z[node]))
                if at_once and node == start and i > begin:
                    off = _NONE
                leave[i, node] = off
                # Take off: over the node with what is left after the climb, unless that is late.
                off -= climb
                late = max(x + flight, full_s + flight * drain - (off / costs.rate_per_s - x)) > deadline
                if not barred and not late:
                    charge, left = max(charge, off), max(left, off - costs.margin_soc_per_s * table.climb_s)
                over[i, node] = charge
                if margin:
                    rest[i, node] = left
                if left < enough:
                    continue
                # Nodes that are reached within the cell are looked at again with what is brought there.
                for k in range(open_now.first[node], open_now.first[node] + inner[node]):
                    cell, least = i + open_now.steps[k], open_now.takes_s[k]
                    if least > inside:
                        cell, _, least = crossed(table, cells, open_now, k, i, (x, slot, ends))
                    lesser = left - strict * least
                    if cell != i or lesser < enough:
                        continue
                    other, less = open_now.head[k], charge - per_s * least
                    if less > over[i, other] or (margin and lesser > rest[i, other]):
                        over[i, other] = max(less, over[i, other])
                        if margin:
                            rest[i, other] = max(lesser, rest[i, other])
                        seen[other] = stale[other] = again = True
        # Cruise: charge over other nodes in the later cells in which a flight over the segment may end.
        for node in range(nodes):
            charge = over[i, node]
            left = rest[i, node] if margin else charge
            if left < enough:
                continue
            for k in range(open_now.first[node], open_now.first[node + 1]):
                # A flight within the slot takes one time, whenever it enters.
                least = open_now.takes_s[k]
                cell = i + open_now.steps[k]
                end = cell + 1
                if least > inside:
                    cell, end, least = crossed(table, cells, open_now, k, i, (x, slot, ends))
                less, lesser = charge - per_s * least, left - strict * least
                if lesser < enough:
                    continue
                other = open_now.head[k]
                seen[other] = True
                cell, end = max(cell, i + 1), min(end, cells.length - 1)
                while cell <= end:
                    over[cell, other] = max(less, over[cell, other])
                    if margin:
                        rest[cell, other] = max(lesser, rest[cell, other])
                    cell += 1
    return over, leave, found, last


@compiled
def backward_pass(one: Pass) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: PLR0915  as above
    """Least charge from which the destination can be reached in time, over each node and on leaving it.

    The mirror of `forward_pass`, with the last cell first. A_i(v) is the least charge over node v:

        A_i(v)     = min(A_j(w) + c T over the segments (v, w) and the cells j in which they may end,  landing)
        leave_i(v) = the first of these alone, + k + c climb
        landing    = needed + c descent at the destination; at another station max(reserve, stay) + c (hover + descent)
        stay       = min(leave_j(v) for the j from the cell of the touch-down on,  F(pad time + Z))
        Z          = least F^-1(leave_j(v)) - (x_(j+1) - climb) for the j from the cell of the pad time on

    With a margin m, `rest` is the least charge for reserve and margin alone, at c + m a second.

    Takes a `Pass` of `planner.exact.relaxation`: a cell or more, and arrays of its cells and nodes.

    Returns
    -------
    over, leave : ndarray, shape (cells, nodes)
        A and leave; infinite where there is no way.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    pad_s, spot_s, has_pads = one.pad_s, one.spot_s, one.has_pads
    allowed, goal, ratio = one.allowed, one.goal, one.ratio
    nodes = len(table.first) - 1
    rows = np.full((5, cells.length + 1, nodes), NEVER)
    # Over a node; the same for reserve and margin alone; to leave it;
    # the least of that, and of the potential, from then on.
    over, rest, leave, ever, potential = rows[0], rows[1], rows[2], rows[3], rows[4]
    per_s, strict = costs.soc_per_s, costs.soc_per_s + costs.margin_soc_per_s
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    climb = costs.soc_fixed + per_s * table.climb_s
    known = table_slot(table, cells.over_s)
    open_now = open_in(table, known, cells.step_s)
    inner = nearest_first(open_now, cells.step_s)
    any_inner = inner.max() > 0
    onward, onward_rest = np.empty(nodes), np.empty(nodes)  # by flights that end in later cells
    for i in range(cells.length - 1, -1, -1):
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        if slot != known:
            known = slot
            open_now = open_in(table, slot, cells.step_s)
            inner = nearest_first(open_now, cells.step_s)
            any_inner = inner.max() > 0
        ends = table_slot_end(table, slot)
        inside = ends - x - cells.step_s
        down_by = x + cells.step_s + table.descent_s
        ever[i], potential[i] = ever[i + 1], potential[i + 1]
        # Over each segment, to the cheapest of the later cells in which the flight may end.
        for node in range(nodes):
            onward[node] = onward_rest[node] = NEVER
            if not allowed[i // ratio, node]:
                continue
            fly, least_rest = NEVER, NEVER
            for k in range(open_now.first[node], open_now.first[node + 1]):
                least = open_now.takes_s[k]
                cell = i + open_now.steps[k]
                end = cell + 1
                if least > inside:
                    cell, end, least = crossed(table, cells, open_now, k, i, (x, slot, ends))
                other = open_now.head[k]
                cell, end = max(cell, i + 1), min(end, cells.length - 1)
                while cell <= end:
                    fly = min(fly, over[cell, other] + per_s * least)
                    if margin:
                        least_rest = min(least_rest, rest[cell, other] + strict * least)
                    cell += 1
            onward[node], onward_rest[node] = fly, least_rest
        again = True
        while again:
            again = False
            for node in range(nodes):
                if not allowed[i // ratio, node]:
                    continue
                # And to nodes that are reached within this cell.
                fly, least_rest = onward[node], onward_rest[node]
                for k in range(open_now.first[node], open_now.first[node] + inner[node]):
                    cell, least = i + open_now.steps[k], open_now.takes_s[k]
                    if least > inside:
                        cell, _, least = crossed(table, cells, open_now, k, i, (x, slot, ends))
                    if cell == i and least < NEVER:
                        fly = min(fly, over[i, open_now.head[k]] + per_s * least)
                        least_rest = min(least_rest, rest[i, open_now.head[k]] + strict * least)
                if not margin:
                    least_rest = fly
                # Leave: with the climb, with no more than a full battery; keep the least from here on.
                off = max(fly, least_rest + costs.margin_soc_per_s * table.climb_s) + climb
                if off < NEVER and (off <= 1.0 + LOOSE or not has_pads[node]):
                    leave[i, node], ever[i, node] = off, min(ever[i, node], off)
                    u = time_from_empty(grounds, node, min(off, 1.0)) - (x - table.climb_s + cells.step_s)
                    potential[i, node] = min(potential[i, node], u)
                # Land at the destination.
                if node == goal:
                    fly = min(fly, one.needed[i] + per_s * table.descent_s)
                    least_rest = min(least_rest, one.needed[i] + strict * table.descent_s)
                elif has_pads[node] and ever[i, node] < NEVER:
                    # Or at a station, to leave it later as it is or, from a pad, charged.
                    down = NEVER
                    cell = cell_of(cells, -table.climb_s, spot_s[i, node])
                    if cell < cells.length:
                        down = ever[cell, node]
                    cell = cell_of(cells, -table.climb_s, pad_s[i, node])
                    if cell < cells.length and potential[cell, node] < NEVER:
                        down = min(down, charge_after(grounds, node, pad_s[i, node] + potential[cell, node]))
                    hover = max(0.0, spot_s[i, node] - down_by) + table.descent_s
                    fly = min(fly, max(down, costs.reserve) + per_s * hover)
                    if down < NEVER:
                        least_rest = min(least_rest, costs.reserve + strict * hover)
                # Look again while a segment that is flown within the cell makes it less.
                if fly < over[i, node] or (margin and least_rest < rest[i, node]):
                    over[i, node] = min(fly, over[i, node])
                    if margin:
                        rest[i, node] = min(least_rest, rest[i, node])
                    again = any_inner
    return over[:-1], leave[:-1]


@compiled
def in_time(
    over: NDArray[np.float64],
    cells: Cells,
    descent_s: float,
    costs: Costs,
    least_s: NDArray[np.float64],
    deadline_s: float,
) -> NDArray[np.bool_]:
    """Return where a drone over a node with the most charge it can have can be at the destination by a deadline.

    By the bound of `forward_pass`: x + L and reserve / r + L (1 + c / r) - (E / r - x) are both no later.

    Takes arrays of the cells and nodes, and any deadline.

    Parameters
    ----------
    over : ndarray, shape (cells, nodes)
        E of `forward_pass`.
    least_s : ndarray, shape (nodes,)
        Of `least_times`.

    Returns
    -------
    ndarray of bool, shape (cells, nodes)
    """
    out = np.zeros(over.shape, dtype=np.bool_)
    drain = (costs.soc_per_s + costs.rate_per_s) / costs.rate_per_s
    for i in range(len(over)):
        x = cells.over_s + i * cells.step_s
        for node in range(len(least_s)):
            # L, and the time by which charge lets it arrive.
            flight = least_s[node] + descent_s
            charge = (costs.reserve - over[i, node]) / costs.rate_per_s + flight * drain
            out[i, node] = over[i, node] > _NONE and max(x + flight, x + charge) <= deadline_s
    return out
