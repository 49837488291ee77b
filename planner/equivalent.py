"""One world that stands for a forecast: what the robust planner composes a route in.

Each segment is flown at the speed whose flight time is the mean of the members' that can fly it, each station has its
expected wait, and a landing keeps, beyond the reserve, a margin for each second of flight. The mean of functions that
are first in, first out is one again, so that the exact planner's proofs hold in this world as well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.compiled import compiled
from models.flight_kernels import segment_speed
from models.queue_paths import QueuePath, expected_path, no_queue

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.flight import Air
    from planner.problem import Problem

LEAST_OPEN = 0.5
"""A segment is open in a slot where members of at least this probability can fly it."""


@compiled
def _mean_speeds(air: Air, probability: NDArray[np.float64], slots: int) -> NDArray[np.float64]:
    out = np.zeros((slots, len(air.distance_m)))
    for slot in range(slots):
        for segment in range(len(air.distance_m)):
            share, pace = 0.0, 0.0
            for member in range(len(probability)):
                speed = segment_speed(air, member, slot, segment)
                if speed > 0.0:
                    share += probability[member]
                    pace += probability[member] / speed
            if share >= LEAST_OPEN:
                out[slot, segment] = share / pace
    return out


def mean_speeds(air: Air, probability: NDArray[np.float64], hours: float) -> NDArray[np.float64]:
    """Ground speed of each segment in each slot whose time is the mean of those members that can fly it.

    Parameters
    ----------
    air, probability
        The forecast.
    hours : float
        From here on the last slot's speeds hold on.

    Returns
    -------
    ndarray, shape (slots, segments)
        m/s; 0 where members of less than `LEAST_OPEN` can fly.
    """
    slots = air.north.shape[1]
    count = min(int(np.ceil(hours * 3600.0 / air.slot_s)) + 1, slots)
    found = _mean_speeds(air, probability, count)
    return np.concatenate((found, np.repeat(found[-1:], slots - count, axis=0)))


def expected_queues(problem: Problem) -> dict[int, QueuePath]:
    """Expected wait at every station as a queue path."""
    waits = problem.waits
    waits.need(np.arange(len(problem.network)))
    return {
        node: expected_path(waits.start_s, waits.step_s, waits.wait_s[node]) if problem.has_pads(node) else no_queue()
        for node in range(len(problem.network))
    }
