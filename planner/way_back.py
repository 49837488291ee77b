"""The way back: the drone after the delivery, and a package that cannot be delivered.

It is planned by the planner of the delivery, from the target, at the hour when the drone leaves it and with the charge that it has there.
From a target with pads the drone charges first. From one without pads it leaves with what it came with: the delivery is planned so
that this is enough for the flight to a station (`planner.problem.ways_on`). Where the way back shows that a station will not do to begin
it with, the delivery is planned again without that station.
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING

from skyway.models.base.errors import InfeasibleError, NoRouteError
from skyway.models.base.formatting import share
from skyway.models.composition.composition import Composition, State, WayBack
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.request import NO_RETURN
from skyway.planner.problem.ways_on import return_node, undelivered_node

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.request import Request
    from skyway.planner.result import PlanResult

    Compose = Callable[[Scenario, Request], PlanResult]

MOST_ROUNDS = 6
"""Times that a delivery is planned, each without the stations that the way back could not begin with before."""
_ROUNDING_SOC = 1e-7
"""What just suffices, suffices."""
MOST_PADS = 8
"""Of the pads near the target so many are looked at."""


class NoWayBackError(NoRouteError):
    """There is no way back after a delivery."""

    def __init__(self, message: str, *, constraint: str, by: frozenset[str]) -> None:
        super().__init__(message, constraint=constraint)
        self.by = by
        """Stations that the way back could have begun with."""


def plan_there_and_back(scenario: Scenario, request: Request, compose: Compose) -> PlanResult:
    """Plan a delivery, and what becomes of the drone and of an undelivered package.

    `compose` plans a request without either. An `InfeasibleError` says why there is no delivery, or no way back.
    """
    asked = request
    error: NoWayBackError | None = None
    for _ in range(MOST_ROUNDS):
        try:
            result = compose(scenario, asked)
        except InfeasibleError:
            if error is not None:
                raise error from None
            raise
        try:
            return with_way_back(result, compose)
        except NoWayBackError as found:
            error = found
            fresh = found.by - set(asked.not_back_by)
            if not fresh:
                break
            asked = replace(asked, not_back_by=(*asked.not_back_by, *sorted(fresh)))
    if error is None:
        raise AssertionError
    raise error


def with_way_back(result: PlanResult, compose: Compose) -> PlanResult:
    """Return a delivery with its way back. Raises a `NoWayBackError` if there is none."""
    problem, c = result.problem, result.composition
    request = problem.request
    stations = problem.network.stations
    back = undelivered = None
    node, carried = return_node(problem), undelivered_node(problem)
    stays = node == problem.destination or (node is None and not problem.needs_escape) or not request.escape
    if not stays:
        ends = [stations[node].id] if node is not None else _nearest_pads(result)
        back = _first(result, compose, ends, 0.0)
    if carried is not None and carried != problem.destination:
        undelivered = _first(result, compose, [stations[carried].id], request.payload_kg)
    way = WayBack(
        asked=request.return_to,
        station=c.destination if back is None else back.destination,
        dwell_s=request.dwell_s,
        release=request.release,
        plan=back,
        undelivered_to=None if carried is None else stations[carried].id,
        undelivered=undelivered,
    )
    return replace(result, composition=replace(c, way_back=way, notes=(*c.notes, *_of_way_out(result, back))))


def _of_way_out(result: PlanResult, back: Composition | None) -> tuple[str, ...]:
    """Say so where the probability of success does not count the flight on: only the planner robust counts it."""
    c = result.composition
    if back is None or c.success is None or result.outcome.p_onward is not None or not result.problem.needs_escape:
        return ()
    own = "" if back.success is None else f"; on the way back, from the typical schedule: {share(back.success)}"
    return (f"The share of the deliveries that keep the reserve is that of the way out alone{own}",)


def _first(result: PlanResult, compose: Compose, ends: list[str], payload_kg: float) -> Composition:
    """Plan the way on to the first of some stations to which there is one."""
    failed: InfeasibleError | None = None
    for end in ends:
        try:
            return compose(result.problem.scenario, _request_on(result, end, payload_kg)).composition
        except InfeasibleError as error:
            failed = failed or error
    package = "with" if payload_kg > 0.0 else "without"
    target = result.composition.destination
    why = str(failed) if failed is not None else f"no station with pads is in reach of {target}"
    constraint = failed.constraint if failed is not None else "energy"
    raise NoWayBackError(
        f"no way back from {target} {package} the package: {why}", constraint=constraint, by=_begins(result)
    )


def _request_on(result: PlanResult, end: str, payload_kg: float) -> Request:
    """Ask for the way on from where and when the delivery ends."""
    problem, c = result.problem, result.composition
    off, soc = c.arrive + timedelta(seconds=problem.request.dwell_s), c.services[-1].soc_arrive - problem.hover_soc
    state = State(off, c.destination, None, min(soc + _ROUNDING_SOC, 1.0), visited=problem.request.state.visited)
    return replace(
        problem.request, state=state, destination=end, payload_kg=payload_kg, drone=c.drone, stop_at=(), return_to=NO_RETURN,
        dwell_s=0.0, undelivered_to=None, release="gripper", not_back_by=(), escape=False, objective=Objective(), not_before=None,
    )  # fmt: skip


def _begins(result: PlanResult) -> frozenset[str]:
    """Stations that the way on could begin with, of a target without pads."""
    network = result.problem.network
    return frozenset(network.stations[int(network.head[way[-1]])].id for way in _in_reach(result.problem, result))


def _in_reach(problem: Problem, result: PlanResult) -> list[tuple[int, ...]]:
    """Ways on that the charge on arrival is enough for in still air, nearest first; the nearest one in any case."""
    air, network = problem.air, problem.network
    per_s, fixed = problem.onward_cost
    spare = result.composition.services[-1].soc_arrive - problem.reserve
    length = {way: float(network.distance_m[list(way)].sum()) for way in problem.ways_on}
    near = sorted(length, key=lambda way: length[way])
    fixed += per_s * (air.climb_s + air.descent_s)
    return [way for way in near if fixed + per_s * length[way] / air.airspeed_mps <= spare] or near[:1]


def _nearest_pads(result: PlanResult) -> list[str]:
    """Stations with pads by when the drone is on a pad there, as is expected: flight and wait."""
    problem = result.problem
    network, once_s = problem.network, problem.air.climb_s + problem.air.descent_s
    off_s = result.composition.arrive.timestamp() + problem.request.dwell_s
    look = Lookahead(problem)
    ready: dict[str, float] = {}
    for way in _in_reach(problem, result)[:MOST_PADS]:
        end = int(network.head[way[-1]])
        flown_s = once_s + sum(look.flight(segment, off_s)[0] - once_s for segment in way)
        if math.isfinite(flown_s):
            flown_s += problem.waits.at(end, off_s + flown_s)[0]
        ready[network.stations[end].id] = flown_s
    return sorted(ready, key=lambda name: ready[name])
