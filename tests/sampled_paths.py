"""One sampled queue of one station, drawn from a generator of random numbers."""

import numpy as np

from skyway.models.queues.paths import PackedPaths, QueuePath
from skyway.models.queues.sampling_kernels import lived_sets


def sample_path(
    rng: np.random.Generator,
    pads: int,
    spots: int,
    rates: tuple[np.ndarray, np.ndarray],
    times: tuple[float, float, float],
    present: int,
    known_s: np.ndarray | None = None,
) -> QueuePath:
    """The other drones of a station with hourly rates (arrivals, services); `times` are those of the first hour, the start and the end."""
    known = np.empty(0) if known_s is None else known_s
    found = lived_sets(
        rng.integers(0, 2**64, 1, dtype=np.uint64),
        (np.array([pads]), np.array([spots])),
        (rates[0][None], rates[1][None]),
        times[:2],
        np.array(times[2:]),
        np.array([present]),
        (known[None], np.array([len(known)])),
    )
    offset, arrival_s, pad_s, land_s, at_start, left_offset, left_s = found
    return PackedPaths(offset, arrival_s, pad_s, land_s, np.zeros(len(pad_s)), at_start, left_offset, left_s)[0]
