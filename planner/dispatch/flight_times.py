"""Times of flights between places, and their charge: the same for plans of a fleet and for the worlds in which these are simulated.

A flight is in the air for climb, cruise, descent and the manoeuvres that every supervised flight takes beyond its segments (`manoeuvres_s` of the online
planner: acceleration, braking, the last metres of a landing). Before and after it the drone stands for `ground_s`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.problem.problem import Problem


def fixed_s(problem: Problem) -> float:
    """Return the time in the air beyond the segments, s: climb, descent and manoeuvres."""
    return float(problem.air.climb_s + problem.air.descent_s + problem.parameters.online.manoeuvres_s)


def air_times(problem: Problem, places: Sequence[int], speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the time in the air of flights without a landing, s, shape (slots, places, places), each on the way that is fastest in its slot.

    `speed_mps` has the ground speeds, shape (slots, segments), 0 where a segment cannot be flown.
    """
    found = np.empty((len(speed_mps), len(places), len(places)))
    for slot, speed in enumerate(speed_mps):
        if slot and np.array_equal(speed, speed_mps[slot - 1]):
            found[slot] = found[slot - 1]
            continue
        found[slot] = _fastest_s(problem, places, speed) + fixed_s(problem)
    diagonal = np.arange(len(places))
    found[:, diagonal, diagonal] = np.inf
    return found


def charge_of(problem: Problem, air_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the charge, as SoC, that the model gives for flights of some times in the air."""
    return np.asarray(problem.soc_fixed + problem.soc_per_s * air_s)


def shortest_m(problem: Problem, places: Sequence[int]) -> NDArray[np.float64]:
    """Return the lengths of the shortest ways between places, m, shape (places, places): their times at 1 m/s."""
    return _fastest_s(problem, places, np.ones(len(problem.air.distance_m)))


def _fastest_s(problem: Problem, places: Sequence[int], speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least times between places over segments with a speed above 0, s, shape (places, places)."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    network, size, nodes = problem.network, len(problem.network), np.array(places)
    open_ = speed_mps > 0.0
    time_s = problem.air.distance_m[open_] / speed_mps[open_]
    graph = csr_array((time_s, (network.tail[open_], network.head[open_])), shape=(size, size))
    return np.asarray(dijkstra(graph, indices=nodes)[:, nodes])
