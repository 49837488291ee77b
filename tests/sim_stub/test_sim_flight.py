"""One vehicle, one mission, both families: what a delivery leg looks like on the wire."""

import math

import pytest
from sim_station import JUMP, LAND, LAT, NAN, SPEED, TAKEOFF, WAYPOINT, Stage, item, leg, plain

from sim_stub.physics import offset_m
from sim_stub.wind_truth import ConstantWind

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
def test_condition_and_delay_items_and_loiter_time(autopilot):
    stage = Stage(autopilot)
    waits = [item(19, 50, p=(15, 0, 0, 0)), item(31, 50, z=60.0, p=(0, 0, 0, 0)), plain(93, 10)]
    conditions = [plain(112, 5), plain(178, 1, 4, -1), plain(114, 20), plain(178, 1, 6, -1)]
    if autopilot == "ardupilot":
        conditions.append(plain(115, 90, 0, 1, 0))
    stage.station.upload(
        stage.mission(item(TAKEOFF), *waits, *conditions, item(WAYPOINT, 150, z=60), item(LAND, 150, z=0))
    )
    assert set(stage.start()) == {0}
    stage.rest()
    assert stage.happened("mission complete") or autopilot == "ardupilot"
    assert stage.pilot.commanded_mps == 6.0


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
    stage.station.run(300.0)
    assert stage.pilot.armed
    assert stage.vehicle.body.ground_speed_mps < 0.3
    assert stage.station.command(20) == 0
    stage.rest()


def test_ardupilot_loiters_turns_for_as_long_as_they_would_take():
    stage = Stage("ardupilot")
    stage.station.upload(stage.mission(item(TAKEOFF), item(18, 60, p=(2, 0, 50, 0)), item(LAND, 60)))
    stage.start()
    stage.station.until(lambda: stage.happened("item 2 begins"))
    begun = stage.lockstep.now_s
    stage.station.until(lambda: stage.happened("item 2 reached"))
    assert stage.lockstep.now_s - begun > 2 * 2 * math.pi * 50 / 10


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
