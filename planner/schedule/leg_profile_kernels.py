"""Kernels that take a charge profile through a flight, a queue and a pad: from one stop to the next, exactly.

With g(t) the charge a drone can leave with at t (`planner.schedule.profile_kernels`) and a(t) the arrival function of
the flight:

- *flight*: leaving at t it lands at a(t) with s = g(t) - k - c (a(t) - t), where k is the charge that a flight costs
  and c that of a second;
- *queue*: a drone that arrives at a after the first i others touches down at b = max(a, land_i), hovering until then at
  the cost c (b - a), and has a pad at w = max(a + delay_i, pad_i) (`models.queues.paths.QueuePath`);
- *pad*: there its potential is z = F^-1(s) - w.

Each step takes lines to lines, so a piece stays six numbers: (a0, s0, t0, a1, s1, t1), time and charge at both of its
ends and the departures that lead to them. Where a step bends, the piece is cut. So the profile of the next stop is
exact for the piecewise-linear charging curve.

Source: charging-function propagation (Baum et al., "Shortest feasible paths with charging stops for battery electric
vehicles", Transportation Science 53, 2019), with time-dependent flights and queues added.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.planner.schedule.profile_kernels import SOC_TOLERANCE, along, interpolate, running_max

if TYPE_CHECKING:
    from numpy.typing import NDArray

BEFORE_S = 1e-3
"""Who wants to be before another drone in a queue arrives at least this much earlier: a tie is lost."""


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
    """Take a departure profile through a flight: pieces of charge on touch-down, by its time.

    Takes a profile and pieces in order of time, any number of them, and at least one point of `needed`. O(points +
    pieces).

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
        # The piece j of g that holds at the first take-off.
        now = max(t0, g[0, 0])
        while k + 1 < len(g) and g[k + 1, 0] <= now:
            k += 1
        j = k
        while True:
            # Up to the end of this piece of g or of the flight, whichever comes first.
            end = t1
            if j + 1 < len(g) and g[j + 1, 0] < t1:
                end = g[j + 1, 0]
            rate = 0.0
            if j + 1 < len(g) and g[j + 1, 0] > g[j, 0]:
                rate = (g[j + 1, 1] - g[j, 1]) / (g[j + 1, 0] - g[j, 0])
            # Touch-downs b and charges s at both ends.
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
    """Add the part of a linear piece that lands with at least the needed charge; returns the new count.

    n(a) + `margin` (a - t) is needed, n through the points of `needed`, constant outside them. The piece is cut at
    these.
    """
    # The usual case: n is constant.
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
        # The part of the piece between two points of n, and what is needed at both ends of it.
        b0, b1 = max(a0, low), min(a1, high)
        p0 = (b0 - a0) / (a1 - a0) if a1 > a0 else 0.0
        p1 = (b1 - a0) / (a1 - a0) if a1 > a0 else 1.0
        d0, d1 = t0 + p0 * (t1 - t0), t0 + p1 * (t1 - t0)
        # On this piece of n: at a jump its ends are not the neighbours'.
        n0 = along(needed, k, b0) if k >= 0 else needed[0, 1]
        n1 = along(needed, k, b1) if k >= 0 else needed[0, 1]
        n0, n1 = n0 + margin * (b0 - d0), n1 + margin * (b1 - d1)
        count = _clip(out, count, b0, s0 + p0 * (s1 - s0), d0, b1, s0 + p1 * (s1 - s0), d1, n0, n1)
        if a1 <= a0:
            break
    return count


@compiled_lean
def _spared(begin: float, end: float) -> tuple[float, float]:
    """Shares of a line from `begin` to `end`, at least one of them positive, between which it is not negative."""
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
    """Add the part of a linear piece on which s >= n, with n linear from n0 to n1; returns the new count."""
    d0, d1 = s0 - n0 + SOC_TOLERANCE, s1 - n1 + SOC_TOLERANCE
    if d0 < 0.0 and d1 < 0.0:
        return count
    p0, p1 = _spared(d0, d1)
    da, ds, dt = a1 - a0, s1 - s0, t1 - t0
    return _put(out, count, a0 + p0 * da, s0 + p0 * ds, t0 + p0 * dt, a0 + p1 * da, s0 + p1 * ds, t0 + p1 * dt)


@compiled
def _put(out: NDArray[np.float64], count: int, a0: float, s0: float, t0: float, a1: float, s1: float, t1: float) -> int:
    """Write a linear piece to row `count`; returns the new count."""
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
    """Land pieces at a station with a queue and put them on its pads: the profiles z and h there.

    Takes `count` pieces of finite times, of which there are at least so many, a queue path, and a charging curve of two points or more.

    Parameters
    ----------
    pieces, count
        Of `fly_profile`.
    soc_per_s : float
        Of hovering while every holding spot is taken.
    margin_soc_per_s, reserve_soc : float
        Least charge on touch-down after T seconds in the air is ``reserve_soc + margin_soc_per_s * T``.
    others_s : ndarray, shape (others,)
        Arrivals of the queue path, see `models.queues.paths.QueuePath`.
    pad_s, land_s, delay_s : ndarray, shape (others + 1,)
        Of that path.
    curve_s, curve_soc : ndarray, shape (points,)
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
        # Arrivals behind the first k others.
        k = np.searchsorted(others_s, a0, side="right")
        at_once = land_s[np.searchsorted(others_s, a1, side="right")] <= a0  # whoever is before it, it finds a spot
        # No hovering anywhere on the piece: all of it lands on arrival.
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
            # Cut it where another drone arrives, where hovering ends and where waiting for the pad ends.
            end = a1
            if k < len(others_s) and others_s[k] - BEFORE_S < end:
                end = max(others_s[k] - BEFORE_S, now)
            if land_s[k] > now and land_s[k] < end:
                end = land_s[k]
            if now < pad_s[k] - delay_s[k] < end:
                end = pad_s[k] - delay_s[k]
            # Shares of the piece; touch-downs b, times on the pad w, charges e and departures d at both ends.
            p0 = (now - a0) / (a1 - a0) if a1 > a0 else 0.0
            p1 = (end - a0) / (a1 - a0) if a1 > a0 else 1.0
            b0, b1 = max(now, land_s[k]), max(end, land_s[k])
            if end > now and land_s[k] >= end:
                b0 = b1 = land_s[k]
            w0, w1 = max(now + delay_s[k], pad_s[k]), max(end + delay_s[k], pad_s[k])
            e0 = s0 + p0 * (s1 - s0) - soc_per_s * (b0 - now)
            e1 = s0 + p1 * (s1 - s0) - soc_per_s * (b1 - end)
            d0, d1 = t0 + p0 * (t1 - t0), t0 + p1 * (t1 - t0)
            # Keep what lands with the reserve and the margin.
            spare0 = e0 - reserve_soc - margin_soc_per_s * (b0 - d0) + SOC_TOLERANCE
            spare1 = e1 - reserve_soc - margin_soc_per_s * (b1 - d1) + SOC_TOLERANCE
            if spare0 >= 0.0 or spare1 >= 0.0:
                q0, q1 = _spared(spare0, spare1)
                b0, b1 = b0 + q0 * (b1 - b0), b0 + q1 * (b1 - b0)
                w0, w1 = w0 + q0 * (w1 - w0), w0 + q1 * (w1 - w0)
                e0, e1 = e0 + q0 * (e1 - e0), e0 + q1 * (e1 - e0)
                d0, d1 = d0 + q0 * (d1 - d0), d0 + q1 * (d1 - d0)
                # Onto h and, over the charging curve, onto z.
                if lands >= len(landed) - 2:
                    landed = np.concatenate((landed, np.empty_like(landed)))
                if not at_once:
                    lands = _put(landed, lands, b0, e0, d0, b1, e1, d1)
                if pads >= len(on_pad) - len(curve_s) - 4:
                    on_pad = np.concatenate((on_pad, np.empty_like(on_pad)))
                pads = _onto_pad(on_pad, pads, w0, e0, d0, w1, e1, d1, curve_s, curve_soc)
            if end >= a1:
                break
            # Continue behind the others that have arrived by then; the last `BEFORE_S` before an arrival are omitted:
            # a tie is lost.
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
    """Turn a piece that comes onto its pad into pieces of potential z = F^-1(s) - w; returns the new count.

    The piece (w0, s0, t0, w1, s1, t1) is split where its charge meets a knot of the curve, so that F^-1 is linear on
    each part.
    """
    last = 0.0
    rising = s1 > s0
    knots = len(curve_soc)
    for step in range(knots + 1):
        # Share of the piece at which it meets the next knot, in the order in which its charge goes.
        part = 1.0
        if step < knots and s0 != s1:
            knot = curve_soc[step] if rising else curve_soc[knots - 1 - step]
            part = (knot - s0) / (s1 - s0)
            if part <= last:
                continue
            part = min(part, 1.0)
        elif step < knots:
            continue
        # From the knot before to this one.
        p0, p1 = w0 + last * (w1 - w0), w0 + part * (w1 - w0)
        u0 = interpolate(s0 + last * (s1 - s0), curve_soc, curve_s)
        u1 = interpolate(s0 + part * (s1 - s0), curve_soc, curve_s)
        count = _put(out, count, p0, u0 - p0, t0 + last * (t1 - t0), p1, u1 - p1, t0 + part * (t1 - t0))
        if part >= 1.0:
            break
        last = part
    return count
