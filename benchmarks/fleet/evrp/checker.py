"""An independent checker of solutions: it shares no code with the solver, and uses only the instance files.

Charges of a route of the first set are found by a linear program: times and amounts are variables, so feasible amounts are found if they exist, and
infeasibility is proved. Routes of the second set are simulated minute by minute.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linprog

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.fleet.evrp import evrptw, overnight

TOLERANCE = 1e-6


def distance_of(instance: evrptw.Instance, routes: Sequence[Sequence[str]]) -> float:
    """Length of all routes, from the coordinates."""
    place = {one: instance.place[number] for number, one in enumerate(instance.ids)}
    depot = instance.ids[0]
    total = 0.0
    for route in routes:
        stops = [place[one] for one in (depot, *route, depot)]
        total += sum(float(np.linalg.norm(after - before)) for before, after in itertools.pairwise(stops))
    return total


def faults(instance: evrptw.Instance, routes: Sequence[Sequence[str]]) -> list[str]:
    """Return the faults of a solution of the first set; empty if it is feasible."""
    found = []
    kind = dict(zip(instance.ids, instance.kind, strict=True))
    demand = dict(zip(instance.ids, instance.demand.tolist(), strict=True))
    visited = sorted(one for route in routes for one in route if kind[one] == "c")
    if visited != sorted(one for one in instance.ids if kind[one] == "c"):
        found.append("not every customer is visited once")
    for number, route in enumerate(routes):
        load = sum(demand[one] for one in route)
        if load > instance.capacity + TOLERANCE:
            found.append(f"route {number}: load {load:g} of {instance.capacity:g}")
        if not can_be_driven(instance, route):
            found.append(f"route {number}: windows and battery cannot be kept")
    return found


def can_be_driven(instance: evrptw.Instance, route: Sequence[str]) -> bool:
    """Whether there are times and charges that keep the windows and the battery limits.

    Variables of each stop i: begin of service t_i, energy on arrival e_i, charge x_i (0 but at stations).
    """
    index = {one: number for number, one in enumerate(instance.ids)}
    stops = [0, *(index[one] for one in route), 0]
    count, battery = len(stops), instance.battery
    rows, limits = [], []
    bounds: list[tuple[float, float]] = [(float(instance.ready[stop]), float(instance.due[stop])) for stop in stops]
    bounds += [(battery, battery), *((0.0, battery) for _ in stops[1:])]
    bounds += [(0.0, battery if instance.kind[stop] == "f" else 0.0) for stop in stops]
    for one, (stop, after) in enumerate(itertools.pairwise(stops)):
        gap = float(np.linalg.norm(instance.place[after] - instance.place[stop]))
        leave = np.zeros(3 * count)  # t_i + service + g x_i + way <= t_j
        leave[one], leave[one + 1], leave[2 * count + one] = 1.0, -1.0, instance.refuelling
        rows.append(leave)
        limits.append(-float(instance.service[stop]) - gap / instance.velocity)
        used = np.zeros(3 * count)  # e_j <= e_i + x_i - way
        used[count + one + 1], used[count + one], used[2 * count + one] = 1.0, -1.0, -1.0
        rows.append(used)
        limits.append(-gap * instance.consumption)
        full = np.zeros(3 * count)  # e_i + x_i <= Q
        full[count + one], full[2 * count + one] = 1.0, 1.0
        rows.append(full)
        limits.append(battery)
    slack = np.array(limits) + TOLERANCE
    return bool(
        linprog(np.zeros(3 * count), A_ub=np.array(rows), b_ub=slack, bounds=bounds, method="highs").status == 0
    )


def overnight_faults(instance: overnight.Instance, solution: overnight.Solution) -> list[str]:
    """Return the faults of a solution of the second set; empty if it is feasible and its cost is correct."""
    found = []
    depot = len(instance.window) - 1
    heads = [instance.links[link].head for route in solution.routes for link in route.links]
    if sorted(one for one in heads if one != depot) != list(range(1, depot)):
        found.append("not every customer is visited once")
    cost = sum(instance.links[link].cost for route in solution.routes for link in route.links) / 10.0
    if abs(cost - solution.cost) > TOLERANCE:
        found.append(f"costs {cost:g}, not {solution.cost:g}")
    busy = np.zeros(instance.last_period + 2, dtype=int)
    for number, route in enumerate(solution.routes):
        links = [instance.links[link] for link in route.links]
        ends = [0, *(link.head for link in links)]
        if [link.tail for link in links] != ends[:-1] or ends[-1] != depot or depot in ends[:-1]:
            found.append(f"route {number}: its links are no tour")
        if sum(instance.load[node] for node in ends) > instance.capacity:
            found.append(f"route {number}: load")
        energy = sum(link.energy for link in links)
        if (
            energy > instance.battery
            or int(instance.periods[min(energy, instance.battery)]) > route.last_period - route.first_period + 1
        ):
            found.append(f"route {number}: energy {energy} is not charged")
        if (
            not instance.first_period
            <= route.first_period
            <= route.last_period
            <= min(instance.last_period, route.departure - 1)
        ):
            found.append(
                f"route {number}: charges in periods {route.first_period} to {route.last_period}, departs at {route.departure}"
            )
        busy[route.first_period : route.last_period + 1] += 1
        at = max(10 * route.departure, instance.window[0][0])
        for link in links:
            at = max(at + link.time, instance.window[link.head][0])
            if at > instance.window[link.head][1]:
                found.append(f"route {number}: at node {link.head} at {at}, not by {instance.window[link.head][1]}")
    if int(busy.max()) > instance.chargers:
        found.append(f"{busy.max()} vehicles at {instance.chargers} chargers")
    return found
