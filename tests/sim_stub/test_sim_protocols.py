"""MAVLink microservices, one after the other, as a ground station meets them."""

import math
import struct
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import LAT, LON, NAN, TAKEOFF, WAYPOINT, Stage, Station, item, leg, plain

from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.wire.messages import Mavlink, message, message_name

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


# Heartbeat, modes


@BOTH
def test_heartbeats_come_every_second_and_carry_the_real_mode_numbers(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    beats = [m for m in s.run(10.0) if m.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(10, abs=1)
    assert beats[0].autopilot == {"px4": 12, "ardupilot": 3}[autopilot]
    numbers = {
        "px4": {
            (1, 7): 7 << 16,
            (1, 2): 2 << 16,
            (1, 3): 3 << 16,
            (1, 4, 3): 4 << 16 | 3 << 24,
            (1, 4, 5): 4 << 16 | 5 << 24,
        },
        "ardupilot": {(1, 0): 0, (1, 2): 2, (1, 4): 4, (1, 5): 5, (1, 6): 6, (1, 9): 9, (1, 17): 17},
    }[autopilot]
    for parameters, number in numbers.items():
        assert s.command(176, *parameters) == 0
        assert s.wait("HEARTBEAT", 2.0, custom_mode=number) is not None
    assert s.command(176, 1, 4, 99) == {"px4": 1, "ardupilot": 0}[autopilot], "no such mode; ArduPilot reads p2 alone"
    assert s.command(176, 1, 99) == {"px4": 0, "ardupilot": 4}[autopilot], "PX4 accepts what means nothing"
    s.send(dialect.MAVLink_set_mode_message(1, 1, next(iter(numbers.values()))))
    assert s.wait("HEARTBEAT", 2.0, custom_mode=next(iter(numbers.values()))) is not None


def test_px4_enters_any_mode_disarmed_and_then_refuses_to_arm_or_in_the_air_to_change():
    stage = Stage("px4")
    assert stage.station.command(176, 1, 6) == 0
    assert stage.station.command(400, 1) == 1
    assert "Preflight Fail: Offboard: no setpoints" in stage.station.texts
    assert stage.station.command(176, 1, 4, 3) == 0
    stage.take_off(10.0)
    assert stage.station.command(176, 1, 6) == 1
    assert stage.pilot.mode == Mode.HOLD


@pytest.mark.parametrize(("number", "name"), [(21, "land"), (20, "return")])
def test_px4_leaves_land_and_return_when_it_disarms_for_nothing_arms_in_them(number, name):
    stage = Stage("px4")
    assert stage.station.command(176, 1, 4, {21: 6, 20: 5}[number]) == 0
    assert stage.station.command(400, 1) == 1
    assert "Preflight Fail: Mode not suitable for takeoff" in stage.station.texts
    stage.station.command(176, 1, 4, 3)
    stage.take_off(15.0)
    assert stage.station.command(number) == 0
    stage.rest(200.0)
    assert stage.happened(f"mode {name}")
    assert stage.pilot.mode == Mode.HOLD, "the last one it was given that it can be armed in"
    assert stage.station.command(400, 1) == 0


@BOTH
@pytest.mark.parametrize("magic", [21196.0, 2989.0])
def test_the_word_that_forces_arming(autopilot, magic):
    stage = Stage(autopilot, faults=(parse_fault("prearm"),))
    assert stage.station.command(400, 1) in (1, 4)
    forced = autopilot == "ardupilot" and magic == 2989.0
    assert stage.station.command(400, 1, magic) == (0 if forced else {"px4": 1, "ardupilot": 4}[autopilot])


def test_px4_mission_start_arms_and_is_denied_for_items_it_has_not():
    stage = Stage("px4")
    s = stage.station
    assert s.command(300) == 2, "no mission"
    s.upload(stage.mission(*leg()))
    assert s.command(300, 3) == 2
    assert s.command(300, -1) == 0
    assert stage.pilot.armed
    s.until(lambda: stage.vehicle.body.alt_m > 20.0)


@BOTH
def test_what_the_families_answer_to_commands_they_know_or_do_not(autopilot):
    """Commander.cpp and navigator_main.cpp of PX4, GCS_Common.cpp of ArduPilot."""
    stage = Stage(autopilot)
    s = stage.station
    answers = {
        # (command, parameters): PX4, ArduPilot
        (193, 0): (3, 4),  # DO_PAUSE_CONTINUE: PX4 has none; ArduPilot only in AUTO
        (42651, 255, 90): (3, 0),  # BATTERY_RESET is ArduPilot's own
        (17,): (3, 0),  # NAV_LOITER_UNLIM
        (115, 90): (3, 0),  # CONDITION_YAW
        (207, 0): (3, 0),  # DO_FENCE_ENABLE
        (178, 1, -1): (0, 4),  # DO_CHANGE_SPEED: no speed is the default one on PX4
        (178, 2, 3): (0, 0),
        (189,): (6, 4),  # DO_LAND_START without one
        (192, -1, 0): (3, 3),  # DO_REPOSITION without the flag; ArduPilot wants COMMAND_INT
        (224, 0, 0): (4, 4),  # DO_SET_MISSION_CURRENT without a mission
        (224, -2, 0): (2, 2),
        (224, 0, 7): (2, 2),
        (246, 0): (0, 3),  # PREFLIGHT_REBOOT_SHUTDOWN that asks for nothing
    }
    got = {asked: s.command(*asked) for asked in answers}
    assert got == {asked: pair[autopilot == "ardupilot"] for asked, pair in answers.items()}


@BOTH
def test_the_current_item_is_set_by_command_with_its_jump_counters(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    s.upload(stage.mission(*leg()))
    assert s.command(224, 1) == 0
    assert [m.seq for m in s.seen if m.get_type() == "MISSION_CURRENT"][-1] == 1
    stage.pilot.run.repeats[2] = 1
    assert s.command(224, -1, 1) == 0
    assert not stage.pilot.run.repeats
    assert stage.pilot.run.current == 1
    assert s.command(224, 99) == 4


def test_ardupilot_changes_the_speed_up_and_down_too():
    stage = Stage("ardupilot")
    assert stage.station.command(178, 2, 1.5) == 0
    assert stage.station.command(178, 3, 0.8) == 0
    stage.pilot.step()
    assert (stage.pilot.speeds.up_mps, stage.pilot.speeds.down_mps) == pytest.approx((1.5, 0.8))


def test_px4_reads_a_base_mode_where_no_custom_mode_is_given():
    stage = Stage("px4")
    for base, mode in ((4, Mode.MISSION), (64 | 8, Mode.POSITION), (64, Mode.STABILIZE)):
        assert stage.station.command(176, base) == 0
        assert stage.pilot.mode == mode
    assert stage.station.command(176, 1, 4) == 0
    assert stage.pilot.mode == Mode.MISSION, "AUTO alone is the mission"


def test_px4_a_gripper_takes_its_time_and_says_so():
    stage = Stage("px4", payload_kg=0.7, parameters=(("PD_GRIPPER_EN", 1.0), ("PD_GRIPPER_TO", 2.0)))
    s = stage.station
    assert s.command(211, 1, 1) == 0, "closed already"
    assert s.command(211, 1, 0) == 5
    assert s.command(211, 1, 0) == 1, "the same again"
    assert stage.vehicle.body.payload_kg == 0.7
    assert s.wait("COMMAND_ACK", 3.0, command=211).result == 0
    assert stage.vehicle.body.payload_kg == 0.0
    assert s.command(211, 1, 1) == 5
    s.send(dialect.MAVLink_command_long_message(1, 1, 211, 0, 1, 0, 0, 0, 0, 0, 0))
    results = [m.result for m in s.run(0.5) if m.get_type() == "COMMAND_ACK"]
    assert results == [6, 0], "the first is cancelled, and it is open still"


# Commands


@BOTH
def test_a_long_command_tells_progress_can_be_asked_again_and_cancelled(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    assert s.command(241, 1) == 5
    assert s.command(241, 1) == 5, "a retry while it runs"
    acks = [(m.result, m.progress) for m in s.run(3.0) if m.get_type() == "COMMAND_ACK"]
    assert acks == [(5, 25), (5, 50), (5, 75), (0, 100)]
    assert s.command(241, 1) == 5
    cancel = message("COMMAND_CANCEL", command=241, target_system=1, target_component=1)
    s.link.write(Mavlink(255, 190).frame(cancel))
    assert s.wait("COMMAND_ACK", result=6) is not None
    assert not [m for m in s.run(3.0) if m.get_type() == "COMMAND_ACK"]


@BOTH
def test_a_duplicate_of_a_command_does_no_harm(autopilot):
    stage = Stage(autopilot, impairment=Impairment(duplicate=1.0))
    stage.take_off(20.0)
    stage.station.upload(stage.mission(*leg()))
    assert stage.pilot.armed


@BOTH
def test_unknown_commands_are_unsupported_and_answered_to_the_sender(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    assert s.command(31_000) == 3
    ack = [m for m in s.seen if m.get_type() == "COMMAND_ACK"][-1]
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert s.command_int(31_000, (0, 0, 0, 0), LAT, LON, 0) == 3


@BOTH
def test_arming_is_refused_with_the_reason_in_a_statustext(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("prearm@0s+30s")])
    s = stage.station
    if autopilot == "ardupilot":
        s.command(176, 1, 4)
    assert s.command(400, 1) == {"px4": 1, "ardupilot": 4}[autopilot]
    assert any("Compass not healthy" in text for text in s.texts)
    health = s.command(512, 1) == 0 and [m for m in s.seen if m.get_type() == "SYS_STATUS"][-1]
    assert not health.onboard_control_sensors_health & 0x10000000
    s.run(40.0)
    assert s.command(400, 1) == 0


@BOTH
def test_home_can_be_set_and_asked_for(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    assert s.command_int(179, (0, 0, 0, 0), LAT + 0.01, LON, 33.0, frame=5) == 0
    home = s.wait("HOME_POSITION") or [m for m in s.seen if m.get_type() == "HOME_POSITION"][-1]
    assert home.latitude == pytest.approx((LAT + 0.01) * 1e7, abs=2)
    assert s.command(410) == 0
    assert s.command(179, 1) == 0
    assert stage.pilot.home.lat == pytest.approx(LAT)


@BOTH
def test_a_gripper_obeys_and_says_so(autopilot):
    stage = Stage(autopilot, payload_kg=0.7)
    assert stage.station.command(211, 1, 0) == 4, "none is enabled"
    stage.pilot.parameters.set({"px4": "PD_GRIPPER_EN", "ardupilot": "GRIP_ENABLE"}[autopilot], 1.0)
    assert stage.station.command(211, 1, 0) == {"px4": 5, "ardupilot": 0}[autopilot]
    stage.station.run(1.5)
    assert stage.vehicle.body.payload_kg == 0.0
    assert stage.happened("package of 0.7 kg released")
    assert stage.station.command(211, 1, 7) == 2


@BOTH
def test_termination_stops_the_motors(autopilot):
    stage = Stage(autopilot)
    stage.take_off(20.0)
    assert stage.station.command(185, 1) == 0
    stage.station.run(6.0)
    assert stage.pilot.crashed
    assert stage.station.wait("HEARTBEAT").system_status == 6


@BOTH
def test_do_land_start_jumps_to_the_landing(autopilot):
    stage = Stage(autopilot)
    items = stage.mission(item(TAKEOFF), item(WAYPOINT, 2000), plain(189), item(21, 50, z=0.0))
    assert stage.station.upload(items) == 0
    stage.start()
    stage.station.run(30.0)
    assert stage.station.command(189) == 0
    stage.rest()
    assert stage.happened("(land)")
    assert stage.vehicle.body.lat - LAT < 60 / 111_000


# Missions


def test_ardupilot_takes_a_partial_list():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(*leg()))
    s.send(dialect.MAVLink_mission_write_partial_list_message(1, 1, 2, 2, 0))
    assert s.wait("MISSION_REQUEST").seq == 2
    s.send(s.item_message(2, item(WAYPOINT, 77)))
    assert s.wait("MISSION_ACK").type == 0
    assert stage.pilot.run.items[2].x == item(WAYPOINT, 77)[6]
    s.send(dialect.MAVLink_mission_write_partial_list_message(1, 1, 9, 12, 0))
    assert s.wait("MISSION_ACK").type == 1


def test_px4_keeps_silent_about_a_partial_list():
    s = Stage("px4").station
    s.send(dialect.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, 0))
    assert s.wait("MISSION_ACK", 2.0) is None


@BOTH
def test_the_current_item_is_set_and_told(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    s.upload(stage.mission(*leg()))
    s.seen.clear()
    s.send(dialect.MAVLink_mission_set_current_message(1, 1, 2))
    assert s.wait("MISSION_CURRENT", seq=2) is not None
    s.send(dialect.MAVLink_mission_set_current_message(1, 1, 99))
    s.run(1.0)
    assert stage.pilot.run.current == 2


def test_a_cancelled_px4_upload_leaves_the_old_mission_and_the_next_one_is_served():
    stage = Stage("px4")
    s = stage.station
    s.upload(leg())
    s.send(dialect.MAVLink_mission_count_message(1, 1, 5, 0))
    s.wait("MISSION_REQUEST_INT")
    s.send(dialect.MAVLink_mission_ack_message(1, 1, 15, 0))
    s.run(0.5)
    assert len(stage.pilot.run.items) == 3
    assert s.upload((item(TAKEOFF), item(21, 0, z=0.0))) == 0


def test_px4_an_item_again_after_the_lost_final_ack_is_acked_again():
    stage = Stage("px4")
    s = stage.station
    assert s.upload(leg()) == 0
    s.send(s.item_message(2, leg()[2]))
    assert s.wait("MISSION_ACK").type == 0


@pytest.mark.parametrize(("autopilot", "code"), [("px4", 2), ("ardupilot", 2)])
def test_an_unknown_frame_is_refused_by_its_code(autopilot, code):
    stage = Stage(autopilot)
    assert stage.station.upload(stage.mission(item(WAYPOINT, 10, frame=9))) == code


def test_ardupilot_refuses_places_off_the_globe_by_parameter():
    stage = Stage("ardupilot")
    assert stage.station.upload(stage.mission(item(WAYPOINT, x=950_000_000, y=0))) == 10
    assert stage.station.upload(stage.mission(item(WAYPOINT, x=1, y=1_900_000_000))) == 11
    assert stage.station.upload(stage.mission(item(WAYPOINT, 10, z=NAN))) == 12


@BOTH
def test_fence_and_rally_go_up_and_come_down(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    fence = [
        item(5003, 0, p=(500, 0, 0, 0)),
        *(item(5002, n, e, p=(3, 0, 0, 0)) for n, e in ((90, 0), (120, 0), (90, 30))),
    ]
    assert s.upload(fence, kind=1) == 0
    assert [m.command for m in s.download(1)] == [5003, 5002, 5002, 5002]
    assert s.upload([item(5100, 40), item(5100, 80)], kind=2) == 0
    assert len(s.download(2)) == 2
    for kind in (1, 2):
        s.send(dialect.MAVLink_mission_clear_all_message(1, 1, kind))
        assert s.wait("MISSION_ACK", mission_type=kind).type == 0
        assert s.download(kind) == []


@pytest.mark.parametrize(("action", "mode"), [(2, Mode.HOLD), (3, Mode.RTL), (5, Mode.LAND)])
def test_px4_does_at_the_fence_what_gf_action_says(action, mode):
    stage = Stage("px4", parameters=(("GF_ACTION", action),))
    s = stage.station
    stage.take_off(30.0)
    assert s.command_int(192, (-1, 1, 0, NAN), LAT + 400 / 111_000, LON, 35.0, 5) == 0
    s.upload([item(5003, 0, p=(200, 0, 0, 0))], kind=1)
    s.until(lambda: stage.happened("failsafe fence"), 120.0)
    s.run(1.0)
    assert stage.pilot.mode == mode


# Parameters


@pytest.mark.parametrize(("autopilot", "name", "value"), [("px4", "COM_FLTMODE1", -1), ("ardupilot", "FLTMODE1", -1)])
def test_integers_travel_as_bytes_on_px4_and_as_numbers_on_ardupilot(autopilot, name, value):
    stage = Stage(autopilot)
    s = stage.station
    seen = {}
    original = stage.vehicle.radio.ports[0].send
    stage.vehicle.radio.ports[0].send = lambda data: (seen.__setitem__(data[7], data), original(data))[1]
    kind = stage.pilot.parameters.find(name).kind
    raw = struct.pack("<i", value) if autopilot == "px4" else struct.pack("<f", value)
    (told,) = struct.unpack("<f", raw)
    s.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), told, kind))
    s.run(0.5)
    assert stage.pilot.parameters[name] == value
    assert seen[22][10:14] == raw


@BOTH
def test_the_parameter_list_is_complete_and_a_read_by_index_agrees(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    s.send(dialect.MAVLink_param_request_list_message(1, 1))
    listed = {m.param_index: m.param_id for m in s.run(3.0) if m.get_type() == "PARAM_VALUE"}
    assert sorted(listed) == list(range(len(stage.pilot.parameters)))
    s.send(dialect.MAVLink_param_request_read_message(1, 1, b"", 5))
    assert s.wait("PARAM_VALUE", param_index=5).param_id == listed[5]
    assert s.parameter("NO_SUCH") is None
    assert s.set_parameter("NO_SUCH", 1.0) is None


def test_ardupilot_keeps_whole_numbers_in_the_range_of_their_type():
    stage = Stage("ardupilot")
    assert stage.station.set_parameter("FENCE_ACTION", 300.7, 2).param_value == 127
    assert stage.station.set_parameter("WPNAV_SPEED", NAN).param_value == 1000.0


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
