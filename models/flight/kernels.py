"""Compiled kernels of flights through slotted wind. See `models.flight.rules` for the rules and `SegmentWind` for the arrays."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.jit.compiled import compiled_lean
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

NEVER = math.inf
SLOT_EDGE_S = 1e-6  # a time this close below a boundary counts as beyond it, so that no step has length zero


@compiled_lean
def slot_of(air: SegmentWind, time_s: float) -> int:
    """Slot that holds a time; times outside the series use its first or last slot, what is not a number the last.

    Takes any time, infinite and NaN included.
    """
    last = air.north.shape[1] - 1
    slots = (time_s + SLOT_EDGE_S - air.start_s) / air.slot_s
    if not slots < last:  # later, or no number, of which no integer can be made
        return last
    return int(slots) if slots > 0.0 else 0


@compiled_lean
def slot_end(air: SegmentWind, slot: int) -> float:
    """POSIX seconds at which a slot ends; the last one never does.

    Takes any slot; those from the last on never end.
    """
    if slot >= air.north.shape[1] - 1:
        return NEVER
    return air.start_s + (slot + 1) * air.slot_s


@compiled_lean
def wind_on(air: SegmentWind, member: int, slot: int, segment: int) -> tuple[float, float]:
    """Wind (north, east) over a segment in one slot of one member."""
    north = 0.0
    east = 0.0
    for site in range(air.weight.shape[1]):
        north += air.weight[segment, site] * air.north[member, slot, site]
        east += air.weight[segment, site] * air.east[member, slot, site]
    return north, east


@compiled_lean
def segment_speed(air: SegmentWind, member: int, slot: int, segment: int) -> float:
    """Ground speed over a segment in one slot (equations 1-5); 0 where it cannot be flown."""
    north, east = wind_on(air, member, slot, segment)
    along = north * air.cos_bearing[segment] + east * air.sin_bearing[segment]
    across = east * air.cos_bearing[segment] - north * air.sin_bearing[segment]
    square = air.airspeed_mps * air.airspeed_mps - across * across
    if square <= 0.0 or north * north + east * east > air.wind_limit_mps * air.wind_limit_mps:
        return 0.0
    speed = along + math.sqrt(square)
    if not speed >= MIN_GROUND_SPEED_MPS:  # not a number either
        return 0.0
    return min(speed, air.max_ground_speed_mps)


@compiled_lean
def cruise(air: SegmentWind, member: int, segment: int, time_s: float) -> float:
    """Time at which a segment entered at `time_s` is left again; never where a slot on the way forbids it."""
    left = air.distance_m[segment]
    now = time_s
    slot = slot_of(air, now)
    while True:
        speed = segment_speed(air, member, slot, segment)
        if speed <= 0.0:
            return NEVER
        end = slot_end(air, slot)
        if end == NEVER or now + left / speed <= end:
            return now + left / speed
        left -= speed * (end - now)
        now = end
        slot += 1


@compiled_lean
def land(air: SegmentWind, member: int, segments: NDArray[np.int64], depart_s: float) -> float:
    """Touch-down of a flight over segments that takes off at `depart_s`; never where it is not flyable."""
    now = depart_s + air.climb_s
    for segment in segments:
        now = cruise(air, member, segment, now)
        if now == NEVER:
            return NEVER
    now += air.descent_s
    first = slot_of(air, depart_s)
    last = slot_of(air, now - 2.0 * SLOT_EDGE_S)
    if len(segments) == 1 and last == first:
        return now
    for slot in range(first, last + 1):
        for segment in segments:
            if segment_speed(air, member, slot, segment) <= 0.0:
                return NEVER
    return now


@compiled_lean
def next_opening(air: SegmentWind, member: int, segments: NDArray[np.int64], time_s: float) -> float:
    """First time from `time_s` on at which a take-off makes a flyable flight; never where the wind stays over limits.

    Takes a member and segments of the air (checked where `air_over` and the itinerary are made), and any time: none that is infinite or NaN is
    flyable.
    """
    now = time_s
    while True:
        if land(air, member, segments, now) < NEVER:
            return now
        end = slot_end(air, slot_of(air, now))
        if end == NEVER:
            return NEVER
        now = end


@compiled_lean
def leg(air: SegmentWind, member: int, segment: int, time_s: float) -> tuple[float, float]:
    """Take-off and touch-down of a one-segment flight that leaves at `time_s` or, held by the wind, when it first can."""
    off = time_s
    first = slot_of(air, off)
    while True:
        slot = first
        end = slot_end(air, slot)
        flyable = True
        now = off + air.climb_s
        while now >= end - SLOT_EDGE_S and flyable:  # the climb reaches into the next slot: this one counts too
            flyable = segment_speed(air, member, slot, segment) > 0.0
            slot += 1
            end = slot_end(air, slot)
        left = air.distance_m[segment]
        while flyable:
            speed = segment_speed(air, member, slot, segment)
            if speed <= 0.0:
                flyable = False
            elif end == NEVER or now + left / speed <= end:
                now += left / speed
                break
            else:
                left -= speed * (end - now)
                now = end
                slot += 1
                end = slot_end(air, slot)
        down = now + air.descent_s
        while flyable and down > end + SLOT_EDGE_S:  # and so does the descent
            slot += 1
            end = slot_end(air, slot)
            flyable = segment_speed(air, member, slot, segment) > 0.0
        if flyable:
            return off, down
        first += 1
        if first >= air.north.shape[1]:
            return NEVER, NEVER
        off = slot_end(air, first - 1)
