"""Free capacity of stations: blocking probabilities, and the required probability of a free place before take-off.

A drone that finds all pads and holding spots taken hovers on its reserve. The pads and the queue of the next station are
known before a take-off (from the pad service), so that a flight starts only when the probability that the station is full
at its end is small.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.units import S_PER_H
from skyway.models.queues.load import hours_of_week
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.robust.free_capacity_kernels import FreeCapacity, chance_full, chances, expected

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.load import PadLoad
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.problem import Problem


def _begin_s(problem: Problem) -> float:
    """Beginning of the hour of the departure, POSIX seconds: rates are those of hours of UTC."""
    return problem.depart_s - problem.depart_s % S_PER_H


def _rates(problem: Problem, nodes: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Arrivals, and departures from a busy pad, per s in each hour from that of the departure on, shape (nodes, hours)."""
    load = problem.load
    at = np.ix_(np.asarray(nodes, dtype=np.int64), hours_of_week(load.timezone, problem.depart_s, HORIZON_H))
    return np.ascontiguousarray(load.arrivals_per_s[at]), _services(load.mean_charging_s[at])


def room_at(problem: Problem, nodes: Sequence[int], most: float) -> FreeCapacity:
    """Return the free capacity at the stations at the end of each leg, checked before it; stations without pads always have a free place."""
    at = np.asarray(nodes, dtype=np.int64)
    stations = [problem.network.stations[node] for node in at]
    spots = np.array([one.holding_spots if one.pads else 1 for one in stations], dtype=np.int64)
    pads = problem.network.pads[at].astype(np.int64)
    arrivals, services = _rates(problem, nodes)
    arrivals[pads == 0] = 0.0  # a load given for all stations does not apply to those without pads
    return FreeCapacity(pads, spots, _begin_s(problem), arrivals, services, most)


def blocking_probabilities(problem: Problem) -> NDArray[np.float64]:
    """Return the probability that each station is full after a flight of usual length that begins with one pad free there, shape (nodes,).

    The maximum over the hours from the earliest arrival on (`RobustParameters.busy_hours`).
    """
    network, parameters = problem.network, problem.parameters.robust
    origin = network.lat[problem.origin], network.lon[problem.origin]
    least_s = geodesy.coarse_distance_m(*origin, network.lat, network.lon) / problem.air.max_ground_speed_mps
    first = ((problem.depart_s - _begin_s(problem) + least_s) // S_PER_H).astype(np.int64)
    arrivals, services = _rates(problem, range(len(network)))
    hours = np.minimum(first[:, None] + np.arange(parameters.busy_hours), HORIZON_H - 1)
    busiest = parameters.usual_flight_s * np.take_along_axis(arrivals, hours, axis=1).max(axis=1)
    slowest = parameters.usual_flight_s * np.take_along_axis(services, hours, axis=1).min(axis=1)
    pads = network.pads.astype(np.int64)
    spots = np.array([station.holding_spots for station in network.stations], dtype=np.int64)
    return np.where(pads > 0, chances(pads, spots, busiest, slowest, pads - 1), 0.0)


def likely_free(problem: Problem, most: float, flight_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where a drone finds a place to land in all but a share of the cases, shape (nodes,).

    From the reported drones at each station and the time of the flight there, `flight_s`, shape (nodes,); without a
    report, from one free pad.
    """
    arrivals, services = _rates(problem, range(len(problem.network)))
    begin_s = problem.depart_s - _begin_s(problem)
    found = np.zeros(len(problem.network), dtype=bool)
    for node, one in enumerate(problem.network.stations):
        if one.pads:
            end_s = begin_s + flight_s[node]
            seen = problem.busy.get(node, one.pads - 1)
            come, gone = expected(arrivals[node], begin_s, end_s), expected(services[node], begin_s, end_s)
            found[node] = chance_full(one.pads, one.holding_spots, come, gone, seen) <= most
    found[problem.destination] = True
    return found


def no_place_probability(
    scenario: Scenario, node: int, present: int, now_s: float, lands_s: float, hover_s: float
) -> float:
    """Probability that an arriving drone finds no place to land within its hover time, given how many others are present now.

    Arrivals before it occupy places, later ones do not; departures until then free places. Times are POSIX seconds.
    """
    station, load = scenario.network.stations[node], scenario.load
    lands_s = max(lands_s, now_s)
    come, _ = _come_and_gone(load, node, now_s, lands_s)
    _, gone = _come_and_gone(load, node, now_s, lands_s + max(hover_s, 0.0))
    return float(chance_full(station.pads, station.holding_spots, come, gone, present))


def turned_for_room_probability(
    scenario: Scenario,
    node: int,
    present: int,
    now_s: float,
    leaves_s: float,
    lands_s: float,
    hover_s: float,
    most: float,
) -> float:
    """Return the probability that a flight to a station is turned halfway, because by then the probability of no place exceeds `most`.

    From the number of others at the station now; it takes off later. Otherwise as `no_place_probability`.
    """
    station, load = scenario.network.stations[node], scenario.load
    half_s = 0.5 * (leaves_s + lands_s)
    come, _ = _come_and_gone(load, node, half_s, lands_s)
    _, gone = _come_and_gone(load, node, half_s, lands_s + hover_s)
    turned_by = (
        count
        for count in range(station.pads + station.holding_spots + 1)
        if chance_full(station.pads, station.holding_spots, come, gone, count) > most
    )
    least = next(turned_by, None)
    if least is None:
        return 0.0
    come, gone = _come_and_gone(load, node, now_s, half_s)
    return float(chance_full(station.pads, least - station.pads, come, gone, present))


def _come_and_gone(load: PadLoad, node: int, begin_s: float, end_s: float) -> tuple[float, float]:
    """Return the expected numbers of arrivals at a station between two times, POSIX seconds, and of departures from one busy pad of it."""
    hour_s = begin_s - begin_s % S_PER_H
    arrivals, charging = load.hourly(node, begin_s, int((end_s - hour_s) // S_PER_H) + 1)
    return expected(arrivals, begin_s - hour_s, end_s - hour_s), expected(
        _services(charging), begin_s - hour_s, end_s - hour_s
    )


def _services(charging_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Departures from a busy pad, per s, from mean charging times."""
    return np.divide(1.0, charging_s, out=np.zeros_like(charging_s), where=charging_s > 0.0)


def blocking_probability_after(problem: Problem, after_s: float, *, behind: int) -> float:
    """Return the probability that the origin is full for a drone that leaves it and returns after a time.

    From the numbers of drones now before it, and `behind` it in the queue.
    """
    one = problem.network.stations[problem.origin]
    (arrivals,), (services,) = _rates(problem, [problem.origin])
    begin_s = problem.depart_s - _begin_s(problem)
    come, gone = (expected(rate, begin_s, begin_s + after_s) for rate in (arrivals, services))
    seen = problem.busy.get(problem.origin, one.pads - 1) + behind
    return float(chance_full(one.pads, one.holding_spots, come, gone, seen))
