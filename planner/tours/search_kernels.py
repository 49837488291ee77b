"""Kernels of the search: ruin and recreate, accepted by simulated annealing; routes that were seen are kept.

After Christiaens and Vanden Berghe, "Slack induction by string removals for vehicle routing problems", Transportation Science 54 (2020): while customers are
in no route, plans are also compared by how often those were.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.jit.compiled import compiled_lean
from skyway.models.jit.random_kernels import GOLDEN, MIX_1, mixed, uniform
from skyway.planner.tours.charger_kernels import lateness
from skyway.planner.tours.recreate_kernels import recreate
from skyway.planner.tours.route_kernels import GAIN
from skyway.planner.tours.ruin_kernels import drop, ruin

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.charger_kernels import Space as Chargers
    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.route_kernels import Plan, Space
    from skyway.planner.tours.ruin_kernels import Work


class Pool(NamedTuple):
    """Routes that were seen in good plans, each set of customers once, with its cheapest order."""

    customer: NDArray[np.int64]
    """Shape (pool, most)."""
    way: NDArray[np.int64]
    """Shape (pool, most + 1)."""
    length: NDArray[np.int64]
    cost: NDArray[np.float64]
    """Shape (pool,) each."""
    filled: NDArray[np.int64]
    """Shape (1,)."""
    slot: NDArray[np.int64]
    """Shape (slots,): a hash table of the numbers of routes; -1: free."""
    key: NDArray[np.uint64]
    """Shape (pool,): hash of each."""


@compiled_lean
def copy_route(source: Plan, target: Plan, route: int) -> None:
    """Make a route of one plan that of another; `route_of` is left."""
    length = source.length[route]
    target.length[route] = length
    target.load[route], target.cost[route] = source.load[route], source.cost[route]
    for one in range(length + 1):
        target.way[route, one], target.aboard[route, one] = source.way[route, one], source.aboard[route, one]
        for part in range(3):
            target.ahead[route, one, part] = source.ahead[route, one, part]
            target.behind[route, one, part] = source.behind[route, one, part]
        if one < length:
            target.customer[route, one] = source.customer[route, one]


@compiled_lean
def copy_plan(source: Plan, target: Plan) -> None:
    """Make one plan another.

    Takes two plans of one problem.
    """
    for route in range(len(source.length)):
        copy_route(source, target, route)
    for node in range(len(source.route_of)):
        target.route_of[node] = source.route_of[node]


@compiled_lean
def remember(tours: Tours, plan: Plan, pool: Pool, route: int) -> None:
    """Put a route into the pool, if there is room."""
    key = np.uint64(0)
    for position in range(plan.length[route]):
        key += mixed(np.uint64(plan.customer[route, position]) * GOLDEN)
    if tours.depot.chargers:
        for position in range(plan.length[route] + 1):
            key += mixed(np.uint64(plan.way[route, position] + 1000) * MIX_1)
    at = np.int64(key % np.uint64(len(pool.slot)))
    while pool.slot[at] >= 0 and pool.key[pool.slot[at]] != key:
        at = np.int64(at + 1 if at + 1 < len(pool.slot) else 0)
    number = pool.slot[at]
    if number < 0:
        number = pool.filled[0]
        if number == len(pool.length):
            return
        pool.filled[0] = number + 1
        pool.slot[at], pool.key[number] = number, key
    elif pool.cost[number] <= plan.cost[route]:
        return
    pool.length[number], pool.cost[number] = plan.length[route], plan.cost[route]
    for position in range(plan.length[route] + 1):
        pool.way[number, position] = plan.way[route, position]
        if position < plan.length[route]:
            pool.customer[number, position] = plan.customer[route, position]


class Cooling(NamedTuple):
    """How is searched."""

    warm: float
    cool: float
    """Temperatures of simulated annealing, at the beginning and the end."""
    removed: float
    longest: int
    """Customers that are taken out at once, on average, and from one route at most."""
    late: float
    """Cost of one unit of lateness."""
    absent: float
    """Share of its refusal that a customer costs who is in no route."""
    pooled: float
    """Routes of accepted plans that cost less than so many times the best are put into the pool."""
    most_routes: int


@compiled_lean
def absent_cost(tours: Tours, work: Work, plan: Plan) -> tuple[float, float]:
    """Return what the customers that are in no route cost, and in sum how often they were in none, weighed by that.

    Takes a plan of the problem, and how often each customer was absent.
    """
    cost, lack = 0.0, 0.0
    for node in range(1, len(plan.route_of)):
        if plan.route_of[node] < 0:
            cost += tours.refusal[node]
            lack += work.absences[node] * tours.refusal[node]
    return cost, lack


@compiled_lean
def total_cost(plan: Plan) -> float:
    """Return the cost of all routes.

    Takes a plan whose routes are labelled.
    """
    total = 0.0
    for route in range(len(plan.length)):
        if plan.length[route]:
            total += plan.cost[route]
    return total


@compiled_lean
def settle(tours: Tours, plan: Plan, trial: Plan, work: Work, pool: Pool, taken: bool, pooled: bool) -> None:
    """Make the plan what was tried, where that is taken, or what is tried the plan again."""
    for route in range(len(plan.length)):
        if work.touched[route]:
            if taken:
                copy_route(trial, plan, route)
                if pooled and plan.length[route]:
                    remember(tours, plan, pool, route)
            else:
                copy_route(plan, trial, route)
    for node in range(len(plan.route_of)):
        if taken:
            plan.route_of[node] = trial.route_of[node]
        else:
            trial.route_of[node] = plan.route_of[node]


@compiled_lean
def anneal(
    tours: Tours, plan: Plan, trial: Plan, best: Plan, work: Work, space: Space, chargers: Chargers, pool: Pool, cooling: Cooling, iterations: int,
    best_cost: float,
) -> tuple[int, float, int]:  # fmt: skip
    """Search for so many iterations; returns how many were done, the cost of `best`, and in how many the plan was not late.

    `plan` and `trial` begin and end equal. It ends at once when the last absent customer is served. A plan is accepted if its cost is below
    c - T ln u, c that of the plan before, T the temperature and u uniform; while customers are absent also where those that are then were absent less often.

    Takes three plans of one problem, the first two equal, and any number of iterations.
    """
    refused, missing = absent_cost(tours, work, plan)
    cost = total_cost(plan) + cooling.absent * refused + cooling.late * lateness(tours, plan, chargers)
    began, punctual, in_time = refused > 0.0, lateness(tours, plan, chargers) == 0.0, 0
    for iteration in range(iterations):
        temperature = cooling.warm * (cooling.cool / cooling.warm) ** (iteration / iterations)
        work.absent[-1] = 0
        for route in range(len(plan.length)):
            work.touched[route] = False
        for node in range(1, len(plan.route_of)):
            if plan.route_of[node] < 0:
                drop(trial, work, node)
        ruin(tours, trial, work, space, cooling.removed, cooling.longest)
        recreate(tours, trial, work, space, cooling.most_routes)
        left, lack = absent_cost(tours, work, trial)
        driven = total_cost(trial)
        total, most, late = driven + cooling.absent * left, cost - temperature * np.log(1.0 - uniform(work.random)), 0.0
        rarer = refused > 0.0 and lack < missing
        if total < most or rarer:  # lateness is not worked out where the plan costs too much anyway
            late = lateness(tours, trial, chargers)
            total += cooling.late * late
        taken = total < most or rarer
        for one in range(work.absent[-1]):
            work.absences[work.absent[one]] += 1.0
        settle(tours, plan, trial, work, pool, taken, total < cooling.pooled * best_cost + cooling.late * late)
        in_time += punctual and refused == 0.0
        if taken:
            cost, punctual = total, late == 0.0
            if late == 0.0 and driven + left < best_cost - GAIN:
                best_cost = driven + left
                copy_plan(plan, best)
        if refused > 0.0 or left > 0.0:
            refused, missing = absent_cost(tours, work, plan)
        if began and refused == 0.0:
            return iteration + 1, best_cost, in_time
    return iterations, best_cost, in_time
