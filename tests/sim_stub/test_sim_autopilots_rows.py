"""Every row of design/autopilots.md, shown by the simulated vehicle; each test names its row."""

import math
import statistics

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import (
    DELAY,
    DISARM,
    JUMP,
    LAND,
    LAT,
    LON,
    NAN,
    SPEED,
    TAKEOFF,
    WAYPOINT,
    Stage,
    Station,
    item,
    leg,
    plain,
)

from skyway.models.network.network import Station as Place
from skyway.sim_stub.autopilot.modes import Mode
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.physics import offset_m
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.channel import Impairment

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
GUIDED_RETURN = {"px4": "NAV_DLL_ACT", "ardupilot": "FS_GCS_ENABLE"}


def away(stage, north_m=0.0, east_m=0.0):
    """Metres of the vehicle from a point given from the start."""
    north, east = offset_m(LAT, LON, stage.vehicle.body.lat, stage.vehicle.body.lon)
    return math.hypot(north - north_m, east - east_m)


def height(stage):
    return stage.vehicle.body.alt_m - 5.0


# Mission protocol


def test_row_ardupilot_asks_with_mission_request_and_takes_item_int():
    stage = Stage("ardupilot")
    assert stage.station.upload(stage.mission(*leg())) == 0
    kinds = {m.get_type() for m in stage.station.seen if m.get_type().startswith("MISSION_REQUEST")}
    assert kinds == {"MISSION_REQUEST"}


def test_row_px4_asks_first_with_request_int_and_after_silence_with_request():
    stage = Stage("px4")
    s = stage.station
    s.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    asked = [m.get_type() for m in s.run(0.6) if m.get_type().startswith("MISSION_REQUEST")]
    assert asked == ["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_REQUEST_INT"]
    for seq, it in enumerate(leg()):
        s.send(s.item_message(seq, it))
    assert s.wait("MISSION_ACK").type == 0, "an INT item answers both"


@pytest.mark.parametrize(("autopilot", "interval_s", "patience_s"), [("px4", 0.25, 5.0), ("ardupilot", 1.0, 8.0)])
def test_row_timeouts_the_server_repeats_its_request_and_gives_up_at_last(autopilot, interval_s, patience_s):
    stage = Stage(autopilot)
    s = stage.station
    s.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    found = s.run(patience_s + 2.0)
    asked = [m for m in found if m.get_type().startswith("MISSION_REQUEST")]
    assert len(asked) == pytest.approx(patience_s / interval_s, abs=2)
    acks = [m.type for m in found if m.get_type() == "MISSION_ACK"]
    if autopilot == "px4":
        assert acks == []
        assert "Operation timeout" in s.texts
    else:
        assert acks == [15]
        assert "Mission upload timeout" in s.texts


def test_row_a_blind_restart_meets_a_server_still_in_its_own_transaction():
    px4 = Stage("px4").station
    px4.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    px4.wait("MISSION_REQUEST_INT", seq=0)
    px4.send(px4.item_message(0, leg()[0]))
    px4.wait("MISSION_REQUEST_INT", seq=1)
    px4.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    assert px4.wait("MISSION_ACK").type == 1
    other = Stage("ardupilot")
    s = other.station
    s.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    s.wait("MISSION_REQUEST")
    s.send(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    assert s.wait("MISSION_ACK").type == 14, "read back too early"


def test_row_ardupilot_uploads_are_not_atomic_px4_uploads_are():
    good = (item(TAKEOFF), item(WAYPOINT, 100), item(WAYPOINT, 200), item(LAND, 200))
    bad = (item(TAKEOFF, z=77.0), item(WAYPOINT, 900), plain(65000), item(LAND, 900))
    for autopilot, north in (("px4", 100), ("ardupilot", 900)):
        stage = Stage(autopilot)
        s = stage.station
        assert s.upload(stage.mission(*good)) == 0
        assert s.upload(stage.mission(*bad)) == 3
        items = s.download()
        second = items[2 if autopilot == "ardupilot" else 1]
        assert second.x == pytest.approx(item(WAYPOINT, north)[6], abs=1)
        last = items[-1]
        assert last.x == pytest.approx(item(LAND, 200)[6], abs=1), "and the rest is still the old mission"


def test_row_ardupilot_a_timed_out_upload_leaves_a_mix_and_the_new_waypoints_are_flown():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(item(TAKEOFF), item(WAYPOINT, 50), item(WAYPOINT, 0), item(LAND, 0)))
    new = stage.mission(item(TAKEOFF), item(WAYPOINT, -150), item(WAYPOINT, 100), item(LAND, 100))
    s.send(dialect.MAVLink_mission_count_message(1, 1, len(new), 0))
    for seq in range(3):
        s.wait("MISSION_REQUEST", seq=seq)
        s.send(s.item_message(seq, new[seq]))
    assert s.wait("MISSION_ACK", 12.0).type == 15
    stage.start()
    s.until(lambda: away(stage, -150) < 3.0, 200.0)


def test_row_ardupilot_item_0_is_home_so_without_a_placeholder_the_first_item_is_lost():
    stage = Stage("ardupilot")
    s = stage.station
    assert s.upload(list(leg())) == 0
    home, *rest = s.download()
    assert (home.command, home.frame, home.z) == (WAYPOINT, 0, 5.0)
    assert [m.command for m in rest] == [WAYPOINT, LAND], "the take-off is gone"


def test_row_ardupilot_sequence_and_jump_targets_count_home():
    stage = Stage("ardupilot")
    s = stage.station
    items = stage.mission(item(TAKEOFF), item(WAYPOINT, 60), item(WAYPOINT, 0), plain(JUMP, 2, 1), item(LAND, 0))
    assert s.upload(items) == 0
    stage.start()
    stage.rest()
    assert stage.events.count("item 2 reached") == 2
    assert s.upload([*items[:4], plain(JUMP, 0, 1), items[5]]) == 1, "a jump to home is refused"


def test_row_ardupilot_what_a_download_rewrites_and_the_second_round_trip_is_stable():
    stage = Stage("ardupilot")
    s = stage.station
    sent = stage.mission(
        item(TAKEOFF, frame=6, z=40.129, p=(7.9, 0, 0, NAN)),
        item(WAYPOINT, 100, frame=6, z=50.129, p=(3.7, 5, 6, 45)),
        item(WAYPOINT, 200, frame=5, z=55.5, p=(0, 0, 0, NAN)),
        item(LAND, 200, z=0.0),
    )
    assert s.upload(sent) == 0
    first = s.download()
    take_off, near, far, land = first[1:]
    assert (take_off.frame, take_off.param1) == (3, 7.0)
    assert (near.frame, near.param1, near.param2, near.param3, near.param4) == (3, 3.0, 0, 0, 0)
    assert near.z == pytest.approx(50.12)
    assert (far.frame, far.param4) == (0, 0)
    assert land.param4 == 1
    again = [(m.frame, m.command, m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z) for m in first]
    assert s.upload(again) == 0
    assert [m.to_dict() for m in s.download()] == [m.to_dict() for m in first]


def test_row_px4_what_a_download_rewrites():
    stage = Stage("px4")
    s = stage.station
    sent = (
        item(TAKEOFF),
        item(WAYPOINT, 100, p=(3.5, 5, 6, NAN)),
        item(WAYPOINT, 150, frame=0, z=60.0),
        item(LAND, 200, z=0.0, p=(25, 0, 0, NAN)),
    )
    assert s.upload(sent) == 0
    take_off, near, far, land = s.download()
    assert [m.current for m in (take_off, near, far, land)] == [1, 0, 0, 0]
    assert (take_off.frame, near.frame, far.frame) == (6, 6, 5)
    assert (near.param1, near.param2, near.param3, near.param4) == (3.5, 5.0, 0.0, 0.0)
    assert land.param1 == 0.0


def test_row_px4_acks_carry_the_mission_id_as_opaque_id():
    stage = Stage("px4")
    s = stage.station
    frames = []
    original = stage.vehicle.radio.ports[0].send
    stage.vehicle.radio.ports[0].send = lambda data: (frames.append(data), original(data))[1]
    assert s.upload(leg()) == 0
    ack = next(f for f in frames if f[7] == 47)
    opaque = int.from_bytes(ack[14:18], "little")
    assert opaque == stage.vehicle.mission_ids[0] != 0


def test_row_ardupilot_clear_all_types_is_unsupported_and_a_clear_in_auto_refused():
    stage = Stage("ardupilot")
    s = stage.station
    s.upload(stage.mission(*leg()))
    s.send(dialect.MAVLink_mission_clear_all_message(1, 1, 255))
    assert s.wait("MISSION_ACK").type == 3
    stage.start()
    s.run(20.0)
    s.send(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
    assert s.wait("MISSION_ACK").type != 0
    assert len(stage.pilot.run.items) == 4
    px4 = Stage("px4").station
    px4.upload(leg())
    px4.send(dialect.MAVLink_mission_clear_all_message(1, 1, 255))
    assert px4.wait("MISSION_ACK").type == 0


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_row_ardupilot_refuses_nan_but_in_the_yaw_of_waypoint_land_and_take_off(number):
    stage = Stage("ardupilot")
    p = [0.0, 0.0, 0.0, 0.0]
    p[number - 1] = NAN
    assert stage.station.upload(stage.mission(item(19, 10, p=p))) == 5 + number
    expected = 0 if number == 4 else 5 + number
    assert stage.station.upload(stage.mission(item(WAYPOINT, 10, p=p))) == expected


def test_row_px4_delay_and_change_speed_need_the_frame_mission():
    stage = Stage("px4")
    for command in (DELAY, SPEED):
        assert stage.station.upload([plain(command, 1, 5, frame=3)]) == 3
        assert stage.station.upload([plain(command, 1, 5, frame=2)]) == 0


def test_row_px4_a_fence_whose_vertex_counts_disagree_is_acked_and_invalid_afterwards():
    stage = Stage("px4")
    square = [(-50, -50), (-50, 50), (50, 50), (50, -50)]
    good = [item(5001, n, e, p=(4, 0, 0, 0)) for n, e in square]
    bad = [item(5001, n, e, p=(4 if k else 3, 0, 0, 0)) for k, (n, e) in enumerate(square)]
    assert stage.station.upload(good, kind=1) == 0
    assert stage.pilot.fence.areas
    assert stage.station.upload(bad, kind=1) == 0
    assert not stage.pilot.fence.areas
    stage.station.run(1.0)
    assert any("consistent" in text for text in stage.station.texts)


def test_row_px4_accepted_does_not_mean_flyable():
    stage = Stage("px4")
    s = stage.station
    assert s.upload((item(WAYPOINT, 100), item(TAKEOFF), item(LAND, 100))) == 0
    assert s.wait("MISSION_CURRENT", 3.0).mission_state == 1
    assert s.command(400, 1) == 0
    assert s.command(300) == 2
    assert s.upload(leg()) == 0
    assert s.wait("MISSION_CURRENT", 3.0).mission_state == 2


@pytest.mark.parametrize(("loss", "low_s", "high_s"), [(0.0, 0.3, 1.2), (0.05, 0.9, 5.0), (0.2, 3.0, 12.0)])
def test_row_lossy_links_a_careful_client_answering_every_request(loss, low_s, high_s):
    """20 items, 20 ms each way: 2.7 s at 5 % and 5.9 s at 20 % were seen."""
    times = []
    for seed in range(12):
        stage = Stage("px4", impairment=Impairment(loss=loss, delay_s=0.02), seed=seed)
        items = [item(TAKEOFF), *(item(WAYPOINT, 10 * k) for k in range(18)), item(LAND, 0)]
        start = stage.lockstep.now_s
        stage.station.upload(items, seconds=60.0)
        times.append(stage.lockstep.now_s - start)
    assert low_s < statistics.mean(times) < high_s


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
