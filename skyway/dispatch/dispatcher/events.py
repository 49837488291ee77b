"""Events since the dispatcher's last step: flights that ended or are late, new orders, pads out of order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.dispatch.records import HANDED_OVER, LOST, STANDING, TO_PACKAGE, WITH_PACKAGE
from skyway.dispatch.requests import why_not, without_pads
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration
from skyway.models.orders.fitting import fit

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
    from skyway.dispatch.dispatcher.promises import Promises
    from skyway.dispatch.dispatcher.reasons import Reasons
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.records import DroneRecord, End, FlightRecord, Progress
    from skyway.models.scenario.scenario import Scenario

LATE_S = 120.0
"""Delay of a flight beyond that already planned with that causes a replan, s."""
HELD_UP_S = {"holding": 900.0, "lost-link": 900.0, "preparing": 7200.0}
"""Time, s, after which a drone that is held up, out of contact, or did not take off is handed over to a person."""


def _held_up_since_s(flight: FlightRecord, progress: Progress) -> float:
    """Return since when a drone is held up, POSIX seconds; before its first take-off it waits for its package until that is ready."""
    waits = progress.state == "preparing" and progress.flights == 0
    return max(progress.since_s, flight.not_before_s) if waits else progress.since_s


class Events:
    """Updates the state with new events, and collects reasons to replan.

    Parameters
    ----------
    situation : Situation
        The state, changed here.
    promises : Promises
        Answers to orders.
    legs : ClosedLegs
        Closed legs.
    scenario : Scenario
        Region of the orders.
    say : callable
        Displays a line.
    """

    def __init__(
        self, situation: Situation, promises: Promises, legs: ClosedLegs, scenario: Scenario, say: Callable[[str], None]
    ) -> None:
        self._situation, self._promises, self._legs, self._say = situation, promises, legs, say
        self._scenario = scenario
        self._pads_known: dict[str, str] | None = None

    def take_ends(self, now_s: float, why: Reasons) -> None:
        """Process flights that have ended."""
        for name, (state, flight) in list(self._situation.flights.items()):
            if state == "ended" and flight.end is not None:
                self._take_end(now_s, name, flight, flight.end, why)

    def _take_end(self, now_s: float, name: str, flight: FlightRecord, end: End, why: Reasons) -> None:
        situation = self._situation
        _, drone = situation.drones[flight.drone]
        safe = end.station is not None and end.state in ("delivered", "stopped-safe")
        drone.flight, drone.aboard = None, None
        drone.place = end.station or drone.place
        if end.soc is not None:
            drone.soc, drone.measured_s = end.soc, end.at_s
        if not safe:
            self._lose(flight.drone, drone, end.state, f"{end.state}: {end.reason}", why)
            drone.route = ()
        elif not end.arrived and situation.recalled(flight):
            if drone.route and drone.route[0].steps[0].origin != end.station:
                why.of_drone[flight.drone] = (
                    f"{flight.drone} stays at {end.station}: order {flight.order} was cancelled"
                )
                drone.route = ()
        elif not end.arrived:
            why.of_drone[flight.drone] = f"{flight.drone} stopped at {end.station}: {end.reason}"
            drone.route = ()  # the steps after it; its pads are free for others, and for itself
            self._legs.close(flight.type, flight.steps, drone.place, now_s)
        if flight.order is not None and situation.find_order(flight.order):
            self._take_end_of_order(flight.order, flight, end, safe=safe)
        situation.change_drone(flight.drone, STANDING if safe else LOST, drone)
        situation.close_flight(name)

    def _lose(self, name: str, drone: DroneRecord, what: str, reason: str, why: Reasons) -> None:
        drone.reason = reason
        why.of_drone[name] = f"{name} was lost ({what})"
        self._say(f"{name} is lost, a person must check it: {reason}")

    def _take_end_of_order(self, name: str, flight: FlightRecord, end: End, *, safe: bool) -> None:
        situation = self._situation
        state, order = situation.orders[name]
        if state == HANDED_OVER and not (flight.phase == WITH_PACKAGE and end.arrived and end.sure):
            return
        order.drone = None
        if flight.phase == TO_PACKAGE:
            situation.change_order(name, "promised" if end.arrived else "new", order)
        elif end.arrived and end.sure:
            order.delivered_s = end.at_s
            order.reason = ""  # of an earlier stop or delay
            late_s = end.at_s - order.order.due.timestamp()
            self._say(f"{name} delivered at {end.station}" + (f", {duration(late_s)} late" if late_s > 0.0 else ""))
            situation.change_order(name, "delivered", order)
        elif end.arrived or not safe or end.station is None:
            order.reason = f"{flight.drone}, {end.state}: {end.reason}"
            self._promises.hand_over(name, order)
        elif end.station == order.order.destination:  # no flyable leg is left
            order.reason = f"on board {flight.drone}, which stands at {end.station} already: {end.reason}"
            self._promises.hand_over(name, order)
        else:
            order.place, order.drone, order.reason = end.station, flight.drone, f"at {end.station}: {end.reason}"
            situation.drones[flight.drone][1].aboard = name
            situation.change_order(name, "aboard", order)

    def take_delays(self, now_s: float, why: Reasons) -> None:
        """Process increased delays of flights, and drones that were held up for too long."""
        situation = self._situation
        for name, (_, flight) in situation.flights.items():
            late_s = max(flight.late_s, now_s - flight.end_s if flight.progress is None else 0.0)
            if flight.progress is None and now_s > flight.begin_s + LATE_S:
                late_s = max(late_s, now_s - flight.begin_s)
            if late_s - situation.late_s.get(name, 0.0) >= LATE_S:
                why.delays_s[flight.drone] = late_s - situation.late_s.get(name, 0.0)
                situation.late_s[name] = late_s
                why.of_drone[flight.drone] = f"{flight.drone} is {duration(late_s)} late"
            progress = flight.progress
            state, drone = situation.drones[flight.drone]
            longest_s = math.inf if progress is None else HELD_UP_S.get(progress.state, math.inf)
            since_s = -math.inf if progress is None else _held_up_since_s(flight, progress)
            if progress is not None and now_s > since_s + longest_s and state != LOST:
                reason = f"{progress.state} for {duration(now_s - since_s)}"
                self._lose(flight.drone, drone, reason, reason, why)
                situation.change_drone(flight.drone, LOST, drone)
                if flight.order is not None and flight.order in situation.orders:
                    self._take_from(flight.order, flight, reason)

    def _take_from(self, name: str, flight: FlightRecord, reason: str) -> None:
        """Take an order from a drone that was held up; a package on board is handed over to a person."""
        order = self._situation.orders[name][1]
        order.reason = f"{flight.drone}: {reason}"
        if flight.phase == WITH_PACKAGE:
            self._promises.hand_over(name, order)
        else:
            order.drone = None
            self._situation.change_order(name, "new", order)

    def take_cancellations(self, now_s: float, why: Reasons) -> None:
        """Process requests to cancel orders: done, or refused if the package is aboard or the order was closed meanwhile."""
        situation = self._situation
        for name, (_, request) in list(situation.cancels.items()):
            state, order = situation.orders.get(name) or situation.closed_order(name)
            reason = why_not(name, state, order, (one for _, one in situation.flights.values()))
            situation.answer_cancel(name, reason)
            if reason:
                self._say(f"{name} cannot be cancelled: {reason}")
            else:
                self._promises.cancel(now_s, name, order, request.by)
                why.general.append(f"order {name} was cancelled")

    def take_orders(self, why: Reasons) -> None:
        """Process new orders; those that fit no drone, or have an unknown place, are refused."""
        situation = self._situation
        fresh = [
            name
            for name, (state, one) in situation.orders.items()
            if state == "new" and one.promise is None and not one.reason
        ]
        vehicles = [one.vehicle for _, one in situation.drones.values()]
        for name in fresh:
            record = situation.orders[name][1]
            try:
                found = fit(self._scenario, [record.order], vehicles)
            except InputError as error:
                record.reason = "; ".join(
                    f"{one.field or ''} {one.value or ''}: {one.problem}".strip() for one in error.faults[:3]
                )
                self._promises.refuse(name, record)
                continue
            record.order, record.place = found.orders[0], found.orders[0].origin
            if padless := without_pads(self._scenario.network, record.order):
                field, place = padless[0]
                record.reason = (
                    f"{field} {place}: has no pads; the drones of this service land only at stations with pads"
                )
                self._promises.refuse(name, record)
                continue
            record.reason = "not planned yet"
            situation.change_order(name, "new", record)
            why.general.append(f"order {name} came")

    def take_pads(self, now_s: float, why: Reasons) -> None:
        """Process pads that are newly out of order, and those that are back in service."""
        out = {
            name: f"{one.station} {one.pad}"
            for name, (_, one) in self._situation.pads.items()
            if one.from_s <= now_s < one.until_s
        }
        known, self._pads_known = self._pads_known, out
        if known is not None:
            why.general += [f"pad {one} is out of order" for name, one in out.items() if name not in known]
            why.general += [f"pad {one} is back" for name, one in known.items() if name not in out]
        elif out:
            why.general.append("pads are out of order")
