"""Kernels of the ways of a fixed route: from a pad over its work to a pad, with their time and charge.

A *position* is a point of the work, numbered from 0. A *way* leads from a pad to the position where the work goes on, over the
work as far as another position, and from there to a pad; or from pad to pad; or to the end of the work. Each hop takes what the
slot says in which it begins, so that between two changes a way takes the same time whenever it starts.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import Slots, slot_number, slot_until
from skyway.models.jit.compiled import compiled
from skyway.planner.schedule.leg_profile_kernels import fly_profile, stop_profile
from skyway.planner.schedule.profile_kernels import departure_profile

if TYPE_CHECKING:
    from numpy.typing import NDArray

BEFORE_CHANGE_S = 1e-5
"""Who wants what a slot says takes off at least so long before it ends."""
NO_OTHERS = np.empty(0)
AT_ONCE = np.array([-math.inf])
NO_DELAY = np.zeros(1)
"""A queue of nobody, as `stop_profile` takes it."""
NOWHERE = -1
"""Instead of a pad: the start of the route, or its end."""


class Hops(NamedTuple):
    """What every hop takes, by the slot in which it begins: seconds, infinite where nobody flies it, and SoC by the model."""

    work_s: NDArray[np.float64]
    work_soc: NDArray[np.float64]
    """Shape (slots, positions - 1). From each position to the next."""
    to_s: NDArray[np.float64]
    to_soc: NDArray[np.float64]
    """Shape (slots, positions, pads). From a position, where the work is left, to a pad."""
    from_s: NDArray[np.float64]
    from_soc: NDArray[np.float64]
    """Shape (slots, positions, pads). From a pad to where the work goes on that was left at a position."""
    between_s: NDArray[np.float64]
    between_soc: NDArray[np.float64]
    """Shape (slots, pads, pads). From pad to pad."""
    resume: NDArray[np.int64]
    """Shape (positions,). Position where the work goes on that was left at a position: itself, or a later one."""


@compiled
def way(
    hops: Hops, slots: Slots, left_at: int, pad: int, until: int, to_pad: int, time_s: float
) -> tuple[float, float, float]:
    """Time in s and SoC of a way that starts at a time, and for how many more seconds both stay the same.

    It begins at `pad`, work having been left at `left_at`, or at `NOWHERE` at the start of the route; it ends on `to_pad`, with the
    work done as far as position `until`, or at `NOWHERE` at the end of the route.

    Takes positions and pads of the hops, `until` no less than `left_at`, and any time.
    """
    now, soc, same = time_s, 0.0, math.inf
    if pad >= 0 and until == left_at:  # from pad to pad
        slot = slot_number(slots, now)
        same = slot_until(slots, slot) - now
        return hops.between_s[slot, pad, to_pad], hops.between_soc[slot, pad, to_pad], same
    first = 0
    if pad >= 0:
        slot = slot_number(slots, now)
        same = slot_until(slots, slot) - now
        now += hops.from_s[slot, left_at, pad]
        soc += hops.from_soc[slot, left_at, pad]
        first = hops.resume[left_at]
    for position in range(first, until):
        if now == math.inf:
            break
        slot = slot_number(slots, now)
        same = min(same, slot_until(slots, slot) - now)
        now += hops.work_s[slot, position]
        soc += hops.work_soc[slot, position]
    if to_pad >= 0 and now < math.inf:
        slot = slot_number(slots, now)
        same = min(same, slot_until(slots, slot) - now)
        now += hops.to_s[slot, until, to_pad]
        soc += hops.to_soc[slot, until, to_pad]
    return now - time_s, soc, same


@compiled
def pieces_of(
    hops: Hops, slots: Slots, left_at: int, pad: int, until: int, to_pad: int, from_s: float, to_s: float
) -> NDArray[np.float64]:
    """Pieces (t0, t1, seconds, SoC) of a way by its take-off from `from_s` to `to_s`, sorted; nobody takes off in the gaps.

    Left out are take-offs after which a later one arrives no later: a drone that waits has more charge, too.

    Takes a way as `way` does, and finite times.
    """
    out = np.empty((16, 4))
    size = 0
    now = from_s
    while True:
        seconds, soc, same = way(hops, slots, left_at, pad, until, to_pad, now)
        end = min(now + max(same, 1e-6), to_s)
        if seconds < math.inf:
            if size == len(out):
                grown = np.empty((2 * size, 4))
                grown[:size] = out
                out = grown
            # at the change itself the way starts in the next slot
            last = end if end >= to_s else max(end - BEFORE_CHANGE_S, now)
            out[size, 0], out[size, 1], out[size, 2], out[size, 3] = now, last, seconds, soc
            size += 1
        if end >= to_s:
            break
        now = end
    kept = size
    earliest = math.inf
    for i in range(size - 1, -1, -1):
        t0, t1, seconds, soc = out[i]
        if t0 + seconds >= earliest:
            continue
        kept -= 1
        out[kept, 0], out[kept, 1], out[kept, 2], out[kept, 3] = t0, min(t1, earliest - seconds), seconds, soc
        earliest = t0 + seconds
    return out[kept:size].copy()


@compiled
def flown(
    g: NDArray[np.float64], pieces: NDArray[np.float64], mean_ratio: float, sure_ratio: float, reserve_soc: float
) -> NDArray[np.float64]:
    """Take a departure profile over a way: rows (a0, s0, t0, a1, s1, t1) of arrival, charge and departure, sorted by arrival.

    A way takes `mean_ratio` times what the model says, and starts only with charge for `sure_ratio` times that, and the reserve.

    Takes a profile and pieces in order of time, any number of them.
    """
    found = np.empty((0, 6))
    for i in range(len(pieces)):
        t0, t1, seconds, soc = pieces[i]
        flights = np.array([[t0, t0 + seconds, t1, t1 + seconds]])
        needed = np.array([[t0, reserve_soc + (sure_ratio - mean_ratio) * soc]])
        rows, count = fly_profile(g, flights, 0.0, mean_ratio * soc, 0.0, needed, math.inf)
        if count:
            found = np.concatenate((found, rows[:count]))
    return found


@compiled
def waited(rows: NDArray[np.float64], wait: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let arrivals wait for their pad: rows as those of `flown`, with the time at which the pad is theirs.

    `wait` has points (arrival, wait), shape (points, 2): linear between them, constant outside; nobody who arrives later is
    earlier on the pad.

    Takes rows of finite times in order, and one point of the wait or more, by arrival, no two at the same time.
    """
    out = np.empty((len(rows) * (len(wait) + 1), 6))
    size = 0
    for i in range(len(rows)):
        a0, s0, t0, a1, s1, t1 = rows[i]
        at = a0
        k = np.searchsorted(wait[:, 0], a0, side="right")
        while True:
            end = a1 if k >= len(wait) else min(a1, wait[k, 0])
            p0 = (at - a0) / (a1 - a0) if a1 > a0 else 0.0
            p1 = (end - a0) / (a1 - a0) if a1 > a0 else 1.0
            out[size, 0] = at + np.interp(at, wait[:, 0], wait[:, 1])
            out[size, 1], out[size, 2] = s0 + p0 * (s1 - s0), t0 + p0 * (t1 - t0)
            out[size, 3] = end + np.interp(end, wait[:, 0], wait[:, 1])
            out[size, 4], out[size, 5] = s0 + p1 * (s1 - s0), t0 + p1 * (t1 - t0)
            size += 1
            if end >= a1:
                break
            at = end
            k += 1
    return out[:size].copy()


@compiled
def landed(
    g: NDArray[np.float64],
    pieces: NDArray[np.float64],
    ratios: tuple[float, float],
    reserve_soc: float,
    wait: NDArray[np.float64],
    curve_s: NDArray[np.float64],
    curve_soc: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Take a departure profile over a way and onto its pad: the profiles z and h there, and that of the next departure.

    All are empty where no take-off is possible. Takes what `flown` and `waited` take, and a curve that ascends.
    """
    rows = flown(g, pieces, ratios[0], ratios[1], reserve_soc)
    if len(rows) == 0:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2))
    z, h = stop_profile(rows, len(rows), 0.0, 0.0, -math.inf, NO_OTHERS, AT_ONCE, AT_ONCE, NO_DELAY, curve_s, curve_soc)
    if wait[:, 1].max() > 0.0:
        later = waited(rows, wait)
        z, _ = stop_profile(
            later, len(later), 0.0, 0.0, -math.inf, NO_OTHERS, AT_ONCE, AT_ONCE, NO_DELAY, curve_s, curve_soc
        )
    return z, h, departure_profile(z, h, curve_s, curve_soc)
