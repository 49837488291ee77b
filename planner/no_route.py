"""Why there is no route: the constraint that binds, said with its figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.errors import NoRouteError
from models.units import S_PER_MIN

if TYPE_CHECKING:
    from planner.outlook import Outlook
    from planner.problem import Problem


def _connected(problem: Problem, usable: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> set[int]:
    """Nodes that the origin is joined to over usable segments."""
    network = problem.network
    found, queue = {problem.origin}, [problem.origin]
    while queue:
        node = queue.pop()
        for segment in range(int(network.first[node]), int(network.first[node + 1])):
            other = int(network.head[segment])
            if usable[segment] and other not in found:
                found.add(other)
                queue.append(other)
    return found


def no_route(problem: Problem, outlook: Outlook) -> NoRouteError:
    """Explain a failed search: disconnected, energy on the decisive segment, or wind.

    The decisive segment is the one that asks least among those that lead out of what can be reached.
    """
    network = problem.network
    start = network.stations[problem.origin].id
    goal = network.stations[problem.destination].id
    every = np.ones(len(network.tail), dtype=bool)
    if problem.destination not in _connected(problem, every):
        message = f"no route from {start} to {goal}: no chain of segments joins them (the network is in parts)"
        return NoRouteError(message, constraint="disconnected")
    charge = np.array([outlook.flight(segment, problem.depart_s)[1] for segment in range(len(network.tail))])
    reached = _connected(problem, charge <= outlook.budget)
    if problem.destination in reached:
        message = (
            f"no route from {start} to {goal} within the forecast: each segment can be flown on a full battery now, "
            f"but not one after the other as wind, queues and charge ({100 * problem.soc:.0f} % now) develop"
        )
        return NoRouteError(message, constraint="energy")
    out = [i for i in range(len(charge)) if int(network.tail[i]) in reached and int(network.head[i]) not in reached]
    least = min(out, key=lambda i: (charge[i], network.distance_m[i]))
    a, b = network.stations[int(network.tail[least])].id, network.stations[int(network.head[least])].id
    where = f"segment {a} > {b} ({network.distance_m[least] / 1000:.1f} km)"
    if not math.isfinite(charge[least]):
        message = (
            f"no route from {start} to {goal}: the wind stays above the limits of {problem.drone.id} "
            f"({problem.drone.wind_limit_mps:g} m/s) on {where} throughout the forecast"
        )
        return NoRouteError(message, constraint="wind")
    escape = ""
    if int(network.head[least]) == problem.destination and problem.needs_escape:
        escape = " and on to a station with pads"
    message = (
        f"no route from {start} to {goal}: {where}{escape} takes {100 * charge[least]:.0f} % of the battery of "
        f"{problem.drone.id} in the worst forecast wind, {100 * outlook.budget:.0f} % are there above the reserve "
        f"of {100 * problem.reserve:.0f} % (longest flight {problem.longest_flight_s / S_PER_MIN:.0f} min)"
    )
    return NoRouteError(message, constraint="energy")
