"""Rows of design/autopilots.md on fence, rally points and failsafes, shown by the simulated vehicle; each test names its row."""

import math

import pytest
from sim_station import LAND, LAT, LON, NAN, TAKEOFF, WAYPOINT, Stage, Station, away, height, item, leg

from skyway.sim_stub.faults import parse_fault

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


# Fence, rally, failsafe


def test_row_rally_limit_sends_a_farther_vehicle_home_instead():
    for limit_km, north in ((0.3, 0.0), (0.0, 1200.0)):
        stage = Stage("ardupilot", parameters=(("RALLY_LIMIT_KM", limit_km), ("WPNAV_SPEED", 1500)))
        s = stage.station
        assert s.upload([item(5100, 1200.0)], kind=2) == 0
        s.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 800), item(LAND, 800)))
        stage.start()
        s.until(lambda stage=stage: away(stage, 700) < 20.0)
        assert s.command(20) == 0
        stage.rest()
        assert away(stage, north) < 3.0


def test_row_px4_returns_to_the_nearest_of_home_and_rally_points():
    stage = Stage("px4")
    s = stage.station
    assert s.upload([item(5100, 300.0)], kind=2) == 0
    s.upload((item(TAKEOFF), item(WAYPOINT, 250), item(LAND, 250)))
    stage.start()
    s.until(lambda: away(stage, 200) < 20.0)
    assert s.command(20) == 0
    s.run(30.0)
    assert height(stage) > 55.0, "at RTL_RETURN_ALT"
    stage.rest()
    assert away(stage, 300) < 3.0


def test_row_fence_type_7_also_breaches_300_m_from_home_and_4_does_not():
    for kinds, breached in ((7, True), (4, False)):
        stage = Stage("ardupilot", parameters=(("FENCE_ENABLE", 1), ("FENCE_TYPE", kinds)))
        stage.station.upload(stage.mission(*leg(distance=500)))
        stage.start()
        stage.rest()
        assert stage.happened("failsafe fence") is breached
        assert (away(stage) < 3.0) is breached
    high = Stage("ardupilot", parameters=(("FENCE_ENABLE", 1), ("FENCE_TYPE", 7)))
    high.station.upload(high.mission(*leg(distance=100, height=120)))
    high.start()
    high.rest()
    assert high.happened("failsafe fence")


@pytest.mark.parametrize(
    ("autopilot", "options", "breached"), [("px4", None, False), ("ardupilot", 0, True), ("ardupilot", 2, False)]
)
def test_row_several_inclusion_areas_px4_any_ardupilot_all_unless_fence_options(autopilot, options, breached):
    parameters = () if options is None else (("FENCE_ENABLE", 1), ("FENCE_TYPE", 4), ("FENCE_OPTIONS", options))
    stage = Stage(autopilot, parameters=parameters)

    def box(south, north):
        return [item(5001, n, e, p=(4, 0, 0, 0)) for n, e in ((south, -50), (south, 50), (north, 50), (north, -50))]

    assert stage.station.upload(box(-50, 220) + box(180, 450), kind=1) == 0
    stage.station.upload(stage.mission(*leg()))
    if autopilot == "ardupilot" and options == 0:
        assert stage.start()[1] == 4, "it does not even arm outside one of them"
        return
    assert set(stage.start()) == {0}
    stage.rest()
    assert stage.happened("failsafe fence") is breached


@pytest.mark.parametrize(
    ("autopilot", "parameters", "finishes"),
    [
        ("px4", (("NAV_DLL_ACT", 2),), False),
        ("px4", (("NAV_DLL_ACT", 2), ("COM_DLL_EXCEPT", 1)), True),
        ("px4", (("NAV_DLL_ACT", 0),), True),
        ("ardupilot", (("FS_GCS_ENABLE", 1),), False),
        ("ardupilot", (("FS_GCS_ENABLE", 1), ("FS_OPTIONS", 2)), True),
        ("ardupilot", (), True),
    ],
)
def test_row_link_loss_to_finish_the_leg_depends_on_the_parameters(autopilot, parameters, finishes):
    stage = Stage(autopilot, parameters=parameters)
    stage.station.upload(stage.mission(*leg(distance=600)))
    stage.start()
    stage.station.run(40.0)
    stage.lockstep.run_for(400.0)  # our program has ended, and its heartbeat with it
    assert not stage.pilot.armed
    assert (away(stage, 600 if finishes else 0) < 3.0) is True


@pytest.mark.parametrize(
    ("autopilot", "parameters", "finishes"),
    [
        ("px4", (), False),
        ("px4", (("COM_RCL_EXCEPT", 1),), True),
        ("ardupilot", (), False),
        ("ardupilot", (("FS_OPTIONS", 1),), True),
    ],
)
def test_row_remote_control_loss_to_finish_the_leg_depends_on_the_parameters(autopilot, parameters, finishes):
    stage = Stage(autopilot, parameters=parameters, faults=[parse_fault("rc-loss@50s")])
    stage.station.upload(stage.mission(*leg(distance=600)))
    stage.start()
    stage.rest()
    assert away(stage, 600 if finishes else 0) < 3.0


def test_row_ardupilot_only_heartbeats_of_sysid_mygcs_count():
    stage = Stage("ardupilot", parameters=(("FS_GCS_ENABLE", 1), ("SYSID_MYGCS", 254)))
    stage.station.upload(stage.mission(*leg(distance=600)))
    mine = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle), system=254)
    mine.read(0.1)
    stage.start()
    stage.station.run(60.0)
    assert stage.happened("failsafe link: rtl"), "the other station's heartbeat was there all the time"


@BOTH
def test_row_battery_actions_and_thresholds_are_parameters(autopilot):
    parameters = {
        "px4": (("COM_LOW_BAT_ACT", 3), ("BAT_CRIT_THR", 0.46), ("BAT_LOW_THR", 0.47), ("BAT_EMERGEN_THR", 0.1)),
        "ardupilot": (("BATT_LOW_MAH", 7000), ("BATT_FS_LOW_ACT", 2)),
    }[autopilot]
    stage = Stage(autopilot, soc=0.48, parameters=parameters)
    stage.station.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 4000), item(LAND, 4000)))
    stage.start()
    stage.rest()
    assert stage.happened(": rtl")
    assert away(stage) < 3.0


@BOTH
def test_row_rtl_height_is_a_parameter_and_a_return_below_it_climbs_first(autopilot):
    name, value = {"px4": ("RTL_RETURN_ALT", 70.0), "ardupilot": ("RTL_ALT", 7000.0)}[autopilot]
    stage = Stage(autopilot, parameters=((name, value),))
    stage.station.upload(stage.mission(item(TAKEOFF, z=30.0), item(WAYPOINT, 400, z=30.0), item(LAND, 400)))
    stage.start()
    stage.station.until(lambda: away(stage) > 200.0)
    assert stage.station.command(20) == 0
    stage.station.until(lambda: height(stage) > 69.0, 60.0)
    begun = away(stage)
    assert begun > 180.0, "up first, then home"
    stage.rest()
    assert away(stage) < 3.0


@BOTH
def test_row_a_fence_must_contain_the_divert_paths_too(autopilot):
    parameters = {
        "px4": (("GF_ACTION", 2),),
        "ardupilot": (("FENCE_ENABLE", 1), ("FENCE_TYPE", 4), ("FENCE_ACTION", 2)),
    }
    stage = Stage(autopilot, parameters=parameters[autopilot])
    corners = ((-50, -60), (-50, 60), (500, 60), (500, -60), (320, -60), (320, 20), (180, 20), (180, -60))
    assert stage.station.upload([item(5001, n, e, p=(8, 0, 0, 0)) for n, e in corners], kind=1) == 0
    stage.station.upload(
        stage.mission(item(TAKEOFF), item(WAYPOINT, 100, 0), item(WAYPOINT, 100, -40), item(LAND, 100, -40))
    )
    stage.start()
    stage.station.until(lambda: away(stage, 100, -40) < 5.0, 200.0)

    def divert(north, east):
        lat, lon = LAT + north / 111_045.0, LON + east / (111_045.0 * math.cos(math.radians(LAT)))
        return stage.station.command_int(192, (-1, 1, 0, NAN if autopilot == "px4" else 0), lat, lon, 45.0, 5)

    answer = divert(250, -30)
    stage.station.run(20.0)
    assert away(stage, 100, -40) < 15.0, "into what is cut out: it does not go"
    assert answer == {"px4": 0, "ardupilot": 4}[autopilot]
    assert ("Reposition is outside geofence" in stage.station.texts) is (autopilot == "px4")
    assert divert(400, -40) == 0, "beyond it, on a way that leads through"
    stage.station.until(lambda: stage.happened("failsafe fence"), 100.0)
    stage.station.run(20.0)
    assert away(stage, 400, -40) > 100.0, "it never gets there"


@pytest.mark.parametrize(("options", "lands_where_it_is"), [(0, False), (8, True)])
def test_row_ardupilot_goes_on_landing_when_the_link_is_lost_with_its_bit(options, lands_where_it_is):
    stage = Stage("ardupilot", parameters=(("FS_GCS_ENABLE", 1), ("FS_OPTIONS", options)))
    stage.station.upload(stage.mission(*leg(distance=300)))
    stage.start()
    stage.station.until(lambda: stage.pilot.landed_state == 4)
    stage.lockstep.run_for(300.0)
    assert not stage.pilot.armed
    assert (away(stage, 300) < 3.0) is lands_where_it_is


def test_row_ardupilot_a_second_station_with_our_id_keeps_the_failsafe_quiet():
    """The trap for whose sake it must be noticed and refused: the vehicle cannot tell them apart."""
    stage = Stage("ardupilot", parameters=(("FS_GCS_ENABLE", 1),))
    stage.station.upload(stage.mission(*leg(distance=600)))
    stage.start()
    twin = Station(stage.lockstep, stage.lockstep.connect(stage.vehicle))
    twin.run(60.0)  # ours is silent
    assert not stage.happened("failsafe link")
