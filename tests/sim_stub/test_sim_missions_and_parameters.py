"""Mission and parameter protocols of the simulated vehicle."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from sim_station import LAT, LON, NAN, TAKEOFF, WAYPOINT, Stage, item, leg

from skyway.sim_stub.autopilot.modes import Mode

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


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
