"""How fast the simulator is: lockstep in the air and on a pad, a hundred vehicles on sockets, memory, garbage.

Run as a script; prints a line a figure with its ratio to what is asked for.
"""

from __future__ import annotations

import argparse
import os
import random
import socket
import sys
import time
import tracemalloc
from typing import TYPE_CHECKING

from skyway.models.base.address import Address
from skyway.models.network.station import Station
from skyway.sim_stub.autopilot.items import Command, Frame, Item
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.fleet import FleetOptions, build_world, serve
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle

HERE = Station("here", "Here", 40.74, -73.97, 5.0, 2, 2)
RATES = {"GLOBAL_POSITION_INT": 4.0, "ATTITUDE": 10.0}
WANTED_AIR, WANTED_PAD, WANTED_CORE = 200.0, 2000.0, 0.60


def report(what: str, figure: str, ratio: float) -> None:
    """Print one figure; a ratio above 1 is better than asked for."""
    print(f"{what:<52} {figure:>16}   {ratio:6.2f} x what is asked for")


def mission(vehicle: Vehicle, far_m: float = 8000.0) -> None:
    """Give a vehicle a long way to go, and start it."""
    north = far_m / 111_045.0
    x, y = round(vehicle.config.lat * 1e7), round(vehicle.config.lon * 1e7)
    items = [
        Item(Command.TAKEOFF, Frame.RELATIVE, x=x, y=y, z=60.0),
        Item(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 12.0),
        Item(Command.WAYPOINT, Frame.RELATIVE, x=x + round(north * 1e7), y=y, z=60.0),
        Item(Command.LAND, Frame.RELATIVE, x=x + round(north * 1e7), y=y),
    ]
    pilot = vehicle.autopilot
    pilot.stores[0][:] = items
    pilot.missions_stored(replaced=True, current=None)
    pilot.arm(force=True, by="bench")
    pilot.request_mode(Mode.MISSION, "bench")


def lockstep(*, flying: bool) -> float:
    """Simulated seconds to the second of one vehicle with its telemetry on."""
    world = World(wind=ConstantWind.of(6.0, 300.0), stations=[HERE])
    vehicle = world.add(
        VehicleConfig(lat=HERE.lat, lon=HERE.lon, ground_m=5.0, soc=0.3 if not flying else 1.0, warm=True)
    )
    run = Lockstep(world)
    link = run.connect(vehicle)
    for name, rate in RATES.items():
        vehicle.radio.ports[0].set_interval(name, 1.0 / rate, 0.0)
    if flying:
        mission(vehicle)
        duration = 500.0
    else:
        Pads(world).charge("here", "1", 1.0)
        duration = 5000.0
    begun = time.process_time()
    end = run.now_s + duration
    while run.now_s < end:
        link.read(1.0)
    return duration / (time.process_time() - begun)


def hundred(seconds: float) -> float:
    """Share of a core that a hundred flying vehicles need at 1x, with 4 Hz position and 10 Hz attitude each.

    Processor time to simulated time: on a busy machine simulated time falls behind, and nothing is gained by that.
    """
    sink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sink.bind(("127.0.0.1", 0))
    sink.settimeout(0.0)
    address = Address("udpout", "127.0.0.1", sink.getsockname()[1])
    options = FleetOptions(stations=(HERE,), places=(HERE,), vehicles=100, warm=True, wind=ConstantWind.of(6.0, 300.0))
    world = build_world(options)
    loop, _ = serve(world, connect=(address,))
    for vehicle in world.vehicles.values():
        for name, rate in RATES.items():
            vehicle.radio.ports[0].set_interval(name, 1.0 / rate, 0.0)
        mission(vehicle)
    stop = world.wall_s + seconds
    begun, simulated = time.process_time(), world.sim_s
    try:
        while world.wall_s < stop:
            loop.turn(0.01)
    finally:
        loop.close()
        sink.close()
    assert all(vehicle.active for vehicle in world.vehicles.values()), "all are in the air"
    return (time.process_time() - begun) / (world.sim_s - simulated)


def memory_kb() -> float:
    """Memory of one vehicle with a port, in KiB."""
    options = FleetOptions(stations=(HERE,), places=(HERE,), vehicles=1, warm=True)
    world = build_world(options)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for system in range(2, 102):
        vehicle = world.add(VehicleConfig(lat=HERE.lat, lon=HERE.lon, system=system, warm=True))
        vehicle.radio.connect(lambda _: None)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return (after - before) / 100.0 / 1024.0


def garbage(packets: int) -> float:
    """Random packets a second that one vehicle throws away."""
    world = World()
    vehicle = world.add(VehicleConfig(lat=HERE.lat, lon=HERE.lon, warm=True))
    port = vehicle.radio.connect(lambda _: None)
    generator = random.Random(1)
    junk = [generator.randbytes(generator.randint(1, 280)) for _ in range(1000)]
    begun = time.process_time()
    for number in range(packets):
        vehicle.receive(port, junk[number % 1000])
    return packets / (time.process_time() - begun)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of the hundred vehicles")
    seconds = parser.parse_args().seconds
    air, pad = lockstep(flying=True), lockstep(flying=False)
    report("one vehicle in lockstep, in the air", f"{air:.0f} x real", air / WANTED_AIR)
    report("one vehicle in lockstep, on a pad", f"{pad:.0f} x real", pad / WANTED_PAD)
    core = hundred(seconds)
    report("a hundred vehicles in the air at 1x", f"{core:.0%} of a core", WANTED_CORE / core)
    print(f"{'memory of one vehicle':<52} {memory_kb():>12.0f} KiB")
    print(f"{'random packets thrown away':<52} {garbage(100_000):>12.0f} /s")
    print(f"{'cores here':<52} {os.cpu_count() or 0:>12}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
