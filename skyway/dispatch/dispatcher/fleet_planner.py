"""Planning of some orders with some drones around flights under way: available drones, pads and wind, and the routes in the form of the desk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.dispatch.records import LOST, PlannedPart, PlanStep
from skyway.models.base.units import from_posix
from skyway.models.orders.fitting import Work
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.dispatch.flight_plans import flights_of
from skyway.planner.dispatch.result import Step
from skyway.planner.promises.promises import promised as with_outlook

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from datetime import datetime

    from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
    from skyway.dispatch.dispatcher.seen_strangers import SeenStrangers
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.fleet_winds import FleetForecast
    from skyway.dispatch.region import Region
    from skyway.models.ledger.ledger import Hold
    from skyway.models.orders.order import Order, Vehicle
    from skyway.planner.dispatch.flight_plans import PlannedFlight
    from skyway.planner.dispatch.result import Answer

TURN_S = 60.0
"""Time from a landing until the next flight can begin, s."""
NEVER_REFUSED_S = 1e7
"""Cost of refusing such an order, s: more than any delay within a day."""


@dataclass(frozen=True)
class Planned:
    """A plan in the form of the desk: routes by drone, answers by order."""

    routes: dict[str, tuple[PlannedPart, ...]]
    answers: dict[str, Answer]


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
    ) -> Planned:
        """Plan around held windows; the search begins with the kept routes.

        `promised` has the promised times, `once_promised` all orders that ever had a promise; `max_late_s` is the permitted delay, s;
        orders are then served whenever that is possible.
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
            plan = with_outlook(work, plan, forecast, parameters, reserve=region.service.reserve, seed=seed, holds=holds, seen=self._pads.at(now_s), windows=True)  # fmt: skip
        routes = {route.drone: tuple(_part_of(one) for one in flights_of(route)) for route in plan.routes}
        return Planned(routes, {one.order: one for one in plan.answers})


def available(situation: Situation, now_s: float) -> dict[str, Vehicle]:
    """Return the drones available for planning, each with place and time of the end of its present flight."""
    found = {}
    for name, (state, drone) in situation.drones.items():
        if state == LOST or drone.aboard is not None:
            continue
        place, soc, from_s = drone.place, drone.soc, now_s
        if drone.flight is not None:
            flight = situation.flights[drone.flight][1]
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
