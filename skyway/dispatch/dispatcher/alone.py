"""Drones that are planned individually: those that stand with a package on its way, and idle ones away from home."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.fleet_planner import TURN_S
from skyway.dispatch.dispatcher.windows import as_holds, out_of_order, wanted
from skyway.dispatch.records import HOME, STANDING, WITH_PACKAGE, PlannedPart
from skyway.models.base.units import from_posix
from skyway.models.orders.order import Order

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.dispatcher.bookings import Bookings
    from skyway.dispatch.dispatcher.fleet_planner import FleetPlanner
    from skyway.dispatch.dispatcher.promises import Promises
    from skyway.dispatch.dispatcher.reasons import Reasons
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import DroneRecord, OrderRecord
    from skyway.models.ledger.ledger import Hold
    from skyway.planner.dispatch.result import Answer

AGAIN_S = 600.0
"""Interval, s, of new plans for a drone whose flight was not begun, or for which there is no route."""
ITERATIONS = 20
PATIENT_S = 86_400.0
"""A package on board is delivered however late."""
WHOLE_DAY_S = 86_400.0


class Alone:
    """Plans individual flights.

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
    say : callable
        Displays a line.
    """

    def __init__(
        self, situation: Situation, planner: FleetPlanner, promises: Promises, bookings: Bookings, holder: str,
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._situation, self._planner, self._promises, self._bookings = situation, planner, promises, bookings
        self._holder, self._say = holder, say
        self._tried_s: dict[tuple[str, str], float] = {}

    def note_packages(self, now_s: float, why: Reasons) -> None:
        """Record whether a standing drone has a package on board and a plan is due."""
        situation = self._situation
        carriers = [
            one.drone for state, one in situation.orders.values() if state == "aboard" and one.drone in situation.drones
        ]
        if any(self._is_time(one, now_s) for one in carriers):
            why.general.append("a package is on board a standing drone")

    def _is_time(self, name: str, now_s: float) -> bool:
        """Whether a plan for a drone is due: after a flight that was not begun, the same is not tried again at once."""
        return now_s >= self._tried_s.get((name, self._situation.drones[name][1].place), -AGAIN_S) + AGAIN_S

    def bring_on(self, now_s: float) -> None:
        """Plan for each drone that stands with a package, or away from home without a task."""
        for name, (state, drone) in list(self._situation.drones.items()):
            if state != STANDING or drone.flight is not None:
                continue
            _, order = self._situation.orders.get(drone.aboard or "", (None, None))
            if drone.route and (order is None or drone.route[0].order == drone.aboard):
                continue
            if order is None and drone.place == drone.vehicle.home:
                continue
            if not self._is_time(name, now_s):
                continue
            self._tried_s[name, drone.place] = now_s
            self._plan(now_s, name, drone, order)

    def _plan(self, now_s: float, name: str, drone: DroneRecord, order: OrderRecord | None) -> None:
        wanted = _order_on(name, drone, now_s, order)
        vehicle = replace(
            drone.vehicle, place=drone.place, soc=drone.soc, available_from=from_posix(now_s), available_to=None
        )
        made = self._planner.plan(
            now_s, [wanted], [vehicle], self._held(now_s), iterations=ITERATIONS, seed=0, max_late_s=PATIENT_S
        )
        route = made.routes.get(name, ())
        if order is None:
            drone.route = tuple(
                PlannedPart(order=None, phase=HOME, steps=part.steps) for part in route if part.phase == WITH_PACKAGE
            )
        elif route:
            drone.route = route
        else:
            self._leave_aboard(name, drone, order, made.answers[wanted.id])
        self._situation.change_drone(name, STANDING, drone)

    def _leave_aboard(self, name: str, drone: DroneRecord, order: OrderRecord, answer: Answer) -> None:
        """Leave a package on board until the next attempt; if that is hopeless, hand it over to a person."""
        id_ = order.order.id
        order.reason = f"on board {name} at {drone.place}: {answer.reason}"
        if not answer.hopeless:
            self._situation.change_order(id_, "aboard", order)
            return
        drone.aboard = None
        self._promises.hand_over(id_, order)
        self._say(f"{id_}: take it off {name} at {drone.place}")

    def _held(self, now_s: float) -> list[Hold]:
        """Return the windows to plan around: pads out of order, bookings of others, and all wanted windows."""
        own = [
            hold
            for itinerary, windows in wanted(self._situation, now_s).items()
            for hold in as_holds(itinerary, windows, self._holder)
        ]
        return [*out_of_order(self._situation), *self._bookings.of_others(now_s), *own]


def _order_on(name: str, drone: DroneRecord, now_s: float, order: OrderRecord | None) -> Order:
    """Return an order that moves a drone: with the package on board, or home without one."""
    now = from_posix(now_s)
    if order is not None:
        due = max(order.order.due, from_posix(now_s + TURN_S))
        return replace(order.order, origin=drone.place, ready=now, due=due)
    return Order(
        id=f"home of {name}",
        origin=drone.place,
        destination=drone.vehicle.home,
        mass_kg=0.0,
        ready=now,
        due=from_posix(now_s + WHOLE_DAY_S),
    )
