"""A ground station for tests: pymavlink messages over a lockstep link, patient and careful."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from skyway.models.network.station import Station as Place
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

NAN = math.nan
LAT, LON = 40.7392, -73.9756
M_PER_DEG = 111_045.0
TAKEOFF, WAYPOINT, LAND, DELAY, SPEED, JUMP, DISARM = 22, 16, 21, 93, 178, 177, 400


def item(command, north_m=0.0, east_m=0.0, z=40.0, frame=3, p=(0, 0, 0, NAN), x=None, y=None):
    """(frame, command, p1..p4, x, y, z), placed by metres from the start."""
    if x is None:
        lat = LAT + north_m / M_PER_DEG
        lon = LON + east_m / (M_PER_DEG * math.cos(math.radians(LAT)))
        x, y = (0, 0) if frame == 2 else (round(lat * 1e7), round(lon * 1e7))
    return (frame, command, *p, x, y, z)


def plain(command, *p, frame=2):
    return (frame, command, *p, *(0,) * (4 - len(p)), 0, 0, 0)


class Station:
    """One ground station on one link."""

    def __init__(self, lockstep, link, system=255, target=1, mavlink1=False):
        self.lockstep, self.link, self.target, self.mavlink1 = lockstep, link, target, mavlink1
        self.mav = dialect.MAVLink(None, system, 190)
        self.mav.robust_parsing = True
        self.seen, self.texts, self.beating = [], [], 0.0

    def send(self, message):
        self.link.write(message.pack(self.mav, force_mavlink1=self.mavlink1))

    def read(self, seconds):
        """Messages of the next stretch of time, at the latest `seconds`; sends heartbeats meanwhile."""
        if self.lockstep.now_s >= self.beating:
            self.beating = self.lockstep.now_s + 1.0
            self.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        wait = min(seconds, max(self.beating - self.lockstep.now_s, 0.0))
        found = self.mav.parse_buffer(self.link.read(wait)) or []
        self.seen += found
        self.texts += [m.text for m in found if m.get_type() == "STATUSTEXT"]
        return found

    def run(self, seconds):
        end = self.lockstep.now_s + seconds
        found = []
        while self.lockstep.now_s < end:
            found += self.read(end - self.lockstep.now_s)
        return found

    def wait(self, kind, seconds=5.0, **fields):
        end = self.lockstep.now_s + seconds
        while True:
            for m in self.read(end - self.lockstep.now_s):
                if m.get_type() == kind and all(getattr(m, k) == v for k, v in fields.items()):
                    return m
            if self.lockstep.now_s >= end:
                return None

    def until(self, condition, seconds=600.0):
        end = self.lockstep.now_s + seconds
        while not condition():
            assert self.lockstep.now_s < end, "it never happened"
            self.read(end - self.lockstep.now_s)

    def command(self, number, *p, seconds=3.0):
        p = [*p, *[0] * (7 - len(p))]
        self.send(dialect.MAVLink_command_long_message(self.target, 1, number, 0, *p))
        ack = self.wait("COMMAND_ACK", seconds, command=number)
        return None if ack is None else ack.result

    def command_int(self, number, p, lat, lon, z, frame=6):
        self.send(
            dialect.MAVLink_command_int_message(
                self.target, 1, frame, number, 0, 0, *p, round(lat * 1e7), round(lon * 1e7), z
            )
        )
        ack = self.wait("COMMAND_ACK", command=number)
        return None if ack is None else ack.result

    def item_message(self, seq, it, kind=0, current=0):
        frame, command, p1, p2, p3, p4, x, y, z = it
        return dialect.MAVLink_mission_item_int_message(
            self.target, 1, seq, frame, command, current, 1, p1, p2, p3, p4, x, y, z, kind
        )

    def upload(self, items, kind=0, current=None, seconds=60.0):
        """Answer every request; returns the result of the MISSION_ACK, None for silence."""
        end = self.lockstep.now_s + seconds
        self.send(dialect.MAVLink_mission_count_message(self.target, 1, len(items), kind))
        asked = False
        while self.lockstep.now_s < end:
            batch = self.read(1.5 if not asked else end - self.lockstep.now_s)
            if not batch and not asked:
                self.send(dialect.MAVLink_mission_count_message(self.target, 1, len(items), kind))
            for m in batch:
                if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and m.seq < len(items):
                    asked = True
                    marked = int(current == m.seq)
                    self.send(self.item_message(m.seq, items[m.seq], kind, marked))
                if m.get_type() == "MISSION_ACK" and m.mission_type == kind:
                    return m.type
        return None

    def download(self, kind=0, as_int=True):
        self.send(dialect.MAVLink_mission_request_list_message(self.target, 1, kind))
        count = self.wait("MISSION_COUNT")
        items = []
        ask = dialect.MAVLink_mission_request_int_message if as_int else dialect.MAVLink_mission_request_message
        for seq in range(count.count):
            for _ in range(20):
                self.send(ask(self.target, 1, seq, kind))
                got = self.wait("MISSION_ITEM_INT" if as_int else "MISSION_ITEM", 0.5, seq=seq)
                if got is not None:
                    break
            items.append(got)
        self.send(dialect.MAVLink_mission_ack_message(self.target, 1, 0, kind))
        self.run(0.1)
        return items

    def parameter(self, name):
        self.send(dialect.MAVLink_param_request_read_message(self.target, 1, name.encode(), -1))
        return self.wait("PARAM_VALUE", param_id=name)

    def set_parameter(self, name, value, kind=9):
        self.send(dialect.MAVLink_param_set_message(self.target, 1, name.encode(), value, kind))
        return self.wait("PARAM_VALUE", param_id=name)


class Stage:
    """One vehicle in a world with one station on it."""

    def __init__(self, autopilot="px4", *, wind=None, faults=(), impairment=None, stations=(), seed=1, **config):
        self.world = World(wind=wind or ConstantWind(), faults=faults, stations=stations)
        config.setdefault("warm", True)
        config.setdefault("power_error", 1.0)
        self.vehicle = self.world.add(
            VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, autopilot=autopilot, seed=seed, **config)
        )
        self.lockstep = Lockstep(self.world)
        self.station = Station(self.lockstep, self.lockstep.connect(self.vehicle, impairment, seed=seed))

    @property
    def pilot(self):
        return self.vehicle.autopilot

    @property
    def events(self):
        return [event.text for event in self.world.events]

    def happened(self, text):
        return any(text in event for event in self.events)

    def mission(self, *items):
        """The items in the vehicle's own numbering: ArduPilot's home goes first."""
        return ([item(WAYPOINT, z=0.0, frame=0)] if self.vehicle.config.autopilot == "ardupilot" else []) + list(items)

    def start(self):
        """Arm and start the mission as each family wants it; returns the results of the commands."""
        s = self.station
        if self.vehicle.config.autopilot == "px4":
            return s.command(400, 1), s.command(300)
        return s.command(176, 1, 4), s.command(400, 1), s.command(300)

    def take_off(self, height=30.0):
        """Hover at a height."""
        s = self.station
        if self.vehicle.config.autopilot == "px4":
            assert s.command(400, 1) == 0
            assert s.command(22, 0, 0, 0, NAN, NAN, NAN, self.pilot.body.alt_m + height) == 0
        else:
            assert s.command(176, 1, 4) == 0
            assert s.command(400, 1) == 0
            assert s.command(22, 0, 0, 0, 0, 0, 0, height) == 0
        s.until(lambda: self.vehicle.body.alt_m > self.pilot.home_alt_m + height - 1.0, 120.0)
        s.run(5.0)

    def rest(self, seconds=900.0):
        """Let it fly until it stands disarmed."""
        self.station.until(lambda: not self.pilot.armed and self.vehicle.body.grounded, seconds)


def pads_stage(pads=1, spots=1, load=None, soc=0.4, seed=1, **place):
    """One vehicle that stands at a station with pads, and the pads."""
    stage = Stage("px4", stations=[Place("here", "here", LAT, LON, 5.0, pads, spots, **place)], soc=soc)
    port = stage.vehicle.radio.ports[0]
    port.streams.clear()  # hours on a pad, and nobody listens
    port.reschedule()
    return stage, Pads(stage.world, load, seed=seed)


def leg(*, distance=400.0, height=40.0):
    """Take off, fly north, land."""
    return (
        item(TAKEOFF, z=height),
        item(WAYPOINT, distance, z=height),
        item(LAND, distance, z=0.0),
    )


def away(stage, north_m=0.0, east_m=0.0):
    """Metres of the vehicle from a point given from the start."""
    north, east = offset_m(LAT, LON, stage.vehicle.body.lat, stage.vehicle.body.lon)
    return math.hypot(north - north_m, east - east_m)


def height(stage):
    """Height of the vehicle above its start, metres."""
    return stage.vehicle.body.alt_m - 5.0
