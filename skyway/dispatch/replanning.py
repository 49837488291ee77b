"""Planning around what is flying: what can be replanned, with which drones, and which promises that changes, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.dispatch.records import PlannedPart, PlanStep, Promise
from skyway.models.base.formatting import duration
from skyway.models.base.units import from_posix
from skyway.models.ledger.ledger import Hold
from skyway.models.ledger.window import Window
from skyway.models.orders.fitting import Work
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.dispatch.flight_plans import flights_of
from skyway.planner.dispatch.result import Step

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from datetime import datetime

    from skyway.dispatch.records import DroneRecord, FlightRecord, OrderRecord
    from skyway.dispatch.region import Region
    from skyway.models.orders.order import Order, Vehicle
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.dispatch.flight_plans import PlannedFlight
    from skyway.planner.dispatch.flights import Leg
    from skyway.planner.dispatch.result import Answer, DispatchPlan

WITH_PACKAGE, TO_PACKAGE, HOME = "with the package", "to the package", "home"
TURN_S = 60.0
"""From a landing to when the next flight can begin."""
PATIENT_S = 86_400.0
"""A package that is aboard is delivered however late."""
WHOLE_DAY_S = 86_400.0
NEVER_REFUSED_S = 1e7
"""What refusing it would cost: more than any lateness of a day."""
LEG_CLOSED_S = 600.0
"""A leg that was not begun is closed for so long at least."""


@dataclass
class Reasons:
    """Why it is replanned: sentences, those that concern a drone by its id."""

    general: list[str] = field(default_factory=list)
    of_drone: dict[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.general or self.of_drone)

    def why(self, drones: Sequence[str]) -> str:
        """Return why a promise of some drones was changed."""
        own = [self.of_drone[one] for one in drones if one in self.of_drone]
        found = own or self.general or list(self.of_drone.values())
        more = f"; and {len(found) - 2} reasons more" if len(found) > 2 else ""
        return "; ".join(found[:2]) + more


@dataclass(frozen=True)
class Planned:
    """A plan as the desk takes it."""

    routes: dict[str, tuple[PlannedPart, ...]]
    answers: dict[str, Answer]
    plan: DispatchPlan


def available(drones: Mapping[str, tuple[str, DroneRecord]], flights: Mapping[str, tuple[str, FlightRecord]], now_s: float) -> dict[str, Vehicle]:  # fmt: skip
    """Return the drones that can be planned with, each where and when its flight under way will be over."""
    found = {}
    for name, (state, drone) in drones.items():
        if state == "lost" or drone.aboard is not None:
            continue
        place, soc, from_s = drone.place, drone.soc, now_s
        if drone.flight is not None:
            flight = flights[drone.flight][1]
            last = flight.steps[-1]
            place, soc = last.destination, last.soc_end
            from_s = max(flight.end_s + flight.late_s, now_s) + TURN_S
        begin = drone.vehicle.available_from
        if begin is not None:
            from_s = max(from_s, begin.timestamp())
        found[name] = replace(
            drone.vehicle, place=place, soc=min(max(soc, 0.0), 1.0), available_from=from_posix(from_s)
        )
    return found


def plan_around(
    region: Region,
    now_s: float,
    orders: Sequence[Order],
    vehicles: Sequence[Vehicle],
    holds: Sequence[Hold],
    *,
    kept: Mapping[str, Sequence[PlannedPart]],
    promised: Mapping[str, datetime],
    once_promised: Collection[str] = (),
    time_limit_s: float,
    iterations: int,
    seed: int,
    air: tuple[WindEnsemble, Mapping[str, DepartureMargin]],
    closed: Mapping[Leg, float] | None = None,
    max_late_s: float | None = None,
) -> Planned:
    """Plan some orders with some drones, around the windows that are held; the search begins with what was planned before.

    `air` has the forecast that is known, and the margins that flights need in it; `closed` legs that are not flown before a time.
    """
    places = tuple(place for one in orders for place in (one.origin, one.destination)) + tuple(
        one.place for one in vehicles
    )
    scenario = region.with_places(places)
    parameters = region.planning
    if max_late_s is not None:
        patient = replace(parameters.dispatch, max_late_s=max_late_s, refusal_s=NEVER_REFUSED_S)
        parameters = replace(parameters, dispatch=patient)
    work = Work(scenario, tuple(orders), tuple(vehicles))
    before = {name: [step_of(one, part) for part in parts for one in part.steps] for name, parts in kept.items()}
    plan = dispatch(
        work, from_posix(now_s), forecast=air[0], margin_of=air[1], hope=region.forecast(now_s), holds=holds, reserve=region.service.reserve,
        time_limit_s=time_limit_s, iterations=iterations, seed=seed, parameters=parameters, kept=before,
        promised=promised, once_promised=once_promised, closed=closed, bounded=False,
    )  # fmt: skip
    routes = {route.drone: tuple(part_of(one) for one in flights_of(route)) for route in plan.routes}
    return Planned(routes, {one.order: one for one in plan.answers}, plan)


def part_of(flight: PlannedFlight) -> PlannedPart:
    """Return a part of a route as the desk keeps it."""
    steps = tuple(
        PlanStep(
            kind=one.kind, origin=one.origin, destination=one.destination, begin_s=one.begin.timestamp(), end_s=one.end.timestamp(),
            soc_begin=one.soc_begin, soc_end=one.soc_end, pad=one.pad,
        )
        for one in flight.steps
    )  # fmt: skip
    return PlannedPart(order=flight.order, phase=flight.phase, steps=steps)


def step_of(one: PlanStep, part: PlannedPart) -> Step:
    """Return a step as the planner has it."""
    return Step(
        kind=one.kind, order=part.order, phase=part.phase, origin=one.origin, destination=one.destination,  # type: ignore[arg-type]
        begin=from_posix(one.begin_s), end=from_posix(one.end_s), soc_begin=one.soc_begin, soc_end=one.soc_end, pad=one.pad,
    )  # fmt: skip


def promise_of(answer: Answer) -> Promise | None:
    """Return what an order is told; None where it is not served."""
    if answer.drone is None or answer.fetched is None or answer.delivered is None:
        return None
    return Promise(drone=answer.drone, fetched_s=answer.fetched.timestamp(), delivered_s=answer.delivered.timestamp())


def changed(before: Promise | None, after: Promise | None, tolerated_s: float) -> str:
    """Say how a promise changes for who was given it; nothing where it does not."""
    if before is None:
        return ""
    if after is None:
        return "it is not promised any more"
    later_s = after.delivered_s - before.delivered_s
    return f"{duration(later_s)} later" if later_s > tolerated_s else ""


def windows_of(steps: Sequence[PlanStep], late_s: float = 0.0, *, not_before_s: float = 0.0) -> list[Window]:
    """Return the windows of pads of some steps that are not over, as late as they are."""
    found = []
    for one in steps:
        if one.kind != "charge" or one.pad is None or one.end_s + late_s <= not_before_s or one.end_s <= one.begin_s:
            continue
        begin_s = one.begin_s if one.begin_s <= not_before_s else one.begin_s + late_s
        found.append(
            Window(station=one.origin, pad=one.pad, start=from_posix(begin_s), end=from_posix(one.end_s + late_s))
        )
    return found


def as_holds(itinerary: str, windows: Sequence[Window], holder: str) -> list[Hold]:
    """Return windows as a planner takes what is held."""
    return [Hold(itinerary, 0, number, one, "firm", holder, 0) for number, one in enumerate(windows, 1)]


def apart(
    wanted: Mapping[str, Sequence[Window]], pads: Mapping[str, int], taken: Sequence[Window] = ()
) -> dict[str, list[Window]]:
    """Put windows that overlap on one pad onto another one of the station, or behind each other.

    Flights that are late may want a pad that another was to have by then: who is first has it, as on the ground.
    """
    placed: list[Window] = list(taken)
    found: dict[str, list[Window]] = {name: [] for name in wanted}
    flat = sorted(
        ((one.start, name, one) for name, windows in wanted.items() for one in windows),
        key=lambda one: (one[0], one[1]),
    )
    for _, name, window in flat:
        numbers = [
            window.pad,
            *(number for number in range(1, pads.get(window.station, window.pad) + 1) if number != window.pad),
        ]
        options = [replace(window, pad=number) for number in numbers]
        best = next((one for one in options if not any(one.touches(other) for other in placed)), None)
        if best is None:
            best = min((_behind(one, placed) for one in options), key=lambda one: one.start)
        placed.append(best)
        found[name].append(best)
    return found


def _behind(window: Window, placed: Sequence[Window]) -> Window:
    """Return a window as late as those before it make it."""
    while True:
        met = [one.end for one in placed if window.touches(one)]
        if not met:
            return window
        begin = max(met)
        window = replace(window, start=begin, end=max(window.end, begin + (window.end - window.start)))


def ferry(drone: str, place: str, home: str, now_s: float, order: OrderRecord | None) -> Order:
    """Return an order that brings a drone on alone: with the package that is aboard, or home without any."""
    from skyway.models.orders.order import Order

    now = from_posix(now_s)
    if order is not None:
        due = max(order.order.due, from_posix(now_s + TURN_S))
        return replace(order.order, origin=place, ready=now, due=due)
    return Order(
        id=f"home of {drone}",
        origin=place,
        destination=home,
        mass_kg=0.0,
        ready=now,
        due=from_posix(now_s + WHOLE_DAY_S),
    )


class ClosedLegs:
    """Legs that the check before a take-off refused, not planned before the next hour of the forecast, by type of drone; forgotten with the process, then refused once more."""

    def __init__(self) -> None:
        self._until_s: dict[Leg, float] = {}

    def close(self, kind: str, steps: Sequence[PlanStep], station: str, forecast: WindEnsemble, now_s: float) -> tuple[Leg, float] | None:  # fmt: skip
        """Close the leg of a flight on which a drone was to leave a station; returns it with its time, POSIX seconds, where there is one."""
        flown = next((one for one in steps if one.kind == "fly" and one.origin == station), None)
        if flown is None:
            return None
        slot = math.floor((now_s + LEG_CLOSED_S - forecast.start_s) / forecast.slot_s) + 1
        leg, until_s = (kind, station, flown.destination), forecast.start_s + slot * forecast.slot_s
        self._until_s[leg] = until_s
        return leg, until_s

    def at(self, now_s: float) -> dict[Leg, float]:
        """Return what is closed at a time, and until when."""
        self._until_s = {leg: until_s for leg, until_s in self._until_s.items() if until_s > now_s}
        return dict(self._until_s)
