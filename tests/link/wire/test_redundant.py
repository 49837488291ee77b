"""Several radios to one vehicle: each packet once, the better one used, failover in time, and echoes that fool nobody."""

import pytest
from wires import LAT, LON, a_mission

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.opening import open_connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.redundant import RedundantTransport
from skyway.models.base.errors import InputError
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World


class Cut:
    """A radio that can be switched off."""

    def __init__(self, inner):
        self.inner, self.off = inner, False

    def read(self, timeout_s=0.0):
        data = self.inner.read(timeout_s)
        return b"" if self.off else data

    def write(self, data):
        if not self.off:
            self.inner.write(data)

    def close(self):
        self.inner.close()


class Copy:
    """A second radio of the same channel: what the first one gets, a moment later, and nothing of its own way out."""

    def __init__(self, first, echo=False):
        self.first, self.echo, self.off = first, echo, False
        self.waiting = []
        read, write = first.read, first.write

        def heard(timeout_s=0.0):
            data = read(timeout_s)
            if data and not self.echo:
                self.waiting.append(data)
            return data

        def sent(data):
            if self.echo:
                self.waiting.append(data)
            write(data)

        first.read, first.write = heard, sent

    def read(self, timeout_s=0.0):
        found, self.waiting = b"".join(self.waiting), []
        return b"" if self.off else found

    def write(self, data):
        if self.echo:
            self.waiting.append(data)

    def close(self):
        pass


class Scene:
    def __init__(self, second="channel", autopilot="px4", losses=(0.0, 0.0)):
        world = World(wind=ConstantWind())
        self.craft = world.add(VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, autopilot=autopilot, warm=True))
        lockstep = Lockstep(world)
        self.clock = lockstep.clock
        ways = [Cut(lockstep.connect(self.craft, Impairment(loss=loss), seed=n)) for n, loss in enumerate(losses)]
        if second != "channel":
            ways[1] = Copy(ways[0], echo=second == "echo")
        self.ways = ways
        self.radios = RedundantTransport([("telemetry", ways[0]), ("lte", ways[1])], self.clock.now_s)
        self.connection = Connection(self.radios, self.clock)
        self.heard = []
        self.connection.listeners.append(lambda peer, message: self.heard.append((self.clock.now_s(), message)))
        self.vehicle = Vehicle(self.connection, 1)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("second", ["channel", "copy"])
def test_each_packet_is_taken_once_and_orders_are_answered(second, autopilot):
    scene = Scene(second, autopilot)
    scene.vehicle.request_telemetry()
    scene.connection.run_for(5.0)
    scene.heard.clear()
    begun = scene.clock.now_s()
    scene.connection.run_for(10.0)
    times = [message["time_boot_ms"] for _, message in scene.heard if message.name == "ATTITUDE"]
    assert len(times) == len(set(times))
    assert len(times) >= 9.0 * (scene.clock.now_s() - begun)
    assert scene.vehicle.upload(a_mission(20)).verified
    assert scene.connection.peers[1].lost == 0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_radio_that_falls_silent_is_replaced_within_two_seconds_and_told(autopilot):
    scene = Scene("channel", autopilot)
    scene.vehicle.request_telemetry()
    scene.connection.run_for(5.0)
    scene.radios.notes()
    scene.ways[0].off = True
    cut_s = scene.clock.now_s()
    scene.heard.clear()
    assert scene.connection.wait(lambda: scene.heard and scene.radios.used.name == "lte", 5.0)
    assert scene.heard[0][0] - cut_s <= 2.0
    assert scene.vehicle.answers()
    said = scene.radios.notes()
    assert said[0] == "radio telemetry is silent"
    assert "radio lte" in said[1]
    assert "is used instead" in said[1]


def test_of_two_radios_the_one_that_loses_less_is_used_in_the_end():
    scene = Scene(losses=(0.4, 0.02))
    scene.vehicle.nudge_telemetry()
    scene.connection.run_for(20.0)
    assert scene.radios.used.name == "lte"
    assert [radio.loss > 0.25 for radio in scene.radios.radios] == [True, False]


def test_a_radio_that_is_an_echo_is_told_in_one_line_and_nothing_is_heard_twice():
    scene = Scene("echo")
    scene.vehicle.request_telemetry()
    scene.connection.run_for(5.0)
    assert [note for note in scene.radios.notes() if "echoes packets" in note] == [
        "radio lte echoes packets: its echoes are dropped"
    ]
    assert scene.radios.used.name == "telemetry"
    assert scene.connection.conflict is None
    assert scene.vehicle.upload(a_mission(10)).verified


def test_the_same_radio_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="the same radio twice"):
        open_connection(["udpin:127.0.0.1:14999", "udpin:127.0.0.1:14999"], record=tmp_path)
