"""Flights in one known wind, with tabulated ground speeds.

The rules are those of `models.flight.rules`; a table that was not made from a wind, for example of harmonic mean speeds over
the members of a forecast, follows them too: constant within a slot, 0 where a segment is closed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import Slots, cross, land_by, segment_speed, slot_number, slot_until
from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind


class FlightTable(NamedTuple):
    """A network and the ground speed over each of its segments in each slot."""

    start_s: float
    slot_s: float
    """POSIX seconds of the first slot and length of a slot; the last slot holds on forever."""
    climb_s: float
    descent_s: float
    """Spent at the start and the end of each flight."""
    first: NDArray[np.int64]
    head: NDArray[np.int64]
    """Segments that leave node i are ``first[i] : first[i + 1]``; where they lead."""
    distance_m: NDArray[np.float64]
    """Shape (segments,). Their lengths."""
    speed_mps: NDArray[np.float64]
    """Shape (slots, segments). Ground speeds; 0 where a segment cannot be flown."""


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
def table_slots(table: FlightTable) -> Slots:
    """Slots of a table."""
    return Slots(table.start_s, table.slot_s, len(table.speed_mps))


@compiled
def table_slot(table: FlightTable, time_s: float) -> int:
    """Slot that holds a time, see `models.flight.kernels.slot_number`.

    Takes any time, infinite and NaN included.
    """
    return slot_number(table_slots(table), time_s)


@compiled
def table_slot_end(table: FlightTable, slot: int) -> float:
    """POSIX seconds at which a slot ends; the last one never does.

    Takes any slot; those from the last on never end.
    """
    return slot_until(table_slots(table), slot)


@compiled
def _table_speed(table: FlightTable, slot: int, segment: int) -> float:
    """Ground speed as `models.flight.kernels.cross` takes it."""
    speed: float = table.speed_mps[slot, segment]
    return speed


@compiled
def table_cruise(table: FlightTable, segment: int, time_s: float, last_slot: int) -> float:
    """Time at which a segment entered at `time_s` is left again, where the wind of `last_slot` is held on after it.

    Never where a slot on the way forbids it.
    """
    slots = Slots(table.start_s, table.slot_s, last_slot + 1)
    return cross(_table_speed, table, slots, table.distance_m[segment], segment, time_s)


@compiled
def table_land(table: FlightTable, segments: NDArray[np.int64], depart_s: float) -> float:
    """Touch-down of a flight over segments that takes off at `depart_s`; never where it is not flyable.

    Takes segments of the table and any time; infinite and NaN never land.
    """
    return land_by(
        _table_speed,
        table,
        table_slots(table),
        table.climb_s,
        table.descent_s,
        table.distance_m,
        segments,
        depart_s,
    )
