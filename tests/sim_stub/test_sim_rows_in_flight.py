"""Rows of design/autopilots.md on missions changed in flight and on telemetry, shown by the simulated vehicle; each test names its row."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import LAND, LAT, LON, NAN, TAKEOFF, WAYPOINT, Stage, Station, away, item, leg

from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.wind_truth import ConstantWind

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


# Changing a mission in flight


def fly_to_third(stage):
    """In flight to the fourth of six items."""
    path = (item(TAKEOFF), *(item(WAYPOINT, 100 * k) for k in (1, 2, 3, 8)), item(LAND, 800))
    stage.station.upload(stage.mission(*path))
    stage.start()
    stage.station.until(lambda: stage.happened("item 3 begins"))


def test_row_px4_an_upload_in_flight_without_current_skips_waypoints_and_may_fly_straight_to_land():
    stage = Stage("px4")
    fly_to_third(stage)
    new = (item(WAYPOINT, 250, 300), item(WAYPOINT, 0, 300), item(LAND, 0, 0))
    assert stage.station.upload(new) == 0
    stage.rest()
    assert stage.events.count("item 2 begins (land)") == 1
    assert not stage.happened("item 0 begins (waypoint)")


def test_row_px4_with_current_on_the_right_item_it_is_correct():
    stage = Stage("px4")
    fly_to_third(stage)
    new = (item(WAYPOINT, 250, 300), item(WAYPOINT, 0, 300), item(LAND, 0, 0))
    assert stage.station.upload(new, current=0) == 0
    stage.station.until(lambda: away(stage, 250, 300) < 11.0, 200.0)
    stage.rest()
    assert away(stage) < 3.0


def test_row_px4_with_take_off_first_and_current_it_flies_back_to_it():
    stage = Stage("px4")
    fly_to_third(stage)
    assert stage.station.upload((item(TAKEOFF), item(WAYPOINT, 500), item(LAND, 500)), current=0) == 0
    stage.station.until(lambda: away(stage) < 11.0, 200.0)


def test_row_px4_an_infeasible_upload_in_flight_goes_into_hold():
    stage = Stage("px4")
    fly_to_third(stage)
    assert stage.station.upload((item(WAYPOINT, 250), item(TAKEOFF), item(LAND, 0)), current=0) == 0
    stage.station.run(2.0)
    assert stage.pilot.mode == Mode.HOLD


def test_row_ardupilot_pause_and_continue_works():
    stage = Stage("ardupilot")
    fly_to_third(stage)
    assert stage.station.command(193, 0) == 0
    stage.station.run(10.0)
    assert stage.vehicle.body.ground_speed_mps < 0.3
    assert stage.pilot.mode == Mode.MISSION
    assert stage.station.command(193, 1) == 0
    stage.rest()
    assert away(stage, 800) < 3.0


def test_row_ardupilot_new_items_act_as_soon_as_each_arrives():
    stage = Stage("ardupilot")
    fly_to_third(stage)
    s = stage.station
    current = stage.pilot.run.current
    new = stage.mission(item(TAKEOFF), *(item(WAYPOINT, 100 * k, -200) for k in (1, 2, 3, 4)), item(LAND, 400))
    s.send(dialect.MAVLink_mission_count_message(1, 1, len(new), 0))
    for seq in range(current + 1):
        s.wait("MISSION_REQUEST", seq=seq)
        s.send(s.item_message(seq, new[seq]))
    s.run(1.0)
    assert stage.pilot.run.behaviour.lon < LON - 0.001, "the upload is not complete, and it flies the new item"


def test_row_ardupilot_hold_upload_set_current_resume():
    stage = Stage("ardupilot")
    fly_to_third(stage)
    s = stage.station
    assert s.command(193, 0) == 0
    assert s.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 300, 100), item(LAND, 300, 100))) == 0
    assert s.command(224, 2, 0) == 0
    assert s.command(193, 1) == 0
    stage.rest()
    assert away(stage, 300, 100) < 3.0


@BOTH
def test_row_unverified_divert_by_reposition_or_guided_and_land(autopilot):
    stage = Stage(autopilot)
    fly_to_third(stage)
    lat, lon = LAT + 250 / 111_045.0, LON
    p = (-1, 1, 0, NAN) if autopilot == "px4" else (-1, 1, 0, 0)
    frame, z = (5, 45.0) if autopilot == "px4" else (6, 40.0)
    assert stage.station.command_int(192, p, lat, lon, z, frame) == 0
    stage.station.until(lambda: away(stage, 250) < 2.0, 100.0)
    assert stage.station.command(21, 0) == 0
    stage.rest()
    assert away(stage, 250) < 3.0


@BOTH
def test_row_a_pilots_mode_switch_wins(autopilot):
    stage = Stage(autopilot, faults=[parse_fault("pilot@60s")])
    stage.station.upload(stage.mission(*leg(distance=2000)))
    stage.start()
    stage.station.until(lambda: stage.happened("(the pilot)"))
    number = 3 << 16 if autopilot == "px4" else 5
    assert stage.station.wait("HEARTBEAT", 3.0, custom_mode=number) is not None
    place = away(stage)
    stage.station.run(60.0)
    assert away(stage) == pytest.approx(place, abs=25.0), "it stays where the pilot has it"
    assert stage.pilot.armed


@BOTH
def test_row_another_stations_disarm_or_mission_change_wins_and_can_be_seen(autopilot):
    stage = Stage(autopilot)
    stage.station.upload(stage.mission(*leg()))
    pilot = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle), system=254)
    before = stage.vehicle.mission_ids[0]
    assert pilot.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 90), item(LAND, 90))) == 0
    assert stage.vehicle.mission_ids[0] != before
    assert len(stage.station.download()) == len(stage.mission(*leg()))
    stage.start()
    assert stage.station.wait("HEARTBEAT", 3.0).base_mode & 128
    assert pilot.command(400, 0, 21196) == 0
    stage.station.run(2.0)
    assert not [m for m in stage.station.seen if m.get_type() == "HEARTBEAT"][-1].base_mode & 128


# Telemetry


def test_row_ardupilot_streams_nothing_useful_until_asked():
    stage = Stage("ardupilot")
    s = stage.station
    assert {m.get_type() for m in s.run(10.0)} == {"HEARTBEAT"}
    assert s.command(511, 33, 250_000) == 0
    s.send(dialect.MAVLink_request_data_stream_message(1, 1, 10, 10, 1))
    found = [m.get_type() for m in s.run(10.0)]
    assert found.count("GLOBAL_POSITION_INT") == pytest.approx(40, abs=2)
    assert found.count("ATTITUDE") == pytest.approx(100, abs=2)


def test_row_ardupilot_arming_in_guided_needs_40_s_after_boot_and_says_why():
    stage = Stage("ardupilot", warm=False)
    s = stage.station
    s.run(10.0)
    assert s.command(176, 1, 4) == 0
    tries = 0
    while s.command(400, 1) != 0:
        tries += 1
        s.run(2.0)
    assert 40.0 < stage.lockstep.now_s < 50.0
    assert tries > 5
    assert "Arm: Need Position Estimate" in s.texts


def test_row_airspeed_is_never_to_be_trusted():
    for autopilot in ("px4", "ardupilot"):
        stage = Stage(autopilot, wind=ConstantWind.of(10, 0))
        stage.take_off()
        s = stage.station
        assert s.command(511, 74, 200_000) == 0
        hud = s.wait("VFR_HUD")
        if autopilot == "px4":
            assert math.isnan(hud.airspeed)
        else:
            assert hud.airspeed == pytest.approx(hud.groundspeed)
        assert stage.vehicle.body.airspeed_mps > 8.0


def test_row_px4_wind_cov_is_alive_only_with_drag_fusion():
    for on in (0, 1):
        stage = Stage("px4", wind=ConstantWind.of(7, 270), parameters=(("EKF2_DRAG_CTRL", on),))
        stage.vehicle.gusts.intensity = 0.0
        stage.take_off()
        found = stage.station.wait("WIND_COV", 10.0)
        assert (found is not None) is bool(on)
    assert found.wind_y == pytest.approx(7.0, abs=0.8), "towards the east"


def test_row_ardupilot_wind_comes_at_4_hz_but_zero_unless_its_drag_is_set():
    for coefficients, speed in (((), 0.0), ((("EK3_DRAG_MCOEF", 0.2),), 7.0)):
        stage = Stage("ardupilot", wind=ConstantWind.of(7, 270), parameters=coefficients)
        stage.vehicle.gusts.intensity = 0.0
        stage.take_off()
        s = stage.station
        s.send(dialect.MAVLink_request_data_stream_message(1, 1, 12, 4, 1))
        found = [m for m in s.run(10.0) if m.get_type() == "WIND"]
        assert len(found) == pytest.approx(40, abs=2)
        assert found[-1].speed == pytest.approx(speed, abs=0.8)
    assert found[-1].direction == pytest.approx(270.0, abs=10.0), "FROM the west"


def test_row_soc_may_jump_be_unknown_or_stay_where_it_is():
    faults = [parse_fault(t) for t in ("soc-unknown@20s+10s", "soc-jump=0.4@40s+10s", "soc-stuck@60s")]
    stage = Stage("px4", faults=faults)
    s = stage.station
    s.run(25.0)
    assert s.wait("SYS_STATUS", 2.0).battery_remaining == -1
    assert s.wait("BATTERY_STATUS", 3.0).battery_remaining == -1
    s.run(15.0)
    assert s.wait("SYS_STATUS", 2.0).battery_remaining == 40
    s.run(20.0)
    stage.vehicle.battery.soc = 0.3
    assert s.wait("SYS_STATUS", 2.0).battery_remaining > 90
    cold = Stage("px4", warm=False)
    assert cold.station.wait("SYS_STATUS", 6.0).battery_remaining == -1, "unknown in the first seconds"
