"""Hostile input: nothing crashes it, hangs it or makes it grow, and the next good client is served."""

import contextlib
import math
import random
import socket
import struct
import time
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_serving import served
from sim_station import LAT, LON, NAN, Stage, Station, item, leg

from skyway.sim_stub.transports import tcp
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.transports.pad_server import MAX_CLIENTS

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def good_frames(system=255):
    mav = dialect.MAVLink(None, system, 190)
    frames = []
    for number in (
        *((0, 11, 22, 20, 21, 23, 37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 66, 73, 75, 76, 86, 111, 4)),
        256,
    ):
        cls = dialect.mavlink_map[number]
        values = []
        for kind, name in zip(cls.fieldtypes, cls.fieldnames, strict=True):
            array = cls.array_lengths[cls.ordered_fieldnames.index(name)]
            values.append(b"x" * min(array, 4) if kind == "char" else [1] * array if array else 1)
        frames.append(cls(*values).pack(mav))
    return frames


def throw(stage, packets, generator):
    """Random and mutated packets, with good checksums where they matter."""
    frames = good_frames()
    from fastcrc.crc16 import mcrf4xx

    for number in range(packets):
        kind = number % 3
        if kind == 0:
            packet = generator.randbytes(generator.randint(0, 300))
        elif kind == 1:
            packet = bytearray(generator.choice(frames))
            for _ in range(generator.randint(1, 6)):
                packet[generator.randrange(len(packet))] = generator.randrange(256)
        else:  # a random payload that passes every check
            numbers = (11, 20, 21, 22, 23, 37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 66, 73, 75, 76, 76, 76, 86)
            kind = dialect.mavlink_map[generator.choice(numbers)]
            values = list(kind.unpacker.unpack(generator.randbytes(kind.unpacker.size)))
            places = {name: sum(kind.lengths[:n]) for n, name in enumerate(kind.ordered_fieldnames)}
            for name in ("target_system", "target_component"):
                if name in places:
                    values[places[name]] = generator.choice((0, 1))
            if "command" in places and generator.random() < 0.8:
                values[places["command"]] = generator.choice(KNOWN)
            for i, value in enumerate(values):
                if isinstance(value, float) and generator.random() < 0.5:
                    values[i] = generator.choice((NAN, math.inf, -math.inf, 0.0, 1.0, -1.0, 3e38, 4.0, 300.0))
            payload = kind.unpacker.pack(*values).rstrip(b"\0") or b"\0"
            head = bytes([0xFD, len(payload), 0, 0, number & 255, 255, 190]) + kind.id.to_bytes(3, "little")
            body = head + payload
            packet = body + struct.pack("<H", mcrf4xx(body[1:] + bytes([kind.crc_extra])))
        stage.station.link.write(bytes(packet))
        if number % 10_000 == 9_999:
            stage.station.send(dialect.MAVLink_command_long_message(1, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0))
        if number % 20 == 0:
            stage.lockstep.run_for(0.05)
            stage.station.link.inbox.clear()
    stage.lockstep.run_for(20.0)
    stage.station.link.inbox.clear()


KNOWN = (16, 21, 22, 20, 17, 93, 112, 176, 178, 179, 183, 185, 189, 192, 193, 207, 211, 224, 241, 245, 300, 400)
KNOWN += (401, 410, 510, 511, 512, 519, 520, 42651)


def still_serves(stage):
    """A good client is served: parameters, a mission, and where it can still fly, a flight."""
    stage.lockstep.run_for(60.0)
    s = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle))
    s.run(1.0)
    for _ in range(3):
        if s.parameter("MAV_SYS_ID" if stage.vehicle.config.autopilot == "px4" else "SYSID_THISMAV") is not None:
            break
    else:
        pytest.fail("no answer to a good client")
    if stage.pilot.run.state == 3 and stage.vehicle.config.autopilot == "ardupilot":
        return
    assert s.upload(stage.mission(*leg())) == 0


@BOTH
@pytest.mark.parametrize("flying", [False, True])
def test_random_and_mutated_packets(autopilot, flying):
    stage = Stage(autopilot)
    if flying:
        stage.take_off()
    throw(stage, 6_000, random.Random(f"{autopilot}{flying}"))
    stage.vehicle.radio.set_signing(None, 0)  # a random SETUP_SIGNING may have locked everybody out, as it would
    still_serves(stage)


@pytest.mark.slow
@BOTH
def test_a_million_random_and_mutated_packets_without_growing(autopilot):
    stage = Stage(autopilot)
    generator = random.Random(7)
    throw(stage, 20_000, generator)
    tracemalloc.start()
    throw(stage, 20_000, generator)
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    throw(stage, 930_000, generator)
    stage.world.events.clear()
    tracemalloc.start()
    throw(stage, 30_000, generator)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after < before + 3_000_000
    stage.vehicle.radio.set_signing(None, 0)
    still_serves(stage)


def test_half_open_tcp_and_a_client_that_stops_reading():
    from pymavlink import mavutil

    with served(tcp_port=0) as running:
        where = running.where()
        stuck = [socket.create_connection(where, timeout=5.0) for _ in range(5)]
        for one in stuck:
            one.sendall(b"\xfd\xff")  # a frame that never ends
        stuck[0].setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        stuck[0].close()  # a reset
        link = mavutil.mavlink_connection(f"tcp:{where[0]}:{where[1]}", autoreconnect=False)
        assert link.wait_heartbeat(timeout=5) is not None
        link.close()
        for one in stuck[1:]:
            one.close()
        again = mavutil.mavlink_connection(f"tcp:{where[0]}:{where[1]}", autoreconnect=False)
        assert again.wait_heartbeat(timeout=5) is not None
        again.close()


@BOTH
def test_a_client_that_stops_mid_upload_blocks_the_next_one_only_for_a_while(autopilot):
    stage = Stage(autopilot)
    first = stage.station
    first.send(dialect.MAVLink_mission_count_message(1, 1, 50, 0))
    first.run(0.5)
    first.link.close()
    second = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle), system=254)
    second.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    assert second.wait("MISSION_ACK", 2.0).type in (1, 14)
    second.run(9.0)
    assert second.upload(stage.mission(*leg())) == 0


@BOTH
def test_commands_for_other_systems_and_components_are_not_ours(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    for system, component in ((2, 1), (1, 100)):
        s.send(dialect.MAVLink_command_long_message(system, component, 400, 0, 1, 21196, 0, 0, 0, 0, 0))
        assert s.wait("COMMAND_ACK", 1.0) is None
    assert not stage.pilot.armed
    s.target = 0
    assert s.command(400, 1, 21196) == 0, "0 is for everybody"


@BOTH
@pytest.mark.parametrize("count", [10_000, 65_535])
def test_missions_too_long_are_refused_at_once(autopilot, count):
    stage = Stage(autopilot)
    stage.station.send(dialect.MAVLink_mission_count_message(1, 1, count, 0))
    assert stage.station.wait("MISSION_ACK").type == 4


@BOTH
def test_the_longest_mission_that_fits_is_stored(autopilot):
    stage = Stage(autopilot)
    most = 2000 if autopilot == "px4" else 724
    items = stage.mission(item(22), *(item(16, n % 400) for n in range(most - 3)), item(21))[:most]
    assert stage.station.upload(items, seconds=600.0) == 0


@settings(max_examples=30)
@given(st.data())
def test_absurd_parameters_neither_crash_nor_stop_it(data):
    autopilot = data.draw(st.sampled_from(["px4", "ardupilot"]))
    stage = Stage(autopilot)
    stage.take_off(20.0)
    store = stage.pilot.parameters
    absurd = st.sampled_from([NAN, math.inf, -math.inf, -1.0, 0.0, 3e38, -3e38, 1e-30, 2.0**31, 255.0])
    for _ in range(8):
        parameter = store.at(data.draw(st.integers(0, len(store) - 1)))
        if parameter.name.startswith(("MAV_PROTO", "SERIAL0")):
            continue
        stage.station.set_parameter(parameter.name, data.draw(absurd), parameter.kind)
    stage.station.run(20.0)
    assert math.isfinite(stage.vehicle.body.lat)
    assert math.isfinite(stage.vehicle.body.alt_m)
    assert abs(stage.vehicle.body.lat - LAT) < 1.0
    assert abs(stage.vehicle.body.lon - LON) < 1.0


@BOTH
def test_absurd_places_are_refused_or_harmless(autopilot):
    stage = Stage(autopilot)
    stage.take_off(20.0)
    s = stage.station
    for lat, lon, z in ((95.0, 0.0, 10.0), (0.0, 200.0, 10.0), (LAT, LON, NAN), (LAT, LON, 1e30)):
        s.command_int(192, (NAN, 1, 0, NAN), lat, lon, z)
        s.command_int(179, (0, 0, 0, 0), lat, lon, z)
    s.command(22, NAN, NAN, NAN, NAN, NAN, NAN, math.inf)
    s.command(178, NAN, NAN, NAN)
    s.command(176, NAN, math.inf, -5)
    s.command(511, math.inf, NAN)
    s.run(5.0)
    body = stage.vehicle.body
    assert all(map(math.isfinite, (body.lat, body.lon, body.alt_m, body.roll, body.pitch)))


@pytest.mark.parametrize("what", ["vehicle", "pads"])
def test_silent_connections_keep_nobody_out_for_ever(what, monkeypatch):
    monkeypatch.setattr(tcp, "SILENT_S", 0.3)
    with served(tcp_port=0, pads="tcp:127.0.0.1:0") as running:
        where = running.where(0 if what == "vehicle" else 1)
        most = tcp.MAX_VEHICLE_PEERS if what == "vehicle" else MAX_CLIENTS
        with contextlib.ExitStack() as stack:
            for _ in range(most):
                stack.enter_context(socket.create_connection(where))
            end = time.monotonic() + 10.0
            answer = b""
            while not answer and time.monotonic() < end:
                with socket.create_connection(where) as late:
                    late.settimeout(2.0)
                    with contextlib.suppress(OSError):
                        late.sendall(b'{"op": "status", "station": "here"}\n')
                        answer = late.recv(4096)
            assert answer, "the newest is served"


def test_too_many_connections_are_turned_away():
    with served(tcp_port=0) as running:
        clients = [socket.create_connection(running.where(), timeout=5.0) for _ in range(12)]
        clients[-1].settimeout(5.0)
        assert clients[-1].recv(10) == b""
        for client in clients:
            client.close()


def test_over_udp_the_newest_station_is_served_however_many_came_before():
    beat = good_frames()[0]
    with served(connect=["udpin:127.0.0.1:0"]) as running:
        sockets = []
        for _ in range(20):
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            one.settimeout(5.0)
            one.sendto(beat, running.where())
            assert one.recv(2000)
            sockets.append(one)
        for one in sockets:
            one.close()
        assert len(running.world.vehicles[1].radio.ports) <= 8


@BOTH
def test_a_bad_link_with_everything_at_once(autopilot):
    bad = Impairment(loss=0.1, delay_s=0.02, jitter_s=0.03, duplicate=0.1, reorder=0.1)
    for seed in range(5):
        stage = Stage(autopilot, impairment=bad, seed=seed)
        for _ in range(6):
            if stage.station.upload(stage.mission(*leg()), seconds=30.0) == 0:
                break
            stage.station.run(9.0)
        else:
            pytest.fail("never through")
