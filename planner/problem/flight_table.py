"""Flights in one known wind, with tabulated ground speeds.

The rules are those of `models.flight.rules`; a table that was not made from a wind, for example of harmonic mean speeds over
the members of a forecast, follows them too: constant within a slot, 0 where a segment is closed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER, segment_speed
from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

_SLOT_EDGE_S = 1e-6  # a time this close below a boundary counts as beyond it, as in `models.flight.kernels`


class FlightTable(NamedTuple):
    """A network and the ground speed over each of its segments in each slot.

    Attributes
    ----------
    start_s, slot_s : float
        POSIX seconds of the first slot and length of a slot; the last slot holds on forever.
    climb_s, descent_s : float
        Spent at the start and the end of each flight.
    first, head : ndarray of int
        Segments that leave node i are ``first[i] : first[i + 1]``; where they lead.
    distance_m : ndarray, shape (segments,)
        Their lengths.
    speed_mps : ndarray, shape (slots, segments)
        Ground speeds; 0 where a segment cannot be flown.
    """

    start_s: float
    slot_s: float
    climb_s: float
    descent_s: float
    first: NDArray[np.int64]
    head: NDArray[np.int64]
    distance_m: NDArray[np.float64]
    speed_mps: NDArray[np.float64]


@compiled
def ground_speeds(
    air: SegmentWind, member: int, slots: NDArray[np.int64], segments: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Ground speeds over some segments in some slots of one member, shape (slots, segments).

    Takes a member, slots and segments of the air, any number of them.
    """
    out = np.empty((len(slots), len(segments)))
    for row in range(len(slots)):
        for column in range(len(segments)):
            out[row, column] = segment_speed(air, member, slots[row], segments[column])
    return out


@compiled
def table_slot(table: FlightTable, time_s: float) -> int:
    """Slot that holds a time; times outside the series use its first or last slot.

    Takes any time, infinite and NaN included.
    """
    slot = int(math.floor((time_s + _SLOT_EDGE_S - table.start_s) / table.slot_s))
    return min(max(slot, 0), len(table.speed_mps) - 1)


@compiled
def table_slot_end(table: FlightTable, slot: int) -> float:
    """POSIX seconds at which a slot ends; the last one never does.

    Takes any slot; those from the last on never end.
    """
    if slot >= len(table.speed_mps) - 1:
        return NEVER
    return table.start_s + (slot + 1) * table.slot_s


@compiled
def table_cruise(table: FlightTable, segment: int, time_s: float) -> float:
    """Time at which a segment entered at `time_s` is left again; never where a slot on the way forbids it."""
    left = table.distance_m[segment]
    now = time_s
    slot = table_slot(table, now)
    while True:
        speed = table.speed_mps[slot, segment]
        if speed <= 0.0:
            return NEVER
        end = table_slot_end(table, slot)
        out: float = now + left / speed
        if out <= end:
            return out
        left -= speed * (end - now)
        now = end
        slot += 1


@compiled
def table_land(table: FlightTable, segments: NDArray[np.int64], depart_s: float) -> float:
    """Touch-down of a flight over segments that takes off at `depart_s`; never where it is not flyable.

    Takes segments of the table and any time; infinite and NaN never land.
    """
    now = depart_s + table.climb_s
    for segment in segments:
        now = table_cruise(table, segment, now)
        if now == NEVER:
            return NEVER
    now += table.descent_s
    for slot in range(table_slot(table, depart_s), table_slot(table, now - 2.0 * _SLOT_EDGE_S) + 1):
        for segment in segments:
            if table.speed_mps[slot, segment] <= 0.0:
                return NEVER
    return now
