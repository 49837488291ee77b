"""Lower bound of the cost of any plan of a fleet: an assignment of orders to predecessors.

Each served order is fetched by a drone that comes from its first place or from another order, and each of those has at most one next
order. So the cheapest assignment of orders to predecessors bounds the cost from below, when each pair costs no more than in
any plan: flights as in the best slot, charging at the fastest rate and only beyond what a full battery holds, pads always free.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import DispatchProblem

MAX_CELLS = 40_000_000
"""Largest numbers of pairs that are assigned, and that are computed at once; above, each order takes its cheapest
predecessor."""


def lower_bound(problem: DispatchProblem) -> float:
    """Return a lower bound of the cost of any plan."""
    orders, count = problem.orders, len(problem.orders.origin)
    if not count:
        return 0.0
    before = len(problem.fleet.place) + count
    if before * count > MAX_CELLS:
        width = max(MAX_CELLS // before, 1)
        parts = (np.arange(begin, min(begin + width, count)) for begin in range(0, count, width))
        return float(sum(_costs(problem, part).min(axis=0).sum() for part in parts))
    from scipy.optimize import linear_sum_assignment

    refused = np.full((count, count), np.inf)
    np.fill_diagonal(refused, orders.refusal_s)
    whole = np.concatenate((_costs(problem, np.arange(count)), refused))
    rows, columns = linear_sum_assignment(np.where(np.isfinite(whole), whole, 1e15))
    return float(whole[rows, columns].sum())


def _costs(problem: DispatchProblem, which: NDArray[np.int64]) -> NDArray[np.float64]:
    """Least cost of some orders after each drone's first place and each other order, shape (drones + orders, which); at most the cost of refusing them."""
    fleet, orders, weights = problem.fleet, problem.orders, problem.weights
    empty, loaded = (
        _ways(problem, np.unique(fleet.empty_mode)),
        _ways(problem, np.unique(orders.mode[orders.mode >= 0])),
    )
    legs_s, legs_need = loaded[0][orders.origin, orders.destination], loaded[1][orders.origin, orders.destination]
    # From a drone's first place, and from where another order was delivered, at the earliest.
    from_place = np.concatenate((fleet.place, orders.destination))
    earliest = np.concatenate((fleet.from_s, orders.ready_s + legs_s))
    way_s = empty[0][from_place[:, None], orders.origin[None, which]]
    way_need = empty[1][from_place[:, None], orders.origin[None, which]]
    begin = np.maximum(earliest[:, None] + way_s, orders.ready_s[None, which])
    done = begin + legs_s[None, which]
    late = np.maximum(done - orders.due_s[None, which], 0.0)
    energy = weights.energy_s * (way_need + legs_need[None, which])
    cost = done - orders.ready_s[None, which] + weights.lateness * late + energy
    cost = np.where(done <= orders.latest_s[None, which] + 1e-6, cost, np.inf)
    cost[len(fleet.place) + which, np.arange(len(which))] = np.inf  # no order comes before itself
    return np.minimum(cost, orders.refusal_s[None, which])


def _ways(problem: DispatchProblem, modes: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least time, and least charge, between all places, in the best mode and slot; charge beyond a full battery costs time."""
    flights = problem.flights
    time_s = flights.time_s[modes].min(axis=(0, 1))
    need = flights.need[modes].min(axis=(0, 1)) * float(problem.fleet.scale.min())
    diagonal = np.arange(len(time_s))
    time_s[diagonal, diagonal] = need[diagonal, diagonal] = 0.0
    for stop in flights.stops:
        np.minimum(time_s, time_s[:, stop, None] + time_s[None, stop, :], out=time_s)
        np.minimum(need, need[:, stop, None] + need[None, stop, :], out=need)
    slopes = np.diff(flights.curve_s, axis=1) / np.maximum(np.diff(flights.curve_soc, axis=1), 1e-12)
    fastest = float(slopes[np.diff(flights.curve_soc, axis=1) > 1e-9].min())
    extra = np.maximum(need - (1.0 - flights.reserve), 0.0)
    return time_s + np.where(np.isfinite(extra), fastest * extra, np.inf), need
