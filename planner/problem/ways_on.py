"""Ways on from a target without pads: where the drone may land next, and over which segments it goes there.

It may land where it can charge, and from where it gets, charging on its way, to where it is to be in the end. That is judged by what
a full battery flies in still air; the way back itself is planned in the wind of its hour (`planner.way_back`).
"""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.planner.problem.request import BACK, HOME, NEAREST_PAD, NO_RETURN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.planner.problem.problem import Problem


def return_node(problem: Problem) -> int | None:
    """Node where the drone is to be after the delivery; None where any pad will do, or it stays.

    Raises an `InputError` if there is no such station, if it cannot charge there, if it cannot stay, or if where it began is unknown.
    """
    asked = problem.request.return_to
    if asked == NO_RETURN and problem.needs_escape:
        name = problem.network.stations[problem.destination].id
        remedy = f"{NEAREST_PAD}, {HOME} or a station: the drone cannot stay {'there' if problem.request.in_air else 'in the street'}"
        raise InputError(
            Fault(
                f"{name}, {problem.why_on}" if problem.request.in_air else f"{name} has no pads",
                field="return_to",
                value=asked,
                remedy=remedy,
            )
        )
    if asked in (NO_RETURN, NEAREST_PAD):
        return None
    return _origin(problem, asked, "return_to") if asked == HOME else _station(problem, asked, "return_to")


def undelivered_node(problem: Problem) -> int | None:
    """Node that receives a package that could not be delivered; None where none was requested.

    Raises an `InputError` as `return_node` does.
    """
    asked = problem.request.undelivered_to
    if asked is None:
        return None
    return _origin(problem, asked, "undelivered_to") if asked == BACK else _station(problem, asked, "undelivered_to")


def _origin(problem: Problem, name: str, field: str) -> int:
    """Node where the delivery began; a request that begins in the air does not tell."""
    if problem.request.state.position is not None:
        remedy = "the name of a station"
        raise InputError(Fault("is unknown: the drone is in the air", field=field, value=name, remedy=remedy))
    return problem.origin


def _station(problem: Problem, name: str, field: str) -> int:
    node = problem.network.index.get(name)
    if node is None:
        raise InputError(Fault("no such station", field=field, value=name))
    if node == problem.destination and problem.needs_escape:
        remedy = f"{NEAREST_PAD}, {HOME} or a station"
        raise InputError(Fault(f"is the target, {problem.why_on}", field=field, value=name, remedy=remedy))
    if node != problem.origin and not problem.has_pads(node):
        raise InputError(Fault("has no pads", field=field, value=name, remedy="a station with pads"))
    return node


def ways_on(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """Flights on from the destination: the segments of the shortest way to each station that it may land at.

    Other stations are flown over; those with a way of their own are not.
    """
    network, allowed = problem.network, landings(problem)
    found: list[tuple[int, ...]] = []
    before: dict[int, int] = {}
    done: set[int] = set()
    heap = [(0.0, problem.destination, -1)]
    most_m = flight_range_m(problem)
    while heap:
        distance, node, segment = heapq.heappop(heap)
        if node in done or distance > most_m:
            continue
        done.add(node)
        before[node] = segment
        if allowed[node]:
            found.append(_way(network, before, node))
            continue
        for out in range(int(network.first[node]), int(network.first[node + 1])):
            head = int(network.head[out])
            if head not in done:
                heapq.heappush(heap, (distance + float(network.distance_m[out]), head, out))
    return tuple(found)


def _way(network: Network, before: dict[int, int], node: int) -> tuple[int, ...]:
    way: list[int] = []
    while (segment := before[node]) >= 0:
        way.append(segment)
        node = int(network.tail[segment])
    return tuple(reversed(way))


def landings(problem: Problem) -> NDArray[np.bool_]:
    """Allowed landing stations after the destination, shape (nodes,).

    With `NEAREST_PAD`, where no station leaves it useful, that is any station with pads.
    """
    network = problem.network
    pads: NDArray[np.bool_] = network.pads > 0
    pads[problem.destination] = False
    back, undelivered = return_node(problem), undelivered_node(problem)
    free = back is None
    if free and problem.in_flight:
        back = None  # where it came from is unknown any more
    elif free:
        back = problem.origin
    useful = pads.copy()
    for goal in {back, undelivered} - {None, problem.destination}:
        useful &= _leading_to(problem, int(goal or 0), pads)
    if free and undelivered is None and not useful.any():
        useful = pads
    for name in problem.request.not_back_by:
        useful[network.index[name]] = False
    return useful


def flight_range_m(problem: Problem) -> float:
    """Range of a full battery in still air, from take-off to touch-down on the reserve, m."""
    per_s, fixed = problem.onward_cost
    cruise_s = (1.0 - problem.reserve - fixed) / per_s - problem.rules.climb_s - problem.rules.descent_s
    return max(cruise_s, 0.0) * problem.air.airspeed_mps


def _leading_to(problem: Problem, goal: int, pads: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Stations from which flights of a full battery, with charging between them, lead to a goal, itself included."""
    from scipy.sparse import csr_array  # imported late: most plans need none of it
    from scipy.sparse.csgraph import dijkstra

    network, most_m = problem.network, flight_range_m(problem)
    count = len(network)
    back = csr_array((np.maximum(network.distance_m, 1e-3), (network.head, network.tail)), shape=(count, count))
    found = np.zeros(count, dtype=bool)
    found[goal] = True
    fresh = np.array([goal])
    while len(fresh):
        away_m = dijkstra(back, indices=fresh, min_only=True, limit=most_m if math.isfinite(most_m) else np.inf)
        new = pads & np.isfinite(away_m) & ~found
        found |= new
        fresh = np.flatnonzero(new)
    return found
