"""Sampled queues: realizations of the other drones at a station over a horizon.

The other drones follow the model of `models.queues.waiting_times`: Poisson arrivals, a charging drone leaves at a rate
1 / mean charging time, both by the hour. Our drone does not affect them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.jit.random_kernels import numbers
from skyway.models.queues.paths import PackedPaths, QueuePath, no_queue, pack
from skyway.models.queues.sampling_kernels import lived_sets
from skyway.models.queues.waiting_times import STEP_S, TAIL_H, WaitForecast, present_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.load import PadLoad

    Floats: TypeAlias = NDArray[np.float64]
    Integers: TypeAlias = NDArray[np.int64]


WAIT_PATHS, WAIT_SEED = 100, 0x57


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
    until_s: float = math.inf,
) -> list[dict[int, QueuePath]]:
    """Sample a set of paths, one for each of several stations, for each of several seeds.

    The deviates of each station are functions of the seed and its index, so that it gets the same
    path whichever other stations are requested. If the pads were not seen, the path begins with a number of drones
    drawn from the distribution of `models.queues.waiting_times.settled`.

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
        When busy pads of a node become free, POSIX seconds, as far as known; the others by the rates.
    until_s : float
        Paths simulated only until then, POSIX seconds, agree with longer ones up to then.

    Returns
    -------
    list of dict of int to QueuePath
        For each seed, by node.
    """
    with_pads = [station for station in dict.fromkeys(stations) if pads[station]]
    if not with_pads:
        return [dict.fromkeys(stations, no_queue()) for _ in seeds]
    nobody_saw = [station for station in with_pads if station not in busy]
    shares = dict(zip(nobody_saw, present_at(load, nobody_saw, pads[nobody_saw].tolist(), start_s), strict=True))
    keys, uniform = _drawn(seeds, np.array(with_pads))
    present = np.empty(keys.shape, dtype=np.int64)
    for number, station in enumerate(with_pads):
        share = shares.get(station)
        present[number] = (
            busy[station] if share is None else np.searchsorted(share, uniform[number] * share[-1], side="right")
        )
    places = with_pads, pads[with_pads], holding_spots[with_pads]
    found = _lived(keys.ravel(), load, places, (start_s, hours), until_s, present.ravel(), free_s or {})
    place = {station: number * len(seeds) for number, station in enumerate(with_pads)}
    return [
        {station: found[place[station] + one] if station in place else no_queue() for station in stations}
        for one in range(len(seeds))
    ]


def _drawn(seeds: Sequence[int | Sequence[int]], stations: Integers) -> tuple[NDArray[np.uint64], Floats]:
    """Return a key and a uniform deviate in (0, 1) for each station and seed, shape (stations, seeds) each.

    Whichever other stations there are: both are functions of seed and station.
    """
    bits = np.empty((2, len(stations), len(seeds)), dtype=np.uint64)
    for column, seed in enumerate(seeds):
        (key,) = np.random.SeedSequence(seed).generate_state(1, np.uint64)
        for which in range(2):
            bits[which, :, column] = numbers(key, 2 * stations + which)
    return bits[0], ((bits[1] >> np.uint64(11)) + 0.5) / 2.0**53


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

    The exact forecast (`models.queues.waiting_times.forecast_waits`) covers only memoryless stays. Arguments as of `sample_sets`.
    """
    grid = start_s + STEP_S * np.arange(math.ceil(hours * S_PER_H / STEP_S) + 1)
    seeds = [(WAIT_SEED, number) for number in range(WAIT_PATHS)]
    sets = sample_sets(load, pads, np.zeros_like(pads), stations, start_s, hours, seeds, busy, free_s)
    found = {}
    for station in stations:
        waits = np.array([paths[station].pad_time(grid) for paths in sets]) - grid
        found[station] = WaitForecast(waits.mean(axis=0), (waits <= 0.0).mean(axis=0))
    return found


def sample_many(
    load: PadLoad,
    pads: int,
    spots: int,
    station: int,
    start_s: float,
    hours: float,
    seed: Sequence[int],
    count: int,
    busy: int | None,
    free_s: Sequence[float] = (),
    until_s: float | Floats = math.inf,
) -> PackedPaths:
    """Sample many paths of one station at once, from a separate stream seeded by the seed and its index.

    Arguments as of `sample_sets`, which samples paths that are named one by one; here the `count` paths depend on each other: if
    the pads were not seen (`busy` is None), the numbers of drones that they begin with are stratified over the
    probabilities. So a part of a set cannot be sampled separately.

    Paths simulated only until `until_s`, POSIX seconds, of all or of each, shape (count,), agree with longer ones up to then.
    """
    if not pads:
        return pack([no_queue()] * count)
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(station,))))
    present = np.full(count, busy or 0)
    if busy is None:
        (share,) = present_at(load, [station], [pads], start_s)
        evenly = (rng.permutation(count) + rng.random(count)) / count
        present = np.searchsorted(share, evenly * share[-1], side="right").astype(np.int64)
    keys = rng.integers(0, 2**64, count, dtype=np.uint64)
    places = [station], np.array([pads]), np.array([spots])
    return _lived(keys, load, places, (start_s, hours), until_s, present, {station: free_s})


def _lived(
    keys: NDArray[np.uint64],
    load: PadLoad,
    places: tuple[Sequence[int], Integers, Integers],
    horizon: tuple[float, float],
    until_s: float | Floats,
    present: Integers,
    free_s: Mapping[int, Sequence[float]],
) -> PackedPaths:
    """Simulate as many paths of each of some stations (`models.queues.sampling_kernels.lived_sets`).

    `places` are the stations with pads and holding spots of each, `horizon` its beginning, POSIX seconds, and its hours.
    """
    stations, pads, spots = places
    start_s, hours = horizon
    first_s = math.floor(start_s / S_PER_H) * S_PER_H
    end_s = np.broadcast_to(np.clip(until_s, start_s, start_s + hours * S_PER_H), len(keys)).astype(np.float64)
    arrivals, charging = load.hourly(np.array(stations)[:, None], first_s, math.ceil(hours) + 1 + TAIL_H)
    known = [sorted(free_s.get(station, ())) for station in stations]
    count = np.array([len(one) for one in known])
    known_s = np.zeros((len(stations), count.max()))
    for row, one in zip(known_s, known, strict=True):
        row[: len(one)] = one
    offset, arrival, pad, land, at_start, left_offset, left = lived_sets(
        keys, (pads, spots), (arrivals, 1.0 / charging), (first_s, start_s), end_s, present, (known_s, count)
    )
    return PackedPaths(offset, arrival, pad, land, np.zeros(len(pad)), at_start, left_offset, left)
