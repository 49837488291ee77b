"""Pads that are available only in time windows: a van with a limited stay, or a pad between two bookings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.way_kernels import AT_ONCE, NO_DELAY, NO_OTHERS, flown, waited
from skyway.planner.schedule.leg_profile_kernels import stop_profile
from skyway.planner.schedule.profile_kernels import departure_profile

if TYPE_CHECKING:
    from numpy.typing import NDArray

Window = tuple[float, float]
"""Seconds: no landing before the first, and no stay beyond the last."""
ALWAYS: Window = (-math.inf, math.inf)
NEVER: Window = (-math.inf, -math.inf)
_NONE: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] = (
    np.empty((0, 3)),
    np.empty((0, 3)),
    np.empty((0, 2)),
)


def landed_within(
    g: NDArray[np.float64],
    pieces: NDArray[np.float64],
    ratios: tuple[float, float],
    reserve_soc: float,
    wait: NDArray[np.float64],
    curve: tuple[NDArray[np.float64], NDArray[np.float64]],
    window: Window,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Take a departure profile over a way and onto a pad as `way_kernels.landed` does, in a window of the pad.

    A drone that would arrive too early takes off later; the profile of the next departure ends with the window.
    """
    rows = _arriving(np.asarray(flown(g, pieces, *ratios, reserve_soc)), window)
    if not len(rows):
        return _NONE
    none_else = (0.0, 0.0, -math.inf, NO_OTHERS, AT_ONCE, AT_ONCE, NO_DELAY, *curve)
    z, h = stop_profile(rows, len(rows), *none_else)
    if wait[:, 1].max() > 0.0:
        later = waited(rows, wait)
        z, _ = stop_profile(later, len(later), *none_else)
    return z, h, until(np.asarray(departure_profile(z, h, *curve)), window[1])


def _arriving(rows: NDArray[np.float64], window: Window) -> NDArray[np.float64]:
    """Return the parts of rows (a0, s0, t0, a1, s1, t1) that arrive within a window."""
    first, last = window
    rows = rows[(rows[:, 3] >= first) & (rows[:, 0] <= last)]
    length = np.maximum(rows[:, 3] - rows[:, 0], 1e-300)[:, None]
    begin = np.clip((first - rows[:, :1]) / length, 0.0, 1.0)
    end = np.clip((last - rows[:, :1]) / length, 0.0, 1.0)
    step = rows[:, 3:] - rows[:, :3]
    return np.ascontiguousarray(np.hstack((rows[:, :3] + begin * step, rows[:, :3] + end * step)))


def until(g: NDArray[np.float64], last_s: float) -> NDArray[np.float64]:
    """Return a departure profile up to a time."""
    if not len(g) or g[-1, 0] <= last_s:
        return g
    kept = int(np.searchsorted(g[:, 0], last_s, side="right"))
    if not kept:
        return g[:0]
    (t0, s0), (t1, s1) = g[kept - 1], g[kept]
    if t1 <= t0:
        return g[:kept].copy()
    return np.vstack((g[:kept], (last_s, s0 + (s1 - s0) * (last_s - t0) / (t1 - t0))))
