"""Supervised work in virtual time: a survey that is longer than a battery, cut and flown in a simulated world, with its camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from skyway import missions
from skyway.link.protocol.connection import Connection
from skyway.link.supervisor import DeliveryJob, Journal, NobodyThere, Supervisor
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions import Command, Frame, Home, Mission, MissionDocument, MissionItem
from skyway.missions.checks.weather import ForecastWind, SteadyWind
from skyway.missions.items.coordinates import Point
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.base import geodesy
from skyway.models.drones.drone import M200_V2
from skyway.models.network.station import Station
from skyway.models.wind.forecast import constant_wind
from skyway.recharge.flying.work_job import job_of
from skyway.recharge.output import parameters_of
from skyway.recharge.problem import RechargeOptions
from skyway.recharge.recharged import recharged
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from skyway.link.supervisor import Operator, Outcome
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.recharge.cutting import Recharged
    from skyway.sim_stub.autopilot.base import Autopilot
    from skyway.sim_stub.autopilot.items import Item
    from skyway.sim_stub.faults import Fault
    from skyway.sim_stub.plant.wind_truth import WindTruth

NOON = datetime(2026, 5, 4, 12, 0, tzinfo=UTC)
PLACE = (40.70, -74.00)
GROUND_M = 20.0
STANDS_S = 4.0
"""At the beginning of each line it stands: else the line begins wherever the vehicle swings to at the corner."""
EXACT_M = 1.0
"""A place of the survey counts as reached within it: else a line begins wherever the vehicle comes by."""
EXACT = {"px4": (), "ardupilot": (("WPNAV_RADIUS", 100.0 * EXACT_M),)}
HORIZON_H = 24


def placed(
    origin: tuple[float, float],
    east_m: float,
    north_m: float,
    command: Command = Command.NAV_WAYPOINT,
    height_m: float = 60.0,
) -> MissionItem:
    """Return an item so far east and north of a place."""
    bearing = math.degrees(math.atan2(east_m, north_m))
    point = Point.of_degrees(*geodesy.direct(*origin, bearing, math.hypot(east_m, north_m)))
    reached_m = EXACT_M if command == Command.NAV_WAYPOINT else 0.0
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, param2=reached_m, x=point.lat_e7, y=point.lon_e7, z=height_m)


def survey(
    origin: tuple[float, float] = PLACE, lines: int = 9, length_m: float = 1500.0, every_m: float = 40.0
) -> Mission:
    """Return a survey of lines 60 m apart, north of a home, with a picture every so many metres."""
    items = [placed(origin, 0.0, 0.0, Command.NAV_TAKEOFF)]
    for number in range(lines):
        ends = (100.0, 100.0 + length_m) if number % 2 == 0 else (100.0 + length_m, 100.0)
        items += [
            replace(placed(origin, 60.0 * number, ends[0]), param1=STANDS_S),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, every_m, 0.0, 1.0),
            placed(origin, 60.0 * number, ends[1]),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        ]
    items.append(placed(origin, 0.0, 0.0, Command.NAV_LAND, 0.0))
    return Mission(tuple(items), Home(Point.of_degrees(*origin), GROUND_M), 15.0, 8.0, 12, 2)


def pad(name: str, origin: tuple[float, float], east_m: float, north_m: float, ground_m: float) -> Station:
    """Return a station with two pads so far east and north of a place."""
    at = placed(origin, east_m, north_m).point
    if at is None:
        raise ValueError(name)
    return Station(name, name, at.lat, at.lon, ground_m, 2)


class Camera:
    """Takes pictures as autopilots do: so far from the last one, as the mission last ordered.

    It keeps count over flights: a camera without power takes none, and one with power knows its last picture.
    """

    def __init__(self, pilot: Autopilot) -> None:
        self.pilot, self.every_m = pilot, 0.0
        self.pictures: list[tuple[float, float]] = []
        self.last: tuple[float, float] | None = None
        self._before: tuple[float, float] | None = None
        self._execute, self._after_step = pilot.execute, pilot.after_step
        pilot.execute, pilot.after_step = self.execute, self.after_step  # type: ignore[method-assign]

    @property
    def here(self) -> tuple[float, float]:
        """Where the autopilot believes to be: by that it takes pictures, and that is written into them."""
        return self.pilot.lat, self.pilot.lon

    def execute(self, item: Item) -> None:
        """Obey an order of the mission."""
        self._execute(item)
        if item.command == Command.DO_SET_CAM_TRIGG_DIST:
            self.every_m = item.p1
            self.last = self.last or self.here
            if item.p1 > 0.0 and item.p3 == 1.0:
                self._take(self.here)

    def after_step(self) -> None:
        """Take a picture where the vehicle is so far from the last one."""
        self._after_step()
        here = self.here
        if not self.pilot.armed:
            self.every_m = 0.0
        if self.every_m > 0.0 and self.last is not None:
            away, before = (math.hypot(*offset_m(*self.last, *one)) for one in (here, self._before or here))
            if away >= self.every_m:  # between two steps, so that no step is added to the distance
                part = (self.every_m - before) / (away - before) if away > self.every_m > before else 1.0
                lat, lon = (a + part * (b - a) for a, b in zip(self._before or here, here, strict=True))
                self._take((lat, lon))
        self._before = here

    def _take(self, here: tuple[float, float]) -> None:
        self.pictures.append(here)
        self.last = here


@dataclass
class Story:
    """Work to be flown: which mission, from which pads, in which wind, with which faults."""

    autopilot: str = "px4"
    mission: Mission = field(default_factory=survey)
    pads: Sequence[Station] = (pad("west", PLACE, -150.0, 700.0, 12.0), pad("east", PLACE, 620.0, 1500.0, 31.0))
    soc: float = 0.7
    power_error: float | None = 1.0
    seed: int = 1
    region: Scenario | None = None
    forecast: WindEnsemble | None = None
    """None: a constant wind of 5 m/s from 300°."""
    truth: WindTruth = field(default_factory=lambda: ConstantWind.of(5.0, 300.0))
    depart: datetime = NOON
    epsilon: float = 0.001
    replanning: bool = True
    faults: tuple[Fault, ...] = ()
    vehicle: dict[str, Any] = field(default_factory=dict)
    transit_mps: float = 12.0


class Stage:
    """The world of a story, and a supervisor that may be killed and begun again."""

    def __init__(self, story: Story, folder: Path, operator: Operator | None = None) -> None:
        self.story = story
        self.family = missions.family_named(story.autopilot)
        self.forecast = story.forecast or constant_wind(5.0, 300.0, story.depart, HORIZON_H, *PLACE, 60.0)
        steady = story.forecast is None
        weather = SteadyWind(5.0, 300.0) if steady else ForecastWind(self.forecast, story.depart.timestamp(), 0.2)
        conditions = missions.FlightConditions(M200_V2, weather=weather, soc_start=story.soc)
        self.document = MissionDocument(story.mission)
        options = RechargeOptions(conditions, TransitRules(story.transit_mps), epsilon=story.epsilon)
        self.found: Recharged = recharged(self.document, story.pads, [self.family], options)
        self.job: DeliveryJob = job_of(
            self.found, self.document, self.family, story.region, self.forecast, story.depart.timestamp(),
            asking="never" if operator is None else "once", replanning=story.replanning,
        )  # fmt: skip
        home = story.mission.home
        if home is None:
            raise ValueError("the mission has no home")
        self.world = World(
            epoch_s=story.depart.timestamp(),
            wind=story.truth,
            stations=self.job.scenario.network.stations,
            faults=story.faults,
        )
        self.craft = self.world.add(
            VehicleConfig(
                lat=home.point.lat, lon=home.point.lon, ground_m=home.altitude_m or 0.0, autopilot=story.autopilot,
                warm=True, soc=story.soc, power_error=story.power_error, seed=story.seed, parameters=EXACT[story.autopilot], **story.vehicle,
            )
        )  # fmt: skip
        self.camera = Camera(self.craft.autopilot)
        self.pads = Pads(self.world, None, seed=story.seed)
        self.lockstep = Lockstep(self.world)
        self.journal_path = folder / f"work-{story.autopilot}-{story.seed}.jsonl"
        self.operator = operator or NobodyThere()
        self.landings: list[float] = []

    def fly(self, *, resume: bool = False, on_tick: Callable[[Any], None] | None = None) -> Outcome:
        """Connect, put a supervisor in charge, and let it fly to the end."""
        connection = Connection(self.lockstep.connect(self.craft, seed=self.story.seed), self.lockstep.clock)
        journal = Journal(self.journal_path, self.lockstep.clock.posix_s, resume=resume)
        down = [True]

        def tick(ctx: Any) -> None:
            landed = self.craft.autopilot.landed
            if landed and not down[0]:
                self.landings.append(self.craft.battery.soc)
            down[0] = landed
            if on_tick is not None:
                on_tick(ctx)

        supervisor = Supervisor(
            self.job, Vehicle(connection), self.lockstep.clock, self.pads, self.operator, journal,
            resume=resume, on_tick=tick,
        )  # fmt: skip
        try:
            return supervisor.run()
        finally:
            journal.close()
            connection.close()


def whole(story: Story, folder: Path) -> list[tuple[float, float]]:
    """Fly the mission undivided, with a battery that is always full, as fast as it is planned; return where its pictures are."""
    stage = Stage(story, folder)
    craft, lockstep = stage.craft, stage.lockstep
    connection = Connection(lockstep.connect(craft, seed=story.seed), lockstep.clock)
    vehicle = Vehicle(connection)
    store = craft.autopilot.parameters
    for asked in parameters_of(stage.found, stage.family.name, [stage.document]):
        way = next((one for one in asked.ways if store.find(one.name) is not None and not one.paired), asked)
        have = store.find(way.name)
        if have is not None and not way.accepts(have.value):
            wanted = way.value or 0.0
            store.set(way.name, int(have.value) | int(wanted) if way.rule == "bits" else wanted)
    after_step = craft.autopilot.after_step

    def charged() -> None:
        after_step()
        craft.battery.soc = 1.0

    craft.autopilot.after_step = charged  # type: ignore[method-assign]
    for _ in vehicle.samples(3.0):
        pass
    first, *others = story.mission.items
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, story.mission.hover_speed_mps or 0.0, -1.0)
    mission = replace(story.mission, firmware=stage.family.firmware, items=(first, speed, *others))
    if not vehicle.upload(mission).verified:
        raise ValueError("the undivided mission was not taken")
    vehicle.start(patience_s=60.0)
    for _ in vehicle.samples(60.0):
        pass
    while craft.autopilot.armed:
        for _ in vehicle.samples(5.0):
            pass
    connection.close()
    return stage.camera.pictures
