"""One vehicle, one mission, both families: what a delivery leg looks like on the wire."""

import itertools
import math

import pytest
from sim_station import JUMP, LAND, LAT, LON, NAN, SPEED, TAKEOFF, WAYPOINT, Stage, item, leg, plain

from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind

GRIPPER = {"px4": (("PD_GRIPPER_EN", 1),), "ardupilot": (("GRIP_ENABLE", 1),)}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


@BOTH
def test_a_leg_is_flown_from_take_off_to_disarmed_on_the_ground(autopilot):
    stage = Stage(autopilot, wind=ConstantWind.of(6, 300))
    assert stage.station.upload(stage.mission(*leg())) == 0
    assert set(stage.start()) == {0}
    stage.rest()
    north, east = offset_m(
        stage.vehicle.config.lat, stage.vehicle.config.lon, stage.vehicle.body.lat, stage.vehicle.body.lon
    )
    assert math.hypot(north - 400, east) < 2.0
    assert stage.vehicle.body.alt_m == 5.0
    assert 0.9 < stage.vehicle.battery.soc < 0.99


@BOTH
def test_tilt_ground_velocity_and_wind_agree_in_steady_flight(autopilot):
    stage = Stage(autopilot, wind=ConstantWind.of(8, 0))
    stage.vehicle.gusts.intensity = 0.0
    stage.station.upload(stage.mission(item(TAKEOFF), plain(SPEED, 1, 9, -1), item(WAYPOINT, 3000), item(LAND, 3000)))
    stage.start()
    stage.station.run(60.0)
    body, frame = stage.vehicle.body, stage.vehicle.airframe
    assert body.ground_speed_mps == pytest.approx(9.0, abs=0.05)
    assert body.airspeed_mps == pytest.approx(17.0, abs=0.05), "the wind is against it"
    drag = frame.drag_n_per_speed(17.0, 0.0) * 17.0
    assert math.tan(-body.pitch) * frame.weight_n == pytest.approx(drag, rel=0.01)
    attitude = stage.station.wait("ATTITUDE", 2.0) if autopilot == "px4" else None
    assert attitude is None or attitude.pitch == pytest.approx(body.pitch, abs=0.02)


@BOTH
def test_do_jump_repeats_a_leg_as_often_as_it_says(autopilot):
    stage = Stage(autopilot)
    first = 1 if autopilot == "ardupilot" else 0
    stage.station.upload(
        stage.mission(
            item(TAKEOFF), item(WAYPOINT, 60), item(WAYPOINT, 0), plain(JUMP, first + 1, 2), item(LAND, 0, z=0)
        )
    )
    stage.start()
    stage.rest()
    assert stage.events.count(f"item {first + 1} reached") == 3


@BOTH
def test_a_waypoint_holds_as_long_as_it_says_and_a_gripper_lets_go(autopilot):
    stage = Stage(autopilot, payload_kg=1.0, parameters=GRIPPER[autopilot])
    stage.station.upload(
        stage.mission(item(TAKEOFF), item(WAYPOINT, 100, p=(20, 0, 0, NAN)), plain(211, 1, 0), item(LAND, 100, z=0))
    )
    stage.start()
    stage.station.until(lambda: stage.vehicle.body.payload_kg == 0.0)
    times = {e.text: e.sim_s for e in stage.world.events}
    arrived = next(t for text, t in times.items() if text.startswith("item") and "waypoint" in text)
    assert times["package of 1 kg released " + stage.vehicle.place()] - arrived > 20.0
    stage.rest()


@BOTH
def test_loiter_time_loiter_to_alt_and_delay_take_their_time(autopilot):
    stage = Stage(autopilot)
    waits = [item(19, 50, p=(15, 0, 0, 0)), item(31, 50, z=60.0, p=(0, 0, 0, 0)), plain(93, 10)]
    stage.station.upload(stage.mission(item(TAKEOFF), *waits, item(LAND, 50, z=0)))
    assert set(stage.start()) == {0}
    began = {}
    first = 1 if autopilot == "px4" else 2
    for number in range(first, first + 4):
        stage.station.until(lambda number=number: stage.happened(f"item {number} begins"))
        began[number - first] = stage.lockstep.now_s
    assert began[1] - began[0] > 15.0
    assert began[2] - began[1] > 20.0 / 3.0, "20 m up at 3 m/s at most"
    assert began[3] - began[2] == pytest.approx(10.0, abs=0.2)
    assert stage.vehicle.body.alt_m == pytest.approx(65.0, abs=1.5)


def test_ardupilot_conditions_hold_back_what_follows_them_until_they_are_met():
    stage = Stage("ardupilot")
    s = stage.station
    s.command(511, 30, 50_000)  # something to hear at every step
    conditions = [plain(112, 5), plain(178, 1, 4, -1), plain(114, 20), plain(178, 1, 6, -1), plain(115, 90, 0, 1, 0)]
    s.upload(
        stage.mission(
            item(TAKEOFF), item(WAYPOINT, 20), *conditions, plain(178, 1, 2, -1), item(WAYPOINT, 150), item(LAND, 150)
        )
    )
    stage.start()
    s.until(lambda: stage.happened("item 9 begins"))
    begun = stage.lockstep.now_s
    s.until(lambda: stage.pilot.commanded_mps == 4.0)
    assert stage.lockstep.now_s - begun == pytest.approx(5.0, abs=0.2)
    s.until(lambda: stage.pilot.commanded_mps == 6.0)
    north, _ = offset_m(LAT, LON, stage.vehicle.body.lat, stage.vehicle.body.lon)
    assert 150 - north == pytest.approx(20.0, abs=1.0)
    s.until(lambda: stage.pilot.commanded_mps == 2.0)
    assert math.degrees(stage.vehicle.body.yaw) == pytest.approx(90.0, abs=2.5)


def test_ardupilot_skips_what_a_condition_holds_back_when_the_waypoint_comes_first():
    stage = Stage("ardupilot")
    held = [plain(112, 500), plain(178, 1, 4, -1)]
    stage.station.upload(
        stage.mission(item(TAKEOFF), *held, item(WAYPOINT, 60), item(WAYPOINT, 120), item(LAND, 120, z=0))
    )
    stage.start()
    stage.rest()
    assert stage.pilot.commanded_mps is None


@pytest.mark.parametrize(("p3", "p4", "heading"), [(1, 0, 200.0), (1, 1, 250.0), (-1, 1, 210.0)])
def test_ardupilot_turns_to_a_heading_absolute_or_relative_either_way(p3, p4, heading):
    stage = Stage("ardupilot")
    stage.take_off()
    stage.vehicle.body.yaw = math.radians(230.0 - 360.0)
    assert stage.station.command(115, 20 if p4 else 200, 0, p3, p4) == 0
    stage.station.run(8.0)
    assert math.degrees(stage.vehicle.body.yaw) % 360.0 == pytest.approx(heading, abs=2.0)


def test_px4_keeps_a_condition_delay_as_a_delay_and_refuses_the_other_conditions():
    stage = Stage("px4")
    s = stage.station
    assert s.upload((item(TAKEOFF), plain(112, 8), item(LAND, 0, z=0))) == 0
    assert [m.command for m in s.download()] == [TAKEOFF, 93, LAND]
    stage.start()
    s.until(lambda: stage.happened("item 1 begins"))
    begun = stage.lockstep.now_s
    s.until(lambda: stage.happened("item 2 begins"))
    assert stage.lockstep.now_s - begun == pytest.approx(8.0, abs=0.2)
    for refused in (plain(114, 20), plain(115, 90), item(18, 50, p=(2, 0, 30, 0))):
        assert s.upload((item(TAKEOFF), refused, item(LAND, 0, z=0))) == 3


@BOTH
def test_it_is_refused_to_disarm_in_the_air_and_forced_it_falls(autopilot):
    stage = Stage(autopilot)
    stage.take_off()
    assert stage.station.command(400, 0) in (1, 4)
    assert stage.station.command(400, 0, 21196) == 0
    stage.station.run(10.0)
    assert stage.pilot.crashed
    assert stage.station.command(400, 1) != 0


@BOTH
def test_an_empty_battery_falls_out_of_the_sky(autopilot):
    stage = Stage(autopilot, soc=0.03)
    if autopilot == "px4":
        stage.pilot.parameters.set("BAT_CRIT_THR", 0.0)
        stage.pilot.parameters.set("BAT_LOW_THR", 0.0)
        stage.pilot.parameters.set("BAT_EMERGEN_THR", 0.0)
    stage.take_off()
    stage.station.until(lambda: stage.pilot.crashed, 300.0)
    assert stage.happened("battery empty")
    assert stage.vehicle.battery.soc == 0.0


def test_hover_lasts_as_long_as_the_maker_says():
    for payload_kg, minutes in ((0.0, 38.0), (1.45, 24.0)):
        stage = Stage("px4", payload_kg=payload_kg)
        stage.take_off(10.0)
        before, start = stage.vehicle.battery.soc, stage.lockstep.now_s
        stage.station.run(60.0)
        used = before - stage.vehicle.battery.soc
        assert (stage.lockstep.now_s - start) / used / 60.0 == pytest.approx(minutes, rel=0.01)
        assert LAT


def test_px4_takes_heading_and_acceptance_radius_of_a_waypoint():
    stage = Stage("px4")
    waypoint = item(WAYPOINT, 200, p=(20, 3, 0, 135))
    stage.station.upload((item(TAKEOFF), waypoint, item(LAND, 200, z=0)))
    stage.start()
    stage.station.until(lambda: stage.pilot.run.current == 1 and stage.pilot.run.behaviour.arrived_s is not None)
    north, _ = offset_m(LAT, stage.vehicle.config.lon, stage.vehicle.body.lat, stage.vehicle.body.lon)
    assert 196.0 < north < 199.0, "3 m before it"
    stage.station.run(10.0)
    assert math.degrees(stage.vehicle.body.yaw) == pytest.approx(135.0, abs=1.0)


def test_ardupilot_looks_along_the_way_whatever_an_item_says():
    stage = Stage("ardupilot")
    stage.station.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 400, 400, p=(0, 0, 0, 270)), item(LAND, 400, 400)))
    stage.start()
    stage.station.run(40.0)
    assert math.degrees(stage.vehicle.body.yaw) == pytest.approx(45.0, abs=3.0)


@BOTH
def test_loiter_unlimited_stays_until_told_otherwise(autopilot):
    stage = Stage(autopilot)
    stage.station.upload(stage.mission(item(TAKEOFF), item(17, 60, p=(0, 0, 0, 0)), item(LAND, 0, z=0)))
    stage.start()
    stage.station.run(120.0)
    assert stage.pilot.armed
    assert stage.vehicle.body.ground_speed_mps < 0.3
    assert stage.station.command(20) == 0
    stage.rest()


@pytest.mark.parametrize(("radius", "clockwise"), [(30.0, True), (-60.0, False)])
def test_ardupilot_flies_its_turns_as_circles(radius, clockwise):
    stage = Stage("ardupilot", wind=ConstantWind.of(6.0, 250.0))
    s = stage.station
    s.upload(stage.mission(item(TAKEOFF), item(18, 100, p=(2, 0, radius, 0)), item(LAND, 100)))
    stage.start()
    s.until(lambda: stage.happened("item 2 begins"))
    s.until(lambda: stage.pilot.run.behaviour.edge is not None and stage.pilot.run.behaviour.edge.done)
    centre = item(18, 100)[6] * 1e-7, item(18, 100)[7] * 1e-7
    away, angles = [], []
    while not stage.happened("item 2 reached"):
        s.run(0.5)
        body = stage.vehicle.body
        north, east = offset_m(*centre, body.lat, body.lon)
        away.append(math.hypot(north, east))
        angles.append(math.atan2(east, north))
    assert min(away[6:]) > 0.85 * abs(radius)
    assert max(away[6:]) < 1.15 * abs(radius)
    turned = sum((b - a + math.pi) % (2 * math.pi) - math.pi for a, b in itertools.pairwise(angles))
    assert abs(turned) == pytest.approx(4 * math.pi, rel=0.1)
    assert (turned > 0) is clockwise


@pytest.mark.parametrize(("asked", "kept"), [(50.0, 50), (-30.4, -30), (255.0, 255), (256.0, 260), (9999.0, 2550)])
def test_ardupilot_keeps_the_radius_of_turns_in_a_byte(asked, kept):
    stage = Stage("ardupilot")
    stage.station.upload(stage.mission(item(TAKEOFF), item(18, 100, p=(2, 0, asked, 0)), item(LAND, 100)))
    assert stage.station.download()[2].param3 == kept


@BOTH
def test_a_return_item_ends_a_mission_at_home(autopilot):
    stage = Stage(autopilot)
    stage.station.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 120), plain(20)))
    stage.start()
    stage.rest()
    north, east = offset_m(LAT, stage.vehicle.config.lon, stage.vehicle.body.lat, stage.vehicle.body.lon)
    assert math.hypot(north, east) < 2.0


def test_ardupilot_waits_until_midnight_where_a_delay_is_nothing():
    stage = Stage("ardupilot")
    stage.station.upload(stage.mission(item(TAKEOFF), plain(93, 0, 0, 0, 0), item(LAND, 0, z=0)))
    stage.start()
    stage.station.run(120.0)
    assert stage.pilot.armed
    assert stage.pilot.run.current == 2


@pytest.mark.parametrize(("level", "mode"), [("LOW", "return"), ("CRT", "land")])
def test_ardupilot_acts_on_voltage_only_after_its_timer(level, mode):
    act = 2 if level == "LOW" else 1
    stage = Stage("ardupilot", soc=0.5)
    stage.take_off(20.0)
    for name, value in ((f"BATT_FS_{level}_ACT", act), (f"BATT_{level}_VOLT", 25.0), ("BATT_LOW_TIMER", 10)):
        stage.pilot.parameters.set(name, value)
    stage.station.run(8.0)
    assert not stage.happened("failsafe battery")
    stage.station.run(4.0)
    assert stage.pilot.mode.value == mode
