"""Random small instances of the first set."""

from __future__ import annotations

import numpy as np

from benchmarks.fleet.evrp.evrptw import Instance


def random_instance(seed: int, *, customers: int, stations: int) -> Instance:
    """Return an instance in which a vehicle can serve each customer alone: the battery suffices for the round trip.

    Some windows are narrow, some wide, and charging is fast or slow.
    """
    random = np.random.default_rng(seed)
    place = random.uniform(0.0, 100.0, (1 + stations + customers, 2))
    place[1] = place[0] = 50.0
    kind = ("d", *"f" * stations, *"c" * customers)
    ids = tuple(f"{one.upper()}{number}" for number, one in enumerate(kind))
    battery, pace = float(random.uniform(145.0, 170.0)), float(random.choice([0.2, 1.0, 3.0]))
    horizon = float(random.choice([700.0, 1400.0]))
    count = len(kind)
    served = np.array([one == "c" for one in kind])
    far = np.hypot(*(place - place[0]).T)
    earliest = far + random.uniform(0.0, 0.5, count) * (horizon - 4.0 * far - 2.0 * pace * battery).clip(0.0)
    ready = np.where(served, earliest, 0.0)
    width = pace * battery + random.uniform(10.0, 0.4 * horizon, count)
    due = np.where(served, ready + width, horizon + 3.0 * pace * battery)
    return Instance(
        f"random {seed}", ids, kind, place, np.where(served, random.integers(5, 30, count), 0).astype(float), ready, due,
        np.where(served, 10.0, 0.0), battery, 90.0, 1.0, pace, 1.0,
    )  # fmt: skip
