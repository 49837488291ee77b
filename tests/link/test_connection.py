"""Connections: strings as people write them, sockets, serial lines, several vehicles at once, coming back."""

import os
import socket
import time

import pytest
from sim_serving import free_port, served
from wires import a_mission

from link.address import Address, parse_address
from link.connection import Connection
from link.exchange import RoundTrip
from link.mavlink_vehicle import MavlinkVehicle
from link.opening import open_connection
from link.transport import TcpClient, UdpSocket, open_transport
from models.clock import WallClock
from models.errors import InputError, LinkLostError

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
        crafts = [MavlinkVehicle(connection, system) for system in (1, 2, 3)]
        assert [craft.identify().uid & 0xFF for craft in crafts] == [1, 2, 3]
        assert crafts[1].upload(a_mission(10)).verified
        sizes = [len(v.autopilot.stores[0]) for v in there.world.vehicles.values()]
        assert sizes == [0, 10, 0]
        with pytest.raises(InputError, match="one of 1, 2, 3"):
            MavlinkVehicle(connection)
    connection.close()


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


def test_tcp_without_a_vehicle_says_so():
    with pytest.raises(LinkLostError, match="is the vehicle on"):
        TcpClient(Address("tcp", "127.0.0.1", free_port(socket.SOCK_STREAM)))


def test_a_vehicle_may_connect_to_us():
    port = free_port(socket.SOCK_STREAM)
    connection = open_connection(f"tcpin:127.0.0.1:{port}", record=None)
    with served(connect=(f"tcp:127.0.0.1:{port}",), autopilot="ardupilot"):
        assert MavlinkVehicle(connection).upload(a_mission(5)).verified
    connection.close()


def test_a_port_that_is_taken_is_named():
    first = UdpSocket(Address("udpin", "127.0.0.1", 0))
    with pytest.raises(InputError, match=f"cannot listen.*{first.port}"):
        UdpSocket(Address("udpin", "127.0.0.1", first.port))
    first.close()


def test_a_serial_line_is_read_and_written():
    ours, theirs = os.openpty()
    line = open_transport(Address("serial", os.ttyname(theirs), 57600))
    connection = Connection(line, WallClock())
    connection.pump(0.0)
    assert os.read(ours, 100).startswith(b"\xfd")
    os.write(ours, b"\xfd\x00hello")
    assert line.read(1.0) == b"\xfd\x00hello"
    connection.close()
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("device", "why"), [("/dev/no-such-line", "cannot be opened"), ("/dev/null", "no serial line")]
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
    assert trip.retry_s(30) == 1.5


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
