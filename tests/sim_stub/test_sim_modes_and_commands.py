"""Heartbeat, modes and commands of the simulated vehicle."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import LAT, LON, TAKEOFF, WAYPOINT, Stage, item, leg, plain

from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.transports.channel import Impairment
from skyway.sim_stub.wire.messages import Mavlink, message

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
