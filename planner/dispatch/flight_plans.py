"""Flights of a fleet's routes as compositions, so that they are flown, supervised and shown like those of one delivery.

A flight here is one part of a route: to the package, with it, or home, with the stops on its way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InfeasibleError
from skyway.models.base.units import S_PER_H
from skyway.models.composition.composition import State
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.request import Request
from skyway.planner.problem.speeds import MeanSpeeds
from skyway.planner.schedule.composing import compose
from skyway.planner.schedule.itinerary import Leg, fly_sampled, typical_member
from skyway.planner.schedule.outcome import outcome

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.dispatch.result import Phase, Route, Step
    from skyway.planner.parameters.planner import PlannerParameters


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """One part of a drone's route."""

    order: str | None
    """Order of the flight; None on the way home."""
    phase: Phase
    steps: tuple[Step, ...]

    @property
    def begin(self) -> datetime:
        """Beginning, with a charge or a take-off."""
        return self.steps[0].begin

    @property
    def end(self) -> datetime:
        """Time of the last landing."""
        return self.steps[-1].end

    @property
    def origin(self) -> str:
        """First place."""
        return self.steps[0].origin

    @property
    def destination(self) -> str:
        """Place of the last landing."""
        return self.steps[-1].destination


def flights_of(route: Route) -> list[PlannedFlight]:
    """Return the parts of a route, each to its last landing; charges of a part behind that, or without a flight, belong to the next part."""
    found: list[PlannedFlight] = []
    waiting: tuple[Step, ...] = ()
    for (order, phase), group in groupby(route.steps, key=lambda one: (one.order, one.phase)):
        steps = (*waiting, *group)
        end = max((number for number, one in enumerate(steps, 1) if one.kind == "fly"), default=0)
        waiting = steps[end:]
        if end:
            found.append(PlannedFlight(order, phase, steps[:end]))
    return found


def composed(
    scenario: Scenario,
    forecast: WindEnsemble,
    drone: str,
    payload_kg: float,
    flight: PlannedFlight,
    parameters: PlannerParameters,
    *,
    reserve: float,
) -> Composition:
    """Compose one part of a route, with its stations, winds and charges; a stop is left with the planned charge, and at the planned time without a charge.

    A drone that is to charge may come early, or with more charge than was planned: it does not stay on the pad until the planned time.

    Raises an `InfeasibleError` if it is infeasible in all winds of the forecast.
    """
    first = flight.steps[0]
    state = State(flight.begin, flight.origin, None, min(max(first.soc_begin, 0.0), 1.0))
    request = Request(state=state, destination=flight.destination, payload_kg=payload_kg, drone=drone, reserve_soc=reserve, escape=False)  # fmt: skip
    problem = Problem(scenario, request, scenario.drone(drone), forecast, parameters=parameters).thinned(
        parameters.robust.members
    )
    legs, charge = [], None
    for step in flight.steps:
        if step.kind == "charge":
            charge = min(step.soc_end, 1.0)
            continue
        segments = _way(problem, step, parameters.robust.speed_hours)
        legs.append(Leg(segments, charge, step.begin.timestamp() if charge is None else -math.inf))
        charge = None
    itinerary = tuple(legs)
    member, course = typical_member(problem, itinerary)
    result = outcome(problem, *fly_sampled(problem, itinerary, parameters.online.told_queues))
    return compose(problem, itinerary, course, member, result, planner="dispatch", planning_time_s=0.0)


def _way(problem: Problem, step: Step, hours: float) -> tuple[int, ...]:
    """Segments of the fastest path in the hour in which a flight begins, as in the dispatcher's tables."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    network, air = problem.network, problem.air
    slots = air.north.shape[1]
    slot = min(max(int((step.begin.timestamp() - air.start_s) / air.slot_s), 0), slots - 1)
    speeds = MeanSpeeds(air, problem.probability, max(hours, (slot + 1) * air.slot_s / S_PER_H))
    row = speeds.over(slot, slot, np.arange(len(network.tail)))[0]
    usable = np.flatnonzero(row > 0.0)
    weight = air.distance_m[usable] / row[usable]
    size = len(network)
    graph = csr_array((weight, (network.tail[usable], network.head[usable])), shape=(size, size))
    begin, end = network.index[step.origin], network.index[step.destination]
    _, before = dijkstra(graph, indices=np.array([begin]), return_predecessors=True)
    nodes = [end]
    while nodes[-1] != begin:
        if before[0, nodes[-1]] < 0:
            raise InfeasibleError(
                f"no way from {step.origin} to {step.destination} in the winds of that hour", constraint="wind"
            )
        nodes.append(int(before[0, nodes[-1]]))
    return _segments(problem, nodes[::-1], usable)


def _segments(problem: Problem, nodes: Sequence[int], usable: NDArray[np.int64]) -> tuple[int, ...]:
    network = problem.network
    found = []
    for tail, head in pairwise(nodes):
        among = usable[(network.tail[usable] == tail) & (network.head[usable] == head)]
        found.append(int(among[np.argmin(problem.air.distance_m[among])]))
    return tuple(found)
