"""Free capacity of stations: blocking probabilities, and how sure a drone must be of a place before take-off.

A drone that finds all pads and holding spots taken hovers on its reserve. The pads and the line of the next station are
known before a take-off (the pad service tells), so that a flight is begun only when the chance to find the station full
at its end is small.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.queues.load import hours_of_week
from skyway.planner.robust.free_capacity_kernels import FreeCapacity, Present, chance_full, chances

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.sampling import QueuePath
    from skyway.planner.problem.problem import Problem


def _rates(problem: Problem) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Greatest arrival rate and least rate of service of each node in the hours ahead, shape (nodes,)."""
    load = problem.load
    hours = hours_of_week(load.timezone, problem.depart_s, problem.parameters.robust.busy_hours)
    charging = load.mean_charging_s[:, hours].max(axis=1)
    busiest = load.arrivals_per_s[:, hours].max(axis=1)
    return busiest, np.divide(1.0, charging, out=np.zeros_like(charging), where=charging > 0.0)


def room_at(problem: Problem, nodes: Sequence[int], most: float) -> FreeCapacity:
    """Room of the stations at the end of each leg, to be looked at before it; where there are no pads is always room."""
    arrivals, services = _rates(problem)
    at = np.asarray(nodes, dtype=np.int64)
    stations = [problem.network.stations[node] for node in at]
    spots = np.array([one.holding_spots if one.pads else 1 for one in stations], dtype=np.int64)
    return FreeCapacity(problem.network.pads[at].astype(np.int64), spots, arrivals[at], services[at], most)


def present_in(paths: Sequence[QueuePath]) -> Present:
    """Lay out for kernels who is at the stations of queue paths."""
    offset = np.cumsum([0, *(len(path.left_s) for path in paths)]).astype(np.int64)
    at_start = np.array([path.present for path in paths], dtype=np.int64)
    return Present(at_start, offset, np.concatenate([np.empty(0), *(path.left_s for path in paths)]))


def blocking_probabilities(problem: Problem) -> NDArray[np.float64]:
    """Chance that each station is full after a flight of usual length that begins with one pad free there, shape (nodes,)."""
    flight_s = problem.parameters.robust.usual_flight_s
    arrivals, services = (rate * flight_s for rate in _rates(problem))
    pads = problem.network.pads.astype(np.int64)
    spots = np.array([station.holding_spots for station in problem.network.stations], dtype=np.int64)
    return np.where(pads > 0, chances(pads, spots, arrivals, services, pads - 1), 0.0)


def likely_free(problem: Problem, most: float, flight_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where a drone finds room to land in all but a share of what may come, shape (nodes,).

    From who is seen at each station now and the time of the flight there, `flight_s`, shape (nodes,); where nobody was
    seen, from one free pad.
    """
    arrivals, services = (rate * flight_s for rate in _rates(problem))
    found = np.zeros(len(problem.network), dtype=bool)
    for node, one in enumerate(problem.network.stations):
        if one.pads:
            seen = problem.busy.get(node, one.pads - 1)
            found[node] = chance_full(one.pads, one.holding_spots, arrivals[node], services[node], seen) <= most
    found[problem.destination] = True
    return found


def blocking_probability_after(problem: Problem, after_s: float, *, behind: int) -> float:
    """Chance that the origin is full for a drone that leaves it and is back after a time.

    From who is seen there before the drone now, and `behind` it in the line.
    """
    one = problem.network.stations[problem.origin]
    arrivals, services = (float(rate[problem.origin]) * after_s for rate in _rates(problem))
    seen = problem.busy.get(problem.origin, one.pads - 1) + behind
    return float(chance_full(one.pads, one.holding_spots, arrivals, services, seen))
