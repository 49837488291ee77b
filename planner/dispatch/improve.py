"""Adaptive large neighbourhood search: orders are repeatedly removed from the routes of a fleet and inserted elsewhere."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.planner.dispatch.flight_kernels import HOME
from skyway.planner.dispatch.keeping import hold, keep, take
from skyway.planner.dispatch.search import Search

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import DispatchProblem
    from skyway.planner.parameters.dispatch import DispatchParameters

CHARGED_WAITING = (1.0, 1.0, 0.8, 0.6, 0.4, 0.0)
"""Charges to which drones charge while they wait, chosen at random: another drone may need the pad."""
NOISES = (0.0, 0.0, 0.1, 0.3, 1.0)
"""Noise on the cost of an insertion, as the standard deviation of its logarithm; chosen at random."""
REGRETTED = 12
"""Largest number of orders that are inserted with regret."""
KEEPS_BEST = 200
"""Largest number of drones for which worse routes are accepted for a while; the best ones are kept separately."""
HALTED = 1
"""Largest number of changed orders that get or lose a charging stop, on the way to the package or with it."""
HALTED_HOME = 0.1
"""Chance that it is one on the way home. With a third, and with all stops tried in a fifth of the changes
(`ELSEWHERE`), 11 of 90 small problems had a higher cost; with these values 2, as many as without either."""
NEAREST = 6
"""Number of nearby stations from which such a stop is chosen."""
LEVELS = (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Charges with which drones leave such stops."""
ELSEWHERE = 0.05
"""Chance that only one drone is flown again, with each of the stops tried for one order and phase, or for its way home."""
ELSEWHERE_OF = 2
"""Number of random drones of which the most expensive is selected."""
AGAIN = 0.1
"""Probability that some drones are only scheduled again, in another sequence: the first one gets the pads."""
RESTYLED = 0.3
"""Share of the changing drones that try another charge while waiting."""
GAINS = (3.0, 1.0, 0.2)
"""Score of the removal method: for the best routes so far, for better ones, and for others."""
MEMORY = 0.95
TOLERATED_S = 300.0
"""A delivery later than promised by at most this does not count as a changed promise."""


class Improver:
    """Improves the routes of a search."""

    def __init__(self, search: Search) -> None:
        self.search, self.random = search, search.random
        self.orders, self.parameters = search.problem.orders, search.parameters

    def improve(self, *, end_at: float, iterations: int) -> None:
        """Search until a time, or for a number of iterations, and keep the best routes."""
        search, count = self.search, self.parameters
        if not search.orders:
            return
        ways = (self._at_random, self._near_one, self._costly, self._of_drones)
        weight = np.ones(len(ways))
        served = max(int((search.drone_of >= 0).sum()), 1)
        scale = max(float(search.routes.total.sum()) / served, 1.0) * count.cooling
        share = math.ceil(count.destroyed_share * min(search.orders, 40))
        most = max(min(count.destroyed, search.orders), share)
        keeps = search.drones <= KEEPS_BEST
        current = best_cost = search.cost
        best = search.all() if keeps else None
        begin = time.perf_counter()
        for number in range(iterations):
            now = time.perf_counter()
            if now >= end_at:
                break
            warmth = 1.0 - max(number / iterations, (now - begin) / max(end_at - begin, 1e-9)) if keeps else 0.0
            way = int(self.random.choice(len(ways), p=weight / weight.sum()))
            search.watch()
            how = self.random.random()
            if how < AGAIN:
                done = self._again()
            elif how < AGAIN + ELSEWHERE:
                done = self._elsewhere()
            else:
                done = self._changed(ways[way](int(self.random.integers(1, most + 1))), most)
            cost = search.cost
            gain = GAINS[0] if cost < best_cost - 1e-6 else GAINS[1] if cost < current - 1e-6 else GAINS[2]
            weight[way] = MEMORY * weight[way] + (1.0 - MEMORY) * gain
            allowed = self.random.random() < math.exp(min((current - cost) / max(scale * warmth, 1e-9), 0.0))
            if not done or not allowed:
                search.back()
            else:
                search.undo, current = None, cost
                if cost < best_cost - 1e-6:
                    best_cost, best = cost, search.all() if keeps else None
            search.iterations += 1
        if best is not None and search.cost > best_cost:
            search.all_back(best)
        search.spare_halts()

    def _again(self) -> bool:
        """Schedule some drones again with other stops, in another sequence; false if one becomes infeasible."""
        drones = [
            int(one)
            for one in self.random.permutation(np.flatnonzero(self.search.routes.length))[: self.random.integers(1, 4)]
        ]
        self._restyle(set(drones))
        flown = [one for drone in drones for one in self.search.route(drone)]
        self._halted(flown)
        return self.search.again(drones)

    def _elsewhere(self) -> bool:
        """Move a charge of one drone to the stop where its route costs least, for one order and phase or on its way home; false if there is none."""
        search = self.search
        flown = np.flatnonzero(search.routes.length)
        if not len(flown):
            return False
        drone = max(self.random.choice(flown, ELSEWHERE_OF).tolist(), key=lambda one: float(search.routes.total[one]))
        if search.undo is not None:
            search.undo.saved.setdefault(drone, search.saved(drone))
        route = search.route(drone)
        number = int(self.random.integers(0, 3 * len(route)))
        order, phase = (route[number // 2], number % 2) if number < 2 * len(route) else (route[-1], HOME)
        return search.settle(drone, order, phase)

    def _changed(self, chosen: list[int], most: int) -> bool:
        """Remove orders and insert them again, with some that are not served; false if a route is infeasible without them."""
        search = self.search
        outside = np.flatnonzero(search.drone_of < 0)
        outside = self.random.permutation(outside)[:most]
        self._restyle({int(search.drone_of[one]) for one in chosen})
        if not search.remove(chosen):
            return False
        waiting = list(dict.fromkeys((*chosen, *(int(one) for one in outside))))
        self._halted(waiting)
        how = self.random.random()
        if how < 0.4 and len(waiting) <= REGRETTED:
            search.insert_with_regret(waiting)
            return True
        self.random.shuffle(waiting)
        if how < 0.7:
            waiting.sort(key=lambda one: -self.orders.refusal_s[one])
        noise = float(self.random.choice(NOISES))
        for one in waiting:
            search.insert_best(one, noise)
        return True

    def _restyle(self, changing: set[int]) -> None:
        """Change the charge at which some drones wait: changing ones, and ones without orders."""
        search = self.search
        idle = self.random.permutation(np.flatnonzero(search.routes.length == 0))[:8]
        for drone in sorted(changing | {int(one) for one in idle}):
            if self.random.random() < RESTYLED:
                if search.undo is not None:
                    search.undo.saved.setdefault(drone, search.saved(drone))
                search.routes.most[drone] = self.random.choice(CHARGED_WAITING)

    def _halted(self, chosen: Sequence[int]) -> None:
        """Give a few of the changing orders other charging stops, or none."""
        halts = self.search.routes.halts
        for one in self.random.permutation(np.array(chosen, dtype=np.int64))[: self.random.integers(0, HALTED + 1)]:
            phase = HOME if self.random.random() < HALTED_HOME else int(self.random.integers(0, 2))
            halts.place[one, phase] = -1
            if self.random.random() < 0.7:
                halts.place[one, phase] = self.random.choice(self.search.stops_near(one, phase, NEAREST))
                halts.soc[one, phase] = self.random.choice(LEVELS)

    def _served(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.search.drone_of >= 0)

    def _at_random(self, count: int) -> list[int]:
        return [int(one) for one in self.random.permutation(self._served())[:count]]

    def _near_one(self, count: int) -> list[int]:
        """Orders close to a random one in time and place."""
        served = self._served()
        if not len(served):
            return []
        orders = self.orders
        way = self.search.problem.flights.to_go_s[0, 0]
        one = int(self.random.choice(served))
        far = way[orders.origin[one], orders.origin[served]] + way[orders.destination[one], orders.destination[served]]
        far = np.where(np.isfinite(far), far, 1e6) + np.abs(orders.ready_s[one] - orders.ready_s[served])
        far *= self.random.uniform(0.7, 1.3, len(far))
        return [int(served[place]) for place in np.argsort(far)[:count]]

    def _costly(self, count: int) -> list[int]:
        """Orders that add most to their routes."""
        served, search = self._served(), self.search
        if len(served) > 20 * count:
            served = self.random.permutation(served)[: 20 * count]
        drone = search.drone_of[served]
        position = [search.route(int(d)).index(int(o)) for d, o in zip(drone, served, strict=True)]
        place = np.array(position, dtype=np.int64)
        added = search.routes.cost[drone, place + 1] - search.routes.cost[drone, place]
        added *= self.random.uniform(0.3, 1.0, len(added))
        return [int(served[place]) for place in np.argsort(-added)[:count]]

    def _of_drones(self, count: int) -> list[int]:
        """Whole routes."""
        found: list[int] = []
        for drone in self.random.permutation(np.flatnonzero(self.search.routes.length)):
            found += self.search.route(int(drone))
            if len(found) >= count:
                break
        return found[: 2 * count]


@dataclass(frozen=True)
class Before:
    """The previous plan, by numbers of drones, orders and places."""

    routes: Mapping[int, Sequence[int]]
    """Orders of each drone, in sequence."""
    halts: Mapping[tuple[int, int], tuple[int, float]]
    """Last charging stop for an order and phase, and the charge at departure."""
    promised_s: Mapping[int, float]
    """Promised delivery times, POSIX seconds."""
    rows: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)
    """Planned steps of each drone. Its pads are reserved until it is scheduled, and the steps are kept where that is still possible."""

    def hold_to(self, search: Search) -> None:
        """Prevent new orders and improvements from delaying a promised order beyond its present time, or beyond the limit for new promises."""
        orders = search.problem.orders
        for order in self.promised_s:
            usual_s = orders.due_s[order] + search.parameters.max_late_s
            done_s = search.delivered_s(order)
            if done_s < math.inf:
                orders.latest_s[order] = min(max(usual_s, done_s + TOLERATED_S), orders.latest_s[order])

    def changed(self, search: Search) -> int:
        """How many promises the routes break: the order is not served, or more than `TOLERATED_S` later."""
        broken = 0
        for order, at_s in self.promised_s.items():
            done_s = search.delivered_s(order)
            broken += done_s > at_s + TOLERATED_S
        return broken


def solve(
    problem: DispatchProblem,
    parameters: DispatchParameters,
    *,
    seed: int = 0,
    time_limit_s: float = 10.0,
    iterations: int = 10**9,
    before: Before | None = None,
) -> Search:
    """Search for routes, within a time limit or a number of iterations; an `InputError` refuses a limit that is not above 0.

    The search begins with the routes of `before`; a plan that changes promises is accepted only if its gain exceeds their cost.
    """
    if not time_limit_s > 0.0:
        raise InputError("must be above 0", field="--time-limit", value=time_limit_s)
    search = Search(problem, parameters, seed)
    search.warm_up()
    end_at = time.perf_counter() + time_limit_s
    if before is not None:
        for drone, rows in before.rows.items():
            hold(search, drone, rows)
        for drone, route in before.routes.items():
            if not keep(search, drone, route, before.rows.get(drone), before.halts):
                take(search, drone, route, before.halts)
        before.hold_to(search)
    search.build(end_at, set() if before is None else before.promised_s.keys())
    if before is None:
        Improver(search).improve(end_at=end_at, iterations=iterations)
        search.polish()
        return search
    search.polish()
    kept, weight = search.all(), parameters.change_s
    cost = search.cost + weight * before.changed(search)
    Improver(search).improve(end_at=end_at, iterations=iterations)
    if search.iterations:
        search.polish()
    if search.cost + weight * before.changed(search) > cost - 1e-6:
        search.all_back(kept)
    return search
