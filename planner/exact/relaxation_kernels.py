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

The bests of a cell are those of different drones, and each flight and each stay would gain up to a cell by that. So two more numbers go
along, which nothing rounds: e_i(v), when a drone can be over the node at the soonest in the cell, and P_i(v), the most that E / r - t can be
there, with t the time and r the greatest rate of any pad: no charging increases that, and a flight of T seconds decreases it by T (1 + c / r).
On a pad nobody has a potential of more than F^-1(E) - e, nor of more than F^-1(E) - E / r + P. Flights end no sooner than e + T.

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
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.exact.relaxation_grid_kernels import (
    LOOSE,
    TIE_S,
    Cells,
    Waits,
    cell_of,
    charge_after,
    crossed,
    nearest_first,
    open_in,
    regular_s,
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
    waits: Waits
    """Of `queue_cells`."""
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


class Reached(NamedTuple):
    """What can be had over nodes, in cells by nodes one behind the other: the best of each, of different drones perhaps."""

    charge: NDArray[np.float64]
    rest: NDArray[np.float64]
    """Most charge, and that for reserve and margin alone."""
    potential: NDArray[np.float64]
    """Most charge in seconds of the greatest rate, less the time."""
    early_s: NDArray[np.float64]
    """When a drone can be there at the soonest, POSIX seconds."""


@compiled_lean
def _reach(
    reached: Reached, place: int, charge: float, rest: float, potential: float, time_s: float, margin: bool
) -> bool:
    """Take note of what is had at a place; tells whether that is better in anything."""
    better: bool = (
        charge > reached.charge[place] or potential > reached.potential[place] or time_s < reached.early_s[place]
    )
    reached.charge[place] = max(charge, reached.charge[place])
    reached.potential[place] = max(potential, reached.potential[place])
    reached.early_s[place] = min(time_s, reached.early_s[place])
    if margin:
        better |= rest > reached.rest[place]
        reached.rest[place] = max(rest, reached.rest[place])
    return better


@compiled
def forward_pass(  # noqa: PLR0915  one loop: taking it apart costs more than the work that is done in it
    one: Pass, origin: tuple[int, float, float, float, bool], remaining: tuple[NDArray[np.float64], float], after: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, int]:
    """Most charge that a drone can have over each node, and leave it with, in each cell: see this module.

    A drone over a node is dropped when it cannot be at the destination by the deadline D even at the
    best: with L the least time of flight left and r the greatest rate of charging, it arrives no earlier than e + L,
    nor than reserve / r + L (1 + c / r) - P (see `planner.exact.stop_label_kernels.stop_label_bound`).

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
    over_goal_s : float
        When a drone is over the destination at the soonest with what it needs there; never if it is not.
    last : int
        The last cell filled.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    waits, has_pads = one.waits, one.has_pads
    allowed, goal, ratio = one.allowed, one.goal, one.ratio
    nodes = len(table.first) - 1
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    rows = np.full((9 if margin else 7, cells.length, nodes), _NONE)
    over, leave, landed, onto = rows[0], rows[1], rows[2], rows[3]
    # Over a node by flights that may end in a cell or in the one after it; those and `over` for reserve and margin alone.
    soon = rows[4]
    potential, soon_potential = rows[5], rows[6]
    rest, soon_rest = (rows[7], rows[8]) if margin else (over, soon)
    times = np.full((2, cells.length, nodes), NEVER)
    early, soon_early = times[0], times[1]
    flat = Reached(over.reshape(-1), rest.reshape(-1), potential.reshape(-1), early.reshape(-1))
    flat_soon = Reached(soon.reshape(-1), soon_rest.reshape(-1), soon_potential.reshape(-1), soon_early.reshape(-1))
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
    # Charge of a climb; least charge to land with; terms of the bound that drops what is late.
    climb = costs.soc_fixed + per_s * table.climb_s
    enough = costs.reserve - LOOSE + strict * table.descent_s
    full_s = costs.reserve / costs.rate_per_s
    drain = (per_s + costs.rate_per_s) / costs.rate_per_s
    known = table_slot(table, cells.over_s)
    open_now = open_in(table, known, cells.step_s)
    inner = nearest_first(open_now, cells.step_s)
    i, since = begin - 1, begin
    while i < last:
        i += 1
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        if slot != known:
            known, since = slot, i
            open_now = open_in(table, slot, cells.step_s)
            inner = nearest_first(open_now, cells.step_s)
        ends = table_slot_end(table, slot)
        if open_now.first[nodes] == 0 and i > since + 2 and x + 1.5 * cells.step_s < ends:
            # All is shut, and what flew has landed: drones only charge. How far is seen in the last cell of the slot.
            for node in range(nodes):
                h[node], z[node] = max(h[node], landed[i, node]), max(z[node], onto[i, node])
            continue
        inside = regular_s(table, slot, x, cells.step_s)
        down_by = x + cells.step_s + table.descent_s
        # From then on, flights are over segments that open with the slot.
        opened_s = table.start_s + slot * table.slot_s + table.climb_s
        for before in range(max(i - 1, 0), i + 1):
            for node in range(nodes):
                over[i, node] = max(over[i, node], soon[before, node])
                potential[i, node] = max(potential[i, node], soon_potential[before, node])
                if soon_early[before, node] < NEVER:
                    early[i, node] = min(early[i, node], max(soon_early[before, node], x))
                if margin:
                    rest[i, node] = max(rest[i, node], soon_rest[before, node])
        for node in range(nodes):
            seen[node] |= over[i, node] > _NONE
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
                charge, at_s = over[i, node], early[i, node]
                can = min(potential[i, node], charge / costs.rate_per_s - at_s)
                left = rest[i, node] if margin else charge
                late = max(at_s + flight, full_s + flight * drain - can) > deadline
                if barred or late or left < enough:
                    charge = left = can = _NONE
                    at_s = NEVER
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
                    hover = max(0.0, waits.spot_s[i, node] - down_by) + table.descent_s
                    down = charge - per_s * hover
                    if left - strict * hover >= costs.reserve - LOOSE:
                        cell = waits.spot_cell[i, node]
                        if cell < cells.length:
                            landed[cell, node] = max(landed[cell, node], down)
                        cell = waits.pad_cell[i, node]
                        if cell < cells.length:
                            # No more than by the soonest touch-down, nor than by the potential: a pad charges at the greatest rate at most.
                            full = time_from_empty(grounds, node, down)
                            u = full - max(waits.pad_s[i, node], at_s + table.descent_s)
                            v = full - down / costs.rate_per_s + can - drain * table.descent_s
                            onto[cell, node] = max(onto[cell, node], min(u, v))
                # H, Z and leave.
                h[node], z[node] = max(h[node], landed[i, node]), max(z[node], onto[i, node])
                begin_s = max(x, depart_s + table.climb_s)
                off = soonest = h[node]
                if z[node] > _NONE:
                    off = max(off, charge_after(grounds, node, x + cells.step_s - table.climb_s + z[node]))
                    soonest = max(soonest, charge_after(grounds, node, begin_s - table.climb_s + z[node]))
                if at_once and node == start and i > begin:
                    off = _NONE
                leave[i, node] = off
                # Take off: over the node with what is left after the climb, unless that is late or all is shut.
                off -= climb
                gained = (soonest - climb) / costs.rate_per_s - begin_s
                barred |= off == _NONE or open_now.first[node] == open_now.first[node + 1]
                late = max(begin_s + flight, full_s + flight * drain - gained) > deadline
                if not barred and not late:
                    can, at_s = max(can, gained), min(at_s, begin_s)
                    charge, left = max(charge, off), max(left, off - costs.margin_soc_per_s * table.climb_s)
                over[i, node], potential[i, node], early[i, node] = charge, can, at_s
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
                    there_s = (max(at_s, opened_s) if open_now.opened[k] else at_s) + least
                    if cell != i or lesser < enough or there_s > x + cells.step_s + TIE_S:
                        continue
                    other, less = open_now.head[k], charge - per_s * least
                    if _reach(flat, i * nodes + other, less, lesser, can - drain * least, there_s, margin):
                        seen[other] = stale[other] = again = True
        # Cruise: charge over other nodes in the later cells in which a flight over the segment may end.
        # A flight within the slot takes one time, whenever it enters, and ends in one of two cells.
        regular = min(inside, (cells.length - 1 - i) * cells.step_s)
        for node in range(nodes):
            charge, can, at_s = over[i, node], potential[i, node], early[i, node]
            left = rest[i, node] if margin else charge
            if left < enough:
                continue
            for k in range(open_now.first[node], open_now.first[node + 1]):
                least = open_now.takes_s[k]
                cell = i + open_now.steps[k]
                if least <= regular and cell > i:
                    place = i * nodes + open_now.place[k]
                    less, lesser, there_s = charge - per_s * least, left - strict * least, at_s + least
                    if lesser < enough:
                        continue
                    if there_s <= x + (open_now.steps[k] + 1) * cells.step_s + TIE_S:
                        _reach(flat_soon, place, less, lesser, can - drain * least, there_s, margin)
                    elif cell + 1 < cells.length:
                        _reach(flat, place + nodes, less, lesser, can - drain * least, there_s, margin)
                    continue
                end = cell + 1
                if least > inside:
                    cell, end, least = crossed(table, cells, open_now, k, i, (x, slot, ends))
                less, lesser = charge - per_s * least, left - strict * least
                if lesser < enough:
                    continue
                there_s = (max(at_s, opened_s) if open_now.opened[k] else at_s) + least
                cell = max(cell, i + 1, i + int((there_s - TIE_S - x) / cells.step_s))
                while cell <= min(end, cells.length - 1):
                    begin_s = max(there_s, x + (cell - i) * cells.step_s)
                    _reach(flat, cell * nodes + open_now.head[k], less, lesser, can - drain * least, begin_s, margin)
                    cell += 1
    return over, leave, early[found, goal] if found < cells.length else NEVER, last


@compiled
def needed_where(
    over: NDArray[np.float64], leave: NDArray[np.float64], has_over: NDArray[np.float64], has_leave: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return what is needed over nodes where a drone can have it, and when it can leave them with what that takes.

    Takes arrays of the cells and nodes.

    Parameters
    ----------
    over, leave, has_over, has_leave : ndarray, shape (cells, nodes)
        Of `backward_pass` and of `forward_pass`.

    Returns
    -------
    need : ndarray, shape (cells, nodes)
        The former `over`; infinite where no drone has as much.
    window : ndarray of int, shape (nodes, 2)
        First and last cell in which it can leave each node; (0, -1) where it cannot.
    """
    cells, nodes = over.shape
    need = np.empty((cells, nodes))
    window = np.zeros((nodes, 2), dtype=np.int64)
    window[:, 1] = -1
    for i in range(cells):
        for node in range(nodes):
            need[i, node] = over[i, node] if has_over[i, node] >= over[i, node] - LOOSE else NEVER
            if leave[i, node] < NEVER and has_leave[i, node] >= leave[i, node] - LOOSE:
                if window[node, 1] < 0:
                    window[node, 0] = i
                window[node, 1] = i
    return need, window


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
