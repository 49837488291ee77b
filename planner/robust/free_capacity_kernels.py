"""Kernels of free capacity: whether the next station has a free place on arrival, given its queue now."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.schedule.schedule_kernels import Queues

LOOK_S = 120.0
"""A drone that finds no room at the next station looks again after so long."""
_NEGLIGIBLE = 1e-12
_MOST = 60  # departures that are considered


class FreeCapacity(NamedTuple):
    """Stations at the end of each leg, for the chance to find one full; shape (legs,) where nothing else is said."""

    pads: NDArray[np.int64]
    spots: NDArray[np.int64]
    """Pads, and holding spots beside them."""
    start_s: float
    arrivals_per_s: NDArray[np.float64]
    services_per_s: NDArray[np.float64]
    """Others that arrive, and that leave one busy pad, in each hour from `start_s`, POSIX seconds, on; shape (legs, hours)."""
    most: float
    """Greatest probability of a full station with which a flight starts; 1: pads are ignored."""


class Present(NamedTuple):
    """Others at the stations, to be counted at any time; an entry for each queue path, in the order of `Queues`."""

    at_start: NDArray[np.int64]
    """Shape (entries,). On pads and in line when the path begins."""
    offset: NDArray[np.int64]
    left_s: NDArray[np.float64]
    """Departures after that of entry i are ``left_s[offset[i] : offset[i + 1]]``, ascending."""

    @classmethod
    def of(cls, paths: PackedPaths) -> Present:
        """Those of packed paths."""
        return cls(paths.present, paths.left_offset, paths.left_s)


@compiled_lean
def chance_full(pads: int, spots: int, arrivals: float, services: float, present: int) -> float:
    """Chance that all pads and spots are taken after a while in which `arrivals` others are expected.

    P(A - D >= room) = sum over d of P(D = d) P(A >= room + d), room = pads + spots - present, with A Poisson of mean
    `arrivals` and D Poisson of mean `services` times the pads busy now: those that arrive in the meantime are assumed
    not to leave again.

    Takes counts and expected numbers from 0 up, all finite. Without room now, a drone must leave first.

    Parameters
    ----------
    pads, spots : int
        Of the station.
    arrivals, services : float
        Expected number of arrivals, and of departures from one busy pad, in the while.
    present : int
        Others there now.
    """
    room = pads + spots - present
    leaving = services * min(pads, present)
    gone = math.exp(-leaving)  # probability of `count` departures
    more = 1.0  # and of at least so many
    count = 0
    total = 0.0
    below, term = 0.0, math.exp(-arrivals)  # probability of fewer arrivals than there is room for, and of just so many
    # P(A < room), and P(A = room).
    for k in range(room):
        below += term
        term *= arrivals / (k + 1)
    # One departure more at a time, until more than `room + d` arrivals are negligible.
    while True:
        late = max(1.0 - below, 0.0)
        total += gone * late
        more -= gone
        count += 1
        gone *= leaving / count
        if late < _NEGLIGIBLE:
            return total
        if count > _MOST:
            return min(total + max(more, 0.0) * late, 1.0)
        if room + count > 0:
            below += term
            term *= arrivals / (room + count)


@compiled
def chances(
    pads: NDArray[np.int64],
    spots: NDArray[np.int64],
    arrivals: NDArray[np.float64],
    services: NDArray[np.float64],
    present: NDArray[np.int64],
) -> NDArray[np.float64]:
    """`chance_full` of several stations, shape (stations,).

    Takes arrays of one length.
    """
    out = np.empty(len(pads))
    for i in range(len(pads)):
        out[i] = chance_full(pads[i], spots[i], arrivals[i], services[i], present[i])
    return out


@compiled_lean
def others_at(queues: Queues, there: Present, entry: int, time_s: float) -> int:
    """Others at the station of an entry at a time: at the start, plus arrived, minus left by then."""
    low, high = queues.offset[entry], queues.offset[entry + 1]
    # The first arrival of a packed path is -inf, not a drone.
    came = max(np.searchsorted(queues.arrival_s[low:high], time_s, side="right") - 1, 0)
    left = np.searchsorted(there.left_s[there.offset[entry] : there.offset[entry + 1]], time_s, side="right")
    return int(there.at_start[entry] + came - left)


@compiled_lean
def expected(per_s: NDArray[np.float64], begin_s: float, end_s: float) -> float:
    """Expected number of events between two times, at the rate of each hour, shape (hours,); the last rate continues.

    Times are seconds from the beginning of the first hour, which may not be after either.

    Takes one rate or more, and finite times from 0 up, the end not before the beginning.
    """
    last = len(per_s) - 1
    hour = min(int(begin_s // S_PER_H), last)
    total, at = 0.0, begin_s
    while hour < last and (hour + 1) * S_PER_H < end_s:
        total += per_s[hour] * ((hour + 1) * S_PER_H - at)
        hour += 1
        at = hour * S_PER_H
    return float(total + per_s[hour] * max(end_s - at, 0.0))


@compiled_lean
def is_room(room: FreeCapacity, leg: int, present: int, time_s: float, flight_s: float) -> bool:
    """Return whether the station at the end of a leg has room, likely enough, after a flight, with so many there now.

    The flight begins at `time_s`, POSIX seconds, and is expected to last `flight_s`.
    """
    begin_s = max(time_s - room.start_s, 0.0)
    full = chance_full(
        room.pads[leg],
        room.spots[leg],
        expected(room.arrivals_per_s[leg], begin_s, begin_s + flight_s),
        expected(room.services_per_s[leg], begin_s, begin_s + flight_s),
        present,
    )
    return full <= room.most


@compiled_lean
def next_look(
    room: FreeCapacity,
    leg: int,
    queues: Queues,
    there: Present,
    entry: int,
    time_s: float,
    flight_s: float,
    until_s: float,
) -> float:
    """Find the first time after one without room, in steps of `LOOK_S`, at which there is room or `until_s` is over.

    `entry` is the queue path of the station in `queues` and `there`; the chance is computed again only when the number of others has changed.
    """
    seen = others_at(queues, there, entry, time_s)
    while True:
        time_s += LOOK_S
        if time_s >= until_s:
            return time_s
        present = others_at(queues, there, entry, time_s)
        if present != seen and is_room(room, leg, present, time_s, flight_s):
            return time_s
        seen = present
