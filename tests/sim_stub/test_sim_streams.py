"""Message streams, time, signing, battery and link of the simulated vehicle, and that a run is determined by its seed."""

import math
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import Stage, Station, leg

from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.wire.messages import message_name

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


# Streams, time, version, text


@BOTH
def test_message_intervals_are_set_told_and_stopped(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    assert s.command(511, 30, 100_000) == 0
    assert s.command(510, 30) == 0
    told = [m for m in s.seen if m.get_type() == "MESSAGE_INTERVAL"][-1]
    assert told.interval_us == 100_000
    assert sum(m.get_type() == "ATTITUDE" for m in s.run(10.0)) == pytest.approx(100, abs=2)
    assert s.command(511, 30, -1) == 0
    assert sum(m.get_type() == "ATTITUDE" for m in s.run(5.0)) == 0
    assert s.command(511, 30, 0) == 0
    assert any(m.get_type() == "ATTITUDE" for m in s.run(5.0)) is (autopilot == "px4"), "0 is the default rate"
    assert s.command(511, 12_345, 1000) in (2, 4)


@BOTH
@pytest.mark.parametrize("rate_hz", [4.0, 10.0, 50.0])
def test_a_message_comes_as_often_as_it_is_asked_for_in_the_air(autopilot, rate_hz):
    stage = Stage(autopilot, wind=ConstantWind.of(8.0, 200.0))
    stage.take_off(20.0)
    assert stage.station.command(511, 30, 1e6 / rate_hz) == 0
    stage.station.run(2.0)
    heard = [m for m in stage.station.run(20.0) if m.get_type() == "ATTITUDE"]
    assert len(heard) == pytest.approx(20.0 * rate_hz, rel=0.02)
    times = [m.time_boot_ms for m in heard]
    assert {b - a for a, b in pairwise(times)} <= {round(1e3 / rate_hz) + off for off in (-1, 0, 1)}
    assert len({m.roll for m in heard}) > 0.9 * len(heard), "each one is new"


def test_a_finer_step_of_physics_flies_the_same():
    fine, coarse = ({}, {})
    for told, rate in ((fine, 20_000), (coarse, 100_000)):
        stage = Stage("px4", wind=ConstantWind.of(7.0, 100.0))
        stage.vehicle.gusts.intensity = 0.0
        stage.station.command(511, 30, rate)
        stage.station.upload(leg(distance=250.0))
        stage.start()
        stage.rest()
        told["time"], told["soc"] = stage.lockstep.now_s, stage.vehicle.battery.soc
    assert fine["time"] == pytest.approx(coarse["time"], rel=0.01)
    assert 1.0 - fine["soc"] == pytest.approx(1.0 - coarse["soc"], rel=0.01)


@BOTH
def test_every_message_that_can_be_asked_for_is_sent(autopilot):
    from skyway.sim_stub.protocols.telemetry import BUILDERS

    stage = Stage(autopilot, parameters=(("EKF2_DRAG_CTRL", 1),) if autopilot == "px4" else ())
    stage.take_off()
    s = stage.station
    for number in BUILDERS:
        name = message_name(number)
        s.seen.clear()
        result = s.command(512, number)
        mine = name not in stage.pilot.LACKS
        assert (result == 0) is mine, name
        told = {m.get_type() for m in s.seen}
        assert not mine or name in told or f"UNKNOWN_{number}" in told, name  # one is not in pymavlink's tables


@BOTH
def test_time_version_and_ping_are_answered(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    s.send(dialect.MAVLink_timesync_message(0, 123_456_789))
    answer = s.wait("TIMESYNC")
    assert answer.ts1 == 123_456_789
    assert answer.tc1 == pytest.approx(stage.vehicle.boot_us * 1000, rel=1e-6)
    assert s.command(512, 148) == 0
    version = [m for m in s.seen if m.get_type() == "AUTOPILOT_VERSION"][-1]
    bytewise, by_number = 16, 131072
    assert bool(version.capabilities & bytewise) is (autopilot == "px4")
    assert bool(version.capabilities & by_number) is (autopilot == "ardupilot")
    assert version.capabilities & 8192, "MAVLink 2"
    assert s.command(520) == 0
    s.send(dialect.MAVLink_ping_message(5, 7, 0, 0))
    assert s.wait("PING").seq == 7


def test_a_long_text_comes_in_numbered_chunks():
    stage = Stage("px4")
    text = "x" * 50 + "y" * 50 + "z" * 7
    stage.vehicle.radio.say(4, text)
    chunks = [m for m in stage.station.run(0.2) if m.get_type() == "STATUSTEXT"]
    assert "".join(m.text for m in chunks) == text
    assert [m.chunk_seq for m in chunks] == [0, 1, 2]
    assert len({m.id for m in chunks}) == 1
    assert chunks[0].id > 0
    stage.vehicle.radio.say(4, "w" * 100)
    assert [m.text for m in stage.station.run(0.2) if m.get_type() == "STATUSTEXT"][-1] == ""


@BOTH
def test_a_mavlink_1_station_is_served(autopilot):
    name = "MAV_PROTO_VER" if autopilot == "px4" else "SERIAL0_PROTOCOL"
    stage = Stage(autopilot, parameters=((name, 1),))
    s = stage.station
    s.mavlink1 = True
    assert s.upload(stage.mission(*leg())) == 0
    assert len(s.download(as_int=False)) == len(stage.mission(*leg()))
    assert s.command(512, 0) == 0
    assert all(m.get_msgbuf()[0] == 0xFE for m in s.seen)


def test_px4_switches_to_mavlink_2_when_it_hears_it_and_ardupilot_wants_it_for_a_fence():
    px4 = Stage("px4", parameters=(("MAV_PROTO_VER", 0),))
    first = px4.lockstep
    first.run_for(3.0)
    frames = list(px4.station.link.inbox)
    assert {frame[0] for frame in frames} == {0xFE}
    px4.station.run(3.0)
    assert px4.station.seen[-1].get_msgbuf()[0] == 0xFD
    ardupilot = Stage("ardupilot", parameters=(("SERIAL0_PROTOCOL", 1),))
    ardupilot.station.send(dialect.MAVLink_mission_request_list_message(1, 1, 1))
    assert ardupilot.station.wait("MISSION_ACK").type == 3


@BOTH
def test_signing_unsigned_stations_are_not_heard_and_signed_ones_are(autopilot):
    key = bytes(range(32))
    stage = Stage(autopilot, signing_key=key)
    s = stage.station
    assert s.command(512, 148) is None
    s.mav.signing.secret_key = key
    s.mav.signing.sign_outgoing = True
    s.mav.signing.timestamp = 10_000_000
    s.seen.clear()
    assert s.command(512, 148) == 0
    assert all(m.get_signed() for m in s.seen)


def test_setup_signing_gives_a_key_to_every_link():
    stage = Stage("px4")
    other = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle), system=254)
    key = bytes(range(1, 33))
    stage.station.send(dialect.MAVLink_setup_signing_message(1, 1, list(key), 1))
    stage.station.run(0.2)
    assert other.command(512, 148, seconds=1.0) is None
    other.run(2.0)
    assert other.seen[-1].get_msgbuf()[2] & 1


# Batteries, link, position


@BOTH
def test_voltage_sags_under_load_and_more_with_the_fault(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("battery-sag@60s")])
    rest = stage.vehicle.battery.voltage_v
    stage.take_off()
    load = stage.vehicle.battery.voltage_v
    assert 0.3 < rest - load < 1.5
    stage.station.until(lambda: stage.lockstep.now_s > 65.0)
    assert stage.vehicle.battery.voltage_v < load - 1.0
    assert stage.station.command(512, 147) == 0
    status = [m for m in stage.station.seen if m.get_type() == "BATTERY_STATUS"][-1]
    assert sum(v for v in status.voltages if v != 65535) == pytest.approx(
        stage.vehicle.battery.voltage_v * 1e3, rel=0.01
    )
    assert status.current_battery == pytest.approx(stage.vehicle.battery.current_a * 100, rel=0.05)


@BOTH
def test_a_link_loss_passes_nothing_for_its_time(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("link-loss@10s+20s")])
    s = stage.station
    s.run(10.1)
    assert s.run(19.5) == []
    s.run(1.0)
    assert s.command(512, 0) == 0


@BOTH
def test_without_position_it_lands_where_the_wind_carries_it(autopilot):
    stage = Stage(autopilot, wind=ConstantWind.of(5, 270), faults=[parse_fault("gps@60s")])
    stage.take_off(30.0)
    stage.station.until(lambda: stage.lockstep.now_s > 59.0)
    before = stage.vehicle.body.lon
    stage.rest(200.0)
    assert stage.happened("failsafe position: land")
    assert (stage.vehicle.body.lon - before) * 84_000 > 20.0, "eastwards with the wind"
    assert not stage.pilot.crashed


@BOTH
def test_a_gust_leans_the_vehicle_and_it_holds_its_place(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("gust=9@80s+15s")])
    stage.take_off(20.0)
    stage.station.until(lambda: stage.lockstep.now_s > 90.0)
    tilt = math.degrees(math.acos(math.cos(stage.vehicle.body.roll) * math.cos(stage.vehicle.body.pitch)))
    assert 2.0 < tilt < 10.0
    stage.station.run(30.0)
    assert stage.vehicle.body.ground_speed_mps < 0.2


# Determinism


@BOTH
def test_a_run_is_the_same_bit_for_bit_from_its_seed(autopilot):
    def run(seed):
        bad = Impairment(loss=0.05, delay_s=0.02, jitter_s=0.02, duplicate=0.02, reorder=0.02)
        stage = Stage(autopilot, wind=ConstantWind.of(7, 200), impairment=bad, seed=seed, power_error=None)
        heard = []
        original = stage.station.link.read
        stage.station.link.read = lambda wait=0.0: (heard.append(original(wait)), heard[-1])[1]
        for _ in range(8):
            if stage.station.upload(stage.mission(*leg())) == 0:
                break
            stage.station.run(9.0)
        stage.start()
        stage.station.run(120.0)
        return b"".join(heard), stage.events, stage.vehicle.battery.soc

    first, second, other = run(3), run(3), run(4)
    assert first == second
    assert first[0] != other[0]
    assert first[2] != other[2]
