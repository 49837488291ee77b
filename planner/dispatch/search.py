"""Routes of a fleet during the search: orders are inserted, with regret, and removed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.calendar_kernels import Calendar, book
from skyway.planner.dispatch.flight_kernels import END, HOME, Trace
from skyway.planner.dispatch.plan_kernels import Routes, insertions, lay_out, rebook, unbook
from skyway.planner.dispatch.route_kernels import Halts

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from skyway.planner.dispatch.problem import DispatchProblem
    from skyway.planner.parameters.dispatch import DispatchParameters

MAX_ROUTE, MAX_WINDOWS, MAX_ROWS = 40, 400, 1200
"""Maximum numbers of orders, windows of pads, and flights and charges of one drone."""
TAKEN_WAITING = (1.0, 0.6, 0.0)
"""Charges to which drones charge while they wait, when a route is kept: the first one with which the route is feasible is used."""
STOPS_TRIED = 12
"""Number of stops tried when a drone looks for the best one."""
PARTS = ("order", "length", "time_s", "soc", "cost", "total", "window", "windows", "most")


@dataclass(frozen=True)
class Flown:
    """State of one drone in the search."""

    parts: tuple[NDArray[np.float64], ...]
    """Its rows of the `Routes`."""
    steps: NDArray[np.float64]
    """Its flights and charges, as `lay_out` traced them."""


@dataclass
class Known:
    """Earlier states of some drones, to restore them."""

    drone_of: NDArray[np.int64]
    halts: Halts
    saved: dict[int, Flown] = field(default_factory=dict)


class Search:
    """Routes of a fleet while they are improved; all randomness comes from one seed."""

    def __init__(self, problem: DispatchProblem, parameters: DispatchParameters, seed: int = 0) -> None:
        self.problem, self.parameters = problem, parameters
        self.random = np.random.default_rng(seed)
        flights, fleet, orders = problem.flights, problem.fleet, problem.orders
        self.drones, self.orders = len(fleet.place), len(orders.origin)
        most = min(MAX_ROUTE, self.orders)
        shape = self.drones, most + 1
        self.routes = Routes(
            order=np.full((self.drones, max(most, 1)), -1, dtype=np.int64),
            length=np.zeros(self.drones, dtype=np.int64),
            time_s=np.repeat(fleet.from_s[:, None], most + 1, axis=1),
            soc=np.repeat(fleet.soc[:, None], most + 1, axis=1),
            cost=np.zeros(shape),
            total=np.zeros(self.drones),
            window=np.zeros((self.drones, min(MAX_WINDOWS, 12 * most + 12), 3)),
            windows=np.zeros(self.drones, dtype=np.int64),
            most=np.ones(self.drones),
            halts=Halts(np.full((self.orders, 3), -1, dtype=np.int64), np.zeros((self.orders, 3))),
            gap_s=parameters.pad_gap_s,
        )
        pads = int(flights.pads.sum())
        taken = np.bincount([pad for pad, _, _ in problem.taken], minlength=pads)
        depth = int(taken.max(initial=0)) + max(64, 8 * self.orders * 4 // max(pads, 1) + 64)
        self.calendar = Calendar(
            np.zeros((pads, depth)), np.zeros((pads, depth)), np.zeros((pads, depth), dtype=np.int64),
            np.zeros(pads, dtype=np.int64),
        )  # fmt: skip
        for pad, begin_s, end_s in problem.taken:
            book(self.calendar, pad, begin_s, end_s, -1)
        self.trace = Trace(np.zeros((MAX_ROWS, 10)), np.zeros(1, dtype=np.int64))
        self._silent = Trace(np.zeros((0, 10)), np.zeros(1, dtype=np.int64))
        self.steps = [np.zeros((0, 10))] * self.drones
        """Flights and charges of each drone. They are stored, because laying the route out again could give other
        pads."""
        self.drone_of = np.full(self.orders, -1, dtype=np.int64)
        """Which drone serves each order; -1: none."""
        self._wanted = [int(one) for one in np.lexsort((orders.due_s, -orders.refusal_s))]
        self._least: dict[int, NDArray[np.float64]] = {}
        self.iterations = 0
        self.undo: Known | None = None
        """States of drones before their first change since `watch`; None if changes are not watched."""

    @property
    def cost(self) -> float:
        """Cost of all routes and of the orders that are not served."""
        return float(self.routes.total.sum() + self.problem.orders.refusal_s[self.drone_of < 0].sum())

    def _least_arrivals(self, order: int) -> NDArray[np.float64]:
        """Earliest arrival of each drone at the origin of an order from its first place; selects the drones to try."""
        if order not in self._least:
            flights, fleet, orders = self.problem.flights, self.problem.fleet, self.problem.orders
            slot = ((fleet.from_s - flights.start_s) / flights.slot_s).astype(int)
            at = fleet.empty_mode, np.clip(slot, 0, flights.time_s.shape[1] - 1), fleet.place, orders.origin[order]
            found = fleet.from_s + flights.to_go_s[at]
            self._least[order] = np.where(orders.mode[fleet.type, order] >= 0, found, np.inf)
        return self._least[order]

    def candidates(self, order: int) -> NDArray[np.int64]:
        """Return the drones to try for an order: those that could fetch it first with their present routes."""
        count = self.parameters.vehicles_tried
        if self.drones <= count:
            return np.arange(self.drones)
        flights, orders, routes = self.problem.flights, self.problem.orders, self.routes
        end = routes.length
        at = routes.time_s[np.arange(self.drones), end]
        last = routes.order[np.arange(self.drones), np.maximum(end - 1, 0)]
        place = np.where(end > 0, orders.destination[last], self.problem.fleet.place)
        slot = np.clip(((at - flights.start_s) / flights.slot_s).astype(int), 0, flights.time_s.shape[1] - 1)
        behind = at + flights.to_go_s[self.problem.fleet.empty_mode, slot, place, orders.origin[order]]
        way_s = flights.to_go_s[self.problem.fleet.empty_mode, slot, place, orders.origin[order]]
        least = self._least_arrivals(order)
        first = np.where(np.isfinite(least), behind, np.inf)
        score = np.maximum(first, orders.ready_s[order]) + 0.5 * way_s
        busy = np.isfinite(least) & (at > orders.due_s[order])  # the order may still fit in before
        score = np.where(busy, np.maximum(least, orders.ready_s[order]) + 600.0, score)
        chosen = np.argpartition(score, count)[:count]
        found: NDArray[np.int64] = chosen[np.isfinite(score[chosen])]
        return found

    def tried(self, order: int) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Return drones, the cost that an order adds to each, and its position in the route."""
        drones = self.candidates(order)
        added, position = np.empty(len(drones)), np.empty(len(drones), dtype=np.int64)
        p = self.problem
        insertions(p.flights, p.fleet, p.orders, p.weights, self.calendar, self.routes, self._silent, order, drones, added, position)  # fmt: skip
        return drones, added, position

    def lay_out(self, drone: int) -> bool:
        """Lay a route out again; the result is in `steps`."""
        p = self.problem
        if not lay_out(p.flights, p.fleet, p.orders, p.weights, self.calendar, self.routes, self.trace, drone):
            return False
        self.steps[drone] = self.trace.rows[: self.trace.filled[0]].copy()
        return True

    def change(self, drone: int, route: Sequence[int]) -> bool:
        """Give a drone another route; false, with nothing changed, if the route is infeasible."""
        before = self.saved(drone)
        if self.undo is not None:
            self.undo.saved.setdefault(drone, before)
        self.routes.order[drone, : len(route)] = route
        self.routes.length[drone] = len(route)
        if self.lay_out(drone):
            return True
        self.restore(drone, before)
        return False

    def saved(self, drone: int) -> Flown:
        """Return the state of a drone, for `restore`."""
        return Flown(tuple(getattr(self.routes, name)[drone].copy() for name in PARTS), self.steps[drone])

    def restore(self, drone: int, saved: Flown) -> None:
        """Restore the state of a drone."""
        unbook(self.calendar, self.routes, drone)
        self.put(drone, saved)

    def put(self, drone: int, saved: Flown) -> None:
        """Restore the state of a drone that holds no pads."""
        for name, value in zip(PARTS, saved.parts, strict=True):
            getattr(self.routes, name)[drone] = value
        self.steps[drone] = saved.steps
        rebook(self.calendar, self.routes, drone)

    def delivered_s(self, order: int) -> float:
        """Return the delivery time of an order, POSIX seconds; infinite if it is not served."""
        drone = int(self.drone_of[order])
        return math.inf if drone < 0 else float(self.routes.time_s[drone, self.route(drone).index(order) + 1])

    def all(self) -> Known:
        """Return the states of all drones, for `all_back`."""
        found = self._known()
        found.saved.update({drone: self.saved(drone) for drone in range(self.drones)})
        return found

    def _known(self) -> Known:
        halts = self.routes.halts
        return Known(self.drone_of.copy(), Halts(halts.place.copy(), halts.soc.copy()))

    def watch(self) -> None:
        """Record the states of drones before changes, from now on."""
        self.undo = self._known()

    def back(self) -> None:
        """Undo all changes since `watch`."""
        undo, self.undo = self.undo, None
        if undo is not None:
            self.all_back(undo)

    def all_back(self, known: Known) -> None:
        """Restore the states of some drones, and their orders."""
        for drone in known.saved:
            unbook(self.calendar, self.routes, drone)
        for drone, one in known.saved.items():
            self.put(drone, one)
        self.drone_of[:] = known.drone_of
        self.routes.halts.place[:], self.routes.halts.soc[:] = known.halts

    def route(self, drone: int) -> list[int]:
        """Orders of a drone."""
        return [int(one) for one in self.routes.order[drone, : self.routes.length[drone]]]

    def stops_near(self, order: int, phase: int, count: int) -> NDArray[np.int64]:
        """Return stops with pads near the origin of an order, on the way of its package, or near its destination."""
        flights, orders = self.problem.flights, self.problem.orders
        way = flights.to_go_s[0, 0]
        stops, origin, destination = flights.stops, orders.origin[order], orders.destination[order]
        if phase == HOME:
            return stops[np.argsort(way[destination, stops], kind="stable")[:count]]
        far = way[stops, origin] + (way[stops, destination] if phase else 0.0)
        return stops[np.argsort(far, kind="stable")[:count]]

    def settle(self, drone: int, order: int, phase: int) -> bool:
        """Select the charging stop of one drone at which its route costs least, for an order and phase; for its way home with its last order.

        The drone leaves a stop with the charge that the flight to the next goal needs, or with the present one if that needs another stop. False, with nothing
        booked, if the route is infeasible.
        """
        halts = self.routes.halts
        now = int(halts.place[order, phase]), float(halts.soc[order, phase])
        stops = self.stops_near(order, phase, STOPS_TRIED).tolist()
        tried = [now, (-1, 0.0), *((stop, self._enough(drone, order, phase, stop, now[1])) for stop in stops)]
        costs = []
        for halts.place[order, phase], halts.soc[order, phase] in tried:
            costs.append(float(self.routes.total[drone]) if self.lay_out(drone) else math.inf)
        halts.place[order, phase], halts.soc[order, phase] = tried[int(np.argmin(costs))]
        return min(costs) < math.inf and self.lay_out(drone)

    def spare_halts(self) -> None:
        """Leave out the stops that the search chose and that neither lower the cost of a route nor end it earlier."""
        halts = self.routes.halts
        for drone in range(self.drones):
            chosen = [
                (order, phase) for order in self.route(drone) for phase in range(3) if halts.place[order, phase] >= 0
            ]
            for order, phase in chosen:
                before, place = self.saved(drone), int(halts.place[order, phase])
                cost, end_s = float(self.routes.total[drone]), float(self.steps[drone][-1, END])
                halts.place[order, phase] = -1
                if not (
                    self.lay_out(drone) and self.routes.total[drone] <= cost and self.steps[drone][-1, END] <= end_s
                ):
                    halts.place[order, phase] = place
                    self.restore(drone, before)

    def _enough(self, drone: int, order: int, phase: int, stop: int, otherwise: float) -> float:
        """Charge of a flight from a stop to the next goal; `otherwise` if a full battery is too little."""
        flights, fleet, orders = self.problem.flights, self.problem.fleet, self.problem.orders
        goal = (orders.origin[order], orders.destination[order], fleet.home[drone])[phase]
        empty, loaded = fleet.empty_mode[drone], orders.mode[fleet.type[drone], order]
        mode, after = ((empty, loaded), (loaded, empty), (empty, empty))[phase]
        needs = flights.need[mode, :, stop, goal].min() + flights.escape[after, goal]
        enough = flights.reserve + float(fleet.scale[drone] * needs)
        return enough if enough <= 1.0 else otherwise

    def again(self, drones: Sequence[int]) -> bool:
        """Schedule the routes of some drones again, after the release of all their pads; false if one becomes infeasible."""
        for drone in drones:
            if self.undo is not None:
                self.undo.saved.setdefault(drone, self.saved(drone))
            unbook(self.calendar, self.routes, drone)
        return all(self.lay_out(drone) for drone in drones)

    def insert(self, order: int, drone: int, position: int) -> bool:
        """Insert an order into a route."""
        route = self.route(drone)
        if not self.change(drone, [*route[:position], order, *route[position:]]):
            return False
        self.drone_of[order] = drone
        return True

    def insert_best(self, order: int, noise: float = 0.0) -> bool:
        """Insert an order where it adds least cost, unless refusing it costs less; false if it is not inserted."""
        drones, added, position = self.tried(order)
        blurred = added * np.exp(noise * self.random.standard_normal(len(added)))
        for best in np.argsort(blurred)[:3]:
            if not added[best] < self.problem.orders.refusal_s[order]:
                return False
            if self.insert(order, int(drones[best]), int(position[best])):
                return True
        return False

    def insert_with_regret(self, waiting: list[int]) -> None:
        """Insert orders, each time the one with the greatest regret: the cost increase if its best drone is taken by another."""
        p = self.problem.orders
        known = {order: self.tried(order) for order in waiting}
        while known:
            regret: dict[int, float] = {}
            for order, (_, added, _) in known.items():
                two = np.sort(np.append(added, p.refusal_s[order]))[:2] if len(added) else np.zeros(2)
                regret[order] = float(two[1] - two[0])
            order = max(regret, key=lambda one: (regret[one], -one))
            drones, added, position = known.pop(order)
            best = int(np.argmin(added)) if len(added) else -1
            if best < 0 or not added[best] < p.refusal_s[order]:
                continue
            drone = int(drones[best])
            if not self.insert(order, drone, int(position[best])):
                continue
            for other, (theirs, _, _) in known.items():
                if drone in theirs:
                    known[other] = self.tried(other)

    def warm_up(self) -> None:
        """Call each kernel once, so that compilation, if needed, is not part of the search."""
        if self.orders and self.drones:
            self.tried(0)
            self.lay_out(0)

    def build(self, until_s: float = math.inf, promised: Collection[int] = ()) -> None:
        """Build initial routes: by priority and due time, with regret unless there are too many orders; after a time limit only promised ones."""
        waiting = [order for order in self._wanted if self.drone_of[order] < 0]
        if self.orders * min(self.drones, self.parameters.vehicles_tried) <= 2000:
            for refusal in sorted({float(self.problem.orders.refusal_s[one]) for one in waiting}, reverse=True):
                self.insert_with_regret([one for one in waiting if self.problem.orders.refusal_s[one] == refusal])
            return
        for order in waiting:
            if time.perf_counter() < until_s or order in promised:
                self.insert_best(order)

    def remove(self, orders: Sequence[int]) -> bool:
        """Remove orders from their routes; false if a route becomes infeasible without one."""
        for drone in {int(self.drone_of[one]) for one in orders if self.drone_of[one] >= 0}:
            if not self.change(drone, [one for one in self.route(drone) if one not in orders]):
                return False
        for one in orders:
            self.drone_of[one] = -1
        return True

    def polish(self) -> None:
        """Schedule each route once more on the pads that are now free; kept if it costs less."""
        for drone in np.flatnonzero(self.routes.length):
            before, cost = self.saved(int(drone)), float(self.routes.total[drone])
            if not self.lay_out(int(drone)) or self.routes.total[drone] > cost + 1e-9:
                self.restore(int(drone), before)
