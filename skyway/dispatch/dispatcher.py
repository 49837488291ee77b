"""The dispatcher: takes orders, plans, books, gives flights to workers, and replans around what flies; all it knows lies on the desk."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.dispatch.bookings import Bookings
from skyway.dispatch.fleet_winds import FleetForecast
from skyway.dispatch.records import (
    ACTIVE,
    FLYING,
    LOST,
    OPEN,
    STANDING,
    Board,
    ChangeRecord,
    DroneRecord,
    FlightRecord,
    OrderRecord,
    PadRecord,
    PlannedPart,
)
from skyway.dispatch.replanning import (
    HOME,
    PATIENT_S,
    TO_PACKAGE,
    WITH_PACKAGE,
    ClosedLegs,
    Reasons,
    as_holds,
    available,
    changed,
    ferry,
    plan_around,
    promise_of,
    step_of,
    windows_of,
)
from skyway.dispatch.worker import MOST, worker_name
from skyway.models.base.errors import InfeasibleError, InputError, SkywayError
from skyway.models.base.formatting import duration
from skyway.models.base.units import from_posix
from skyway.models.composition.file import to_json
from skyway.models.ledger.ledger import Hold, TakenError
from skyway.models.ledger.window import Window
from skyway.models.orders.fitting import fit
from skyway.planner.dispatch.flight_plans import PlannedFlight, composed
from skyway.planner.dispatch.flights import latest_s
from skyway.planner.dispatch.improve import TOLERATED_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.leases import KeptLeases
    from skyway.dispatch.records import PlanStep
    from skyway.dispatch.region import Region
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.ledger import Lease
    from skyway.planner.dispatch.result import Answer

LATE_S = 120.0
"""A flight that is later by so much than was planned with is replanned around."""
RETRY_S = 600.0
"""Orders that are not promised are tried again so often."""
ROUNDS = 5
TRIES = 3
"""An order whose flights cannot be composed so often is refused."""
HELD_UP_S = {"holding": 900.0, "lost-link": 900.0, "preparing": 7200.0}
"""A drone that was held up, out of contact, or did not take off for so long is left to a person."""


class Dispatcher:
    """One dispatcher; `step` does what is due at an instant.

    Parameters
    ----------
    region : Region
        Where it is, and in which wind.
    desk : Desk
        Its desk; its ledger is that of the bookings.
    leases : KeptLeases
        Which keep its lease.
    workers : int
        To how many workers flights are given.
    plan_s, iterations : float, int
        How long a plan is bettered, of the wall's time, or by how many changes tried.
    say : callable
        Takes lines for people.
    """

    def __init__(
        self, region: Region, desk: Desk, leases: KeptLeases, *, workers: int, plan_s: float = 2.0, iterations: int = 10**9,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:  # fmt: skip
        self.region, self.desk, self.leases = region, desk, leases
        self.workers, self.plan_s, self.iterations, self.say = workers, plan_s, iterations, say
        self.board = Board(desk)
        self._booked = Bookings(
            desk.ledger, desk.dispatcher, {one.id: one.pads for one in region.base.network.stations}
        )
        self._air = FleetForecast(region)
        self._legs = ClosedLegs()
        self._counted_late: dict[str, float] = {}
        self._pads_known: dict[str, str] | None = None
        self._retried_s: float | None = None
        self._failed: dict[str, int] = {}
        self._brought: dict[tuple[str, str], float] = {}
        self.plans = 0
        self.orders: dict[str, tuple[str, OrderRecord]] = {}
        self.drones: dict[str, tuple[str, DroneRecord]] = {}
        self.flights: dict[str, tuple[str, FlightRecord]] = {}
        self.pads: dict[str, tuple[str, PadRecord]] = {}

    @property
    def lease(self) -> Lease:
        """Its lease; a `FencedError` says that another dispatcher has taken over."""
        self.leases.confirm(self.desk.dispatcher)
        kept = self.leases.kept(self.desk.dispatcher)
        if kept is None:
            raise SkywayError("the lease of the dispatcher is lost")
        return kept

    def step(self, now_s: float) -> None:
        """Look at what has happened, and do what is due."""
        board = self.board
        board.forget_changes()
        self.orders = board.read("order", OrderRecord, OPEN)
        self.drones = board.read("drone", DroneRecord)
        self.flights = board.read("flight", FlightRecord, (*ACTIVE, "ended"))
        self.pads = board.read("pad", PadRecord, ("out",))
        why = Reasons()
        self._air.hear(one for _, one in self.flights.values())
        self._take_ends(now_s, why)
        self._take_progress(now_s, why)
        self._take_orders(now_s, why)
        self._take_pads(now_s, why)
        if why:
            self._plan(now_s, why)
        else:
            self._bring_on(now_s)
        self._begin_due(now_s)
        self._close(now_s)
        board.write(self.lease)
        self._booked.bring_up_to_date(self.lease, self._wanted(now_s), now_s)

    # What has happened

    def _order(self, name: str, state: str, record: OrderRecord) -> None:
        self.orders[name] = (state, record)
        self.board.change("order", name, state, record)

    def _drone(self, name: str, state: str, record: DroneRecord) -> None:
        self.drones[name] = (state, record)
        self.board.change("drone", name, state, record)

    def _take_ends(self, now_s: float, why: Reasons) -> None:
        for name, (state, flight) in list(self.flights.items()):
            if state != "ended" or flight.end is None:
                continue
            end = flight.end
            _, drone = self.drones[flight.drone]
            safe = end.station is not None and end.state in ("delivered", "stopped-safe")
            drone.flight, drone.aboard = None, None
            drone.place = end.station or drone.place
            drone.soc = drone.soc if end.soc is None else end.soc
            if not safe:
                drone.reason = f"{end.state}: {end.reason}"
                why.of_drone[flight.drone] = f"{flight.drone} was lost ({end.state})"
                self.say(f"{flight.drone} is lost, a person must look at it: {drone.reason}")
                drone.route = ()
            elif not end.arrived:
                why.of_drone[flight.drone] = f"{flight.drone} stopped at {end.station}: {end.reason}"
                drone.route = ()  # what was to come after it; its pads are free for others, and for itself
                self._close_leg(flight.type, flight.steps, drone.place, now_s)
            if flight.order is not None and flight.order in self.orders:
                self._order_after(flight, safe=safe)
            elif flight.order is not None:  # it was given up before
                pass
            self._drone(flight.drone, STANDING if safe else LOST, drone)
            self.board.change("flight", name, "closed", flight)
            del self.flights[name]
            self._counted_late.pop(name, None)

    def _close_leg(self, kind: str, steps: tuple[PlanStep, ...], station: str, now_s: float) -> None:
        """Plan without a leg that was not begun until the wind is another one; the same would not be begun again."""
        found = self._legs.close(kind, steps, station, self.region.forecast(now_s), now_s)
        if found is not None:
            (_, _, destination), until_s = found
            self.say(f"{kind}: {station} to {destination} is not planned for {duration(until_s - now_s)}")

    def _order_after(self, flight: FlightRecord, *, safe: bool) -> None:
        end, name = flight.end, flight.order or ""
        if end is None:
            return
        _, order = self.orders[name]
        order.drone = None
        if flight.phase == TO_PACKAGE:
            self._order(name, "promised" if end.arrived else "new", order)
            return
        if end.arrived and end.sure:
            order.delivered_s = end.at_s
            late_s = end.at_s - order.order.due.timestamp()
            self.say(f"{name} delivered at {end.station}" + (f", {duration(late_s)} late" if late_s > 0.0 else ""))
            self._order(name, "delivered", order)
        elif end.arrived or not safe or end.station is None:
            order.reason = f"{flight.drone}, {end.state}: {end.reason}"
            self._hand_over(name, order)
        else:
            order.place, order.drone, order.reason = end.station, flight.drone, f"at {end.station}: {end.reason}"
            self.drones[flight.drone][1].aboard = name
            self._order(name, "aboard", order)

    def _hand_over(self, name: str, order: OrderRecord) -> None:
        self.say(f"{name} is for a person: {order.reason}")
        self._order(name, "handed to a person", order)

    def _take_progress(self, now_s: float, why: Reasons) -> None:
        for name, (_, flight) in self.flights.items():
            late_s = max(flight.late_s, now_s - flight.end_s if flight.progress is None else 0.0)
            if flight.progress is None and now_s > flight.begin_s + LATE_S:
                late_s = max(late_s, now_s - flight.begin_s)
            if late_s - self._counted_late.get(name, 0.0) >= LATE_S:
                self._counted_late[name] = late_s
                why.of_drone[flight.drone] = f"{flight.drone} is {duration(late_s)} late"
            told = flight.progress
            state, drone = self.drones[flight.drone]
            longest_s = math.inf if told is None else HELD_UP_S.get(told.state, math.inf)
            if told is not None and now_s > told.since_s + longest_s and state != LOST:
                drone.reason = f"{told.state} for {duration(now_s - told.since_s)}"
                self._drone(flight.drone, LOST, drone)
                why.of_drone[flight.drone] = f"{flight.drone} was lost ({drone.reason})"
                self.say(f"{flight.drone} is lost, a person must look at it: {drone.reason}")
                if flight.order is not None and flight.order in self.orders:
                    order = self.orders[flight.order][1]
                    order.reason = f"{flight.drone}: {drone.reason}"
                    if flight.phase == WITH_PACKAGE:
                        self._hand_over(flight.order, order)
                    else:
                        order.drone = None
                        self._order(flight.order, "new", order)

    def _take_orders(self, now_s: float, why: Reasons) -> None:
        fresh = [
            name
            for name, (state, one) in self.orders.items()
            if state == "new" and one.promise is None and not one.reason
        ]
        vehicles = [one.vehicle for _, one in self.drones.values()]
        for name in fresh:
            record = self.orders[name][1]
            try:
                found = fit(self.region.base, [record.order], vehicles)
            except InputError as error:
                record.reason = "; ".join(
                    f"{one.field or ''} {one.value or ''}: {one.problem}".strip() for one in error.faults[:3]
                )
                self._order(name, "refused", record)
                self.say(f"{name} refused: {record.reason}")
                continue
            record.order, record.place = found.orders[0], found.orders[0].origin
            record.reason = "not planned yet"
            self._order(name, "new", record)
            why.general.append(f"order {name} came")
        waiting = any(state == "new" for state, _ in self.orders.values())
        if waiting and (self._retried_s is None or now_s >= self._retried_s + RETRY_S):
            why.general.append("orders wait for a promise")
        carriers = [one.drone for state, one in self.orders.values() if state == "aboard" and one.drone in self.drones]
        if any(self._may_bring_on(one, now_s) for one in carriers):
            why.general.append("a package is aboard a drone that stands")

    def _take_pads(self, now_s: float, why: Reasons) -> None:
        out = {
            name: f"{one.station} {one.pad}"
            for name, (_, one) in self.pads.items()
            if one.from_s <= now_s < one.until_s
        }
        if self._pads_known is not None and out != self._pads_known:
            why.general += [f"pad {one} is out of order" for name, one in out.items() if name not in self._pads_known]
            why.general += [f"pad {one} is back" for name, one in self._pads_known.items() if name not in out]
        elif self._pads_known is None and out:
            why.general.append("pads are out of order")
        self._pads_known = out

    # Planning

    def _committed(self, now_s: float) -> dict[str, list[Window]]:
        """Windows of flights that have begun, by the itinerary they are booked as."""
        found: dict[str, list[Window]] = {}
        for name, (_, flight) in self.flights.items():
            windows = windows_of(flight.steps, self._counted_late.get(name, 0.0), not_before_s=now_s)
            found.setdefault(_itinerary(flight.order, flight.drone), []).extend(windows)
        return found

    def _wanted(self, now_s: float) -> dict[str, list[Window]]:
        """Windows that are to be booked, by itinerary."""
        found = self._committed(now_s)
        for name, (_, drone) in self.drones.items():
            last = None
            for part in drone.route:
                last = part.order or last
                key = _itinerary(part.order or last, name)
                found.setdefault(key, []).extend(windows_of(part.steps, not_before_s=now_s))
        return found

    def _dead(self) -> list[Hold]:
        return [
            hold
            for name, (_, one) in self.pads.items()
            for hold in as_holds(f"out of order {name}", [Window(station=one.station, pad=one.pad, start=from_posix(one.from_s), end=from_posix(one.until_s))], "out of order")
        ]  # fmt: skip

    def _plan(self, now_s: float, why: Reasons) -> None:
        """Replan around what flies, and book it; around what others book meanwhile once more."""
        self._retried_s = now_s
        self.plans += 1
        self._bring_on(now_s)
        for number in range(ROUNDS):
            dead = self._dead()
            others = self._booked.of_others(now_s)
            committed = [
                hold
                for key, windows in self._committed(now_s).items()
                for hold in as_holds(key, windows, self.desk.dispatcher)
            ]
            solo = [
                hold
                for name, (_, drone) in self.drones.items()
                if drone.aboard is not None or _goes_home_only(drone)
                for part in drone.route
                for hold in as_holds(f"alone {name}", windows_of(part.steps, not_before_s=now_s), self.desk.dispatcher)
            ]
            self._plan_orders(now_s, [*dead, *others, *committed, *solo], why)
            try:
                self._booked.bring_up_to_date(self.lease, self._wanted(now_s), now_s)
            except TakenError:
                if number == ROUNDS - 1:
                    raise
                continue
            return

    def _plan_orders(self, now_s: float, holds: list[Hold], why: Reasons) -> None:
        carried = {flight.order for _, flight in self.flights.values() if flight.phase == WITH_PACKAGE}
        pool = {
            name: one
            for name, (state, one) in self.orders.items()
            if state in ("new", "promised", "under way") and name not in carried
        }
        vehicles = available(self.drones, self.flights, now_s)
        if not pool:
            for name in vehicles:
                drone = self.drones[name][1]
                if drone.route and not _goes_home_only(drone):
                    drone.route = ()
                    self._drone(name, self.drones[name][0], drone)
            return
        kept = {name: self.drones[name][1].route for name in vehicles}
        promised = {name: from_posix(one.promise.delivered_s) for name, one in pool.items() if one.promise is not None}
        orders = [replace(one.order, origin=one.place) for one in pool.values()]
        if not vehicles:
            for name, one in pool.items():
                one.reason = "no drone is left"
                one.promise = None
                self._order(name, "new", one)
            return
        air = self._air.at(now_s)
        made = plan_around(
            self.region, now_s, orders, list(vehicles.values()), holds, kept=kept, promised=promised,
            once_promised=[name for name, one in pool.items() if one.first is not None], air=air,
            closed=self._legs.at(now_s),
            time_limit_s=self.plan_s, iterations=self.iterations, seed=self.plans,
        )  # fmt: skip
        for name in vehicles:
            state, drone = self.drones[name]
            route = made.routes.get(name, ())
            if route or not _goes_home_only(drone):
                drone.route = route
            self._drone(name, state, drone)
        for name, order in pool.items():
            self._tell_order(now_s, name, order, made.answers[name], why)

    def _tell_order(self, now_s: float, name: str, order: OrderRecord, answer: Answer, why: Reasons) -> None:
        before, after = order.promise, promise_of(answer)
        how = changed(before, after, TOLERATED_S)
        if how:
            order.changes += 1
            drones = [one.drone for one in (before, after) if one is not None]
            reason = f"{how}: {why.why(drones)}"
            number = f"{name} {order.changes}"
            self.board.change(
                "change", number, "told", ChangeRecord(at_s=now_s, order=name, before=before, after=after, why=reason)
            )
            self.say(f"{name}: {reason}")
        if after is not None and (
            before is None or how or after.drone != before.drone or after.delivered_s < before.delivered_s - TOLERATED_S
        ):
            order.promise = after
            order.first = order.first or after
        elif after is None:
            order.promise = None
        state = self.orders[name][0]
        flying = any(flight.order == name for _, flight in self.flights.values())
        order.reason = "" if after is not None else answer.reason or "not planned"
        if answer.hopeless and not flying:
            self.say(f"{name} refused: {order.reason}")
            self._order(name, "refused", order)
            return
        self._order(name, state if flying else "promised" if after is not None else "new", order)

    def _may_bring_on(self, name: str, now_s: float) -> bool:
        """Whether it is time to plan for a drone alone: where its flight on was not begun, the same is not tried again at once."""
        return now_s >= self._brought.get((name, self.drones[name][1].place), -RETRY_S) + RETRY_S

    def _bring_on(self, now_s: float) -> None:
        """Plan for each drone alone that stands with a package, or away from home without anything to do."""
        for name, (state, drone) in list(self.drones.items()):
            if state != STANDING or drone.flight is not None:
                continue
            order = self.orders.get(drone.aboard or "")
            if drone.route and (order is None or drone.route[0].order == drone.aboard):
                continue
            if order is None and drone.place == drone.vehicle.home:
                continue
            if not self._may_bring_on(name, now_s):
                continue
            self._brought[name, drone.place] = now_s
            wanted = ferry(name, drone.place, drone.vehicle.home, now_s, None if order is None else order[1])
            vehicle = replace(
                drone.vehicle, place=drone.place, soc=drone.soc, available_from=from_posix(now_s), available_to=None
            )
            holds = [*self._dead(), *self._booked.of_others(now_s)]
            holds += [
                hold
                for key, windows in self._wanted(now_s).items()
                for hold in as_holds(key, windows, self.desk.dispatcher)
            ]
            made = plan_around(
                self.region, now_s, [wanted], [vehicle], holds, kept={}, promised={}, time_limit_s=self.plan_s, iterations=20,
                air=self._air.at(now_s), closed=self._legs.at(now_s), seed=0, max_late_s=PATIENT_S,
            )  # fmt: skip
            route = made.routes.get(name, ())
            if order is None:
                drone.route = tuple(
                    PlannedPart(order=None, phase=HOME, steps=part.steps)
                    for part in route
                    if part.phase == WITH_PACKAGE
                )
            elif not route and not made.answers[wanted.id].hopeless:
                order[1].reason = f"aboard {name} at {drone.place}: {made.answers[wanted.id].reason}"
                self._order(order[1].order.id, "aboard", order[1])  # tried again, see `_may_bring_on`
            elif not route:
                record = order[1]
                record.reason = f"aboard {name} at {drone.place}: {made.answers[wanted.id].reason}"
                drone.aboard = None
                self._hand_over(drone_order := record.order.id, record)
                self.say(f"{drone_order}: take it off {name} at {drone.place}")
            else:
                drone.route = route
            self._drone(name, state, drone)

    # Doing

    def _begin_due(self, now_s: float) -> None:
        """Give flights that are due to workers."""
        load = {worker_name(self.desk.dispatcher, number): 0 for number in range(1, self.workers + 1)}
        for name in self.flights:
            keeper = self.board.keeper("flight", name)
            load[keeper] = load.get(keeper, 0) + 1
        for name, (state, drone) in self.drones.items():
            if state != STANDING or drone.flight is not None or not drone.route or now_s < drone.route[0].begin_s:
                continue
            part = drone.route[0]
            keeper = min(load, key=lambda one: (load[one], one))
            if load[keeper] >= MOST:
                return
            if self._begin(now_s, name, drone, part, keeper):
                load[keeper] += 1

    def _begin(self, now_s: float, name: str, drone: DroneRecord, part: PlannedPart, keeper: str) -> bool:
        order = self.orders.get(part.order or "")
        mass_kg = order[1].order.mass_kg if order is not None and part.phase == WITH_PACKAGE else 0.0
        ready_s = (
            order[1].order.ready.timestamp()
            if order is not None and part.phase == WITH_PACKAGE and drone.aboard is None
            else 0.0
        )
        flight = PlannedFlight(part.order, part.phase, tuple(step_of(one, part) for one in part.steps))  # type: ignore[arg-type]
        scenario = self.region.with_places((part.steps[0].origin, part.steps[-1].destination, drone.place))
        try:
            plan = composed(
                scenario,
                self._air.at(now_s)[0],
                drone.vehicle.type,
                mass_kg,
                flight,
                self.region.planning,
                reserve=self.region.service.reserve,
            )
        except InfeasibleError as error:
            self._not_composed(now_s, name, drone, part, str(error))
            return False
        number = self.board.count("flight") + 1
        id_ = f"{number:06d} {name}"
        record = FlightRecord(
            drone=name, type=drone.vehicle.type, system=drone.system, order=part.order, phase=part.phase, mass_kg=mass_kg,
            composition=to_json(plan), steps=part.steps, not_before_s=ready_s, journal=f"{number:06d}.jsonl",
        )  # fmt: skip
        self.flights[id_] = ("ordered", record)
        self.board.change("flight", id_, "ordered", record, keeper=keeper)
        drone.flight, drone.route = id_, drone.route[1:]
        self._drone(name, FLYING, drone)
        if order is not None:
            order[1].drone = name
            self._order(part.order or "", "under way", order[1])
        return True

    def _not_composed(self, now_s: float, name: str, drone: DroneRecord, part: PlannedPart, problem: str) -> None:
        """Replan what cannot be flown as it was planned; after some times it is refused, or left to a person."""
        drone.route = ()
        self._drone(name, STANDING, drone)
        self._close_leg(drone.vehicle.type, part.steps, drone.place, now_s)
        if part.order is None or part.order not in self.orders:
            return
        record = self.orders[part.order][1]
        tries = self._failed[part.order] = self._failed.get(part.order, 0) + 1
        record.reason = f"it cannot be flown as planned: {problem}"
        if tries >= TRIES and drone.aboard == part.order:
            drone.aboard = None
            self._hand_over(part.order, record)
        elif tries >= TRIES:
            self._order(part.order, "refused", record)
        elif drone.aboard != part.order:
            self._order(part.order, "new", record)

    def _close(self, now_s: float) -> None:
        """Refuse what cannot be served any more."""
        weigh = self.region.planning.dispatch
        for name, (state, record) in list(self.orders.items()):
            if state == "new" and now_s > latest_s(record.order, weigh, promised=record.first is not None):
                self._order(name, "refused", record)
                self.say(f"{name} refused: {record.reason}")

    @property
    def busy(self) -> bool:
        """Whether any order is open, or any drone has something to do."""
        open_orders = any(state in OPEN for state, _ in self.orders.values())
        moving = any(state != LOST and (one.flight is not None or one.route) for state, one in self.drones.values())
        return open_orders or moving or bool(self.flights)


def _itinerary(order: str | None, drone: str) -> str:
    return order or f"home of {drone}"


def _goes_home_only(drone: DroneRecord) -> bool:
    return bool(drone.route) and all(part.order is None for part in drone.route)
