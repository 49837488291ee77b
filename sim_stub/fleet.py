"""Construction of a simulated fleet: world, vehicles, pads and sockets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.models.base.address import Address
from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError
from skyway.models.base.ranges import range_faults
from skyway.sim_stub.autopilot import NAMES
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.transports import tcp
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.transports.loop import SocketLoop
from skyway.sim_stub.transports.pad_server import serve_pads
from skyway.sim_stub.transports.udp import UdpEndpoint
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from collections.abc import Callable
    from selectors import BaseSelector

    from skyway.models.drones.drone import Drone
    from skyway.models.network.station import Station
    from skyway.models.queues.load import PadLoad
    from skyway.sim_stub.faults import Fault
    from skyway.sim_stub.plant.wind_truth import WindTruth
    from skyway.sim_stub.transports.loop import Endpoint
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.world import Event

MAX_VEHICLES = 250
_TCP_STEP = 10
"""Ports of consecutive vehicles are this far apart, as with the simulators that people know."""
_OPEN: dict[str, Callable[[Address, Vehicle, Impairment, str, BaseSelector], Endpoint]] = {
    "udpout": UdpEndpoint,
    "udpin": UdpEndpoint,
    "tcp": tcp.connect,
    "tcpin": tcp.listen,
}
"""What opens a connection of each kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOptions:
    """What to simulate."""

    stations: tuple[Station, ...]
    """All that are known; vehicles stand at `places`, in turn."""
    places: tuple[Station, ...]
    vehicles: int = 1
    first_system: int = 1
    """System id of the first; the others follow."""
    autopilot: str = NAMES[0]
    firmware: str = ""
    """Version of the autopilot, as `VehicleConfig` has it."""
    drone: Drone | None = None
    soc: float = 1.0
    payload_kg: float = 0.0
    seed: int = 1
    warm: bool = False
    """All have been on for a while and are ready to arm."""
    epoch_s: float = 1_373_464_800.0
    wind: WindTruth | None = None
    load: PadLoad | None = None
    faults: tuple[Fault, ...] = ()
    operator_control: bool = False
    remote_id: bool = False
    """All have a Remote ID module."""
    parameters: tuple[tuple[str, float], ...] = ()
    logs: tuple[int, ...] = ()
    """Bytes of the logs of earlier flights on every card."""
    log_room_bytes: int = 0
    """Room for logs of their own flights on all cards together; 0 writes none."""

    def __post_init__(self) -> None:
        faults = range_faults("--vehicles", self.vehicles, 1, MAX_VEHICLES, f"1 to {MAX_VEHICLES}")
        faults += range_faults("--system", self.first_system, 1, 256 - self.vehicles, "1 to 255 for all vehicles")
        if not self.places:
            faults.append(Wrong("no place for the vehicles", field="--at"))
        if faults:
            raise InputError(faults)


def build_world(options: FleetOptions, on_event: Callable[[Event], None] | None = None) -> World:
    """Make the world with its vehicles and pads."""
    world = World(
        epoch_s=options.epoch_s,
        wind=options.wind,
        stations=options.stations,
        faults=options.faults,
        on_event=on_event,
    )
    airframe = Airframe() if options.drone is None else Airframe(drone=options.drone)
    for number in range(options.vehicles):
        place = options.places[number % len(options.places)]
        world.add(
            VehicleConfig(
                lat=place.lat,
                lon=place.lon,
                ground_m=place.elevation_m or 0.0,
                system=options.first_system + number,
                autopilot=options.autopilot,
                firmware=options.firmware,
                soc=options.soc,
                payload_kg=options.payload_kg,
                seed=options.seed,
                warm=options.warm,
                airframe=airframe,
                operator_control=options.operator_control,
                remote_id=options.remote_id,
                parameters=options.parameters,
                logs=options.logs,
                log_room_bytes=options.log_room_bytes // options.vehicles,
            )
        )
    Pads(world, options.load, seed=options.seed)
    return world


def serve(
    world: World,
    *,
    connect: tuple[Address, ...] = (),
    tcp_port: int | None = None,
    pads: Address | None = None,
    impairment: Impairment | None = None,
    speedup: float = 1.0,
    pad_speedup: float | None = None,
    seed: int = 1,
) -> tuple[SocketLoop, list[str]]:
    """Open the sockets of every vehicle and of the pads; returns the loop to run, and where it can be reached.

    Listening ports count up from vehicle to vehicle: by 1 for ``udpin``, by 10 for TCP.
    """
    loop = SocketLoop(world, speedup=speedup, pad_speedup=pad_speedup)
    how = impairment or Impairment()
    told: list[str] = []
    try:
        for number, (system, vehicle) in enumerate(world.vehicles.items()):
            addresses = [_counted(address, number) for address in connect]
            if tcp_port is not None:
                addresses.append(Address("tcpin", "127.0.0.1", tcp_port + _TCP_STEP * number if tcp_port else 0))
            for place, address in enumerate(addresses):
                endpoint = _OPEN[address.kind](address, vehicle, how, f"{seed}/{system}/{place}", loop.selector)
                loop.add(endpoint)
                told.append(f"vehicle {system}: {endpoint.where}")
        if pads is not None and world.pads is not None:
            server = serve_pads(pads, world.pads, loop.selector)
            loop.add(server)
            told.append(f"pads: {server.where}")
    except InputError:
        loop.close()
        raise
    return loop, told


def _counted(address: Address, number: int) -> Address:
    step = {"udpin": 1, "tcpin": _TCP_STEP}.get(address.kind, 0)
    port = address.port + step * number if address.port else 0
    if port > 65535:
        raise InputError(Wrong("not enough ports for all vehicles", field="--connect", value=address.port))
    return replace(address, port=port)
