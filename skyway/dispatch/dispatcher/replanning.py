"""Replanning of open orders around flights under way, and booking; repeated once if others book in the meantime."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.fleet_planner import available, under_way
from skyway.dispatch.dispatcher.windows import as_holds, committed, out_of_order, to_book, windows_of
from skyway.dispatch.records import WITH_PACKAGE
from skyway.models.base.units import from_posix
from skyway.models.ledger.ledger import TakenError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.dispatch.dispatcher.bookings import Bookings
    from skyway.dispatch.dispatcher.fleet_planner import FleetPlanner
    from skyway.dispatch.dispatcher.promises import Promises
    from skyway.dispatch.dispatcher.reasons import Reasons
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import DroneRecord, OrderRecord, PlannedPart
    from skyway.models.ledger.ledger import Hold

RETRY_S = 600.0
"""Interval of new attempts for orders without a promise, s."""
ROUNDS = 5


class Replanning:
    """Plans all open orders with all drones that are available, or will be.

    Parameters
    ----------
    situation : Situation
        The state, changed here.
    planner : FleetPlanner
        The planner.
    promises : Promises
        Answers to orders.
    bookings : Bookings
        Bookings of pads.
    holder : str
        The dispatcher.
    iterations : int
        Iterations of the search.
    """

    def __init__(self, situation: Situation, planner: FleetPlanner, promises: Promises, bookings: Bookings, holder: str, iterations: int) -> None:  # fmt: skip
        self._situation, self._planner, self._promises, self._bookings = situation, planner, promises, bookings
        self._holder, self._iterations = holder, iterations
        self._planned_s: float | None = None
        self._plans = 0

    def note_waiting(self, now_s: float, why: Reasons) -> None:
        """Record whether orders wait for a promise and a new attempt is due."""
        waiting = any(state == "new" for state, _ in self._situation.orders.values())
        if waiting and (self._planned_s is None or now_s >= self._planned_s + RETRY_S):
            why.general.append("orders wait for a promise")

    def replan(self, now_s: float, why: Reasons) -> None:
        """Replan around present flights, and book; a `TakenError`: others book faster than this dispatcher plans."""
        self._planned_s = now_s
        self._plans += 1
        drones = [one for _, one in self._situation.drones.values()]
        planned_s = {part.order: part.end_s for one in drones for part in one.route if part.phase == WITH_PACKAGE}
        for number in range(ROUNDS):
            self._plan_orders(now_s, self._held(now_s), why, planned_s)
            try:
                self._bookings.bring_up_to_date(to_book(self._situation, now_s), now_s)
            except TakenError:
                if number == ROUNDS - 1:
                    raise
            else:
                return

    def _held(self, now_s: float) -> list[Hold]:
        """Return the windows to plan around: pads out of order, those of others, of flights, and of drones that are planned individually."""
        situation = self._situation
        flying = [
            hold
            for itinerary, windows in committed(situation, now_s).items()
            for hold in as_holds(itinerary, windows, self._holder)
        ]
        alone = [
            hold
            for name, (_, drone) in situation.drones.items()
            if drone.aboard is not None or _goes_home_only(drone)
            for part in drone.route
            for hold in as_holds(f"alone {name}", windows_of(part.steps, not_before_s=now_s), self._holder)
        ]
        return [*out_of_order(situation), *self._bookings.of_others(now_s), *flying, *alone]

    def _plan_orders(
        self, now_s: float, holds: list[Hold], why: Reasons, planned_s: Mapping[str | None, float]
    ) -> None:
        situation = self._situation
        carried = {flight.order for _, flight in situation.flights.values() if flight.phase == WITH_PACKAGE}
        pool = {
            name: one
            for name, (state, one) in situation.orders.items()
            if state in ("new", "promised", "under way") and name not in carried
        }
        vehicles = available(situation, now_s)
        if not pool:
            for name in vehicles:
                self._take_route(name, ())
            return
        if not vehicles:
            self._leave_waiting(pool)
            return
        made = self._planner.plan(
            now_s, [replace(one.order, origin=one.place) for one in pool.values()], list(vehicles.values()), holds,
            iterations=self._iterations, seed=self._plans, kept={name: situation.drones[name][1].route for name in vehicles},
            promised={name: from_posix(one.promise.delivered_s) for name, one in pool.items() if one.promise is not None},
            once_promised=[name for name, one in pool.items() if one.first is not None], begun=under_way(situation, now_s),
        )  # fmt: skip
        for name in vehicles:
            self._take_route(name, made.routes.get(name, ()))
        for name in pool:
            self._promises.answer(now_s, name, made.answers[name], why, planned_s.get(name))

    def _take_route(self, name: str, route: tuple[PlannedPart, ...]) -> None:
        """Give a drone its route; one without a route continues home if it was on its way there."""
        state, drone = self._situation.drones[name]
        if route or not _goes_home_only(drone):
            drone.route = route
        self._situation.change_drone(name, state, drone)

    def _leave_waiting(self, pool: dict[str, OrderRecord]) -> None:
        for name, one in pool.items():
            one.reason = "no drone is available"
            one.promise = None
            self._situation.change_order(name, "new", one)


def _goes_home_only(drone: DroneRecord) -> bool:
    return bool(drone.route) and all(part.order is None for part in drone.route)
