"""Kernels that fly a fixed itinerary through many winds and queues."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER, flown_part, next_opening, segment_speed, slot_end, slot_of
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.schedule.gust_kernels import gusty_land
from skyway.planner.schedule.profile_kernels import interpolate
from skyway.planner.schedule.shut_kernels import Shut, closed_for, opens, past_closures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind
    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.schedule.gust_kernels import Disturbance

PAD, TAKE_OFF, TOUCH_DOWN, SOC_TAKE_OFF, SOC_LANDING, READY, ROOM = range(COLUMNS := 7)
"""Columns of what `fly_under` returns: pad reached (the arrival where no pad is used), take-off, touch-down, charge at
both, when the drone was ready to leave, and for how long after that it held until the next station had room, s. The
rest of the time from ready to take-off it held for the wind."""


class Legs(NamedTuple):
    """Flights of an itinerary and the stop before each, for `fly_under`."""

    offset: NDArray[np.int64]
    segments: NDArray[np.int64]
    """Segments of leg i are ``segments[offset[i] : offset[i + 1]]``."""
    charge_to: NDArray[np.float64]
    not_before_s: NDArray[np.float64]
    """Shape (legs,) each. At the stop before: charge to this SoC (NaN: use no pad) and stay until this time (-inf: do
    not)."""
    curve_s: NDArray[np.float64]
    curve_soc: NDArray[np.float64]
    """Shape (legs, points) each. Charging curve at the stop before; rows padded by repeating the last point."""
    has_pads: NDArray[np.bool_]
    """Shape (legs,). Whether there is a pad at the stop before at all."""
    shut: Shut
    """When the stations are closed."""


class Queues(NamedTuple):
    """Sets of queue paths, packed (`models.queues.paths.PackedPaths`) in order (place, set).

    The places of a set are the stop before each leg and, last, the station where the route ends: one more than legs.
    """

    offset: NDArray[np.int64]
    """Shape (entries + 1,). Path i is rows ``offset[i] : offset[i + 1]`` of the others."""
    arrival_s: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    land_s: NDArray[np.float64]
    delay_s: NDArray[np.float64]
    """See `models.queues.paths.QueuePath`, whose arrivals are preceded by one at -inf: row k holds for a drone
    behind k others."""

    @classmethod
    def of(cls, paths: PackedPaths) -> Queues:
        """Those of packed paths."""
        return cls(paths.offset, paths.arrival_s, paths.pad_s, paths.land_s, paths.delay_s)


def no_queues() -> Queues:
    """Return no set of paths: expected waits are used instead."""
    return Queues(np.zeros(1, dtype=np.int64), np.empty(0), np.empty(0), np.empty(0), np.empty(0))


class Waits(NamedTuple):
    """Expected waits at the stop before each leg, s.

    `wait_s` has shape (legs, times), for arrivals at `start_s` (POSIX seconds), `step_s` later, and so on.
    """

    start_s: float
    step_s: float
    wait_s: NDArray[np.float64]


@compiled_lean
def expected_pad(waits: Waits, leg: int, time_s: float) -> float:
    """Time at which a drone that arrives at a time can expect a pad, POSIX seconds.

    The time and the expected wait then, linear between the points of the grid, constant outside it.
    """
    x = (time_s - waits.start_s) / waits.step_s
    last = waits.wait_s.shape[1] - 1
    if x <= 0.0:
        return time_s + waits.wait_s[leg, 0]
    if x >= last:
        return time_s + waits.wait_s[leg, last]
    k = int(x)
    return time_s + waits.wait_s[leg, k] + (x - k) * (waits.wait_s[leg, k + 1] - waits.wait_s[leg, k])


@compiled_lean
def _interval(queues: Queues, entry: int, time_s: float) -> int:
    """Row of a queue path that holds for arrivals at a time: the last other that came by then."""
    low, high = queues.offset[entry], queues.offset[entry + 1]
    return max(low + np.searchsorted(queues.arrival_s[low:high], time_s, side="right") - 1, low)


@compiled_lean
def sampled_spot(queues: Queues, entry: int, time_s: float) -> float:
    """Time at which a drone that arrives at a time can touch down, POSIX seconds: max(t, land)."""
    return max(time_s, queues.land_s[_interval(queues, entry, time_s)])


@compiled_lean
def sampled_pad(queues: Queues, entry: int, time_s: float) -> float:
    """Time at which a drone that arrives at a time gets a pad, POSIX seconds: max(t + delay, pad)."""
    k = _interval(queues, entry, time_s)
    return max(time_s + queues.delay_s[k], queues.pad_s[k])


@compiled
def waits_at(queues: Queues, entries: NDArray[np.int64], times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Waits for a pad of drones that arrive at given times, each in its own queue path, s, shape (drones,).

    Takes paths that are there, and as many as times.
    """
    out = np.empty(len(entries))
    for i in range(len(entries)):
        out[i] = sampled_pad(queues, entries[i], times_s[i]) - times_s[i]
    return out


@compiled_lean
def to_next_stop(
    disturbance: Disturbance,
    run: int,
    ratio: float,
    air: SegmentWind,
    member: int,
    segments: NDArray[np.int64],
    off_s: float,
    soc: float,
    cost: tuple[float, float],
    queues: Queues,
    ends: int,
) -> tuple[float, float, float]:
    """Fly a leg, and hover until there is a place to land: touch-down, when it came there, and the charge left.

    With gusts and the ratio of its energy to the model's, e: e (k + c T) for a flight of T seconds, e c a second of hovering; (c, k)
    is `cost`. `ends` is the queue path of the station where it ends; without sampled paths there is always a place.
    """
    come_s = gusty_land(
        air, member, segments, off_s, disturbance.gust_key[run], disturbance.gust_sd, disturbance.gust_time_s
    )
    soc -= ratio * (cost[1] + cost[0] * (come_s - off_s))
    down_s = come_s  # a drone that hovers for a spot keeps its place in the queue
    if len(queues.offset) > 1:
        down_s = sampled_spot(queues, ends, come_s)
        soc -= ratio * cost[0] * (down_s - come_s)
    return down_s, come_s, soc


@compiled
def fly_under(
    disturbance: Disturbance,
    air: SegmentWind,
    members: NDArray[np.int64],
    legs: Legs,
    queues: Queues,
    waits: Waits,
    start: tuple[float, float],
    cost: tuple[float, float],
) -> NDArray[np.float64]:
    """Fly an itinerary in several runs, through gusts and with errors of energy.

    For each leg, with s the charge on arrival, F the charging curve from empty, c and k what a second of flight and a
    flight cost, and e the leg's energy as a multiple of the model's:

        ready    r = p + F^-1(charge_to) - F^-1(s), p the time it gets a pad; not before not_before
        take-off t = first opening of the wind from r on, with the charge F(F^-1(s) + t - p)
        where both r and the charge omit what the station is closed after p
        landing  a = end of the flight in gusts, with e (k + c (a - t)) less
        hovering until there is a holding spot, at e c a second

    O(runs x legs) flights. Takes members and sets of queues that are there, and a segment or more for each leg
    (`planner.problem.kernel_inputs`, in `planner.schedule.itinerary`); it charges nowhere without pads.

    Parameters
    ----------
    disturbance : Disturbance
        Gusts, errors of energy, and which set of queues each run meets.
    air : SegmentWind
        The wind.
    members : ndarray of int, shape (runs,)
        Member of the ensemble that each run flies in.
    legs : Legs
        The itinerary.
    queues : Queues
        One sampled path per set and place; with no entries, the expected waits are used instead.
    waits : Waits
        Expected waits.
    start : (time_s, soc)
        When and with which charge the delivery starts.
    cost : (soc_per_s, soc_fixed)
        c and k.

    Returns
    -------
    ndarray, shape (runs, legs, 7)
        See the column names of this module; infinite from the leg on that the wind never opens for.
    """
    count = len(legs.charge_to)
    out = np.full((len(members), count, COLUMNS), NEVER)
    sampled = len(queues.offset) > 1
    sets = (len(queues.offset) - 1) // (count + 1)
    for run in range(len(members)):
        now, soc = start
        joined = now
        for leg in range(count):
            segments = legs.segments[legs.offset[leg] : legs.offset[leg + 1]]
            entry = leg * sets + disturbance.queue[run]
            # The stop: when there is a pad, and when the drone is ready.
            pad = now
            ready = now
            charges = legs.has_pads[leg] and legs.charge_to[leg] > soc  # not where it is NaN either
            u = 0.0
            if charges:
                if sampled:
                    pad = max(now, sampled_pad(queues, entry, joined))
                else:
                    pad = opens(legs.shut, leg, expected_pad(waits, leg, now))
                u = interpolate(soc, legs.curve_soc[leg], legs.curve_s[leg])
                ready = pad + interpolate(legs.charge_to[leg], legs.curve_soc[leg], legs.curve_s[leg]) - u
                ready = past_closures(legs.shut, leg, pad, ready)
            ready = max(ready, legs.not_before_s[leg])
            # Take-off, with what it has charged until then.
            off = next_opening(air, members[run], segments, ready)
            if off == NEVER:
                break
            if charges:
                without = closed_for(legs.shut, leg, pad, off)
                soc = interpolate(u + off - pad - without, legs.curve_s[leg], legs.curve_soc[leg])
            out[run, leg, PAD], out[run, leg, READY], out[run, leg, ROOM] = pad, ready, 0.0
            out[run, leg, TAKE_OFF], out[run, leg, SOC_TAKE_OFF] = off, soc
            # Landing.
            ratio = disturbance.energy[run, leg % disturbance.energy.shape[1]]
            now, joined, soc = to_next_stop(
                disturbance, run, ratio, air, members[run], segments, off, soc, cost, queues, entry + sets
            )
            out[run, leg, TOUCH_DOWN], out[run, leg, SOC_LANDING] = now, soc
    return out


@compiled
def flight_parts(air: SegmentWind, member: int, segments: NDArray[np.int64], depart_s: float) -> NDArray[np.float64]:
    """Cruise of a flight cut where segment or slot changes, shape (parts, 4): segment, slot, seconds, ground speed.

    It ends where a slot cannot be flown in. A flight that never departs (`depart_s` infinite or NaN) has no parts.

    Takes a member and segments of the air, and any time.
    """
    if not math.isfinite(depart_s):
        return np.empty((0, 4))
    out = np.empty((len(segments) * (air.north.shape[1] + 1), 4))
    size = 0
    now = depart_s + air.climb_s
    for segment in segments:
        left = air.distance_m[segment]
        slot = slot_of(air, now)
        while True:
            # To the end of the segment or of the slot, whichever is first.
            speed = segment_speed(air, member, slot, segment)
            if speed <= 0.0:
                return out[:size].copy()
            end = slot_end(air, slot)
            spent, there = flown_part(left, speed, now, end)
            out[size, 0], out[size, 1], out[size, 2], out[size, 3] = segment, slot, spent, speed
            size += 1
            if there:
                now += spent
                break
            left -= speed * spent
            now = end
            slot += 1
    return out[:size].copy()
