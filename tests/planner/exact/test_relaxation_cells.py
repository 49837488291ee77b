"""Cells in which flights over a segment may end: what the passes read of open segments says the same as the flights themselves."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skyway.planner.exact.relaxation_grid_kernels import Cells, crossed, nearest_first, open_in
from skyway.planner.problem.flight_table import FlightTable, table_cruise, table_slot, table_slot_end

SLOT_S = 3600.0

speeds = st.one_of(st.just(0.0), st.floats(2.0, 25.0))


def way(lengths_m, rows):
    """One node with a segment of each length to another; ground speeds by slot and segment."""
    count = len(lengths_m)
    first = np.array([0, count, *([count] * count)])
    return FlightTable(1e9, SLOT_S, 30.0, 30.0, first, np.arange(1, count + 1), np.array(lengths_m), np.array(rows))


def is_allowed(table, segment, entered_s, left_s):
    """Whether the segment is open in all slots from a take-off just before it to a touch-down just after."""
    if not np.isfinite(left_s):
        return False
    begin, end = table_slot(table, entered_s - table.climb_s), table_slot(table, left_s + table.descent_s - 1e-3)
    return all(table.speed_mps[slot, segment] > 0.0 for slot in range(begin, end + 1))


@settings(max_examples=200)
@example([(21601.0, 2.0, 2.0, 2.0)], 0)
@example([(7141.0, 2.0, 0.0, 0.0)], 0)
@example([(500.0, 0.0, 20.0, 0.0)], 36)
@given(
    st.lists(st.tuples(st.floats(50.0, 60_000.0), speeds, speeds, speeds), min_size=1, max_size=6), st.integers(0, 71)
)
def test_flights_end_in_the_cells_and_take_no_less_than_the_time_that_is_said(segments, cell):
    table = way([one[0] for one in segments], [[one[k] for one in segments] for k in (1, 2, 3)])
    cells = Cells(1e9, 100.0, 108)
    over_s = cells.over_s + cell * cells.step_s
    slot = int(table_slot(table, over_s))
    open_now = open_in(table, slot, cells.step_s)
    assert sorted(open_now.number[: open_now.first[1]].tolist()) == [
        k for k, one in enumerate(segments) if one[1 + slot] > 0.0
    ]
    inner = nearest_first(open_now, cells.step_s)
    for k in range(int(open_now.first[1])):
        segment = int(open_now.number[k])
        begin, end, least_s = crossed(table, cells, open_now, k, cell, (over_s, slot, table_slot_end(table, slot)))
        for entered_s in np.linspace(over_s, over_s + cells.step_s, 9):
            left_s = table_cruise(table, segment, entered_s, 2)
            if not is_allowed(table, segment, entered_s, left_s):
                continue
            assert least_s <= left_s - entered_s + 1e-5
            assert begin <= np.floor((left_s - cells.over_s) / cells.step_s + 1e-6)
            last = np.floor((left_s - cells.over_s) / cells.step_s - 1e-6)
            assert end >= min(last, cells.length)  # beyond it nothing is counted
            if left_s < over_s + cells.step_s:
                assert k < inner[0]
