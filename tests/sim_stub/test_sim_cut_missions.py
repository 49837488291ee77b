"""Missions that `skyway recharge` cuts fly on both families: pictures where they were, landings on pads, the reserve kept."""

import math
import re
from datetime import UTC, datetime

import pytest
from sim_station import Station

from skyway import missions
from skyway.missions import Command, Frame, Home, Mission, MissionDocument, MissionItem
from skyway.missions.checks.weather import SteadyWind
from skyway.missions.items.coordinates import Point
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.base import geodesy
from skyway.models.drones.drone import M200_V2
from skyway.models.network.station import Station as Pad
from skyway.recharge.output import parameters_of
from skyway.recharge.problem import RechargeOptions
from skyway.recharge.recharged import recharged
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

NOON = datetime(2026, 5, 4, 12, 0, tzinfo=UTC)
LAT, LON, GROUND_M = 40.70, -74.00, 20.0
EVERY_M = 40.0


def place(east_m, north_m, command=Command.NAV_WAYPOINT, height_m=60.0):
    bearing = math.degrees(math.atan2(east_m, north_m))
    point = Point.of_degrees(*geodesy.direct(LAT, LON, bearing, math.hypot(east_m, north_m)))
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=height_m)


def survey(lines=9, length_m=1500.0):
    items = [place(0.0, 0.0, Command.NAV_TAKEOFF)]
    for number in range(lines):
        ends = (100.0, 100.0 + length_m) if number % 2 == 0 else (100.0 + length_m, 100.0)
        items += [
            place(60.0 * number, ends[0]),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, EVERY_M, 0.0, 1.0),
            place(60.0 * number, ends[1]),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        ]
    items.append(place(0.0, 0.0, Command.NAV_LAND, 0.0))
    return Mission(tuple(items), Home(Point.of_degrees(LAT, LON), GROUND_M), 15.0, 8.0, 12, 2)


def pad(name, east_m, north_m, ground_m):
    at = place(east_m, north_m).point
    return Pad(name, name, at.lat, at.lon, ground_m, 2)


class Camera:
    """Takes pictures by the items that the vehicle has passed, as autopilots do: so far from the last one."""

    def __init__(self, pilot):
        self.pilot, self.every_m, self.last, self.passed, self.pictures = pilot, 0.0, None, -1, []
        self.before = None
        self.after_step = pilot.after_step
        pilot.after_step = self.watch

    def watch(self):
        self.after_step()
        pilot = self.pilot
        run, body = pilot.run, pilot.vehicle.body
        here = (body.lat, body.lon)
        for item in run.items[max(self.passed + 1, 0) : run.current]:
            if item.command == Command.DO_SET_CAM_TRIGG_DIST:
                self.every_m = item.p1
                self.last = self.last or here
                if item.p1 > 0.0 and item.p3 == 1.0:
                    self.take(here)
        self.passed = max(self.passed, run.current - 1)
        if self.every_m > 0.0:
            away, before = (math.hypot(*offset_m(*self.last, *one)) for one in (here, self.before or here))
            if away >= self.every_m:  # between two steps, so that no step is added to the distance
                part = (self.every_m - before) / (away - before) if away > self.every_m > before else 1.0
                self.take(tuple(a + part * (b - a) for a, b in zip(self.before or here, here, strict=True)))
        self.before = here

    def take(self, here):
        self.pictures.append(here)
        self.last = here


class Vehicle:
    """A vehicle at the home of the mission, its camera, and a station that uploads and starts missions."""

    def __init__(self, autopilot, pads, parameters, soc=1.0):
        self.world = World(stations=pads, wind=ConstantWind.of(5.0, 300.0), epoch_s=NOON.timestamp())
        config = VehicleConfig(
            lat=LAT, lon=LON, ground_m=GROUND_M, autopilot=autopilot, warm=True, soc=soc, power_error=1.0
        )
        self.vehicle = self.world.add(config)
        self.lockstep = Lockstep(self.world)
        self.station = Station(self.lockstep, self.lockstep.connect(self.vehicle))
        self.family = missions.family_named(autopilot)
        store = self.vehicle.autopilot.parameters
        for asked in parameters:
            needed = next((way for way in asked.ways if store.find(way.name) is not None and not way.paired), asked)
            have = store.find(needed.name)
            if not needed.accepts(have.value):
                store.set(needed.name, int(have.value) | int(needed.value) if needed.rule == "bits" else needed.value)
        self.camera = Camera(self.vehicle.autopilot)

    def fly(self, mission):
        self.upload(mission)
        self.go()

    def upload(self, mission):
        wire = self.family.to_wire(mission)
        items = [(w.frame, w.command, w.param1, w.param2, w.param3, w.param4, w.x, w.y, w.z) for w in wire]
        assert self.station.upload(items) == 0

    def go(self, item=0, *, goes_on=False):
        """Arm and start, on ArduPilot at an item, as people do who set the current one; fly until it disarms. PX4 goes on when it is armed."""
        station = self.station
        if not goes_on:
            self.camera.passed, self.camera.every_m = item - 1, 0.0
        if self.family.name == "ardupilot":
            station.command(224, item, 0)
            assert station.command(176, 1, 4) == 0
        assert station.command(400, 1) == 0
        if not goes_on:
            assert station.command(300) == 0
        station.until(lambda: not self.vehicle.autopilot.armed, 4000.0)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_cut_survey_is_flown_with_every_picture_where_it_was(autopilot):
    mission, family = survey(), missions.family_named(autopilot)
    pads = (pad("west", -150.0, 700.0, 12.0), pad("east", 620.0, 1500.0, 31.0))
    conditions = missions.FlightConditions(M200_V2, weather=SteadyWind(5.0, 300.0), soc_start=0.7)
    found = recharged(MissionDocument(mission), pads, [family], RechargeOptions(conditions, TransitRules(12.0)))
    assert len(found.plan.stops) >= 1
    flights = found.flights[autopilot]
    whole = Vehicle(autopilot, pads, parameters_of(found, autopilot))
    whole.fly(mission)
    cut = Vehicle(autopilot, pads, parameters_of(found, autopilot), soc=0.7)
    battery = cut.vehicle.battery
    for flight, stop in zip(flights, (*found.plan.stops, None), strict=True):
        cut.fly(flight.document.mission)
        assert battery.soc >= conditions.reserve_soc
        where = (
            (mission.home.point.lat, mission.home.point.lon)
            if stop is None
            else (pads[stop.pad].lat, pads[stop.pad].lon)
        )
        assert math.hypot(*offset_m(*where, cut.vehicle.body.lat, cut.vehicle.body.lon)) < 3.0
        print(f"{autopilot}: lands with {battery.soc:.3f}, check says {flight.report.legs[-1].soc_end:.3f}")
        if stop is not None:
            battery.soc = stop.soc_leave
    assert len(cut.camera.pictures) == len(whole.camera.pictures)
    planned = [(one.lat, one.lon) for one in found.problem.work.pictures]
    # ArduPilot keeps no word of taking the first picture at once
    assert len(planned) - len(whole.camera.pictures) == (autopilot == "ardupilot")
    planned = planned[len(planned) - len(whole.camera.pictures) :]

    # A line is begun within the radius in which a place counts as reached; from there on pictures are as far apart as ordered, over cuts too.
    steps = [one.step for one in found.problem.work.pictures][-len(planned) :]
    north = [offset_m(LAT, LON, *one)[0] for one in cut.camera.pictures]
    within = [n for n in range(1, len(steps) - 1) if steps[n] == steps[n - 1] == steps[n + 1]]
    wrong = [abs(abs(north[n] - north[n - 1]) - EVERY_M) for n in within if steps[n - 1] == steps[max(n - 2, 0)]]
    away = [math.hypot(*offset_m(*one, *other)) for one, other in zip(planned, cut.camera.pictures, strict=True)]
    print(
        f"{autopilot}: {len(planned)} pictures, {EVERY_M:g} m apart but for {max(wrong):.2f} m at most; at most {max(away):.1f} m"
        " from the plan, by where the autopilot begins a line"
    )
    assert max(wrong) <= 1.0
    assert max(away) <= 12.0


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_single_mission_lands_disarmed_on_every_pad_and_goes_on(autopilot):
    mission, family = survey(lines=4), missions.family_named(autopilot)
    pads = (pad("west", -150.0, 700.0, 12.0), pad("east", 620.0, 1500.0, 31.0))
    conditions = missions.FlightConditions(M200_V2, weather=SteadyWind(5.0, 300.0), soc_start=0.5)
    options = RechargeOptions(conditions, TransitRules(12.0), single=True)
    found = recharged(MissionDocument(mission), pads, [family], options)
    assert found.plan.stops
    vehicle = Vehicle(autopilot, pads, parameters_of(found, autopilot), soc=0.5)
    vehicle.upload(found.whole[autopilot].mission)
    told = " ".join(found.notes)
    begins = [0, *(int(one) for one in re.findall(r"(\d+) for battery", told))]
    begins += [0] * (len(found.plan.stops) + 1 - len(begins))  # PX4 goes on by itself
    for number, (begin, stop) in enumerate(zip(begins, (*found.plan.stops, None), strict=True)):
        vehicle.go(begin, goes_on=number > 0 and family.stays_in_mission_after_landing)
        assert vehicle.vehicle.battery.soc >= conditions.reserve_soc
        at = mission.home.point if stop is None else pads[stop.pad]
        assert math.hypot(*offset_m(at.lat, at.lon, vehicle.vehicle.body.lat, vehicle.vehicle.body.lon)) < 3.0
        if stop is not None:
            vehicle.vehicle.battery.soc = stop.soc_leave
    lost = len(found.problem.work.pictures) - len(vehicle.camera.pictures)
    assert lost == (autopilot == "ardupilot"), lost
