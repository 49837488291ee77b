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
"""From a landing to when the next flight can begin."""
NEVER_REFUSED_S = 1e7
"""What refusing it would cost: more than any lateness of a day."""


@dataclass(frozen=True)
class Planned:
    """A plan as the desk takes it: routes by drone, answers by order."""

    routes: dict[str, tuple[PlannedPart, ...]]
    answers: dict[str, Answer]


class FleetPlanner:
    """Plans in the region of a service, in the wind as the fleet knows it, without the legs that are closed.

    Parameters
    ----------
    region : Region
        Where it is.
    air : FleetForecast
        The wind.
    legs : ClosedLegs
        Legs that are not planned.
    pads : SeenStrangers
        Who else is on the pads.
    time_limit_s : float
        How long a plan is bettered, of the wall's time.
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
        """Plan around the windows that are held; the search begins with the routes that are kept.

        `promised` has what was promised, `once_promised` orders that were promised anything ever; with `max_late_s` an order may be so
        late, and is served wherever it can be.
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
    """Return the drones that can be planned with, each where and when its flight under way will be over."""
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
