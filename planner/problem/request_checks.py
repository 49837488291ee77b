"""Checks of a request against the network and the drone."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import MPS_PER_KMH

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.request import Request

MIN_KMH = 30.0
"""Least value of an airspeed above the drone's maximum that is taken for km/h in the message."""


def check_request(scenario: Scenario, request: Request, drone: Drone) -> None:
    """Refuse a request that does not fit the drone or the network (an `InputError` with all faults)."""
    faults = []
    speed = request.airspeed_mps
    if speed is not None and speed > drone.max_airspeed_mps + 1e-9:
        problem = f"{drone.id} flies {drone.max_airspeed_mps:g} m/s at most"
        meant = f"did you mean {speed * MPS_PER_KMH:.3g} m/s ({speed:g} km/h)?"
        fits = speed * MPS_PER_KMH <= drone.max_airspeed_mps and speed >= MIN_KMH
        remedy = meant if fits else f"up to {drone.max_airspeed_mps:g} m/s"
        faults.append(Fault(problem, field="airspeed_mps", value=speed, remedy=remedy))
    for key in request.state.busy_pads:
        if key not in scenario.network.index:
            close = get_close_matches(key, scenario.network.index, 1)
            remedy = f"did you mean {close[0]!r}?" if close else "name stations by their id"
            faults.append(Fault("no such station", field="state.busy_pads", value=key, remedy=remedy))
    if faults:
        raise InputError(faults)


def check_apart(problem: Problem) -> None:
    """Refuse a delivery whose origin is its destination (an `InputError`)."""
    if problem.origin == problem.destination:
        value = problem.request.destination
        raise InputError(Fault("start and destination are the same", field="destination", value=value))
