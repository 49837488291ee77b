"""The wind that a simulated vehicle measures on a long straight flight, with a drag from another flight."""

import numpy as np
import pytest

from skyway.calibration_flight import LAT, LON, drag_of
from skyway.link.protocol.connection import Connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.wind.estimation.live import LiveWind
from skyway.scenarios import load_scenario
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

HEIGHT_M, SPEED_MPS, FLIGHT_S = 60.0, 6.5, 480.0


def item(command, north_deg=0.0, height_m=HEIGHT_M):
    x, y = round((LAT + north_deg) * 1e7), round(LON * 1e7)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=height_m)


def samples(drone, wind, towards):
    """Samples of a straight flight of some minutes, from above half of its height on."""
    world = World(wind=wind)
    vehicle = world.add(VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, warm=True, seed=77, airframe=Airframe(drone=drone)))  # fmt: skip
    lockstep = Lockstep(world)
    craft = Vehicle(Connection(lockstep.connect(vehicle), lockstep.clock))
    craft.request_telemetry()
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, SPEED_MPS, -1.0)
    away = item(Command.NAV_WAYPOINT, 0.05 * towards)
    assert craft.upload(Mission((item(Command.NAV_TAKEOFF), speed, away, item(Command.NAV_LAND, 0.05 * towards, 0.0)))).verified  # fmt: skip
    craft.start(30.0)
    begin_s = lockstep.clock.now_s()
    for one in craft.samples(2.0 * FLIGHT_S):
        if lockstep.clock.now_s() > begin_s + FLIGHT_S:
            break
        if one.landed == 0.0 and one.height_m > 0.5 * HEIGHT_M:
            yield one


@pytest.mark.parametrize("expected", [(10.0, 0.0), (-3.0, 0.0)])
def test_gusts_against_a_straight_flight_are_not_explained_by_another_drag(expected):
    """Each gust pushes the vehicle back a little, and the filter explained both by a drag that became ever smaller: it found 13 m/s of 10."""
    drone = load_scenario(None).drone("m200")
    wind = LiveWind(drag=drag_of(drone, 0.0).another_flight(), forecast=lambda *_: expected)
    found = []
    for one in samples(drone, ConstantWind(10.0, 0.0), towards=-1.0):
        wind.hear(one)
        if wind.estimate is not None:
            found.append((wind.estimate.north_mps, wind.estimate.east_mps))
    north, east = np.array(found[len(found) // 2 :]).mean(axis=0)
    assert north == pytest.approx(10.0, abs=1.3)
    assert east == pytest.approx(0.0, abs=1.0)
