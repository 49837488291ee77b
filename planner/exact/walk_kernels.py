"""The segments of the earliest flight between two stations at one take-off."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight.kernels import NEVER, SLOT_EDGE_S
from skyway.models.jit.compiled import compiled
from skyway.planner.problem.flight_table import table_cruise, table_slot

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.problem.flight_table import FlightTable


@compiled
def earliest_walk(
    table: FlightTable, origin: int, target: int, leave_s: float, longest_s: float
) -> tuple[float, NDArray[np.int64]]:
    """Touch-down of the earliest flight between two nodes that takes off at a time, and its segments in order.

    Dijkstra's algorithm on times over nodes, once for each slot that the flight may end in, on the segments that are
    open in all slots up to it (`models.flight.rules`): the touch-down is never, and there are no segments, where no
    flight that lasts up to `longest_s` is possible.

    Takes two nodes of the table, any finite take-off and any length.
    """
    nodes, last_slot = len(table.first) - 1, len(table.speed_mps) - 1
    begin = table_slot(table, leave_s)
    best_s, best = NEVER, np.empty(0, dtype=np.int64)
    closed = np.zeros(len(table.head), dtype=np.bool_)
    # How the earliest way found enters each node: its segment, and the node before.
    by, before = np.empty(nodes, dtype=np.int64), np.empty(nodes, dtype=np.int64)
    over = np.empty(nodes)
    for last in range(begin, table_slot(table, leave_s + longest_s) + 1):
        for segment in range(len(table.head)):
            closed[segment] = closed[segment] or table.speed_mps[last, segment] <= 0.0
        over[:] = NEVER
        done = np.zeros(nodes, dtype=np.bool_)
        heap = [(leave_s + table.climb_s, origin, -1, -1)]
        while len(heap) > 0:
            now, node, segment, parent = heapq.heappop(heap)
            if done[node]:
                continue
            done[node], by[node], before[node] = True, segment, parent
            if node == target:
                best_s, best = now + table.descent_s, _walk_to(target, by, before)
                break
            for onward in range(table.first[node], table.first[node + 1]):
                other = table.head[onward]
                if done[other] or closed[onward]:
                    continue
                there = table_cruise(table, onward, now, last_slot)
                if there >= over[other] or there + table.descent_s >= best_s:
                    continue
                # A flight that ends later than in the last slot must be open in the slots that it touches as well.
                ends = table_slot(table, there + table.descent_s - 2.0 * SLOT_EDGE_S)
                if ends > last and not _open(table, onward, node, by, before, (last + 1, ends)):
                    continue
                over[other] = there
                heapq.heappush(heap, (there, other, onward, node))
    return best_s, best


@compiled
def _open(
    table: FlightTable,
    segment: int,
    node: int,
    by: NDArray[np.int64],
    before: NDArray[np.int64],
    slots: tuple[int, int],
) -> bool:
    """Whether a segment and the way to the node that it begins at can be flown in all slots from the first to the last."""
    while segment >= 0:
        for slot in range(slots[0], slots[1] + 1):
            if table.speed_mps[slot, segment] <= 0.0:
                return False
        segment, node = by[node], before[node]
    return True


@compiled
def _walk_to(node: int, by: NDArray[np.int64], before: NDArray[np.int64]) -> NDArray[np.int64]:
    """Segments of the way to a node, in order: back from it by what enters each node, -1 where the way begins."""
    count, at = 0, node
    while by[at] >= 0:
        count += 1
        at = before[at]
    out = np.empty(count, dtype=np.int64)
    at = node
    for k in range(count - 1, -1, -1):
        out[k] = by[at]
        at = before[at]
    return out
