"""Calibration flights: a simulated drone flies a square twice, and its drag is found from its telemetry."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.link.protocol.connection import Connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.recorder import Recorder
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.base.errors import LinkError
from skyway.models.base.files import write_atomically
from skyway.models.calibration.wind import identify_drag
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.blocks import blocks
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.drone import Drone
    from skyway.models.drones.telemetry import TelemetrySample

LAT, LON = 40.7392, -73.9756
_SIDE_LAT, _SIDE_LON = 0.010, 0.013
_ROUND = ((_SIDE_LAT, 0.0), (_SIDE_LAT, _SIDE_LON), (0.0, _SIDE_LON), (0.0, 0.0))
_HEIGHT_M, _SPEED_MPS, _LONGEST_S = 60.0, 17.0, 1200.0
_WIND = (2.0, -3.0)


def _item(command: Command, north: float, east: float, height_m: float = _HEIGHT_M) -> MissionItem:
    x, y = round((LAT + north) * 1e7), round((LON + east) * 1e7)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=height_m)


def _square() -> Mission:
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, _SPEED_MPS, -1.0)
    ways = [_item(Command.NAV_WAYPOINT, *corner) for corner in 2 * _ROUND]
    return Mission((_item(Command.NAV_TAKEOFF, 0.0, 0.0), speed, *ways, _item(Command.NAV_LAND, 0.0, 0.0, 0.0)))


@cache
def drag_of(drone: Drone, payload_kg: float) -> DragModel:
    """Fly a square twice in a light wind, in virtual time, and fit the drag; a `LinkError` where that fails."""
    fit = identify_drag(blocks(TelemetryTrack.of_samples(_flown(drone, payload_kg))))
    if fit.drag is None:
        raise LinkError(f"the calibration flight does not determine the drag: {fit.reason}")
    return fit.drag


def record_square(drone: Drone, payload_kg: float, path: Path, *, force: bool = False) -> None:
    """Fly the same square and record it as a ``.tlog``: a flight to calibrate with."""
    with tempfile.TemporaryDirectory() as folder:
        _flown(drone, payload_kg, Path(folder))
        (recorded,) = Path(folder).glob("*.tlog")
        write_atomically(path, recorded.read_bytes(), force=force)


def _flown(drone: Drone, payload_kg: float, folder: Path | None = None) -> list[TelemetrySample]:
    """Fly the square; returns what was heard, and records it where a folder is given."""
    world = World(wind=ConstantWind(*_WIND))
    parameters = (("MPC_XY_VEL_MAX", 20.0), ("MPC_Z_V_AUTO_UP", 5.0))
    vehicle = world.add(
        VehicleConfig(
            lat=LAT, lon=LON, ground_m=5.0, payload_kg=payload_kg, warm=True, seed=77, airframe=Airframe(drone=drone),
            parameters=parameters,
        )
    )  # fmt: skip
    lockstep = Lockstep(world)
    recorder = None if folder is None else Recorder(folder, lockstep.clock)
    connection = Connection(lockstep.connect(vehicle), lockstep.clock, recorder=recorder)
    craft = Vehicle(connection)
    craft.request_telemetry()
    if not craft.upload(_square()).verified:
        raise LinkError("the mission of the calibration flight could not be uploaded")
    craft.start(30.0)
    samples = []
    for sample in craft.samples(_LONGEST_S):
        samples.append(sample)
        if len(samples) > 600 and not craft.armed:
            break
    if recorder is not None:
        connection.close()
    return samples
