"""Sampled queues: one realization of the other drones at a station over a horizon.

Given the others, our drone joins the same line and is served first come, first served: when it arrives after
the first k of them it gets the pad that is free after k assignments. A path keeps these times for every k, so
that any time of arrival finds its answer and nobody overtakes. (Independent draws per arrival would let a
later arrival start earlier.) The others are what `models.queues.waiting_times` computes with: Poisson arrivals, a charging
drone leaves at a rate 1 / mean charging time, both by the hour. They do not notice our drone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.models.queues.waiting_times import STEP_S, TAIL_H, WaitForecast, present_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.queues.load import PadLoad

    Floats: TypeAlias = NDArray[np.float64]


NOTHING_KNOWN = np.empty(0)
WAIT_PATHS, WAIT_SEED = 100, 0x57


@dataclass(frozen=True, eq=False)
class QueuePath:
    """Queue that our drone meets at one station, for any time of arrival.

    Attributes
    ----------
    arrival_s : ndarray, shape (k,)
        When the others arrive, POSIX seconds, ascending.
    pad_s : ndarray, shape (k + 1,)
        Earliest time a pad is free for a drone behind the first 0, 1, … of them; nondecreasing, -inf is
        always.
    land_s : ndarray, shape (k + 1,)
        Earliest time it can touch down, on a pad or a holding spot; nondecreasing and never after `pad_s`.
    delay_s : ndarray, shape (k + 1,)
        It gets no pad sooner than this long after its own arrival, in the interval before the first, between the
        first and the second of them, …; 0 by default. With it a path tells of waits that are expected, not sampled.
        The pad's time must still be nondecreasing in the arrival.
    present : int
        Others on the pads and in line when the path begins.
    left_s : ndarray, shape (departures,)
        When others leave after that, ascending.
    """

    arrival_s: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    land_s: NDArray[np.float64]
    delay_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    present: int = 0
    left_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if self.delay_s.shape != self.pad_s.shape:
            object.__setattr__(self, "delay_s", np.broadcast_to(self.delay_s, self.pad_s.shape))

    def pad_time(self, arrival_s: ArrayLike) -> NDArray[np.float64]:
        """When our drone gets a pad if it arrives at POSIX seconds `arrival_s`; nondecreasing in it.

        An arrival at the very time of another drone's stands behind it. Before the start of the path the
        answer is that of a drone behind all who are there at the start.
        """
        arrival, interval = self._at(arrival_s)
        return np.maximum(arrival + self.delay_s[interval], self.pad_s[interval])

    def land_time(self, arrival_s: ArrayLike) -> NDArray[np.float64]:
        """When it can touch down if it arrives at POSIX seconds `arrival_s`; never after `pad_time`."""
        arrival, interval = self._at(arrival_s)
        return np.maximum(arrival, self.land_s[interval])

    def latest_arrival(self, land_by_s: float) -> float:
        """Latest arrival with which it touches down by a time; -inf where nobody does who arrives from now on."""
        served = int(np.searchsorted(self.land_s, land_by_s, side="right"))
        if served == 0:
            return -math.inf
        return min(land_by_s, float(self.arrival_s[served - 1])) if served <= len(self.arrival_s) else land_by_s

    def present_at(self, time_s: float) -> int:
        """Others on the pads and in line at a time, as one sees who looks."""
        came = int(np.searchsorted(self.arrival_s, time_s, side="right"))
        return self.present + came - int(np.searchsorted(self.left_s, time_s, side="right"))

    def _at(self, arrival_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        arrival = np.asarray(arrival_s, dtype=np.float64)
        return arrival, np.searchsorted(self.arrival_s, arrival, side="right")


def no_queue() -> QueuePath:
    """Return a path on which a pad is always free, as at a delivery target, where nobody recharges."""
    return QueuePath(np.empty(0), np.array([-math.inf]), np.array([-math.inf]))


def expected_paths(start_s: float, step_s: float, wait_s: NDArray[np.float64]) -> list[QueuePath]:
    """Make the paths of drones that wait as long as is expected at their arrival, at several stations.

    Parameters
    ----------
    start_s, step_s : float
        The grid, POSIX seconds and seconds.
    wait_s : ndarray, shape (stations, times)
        Expected waits of arrivals at `start_s`, `start_s` + `step_s`, …

    Returns
    -------
    list of QueuePath
        One a station. Within a step the wait is the mean of its two ends, before the grid and after it that of its
        first and last time. Where that would let a later arrival have its pad earlier, it gets it with the last one
        before it. Landing needs no wait.
    """
    stations, times = wait_s.shape
    arrival = np.asarray(start_s + step_s * np.arange(times), dtype=np.float64)
    delay = np.empty((stations, times + 1))
    delay[:, 0], delay[:, 1:-1], delay[:, -1] = wait_s[:, 0], 0.5 * (wait_s[:, 1:] + wait_s[:, :-1]), wait_s[:, -1]
    pad = np.full(delay.shape, -math.inf)
    pad[:, 1:] = np.maximum.accumulate(arrival + delay[:, :-1], axis=1)
    always = np.full(times + 1, -math.inf)
    return [QueuePath(arrival, pad[number], always, delay[number]) for number in range(stations)]


def sample_sets(
    load: PadLoad,
    pads: NDArray[np.int64],
    holding_spots: NDArray[np.int64],
    stations: Sequence[int],
    start_s: float,
    hours: float,
    seeds: Sequence[int | Sequence[int]],
    busy: Mapping[int, int],
    free_s: Mapping[int, Sequence[float]] | None = None,
) -> list[dict[int, QueuePath]]:
    """Sample a set of paths, one for each of several stations, for each of several seeds.

    Each station draws from a stream of its own, made from the seed and its index, so that it gets the same
    path whichever other stations are asked for. Where the pads were not seen, the path begins with a number of drones
    drawn as `models.queues.waiting_times.settled` says.

    Parameters
    ----------
    load : PadLoad
        Other drones.
    pads, holding_spots : ndarray of int, shape (nodes,)
        Of each station; without pads there is no queue, without holding spots a drone lands only on a free pad.
    stations : sequence of int
        Which nodes.
    start_s, hours : float
        The horizon, POSIX seconds and hours; nobody arrives after it.
    seeds : sequence of int or of sequence of int
        One a set, for example (seed, member).
    busy : mapping of int to int
        Drones present at `start_s`, by node, those beyond the pads in the line.
    free_s : mapping of int to sequence of float, optional
        When busy pads of a node become free, POSIX seconds, as far as that is known; the others by the rates.

    Returns
    -------
    list of dict of int to QueuePath
        For each seed, by node.
    """
    first_s = math.floor(start_s / S_PER_H) * S_PER_H
    times = first_s, start_s, start_s + hours * S_PER_H
    result: list[dict[int, QueuePath]] = [{} for _ in seeds]
    for station in stations:
        arrivals, charging = load.hourly(station, first_s, math.ceil(hours) + 1 + TAIL_H)
        count, spots, rates = int(pads[station]), int(holding_spots[station]), (arrivals, 1.0 / charging)
        known = np.sort(np.array((free_s or {}).get(station, ()), dtype=np.float64))
        share = None if station in busy or not count else present_at(load, station, count, start_s)
        for found, seed in zip(result, seeds, strict=True):
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(station,))))
            present = busy.get(station, 0)
            if share is not None:
                present = int(np.searchsorted(share, rng.random() * share[-1], side="right"))
            found[station] = sample_path(rng, count, spots, rates, times, present, known) if count else no_queue()
    return result


def sampled_waits(
    load: PadLoad,
    pads: NDArray[np.int64],
    stations: Sequence[int],
    start_s: float,
    hours: float,
    busy: Mapping[int, int],
    free_s: Mapping[int, Sequence[float]],
) -> dict[int, WaitForecast]:
    """Forecast the waits at stations where the end of some stays is known, as means over sampled paths.

    The exact forecast (`models.queues.waiting_times.forecast_waits`) knows of stays without memory only. Arguments as of `sample_sets`.
    """
    grid = start_s + STEP_S * np.arange(math.ceil(hours * S_PER_H / STEP_S) + 1)
    seeds = [(WAIT_SEED, number) for number in range(WAIT_PATHS)]
    sets = sample_sets(load, pads, np.zeros_like(pads), stations, start_s, hours, seeds, busy, free_s)
    found = {}
    for station in stations:
        waits = np.array([paths[station].pad_time(grid) for paths in sets]) - grid
        found[station] = WaitForecast(waits.mean(axis=0), (waits <= 0.0).mean(axis=0))
    return found


def pack(
    paths: Sequence[QueuePath],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Lay paths end to end for kernels.

    Returns
    -------
    offset : ndarray of int, shape (paths + 1,)
        Entries of path i are ``offset[i] : offset[i + 1]``, at least one.
    arrival_s, pad_s, land_s, delay_s : ndarray, shape (entries,)
        An entry's times hold for our arrivals from its `arrival_s` (-inf in the first entry of a path)
        until before the next one's.
    """
    offset = np.zeros(len(paths) + 1, dtype=np.int64)
    np.cumsum([len(path.pad_s) for path in paths], out=offset[1:])
    arrival, pad, land, delay = (np.empty(offset[-1]) for _ in range(4))
    for i, path in enumerate(paths):
        low, high = offset[i], offset[i + 1]
        arrival[low] = -math.inf
        arrival[low + 1 : high] = path.arrival_s
        pad[low:high] = path.pad_s
        land[low:high] = path.land_s
        delay[low:high] = path.delay_s
    return offset, arrival, pad, land, delay


def sample_path(
    rng: np.random.Generator,
    pads: int,
    spots: int,
    rates: tuple[NDArray[np.float64], NDArray[np.float64]],
    times: tuple[float, float, float],
    present: int,
    known_s: NDArray[np.float64] = NOTHING_KNOWN,
) -> QueuePath:
    """Sample the other drones at one station; `rates`, `times`, `present` and `known_s` are those of `_lived`."""
    first_s, _, end_s = times
    expected = present + float(rates[0].max()) * (end_s - first_s)
    draws = rng.standard_exponential(pads + 2 * (16 + int(1.2 * expected)))
    while True:
        came, pad_s, land_s, at_start, later, enough = _lived(draws, pads, spots, rates, times, present, known_s)
        if enough:
            return QueuePath(came, pad_s, land_s, present=at_start, left_s=later)
        draws = np.concatenate((draws, rng.standard_exponential(len(draws))))


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
def _lived(
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
    rate, which is the pad's new f. `QueuePath` is what a drone meets behind the first 0, 1, 2, ... of those that come
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
        By the hour; after the last hour its rates go on.
    times : (first_s, start_s, end_s)
        When the first hour of the rates begins, and the horizon, POSIX seconds.
    present : int
        Others at the start, those beyond the pads in line.
    known_s : ndarray, shape (known,)
        When the first so many of the busy pads become free, POSIX seconds, ascending; one that is past is free at the start.

    Returns
    -------
    arrival_s, pad_s, land_s, present, left_s
        Of a `QueuePath`.
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
