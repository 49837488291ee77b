"""Kernels of opening hours: how long a pad is without power, and when landing at a station is allowed.

A station is closed at times (`models.queues.opening_hours`). A drone on its pads is not charged meanwhile; who would get a pad
gets it when it opens, which queue paths tell. Where there are no holding spots nobody lands while it is closed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from skyway.models.jit.compiled import compiled_lean

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind


class Shut(NamedTuple):
    """Closures of the places of an itinerary: the stop before each leg, and last where it ends."""

    offset: NDArray[np.int64]
    """Shape (places + 1,). Closures of place i are rows ``offset[i] : offset[i + 1]`` of the next."""
    closed_s: NDArray[np.float64]
    """Shape (closures, 2). From when and until when, POSIX seconds, ascending for each place."""
    no_landing: NDArray[np.bool_]
    """Shape (places,). Whether nobody lands there while it is closed."""


@compiled_lean
def opens(shut: Shut, place: int, time_s: float) -> float:
    """First time from a given one at which a place is open, POSIX seconds."""
    for k in range(shut.offset[place], shut.offset[place + 1]):
        if shut.closed_s[k, 0] <= time_s < shut.closed_s[k, 1]:
            time_s = shut.closed_s[k, 1]
    return time_s


@compiled_lean
def closed_for(shut: Shut, place: int, begin_s: float, end_s: float) -> float:
    """For how long it is closed between two times, s."""
    total = 0.0
    for k in range(shut.offset[place], shut.offset[place + 1]):
        total += max(min(end_s, shut.closed_s[k, 1]) - max(begin_s, shut.closed_s[k, 0]), 0.0)
    return total


@compiled_lean
def past_closures(shut: Shut, place: int, begin_s: float, end_s: float) -> float:
    """Time by which a place has been open for the span between two times, starting from another one, POSIX seconds."""
    for k in range(shut.offset[place], shut.offset[place + 1]):
        if shut.closed_s[k, 1] > begin_s and shut.closed_s[k, 0] < end_s:
            end_s += shut.closed_s[k, 1] - max(shut.closed_s[k, 0], begin_s)
    return end_s


@compiled_lean
def held_off(
    shut: Shut, place: int, air: SegmentWind, segments: NDArray[np.int64], time_s: float, most_s: float
) -> float:
    """First start of a flight to a place, from a time on, such that it does not end while landings are closed, POSIX seconds.

    It lasts `most_s` seconds at most, and no less than at the greatest ground speed.
    """
    if not shut.no_landing[place]:
        return time_s
    least_s = air.climb_s + air.descent_s
    for segment in segments:
        least_s += air.distance_m[segment] / air.max_ground_speed_mps
    for k in range(shut.offset[place], shut.offset[place + 1]):
        if shut.closed_s[k, 0] < time_s + max(most_s, least_s) and time_s + least_s < shut.closed_s[k, 1]:
            time_s = shut.closed_s[k, 1] - least_s
    return time_s
