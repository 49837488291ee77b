"""Kernels that sample a queue: the other drones at a station arrive, wait, charge and leave, one realization after another."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.models.jit.random_kernels import exponential

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Integers: TypeAlias = NDArray[np.int64]

_ROOM = 64
"""Drones of a realization for which there is room at first."""


@compiled_lean
def _after(t: float, amount: float, rates: Floats, first_s: float) -> float:
    """Find when a rate, constant within hours, has added up to an amount since `t`; inf if it never does.

    The time of the next event of a Poisson process, for a standard exponential `amount`: the t' with integral of the
    rate from t to t' = amount. `rates` are per s, the first hour begins at `first_s`, the last never ends.
    """
    last = len(rates) - 1
    slot = min(max(int((t - first_s) / 3600.0), 0), last)
    while slot < last:
        # What this hour adds from t on, and whether that is enough.
        ends = first_s + (slot + 1) * 3600.0
        inside = rates[slot] * (ends - t)
        if inside >= amount and rates[slot] > 0.0:
            break
        amount -= max(inside, 0.0)
        t = max(t, ends)
        slot += 1
    if rates[slot] <= 0.0:
        return np.inf
    done: float = t + amount / rates[slot]
    return done


@compiled_lean
def _live(
    key: np.uint64,
    pads: int,
    rates: tuple[Floats, Floats],
    times: tuple[float, float, float],
    present: int,
    known_s: Floats,
    free: Floats,
    room: tuple[Floats, Floats, Floats, Floats],
) -> tuple[int, int, int, int]:
    """Serve the drones of one realization, see `lived_sets`: (came, waiting, present at the start, departures), of which -1 came if the room is too small.

    Into `room`, as long as that is: arrivals and times on the pad of all of them, when the pad would be free behind the first so
    many, and departures after the start, ascending. `free` has the shape (pads,).
    """
    arrivals, services = rates
    first_s, start_s, end_s = times
    came, began, ready, left = room
    free[:] = -np.inf
    now, waiting, used = start_s, max(present - pads, 0), 0
    # Drones present at the start: on pads, for known or sampled times, and the rest in line.
    for pad in range(min(present, pads)):
        free[pad] = (
            max(known_s[pad], start_s)
            if pad < len(known_s)
            else _after(start_s, exponential(key, used), services, first_s)
        )
        used += 1
    # Departures after the start, at first of the drones on pads then.
    later = 0
    for pad in range(pads):
        if free[pad] > start_s:
            later = _put_in_order(left, later, free[pad])
    at_start = later
    count = 0
    while True:
        # The pad that is free first: a drone of ours behind the first `count` others would get it then.
        earliest = 0
        for pad in range(1, pads):
            if free[pad] < free[earliest]:
                earliest = pad
        ready[count] = free[earliest]
        if max(count, later) + 1 >= len(came):
            return -1, waiting, at_start, later
        # The next arrival, once those that waited at the start are served; the path ends with the horizon.
        if count >= waiting:
            now = _after(now, exponential(key, used), arrivals, first_s)
            used += 1
            if now > end_s:
                return count, waiting, at_start, later
        # It gets its pad and leaves it.
        came[count], began[count] = now, max(now, free[earliest])
        free[earliest] = _after(began[count], exponential(key, used), services, first_s)
        used += 1
        if free[earliest] > start_s:
            later = _put_in_order(left, later, free[earliest])
            if count < waiting:
                at_start += 1
        count += 1


@compiled_lean
def _put_in_order(ascending: Floats, count: int, value: float) -> int:
    """Insert a value among the first `count`, which ascend; returns the new count. Mostly it is one of the last."""
    k = count
    while k > 0 and ascending[k - 1] > value:
        ascending[k] = ascending[k - 1]
        k -= 1
    ascending[k] = value
    return count + 1


@compiled
def lived_sets(
    keys: NDArray[np.uint64],
    places: tuple[Integers, Integers],
    rates: tuple[Floats, Floats],
    begins: tuple[float, float],
    end_s: Floats,
    present: Integers,
    known: tuple[Floats, Integers],
) -> tuple[Integers, Floats, Floats, Floats, Integers, Integers, Floats]:
    """Serve the drones present at first and all that arrive until the end, first come, first served, in realizations of some stations.

    For the i-th of the drones of a realization: it arrives at a_i, the next event after a_(i-1) of a Poisson process with the
    arrival rate; it gets the pad that is free first, at b_i = max(a_i, f), and leaves it at the next event after b_i with
    the service rate, which is the pad's new f. `models.queues.paths.QueuePath` is what a drone meets behind the first 0, 1, 2, ... of those
    that come after the start. The standard exponential deviates of the events are those of the key, in their order.
    One call for all: what is done for a realization takes a seventh of the time that calling a kernel for it would.

    Takes a station or more and as many realizations of each; hourly rates from 0 up that hold from before the start to the
    end, a pad or more, and spots and drones present from 0 up; `PadLoad`, `Network` and `Request` see to it.

    Parameters
    ----------
    keys : ndarray of uint64, shape (stations * realizations,)
        Of the deviates of each, see `models.jit.random_kernels`; those of the first station first.
    places : (pads, spots)
        Pads of each station, and holding spots beside them, shape (stations,) each.
    rates : (arrivals_per_s, services_per_s)
        Of each station by the hour, shape (stations, hours) each; the rates of the last hour hold afterwards.
    begins : (first_s, start_s)
        When the first hour of the rates and the realizations begin, POSIX seconds.
    end_s : ndarray, shape (stations * realizations,)
        Until when drones arrive in each.
    present : ndarray of int, shape (stations * realizations,)
        Others at the start in each, those beyond the pads in line.
    known : (known_s, count)
        When the first of the busy pads of each station become free, POSIX seconds, ascending, shape (stations, most), and how many of
        a row are known, shape (stations,); a pad with a past time is free at the start.

    Returns
    -------
    offset, arrival_s, pad_s, land_s, present, left_offset, left_s
        Of `PackedPaths`.
    """
    count, of_each = len(keys), len(keys) // len(places[0])
    size = _ROOM + places[0].max()
    room = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    packed, left = np.empty((3, 64 * count)), np.empty(64 * count)
    offset, left_offset = np.zeros(count + 1, dtype=np.int64), np.zeros(count + 1, dtype=np.int64)
    at_start = np.zeros(count, dtype=np.int64)
    free = np.empty(places[0].max())
    for i in range(count):
        place = i // of_each
        pads, spots = places[0][place], places[1][place]
        station = rates[0][place], rates[1][place]
        known_s = known[0][place, : known[1][place]]
        times = begins[0], begins[1], end_s[i]
        of_all, waiting, at_start[i], later = _live(
            keys[i], pads, station, times, present[i], known_s, free[:pads], room
        )
        while of_all < 0:  # once more, the same with more room
            size = 2 * size
            room = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
            of_all, waiting, at_start[i], later = _live(
                keys[i], pads, station, times, present[i], known_s, free[:pads], room
            )
        came, began, ready, gone = room
        # The path begins behind those present at the start; its first entry holds for arrivals before all others.
        low = offset[i]
        entries = of_all + 1 - waiting
        if low + entries > packed.shape[1]:
            wider = np.empty((3, 2 * (low + entries)))
            wider[:, :low] = packed[:, :low]
            packed = wider
        packed[0, low] = -np.inf
        for k in range(entries):
            if k > 0:
                packed[0, low + k] = came[waiting + k - 1]
            packed[1, low + k] = ready[waiting + k]
            # It may stand on a holding spot once the drone that is `spots` places ahead in the line has its pad.
            before = waiting + k - spots
            packed[2, low + k] = ready[waiting + k]
            if spots > 0:
                packed[2, low + k] = min(ready[waiting + k], began[before]) if before >= 0 else -np.inf
        departures = left_offset[i]
        if departures + later > len(left):
            longer = np.empty(2 * (departures + later))
            longer[:departures] = left[:departures]
            left = longer
        for k in range(later):
            left[departures + k] = gone[k]
        offset[i + 1], left_offset[i + 1] = low + entries, departures + later
    low = offset[count]
    return (
        offset,
        packed[0, :low].copy(),
        packed[1, :low].copy(),
        packed[2, :low].copy(),
        at_start,
        left_offset,
        left[: left_offset[count]].copy(),
    )
