"""Rows of design/autopilots.md on the mission protocol, shown by the simulated vehicle; each test names its row."""

import statistics

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import DELAY, JUMP, LAND, NAN, SPEED, TAKEOFF, WAYPOINT, Stage, away, item, leg, plain

from skyway.sim_stub.transports.channel import Impairment

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
