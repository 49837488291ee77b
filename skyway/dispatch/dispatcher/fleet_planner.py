"""Planning of some orders with some drones around flights under way: available drones, pads and wind, and the routes in the form of the desk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.windows import itinerary_name
from skyway.dispatch.records import LOST, WITH_PACKAGE, PlannedPart, PlanStep
from skyway.link.supervisor.states import IN_AIR
from skyway.models.base.units import from_posix
from skyway.models.orders.fitting import Work
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.dispatch.flight_plans import flights_of
from skyway.planner.dispatch.result import Route, Step
from skyway.planner.promises.promises import promised as with_outlook

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from datetime import datetime

    from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
    from skyway.dispatch.dispatcher.seen_strangers import SeenStrangers
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.fleet_winds import FleetForecast
    from skyway.dispatch.records import FlightRecord
    from skyway.dispatch.region import Region
    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.order import Order, Vehicle
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.departure_margin import DepartureMargin
    from skyway.planner.dispatch.flight_plans import PlannedFlight
    from skyway.planner.dispatch.result import Answer, DispatchPlan
    from skyway.planner.parameters.planner import PlannerParameters

TURN_S = 60.0
"""Time from a landing until the next flight can begin, s."""
NEVER_REFUSED_S = 1e7
"""Cost of refusing such an order, s: more than any delay within a day."""


@dataclass(frozen=True)
class Planned:
    """A plan in the form of the desk: routes by drone, answers by order."""

    routes: dict[str, tuple[PlannedPart, ...]]
    answers: dict[str, Answer]


@dataclass(frozen=True)
class Begun:
    """A flight under way, as far as its plan is still to be flown: promises are simulated from here on."""

    vehicle: Vehicle
    """The drone at its next landing, or where it stands: place, expected charge and time."""
    steps: tuple[Step, ...]
    """What follows there."""
    order: Order | None
    """Order whose package is on board, which is not planned any more."""
    itinerary: str
    """Booking of its windows."""
    in_air_s: float
    """Time until that landing, s; 0 where it stands."""


class FleetPlanner:
    """Plans in the region of a service, in the fleet's forecast, without closed legs.

    Parameters
    ----------
    region : Region
        The region.
    air : FleetForecast
        The forecast.
    legs : ClosedLegs
        Closed legs.
    pads : SeenStrangers
        Other drones on the pads.
    time_limit_s : float
        Wall time of the search.
    """

    def __init__(self, region: Region, air: FleetForecast, legs: ClosedLegs, pads: SeenStrangers, time_limit_s: float) -> None:  # fmt: skip
        self._region, self._air, self._legs, self._pads, self._time_limit_s = region, air, legs, pads, time_limit_s

    def plan(
        self,
        now_s: float,
        orders: Sequence[Order],
        vehicles: Sequence[Vehicle],
        holds: Sequence[Hold],
        *,
        iterations: int,
        seed: int,
        kept: Mapping[str, Sequence[PlannedPart]] | None = None,
        promised: Mapping[str, datetime] | None = None,
        once_promised: Collection[str] = (),
        max_late_s: float | None = None,
        begun: Sequence[Begun] = (),
    ) -> Planned:
        """Plan around held windows; the search begins with the kept routes.

        `promised` has the promised times, `once_promised` all orders that ever had a promise; `max_late_s` is the permitted delay, s;
        orders are then served whenever that is possible. `begun` has the flights under way, whose ends are not certain in the simulation of the plan.
        """
        region = self._region
        ends = tuple(place for one in orders for place in (one.origin, one.destination))
        scenario = region.with_places((*ends, *(one.place for one in vehicles)))
        parameters = region.planning
        if max_late_s is not None:
            patient = replace(parameters.dispatch, max_late_s=max_late_s, refusal_s=NEVER_REFUSED_S)
            parameters = replace(parameters, dispatch=patient)
        work = Work(scenario, tuple(orders), tuple(vehicles))
        before = {
            name: [step_of(one, part) for part in parts for one in part.steps] for name, parts in (kept or {}).items()
        }
        forecast, margin_of = self._air.at(now_s)
        plan = dispatch(
            work, from_posix(now_s), forecast=forecast, margin_of=margin_of, hope=region.forecast(now_s), holds=holds, reserve=region.service.reserve,
            time_limit_s=self._time_limit_s, iterations=iterations, seed=seed, parameters=parameters, kept=before,
            promised=promised or {}, once_promised=once_promised, closed=self._legs.at(now_s), bounded=False, seen=self._pads.at(now_s),
        )  # fmt: skip
        if max_late_s is None:
            plan = self._with_outlook(now_s, work, plan, forecast, parameters, margin_of, holds, begun, seed)
        routes = {route.drone: tuple(_part_of(one) for one in flights_of(route)) for route in plan.routes}
        return Planned(routes, {one.order: one for one in plan.answers})

    def _with_outlook(
        self, now_s: float, work: Work, plan: DispatchPlan, forecast: WindEnsemble, parameters: PlannerParameters, margin_of: Mapping[str, DepartureMargin],
        holds: Sequence[Hold], begun: Sequence[Begun], seed: int,
    ) -> DispatchPlan:  # fmt: skip
        """Simulate a plan from now on, with what is still to be flown of the flights under way before each drone's route."""
        of, own = {one.vehicle.id: one for one in begun}, {one.itinerary for one in begun}
        carried = tuple(one.order for one in begun if one.order is not None)
        missing = tuple(one.vehicle for one in begun if all(one.vehicle.id != each.id for each in work.vehicles))
        vehicles = (*(of[one.id].vehicle if one.id in of else one for one in work.vehicles), *missing)
        places = tuple(place for one in carried for place in (one.origin, one.destination))
        named = tuple(place for one in work.orders for place in (one.origin, one.destination))
        scenario = self._region.with_places((*named, *places, *(one.place for one in vehicles)))
        planned = {route.drone: route for route in plan.routes}
        routes = []
        for one in vehicles:
            before, route = of[one.id].steps if one.id in of else (), planned.get(one.id)
            steps = (*before, *(() if route is None else route.steps))
            routes.append(Route(drone=one.id, type=one.type, orders=() if route is None else route.orders, steps=steps))
        found = with_outlook(
            Work(scenario, (*work.orders, *carried), vehicles), replace(plan, routes=tuple(routes)), forecast, parameters, reserve=self._region.service.reserve,
            seed=seed, holds=[one for one in holds if one.itinerary not in own], seen=self._pads.at(now_s), windows=True, margin_of=margin_of,
            in_air_s={one.vehicle.id: one.in_air_s for one in begun if one.in_air_s > 0.0},
        )  # fmt: skip
        return replace(found, routes=plan.routes)


def under_way(situation: Situation, now_s: float) -> list[Begun]:
    """Return the flights under way of drones that are not lost."""
    found = []
    for flight in situation.flights.values():
        record = flight[1]
        state, drone = situation.drones[record.drone]
        if state == LOST:
            continue
        progress, part = record.progress, PlannedPart(order=record.order, phase=record.phase, steps=record.steps)
        ends = [number for number, one in enumerate(record.steps, 1) if one.kind == "fly"]
        place, soc, at_s, after = record.steps[0].origin, drone.soc, now_s, 0
        if progress is not None and progress.soc is not None and 0 < progress.flights <= len(ends):
            after = ends[progress.flights - 1]
            last, leg = record.steps[after - 1], record.composition["legs"][progress.flights - 1]
            place, soc = progress.station or last.destination, progress.soc
            if progress.state in IN_AIR:
                place, at_s = last.destination, max(last.end_s + progress.late_s, now_s)
                rate = (leg["soc_depart"] - leg["soc_arrive"]) / max(leg["flight_time_s"], 1.0)
                soc = progress.soc - rate * max(at_s - progress.at_s, 0.0)
        carried = situation.orders.get(record.order or "")
        order = None if carried is None or record.phase != WITH_PACKAGE else carried[1].order
        if order is not None:
            order = replace(order, origin=record.steps[0].origin)
        vehicle = replace(drone.vehicle, place=place, soc=min(max(soc, 0.0), 1.0), available_from=from_posix(at_s))
        steps = tuple(step_of(one, part) for one in situation.steps_of(record)[after:])
        found.append(Begun(vehicle, steps, order, itinerary_name(record.order, record.drone), at_s - now_s))
    return found


def available(situation: Situation, now_s: float) -> dict[str, Vehicle]:
    """Return the drones available for planning, each with place and time of the end of its present flight."""
    found = {}
    for name, (state, drone) in situation.drones.items():
        if state == LOST or drone.aboard is not None:
            continue
        place, soc, from_s = drone.place, drone.soc, now_s
        if drone.flight is not None:
            flight = situation.flights[drone.flight][1]
            place, soc, from_s = _end_of(flight, situation, now_s)
            from_s += TURN_S
        begin = drone.vehicle.available_from
        if begin is not None:
            from_s = max(from_s, begin.timestamp())
        found[name] = replace(
            drone.vehicle, place=place, soc=min(max(soc, 0.0), 1.0), available_from=from_posix(from_s)
        )
    return found


def _end_of(flight: FlightRecord, situation: Situation, now_s: float) -> tuple[str, float, float]:
    """Return where a flight ends, with which charge, and when, POSIX seconds."""
    progress, steps = flight.progress, situation.steps_of(flight)
    if progress is not None and progress.station is not None and situation.recalled(flight):
        return progress.station, flight.steps[0].soc_begin if progress.soc is None else progress.soc, now_s
    return steps[-1].destination, steps[-1].soc_end, max(steps[-1].end_s + flight.late_s, now_s)


def _part_of(flight: PlannedFlight) -> PlannedPart:
    """Return a part of a route in the form of the desk."""
    steps = tuple(
        PlanStep(
            kind=one.kind, origin=one.origin, destination=one.destination, begin_s=one.begin.timestamp(), end_s=one.end.timestamp(),
            soc_begin=one.soc_begin, soc_end=one.soc_end, pad=one.pad,
        )
        for one in flight.steps
    )  # fmt: skip
    return PlannedPart(order=flight.order, phase=flight.phase, steps=steps)


def step_of(one: PlanStep, part: PlannedPart) -> Step:
    """Return a step in the form of the planner."""
    return Step(
        kind=one.kind, order=part.order, phase=part.phase, origin=one.origin, destination=one.destination,  # type: ignore[arg-type]
        begin=from_posix(one.begin_s), end=from_posix(one.end_s), soc_begin=one.soc_begin, soc_end=one.soc_end, pad=one.pad,
    )  # fmt: skip
