"""One entry to the search for tours: `solve`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.planner.tours.partition import Jobs, partition
from skyway.planner.tours.search import Search

if TYPE_CHECKING:
    from skyway.planner.parameters.tours import ToursParameters
    from skyway.planner.tours.problem import Tours

CHOICES = 8
"""Number of selections of routes if those selected are not jointly feasible."""
FEWER = 0.02
"""Temperature while the number of vehicles is reduced, in mean tours with one customer."""
BUILT = 2000
"""Iterations of the initial plan."""


def solve(
    tours: Tours,
    parameters: ToursParameters,
    *,
    seed: int = 0,
    time_limit_s: float = 60.0,
    iterations: int = 10**9,
    fewest_vehicles: bool = False,
) -> Search:
    """Search for tours, within a time limit or a number of iterations.

    Parameters
    ----------
    tours : Tours
        The problem.
    parameters : ToursParameters
        Parameters of the search.
    seed : int
        Seed of all random numbers; with a limit on iterations alone the tours are reproducible.
    time_limit_s, iterations : float, int
        The search ends after either.
    fewest_vehicles : bool
        Whether the number of vehicles is minimized first, whatever the cost.

    Raises
    ------
    InputError
        The limit is not above 0.
    """
    if not time_limit_s > 0.0:
        raise InputError("must be above 0", field="--time-limit", value=time_limit_s)
    search = Search(tours, parameters, seed)
    _warm_up(tours, parameters)
    begin = time.perf_counter()
    end_at, vehicles = begin + time_limit_s, len(tours.vehicles.begin)
    if len(tours.ready) < 2:
        return search
    search.run(
        end_at=end_at,
        iterations=min(BUILT, iterations),
        warm=parameters.cool,
        cool=parameters.cool,
        most_routes=vehicles,
    )
    most = vehicles
    if fewest_vehicles:
        share = parameters.fleet_share
        most = _fewer(search, begin + share * time_limit_s, int(share * iterations))
        search.forget()
    rest, left = end_at - time.perf_counter(), max(iterations - search.iterations, 1)
    for number in range(parameters.rounds):
        search.restart()
        spent = (number + 1) / parameters.rounds
        cooled_at = end_at - rest * (1.0 - spent + parameters.choice_share / parameters.rounds)
        last = 0 < number == parameters.rounds - 1
        warm = (parameters.warm * parameters.cool) ** 0.5 if last else parameters.warm
        search.run(
            end_at=cooled_at,
            iterations=max(left // parameters.rounds, 1),
            warm=warm,
            cool=parameters.cool,
            most_routes=most,
        )
        _choose(search, most, end_at - rest * (1.0 - spent))
    return search


def _warm_up(tours: Tours, parameters: ToursParameters) -> None:
    """Compile the kernels, so that the search has its time."""
    first = Search(tours, parameters)
    first.run(end_at=np.inf, iterations=1, warm=1.0, cool=1.0, most_routes=1)


def _fewer(search: Search, end_at: float, iterations: int) -> int:
    """Remove routes one after the other, as long as their customers are inserted elsewhere in time; return the remaining number."""
    tours = search.tours
    least = int(np.ceil(tours.demand.sum() / max(float(tours.vehicles.capacity.max()), 1e-9) - 1e-9))
    last = search.iterations + iterations
    while not len(search.refused) and search.used > max(least, 1):
        saved, most = search.saved(), search.used - 1
        search.restart()
        search.drop_route()
        search.best_cost = float(tours.refusal[1:].sum())
        search.run(
            end_at=end_at,
            iterations=max(last - search.iterations, 1),
            warm=FEWER,
            cool=FEWER,
            most_routes=most,
            until_served=True,
        )
        if (search.plan.route_of[1:] < 0).any() or len(search.refused):
            search.restore(saved)
            break
    return search.used


def _choose(search: Search, most_routes: int, end_at: float) -> None:
    """Select the best of all routes found; again without those that are not jointly feasible."""
    from scipy.sparse import csr_array

    tours = search.tours
    count = int(search.pool.filled[0])
    if not count or len(search.refused) or len(np.unique(tours.vehicles.kind)) > 1:
        return
    routes = [search.pooled(number) for number in range(count)]
    rows = np.concatenate([np.array(customers) - 1 for customers, _, _ in routes])
    columns = np.repeat(np.arange(count), [len(customers) for customers, _, _ in routes])
    served = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(tours.ready) - 1, count))
    cost = np.array([cost for _, _, cost in routes])
    jobs = None
    if tours.depot.chargers:
        found = np.array([search.job(customers, ways) for customers, ways, _ in routes], dtype=np.int64)
        jobs = Jobs(found[:, 0], found[:, 1], tours.depot.chargers)
    apart: list[list[int]] = []
    for _ in range(CHOICES):
        left = min(end_at - time.perf_counter(), search.parameters.choice_s)
        if left <= 0.0:
            break
        picked = partition(
            served, cost, most_cost=search.best_cost, most_routes=most_routes, jobs=jobs, apart=apart, time_limit_s=left
        )
        if picked is None or search.take([routes[number][:2] for number in picked]):
            break
        apart.append(picked.tolist())
