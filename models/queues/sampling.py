"""Sampled queues: realizations of the other drones at a station over a horizon.

The other drones follow the model of `models.queues.waiting_times`: Poisson arrivals, a charging drone leaves at a rate
1 / mean charging time, both by the hour. Our drone does not affect them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.queues.paths import PackedPaths, QueuePath, no_queue, pack
from skyway.models.queues.sampling_kernels import lived, lived_sets
from skyway.models.queues.waiting_times import STEP_S, TAIL_H, WaitForecast, present_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.load import PadLoad

    Floats: TypeAlias = NDArray[np.float64]


NOTHING_KNOWN = np.empty(0)
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
) -> list[dict[int, QueuePath]]:
    """Sample a set of paths, one for each of several stations, for each of several seeds.

    Each station draws from a stream of its own, made from the seed and its index, so that it gets the same
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

    Returns
    -------
    list of dict of int to QueuePath
        For each seed, by node.
    """
    first_s = math.floor(start_s / S_PER_H) * S_PER_H
    times = first_s, start_s, start_s + hours * S_PER_H
    result: list[dict[int, QueuePath]] = [{} for _ in seeds]
    nobody_saw = [station for station in stations if station not in busy and pads[station]]
    found = present_at(load, nobody_saw, [int(pads[station]) for station in nobody_saw], start_s)
    shares = dict(zip(nobody_saw, found, strict=True))
    for station in stations:
        arrivals, charging = load.hourly(station, first_s, math.ceil(hours) + 1 + TAIL_H)
        count, spots, rates = int(pads[station]), int(holding_spots[station]), (arrivals, 1.0 / charging)
        known = np.sort(np.array((free_s or {}).get(station, ()), dtype=np.float64))
        share = shares.get(station)
        for paths, seed in zip(result, seeds, strict=True):
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(station,))))
            present = busy.get(station, 0)
            if share is not None:
                present = int(np.searchsorted(share, rng.random() * share[-1], side="right"))
            paths[station] = sample_path(rng, count, spots, rates, times, present, known) if count else no_queue()
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
    first_s = math.floor(start_s / S_PER_H) * S_PER_H
    end_s = np.broadcast_to(np.clip(until_s, start_s, start_s + hours * S_PER_H), count).astype(np.float64)
    arrivals, charging = load.hourly(station, first_s, math.ceil(hours) + 1 + TAIL_H)
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(station,))))
    present = np.full(count, busy or 0)
    if busy is None:
        (share,) = present_at(load, [station], [pads], start_s)
        evenly = (rng.permutation(count) + rng.random(count)) / count
        present = np.searchsorted(share, evenly * share[-1], side="right").astype(np.int64)
    known = np.sort(np.array(free_s, dtype=np.float64))
    keys = rng.integers(0, 2**64, count, dtype=np.uint64)
    offset, arrival, pad, land, at_start, left_offset, left = lived_sets(
        keys, pads, spots, (arrivals, 1.0 / charging), (first_s, start_s), end_s, present, known
    )
    return PackedPaths(offset, arrival, pad, land, np.zeros(len(pad)), at_start, left_offset, left)


def sample_path(
    rng: np.random.Generator,
    pads: int,
    spots: int,
    rates: tuple[NDArray[np.float64], NDArray[np.float64]],
    times: tuple[float, float, float],
    present: int,
    known_s: NDArray[np.float64] = NOTHING_KNOWN,
) -> QueuePath:
    """Sample the other drones at one station; `rates`, `times`, `present` and `known_s` are those of `lived`."""
    key = rng.integers(0, 2**64, dtype=np.uint64)
    came, pad_s, land_s, at_start, later = lived(key, pads, spots, rates, times, present, known_s)
    return QueuePath(came, pad_s, land_s, present=at_start, left_s=later)
