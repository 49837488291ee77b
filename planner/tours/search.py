"""The state of a search for tours: the present plan, the best one, and the pool of tours found."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.calendar_kernels import Calendar
from skyway.planner.tours.charger_kernels import Space as Chargers
from skyway.planner.tours.charger_kernels import clear, drive, lateness
from skyway.planner.tours.depot_kernels import Queue, job, queue_up, schedule
from skyway.planner.tours.route_kernels import GAIN, Plan, Space, insertion, relabel
from skyway.planner.tours.ruin_kernels import Work
from skyway.planner.tours.search_kernels import Cooling, Pool, absent_cost, anneal, copy_plan, total_cost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.parameters.tours import ToursParameters
    from skyway.planner.tours.problem import Tours

LABELS = 128
"""Labels of one node, when the charges of a route are chosen."""
CHUNK = 200
"""Iterations between two checks of the time limit."""
STATES = 16
"""States of the schedule of the chargers at the depot that are kept."""
WANTED, WANTED_COOL = (0.3, 0.6), (0.8, 1.0)
"""Target range of the share of iterations in which the plan serves all customers in time, warm and cool: below it
absence costs more, above it less. Lateness always uses the first."""
STEP = 1.1
CHEAPEST = 0.1
"""Least cost of an absent customer as a share of the initial one: at no cost, the search would leave customers out
and insert them again at any cost."""
UNPRICED = 0.5
"""Share of the time in which energy has no price."""


def _plan(nodes: int, vehicles: int) -> Plan:
    return Plan(
        np.zeros((vehicles, nodes), dtype=np.int64), np.zeros((vehicles, nodes + 1), dtype=np.int64), np.zeros(vehicles, dtype=np.int64),
        np.zeros(vehicles), np.zeros(vehicles), np.zeros((vehicles, nodes + 1)), np.zeros((vehicles, nodes + 1, 3)),
        np.zeros((vehicles, nodes + 1, 3)), np.full(nodes, -1, dtype=np.int64),
    )  # fmt: skip


def _prices(tours: Tours) -> NDArray[np.float64]:
    """Return prices of energy at which the choice between parallel arcs of different energy changes."""
    if not tours.depot.chargers:
        return np.empty(0)
    first = tours.first[:, :-1].ravel()
    count = np.diff(tours.first, axis=1).ravel()
    cheap = first[count > 1]
    saved = tours.ways.energy[cheap, 0] - tours.ways.energy[cheap + 1, 0]
    dearer = tours.ways.cost[cheap + 1] - tours.ways.cost[cheap]
    found: NDArray[np.float64] = dearer[saved > 0.0] / saved[saved > 0.0]
    return found


def _chargers(tours: Tours, vehicles: int, nodes: int) -> Chargers:
    taken = tours.pads.taken
    shape = len(taken.filled), int(taken.filled.max(initial=0)) + 2 * nodes + vehicles
    calendar = Calendar(
        np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros(shape[0], dtype=np.int64)
    )
    chargers = max(tours.depot.chargers, 1)
    states = 1 if chargers == 1 else STATES
    free, late, came = (
        np.zeros(shape, dtype=np.int64) for shape in ((2, states, chargers), (2, states), (vehicles, states, 2))
    )
    return Chargers(
        Queue(np.zeros((vehicles, 3), dtype=np.int64), free, late, late.copy(), came), calendar, np.zeros((0, 8))
    )


def _step(share: float, low: float, high: float) -> float:
    """Return the step of a price: up if the share of plans without the violation is below a range, down if above."""
    return STEP if share < low else 1.0 / STEP if share > high else 1.0


class Search:
    """Search for tours by annealing; all random numbers come from one seed."""

    def __init__(self, tours: Tours, parameters: ToursParameters, seed: int = 0) -> None:
        self.tours, self.parameters = tours, parameters
        nodes, vehicles = len(tours.ready), len(tours.vehicles.begin)
        self.plan, self.trial, self.best = (_plan(nodes, vehicles) for _ in range(3))
        self.space = Space(
            np.zeros((nodes + 2, LABELS, 4)), np.zeros((nodes + 2, LABELS, 2), dtype=np.int64), np.zeros(nodes + 2, dtype=np.int64)
        )  # fmt: skip
        self.chargers = _chargers(tours, vehicles, nodes)
        self.work = Work(
            np.array([seed], dtype=np.uint64), np.zeros(nodes + 1, dtype=np.int64), np.ones(nodes), np.zeros(vehicles, dtype=np.bool_),
            np.zeros(vehicles, dtype=np.bool_), np.zeros(nodes + 1),
        )  # fmt: skip
        kept = parameters.pool
        self.pool = Pool(
            np.zeros((kept, nodes), dtype=np.int16), np.zeros((kept, nodes + 1), dtype=np.int32), np.zeros(kept, dtype=np.int64), np.zeros(kept),
            np.zeros(1, dtype=np.int64), np.full(4 * kept + 1, -1, dtype=np.int64), np.zeros(kept, dtype=np.uint64),
        )  # fmt: skip
        self.best_cost = float(tours.refusal[1:].sum())
        self.iterations = 0
        self._late, self._absent = parameters.late, parameters.absent
        self._random = np.random.default_rng(seed)
        self._prices = _prices(tours)

    @property
    def used(self) -> int:
        """Return the number of vehicles of the best plan."""
        return int((self.best.length > 0).sum())

    @property
    def refused(self) -> NDArray[np.int64]:
        """Return the customers that the best plan does not serve."""
        return np.flatnonzero(self.best.route_of[1:] < 0) + 1

    @property
    def cost(self) -> float:
        """Return the cost of the best plan's routes."""
        return float(total_cost(self.best))

    def route(self, vehicle: int) -> tuple[list[int], list[int]]:
        """Return customers and ways of a route of the best plan."""
        length = int(self.best.length[vehicle])
        return self.best.customer[vehicle, :length].tolist(), self.best.way[vehicle, : length + 1].tolist()

    def run(self, *, end_at: float, iterations: int, warm: float, cool: float, most_routes: int, until_served: bool = False) -> None:  # fmt: skip
        """Anneal the plan until a time, for a number of iterations, or until all customers are served, if that is the goal."""
        begin, first = time.perf_counter(), self.iterations
        mean, usual = self.mean_cost, max(float(self.tours.refusal[1:].mean()), 1e-9)
        first_absent = self.parameters.absent
        dearest_absent = max(usual / mean, first_absent)
        while self.iterations - first < iterations and (now := time.perf_counter()) < end_at:
            share = max((self.iterations - first) / iterations, (now - begin) / (end_at - begin))
            hot = mean * warm * (cool / warm) ** share
            count = min(CHUNK, iterations - self.iterations + first)
            cooling = Cooling(
                hot, hot, float(self.parameters.removed), int(self.parameters.longest), self._late * mean,
                min(self._absent * mean / usual, 1.0), float(self.parameters.pooled),
                most_routes,
            )  # fmt: skip
            done, self.best_cost, in_time = anneal(
                self._priced(),
                self.plan,
                self.trial,
                self.best,
                self.work,
                self.space,
                self.chargers,
                self.pool,
                cooling,
                count,
                self.best_cost,
            )
            self.iterations += done
            low, high = ((1.0 - share) * one + share * other for one, other in zip(WANTED, WANTED_COOL, strict=True))
            self._late *= _step(in_time / done, *WANTED)
            self._absent = min(
                max(self._absent * _step(in_time / done, low, high), CHEAPEST * first_absent), dearest_absent
            )
            if until_served and not (self.plan.route_of[1:] < 0).any():
                break

    def _priced(self) -> Tours:
        """Return the problem with a price on energy, half of the time, if chargers at the depot are limited."""
        if not len(self._prices) or self._random.random() < UNPRICED:
            return self.tours
        price = float(self._random.choice(self._prices))
        return self.tours._replace(guide=self.tours.ways.cost + price * self.tours.ways.energy[:, 0])

    @property
    def mean_cost(self) -> float:
        """Return the mean cost of a tour with one customer, a measure of the distances, whatever the windows."""
        first, ways = self.tours.first, self.tours.ways
        alone = [
            ways.cost[first[0, node]] + ways.cost[first[node, 0]]
            for node in range(1, len(self.tours.ready))
            if first[0, node] < first[0, node + 1] and first[node, 0] < first[node, 1]
        ]
        return max(float(np.mean(alone)), 1e-9) if alone else 1.0

    def restart(self) -> None:
        """Continue from the best plan, with the initial cost of an absent customer; without a best plan from the present one."""
        if not self.used:
            copy_plan(self.plan, self.trial)
            return
        copy_plan(self.best, self.plan)
        copy_plan(self.best, self.trial)
        self._absent = self.parameters.absent

    def drop_route(self) -> None:
        """Remove all customers from the route whose customers were absent least often."""
        plan = self.plan
        used = np.flatnonzero(plan.length)
        absences = [self.work.absences[plan.customer[route, : plan.length[route]]].sum() for route in used]
        route = used[int(np.argmin(absences))]
        plan.route_of[plan.customer[route, : plan.length[route]]] = -1
        plan.length[route] = 0
        relabel(self.tours, plan, route)
        copy_plan(plan, self.trial)

    def forget(self) -> None:
        """Empty the pool."""
        self.pool.filled[0] = 0
        self.pool.slot[:] = -1

    def saved(self) -> tuple[Plan, float]:
        """Return the best plan and its cost, for `restore`."""
        return Plan._make(part.copy() for part in self.best), self.best_cost

    def restore(self, saved: tuple[Plan, float]) -> None:
        """Restore the best plan, and continue from it."""
        copy_plan(saved[0], self.best)
        self.best_cost = saved[1]
        self.restart()

    def pooled(self, number: int) -> tuple[list[int], list[int], float]:
        """Return customers, ways and cost of a route of the pool."""
        length = int(self.pool.length[number])
        return (
            self.pool.customer[number, :length].tolist(),
            self.pool.way[number, : length + 1].tolist(),
            float(self.pool.cost[number]),
        )

    def job(self, customers: Sequence[int], ways: Sequence[int]) -> tuple[int, int]:
        """Return the periods that a route charges at the depot, and the period by which it must be charged; the trial plan is changed."""
        self.put(self.trial, 0, customers, ways)
        found = job(self.tours, self.trial, 0)
        copy_plan(self.plan, self.trial)
        return found

    def take(self, routes: Sequence[tuple[Sequence[int], Sequence[int]]]) -> bool:
        """Make some routes the best plan, if they are jointly feasible and cost less; continue from the best plan."""
        plan = self.trial
        plan.length[:] = 0
        plan.cost[:] = plan.load[:] = 0.0
        plan.route_of[:] = -1
        feasible = all(self.put(plan, number, *route) for number, route in enumerate(routes))
        if not feasible:
            self.restart()
        return feasible and self.keep_trial()

    def keep_trial(self) -> bool:
        """Make the trial plan, whose routes are feasible, the best one if it is in time and costs less; continue from the best. False if it is late."""
        plan = self.trial
        in_time = bool(lateness(self.tours, plan, self.chargers) == 0.0)
        cost = total_cost(plan) + absent_cost(self.tours, self.work, plan)[0]
        if in_time and cost < self.best_cost - GAIN:
            copy_plan(plan, self.best)
            self.best_cost = cost
        self.restart()
        return in_time

    def alone(self, node: int) -> bool:
        """Return whether a vehicle could serve a customer if it were the only one."""
        plan, vehicles = _plan(len(self.tours.ready), len(self.tours.vehicles.begin)), self.tours.vehicles
        fits = np.flatnonzero(vehicles.capacity + GAIN >= self.tours.demand[node])
        return any(insertion(self.tours, plan, int(vehicle), 0, node, np.inf)[0] < np.inf for vehicle in fits)

    def timetables(
        self, plan: Plan | None = None, vehicles: NDArray[np.int64] | None = None
    ) -> dict[int, NDArray[np.float64]]:
        """Return the timetables of some vehicles of a plan, by default the best one, without the others, or of all that it uses; rows as in `charger_kernels`."""
        plan = self.best if plan is None else plan
        calendar = self.chargers.calendar
        clear(self.tours, calendar)
        found = {}
        for vehicle in (np.flatnonzero(plan.length) if vehicles is None else vehicles).tolist():
            rows = np.zeros((6 * (int(plan.length[vehicle]) + 1), 8))
            _, count = drive(self.tours, plan, vehicle, calendar, rows)
            found[vehicle] = rows[:count]
        return found

    def depot_charges(self) -> dict[int, tuple[int, int, int]]:
        """Return for each vehicle of the best plan that is charged at the depot: the period after which it begins, the number of periods, and the period by which it must be charged."""
        queue = self.chargers.queue
        count = queue_up(self.tours, self.best, queue)
        _, state = schedule(queue, count)
        found = {}
        for number in range(count - 1, -1, -1):
            before, begin = queue.came[number, state]
            periods, by, route = queue.job[number].tolist()
            found[route] = int(begin), periods, by
            state = int(before)
        return found

    def put(self, plan: Plan, number: int, customers: Sequence[int], ways: Sequence[int]) -> bool:
        """Insert a route into a plan; false if it is not feasible."""
        plan.customer[number, : len(customers)] = customers
        plan.way[number, : len(ways)] = ways
        plan.length[number] = len(customers)
        plan.route_of[list(customers)] = number
        return bool(relabel(self.tours, plan, number))
