"""A ground station of ours on a simulated vehicle, in virtual time, and packets that somebody meddles with."""

import math
from collections import Counter

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.verified import UploadJob, upload_verified
from skyway.link.wire.frames import FrameReader, FrameWriter
from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.geofence import FencePolygon, Geofence
from skyway.missions.items.mission import Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

LAT, LON = 40.7392, -73.9756
HEARTBEAT_ID = 0
FAMILIES = ("px4", "ardupilot")


def waypoint(number, *, height=50.0, command=Command.NAV_WAYPOINT):
    x, y = round((LAT + 1e-4 * (number + 1)) * 1e7), round((LON + 1e-4 * (number % 7)) * 1e7)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=height + number % 13, param4=math.nan)


def a_mission(items=20, *, height=50.0):
    """Take off, waypoints, land: so many items."""
    middle = [waypoint(n, height=height) for n in range(1, items - 1)]
    land = MissionItem(Command.NAV_LAND, Frame.GLOBAL_RELATIVE_ALT, x=middle[-1].x, y=middle[-1].y)
    return Mission((waypoint(0, height=height, command=Command.NAV_TAKEOFF), *middle, land))


def place(north, east):
    return Point(round((LAT + north) * 1e7), round((LON + east) * 1e7))


def a_fence():
    corners = ((-0.01, -0.01), (-0.01, 0.01), (0.01, 0.01), (0.01, -0.01))
    return Geofence((FencePolygon(tuple(place(*corner) for corner in corners)),))


def some_rally_points():
    return RallyPoints((RallyPoint(place(0.0, 0.0), 40.0), RallyPoint(place(0.002, 0.0), 60.0)))


def bad_radio(loss=0.0, **how):
    how = {"delay_s": 0.02, "jitter_s": 0.005, "duplicate": 0.03, "reorder": 0.03} | how
    return Impairment(loss=loss, **how)


def changed_frame(message, **changed):
    """The same message with other fields, as somebody who meddles would send it."""
    return FrameWriter(message.system, message.component).frame(message.name, message.fields | changed)


class Meddler:
    """A transport that counts, drops and changes messages.

    `spoil(number, name, frame, up)` gets each message in its order and returns the frames to pass instead.
    """

    def __init__(self, inner, spoil=None):
        self.inner, self.spoil, self.count = inner, spoil, 0
        self.log = []
        self._readers = (FrameReader(), FrameReader())

    def _pass(self, data, up):
        passed = b""
        for frame, message in self._readers[up].feed(data):
            name = message.name if message else "?"
            if name.startswith("MISSION_") and name not in ("MISSION_CURRENT", "MISSION_ITEM_REACHED"):
                number, self.count = self.count, self.count + 1
                self.log.append((name, up))
            else:
                number = self.count
            passed += frame if self.spoil is None else self.spoil(number, message, frame, bool(up))
        return passed

    def read(self, timeout_s=0.0):
        return self._pass(self.inner.read(timeout_s), 0)

    def write(self, data):
        data = self._pass(data, 1)
        if data:
            self.inner.write(data)

    def close(self):
        self.inner.close()


class Scene:
    """One simulated vehicle, and our connection to it."""

    def __init__(self, family="px4", *, impairment=None, seed=1, spoil=None, faults=(), signing=None, **config):
        self.world = World(wind=ConstantWind(), faults=faults)
        config.setdefault("warm", True)
        self.vehicle = self.world.add(
            VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, autopilot=family, seed=seed, power_error=1.0, **config)
        )
        self.family = family
        self.lockstep = Lockstep(self.world)
        self.link = Meddler(self.lockstep.connect(self.vehicle, impairment, seed=seed), spoil)
        self.connection = Connection(self.link, self.lockstep.clock, signing=signing)

    def meet(self):
        assert self.connection.wait(lambda: 1 in self.connection.peers, 20.0), "never heard"
        return self.connection.peers[1]

    def job(self, part, **more):
        peer = self.meet()
        more.setdefault("may_roll_back", lambda: True)
        texts = lambda: [text for _, text in peer.texts]  # noqa: E731
        return UploadJob(peer.target, family_named(self.family), part, texts=texts, **more)

    def upload(self, part, **more):
        return self.connection.perform(upload_verified(self.job(part, **more)))

    def stored(self, kind=0):
        """What the vehicle holds, in our numbering: commands with places and heights."""
        items = self.vehicle.autopilot.stores[kind]
        shift = int(self.family == "ardupilot" and kind == 0)
        return [(int(i.command), i.x, i.y, round(i.z, 2)) for i in items[shift:]]

    def quiet(self):
        """Stop telemetry: nothing but the mission protocol costs time."""
        for port in self.vehicle.radio.ports:
            port.streams = {k: s for k, s in port.streams.items() if k == HEARTBEAT_ID}
            port.next_due_s = min(s.due_s for s in port.streams.values())


def as_stored(mission):
    return [(int(i.command), i.x, i.y, round(i.z, 2)) for i in mission.items]


def rates_hz(craft, duration_s):
    """Messages a second of each name that come from a vehicle, over some time."""
    counts = Counter()
    craft.connection.listeners.append(
        lambda peer, message: counts.update([message.name]) if peer is craft.peer else None
    )
    craft.connection.run_for(duration_s)
    return {name: count / duration_s for name, count in counts.items()}
