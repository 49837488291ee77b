"""Kernels that sample a queue: the other drones at a station arrive, wait, charge and leave, one realization after another."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]
    Integers: TypeAlias = NDArray[np.int64]


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


@compiled
def lived(
    draws: Floats,
    pads: int,
    spots: int,
    rates: tuple[Floats, Floats],
    times: tuple[float, float, float],
    present: int,
    known_s: Floats,
) -> tuple[Floats, Floats, Floats, int, Floats, bool]:
    """Serve the drones present at first and all that arrive until the end, first come, first served.

    For the i-th of them: it arrives at a_i, the next event after a_(i-1) of a Poisson process with the arrival rate; it
    gets the pad that is free first, at b_i = max(a_i, f), and leaves it at the next event after b_i with the service
    rate, which is the pad's new f. `models.queues.paths.QueuePath` is what a drone meets behind the first 0, 1, 2, ... of those that come
    after the start.

    Takes finite deviates from 0 up, hourly rates from 0 up that hold from before the start to the end, a pad or more, and
    spots and drones present from 0 up; `PadLoad`, `Network` and `Request` see to it.

    Parameters
    ----------
    draws : ndarray, shape (deviates,)
        Standard exponential deviates, used in order.
    pads, spots : int
        Pads, and holding spots beside them.
    rates : (arrivals_per_s, services_per_s)
        By the hour; the rates of the last hour hold afterwards.
    times : (first_s, start_s, end_s)
        When the first hour of the rates begins, and the horizon, POSIX seconds.
    present : int
        Others at the start, those beyond the pads in line.
    known_s : ndarray, shape (known,)
        When the first of the busy pads become free, POSIX seconds, ascending; a pad with a past time is free at the start.

    Returns
    -------
    arrival_s, pad_s, land_s, present, left_s
        Of a `models.queues.paths.QueuePath`.
    enough : bool
        Whether there were as many draws as it took; without them the others say nothing.
    """
    arrivals, services = rates
    first_s, start_s, end_s = times
    size = len(draws)
    came, began, ready, left = np.empty(size), np.empty(size), np.empty(size + 1), np.empty(size + pads)
    free = np.full(pads, -np.inf)
    now, waiting, used = start_s, max(present - pads, 0), 0
    # Drones present at the start: on pads, for known or sampled times, and the rest in line.
    for pad in range(min(present, pads)):
        free[pad] = (
            max(known_s[pad], start_s) if pad < len(known_s) else _after(start_s, draws[used], services, first_s)
        )
        used += 1
    # Departures after the start, at first of the drones on pads then.
    later = 0
    for pad in range(pads):
        if free[pad] > start_s:
            left[later] = free[pad]
            later += 1
    at_start = later
    count = 0
    while True:
        # The pad that is free first: a drone of ours behind the first `count` others would get it then.
        earliest = np.argmin(free)
        ready[count] = free[earliest]
        if used + 2 > size:
            return came, ready, began, 0, left, False
        # The next arrival, once those that waited at the start are served; the path ends with the horizon.
        if count >= waiting:
            now = _after(now, draws[used], arrivals, first_s)
            used += 1
            if now > end_s:
                break
        # It gets its pad and leaves it.
        came[count], began[count] = now, max(now, free[earliest])
        free[earliest] = _after(began[count], draws[used], services, first_s)
        used += 1
        if free[earliest] > start_s:
            left[later] = free[earliest]
            later += 1
            if count < waiting:
                at_start += 1
        count += 1
    # The path begins behind those present at the start.
    pad_s = ready[waiting : count + 1].copy()
    land_s = pad_s.copy()
    # It may stand on a holding spot once the drone that is `spots` places ahead in the line has its pad.
    for k in range(len(land_s)):
        before = waiting + k - spots
        if spots > 0:
            land_s[k] = min(land_s[k], began[before]) if before >= 0 else -np.inf
    return came[waiting:count].copy(), pad_s, land_s, at_start, np.sort(left[:later]), True


@compiled
def lived_sets(
    draws: Floats,
    pads: int,
    spots: int,
    rates: tuple[Floats, Floats],
    times: tuple[float, float, float],
    present: Integers,
    known_s: Floats,
) -> tuple[Integers, Floats, Floats, Floats, Integers, Integers, Floats, bool]:
    """Serve many realizations of one station, each as `lived` does; packed as `models.queues.paths.PackedPaths`.

    One call for all: what is done for a realization takes a seventh of the time that calling a kernel for it would.

    Takes what `lived` takes.

    Parameters
    ----------
    draws : ndarray, shape (realizations, deviates)
        Standard exponential deviates of each.
    present : ndarray of int, shape (realizations,)
        Others at the start in each, those beyond the pads in line.
    pads, spots, rates, times, known_s
        The station, as there.

    Returns
    -------
    offset, arrival_s, pad_s, land_s, present, left_offset, left_s
        Of `PackedPaths`.
    enough : bool
        Whether there were as many draws as it took for each; without them the others say nothing.
    """
    count, size = draws.shape
    # A realization uses two draws for each drone that comes, and one for each that charges at first.
    most = count * (size // 2 + 2)
    arrival, pad, land = np.empty(most), np.empty(most), np.empty(most)
    left = np.empty(count * (size + pads))
    offset, left_offset = np.zeros(count + 1, dtype=np.int64), np.zeros(count + 1, dtype=np.int64)
    at_start = np.empty(count, dtype=np.int64)
    low = 0
    gone = 0
    enough = True
    for i in range(count):
        came, pad_s, land_s, begin, later, enough = lived(draws[i], pads, spots, rates, times, present[i], known_s)
        if not enough:
            break
        at_start[i] = begin
        # The first entry of a path holds for arrivals before all others.
        arrival[low] = -np.inf
        for k in range(len(came)):
            arrival[low + 1 + k] = came[k]
        for k in range(len(pad_s)):
            pad[low + k], land[low + k] = pad_s[k], land_s[k]
        low += len(pad_s)
        for k in range(len(later)):
            left[gone + k] = later[k]
        gone += len(later)
        offset[i + 1], left_offset[i + 1] = low, gone
    return (
        offset,
        arrival[:low].copy(),
        pad[:low].copy(),
        land[:low].copy(),
        at_start,
        left_offset,
        left[:gone].copy(),
        enough,
    )
