"""Compiled kernels of flights through slotted wind: the wind triangle, the slots, and the walk through them.

See `models.flight.rules` for the rules and `SegmentWind` for the arrays. Whatever flies through slots (in one member,
in a table of speeds, in gusts, in wind that is taken to be worse) takes slots from `slot_number` and `slot_until`,
flies each part of a segment by `flown_part`, and, where the speed follows from slot and segment alone, walks by
`cross`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_inline, compiled_lean
from skyway.models.wind import triangle
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

NEVER = math.inf
SLOT_EDGE_S = 1e-6  # a time this close below a boundary counts as beyond it, so that no step has length zero

along_across = compiled_lean(triangle.along_across)
forward_mps = compiled_lean(triangle.forward_mps)
flyable = compiled_lean(triangle.flyable)


class Slots(NamedTuple):
    """Spans of time in each of which the wind is constant.

    Attributes
    ----------
    start_s, slot_s : float
        POSIX seconds of the first slot and length of a slot.
    length : int
        Number of slots; the last one continues without end.
    """

    start_s: float
    slot_s: float
    length: int


@compiled_lean
def slot_number(slots: Slots, time_s: float) -> int:
    """Slot that holds a time; times outside the series use its first or last slot, what is not a number the last.

    Takes any time, infinite and NaN included.
    """
    last = slots.length - 1
    passed = (time_s + SLOT_EDGE_S - slots.start_s) / slots.slot_s
    if not passed < last:  # later, or no number, of which no integer can be made
        return last
    return int(passed) if passed > 0.0 else 0


@compiled_lean
def slot_until(slots: Slots, slot: int) -> float:
    """POSIX seconds at which a slot ends; the last one never does.

    Takes any slot; those from the last on never end.
    """
    if slot >= slots.length - 1:
        return NEVER
    return slots.start_s + (slot + 1) * slots.slot_s


@compiled_lean
def slots_of(air: SegmentWind) -> Slots:
    """Slots of the wind over segments."""
    return Slots(air.start_s, air.slot_s, air.north.shape[1])


@compiled_lean
def slot_of(air: SegmentWind, time_s: float) -> int:
    """Slot of the air that holds a time, see `slot_number`.

    Takes any time, infinite and NaN included.
    """
    return slot_number(slots_of(air), time_s)


@compiled_lean
def slot_end(air: SegmentWind, slot: int) -> float:
    """POSIX seconds at which a slot of the air ends, see `slot_until`.

    Takes any slot; those from the last on never end.
    """
    return slot_until(slots_of(air), slot)


@compiled_lean
def wind_on(air: SegmentWind, member: int, slot: int, segment: int) -> tuple[float, float]:
    """Wind (north, east) over a segment in one slot of one member, m/s: the weighted mean of the sites."""
    north = 0.0
    east = 0.0
    for site in range(air.weight.shape[1]):
        north += air.weight[segment, site] * air.north[member, slot, site]
        east += air.weight[segment, site] * air.east[member, slot, site]
    return north, east


@compiled_lean
def speed_in(air: SegmentWind, segment: int, north: float, east: float) -> float:
    """Ground speed over a segment in a wind (north, east), m/s; 0 where it cannot be flown.

    Equations 1-5 of the paper: A along the course, C across it, B = sqrt(S^2 - C^2), ground speed A + B, capped at what
    the vehicle is commanded (`models.wind.triangle`).
    """
    along, across = along_across(north, east, air.cos_bearing[segment], air.sin_bearing[segment])
    forward = forward_mps(air.airspeed_mps, across)
    if flyable(along, forward, north * north + east * east, air.wind_limit_mps):
        return min(along + forward, air.max_ground_speed_mps)
    return 0.0


@compiled_lean
def segment_speed(air: SegmentWind, member: int, slot: int, segment: int) -> float:
    """Ground speed over a segment in one slot of one member; 0 where the wind, or a zone, prevents a flight."""
    if air.shut[slot, air.shut_of[segment]]:
        return 0.0
    north, east = wind_on(air, member, slot, segment)
    return speed_in(air, segment, north, east)


@compiled_lean
def airborne_speed(air: SegmentWind, segment: int, north: float, east: float) -> float:
    """Ground speed over a segment in a wind of what is in the air already: limits of the wind slow it, but do not end the flight."""
    along, across = along_across(north, east, air.cos_bearing[segment], air.sin_bearing[segment])
    return float(
        min(max(along + forward_mps(air.airspeed_mps, across), MIN_GROUND_SPEED_MPS), air.max_ground_speed_mps)
    )


@compiled_lean
def flown_part(left_m: float, speed_mps: float, now_s: float, end_s: float) -> tuple[float, bool]:
    """Fly on over a segment until it or the slot ends, whichever is first.

    Returns the seconds flown and whether the segment has ended.
    """
    whole_s = left_m / speed_mps
    if end_s == NEVER or now_s + whole_s <= end_s:
        return whole_s, True
    return end_s - now_s, False


@compiled_inline
def cross(
    speed_over: Callable[[Any, int, int], float], wind: Any, slots: Slots, length_m: float, segment: int, time_s: float
) -> float:
    """Time at which a segment entered at `time_s` is left again; never where a slot on the way forbids it.

    The ground speed in a slot over the segment is ``speed_over(wind, slot, segment)``, m/s, 0 where it forbids it.
    ``left`` is the length that is left at time ``now``: left <- left - speed * (end of the slot - now), now <- end of
    the slot.
    """
    # Slot by slot, at the speed of each.
    left = length_m
    now = time_s
    slot = slot_number(slots, now)
    while True:
        speed = speed_over(wind, slot, segment)
        if speed <= 0.0:
            return NEVER
        end = slot_until(slots, slot)
        spent, there = flown_part(left, speed, now, end)
        if there:
            return now + spent
        left -= speed * spent
        now = end
        slot += 1


@compiled_inline
def land_by(
    speed_over: Callable[[Any, int, int], float],
    wind: Any,
    slots: Slots,
    climb_s: float,
    descent_s: float,
    distance_m: NDArray[np.float64],
    segments: Sequence[int] | NDArray[np.int64],
    depart_s: float,
) -> float:
    """Touch-down of a flight over segments at the speeds of `cross`, POSIX seconds.

    Climb, the segments in turn, descent; never where a slot that the flight touches forbids one of the segments, even
    one that is flown in another slot: with that rule leaving later never arrives earlier (FIFO, `models.flight.rules`).

    `distance_m` has the length of every segment, shape (all segments,); `segments`, an array or a tuple, names those
    that are flown.
    """
    now = depart_s + climb_s
    for segment in segments:
        now = cross(speed_over, wind, slots, distance_m[segment], segment, now)
        if now == NEVER:
            return NEVER
    now += descent_s
    # The slots that it touches; a touch-down as a slot begins does not touch that one.
    first = slot_number(slots, depart_s)
    last = slot_number(slots, now - 2.0 * SLOT_EDGE_S)
    if last == first:  # each was flown in that slot
        return now
    for slot in range(first, last + 1):
        for segment in segments:
            if speed_over(wind, slot, segment) <= 0.0:
                return NEVER
    return now


@compiled_lean
def _speed_of_member(wind: tuple[SegmentWind, int], slot: int, segment: int) -> float:
    """`segment_speed` as `cross` takes it: in (air, member)."""
    return segment_speed(wind[0], wind[1], slot, segment)


@compiled_lean
def cruise(air: SegmentWind, member: int, segment: int, time_s: float) -> float:
    """Time at which a segment entered at `time_s` is left again; never where a slot on the way forbids it."""
    return cross(_speed_of_member, (air, member), slots_of(air), air.distance_m[segment], segment, time_s)


@compiled_lean
def land(air: SegmentWind, member: int, segments: Sequence[int] | NDArray[np.int64], depart_s: float) -> float:
    """Touch-down of a flight over segments that takes off at `depart_s`; never where it is not flyable."""
    wind = air, member
    return land_by(
        _speed_of_member, wind, slots_of(air), air.climb_s, air.descent_s, air.distance_m, segments, depart_s
    )


@compiled_lean
def next_flight(
    air: SegmentWind, member: int, segments: Sequence[int] | NDArray[np.int64], time_s: float
) -> tuple[float, float]:
    """Take-off and touch-down of a flight that leaves at `time_s` or, held by the wind, when it first can.

    POSIX seconds; never where the wind stays over limits. Held flights leave as a slot begins: within a slot, leaving
    later never arrives earlier.
    """
    off = time_s
    while True:
        down = land(air, member, segments, off)
        if down < NEVER:
            return off, down
        off = slot_end(air, slot_of(air, off))
        if off == NEVER:
            return NEVER, NEVER


@compiled_lean
def next_opening(air: SegmentWind, member: int, segments: Sequence[int] | NDArray[np.int64], time_s: float) -> float:
    """First time from `time_s` on at which a take-off makes a flyable flight; never where the wind stays over limits.

    Takes a member and segments of the air (checked where `air_over` and the itinerary are made), and any time: none
    that is infinite or NaN is flyable.
    """
    return next_flight(air, member, segments, time_s)[0]


@compiled_lean
def leg(air: SegmentWind, member: int, segment: int, time_s: float) -> tuple[float, float]:
    """`next_flight` over one segment."""
    return next_flight(air, member, (segment,), time_s)


@compiled_lean
def _airborne_speed_of_member(wind: tuple[SegmentWind, int], slot: int, segment: int) -> float:
    """`airborne_speed` as `cross` takes it: in (air, member)."""
    north, east = wind_on(wind[0], wind[1], slot, segment)
    return airborne_speed(wind[0], segment, north, east)


@compiled
def airborne_times(air: SegmentWind, begin_s: NDArray[np.float64], in_turn: bool) -> NDArray[np.float64]:  # noqa: FBT001  a kernel
    """Seconds over each segment of what is in the air already, in each member, shape (members, segments).

    The segments are flown one after the other from the first of `begin_s` on, or each from its own, shape (segments,). No climb, no descent.

    Takes any air, and finite times, one for each segment.
    """
    slots = slots_of(air)
    out = np.empty((len(air.north), len(air.distance_m)))
    for member in range(len(air.north)):
        now = 0.0
        for segment in range(len(air.distance_m)):
            if segment == 0 or not in_turn:
                now = begin_s[segment]
            down = cross(_airborne_speed_of_member, (air, member), slots, air.distance_m[segment], segment, now)
            out[member, segment] = down - now
            if in_turn:
                now = down
    return out
