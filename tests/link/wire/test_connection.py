"""Connections: strings as people write them, sockets, serial lines, several vehicles at once, coming back."""

import contextlib
import os
import select
import socket
import threading
import time
import tty

import pytest
from sim_serving import free_port, served
from wires import Scene, a_mission

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.exchange import RoundTrip
from skyway.link.protocol.opening import open_connection
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire import transport
from skyway.link.wire.address import parse_address
from skyway.link.wire.frames import FrameReader, FrameWriter
from skyway.link.wire.transport import TcpClient, TcpServer, UdpSocket, open_transport
from skyway.models.base.address import Address
from skyway.models.base.clock import WallClock
from skyway.models.base.errors import InputError, LinkLostError

GOOD = {
    "udpin:0.0.0.0:14540": Address("udpin", "0.0.0.0", 14540),
    "udpin::14550": Address("udpin", "127.0.0.1", 14550),
    "udp://:14540": Address("udpin", "127.0.0.1", 14540),
    "udpout:192.168.1.7:14550": Address("udpout", "192.168.1.7", 14550),
    "tcp:localhost:5760": Address("tcp", "localhost", 5760),
    "tcpin:[::1]:5760": Address("tcpin", "::1", 5760),
    "/dev/ttyUSB0,57600": Address("serial", "/dev/ttyUSB0", 57600),
    "serial:///dev/ttyACM0:921600": Address("serial", "/dev/ttyACM0", 921600),
    "/dev/ttyUSB0": Address("serial", "/dev/ttyUSB0", 57600),
    "COM7,115200": Address("serial", "COM7", 115200),
    "/dev/cu.usbserial-D30": Address("serial", "/dev/cu.usbserial-D30", 57600),
    "/dev/serial/by-path/pci-0:14.0-usb-0:1:1.0,115200": Address(
        "serial", "/dev/serial/by-path/pci-0:14.0-usb-0:1:1.0", 115200
    ),
}


@pytest.mark.parametrize("text", GOOD)
def test_a_connection_is_written_as_everyone_writes_it(text):
    assert parse_address(text) == GOOD[text]
    assert parse_address(str(GOOD[text])) == GOOD[text]


@pytest.mark.parametrize("text", ["", "udp", "tcp:host", "tcp:host:99999", "udpout:host:0", "ftp:host:1", "ttyUSB0"])
def test_anything_else_is_refused_with_an_example(text):
    with pytest.raises(InputError, match=r"udpin:HOST:PORT|1 to 65535"):
        parse_address(text)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_listener_without_a_host_is_not_reachable_from_outside(kind):
    assert parse_address(f"{kind}::14540").host == "127.0.0.1"


def test_three_vehicles_on_one_udp_port_are_told_apart_by_their_ids():
    port = free_port()
    connection = open_connection(f"udpin:127.0.0.1:{port}", record=None)
    with served(vehicles=3, connect=(f"udpout:127.0.0.1:{port}",), autopilot="px4") as there:
        assert connection.wait(lambda: len(connection.peers) == 3, 10.0)
        crafts = [Vehicle(connection, system) for system in (1, 2, 3)]
        assert [craft.identify().uid & 0xFF for craft in crafts] == [1, 2, 3]
        assert crafts[1].upload(a_mission(10)).verified
        sizes = [len(v.autopilot.stores[0]) for v in there.world.vehicles.values()]
        assert sizes == [0, 10, 0]
        with pytest.raises(InputError, match="one of 1, 2, 3"):
            Vehicle(connection)
    connection.close()


@pytest.mark.parametrize(("kind", "firmware"), [(0, 0), (2, 12), (2, 0)], ids=["generic", "as the autopilot", "other"])
def test_an_onboard_computer_that_beats_first_is_not_taken_for_the_autopilot(kind, firmware):
    scene, computer = Scene("px4"), FrameWriter(1, 191)
    fields = {"type": kind, "autopilot": firmware, "base_mode": 209, "system_status": 4, "mavlink_version": 3}
    beats = []

    def spoil(number, message, frame, up):
        if up or message is None or message.name != "HEARTBEAT":
            return frame if beats or up else b""
        beats.append(1)
        return computer.frame("HEARTBEAT", fields) + (frame if len(beats) > 1 else b"")

    scene.link.spoil = spoil
    assert scene.meet().component == 191
    scene.connection.run_for(1.5)
    craft = Vehicle(scene.connection)
    assert craft.peer.component == 1
    assert craft.family.name == "px4"
    assert not craft.armed
    assert craft.upload(a_mission(5)).verified


def test_a_tcp_connection_comes_back_by_itself():
    port = free_port(socket.SOCK_STREAM)
    with served(tcp_port=port, autopilot="px4"):
        connection = open_connection(f"tcp:127.0.0.1:{port}", record=None)
        assert connection.wait(lambda: 1 in connection.peers, 5.0)
    assert connection.wait(lambda: not connection.transport.up, 5.0)
    with served(tcp_port=port, autopilot="px4"):
        heard = connection.peers[1].received
        assert connection.wait(lambda: connection.peers[1].received > heard, 8.0)
    connection.close()


def test_a_connection_that_cannot_be_opened_leaves_no_empty_recording(tmp_path):
    with pytest.raises(LinkLostError):
        open_connection(f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}", record=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_tcp_without_a_vehicle_says_so():
    with pytest.raises(LinkLostError, match="is the vehicle on"):
        TcpClient(Address("tcp", "127.0.0.1", free_port(socket.SOCK_STREAM)))


def test_connecting_again_never_blocks_for_longer_than_asked():
    """The other side's queue is full: a connection is neither made nor refused."""
    there = socket.create_server(("127.0.0.1", 0), backlog=0)
    client = TcpClient(Address("tcp", *there.getsockname()))
    there.accept()[0].close()
    waiting = [socket.socket() for _ in range(4)]
    for other in waiting:
        other.setblocking(False)
        other.connect_ex(there.getsockname())
    deadline = time.monotonic() + 1.6
    while time.monotonic() < deadline:
        begun = time.monotonic()
        assert client.read(0.05) == b""
        assert time.monotonic() - begun < 0.5
    for one in (*waiting, client, there):
        one.close()


def test_a_vehicle_may_connect_to_us_go_and_come_back():
    port = free_port(socket.SOCK_STREAM)
    connection = open_connection(f"tcpin:127.0.0.1:{port}", record=None)
    with served(connect=(f"tcp:127.0.0.1:{port}",), autopilot="ardupilot"):
        craft = Vehicle(connection, 1)
        assert craft.upload(a_mission(5)).verified
    with served(connect=(f"tcp:127.0.0.1:{port}",), autopilot="ardupilot") as there:
        heard = craft.peer.received
        assert connection.wait(lambda: craft.peer.received > heard, 8.0)
        assert craft.upload(a_mission(6)).verified
        assert len(there.world.vehicles[1].autopilot.stores[0]) == 7
    connection.close()


def test_a_speaking_vehicle_is_not_pushed_off_and_a_silent_one_is_replaced(monkeypatch):
    now = time.monotonic()
    monkeypatch.setattr(transport.time, "monotonic", lambda: now)
    server = TcpServer(Address("tcpin", "127.0.0.1", 0))
    first, second, third = (socket.socket() for _ in range(3))
    first.connect(("127.0.0.1", server.port))
    first.sendall(b"first")
    assert server.read(1.0) + server.read(1.0) == b"first"
    second.connect(("127.0.0.1", server.port))
    server.read(1.0)
    server.write(b"answer")
    assert (first.recv(10), second.recv(10)) == (b"answer", b"")
    now += 6.0
    third.connect(("127.0.0.1", server.port))
    server.read(1.0)
    server.write(b"again")
    assert (first.recv(10), third.recv(10)) == (b"", b"again")
    for one in (first, second, third, server):
        one.close()


class Distant:
    """A vehicle on a UDP socket of its own."""

    def __init__(self, port, system):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(0.2)
        self.writer = FrameWriter(system, 1)

    def beat(self):
        self.socket.send(self.writer.frame("HEARTBEAT", {"type": 2, "autopilot": 12, "mavlink_version": 3}))

    def heard(self):
        """Names of the messages that came."""
        names = []
        with contextlib.suppress(TimeoutError):
            while True:
                for _, message in FrameReader().feed(self.socket.recv(300)):
                    names.append(message.name)
                self.socket.settimeout(0.05)
        return names


def test_each_of_several_vehicles_is_answered_at_its_own_address(monkeypatch):
    connection = open_connection("udpin:127.0.0.1:0", record=None)
    port = connection.transport.port
    fleet = {system: Distant(port, system) for system in (1, 2, 3)}
    for vehicle in fleet.values():
        vehicle.beat()
    assert connection.wait(lambda: len(connection.peers) == 3, 3.0)
    connection.send("PARAM_REQUEST_LIST", 2, target_system=2)
    assert [vehicle.heard().count("PARAM_REQUEST_LIST") for vehicle in fleet.values()] == [0, 1, 0]
    liar, later = Distant(port, 2), time.monotonic() + 6.0
    heard = connection.peers[2].received
    liar.beat()
    assert connection.wait(lambda: connection.rejected.elsewhere == 1, 3.0)
    assert connection.peers[2].received == heard
    connection.send("PARAM_REQUEST_LIST", 2, target_system=2)
    assert "PARAM_REQUEST_LIST" in fleet[2].heard()  # nobody takes over an address that still speaks
    assert liar.heard() == []
    monkeypatch.setattr(transport.time, "monotonic", lambda: later)
    liar.beat()
    connection.pump(1.0)
    connection.send("PARAM_REQUEST_LIST", 2, target_system=2)
    assert "PARAM_REQUEST_LIST" in liar.heard()  # a vehicle behind a router that has got a new port
    fleet[3].beat()
    connection.pump(1.0)
    other = Distant(port, 3)
    other.beat()
    assert connection.wait(lambda: connection.rejected.elsewhere == 2, 3.0)
    connection.forget_address(3)  # what spoke from there was another one
    other.beat()
    connection.pump(1.0)
    connection.send("PARAM_REQUEST_LIST", 3, target_system=3)
    assert "PARAM_REQUEST_LIST" in other.heard()
    for one in (other, liar, *fleet.values()):
        one.socket.close()
    connection.close()


def test_a_port_that_is_taken_is_named():
    first = UdpSocket(Address("udpin", "127.0.0.1", 0))
    with pytest.raises(InputError, match=f"cannot listen.*{first.port}"):
        UdpSocket(Address("udpin", "127.0.0.1", first.port))
    first.close()


def test_an_address_of_another_computer_is_named():
    with pytest.raises(InputError, match="this computer has no such address"):
        UdpSocket(Address("udpin", "192.0.2.1", 14550))


class Radio:
    """A serial line with a vehicle at its far end: a pty whose other side passes bytes to a TCP port and back."""

    def __init__(self, link, where):
        self.far, near = os.openpty()
        tty.setraw(near)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(near))
        self._near = near
        self._there = socket.create_connection(where)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._pass, daemon=True)
        self._thread.start()

    def _pass(self):
        while not self._over.is_set():
            ready, _, _ = select.select([self.far, self._there], [], [], 0.02)
            if self.far in ready:
                self._there.sendall(os.read(self.far, 4096))
            if self._there in ready:
                os.write(self.far, self._there.recv(4096))

    def unplug(self):
        self._over.set()
        self._thread.join(2.0)
        os.close(self._near)
        os.close(self.far)
        self._there.close()


def test_a_mission_goes_over_a_serial_line_that_is_unplugged_and_plugged_in_again(tmp_path):
    device = tmp_path / "ttyUSB0"
    with served(tcp_port=0, autopilot="px4") as there:
        vehicle = there.world.vehicles[1]
        radio = Radio(device, there.where())
        connection = Connection(open_transport(Address("serial", str(device), 57600)), WallClock())
        craft = Vehicle(connection, 1)
        assert craft.upload(a_mission(5)).verified
        radio.unplug()
        connection.run_for(0.3)
        heard = craft.peer.received
        radio = Radio(device, there.where())
        assert connection.wait(lambda: craft.peer.received > heard, 8.0)
        assert craft.upload(a_mission(7)).verified
        assert len(vehicle.autopilot.stores[0]) == 7
        connection.close()
        radio.unplug()


def test_a_baud_rate_that_no_line_has_is_refused_with_those_that_there_are():
    with pytest.raises(InputError, match=r"no such baud rate.*57600"):
        open_transport(Address("serial", "/dev/null", 57601))


@pytest.mark.parametrize(
    ("device", "why"), [("/dev/no-such-line", "cannot be opened"), ("/dev/null", "not a serial line")]
)
def test_a_device_that_is_no_serial_line_is_refused(device, why):
    with pytest.raises(InputError, match=why):
        open_transport(Address("serial", device, 57600))


def test_the_wait_before_asking_again_follows_the_round_trip():
    trip = RoundTrip()
    assert trip.retry_s(1) == 0.25
    for _ in range(50):
        trip.learn(0.04)
    assert 0.04 < trip.retry_s(1) < 0.08
    assert trip.retry_s(30) == 3.0


def test_our_heart_beats_once_a_second():
    there = UdpSocket(Address("udpin", "127.0.0.1", 0))
    connection = open_connection(f"udpout:127.0.0.1:{there.port}", record=None)
    begun = time.monotonic()
    connection.run_for(2.1)
    beats = 0
    while there.read(0.0):
        beats += 1
    assert beats == 3
    assert time.monotonic() - begun < 3.0
    connection.close()
    there.close()
