"""Kernel of the relaxation's backward pass over a grid of times: the mirror of `planner.exact.relaxation_kernels.forward_pass`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.exact.relaxation_grid_kernels import (
    LOOSE,
    Cells,
    Open,
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

    from skyway.planner.exact.relaxation_kernels import Pass
    from skyway.planner.problem.flight_table import FlightTable


class Later(NamedTuple):
    """Least charges over nodes in the cells that `backward_pass` has been through, shape (cells, nodes) each."""

    over: NDArray[np.float64]
    aloft: NDArray[np.float64]
    """Of a drone that took off in the slot before that of the cell."""
    soon: NDArray[np.float64]
    """Shape (cells x nodes,). The lesser of `over` in a cell and in the next one."""
    rest: NDArray[np.float64]
    aloft_rest: NDArray[np.float64]
    soon_rest: NDArray[np.float64]
    """The same for reserve and margin alone."""
    following: int
    """First cell of the next slot."""
    per_s: float
    strict: float
    """Charges that a second takes, of which the second is for reserve and margin alone."""


@compiled_lean
def _onward(
    table: FlightTable,
    cells: Cells,
    open_now: Open,
    later: Later,
    flown: tuple[int, int],
    i: int,
    in_slot: tuple[float, int, float],
    regular: tuple[float, float],
    is_aloft: bool,
) -> tuple[float, float]:
    """Return the least charge to fly on over some open segments to the cheapest of the later cells in which the flight may end.

    And that for reserve and margin alone. `flown` are the first of the segments and the one after the last. Flights of up to ``regular[0]``
    seconds end in one of two cells of the slot, see `regular_s`, and those of more than ``regular[1]`` are `crossed`. A drone that
    `is_aloft` since the slot before is over no segment that has been opened since.
    """
    per_s, strict = later.per_s, later.strict
    regular_s, inside = regular
    nodes = later.over.shape[1]
    fly, least_rest = NEVER, NEVER
    for k in range(flown[0], flown[1]):
        if is_aloft and open_now.opened[k]:
            continue
        least = open_now.takes_s[k]
        if least <= regular_s and open_now.steps[k] > 0 and not is_aloft:
            place = i * nodes + open_now.place[k]
            fly = min(fly, later.soon[place] + per_s * least)
            least_rest = min(least_rest, later.soon_rest[place] + strict * least)
            continue
        cell = i + open_now.steps[k]
        end = cell + 1
        if least > inside:
            cell, end, least = crossed(table, cells, open_now, k, i, in_slot)
        other = open_now.head[k]
        cell, end = max(cell, i + 1), min(end, cells.length - 1)
        while cell <= end:
            if is_aloft or cell >= later.following:
                fly = min(fly, later.aloft[cell, other] + per_s * least)
                least_rest = min(least_rest, later.aloft_rest[cell, other] + strict * least)
            else:
                fly = min(fly, later.over[cell, other] + per_s * least)
                least_rest = min(least_rest, later.rest[cell, other] + strict * least)
            cell += 1
    return fly, least_rest


@compiled_lean
def _within_cell(
    table: FlightTable,
    cells: Cells,
    open_now: Open,
    later: Later,
    flown: tuple[int, int],
    i: int,
    in_slot: tuple[float, int, float],
    inside: float,
    is_aloft: bool,
) -> tuple[float, float]:
    """Return the same as `_onward` for flights that end in the cell in which they begin; `flown` are the nearest segments."""
    over, rest = (later.aloft, later.aloft_rest) if is_aloft else (later.over, later.rest)
    fly, least_rest = NEVER, NEVER
    for k in range(flown[0], flown[1]):
        if is_aloft and open_now.opened[k]:
            continue
        cell, least = i + open_now.steps[k], open_now.takes_s[k]
        if least > inside:
            cell, _, least = crossed(table, cells, open_now, k, i, in_slot)
        if cell == i and least < NEVER:
            fly = min(fly, over[i, open_now.head[k]] + later.per_s * least)
            least_rest = min(least_rest, rest[i, open_now.head[k]] + later.strict * least)
    return fly, least_rest


@compiled
def backward_pass(one: Pass) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # noqa: PLR0915  one loop: taking it apart costs more than the work that is done in it
    """Least charge from which the destination can be reached in time, over each node and on leaving it.

    The mirror of `forward_pass`, with the last cell first. A_i(v) is the least charge over node v:

        A_i(v)     = min(A_j(w) + c T over the segments (v, w) and the cells j in which they may end,  landing)
        leave_i(v) = the first of these alone, + k + c climb
        landing    = needed + c descent at the destination; at another station max(reserve, stay) + c (hover + descent)
        stay       = min(leave_j(v) for the j from the cell of the touch-down on,  F(pad time + Z))
        Z          = least F^-1(leave_j(v)) - (x_(j+1) - climb) for the j from the cell of the pad time on

    After a slot begins, `aloft` is A_i(v) of a drone that took off before: over none of the segments that have been opened.
    Flights from one slot into the next lead there.

    With a margin m, `rest` is the least charge for reserve and margin alone, at c + m a second.

    Takes a `Pass` of `planner.exact.relaxation`: a cell or more, and arrays of its cells and nodes.

    Returns
    -------
    over, leave : ndarray, shape (cells, nodes)
        A and leave; infinite where there is no way.
    """
    table, grounds, costs, cells = one.table, one.grounds, one.costs, one.cells
    waits, has_pads = one.waits, one.has_pads
    allowed, goal, ratio = one.allowed, one.goal, one.ratio
    nodes = len(table.first) - 1
    per_s, strict = costs.soc_per_s, costs.soc_per_s + costs.margin_soc_per_s
    margin = costs.margin_soc_per_s > 0.0  # without one the second value of each node is the first
    # Over a node, for reserve and margin alone too, and to leave it.
    found = np.full((3 if margin else 2, cells.length + 1, nodes), NEVER)
    over, rest, leave = found[0], found[-2], found[-1]
    # Over it if the drone took off in the slot before; over it in this cell or in the next one.
    rows = np.empty((6 if margin else 4, cells.length + 1, nodes))
    aloft, soon = rows[0], rows[1]
    aloft_rest, soon_rest = rows[-4], rows[-3]
    # To leave it, and the potential, the least of all from the cell on.
    ever, potential = rows[-2], rows[-1]
    rows[:, cells.length] = NEVER
    flat, flat_rest = soon.reshape(-1), soon_rest.reshape(-1)
    climb = costs.soc_fixed + per_s * table.climb_s
    longest_s = (1.0 - costs.reserve - costs.soc_fixed) / per_s
    known = table_slot(table, cells.over_s)
    open_now = open_in(table, known, cells.step_s)
    inner = nearest_first(open_now, cells.step_s)
    any_inner = inner.max() > 0
    any_opened = open_now.opened.any()
    onward, onward_rest = np.empty(nodes), np.empty(nodes)  # by flights that end in later cells
    landing, landing_rest = np.empty(nodes), np.empty(nodes)
    # The first cell from each on in which anything is allowed: `ever` and `potential` are known of these cells alone.
    live = np.full(cells.length + 1, cells.length)
    for i in range(cells.length - 1, -1, -1):
        live[i] = i if allowed[i // ratio].any() else live[i + 1]
    for i in range(cells.length - 1, -1, -1):
        if live[i] > i:
            soon[i], aloft[i] = over[i + 1], NEVER
            if margin:
                soon_rest[i], aloft_rest[i] = rest[i + 1], NEVER
            continue
        x = cells.over_s + i * cells.step_s
        slot = table_slot(table, x)
        if slot != known:
            known = slot
            open_now = open_in(table, slot, cells.step_s)
            inner = nearest_first(open_now, cells.step_s)
            any_inner = inner.max() > 0
            any_opened = open_now.opened.any()
        ends = table_slot_end(table, slot)
        inside = regular_s(table, slot, x, cells.step_s)
        following = i + cell_of(Cells(x, cells.step_s, cells.length), 0.0, ends + 0.1)
        later = Later(over, aloft, flat, rest, aloft_rest, flat_rest, following, per_s, strict)
        # A flight within the slot takes one time, whenever it enters, and ends in one of two cells.
        regular = min(inside, (cells.length - 1 - i) * cells.step_s)
        down_by = x + cells.step_s + table.descent_s
        ever[i], potential[i] = ever[live[i + 1]], potential[live[i + 1]]
        for node in range(nodes):
            onward[node] = onward_rest[node] = landing[node] = landing_rest[node] = NEVER
            if not allowed[i // ratio, node]:
                continue
            low, high = open_now.first[node], open_now.first[node + 1]
            special = high if open_now.longest_s[node] > regular else low + inner[node]
            fly, least_rest = NEVER, NEVER
            for k in range(special, high):
                fly = min(fly, flat[i * nodes + open_now.place[k]] + per_s * open_now.takes_s[k])
            if margin:
                for k in range(special, high):
                    least_rest = min(
                        least_rest, flat_rest[i * nodes + open_now.place[k]] + strict * open_now.takes_s[k]
                    )
            onward[node], onward_rest[node] = fly, least_rest
            if special > low:
                fly, least_rest = _onward(
                    table, cells, open_now, later, (low, special), i, (x, slot, ends), (regular, inside), False
                )
                onward[node], onward_rest[node] = min(fly, onward[node]), min(least_rest, onward_rest[node])
        again, first_time = True, True
        while again:
            again = False
            for node in range(nodes):
                if not (allowed[i // ratio, node] and (first_time or inner[node] > 0)):
                    continue
                # And to nodes that are reached within this cell.
                near = open_now.first[node], open_now.first[node] + inner[node]
                fly, least_rest = _within_cell(table, cells, open_now, later, near, i, (x, slot, ends), inside, False)
                fly, least_rest = min(fly, onward[node]), min(least_rest, onward_rest[node])
                if not (first_time or fly < onward[node] or (margin and least_rest < onward_rest[node])):
                    continue
                onward[node], onward_rest[node] = fly, least_rest
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
                    landing[node] = one.needed[i] + per_s * table.descent_s
                    landing_rest[node] = one.needed[i] + strict * table.descent_s
                elif has_pads[node] and ever[i, node] < NEVER:
                    # Or at a station, to leave it later as it is or, from a pad, charged.
                    down = NEVER
                    cell = live[waits.spot_cell[i, node]]
                    if cell < cells.length:
                        down = ever[cell, node]
                    cell = live[waits.pad_cell[i, node]]
                    if cell < cells.length and potential[cell, node] < NEVER:
                        down = min(down, charge_after(grounds, node, waits.pad_s[i, node] + potential[cell, node]))
                    hover = max(0.0, waits.spot_s[i, node] - down_by) + table.descent_s
                    landing[node] = max(down, costs.reserve) + per_s * hover
                    if down < NEVER:
                        landing_rest[node] = costs.reserve + strict * hover
                fly, least_rest = min(fly, landing[node]), min(least_rest, landing_rest[node])
                # Look again while a segment that is flown within the cell makes it less.
                if fly < over[i, node] or (margin and least_rest < rest[i, node]):
                    over[i, node] = min(fly, over[i, node])
                    if margin:
                        rest[i, node] = min(least_rest, rest[i, node])
                    again = any_inner
            first_time = False
        soon[i] = np.minimum(over[i], over[i + 1])
        if margin:
            soon_rest[i] = np.minimum(rest[i], rest[i + 1])
        # What took off in the slot before, as long as it may fly, keeps off what has been opened since.
        if not any_opened or x > table.start_s + slot * table.slot_s + longest_s:
            aloft[i] = over[i]
            if margin:
                aloft_rest[i] = rest[i]
            continue
        aloft[i], aloft_rest[i] = NEVER, NEVER
        for node in range(nodes):
            if allowed[i // ratio, node]:
                flown = open_now.first[node], open_now.first[node + 1]
                fly, least_rest = _onward(
                    table, cells, open_now, later, flown, i, (x, slot, ends), (regular, inside), True
                )
                aloft[i, node] = min(fly, landing[node])
                if margin:
                    aloft_rest[i, node] = min(least_rest, landing_rest[node])
        again = any_inner
        while again:
            again = False
            for node in range(nodes):
                if not allowed[i // ratio, node]:
                    continue
                near = open_now.first[node], open_now.first[node] + inner[node]
                fly, least_rest = _within_cell(table, cells, open_now, later, near, i, (x, slot, ends), inside, True)
                if fly < aloft[i, node] or (margin and least_rest < aloft_rest[i, node]):
                    aloft[i, node], again = min(fly, aloft[i, node]), True
                    if margin:
                        aloft_rest[i, node] = min(least_rest, aloft_rest[i, node])
    return over[:-1], leave[:-1]
