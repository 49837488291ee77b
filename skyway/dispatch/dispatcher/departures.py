"""Departures: due flights are composed and given to workers; flights that are no longer possible are replanned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.fleet_planner import step_of
from skyway.dispatch.records import STANDING, WITH_PACKAGE, FlightRecord
from skyway.dispatch.worker import MOST
from skyway.models.base.errors import InfeasibleError
from skyway.models.composition.file import to_json
from skyway.planner.dispatch.flight_plans import PlannedFlight, composed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
    from skyway.dispatch.dispatcher.promises import Promises
    from skyway.dispatch.dispatcher.situation import Situation
    from skyway.dispatch.fleet_winds import FleetForecast
    from skyway.dispatch.records import DroneRecord, PlannedPart
    from skyway.dispatch.region import Region
    from skyway.models.composition.composition import Composition

TRIES = 3
"""Number of failed compositions after which an order is refused."""


class Departures:
    """Begins flights.

    Parameters
    ----------
    situation : Situation
        The state, changed here.
    promises : Promises
        Answers to orders.
    region, air : Region, FleetForecast
        Region and forecast.
    legs : ClosedLegs
        Closed legs.
    workers : sequence of str
        Names of the workers.
    """

    def __init__(
        self, situation: Situation, promises: Promises, region: Region, air: FleetForecast, legs: ClosedLegs, workers: Sequence[str]
    ) -> None:  # fmt: skip
        self._situation, self._promises, self._region, self._air, self._legs = situation, promises, region, air, legs
        self._workers = tuple(workers)
        self._failed: dict[str, int] = {}

    def begin_due(self, now_s: float) -> None:
        """Give due flights to workers, each to the one with the fewest."""
        situation = self._situation
        load = dict.fromkeys(self._workers, 0)
        for name in situation.flights:
            keeper = situation.board.keeper("flight", name)
            load[keeper] = load.get(keeper, 0) + 1
        for name, (state, drone) in situation.drones.items():
            if state != STANDING or drone.flight is not None or not drone.route or now_s < drone.route[0].begin_s:
                continue
            if drone.idle is not None:  # the pads did not answer: it is still on one
                continue
            keeper = min(load, key=lambda one: (load[one], one))
            if load[keeper] >= MOST:
                return
            if self._begin(now_s, name, drone, drone.route[0], keeper):
                load[keeper] += 1

    def _begin(self, now_s: float, name: str, drone: DroneRecord, part: PlannedPart, keeper: str) -> bool:
        situation = self._situation
        _, order = situation.orders.get(part.order or "", (None, None))
        loaded = order if part.phase == WITH_PACKAGE else None
        mass_kg = 0.0 if loaded is None else loaded.order.mass_kg
        ready_s = 0.0 if loaded is None or drone.aboard is not None else loaded.order.ready.timestamp()
        try:
            plan = self._composed(now_s, drone, part, mass_kg)
        except InfeasibleError as error:
            self._take_problem(now_s, name, drone, part, str(error))
            return False
        number = situation.next_flight
        record = FlightRecord(
            drone=name, type=drone.vehicle.type, system=drone.system, order=part.order, phase=part.phase, mass_kg=mass_kg,
            composition=to_json(plan), steps=part.steps, not_before_s=ready_s, journal=f"{number:06d}.jsonl",
        )  # fmt: skip
        situation.begin_flight(number, name, record, keeper)
        if order is not None:
            order.drone = name
            situation.change_order(order.order.id, "under way", order)
        return True

    def _composed(self, now_s: float, drone: DroneRecord, part: PlannedPart, mass_kg: float) -> Composition:
        region = self._region
        return composed(
            region.with_places((part.steps[0].origin, part.steps[-1].destination, drone.place)),
            self._air.at(now_s)[0],
            drone.vehicle.type,
            mass_kg,
            PlannedFlight(part.order, part.phase, tuple(step_of(one, part) for one in part.steps)),  # type: ignore[arg-type]
            region.planning,
            reserve=region.service.reserve,
        )

    def _take_problem(self, now_s: float, name: str, drone: DroneRecord, part: PlannedPart, problem: str) -> None:
        """Take back a flight that cannot be flown as planned; after `TRIES` failures its order is refused, or handed over to a person."""
        situation = self._situation
        drone.route = ()
        situation.change_drone(name, STANDING, drone)
        self._legs.close(drone.vehicle.type, part.steps, drone.place, now_s)
        if part.order is None or part.order not in situation.orders:
            return
        order = situation.orders[part.order][1]
        tries = self._failed[part.order] = self._failed.get(part.order, 0) + 1
        order.reason = f"it cannot be flown as planned: {problem}"
        aboard = drone.aboard == part.order
        if tries >= TRIES and aboard:
            drone.aboard = None
            self._promises.hand_over(part.order, order)
        elif tries >= TRIES:
            self._promises.refuse(part.order, order)
        elif not aboard:
            situation.change_order(part.order, "new", order)
