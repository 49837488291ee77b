"""What `missions` makes of a plan flies on both families, in every form it is exported."""

import math
from datetime import UTC, datetime, timedelta

import pytest
from sim_station import Station

from skyway import missions
from skyway.models.base import geodesy
from skyway.models.composition.composition import Composition
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.service import DroneService, Stop
from skyway.models.composition.service import Place as PlanPlace
from skyway.models.network.station import Station as Place
from skyway.models.wind.summary import Wind
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

NOON = datetime(2026, 5, 4, 12, 0, tzinfo=UTC)
PLACES = {
    "hill": PlanPlace(40.70, -74.00, 60.0, "Hill", 5),
    "harbour": PlanPlace(40.715, -73.99, 2.0, "Harbour", 5),
    "park": PlanPlace(40.73, -73.98, 25.0, "Park", 0),
}


def service(number, origin, destination, depart):
    a, b = PLACES[origin], PLACES[destination]
    length = geodesy.distance_m(a.lat, a.lon, b.lat, b.lon)
    seconds = length / 12.0 + 32.0
    return DroneService(
        id=f"leg-{number}",
        origin=origin,
        destination=destination,
        via=(),
        depart=depart,
        arrive=depart + timedelta(seconds=seconds),
        distance_m=length,
        bearing_deg=geodesy.bearing_deg(a.lat, a.lon, b.lat, b.lon),
        ground_speed_mps=12.0,
        energy_j=seconds * 700.0,
        soc_depart=0.9,
        soc_arrive=0.7,
        wind=Wind(5.0, 300.0),
        tailwind_mps=1.0,
        crosswind_mps=1.0,
        diverts=("harbour",),
    )


@pytest.fixture(scope="module")
def plan():
    first = service(0, "hill", "harbour", NOON)
    stop = Stop("harbour", first.arrive, 30.0, 120.0, 0.0, 0.7, 0.9)
    second = service(1, "harbour", "park", stop.leave)
    return Composition(
        id="c1",
        planner="exact",
        drone="m200-v2",
        payload_kg=1.0,
        airspeed_mps=15.0,
        max_ground_speed_mps=20.0,
        cruise_height_m=60.0,
        climb_rate_mps=5.0,
        descent_rate_mps=3.0,
        reserve_soc=0.2,
        depart=NOON,
        origin="hill",
        destination="park",
        stations=PLACES,
        services=(first, second),
        stops=(stop,),
        arrival=ArrivalDistribution(None, None, None),
        planning_time_s=0.1,
    )


class Delivery:
    """A vehicle at the origin of the plan, set to the parameters that the export asks for."""

    def __init__(self, autopilot, *exports):
        stations = [Place(k, p.name, p.lat, p.lon, p.elevation_m, p.pads) for k, p in PLACES.items()]
        self.world = World(stations=stations, wind=ConstantWind.of(5.0, 300.0), epoch_s=NOON.timestamp())
        start = PLACES["hill"]
        config = VehicleConfig(
            lat=start.lat, lon=start.lon, ground_m=start.elevation_m, autopilot=autopilot, payload_kg=1.0, warm=True
        )
        self.vehicle = self.world.add(config)
        self.lockstep = Lockstep(self.world)
        self.station = Station(self.lockstep, self.lockstep.connect(self.vehicle))
        self.dialect = missions.family_named(autopilot)
        store = self.vehicle.autopilot.parameters
        for asked in (parameter for export in exports for parameter in export.parameters):
            needed = next((way for way in asked.ways if store.find(way.name) is not None and not way.paired), asked)
            have = store.find(needed.name)
            assert have is not None, f"{needed.name} is a parameter that the vehicle does not have"
            if not needed.accepts(have.value):
                bits = int(have.value) | int(needed.value) if needed.rule == "bits" else needed.value
                store.set(needed.name, bits)

    def fly(self, document):
        """Upload a document, start it; read it back and compare."""
        s, pilot = self.station, self.vehicle.autopilot
        wire = self.dialect.to_wire(document.mission)
        items = [(w.frame, w.command, w.param1, w.param2, w.param3, w.param4, w.x, w.y, w.z) for w in wire]
        assert s.upload(items) == 0
        assert len(s.download()) == len(items)
        if pilot.vehicle.config.autopilot == "ardupilot":
            s.command(224, 0, 0)
            assert s.command(176, 1, 4) == 0
        assert s.command(400, 1) == 0
        assert s.command(300) == 0

    def rest(self):
        self.station.until(lambda: not self.vehicle.autopilot.armed, 3000.0)

    def at(self, name):
        body, place = self.vehicle.body, PLACES[name]
        return math.hypot(*offset_m(place.lat, place.lon, body.lat, body.lon)) < 3.0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_leg_by_leg_with_the_package_released_at_the_end(plan, autopilot):
    dialect = missions.family_named(autopilot)
    exports = [missions.leg_mission(plan, number, dialect) for number in (0, 1)]
    delivery = Delivery(autopilot, *exports)
    for number, place in ((0, "harbour"), (1, "park")):
        delivery.fly(exports[number].documents[0])
        delivery.rest()
        assert delivery.at(place)
    assert delivery.vehicle.body.payload_kg == 0.0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_whole_mission_disarmed_on_every_pad(plan, autopilot):
    export = missions.whole_mission(plan, missions.family_named(autopilot))
    delivery = Delivery(autopilot, export)
    if autopilot == "px4":
        delivery.fly(export.documents[0])
        delivery.rest()
        assert delivery.at("harbour")
        delivery.station.run(60.0)
        assert delivery.station.command(400, 1) == 0, "a plain arm resumes"
        delivery.rest()
    else:
        for document in export.documents:
            delivery.fly(document)
            delivery.rest()
    assert delivery.at("park")
    assert delivery.vehicle.body.payload_kg == 0.0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_armed_mission_stays_armed_on_the_pad_and_leaves_by_the_clock(plan, autopilot):
    export = missions.armed_mission(plan, missions.family_named(autopilot))
    delivery = Delivery(autopilot, export)
    delivery.fly(export.documents[0])
    delivery.station.until(lambda: delivery.at("harbour") and delivery.vehicle.autopilot.landed, 900.0)
    delivery.station.run(60.0)
    assert delivery.vehicle.autopilot.armed
    delivery.rest()
    assert delivery.at("park")
