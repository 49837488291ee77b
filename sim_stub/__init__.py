"""Simulated vehicles that behave like PX4 and ArduPilot on the wire, with pads and wind.

The other side of the wire: its drag, power and autopilots are its own and share no code with the planner or the link.
The names below are what a program needs to fly in lockstep; they are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.sim_stub.config import VehicleConfig
    from skyway.sim_stub.faults import Fault, parse_fault
    from skyway.sim_stub.fleet import FleetOptions, build_world, serve
    from skyway.sim_stub.pads import Pads
    from skyway.sim_stub.plant.wind_truth import ConstantWind, RecordedWind
    from skyway.sim_stub.transports.channel import Impairment
    from skyway.sim_stub.transports.lockstep import Lockstep, LockstepTransport, VirtualClock
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.world import Event, World

_HOMES = {
    "VehicleConfig": "config",
    "Fault": "faults",
    "parse_fault": "faults",
    "FleetOptions": "fleet",
    "build_world": "fleet",
    "serve": "fleet",
    "Pads": "pads",
    "Impairment": "transports.channel",
    "Lockstep": "transports.lockstep",
    "LockstepTransport": "transports.lockstep",
    "VirtualClock": "transports.lockstep",
    "Vehicle": "vehicle",
    "ConstantWind": "plant.wind_truth",
    "RecordedWind": "plant.wind_truth",
    "Event": "world",
    "World": "world",
}

__all__ = [
    "ConstantWind",
    "Event",
    "Fault",
    "FleetOptions",
    "Impairment",
    "Lockstep",
    "LockstepTransport",
    "Pads",
    "RecordedWind",
    "Vehicle",
    "VehicleConfig",
    "VirtualClock",
    "World",
    "build_world",
    "parse_fault",
    "serve",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'sim_stub' has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
