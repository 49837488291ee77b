"""Other ground stations on our link: what they see, what they may, and what they cannot do to the flight."""

import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_serving import free_port, served
from wires import FAMILIES, Scene, a_mission

from skyway.cli.views.watch import Watched
from skyway.link.files.aboard import LogStore
from skyway.link.files.fetching import fetch
from skyway.link.forwarding.clients import BURST_BYTES
from skyway.link.forwarding.forwarder import Forwarder
from skyway.link.forwarding.permission import Permission
from skyway.link.protocol.connection import Connection
from skyway.link.protocol.opening import open_connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.signing import Signing
from skyway.link.wire.transport import UdpSocket
from skyway.models.base.address import Address
from skyway.models.base.errors import InputError, LinkLostError

OWN = (255, 195)


class Shared(Scene):
    """A simulated vehicle, our connection to it, and a listening address for other stations, in virtual time."""

    key = None

    def __init__(self, family="px4", permission=Permission.PILOT, kind="udpin", **more):
        super().__init__(family, **more)
        self.links = []
        self.key = more.get("signing_key")
        self.forwarder = Forwarder((f"{kind}:127.0.0.1:0",), permission, own=OWN, signing=self.signing)
        self.port = self.forwarder.endpoints[0].port
        self.connection = Connection(self.link, self.lockstep.clock, signing=self.signing(), forwarder=self.forwarder)
        self.craft = Vehicle(self.connection, 1)

    def signing(self):
        if self.key is None:
            return None
        state = Signing(self.key)
        state.advance_to(self.lockstep.clock.posix_s())
        return state

    def client(self, system=255, component=190):
        """Return a station of pymavlink's, once the vehicle's side knows it."""
        link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{self.port}", source_system=system, source_component=component
        )
        self.links.append(link)
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        self.run(0.1)
        return link

    def run(self, duration_s):
        self.connection.run_for(duration_s)
        self.forwarder.flush()

    def heard(self, link, duration_s=1.0):
        """Messages that a client has got after some time."""
        self.run(duration_s)
        found = []
        while (message := link.recv_msg()) is not None:
            found.append(message)
        return found

    def close(self):
        self.connection.close()
        for link in self.links:
            link.close()


@pytest.fixture
def shared(request):
    scene = Shared(**getattr(request, "param", {}))
    yield scene
    scene.close()


def names(messages):
    return {message.get_type() for message in messages}


def test_a_client_sees_the_vehicle_and_only_the_answers_that_are_meant_for_it(shared):
    asks, watches = shared.client(255, 190), shared.client(254, 190)
    seen = shared.heard(watches)
    assert {"HEARTBEAT", "ATTITUDE"} <= names(seen)
    assert OWN in {(m.get_srcSystem(), m.get_srcComponent()) for m in seen if m.get_type() == "HEARTBEAT"}
    asks.mav.param_request_read_send(1, 1, b"MPC_XY_CRUISE", -1)
    asks.mav.command_long_send(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    answers = names(shared.heard(asks))
    assert {"PARAM_VALUE", "COMMAND_ACK", "AUTOPILOT_VERSION"} <= answers
    assert "COMMAND_ACK" not in names(shared.heard(watches, 0.1))
    shared.craft.parameter("MPC_XY_CRUISE")  # our own go on beside it, and their answers are ours
    assert "COMMAND_ACK" not in names(shared.heard(asks, 0.1))


def orders(link):
    """Orders of all kinds, each with what shows that it was obeyed."""
    return {
        "read": lambda: link.mav.mission_request_list_send(1, 1, 0),
        "mode": lambda: link.mav.command_long_send(1, 1, 176, 0, 1, 3, 0, 0, 0, 0, 0),
        "parameter": lambda: link.mav.param_set_send(1, 1, b"MPC_XY_CRUISE", 7.0, 9),
        "mission": lambda: link.mav.mission_count_send(1, 1, 5, 0),
        "reboot": lambda: link.mav.command_long_send(1, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0),
    }


@pytest.mark.parametrize(
    ("permission", "obeyed"),
    [
        (Permission.NONE, {"read"}),
        (Permission.PILOT, {"read", "mode"}),
        (Permission.ALL, {"read", "mode", "parameter", "mission", "reboot"}),
    ],
)
def test_what_is_not_allowed_does_not_pass_and_is_answered_and_told_once(permission, obeyed):
    shared = Shared(permission=permission)
    link, begun = shared.client(), shared.craft.reboots
    answered = {}
    for name, order in orders(link).items():
        for _ in range(3):  # stations try again
            order()
        answered[name] = {m.get_type(): m for m in shared.heard(link, 0.5)}
    obeys = {
        "read": "MISSION_COUNT" in answered["read"],
        "mode": shared.craft.mode == "position",
        "parameter": shared.vehicle.autopilot.parameters["MPC_XY_CRUISE"] == 7.0,
        "mission": bool(set(answered["mission"]) & {"MISSION_REQUEST_INT", "MISSION_REQUEST"}),
    }
    shared.run(20.0)
    obeys["reboot"] = shared.craft.reboots > begun
    done = {name for name, so in obeys.items() if so}
    assert done == obeyed
    said = [note.said for note in shared.forwarder.notes()]
    assert len(said) == 1 + (5 - 1)  # it is there, and each order but the reading one
    assert sum("refused" in line for line in said) == 5 - len(obeyed)
    if "mode" not in obeyed:
        assert answered["mode"]["COMMAND_ACK"].result == dialect.MAV_RESULT_DENIED
    if "mission" not in obeyed:
        assert answered["mission"]["MISSION_ACK"].type == dialect.MAV_MISSION_DENIED
    shared.close()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_station_cannot_slow_down_the_telemetry_that_we_ask_for(family):
    shared = Shared(family)
    link = shared.client()
    shared.craft.request_telemetry()
    for _ in range(3):
        link.mav.command_long_send(1, 1, 511, 0, 30, 1e6, 0, 0, 0, 0, 0)
        link.mav.request_data_stream_send(1, 1, 0, 1, 1)
    attitudes = [m for m in shared.heard(link, 5.0) if m.get_type() == "ATTITUDE"]
    assert len(attitudes) >= 45
    shared.close()


def test_a_station_does_not_disturb_a_transfer_of_ours(shared):
    link = shared.client()
    shared.connection.listeners.append(lambda *_: link.mav.mission_request_list_send(1, 1, 0))
    assert shared.craft.upload(a_mission(30)).verified


@pytest.mark.parametrize("shared", [{"logs": (20_000,)}, {"family": "ardupilot", "logs": (20_000,)}], indirect=True)
def test_a_log_goes_to_the_one_who_asked_for_it_and_to_nobody_else(shared, tmp_path):
    asks, watches = shared.client(255, 190), shared.client(254, 190)
    asks.mav.log_request_list_send(1, 1, 0, 0xFFFF)
    assert "LOG_ENTRY" in names(shared.heard(asks))
    asks.mav.log_request_data_send(1, 1, int(shared.family == "ardupilot"), 0, 20_000)
    pieces = [message for message in shared.heard(asks, 3.0) if message.get_type() == "LOG_DATA"]
    assert sum(piece.count for piece in pieces) == 20_000
    assert not names(shared.heard(watches, 0.1)) & {"LOG_ENTRY", "LOG_DATA"}
    store = LogStore(shared.craft, "requests")
    fetch(store, store.logs()[0], tmp_path)  # ours goes to no client
    for client in (asks, watches):
        assert not names(shared.heard(client, 0.1)) & {"LOG_ENTRY", "LOG_DATA"}


def frames_of(system, component, count):
    writer = FrameWriter(system, component)
    beat = {"type": 6, "autopilot": 8, "system_status": 4, "mavlink_version": 3}
    return [writer.frame("HEARTBEAT", beat) for _ in range(count)]


def flood(shared, there):
    for frame in frames_of(254, 190, 100):
        there.send(frame * 60)


def short_packets(shared, there):
    """Not many bytes, but more packets than any vehicle answers."""
    for number, frame in enumerate(frames_of(254, 190, 700)):
        there.send(frame)
        if number % 25 == 0:
            shared.run(0.02)


def garbage(shared, there):
    for _ in range(12):
        there.send(os.urandom(400) + b"\xfd" * 100)


def echo(shared, there):
    for _ in range(10):
        shared.run(0.1)
        try:
            there.send(there.recv(4096, socket.MSG_DONTWAIT))
        except BlockingIOError:
            continue


def takes_the_vehicles_id(shared, there):
    for frame in frames_of(1, 1, 3):
        there.send(frame)


def takes_our_id(shared, there):
    for frame in frames_of(*OWN, 103)[100:]:
        there.send(frame)


@pytest.mark.parametrize(
    ("deed", "told"),
    [
        (flood, "floods the link"),
        (short_packets, "200 packets a second"),
        (garbage, "does not send MAVLink"),
        (echo, "echoes packets"),
        (takes_the_vehicles_id, "speaks as vehicle 1"),
        (takes_our_id, "uses our system and component id"),
    ],
)
def test_a_bad_client_is_told_in_one_line_and_the_link_goes_on_as_before(deed, told, shared):
    up = []
    shared.link.spoil = lambda number, message, frame, is_up: up.append(frame) or frame if is_up else frame
    there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    there.connect(("127.0.0.1", shared.port))
    for frame in frames_of(250, 1, 1):
        there.send(frame)
    shared.run(0.1)
    shared.forwarder.notes()
    received, begun = shared.craft.peer.received, len(up)
    for _ in range(3):
        deed(shared, there)
        shared.run(1.0)
    said = [note.said for note in shared.forwarder.notes() if note.what != "joined"]
    assert len(said) == 1, said
    assert told in said[0]
    assert shared.craft.peer.received > received + 30
    assert shared.connection.conflict is None
    bound = 2 * BURST_BYTES + 3 * 25_000
    assert sum(map(len, up[begun:])) < bound
    assert not [frame for frame in up if frame[5:7] == b"\x01\x01"]
    there.close()


def test_one_that_has_a_thousand_kinds_of_orders_refused_gets_a_few_lines(shared):
    link, pilots = shared.client(), shared.client(254, 190)
    told = []
    for kind in range(1000, 2000, 10):
        link.mav.command_long_send(1, 1, kind, 0, 0, 0, 0, 0, 0, 0, 0)
        shared.run(0.05)
        told += shared.forwarder.notes()
    assert sum(note.what == "refused" for note in told) <= 8
    assert sum("further ones are not listed" in note.said for note in told) == 1
    pilots.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    shared.run(0.1)
    passed = [note.client for note in shared.forwarder.notes() if note.what == "passed"]
    assert len(passed) == 2  # what a vehicle hears is told, whoever says it
    shared.run(12.0)
    link.mav.command_long_send(1, 1, 3001, 0, 0, 0, 0, 0, 0, 0, 0)
    shared.run(0.1)
    assert [note.order for note in shared.forwarder.notes() if note.what == "refused"] == ["ARM_AUTHORIZATION_REQUEST"]


def test_two_routers_back_to_back_do_not_go_round_in_circles(shared):
    """Another of us takes the link from our client address, and forwards what it hears to the same address."""
    up = []
    shared.link.spoil = lambda number, message, frame, is_up: up.append(frame) or frame if is_up else frame
    address = Address("udpout", "127.0.0.1", shared.port)
    other = Connection(
        UdpSocket(address), shared.lockstep.clock, forwarder=Forwarder((str(address),), Permission.ALL, own=(253, 195))
    )
    for _ in range(500):
        shared.run(0.01)
        other.pump(0.0)
    assert other.peers[1].received > 50
    assert len(up) < 3 * 8  # our heartbeat and the other's, once a second each
    assert any(note.what == "impersonates" for note in shared.forwarder.notes())
    other.close()


@pytest.mark.parametrize("shared", [{"kind": "tcpin"}], indirect=True)
def test_a_client_that_takes_nothing_delays_nobody_and_is_cut_off(shared):
    deaf = socket.create_connection(("127.0.0.1", shared.port))
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    hears = socket.create_connection(("127.0.0.1", shared.port))
    hears.settimeout(0.0)
    shared.run(0.1)
    assert len(list(shared.forwarder.clients())) == 2
    frame = FrameWriter(1, 1).frame("ATTITUDE", {"time_boot_ms": 5, "roll": 0.5, "pitch": 0.5, "yaw": 0.5})
    got, longest_s = 0, 0.0
    for _ in range(1500):
        begun = time.perf_counter()
        for client in shared.forwarder.clients():
            for _ in range(100):
                client.put(frame)
            client.flush()
        shared.connection.pump(0.02)
        longest_s = max(longest_s, time.perf_counter() - begun)
        try:
            while data := hears.recv(1 << 20):
                got += len(data)
        except BlockingIOError:
            pass
        if len(list(shared.forwarder.clients())) == 1:
            break
    assert len(list(shared.forwarder.clients())) == 1
    assert longest_s < 0.2
    assert got > 100_000
    for one in (deaf, hears):
        one.close()


def test_on_a_signed_link_only_signed_packets_of_clients_pass():
    key = bytes(range(32))
    shared = Shared(signing_key=key)
    link = shared.client()
    orders(link)["mode"]()
    shared.run(2.5)
    assert shared.craft.mode != "position"
    link.setup_signing(key, sign_outgoing=True)
    link.mav.signing.timestamp = 1000
    orders(link)["mode"]()
    shared.run(2.5)
    assert shared.craft.mode == "position"
    shared.close()


def test_an_address_that_cannot_be_forwarded_to_is_named(tmp_path):
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    for text, problem in {
        "nowhere": "--forward: not a connection",
        f"udpin:127.0.0.1:{taken.getsockname()[1]}": "--forward: cannot listen",
        f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}": "--forward: cannot connect",
    }.items():
        with pytest.raises((InputError, LinkLostError), match=problem):
            open_connection("udpin:127.0.0.1:0", record=tmp_path, forward=("udpin:127.0.0.1:0", text))
    assert list(tmp_path.iterdir()) == []
    taken.close()


def test_mavsdk_flies_through_us_and_its_mission_is_refused():
    import mavsdk
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

    port, ours = free_port(), free_port()
    connection = open_connection(f"udpin:127.0.0.1:{ours}", record=None, forward=(f"udpout:127.0.0.1:{port}",))
    with served(connect=(f"udpout:127.0.0.1:{ours}",), autopilot="px4") as there:
        Vehicle(connection).request_telemetry()
        sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        ended = threading.Event()

        def pump():
            while not ended.is_set():
                connection.pump(0.02)

        pumping = threading.Thread(target=pump)
        pumping.start()
        try:
            found = sdk.first_autopilot(10.0)
            assert found is not None
            Action(found).arm()
            Action(found).takeoff()
            end = time.monotonic() + 10.0
            vehicle = next(iter(there.world.vehicles.values()))
            while vehicle.body.grounded and time.monotonic() < end:
                time.sleep(0.1)
            assert not vehicle.body.grounded
            item = MissionItem(0, 6, 16, 1, 1, 0.0, 0.0, 0.0, float("nan"), 407392000, -739756000, 20.0, 0)
            with pytest.raises(mavsdk.MavsdkError):
                MissionRaw(found).upload_mission([item])
            assert not vehicle.autopilot.stores[0]
        finally:
            ended.set()
            pumping.join()
            sdk.destroy()
    said = [note.said for note in connection.forwarder.notes()]
    assert any("COMPONENT_ARM_DISARM" in line and "passed on" in line for line in said)
    assert any("MISSION_COUNT" in line and "refused" in line for line in said)
    connection.close()


@pytest.mark.slow
def test_mavproxy_flies_through_us(tmp_path):
    port, ours = free_port(), free_port()
    connection = open_connection(f"udpin:127.0.0.1:{ours}", record=None, forward=(f"udpout:127.0.0.1:{port}",))
    mavproxy = [sys.executable, Path(sys.executable).parent / "mavproxy.py", f"--master=udpin:127.0.0.1:{port}"]
    folders = [f"--state-basedir={tmp_path}", f"--logfile={tmp_path / 'other.tlog'}"]
    with served(connect=(f"udpout:127.0.0.1:{ours}",), autopilot="ardupilot"):
        craft = Vehicle(connection)
        with subprocess.Popen(
            [*mavproxy, *folders], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path
        ) as other:  # fmt: skip
            clients = list(connection.forwarder.clients())
            assert connection.wait(lambda: any(client.speakers for client in clients), 30.0)
            connection.run_for(3.0)
            other.stdin.write("mode GUIDED\nwp list\nwp clear\n")
            other.stdin.flush()
            assert connection.wait(lambda: craft.mode == "guided", 10.0)
            connection.run_for(3.0)
            other.terminate()
            said = other.communicate()[0]
    assert "Got COMMAND_ACK: DO_SET_MODE: ACCEPTED" in said
    assert "Requesting 0 waypoints" in said
    told = [note.said for note in connection.forwarder.notes()]
    assert any("MISSION_CLEAR_ALL" in line and "refused" in line for line in told), told
    connection.close()


def test_watching_tells_of_every_station_and_of_an_order_again_when_it_comes_again(shared):
    watched = Watched(shared.connection)
    links = [shared.client(system=200 + number) for number in range(7)]
    links[3].mav.command_long_send(1, 1, dialect.MAV_CMD_NAV_LAND, 0, *(7 * [0.0]))
    shared.run(1.0)
    told = watched.news()
    assert sum("joined" in line for line in told) == len(links)
    assert sum("NAV_LAND to vehicle 1: passed on" in line for line in told) == 1
    assert watched.news() == []
    shared.run(10.0)
    links[3].mav.command_long_send(1, 1, dialect.MAV_CMD_NAV_LAND, 0, *(7 * [0.0]))
    shared.run(1.0)
    assert [line.split("sends ")[1] for line in watched.news()] == ["NAV_LAND to vehicle 1: passed on"]
    assert len(watched.lately()) == 5
