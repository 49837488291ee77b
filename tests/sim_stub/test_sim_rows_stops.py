"""Rows of design/autopilots.md on speed and on stops between legs, shown by the simulated vehicle; each test names its row."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import DELAY, DISARM, LAND, LAT, LON, SPEED, TAKEOFF, WAYPOINT, Stage, away, height, item, leg, plain

from skyway.models.network.station import Station as Place
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


# Speed


@pytest.mark.parametrize("kind", [0, 1])
@BOTH
def test_row_multirotors_hold_ground_speed_whatever_type_the_item_names(autopilot, kind):
    stage = Stage(autopilot, wind=ConstantWind.of(6, 180))
    stage.vehicle.gusts.intensity = 0.0
    stage.station.upload(
        stage.mission(item(TAKEOFF), plain(SPEED, kind, 8, -1), item(WAYPOINT, 2000), item(LAND, 2000))
    )
    stage.start()
    stage.station.run(60.0)
    assert stage.vehicle.body.ground_speed_mps == pytest.approx(8.0, abs=0.05)


@pytest.mark.parametrize(
    ("autopilot", "name", "cruise"), [("px4", "MPC_XY_CRUISE", 5.0), ("ardupilot", "WPNAV_SPEED", 10.0)]
)
def test_row_speed_parameters_cap_the_plan(autopilot, name, cruise):
    most = 12.0 if autopilot == "px4" else 10.0
    for item_speed, flown in ((None, cruise), (40.0, most)):
        stage = Stage(autopilot)
        speed = [] if item_speed is None else [plain(SPEED, 1, item_speed, -1)]
        stage.station.upload(stage.mission(item(TAKEOFF), *speed, item(WAYPOINT, 2000), item(LAND, 2000)))
        stage.start()
        stage.station.run(60.0)
        assert stage.vehicle.body.ground_speed_mps == pytest.approx(flown, abs=0.1)
    limit, scale = ("MPC_XY_VEL_MAX", 1) if autopilot == "px4" else ("WPNAV_SPEED", 100)
    stage.pilot.parameters.set(limit, 99.0 * scale)
    stage.pilot.parameters.set(name, 99.0 * scale)
    stage.station.run(40.0)
    assert stage.vehicle.body.ground_speed_mps == pytest.approx(20.0, abs=0.1), "at most 20 m/s"


@BOTH
def test_row_a_supervisor_sends_the_ground_speed_again_in_flight(autopilot):
    stage = Stage(autopilot)
    stage.station.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 3000), item(LAND, 3000)))
    stage.start()
    stage.station.run(40.0)
    assert stage.station.command(178, 0, 7.5, -1) == 0
    stage.station.run(20.0)
    assert stage.vehicle.body.ground_speed_mps == pytest.approx(7.5, abs=0.05)


# Recharge holds


def test_row_px4_a_second_take_off_in_one_mission_is_accepted_and_infeasible():
    stage = Stage("px4")
    two = (item(TAKEOFF), item(WAYPOINT, 50), item(LAND, 50), plain(DELAY, 5), item(TAKEOFF, 50), item(LAND, 50))
    assert stage.station.upload(two) == 0
    assert stage.station.command(300) == 2


def test_row_px4_land_delay_waypoint_straight_above_works_and_stays_armed_on_the_pad():
    stage = Stage("px4")
    s = stage.station
    s.upload((*leg(distance=60), plain(DELAY, 40), item(WAYPOINT, 60), item(WAYPOINT, 120), item(LAND, 120, z=0)))
    stage.start()
    s.until(lambda: stage.happened("item 2 reached"))
    s.run(30.0)
    assert stage.pilot.armed
    assert stage.pilot.landed
    stage.rest()
    assert away(stage, 120) < 2.0


def test_row_px4_land_followed_by_a_distant_waypoint_leaves_sideways_at_low_height():
    stage = Stage("px4")
    s = stage.station
    s.upload((*leg(distance=60), plain(DELAY, 5), item(WAYPOINT, 300), item(LAND, 300, z=0)))
    stage.start()
    s.until(lambda: stage.happened("item 3 reached"))
    s.until(lambda: away(stage, 60) > 10.0, 60.0)
    assert height(stage) < 20.0


def test_row_px4_land_disarm_waypoint_above_works_and_a_plain_arm_resumes():
    stage = Stage("px4")
    s = stage.station
    s.upload((*leg(distance=60), plain(DISARM, 0), item(WAYPOINT, 60), item(WAYPOINT, 120), item(LAND, 120, z=0)))
    stage.start()
    stage.rest()
    assert away(stage, 60) < 2.0
    s.run(100.0)
    assert not stage.pilot.armed
    assert s.command(400, 1) == 0
    stage.rest()
    assert away(stage, 120) < 2.0


def test_row_ardupilot_land_disarms_and_resets_the_mission():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(*leg(distance=60), plain(DELAY, 5, frame=3), item(TAKEOFF, 60), item(LAND, 0)))
    stage.start()
    stage.rest()
    assert away(stage, 60) < 2.0
    s.run(60.0)
    assert not stage.pilot.armed
    assert stage.pilot.run.current == 0


@pytest.mark.parametrize("disarm_delay", [0, 10])
def test_row_ardupilot_continue_after_land_flies_one_mission_only_without_a_disarm_delay(disarm_delay):
    stage = Stage("ardupilot", parameters=(("MIS_OPTIONS", 4), ("DISARM_DELAY", disarm_delay)))
    s = stage.station
    legs = (*leg(distance=60), plain(DELAY, 30, frame=3), item(TAKEOFF, 60), item(WAYPOINT, 120), item(LAND, 120))
    s.upload(stage.mission(*legs))
    stage.start()
    stage.rest()
    assert away(stage, 120 if disarm_delay == 0 else 60) < 2.0


@BOTH
def test_row_one_mission_per_leg_works_best_and_home_moves_to_the_new_site_at_the_next_arming(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    for start, end in ((0, 80), (80, 160)):
        items = (item(TAKEOFF, start), item(WAYPOINT, end), item(LAND, end, z=0))
        assert s.upload(stage.mission(*items)) == 0
        if autopilot == "ardupilot":
            assert s.command(224, 0, 0) == 0
        assert set(stage.start()) == {0}
        home_north = offset_m(LAT, LON, stage.pilot.home.lat, stage.pilot.home.lon)[0]
        assert home_north == pytest.approx(start, abs=2.0)
        stage.rest()
        assert away(stage, end) < 2.0


def test_row_px4_rearm_trap_after_a_completed_mission_it_does_nothing_or_lands_at_once():
    stage = Stage("px4")
    s = stage.station
    s.upload(leg(distance=60))
    stage.start()
    stage.rest()
    assert s.command(400, 1) == 0
    s.run(9.0)
    assert stage.pilot.landed, "still in mission mode it does nothing"
    stage.rest()
    s.command(176, 1, 4, 3)
    assert s.command(400, 1) == 0
    s.command(176, 1, 4, 4)
    s.run(12.0)
    assert stage.events.count("item 2 begins (land)") == 2, "it lands at once, on the pad"
    assert not stage.pilot.armed
    s.send(dialect.MAVLink_mission_set_current_message(1, 1, 0))
    assert s.command(400, 1) == 0
    s.until(lambda: not stage.pilot.landed, 20.0)


def test_row_ardupilot_rearming_needs_224_guided_arm_auto_mission_start():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(*leg(distance=60), item(TAKEOFF, 60), item(WAYPOINT, 120), item(LAND, 120)))
    stage.start()
    stage.rest()
    assert s.command(400, 1) == 4, "AUTO is not armable"
    assert any("AUTO mode not armable" in t for t in s.texts)
    assert s.command(224, 4, 0) == 0
    assert s.command(176, 1, 4) == 0
    assert s.command(400, 1) == 0
    assert s.command(176, 1, 3) == 0
    s.run(5.0)
    assert stage.pilot.landed, "AUTO alone waits on the ground"
    assert s.command(300) == 0
    stage.rest()
    assert away(stage, 120) < 2.0


def test_row_ardupilot_in_auto_on_the_ground_the_mission_must_start_with_a_take_off():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(item(WAYPOINT, 100), item(LAND, 100)))
    s.command(176, 1, 4)
    s.command(400, 1)
    assert s.command(300) == 4
    assert "Auto: Missing Takeoff Cmd" in s.texts


def test_row_the_final_land_gives_no_item_reached_on_ardupilot_and_px4_repeats_ten_times():
    for autopilot, last, times in (("ardupilot", 3, 0), ("px4", 2, 11)):
        stage = Stage(autopilot)
        s = stage.station
        s.upload(stage.mission(*leg(distance=60)))
        stage.start()
        stage.rest()
        s.run(15.0)
        reached = [m.seq for m in s.seen if m.get_type() == "MISSION_ITEM_REACHED"]
        assert reached.count(last) == times
        assert reached.count(last - 1) >= 1
        assert s.command(512, 245) == 0
        assert s.seen[-1].get_type() == "COMMAND_ACK" or s.wait("EXTENDED_SYS_STATE")
        state = [m for m in s.seen if m.get_type() == "EXTENDED_SYS_STATE"][-1]
        assert state.landed_state == 1


def test_row_home_moves_when_arming_so_heights_depend_on_staying_armed():
    """Two stations 20 m apart in height: a second leg at 40 m of an armed mission is 20 m above the second pad."""
    places = (Place("low", "low", LAT, LON, 5.0), Place("high", "high", LAT + 300 / 111_045.0, LON, 25.0))
    for hold, expected in ((plain(DELAY, 5), 45.0), (plain(DISARM, 0), 65.0)):
        stage = Stage("px4", stations=places)
        s = stage.station
        s.upload((*leg(distance=300, height=60), hold, item(WAYPOINT, 300), item(WAYPOINT, 600), item(LAND, 600, z=0)))
        stage.start()
        s.until(lambda stage=stage: stage.happened("item 2 reached"))
        assert stage.vehicle.body.alt_m == 25.0
        s.run(10.0)
        if not stage.pilot.armed:
            assert s.command(400, 1) == 0
        s.until(lambda stage=stage: stage.happened("item 4 reached"))
        assert stage.vehicle.body.alt_m == pytest.approx(expected, abs=1.5)


def test_row_an_armed_hold_leaves_by_the_clock_whatever_the_soc():
    stage = Stage("px4", soc=0.3)
    s = stage.station
    s.upload((*leg(distance=60), plain(DELAY, 200), item(WAYPOINT, 60), item(LAND, 60, z=0)))
    stage.start()
    s.until(lambda: stage.happened("item 2 reached"))
    soc, start = stage.vehicle.battery.soc, stage.lockstep.now_s
    s.until(lambda: not stage.pilot.landed, 300.0)
    assert stage.lockstep.now_s - start == pytest.approx(200.0, abs=3.0)
    assert stage.vehicle.battery.soc < soc, "the propellers have turned all the time"


def test_row_ardupilots_battery_percentage_only_falls_until_battery_reset():
    from skyway.sim_stub.vehicle import Charge

    stage = Stage("ardupilot", soc=0.5)
    s = stage.station
    assert stage.pilot.reported_percent() == 50
    stage.vehicle.charging = Charge(0.9)
    s.run(4000.0)
    assert stage.vehicle.battery.soc == pytest.approx(0.9)
    assert stage.pilot.reported_percent() <= 50
    assert s.command(42651, 1, 90) == 0
    assert stage.pilot.reported_percent() == 90


@BOTH
def test_row_a_reboot_on_the_pad_is_normal(autopilot):
    stage = Stage(autopilot)
    s = stage.station
    s.upload(stage.mission(*leg()))
    s.run(100.0)
    before = stage.vehicle.boot_ms
    assert s.command(246, 1) == 0
    s.run(stage.pilot.BOOT_S / 2)
    s.seen.clear()
    assert s.command(512, 148, seconds=1.0) is None, "it is silent while it boots"
    s.run(6.0)
    assert stage.vehicle.boot_ms < before, "the time base starts again"
    assert s.wait("HEARTBEAT") is not None
    assert len(s.download()) == len(stage.mission(*leg())), "missions survive"
    if autopilot == "ardupilot":
        assert stage.pilot.reported_percent() >= 99, "it believes in a fresh battery"
