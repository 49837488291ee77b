"""Kernels of charge profiles: the charge that a drone can have at a stop, as a function of time.

The profile of a stop is two functions of time, both piecewise linear and never decreasing:

- ``z(t)``: the best charging potential reached on a pad by time t. A drone that comes onto a pad at time p with
  charge s has potential z = F'(s) - p, where F is the charging curve from empty and F' its inverse; as long as it
  stays, its charge is F(t + z). Charging keeps z, so all charging choices are one line.
- ``h(t)``: the best charge with which it can have landed by time t without using a pad.

The charge it can leave with at t is g(t) = max(F(t + z(t)), h(t)). A flight that leaves at t and lands at a costs
k + c (a - t); it is taken through the landing, the queue and the inverse charging curve piece by piece, each piece
linear in t, so that the profile of the next stop is exact for the piecewise-linear curve. The method is that of
charging-function propagation (Baum et al., "Shortest feasible paths with charging stops for battery electric
vehicles", Transportation Science 53, 2019), with time-dependent flights and queues added.

A profile is an array of shape (points, 3): time, value, and the time at which the flight that reaches it left the
stop before (for tracing back). It is linear between points, constant after the last, undefined before the first; two
points at the same time are a jump.
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
BEFORE_S = 1e-3
"""Who wants to be before another drone in a queue arrives at least this much earlier: a tie is lost."""
_NONE = -math.inf


@compiled
def interpolate(x: float, xs: NDArray[np.float64], ys: NDArray[np.float64]) -> float:
    """Piecewise-linear function through increasing points, constant outside them; NaN of NaN."""
    if math.isnan(x):
        return x
    if x <= xs[0]:
        return ys[0]
    last = len(xs) - 1
    if x >= xs[last]:
        return ys[last]
    k = np.searchsorted(xs, x, side="right") - 1
    return ys[k] + (ys[k + 1] - ys[k]) * (x - xs[k]) / (xs[k + 1] - xs[k])


@compiled
def profile_at(profile: NDArray[np.float64], time_s: float) -> tuple[float, float]:
    """Value of a profile and the departure that reaches it; (-inf, nan) before it begins.

    Takes a profile z or h, shape (points, 3), in order of time, of any number of points, and any time.
    """
    points = len(profile)
    if points == 0 or time_s < profile[0, 0] - TIME_TOLERANCE_S:
        return _NONE, math.nan
    k = points - 1
    while k > 0 and profile[k, 0] > time_s:
        k -= 1
    if k == points - 1 or time_s <= profile[k, 0]:
        return profile[k, 1], profile[k, 2]
    part = (time_s - profile[k, 0]) / (profile[k + 1, 0] - profile[k, 0])
    value = profile[k, 1] + part * (profile[k + 1, 1] - profile[k, 1])
    if profile[k + 1, 1] <= profile[k, 1]:
        return value, profile[k, 2]
    return value, profile[k, 2] + part * (profile[k + 1, 2] - profile[k, 2])


@compiled
def running_max(pieces: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Least never-decreasing profile above pieces (x0, y0, d0, x1, y1, d1) that come sorted by x."""
    out = np.empty((3 * count + 1, 3))
    size = 0
    best = _NONE
    for i in range(count):
        x0, y0, d0, x1, y1, d1 = pieces[i]
        if max(y0, y1) <= best + SOC_TOLERANCE:
            continue
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
    """Charge g(t) a drone can leave a stop with, shape (points, 2): time, SoC; linear between, constant after the last.

    Takes profiles that never decrease, and a charging curve that ascends, of two points at least.
    """
    knots = len(curve_s)
    out = np.empty(((len(z) + 1) * (knots + 2) + 2 * len(h) + 4, 2))
    size = 0
    full = curve_s[knots - 1]
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
    if len(h) == 0:
        return out[:size].copy()
    return upper_profile(out[:size], h)


@compiled_lean
def _along(profile: NDArray[np.float64], k: int, x: float) -> float:
    """Value at x of the piece that begins at point k; before the first point there is none."""
    if k < 0:
        return _NONE
    if k + 1 == len(profile) or profile[k + 1, 0] <= profile[k, 0]:
        return profile[k, 1]
    part = (x - profile[k, 0]) / (profile[k + 1, 0] - profile[k, 0])
    return profile[k, 1] + part * (profile[k + 1, 1] - profile[k, 1])


@compiled
def upper_profile(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper envelope of two never-decreasing profiles, shape (points, 2).

    Takes profiles in order of time, of any number of points.
    """
    out = np.empty((4 * (len(a) + len(b)) + 4, 2))
    size = 0
    i, j = -1, -1  # the pieces that hold before x
    x = _NONE
    while i + 1 < len(a) or j + 1 < len(b):
        before = x
        x = min(a[i + 1, 0] if i + 1 < len(a) else math.inf, b[j + 1, 0] if j + 1 < len(b) else math.inf)
        a0, b0, a1, b1 = _along(a, i, before), _along(b, j, before), _along(a, i, x), _along(b, j, x)
        if (a0 - b0) * (a1 - b1) < 0.0 and a0 > _NONE and b0 > _NONE:
            part = (a0 - b0) / ((a0 - b0) - (a1 - b1))
            out[size, 0], out[size, 1] = before + part * (x - before), a0 + part * (a1 - a0)
            size += 1
        of_a, of_b = False, False
        while i + 1 < len(a) and a[i + 1, 0] <= x:
            i, of_a = i + 1, True
        while j + 1 < len(b) and b[j + 1, 0] <= x:
            j, of_b = j + 1, True
        a2, b2 = _along(a, i, x), _along(b, j, x)
        if (not of_a and a1 > b1 and a2 > b2) or (not of_b and b1 > a1 and b2 > a2):
            continue  # a point of the lower one only
        if size > 0:
            out[size, 0], out[size, 1] = x, max(a1, b1)
            size += 1
        if size == 0 or max(a2, b2) > out[size - 1, 1]:
            out[size, 0], out[size, 1] = x, max(a2, b2)
            size += 1
    return out[:size].copy()


@compiled
def fly_profile(
    g: NDArray[np.float64],
    flights: NDArray[np.float64],
    soc_per_s: float,
    soc_fixed: float,
    margin_soc_per_s: float,
    needed: NDArray[np.float64],
    until_s: float,
) -> tuple[NDArray[np.float64], int]:
    """Take a departure profile through a flight.

    Takes a profile and pieces in order of time, any number of them, and at least one point of `needed`.

    Parameters
    ----------
    g : ndarray, shape (points, 2)
        Departure profile.
    flights : ndarray, shape (pieces, 4)
        Pieces (t0, a0, t1, a1) of the arrival function, sorted; gaps are times nobody takes off at.
    soc_per_s, soc_fixed : float
        A flight costs ``soc_fixed + soc_per_s * (arrival - departure)``.
    margin_soc_per_s : float
        Charge beyond `needed` that a second of flight asks for on touch-down.
    needed : ndarray, shape (points, 2)
        Least charge on touch-down by arrival time, piecewise linear; two points at the same time are a jump.
    until_s : float
        Departures and arrivals after this do not matter.

    Returns
    -------
    pieces : ndarray, shape (capacity, 6)
        (a0, s0, t0, a1, s1, t1): charge on touch-down, linear, sorted by arrival.
    count : int
        How many of them.
    """
    room = 2 * (len(g) + len(needed) + 4)  # more than one flight can add
    out = np.empty((2 * room + 4 * len(flights), 6))
    count = 0
    k = 0
    for i in range(len(flights)):
        if count + room > len(out):
            grown = np.empty((2 * len(out), 6))
            grown[:count] = out[:count]
            out = grown
        t0, a0, t1, a1 = flights[i]
        if t1 < g[0, 0] or t0 > until_s or a0 > until_s:
            continue
        slope = (a1 - a0) / (t1 - t0) if t1 > t0 else 1.0
        now = max(t0, g[0, 0])
        while k + 1 < len(g) and g[k + 1, 0] <= now:
            k += 1
        j = k
        while True:
            end = t1
            if j + 1 < len(g) and g[j + 1, 0] < t1:
                end = g[j + 1, 0]
            rate = 0.0
            if j + 1 < len(g) and g[j + 1, 0] > g[j, 0]:
                rate = (g[j + 1, 1] - g[j, 1]) / (g[j + 1, 0] - g[j, 0])
            b0 = a0 + slope * (now - t0)
            b1 = a0 + slope * (end - t0)
            s0 = g[j, 1] + rate * (now - g[j, 0]) - soc_fixed - soc_per_s * (b0 - now)
            s1 = g[j, 1] + rate * (end - g[j, 0]) - soc_fixed - soc_per_s * (b1 - end)
            count = _keep(out, count, b0, s0, now, b1, s1, end, margin_soc_per_s, needed)
            if end >= t1:
                break
            now = end
            j += 1
            while j + 1 < len(g) and g[j + 1, 0] <= now:
                j += 1
    return out, count


@compiled
def _keep(
    out: NDArray[np.float64],
    count: int,
    a0: float,
    s0: float,
    t0: float,
    a1: float,
    s1: float,
    t1: float,
    margin: float,
    needed: NDArray[np.float64],
) -> int:
    """Add the part of a linear piece that lands with at least the needed charge; returns the new count."""
    if len(needed) == 1:
        n0, n1 = needed[0, 1] + margin * (a0 - t0), needed[0, 1] + margin * (a1 - t1)
        return _clip(out, count, a0, s0, t0, a1, s1, t1, n0, n1)
    last = len(needed) - 1
    begin = np.searchsorted(needed[:, 0], a0, side="left") - 1
    for k in range(begin, last + 1):
        if k >= 0 and needed[k, 0] > a1:
            break
        low = needed[k, 0] if k >= 0 else -math.inf
        high = needed[k + 1, 0] if k < last else math.inf
        if a1 < low or a0 > high or (a1 > a0 and (a1 <= low or a0 >= high)):
            continue
        b0, b1 = max(a0, low), min(a1, high)
        p0 = (b0 - a0) / (a1 - a0) if a1 > a0 else 0.0
        p1 = (b1 - a0) / (a1 - a0) if a1 > a0 else 1.0
        d0, d1 = t0 + p0 * (t1 - t0), t0 + p1 * (t1 - t0)
        n0 = (
            _along(needed, k, b0) if k >= 0 else needed[0, 1]
        )  # on this piece: at a jump its ends are not the neighbours'
        n1 = _along(needed, k, b1) if k >= 0 else needed[0, 1]
        n0, n1 = n0 + margin * (b0 - d0), n1 + margin * (b1 - d1)
        count = _clip(out, count, b0, s0 + p0 * (s1 - s0), d0, b1, s0 + p1 * (s1 - s0), d1, n0, n1)
        if a1 <= a0:
            break
    return count


@compiled_lean
def _spared(begin: float, end: float) -> tuple[float, float]:
    """Shares of a line from `begin` to `end`, one of which is positive, between which it is."""
    if begin < 0.0:
        return begin / (begin - end), 1.0
    if end < 0.0:
        return 0.0, begin / (begin - end)
    return 0.0, 1.0


@compiled
def _clip(
    out: NDArray[np.float64],
    count: int,
    a0: float,
    s0: float,
    t0: float,
    a1: float,
    s1: float,
    t1: float,
    n0: float,
    n1: float,
) -> int:
    """Add the part of a linear piece on which s >= n."""
    d0, d1 = s0 - n0 + SOC_TOLERANCE, s1 - n1 + SOC_TOLERANCE
    if d0 < 0.0 and d1 < 0.0:
        return count
    p0, p1 = _spared(d0, d1)
    da, ds, dt = a1 - a0, s1 - s0, t1 - t0
    return _put(out, count, a0 + p0 * da, s0 + p0 * ds, t0 + p0 * dt, a0 + p1 * da, s0 + p1 * ds, t0 + p1 * dt)


@compiled
def _put(out: NDArray[np.float64], count: int, a0: float, s0: float, t0: float, a1: float, s1: float, t1: float) -> int:
    """Add a linear piece; returns the new count."""
    out[count, 0], out[count, 1], out[count, 2] = a0, s0, t0
    out[count, 3], out[count, 4], out[count, 5] = a1, s1, t1
    return count + 1


@compiled
def stop_profile(
    pieces: NDArray[np.float64],
    count: int,
    soc_per_s: float,
    margin_soc_per_s: float,
    reserve_soc: float,
    others_s: NDArray[np.float64],
    pad_s: NDArray[np.float64],
    land_s: NDArray[np.float64],
    delay_s: NDArray[np.float64],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Land pieces at a station with a queue and put them on its pads.

    Parameters
    ----------
    pieces, count
        Of `fly_profile`.
    soc_per_s : float
        Of hovering while every holding spot is taken.
    margin_soc_per_s, reserve_soc : float
        Least charge on touch-down after T seconds in the air is ``reserve_soc + margin_soc_per_s * T``.
    others_s, pad_s, land_s, delay_s : ndarray
        The queue path, see `models.queues.sampling.QueuePath`.
    curve_s, curve_soc : ndarray
        Charging curve from empty.

    Returns
    -------
    z, h : ndarray, shape (points, 3)
        Profiles of charging potential and of landed charge.
    """
    capacity = 4 * count * (len(curve_s) + 2) + 4 * len(others_s) + 16
    on_pad = np.empty((capacity, 6))
    landed = np.empty((4 * count + 3 * len(others_s) + 16, 6))
    pads = 0
    lands = 0
    for i in range(count):
        a0, s0, t0, a1, s1, t1 = pieces[i]
        k = np.searchsorted(others_s, a0, side="right")
        at_once = land_s[np.searchsorted(others_s, a1, side="right")] <= a0  # whoever is before it, it finds a spot
        if at_once:
            lands = _clip(
                landed,
                lands,
                a0,
                s0,
                t0,
                a1,
                s1,
                t1,
                reserve_soc + margin_soc_per_s * (a0 - t0),
                reserve_soc + margin_soc_per_s * (a1 - t1),
            )
        now = a0
        while True:
            end = a1
            if k < len(others_s) and others_s[k] - BEFORE_S < end:
                end = max(others_s[k] - BEFORE_S, now)
            if land_s[k] > now and land_s[k] < end:
                end = land_s[k]
            if now < pad_s[k] - delay_s[k] < end:
                end = pad_s[k] - delay_s[k]
            p0 = (now - a0) / (a1 - a0) if a1 > a0 else 0.0
            p1 = (end - a0) / (a1 - a0) if a1 > a0 else 1.0
            b0, b1 = max(now, land_s[k]), max(end, land_s[k])
            if end > now and land_s[k] >= end:
                b0 = b1 = land_s[k]
            w0, w1 = max(now + delay_s[k], pad_s[k]), max(end + delay_s[k], pad_s[k])
            e0 = s0 + p0 * (s1 - s0) - soc_per_s * (b0 - now)
            e1 = s0 + p1 * (s1 - s0) - soc_per_s * (b1 - end)
            d0, d1 = t0 + p0 * (t1 - t0), t0 + p1 * (t1 - t0)
            spare0 = e0 - reserve_soc - margin_soc_per_s * (b0 - d0) + SOC_TOLERANCE
            spare1 = e1 - reserve_soc - margin_soc_per_s * (b1 - d1) + SOC_TOLERANCE
            if spare0 >= 0.0 or spare1 >= 0.0:
                q0, q1 = _spared(spare0, spare1)
                b0, b1 = b0 + q0 * (b1 - b0), b0 + q1 * (b1 - b0)
                w0, w1 = w0 + q0 * (w1 - w0), w0 + q1 * (w1 - w0)
                e0, e1 = e0 + q0 * (e1 - e0), e0 + q1 * (e1 - e0)
                d0, d1 = d0 + q0 * (d1 - d0), d0 + q1 * (d1 - d0)
                if lands >= len(landed) - 2:
                    landed = np.concatenate((landed, np.empty_like(landed)))
                if not at_once:
                    lands = _put(landed, lands, b0, e0, d0, b1, e1, d1)
                if pads >= len(on_pad) - len(curve_s) - 4:
                    on_pad = np.concatenate((on_pad, np.empty_like(on_pad)))
                pads = _onto_pad(on_pad, pads, w0, e0, d0, w1, e1, d1, curve_s, curve_soc)
            if end >= a1:
                break
            now = end
            while k < len(others_s) and others_s[k] - BEFORE_S <= now:
                now = max(now, min(others_s[k], a1))
                k += 1
    return running_max(on_pad, pads), running_max(landed, lands)


@compiled
def _onto_pad(
    out: NDArray[np.float64],
    count: int,
    w0: float,
    s0: float,
    t0: float,
    w1: float,
    s1: float,
    t1: float,
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> int:
    """Turn a piece that comes onto its pad into pieces of charging potential, split where charge meets a knot of the curve."""
    last = 0.0
    rising = s1 > s0
    knots = len(curve_soc)
    for step in range(knots + 1):
        part = 1.0
        if step < knots and s0 != s1:
            knot = curve_soc[step] if rising else curve_soc[knots - 1 - step]
            part = (knot - s0) / (s1 - s0)
            if part <= last:
                continue
            part = min(part, 1.0)
        elif step < knots:
            continue
        p0, p1 = w0 + last * (w1 - w0), w0 + part * (w1 - w0)
        u0 = interpolate(s0 + last * (s1 - s0), curve_soc, curve_s)
        u1 = interpolate(s0 + part * (s1 - s0), curve_soc, curve_s)
        count = _put(out, count, p0, u0 - p0, t0 + last * (t1 - t0), p1, u1 - p1, t0 + part * (t1 - t0))
        if part >= 1.0:
            break
        last = part
    return count


@compiled
def covers(a: NDArray[np.float64], b: NDArray[np.float64], tolerance: float) -> bool:
    """Return whether departure profile `a` is nowhere below `b` (by more than a tolerance).

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
        if _along(a, k, x) < b[i, 1] - tolerance:
            return False
    k = 0
    for i in range(len(a)):  # at the points of a, just before jumps
        x = a[i, 0]
        if x <= b[0, 0]:
            continue
        while k + 1 < len(b) and b[k + 1, 0] < x:
            k += 1
        if a[i, 1] < _along(b, k, x) - tolerance:
            return False
    return True
