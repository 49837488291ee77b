"""Kernels of the calendars of pads: windows that are taken, and the next that is free."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SLACK = 1e-9


class Calendar(NamedTuple):
    """Windows in which pads are taken, by pad in order of time."""

    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    owner: NDArray[np.int64]
    """Shape (pads, windows) each: from when to when, and by which drone; -1 is none of ours."""
    filled: NDArray[np.int64]
    """Shape (pads,)."""


@compiled
def free_from(calendar: Calendar, pad: int, time_s: float, length_s: float, drone: int) -> float:
    """Earliest time from which a pad is free for so long, as far as others take it."""
    low, high = 0, calendar.filled[pad]
    while low < high:  # the first window that ends after the time
        middle = (low + high) // 2
        if calendar.end_s[pad, middle] > time_s:
            high = middle
        else:
            low = middle + 1
    for number in range(low, calendar.filled[pad]):
        if calendar.owner[pad, number] == drone:
            continue
        if calendar.start_s[pad, number] >= time_s + length_s - SLACK:
            break
        time_s = max(time_s, calendar.end_s[pad, number])
    return time_s


@compiled
def book(calendar: Calendar, pad: int, start_s: float, end_s: float, drone: int) -> bool:
    """Write a window into the calendar; false where there is no room for it.

    Takes a pad of the calendar, finite times and any owner.
    """
    count = calendar.filled[pad]
    if count >= calendar.start_s.shape[1]:
        return False
    place = count
    while place > 0 and calendar.start_s[pad, place - 1] > start_s:
        calendar.start_s[pad, place] = calendar.start_s[pad, place - 1]
        calendar.end_s[pad, place] = calendar.end_s[pad, place - 1]
        calendar.owner[pad, place] = calendar.owner[pad, place - 1]
        place -= 1
    calendar.start_s[pad, place], calendar.end_s[pad, place], calendar.owner[pad, place] = start_s, end_s, drone
    calendar.filled[pad] = count + 1
    return True
