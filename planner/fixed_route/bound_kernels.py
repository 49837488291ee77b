"""Kernels of lower bounds of the time for the rest of a fixed route.

Let tau(s) be the time from empty to charge s where every percent comes from the fastest pad there is. Stops of any plan take at
least the sum of tau(leaving) - tau(arriving). Put together by ways, not by stops, each way of energy E that starts with charge d
adds tau(d) - tau(d - E), which grows with d, for tau is convex: it is least for the d that the way needs. So a way costs its time
and that, whatever comes before and behind it, the last one tau(d), and the least sum is a shortest path. It is no bound only but the answer where all
pads are alike and each way starts with what it needs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled
from skyway.planner.schedule.profile_kernels import interpolate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.fixed_route.way_kernels import Hops


@compiled
def way_cost(
    seconds: float,
    soc: float,
    ratios: tuple[float, float],
    reserve_soc: float,
    tau_soc: NDArray[np.float64],
    tau_s: NDArray[np.float64],
) -> float:
    """Bound of a way: its time, and charging for it; infinite where no battery lasts. `ratios` are mean and sure."""
    need = reserve_soc + ratios[1] * soc
    if not seconds < math.inf or need > 1.0 + 1e-12:
        return math.inf
    return seconds + interpolate(need, tau_soc, tau_s) - interpolate(need - ratios[0] * soc, tau_soc, tau_s)


@compiled
def remaining(
    hops: Hops,
    can_leave: NDArray[np.bool_],
    least_wait_s: NDArray[np.float64],
    ratios: tuple[float, float],
    reserve_soc: float,
    tau_soc: NDArray[np.float64],
    tau_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Bound of what is left, for each position that the work was left at and each pad, shape (positions, pads), seconds.

    Takes hops of one slot: of each the least.
    """
    positions, pads = hops.to_s.shape[1], hops.to_s.shape[2]
    left = np.full((positions, pads), math.inf)
    least_on = np.full(positions, math.inf)  # from each position, over any pad, its charge by the least price
    # what a way costs at least: charge is worth no less than where the fastest curve is the fastest
    per_soc = ratios[0] * (tau_s[1] - tau_s[0]) / (tau_soc[1] - tau_soc[0])
    done_s, done_soc = np.zeros(positions), np.zeros(positions)
    for position in range(positions - 1):
        done_s[position + 1] = done_s[position] + hops.work_s[0, position]
        done_soc[position + 1] = done_soc[position] + hops.work_soc[0, position]
    for position in range(positions - 1, -1, -1):
        if not can_leave[position]:
            continue
        first = hops.resume[position]
        for pad in range(pads):
            begin_s, begin_soc = hops.from_s[0, position, pad], hops.from_soc[0, position, pad]
            if not begin_s < math.inf:
                continue
            last = first
            while last + 1 < positions and done_s[last + 1] - done_s[first] < math.inf:
                if reserve_soc + ratios[1] * (begin_soc + done_soc[last + 1] - done_soc[first]) > 1.0 + 1e-12:
                    break
                last += 1
            best = math.inf
            for until in range(last, first - 1, -1):  # the farthest first: it is nearly the best
                seconds = begin_s + done_s[until] - done_s[first]
                soc = begin_soc + done_soc[until] - done_soc[first]
                if until == positions - 1:
                    need = reserve_soc + ratios[1] * soc
                    if need <= 1.0 + 1e-12:  # what is left at the end is of no use
                        best = min(best, seconds + interpolate(need, tau_soc, tau_s))
                least_s = seconds + per_soc * soc
                if until <= position or not can_leave[until] or least_s + least_on[until] >= best:
                    continue
                for to_pad in range(pads):
                    time_s = seconds + hops.to_s[0, until, to_pad] + least_wait_s[to_pad]
                    energy = soc + hops.to_soc[0, until, to_pad]
                    if time_s + per_soc * energy + left[until, to_pad] >= best:
                        continue
                    cost = way_cost(time_s, energy, ratios, reserve_soc, tau_soc, tau_s)
                    best = min(best, cost + left[until, to_pad])
            left[position, pad] = best
        changed = True
        while changed:  # from pad to pad
            changed = False
            for pad in range(pads):
                for to_pad in range(pads):
                    time_s = hops.between_s[0, pad, to_pad] + least_wait_s[to_pad]
                    if pad == to_pad or time_s + left[position, to_pad] >= left[position, pad]:
                        continue
                    cost = way_cost(time_s, hops.between_soc[0, pad, to_pad], ratios, reserve_soc, tau_soc, tau_s)
                    if cost + left[position, to_pad] < left[position, pad] - 1e-9:
                        left[position, pad] = cost + left[position, to_pad]
                        changed = True
        for pad in range(pads):
            there_s = hops.to_s[0, position, pad] + least_wait_s[pad] + per_soc * hops.to_soc[0, position, pad]
            least_on[position] = min(least_on[position], there_s + left[position, pad])
    return left


@compiled
def onward(
    g: NDArray[np.float64],
    left_at: int,
    pad: int,
    hops: Hops,
    left: NDArray[np.float64],
    can_leave: NDArray[np.bool_],
    least_wait_s: NDArray[np.float64],
    ratios: tuple[float, float],
    reserve_soc: float,
    tau_soc: NDArray[np.float64],
    tau_s: NDArray[np.float64],
    curves: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]],
    best_s: float,
) -> NDArray[np.float64]:
    """Ways on from a stop, rows of shape (5,), those only that may end before `best_s`; unsorted.

    `g` is the departure profile there; `left_at` and `pad` are -1 at the start of the route. `curves` are the kind of each pad, and of
    each kind seconds and SoC. A row is a bound of the end, position, pad (-1: the end of the route), and bounds of what is there: the
    earliest arrival, and the greatest charging potential (`planner.schedule.profile_kernels`).

    Takes positions and pads of the hops, and fastest and other curves of two points at least, both of which increase.
    """
    positions, pads = left.shape
    kind_of, curve_s, curve_soc = curves
    out = np.empty(((positions + 1) * pads + 1, 5))
    size = 0
    start = pad < 0
    # what a way costs at least: charge is worth no less than where the fastest curve is the fastest
    per_soc = ratios[0] * (tau_s[1] - tau_s[0]) / (tau_soc[1] - tau_soc[0])
    base_s = math.inf
    for i in range(len(g)):
        base_s = min(base_s, g[i, 0] - interpolate(g[i, 1], tau_soc, tau_s))
    if not start:
        for to_pad in range(pads):
            if to_pad == pad or not left[left_at, to_pad] < math.inf:
                continue
            time_s = hops.between_s[0, pad, to_pad] + least_wait_s[to_pad]
            soc = hops.between_soc[0, pad, to_pad]
            bound = _bound(g, time_s, soc, ratios, reserve_soc, tau_soc, tau_s) + left[left_at, to_pad]
            if bound < best_s:
                kind = kind_of[to_pad]
                out[size, 0], out[size, 1], out[size, 2] = bound, left_at, to_pad
                out[size, 3], out[size, 4] = _there(
                    g, time_s - least_wait_s[to_pad], soc, ratios, reserve_soc, curve_soc[kind], curve_s[kind]
                )
                size += 1
    seconds = 0.0 if start else hops.from_s[0, left_at, pad]
    soc = 0.0 if start else hops.from_soc[0, left_at, pad]
    first = 0 if start else hops.resume[left_at]
    for until in range(first, positions):
        if until > first:
            seconds += hops.work_s[0, until - 1]
            soc += hops.work_soc[0, until - 1]
        if reserve_soc + ratios[1] * soc > 1.0 + 1e-12 or not seconds < math.inf:
            break
        if until == positions - 1:
            bound, _ = _there(g, seconds, soc, ratios, reserve_soc, tau_soc, tau_s)
            if bound < best_s:
                out[size, 0], out[size, 1], out[size, 2] = bound, until, -1
                out[size, 3], out[size, 4] = -math.inf, math.inf
                size += 1
        if until <= left_at or not can_leave[until]:
            continue
        for to_pad in range(pads):
            time_s = seconds + hops.to_s[0, until, to_pad] + least_wait_s[to_pad]
            energy = soc + hops.to_soc[0, until, to_pad]
            if not base_s + per_soc * energy + time_s + left[until, to_pad] < best_s:
                continue
            bound = _bound(g, time_s, energy, ratios, reserve_soc, tau_soc, tau_s) + left[until, to_pad]
            if bound < best_s:
                kind = kind_of[to_pad]
                out[size, 0], out[size, 1], out[size, 2] = bound, until, to_pad
                out[size, 3], out[size, 4] = _there(
                    g, time_s - least_wait_s[to_pad], energy, ratios, reserve_soc, curve_soc[kind], curve_s[kind]
                )
                size += 1
    return out[:size].copy()


@compiled
def _bound(
    g: NDArray[np.float64],
    seconds: float,
    soc: float,
    ratios: tuple[float, float],
    reserve_soc: float,
    tau_soc: NDArray[np.float64],
    tau_s: NDArray[np.float64],
) -> float:
    """Least t + seconds - tau(g(t) - E) over take-offs t with the charge that is needed.

    g is linear and tau convex, so that the least is at a point of g, or where there is charge enough for the first time.
    """
    need = reserve_soc + ratios[1] * soc - 1e-12
    best = math.inf
    for i in range(len(g)):
        t, charge = g[i, 0], g[i, 1]
        if charge < need:
            continue
        best = min(best, t - interpolate(charge - ratios[0] * soc, tau_soc, tau_s))
        if i > 0 and g[i - 1, 1] < need and t > g[i - 1, 0]:
            part = (need - g[i - 1, 1]) / (charge - g[i - 1, 1])
            t = g[i - 1, 0] + part * (t - g[i - 1, 0])
            best = min(best, t - interpolate(need - ratios[0] * soc, tau_soc, tau_s))
    return best + seconds


@compiled
def _there(
    g: NDArray[np.float64],
    seconds: float,
    soc: float,
    ratios: tuple[float, float],
    reserve_soc: float,
    curve_soc: NDArray[np.float64],
    curve_s: NDArray[np.float64],
) -> tuple[float, float]:
    """Earliest arrival after a way and greatest charging potential there, for hops that take the least they take in any slot.

    The potential F^-1(s) - t is convex in t on each piece of g, so that it is greatest at a point of g, or where the way begins to be
    possible.
    """
    need = reserve_soc + ratios[1] * soc - 1e-12
    first, most = math.inf, -math.inf
    for i in range(len(g)):
        t, charge = g[i, 0], g[i, 1]
        if charge < need:
            continue
        most = max(most, interpolate(charge - ratios[0] * soc, curve_soc, curve_s) - t)
        if i > 0 and g[i - 1, 1] < need and t > g[i - 1, 0]:
            part = (need - g[i - 1, 1]) / (charge - g[i - 1, 1])
            t = g[i - 1, 0] + part * (t - g[i - 1, 0])
            most = max(most, interpolate(need - ratios[0] * soc, curve_soc, curve_s) - t)
        first = min(first, t)
    return first + seconds, most - seconds
