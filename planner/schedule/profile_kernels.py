"""Kernels of charge profiles: the charge that a drone can have at a stop, as a function of time.

The profile of a stop is two functions of time, both piecewise linear and never decreasing:

- ``z(t)``: the best charging potential reached on a pad by time t. A drone that comes onto a pad at time p with
  charge s has potential z = F^-1(s) - p, where F is the charging curve from empty and F^-1 its inverse; as long as it
  stays, its charge is F(t + z). Charging keeps z, so all charging choices are one line.
- ``h(t)``: the best charge with which it can have landed by time t without using a pad.

The charge it can leave with at t is g(t) = max(F(t + z(t)), h(t)). `planner.schedule.leg_profile_kernels` takes it
through a flight to the profile of the next stop.

A profile is an array of shape (points, 3): time, value, and the time at which the flight that reaches it left the stop
before (for tracing back); g has the first two columns. Times are POSIX seconds, z seconds, charges SoC. It is linear
between points, constant after the last, undefined before the first; two points at the same time are a jump.

Source: charging-function propagation (Baum et al., "Shortest feasible paths with charging stops for battery electric
vehicles", Transportation Science 53, 2019).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

TIME_TOLERANCE_S = 1e-6
SOC_TOLERANCE = 1e-12
_NONE = -math.inf


@compiled_lean
def interpolate(x: float, xs: NDArray[np.float64], ys: NDArray[np.float64]) -> float:
    """Piecewise-linear function through points whose x increase, constant outside them; NaN of NaN.

    Takes any x, and one point at least.
    """
    last = len(xs) - 1
    y: float
    if x <= xs[0]:
        y = ys[0]
        return y
    if x >= xs[last]:
        y = ys[last]
        return y
    if math.isnan(x):
        return x
    # The last point at or before x: mostly the first one, as most charging is along the first, straight piece.
    k, high = 0, 1 if x < xs[1] else last
    while high - k > 1:
        middle = (k + high) // 2
        if xs[middle] <= x:
            k = middle
        else:
            high = middle
    y = ys[k] + (ys[k + 1] - ys[k]) * (x - xs[k]) / (xs[k + 1] - xs[k])
    return y


@compiled
def profile_at(profile: NDArray[np.float64], time_s: float) -> tuple[float, float]:
    """Value of a profile and the departure that reaches it; (-inf, nan) before it begins.

    Takes a profile z or h, shape (points, 3), in order of time, of any number of points, and any time.
    """
    points = len(profile)
    if points == 0 or time_s < profile[0, 0] - TIME_TOLERANCE_S:
        return _NONE, math.nan
    # The last point at or before the time.
    k = points - 1
    while k > 0 and profile[k, 0] > time_s:
        k -= 1
    if k == points - 1 or time_s <= profile[k, 0]:
        return profile[k, 1], profile[k, 2]
    # Between two points; where the value is flat, the departure of the earlier one reaches it.
    part = (time_s - profile[k, 0]) / (profile[k + 1, 0] - profile[k, 0])
    value = profile[k, 1] + part * (profile[k + 1, 1] - profile[k, 1])
    if profile[k + 1, 1] <= profile[k, 1]:
        return value, profile[k, 2]
    return value, profile[k, 2] + part * (profile[k + 1, 2] - profile[k, 2])


@compiled
def running_max(pieces: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Least never-decreasing profile above pieces (x0, y0, d0, x1, y1, d1) that come sorted by x0.

    Each of the `count` pieces is a line from (x0, y0) to (x1, y1), whose departures go from d0 to d1. O(count).
    """
    out = np.empty((3 * count + 1, 3))
    size = 0
    best = _NONE
    for i in range(count):
        x0, y0, d0, x1, y1, d1 = pieces[i]
        # A piece that is nowhere above the best so far adds nothing.
        if max(y0, y1) <= best + SOC_TOLERANCE:
            continue
        # It begins above it: a jump.
        if y0 > best:
            if size > 0 and out[size - 1, 0] < x0:
                out[size, 0], out[size, 1], out[size, 2] = x0, best, out[size - 1, 2]
                size += 1
            out[size, 0], out[size, 1], out[size, 2] = x0, y0, d0
            size += 1
            best = y0
        else:  # the piece crosses the best so far, which is flat up to there
            part = (best - y0) / (y1 - y0)
            out[size, 0], out[size, 1] = x0 + part * (x1 - x0), best
            out[size, 2] = d0 + part * (d1 - d0)
            size += 1
        # It rises further.
        if y1 > best:
            out[size, 0], out[size, 1], out[size, 2] = x1, y1, d1
            size += 1
            best = y1
    return out[:size].copy()


@compiled
def departure_profile(
    z: NDArray[np.float64],
    h: NDArray[np.float64],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Charge g(t) = max(F(t + z(t)), h(t)) that a drone can leave a stop with, shape (points, 2): time, SoC.

    Linear between points, constant after the last. F comes as points (`curve_s`, `curve_soc`), seconds from empty and
    SoC.

    Takes profiles that never decrease, and a charging curve that ascends, of two points at least.
    """
    knots = len(curve_s)
    out = np.empty(((len(z) + 1) * (knots + 2) + 2 * len(h) + 4, 2))
    size = 0
    full = curve_s[knots - 1]
    # F(t + z(t)) on each piece of z: its beginning, and a kink where t + z(t) meets a knot of the curve.
    for i in range(len(z)):
        t0, z0 = z[i, 0], z[i, 1]
        last = i == len(z) - 1
        t1 = math.inf if last else z[i + 1, 0]
        z1 = z0 if last else z[i + 1, 1]
        out[size, 0], out[size, 1] = t0, interpolate(t0 + z0, curve_s, curve_soc)
        size += 1
        if t1 <= t0 or t0 + z0 >= full:
            continue
        slope = 1.0 if last else 1.0 + (z1 - z0) / (t1 - t0)
        for k in range(knots):
            t = t0 + (curve_s[k] - t0 - z0) / slope
            if t0 + TIME_TOLERANCE_S < t < t1 - TIME_TOLERANCE_S:
                out[size, 0], out[size, 1] = t, curve_soc[k]
                size += 1
    # The greater of that and h.
    if len(h) == 0:
        return out[:size].copy()
    return upper_profile(out[:size], h)


@compiled_lean
def along(profile: NDArray[np.float64], k: int, x: float) -> float:
    """Value at x of the piece of a profile that begins at point k; -inf before the first point."""
    if k < 0:
        return _NONE
    if k + 1 == len(profile) or profile[k + 1, 0] <= profile[k, 0]:
        return profile[k, 1]
    part = (x - profile[k, 0]) / (profile[k + 1, 0] - profile[k, 0])
    return profile[k, 1] + part * (profile[k + 1, 1] - profile[k, 1])


@compiled
def upper_profile(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper envelope max(a, b) of two never-decreasing profiles, shape (points, 2).

    A sweep over the points of both. At each x: a0, b0 are the values just after the x before, a1, b1 just before this
    one, and a2, b2 just after it.

    Takes profiles in order of time, of any number of points.
    """
    out = np.empty((4 * (len(a) + len(b)) + 4, 2))
    size = 0
    i, j = -1, -1  # the pieces that hold before x
    x = _NONE
    while i + 1 < len(a) or j + 1 < len(b):
        before = x
        x = min(a[i + 1, 0] if i + 1 < len(a) else math.inf, b[j + 1, 0] if j + 1 < len(b) else math.inf)
        a0, b0, a1, b1 = along(a, i, before), along(b, j, before), along(a, i, x), along(b, j, x)
        # The lines cross on the way to x.
        if (a0 - b0) * (a1 - b1) < 0.0 and a0 > _NONE and b0 > _NONE:
            part = (a0 - b0) / ((a0 - b0) - (a1 - b1))
            out[size, 0], out[size, 1] = before + part * (x - before), a0 + part * (a1 - a0)
            size += 1
        # Over the jumps at x, to the pieces that hold after it.
        of_a, of_b = False, False
        while i + 1 < len(a) and a[i + 1, 0] <= x:
            i, of_a = i + 1, True
        while j + 1 < len(b) and b[j + 1, 0] <= x:
            j, of_b = j + 1, True
        a2, b2 = along(a, i, x), along(b, j, x)
        if (not of_a and a1 > b1 and a2 > b2) or (not of_b and b1 > a1 and b2 > a2):
            continue  # a point of the lower one only
        # The envelope just before x and, where it begins or jumps, just after.
        if size > 0:
            out[size, 0], out[size, 1] = x, max(a1, b1)
            size += 1
        if size == 0 or max(a2, b2) > out[size - 1, 1]:
            out[size, 0], out[size, 1] = x, max(a2, b2)
            size += 1
    return out[:size].copy()


@compiled
def covers(a: NDArray[np.float64], b: NDArray[np.float64], tolerance: float) -> bool:
    """Return whether departure profile `a` is nowhere below `b` (by more than a tolerance, SoC).

    As both are linear between their points, looking at these is enough: just after jumps of b, just before jumps of a.

    Takes profiles that never decrease, of any number of points; none covers nothing but none.
    """
    if len(a) == 0 or len(b) == 0:
        return len(b) == 0
    if a[0, 0] > b[0, 0]:
        return False
    k = 0
    for i in range(len(b)):  # at the points of b, just after jumps
        x = b[i, 0]
        while k + 1 < len(a) and a[k + 1, 0] <= x:
            k += 1
        if along(a, k, x) < b[i, 1] - tolerance:
            return False
    k = 0
    for i in range(len(a)):  # at the points of a, just before jumps
        x = a[i, 0]
        if x <= b[0, 0]:
            continue
        while k + 1 < len(b) and b[k + 1, 0] < x:
            k += 1
        if a[i, 1] < along(b, k, x) - tolerance:
            return False
    return True
