"""The drag of a simulated drone, found as an operator finds it: out and back, and across, with the package on."""

from functools import cache

from link.connection import Connection
from link.mavlink_vehicle import MavlinkVehicle
from missions.commands import Command, Frame
from missions.mission import Mission, MissionItem
from models.calibration_wind import identify_drag
from models.telemetry import TelemetryTrack
from models.wind_filter_blocks import blocks
from sim_stub.airframe import Airframe
from sim_stub.config import VehicleConfig
from sim_stub.transports.lockstep import Lockstep
from sim_stub.wind_truth import ConstantWind
from sim_stub.world import World

LAT, LON = 40.7392, -73.9756
SQUARE = (
    (0.010, 0.0),
    (0.010, 0.013),
    (0.0, 0.013),
    (0.0, 0.0),
    (0.010, 0.0),
    (0.010, 0.013),
    (0.0, 0.013),
    (0.0, 0.0),
)


def _item(command, north, east, height=60.0):
    x, y = round((LAT + north) * 1e7), round((LON + east) * 1e7)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=height)


def _square():
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 17.0, -1.0)
    ways = [_item(Command.NAV_WAYPOINT, *corner) for corner in SQUARE]
    return Mission((_item(Command.NAV_TAKEOFF, 0.0, 0.0), speed, *ways, _item(Command.NAV_LAND, 0.0, 0.0, 0.0)))


@cache
def drag_of(drone, payload_kg):
    """Fly a square twice in a light wind, and fit."""
    world = World(wind=ConstantWind(2.0, -3.0))
    config = VehicleConfig(
        lat=LAT, lon=LON, ground_m=5.0, payload_kg=payload_kg, warm=True, seed=77, airframe=Airframe(drone=drone),
        parameters=(("MPC_XY_VEL_MAX", 20.0), ("MPC_Z_V_AUTO_UP", 5.0)),
    )  # fmt: skip
    vehicle = world.add(config)
    lockstep = Lockstep(world)
    craft = MavlinkVehicle(Connection(lockstep.connect(vehicle), lockstep.clock))
    craft.request_telemetry()
    assert craft.upload(_square()).verified
    craft.start(30.0)
    samples = []
    for sample in craft.samples(1200.0):
        samples.append(sample)
        if len(samples) > 600 and not craft.armed:
            break
    fit = identify_drag(blocks(TelemetryTrack.of_samples(samples)))
    assert fit.identified, fit.reason
    return fit.drag
