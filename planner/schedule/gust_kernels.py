"""Gust kernels: flights through wind that varies about its hourly value.

The gust at a time follows from a key and the time alone, so that every flight in the same sampled truth, on any route,
meets the same gusts (but for what is older than `_WARM_UP` time constants at the take-off: 5 % of a deviation). Along and
across the wind each is an Ornstein-Uhlenbeck process sampled at steps k of `GUST_STEP_S` and held within each, in
standard deviations:

    x(k) = phi x(k - 1) + sqrt(1 - phi^2) e(k),     phi = exp(-GUST_STEP_S / time constant)

The normal deviates e(k) are a function of key and k (`models.jit.random_kernels`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER, airborne_speed, flown_part, land, slot_end, slot_of, wind_on
from skyway.models.jit.compiled import compiled_lean
from skyway.models.jit.random_kernels import normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

GUST_STEP_S = 30.0
"""A gust holds for this long."""
LATERAL = 0.8
"""Gusts across the wind as a share of those along it (near the ground in neutral air 1.9 / 2.4)."""
MAX_DEVIATION = 3.0
"""Gusts are cut off at this many standard deviations."""
_WARM_UP = 3.0


class Disturbance(NamedTuple):
    """What each run meets beyond its member of the wind."""

    queue: NDArray[np.int64]
    """Shape (runs,). Which of the sampled sets of queues."""
    energy: NDArray[np.float64]
    """Shape (runs, legs). Energy that each leg takes, as a multiple of the model's; after the last one again from the
    first."""
    gust_key: NDArray[np.uint64]
    """Shape (runs,). Of each run's gusts."""
    gust_sd: float
    """Standard deviation of gusts along the wind as a share of the hourly speed; 0: no gusts."""
    gust_time_s: float
    """Time constant."""


def no_disturbance(runs: int) -> Disturbance:
    """No gusts, no error of energy, and a set of queues for each run."""
    return Disturbance(np.arange(runs), np.ones((runs, 1)), np.zeros(runs, dtype=np.uint64), 0.0, 1.0)


@compiled_lean
def gust_after(gust: tuple[float, float], key: np.uint64, step: int, phi: float, scale: float) -> tuple[float, float]:
    """Gust of a step k of time, x(k), from that of the step before; `scale` is sqrt(1 - phi^2)."""
    along, across = normals(key, step)
    return phi * gust[0] + scale * along, phi * gust[1] + scale * across


@compiled_lean
def gust_at(key: np.uint64, step: int, phi: float) -> tuple[float, float]:
    """Gust along and across the wind in a step of time, in standard deviations, from its past.

    The recurrence from `_WARM_UP` time constants before, of which exp(-`_WARM_UP`) is left.
    """
    scale = math.sqrt(1.0 - phi * phi)
    length = int(math.ceil(-_WARM_UP / math.log(phi))) if phi > 0.0 else 0
    gust = normals(key, step - length)
    for k in range(step - length + 1, step + 1):
        gust = gust_after(gust, key, k, phi, scale)
    return gust


@compiled_lean
def gusty_speed(
    air: SegmentWind, member: int, slot: int, segment: int, gust: tuple[float, float], gust_sd: float
) -> float:
    """Ground speed over a segment in a gust (equations 1-5), m/s; a gust slows a flight, but does not end it.

    With x along the wind w and y across it, as shares of it, the wind becomes (1 + x) w + y w', w' being w turned right
    by 90 degrees: north (1 + x) - east y, east (1 + x) + north y.
    """
    north, east = wind_on(air, member, slot, segment)
    # x and y.
    along = gust_sd * min(max(gust[0], -MAX_DEVIATION), MAX_DEVIATION)
    across = LATERAL * gust_sd * min(max(gust[1], -MAX_DEVIATION), MAX_DEVIATION)
    gust_north = north * (1.0 + along) - east * across
    gust_east = east * (1.0 + along) + north * across
    return airborne_speed(air, segment, gust_north, gust_east)


class Gusts(NamedTuple):
    """Gusts that a flight meets."""

    key: np.uint64
    """Of the deviates."""
    sd: float
    """Standard deviation along the wind, as a share of the wind."""
    phi: float
    scale: float
    """Of the recurrence, see above: what is kept from step to step, and sqrt(1 - phi^2)."""


class GustyPlace(NamedTuple):
    """Where a flight through gusts is."""

    left_m: float
    """What is left of its segment."""
    time_s: float
    """POSIX seconds."""
    step: int
    """Step of time whose gust blows."""
    gust: tuple[float, float]
    """Along and across the wind, in standard deviations."""


@compiled_lean
def gusts_of(key: np.uint64, sd: float, time_constant_s: float) -> Gusts:
    """Gusts of a key, a standard deviation and a time constant above 0."""
    phi = math.exp(-GUST_STEP_S / time_constant_s)
    return Gusts(key, sd, phi, math.sqrt(1.0 - phi * phi))


@compiled_lean
def gusty_start(gusts: Gusts, length_m: float, time_s: float) -> GustyPlace:
    """Begin a segment at a time, with the gust of then."""
    step = int(math.floor(time_s / GUST_STEP_S))
    return GustyPlace(length_m, time_s, step, gust_at(gusts.key, step, gusts.phi))


@compiled_lean
def gusty_part(air: SegmentWind, member: int, segment: int, gusts: Gusts, at: GustyPlace) -> GustyPlace:
    """Fly on over a segment until it, the gust or the slot ends."""
    slot = slot_of(air, at.time_s)
    # Up to the end of the segment, of the gust or of the slot, at the present speed.
    speed = gusty_speed(air, member, slot, segment, at.gust, gusts.sd)
    next_step_s = (at.step + 1) * GUST_STEP_S
    end_s = min(next_step_s, slot_end(air, slot))
    spent, there = flown_part(at.left_m, speed, at.time_s, end_s)
    if there:
        return GustyPlace(0.0, at.time_s + spent, at.step, at.gust)
    left = at.left_m - speed * spent
    # A new slot in the same gust, or the next gust.
    if end_s < next_step_s:
        return GustyPlace(left, end_s, at.step, at.gust)
    return GustyPlace(left, end_s, at.step + 1, gust_after(at.gust, gusts.key, at.step + 1, gusts.phi, gusts.scale))


@compiled_lean
def gusty_land(
    air: SegmentWind,
    member: int,
    segments: NDArray[np.int64],
    depart_s: float,
    key: np.uint64,
    gust_sd: float,
    time_s: float,
) -> float:
    """Touch-down of a flight through gusts of time constant `time_s`; without gusts that of `land`.

    The hourly wind must allow the take-off (`next_opening`). Once started, the flight is flown to its end: a gust beyond
    the limits slows it to the least ground speed.

    Takes a member and segments of the air and a finite take-off; a time constant above 0.
    """
    if gust_sd <= 0.0:
        return land(air, member, segments, depart_s)
    gusts = gusts_of(key, gust_sd, time_s)
    at = gusty_start(gusts, 0.0, depart_s + air.climb_s)
    for segment in segments:
        at = GustyPlace(air.distance_m[segment], at.time_s, at.step, at.gust)
        while at.left_m > 0.0:
            at = gusty_part(air, member, segment, gusts, at)
    return at.time_s + air.descent_s if at.time_s < NEVER else NEVER
