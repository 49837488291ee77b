"""Simulated vehicles that behave like PX4 and ArduPilot on the wire, with pads and wind.

The other side of the wire: its drag, power and autopilots are its own and share no code with the planner or the link.
The names below are what a program needs to fly in lockstep; they are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.lazy import exports

if TYPE_CHECKING:
    from skyway.sim_stub.config import VehicleConfig as VehicleConfig
    from skyway.sim_stub.faults import Fault as Fault
    from skyway.sim_stub.faults import parse_fault as parse_fault
    from skyway.sim_stub.fleet import FleetOptions as FleetOptions
    from skyway.sim_stub.fleet import build_world as build_world
    from skyway.sim_stub.fleet import serve as serve
    from skyway.sim_stub.pads import Pads as Pads
    from skyway.sim_stub.plant.wind_truth import ConstantWind as ConstantWind
    from skyway.sim_stub.plant.wind_truth import RecordedWind as RecordedWind
    from skyway.sim_stub.transports.channel import Impairment as Impairment
    from skyway.sim_stub.transports.lockstep import Lockstep as Lockstep
    from skyway.sim_stub.transports.lockstep import LockstepTransport as LockstepTransport
    from skyway.sim_stub.transports.lockstep import VirtualClock as VirtualClock
    from skyway.sim_stub.vehicle import Vehicle as Vehicle
    from skyway.sim_stub.world import Event as Event
    from skyway.sim_stub.world import World as World

__all__, __getattr__ = exports(__name__)
