"""What was sent against what was read back: rewriting is ignored, a changed flight never."""

import math
from dataclasses import replace

import pytest

from skyway.missions import diff, family_named
from skyway.missions.autopilots.wire import fence_from_wire, fence_to_wire
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import InputError

SENT = Mission(
    (
        MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, param4=math.nan, x=470000000, y=80000000, z=60.0),
        MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 14.2, -1.0),
        MissionItem(
            Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, 5.0, 0.0, 0.0, math.nan, 470100001, 80100001, 61.234
        ),
        MissionItem(Command.DO_JUMP, Frame.MISSION, 2.0, 3.0),
        MissionItem(Command.NAV_LAND, Frame.GLOBAL_RELATIVE_ALT, param4=math.nan, x=470200000, y=80200000, z=2.0),
        MissionItem(Command.DO_GRIPPER, Frame.MISSION, 1.0, 0.0),
    )
)


def with_item(mission, number, **changes):
    items = list(mission.items)
    items[number] = replace(items[number], **changes)
    return Mission(tuple(items))


def as_px4_gives_it_back(mission):
    """As seen in flight: NaN to 0, frames 3 to 6 and 0 to 5, LAND's first parameter changed, 32-bit floats."""
    frames = {Frame.GLOBAL_RELATIVE_ALT: 6, Frame.GLOBAL: 5}
    items = []
    for item in mission.items:
        params = {f"param{i}": 0.0 if math.isnan(v) else v for i, v in enumerate(item.params, 1)}
        if item.command == Command.NAV_LAND:
            params["param1"] = 25.0
        z = round(item.z * 2**16) / 2**16
        items.append(replace(item, **params, frame=Frame(frames.get(item.frame, item.frame)), z=z))
    return Mission(tuple(items))


def as_ardupilot_gives_it_back(mission):
    """As seen in flight: frames 6 to 3, WAYPOINT p2 to p4 0, NaN to 0, LAND p4 1, centimetres, whole p1."""
    items = []
    for item in mission.items:
        params = {f"param{i}": 0.0 if math.isnan(v) else v for i, v in enumerate(item.params, 1)}
        if item.command == Command.NAV_WAYPOINT:
            params = {"param1": float(int(item.param1)), "param2": 0.0, "param3": 0.0, "param4": 0.0}
        if item.command == Command.NAV_LAND:
            params["param4"] = 1.0
        frame = Frame.GLOBAL_RELATIVE_ALT if item.is_located else Frame.GLOBAL
        items.append(replace(item, **params, frame=frame, z=int(item.z * 100) / 100, autocontinue=True))
    return Mission(tuple(items))


@pytest.mark.parametrize(
    ("autopilot", "give_back"), [("px4", as_px4_gives_it_back), ("ardupilot", as_ardupilot_gives_it_back)]
)
def test_what_an_autopilot_is_known_to_rewrite_is_no_difference(autopilot, give_back):
    assert diff(SENT, give_back(SENT), autopilot) == ()
    again = give_back(give_back(SENT))
    assert diff(give_back(SENT), again, autopilot) == ()


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("number", "changes", "field"),
    [
        (0, {"z": 30.0}, "z"),
        (0, {"frame": Frame.GLOBAL}, "altitude reference"),
        (1, {"param2": 12.0}, "param2"),
        (2, {"x": 470100100}, "x"),
        (2, {"y": 80100101}, "y"),
        (2, {"param1": 50.0}, "param1"),
        (2, {"z": 61.5}, "z"),
        (3, {"param1": 1.0}, "param1"),
        (3, {"param2": -1.0}, "param2"),
        (4, {"command": Command.NAV_WAYPOINT}, "command"),
        (5, {"param2": 1.0}, "param2"),
    ],
)
def test_whatever_changes_the_flight_is_told_by_item_and_field(autopilot, number, changes, field):
    differences = diff(SENT, with_item(SENT, number, **changes), autopilot)
    assert [(d.item, d.field) for d in differences] == [(number, field)]
    name = {"x": "latitude", "y": "longitude"}.get(field, field)
    assert str(differences[0]).startswith(f"item {number} {name}: sent ")
    if field == "x":
        assert str(differences[0]).endswith(" read back 47.0100100")


def test_the_frame_of_an_item_without_a_place_does_not_matter():
    speed_in_any_frame = with_item(SENT, 1, frame=Frame.GLOBAL_RELATIVE_ALT)
    start = MissionItem(Command.DO_LAND_START, Frame.GLOBAL_RELATIVE_ALT)
    for autopilot in ("px4", "ardupilot"):
        assert diff(speed_in_any_frame, SENT, autopilot) == ()
        own = family_named(autopilot)
        assert diff(Mission((start,)), own.from_wire(own.to_wire(Mission((start,)))), autopilot) == ()


def test_a_yaw_matters_to_px4_and_is_not_kept_by_ardupilot():
    east = with_item(SENT, 2, param4=90.0)
    assert [d.field for d in diff(east, SENT, "px4")] == ["param4"]
    assert diff(east, with_item(SENT, 2, param4=0.0), "ardupilot") == ()


def test_stopping_after_an_item_matters_to_px4_only():
    stop = with_item(SENT, 2, autocontinue=False)
    assert [d.field for d in diff(stop, SENT, "px4")] == ["autocontinue"]
    assert diff(stop, SENT, "ardupilot") == ()


def test_a_shorter_mission_read_back_is_told_with_the_missing_items():
    differences = diff(SENT, Mission(SENT.items[:4]), "px4")
    assert [(d.item, d.field) for d in differences] == [(None, "count"), (4, "command"), (5, "command")]
    assert str(differences[0]) == "count: sent 6, read back 4"


def test_a_mix_of_old_and_new_items_is_told():
    old = Mission(tuple(with_item(SENT, 2, x=470300000).items[:3]) + SENT.items[3:])
    assert diff(SENT, old, "ardupilot")


def test_fences_and_rally_points_are_compared_too():
    ring = (Point(0, 0), Point(0, 90), Point(90, 90))
    fence = Geofence((FencePolygon(ring),), (FenceCircle(Point(5, 5), 30.0),))
    moved = Geofence((FencePolygon((*ring[:2], Point(90, 99))),), fence.circles)
    assert diff(fence, fence, "px4") == ()
    assert [d.field for d in diff(fence, moved, "px4")] == ["vertices"]
    assert [d.field for d in diff(fence, Geofence((FencePolygon(ring, False),), fence.circles), "px4")] == ["inclusion"]
    assert [d.field for d in diff(fence, Geofence(fence.polygons), "px4")] == ["count", "area"]
    wider = Geofence(fence.polygons, (FenceCircle(Point(5, 5), 31.0),))
    assert [d.field for d in diff(fence, wider, "ardupilot")] == ["radius_m"]
    rally = RallyPoints((RallyPoint(Point(5, 5), 60.0),))
    assert diff(rally, RallyPoints((RallyPoint(Point(5, 6), 60.004),)), "px4") == ()
    assert [d.field for d in diff(rally, RallyPoints((RallyPoint(Point(9, 5), 50.0),)), "px4")] == [
        "point",
        "altitude_m",
    ]
    assert [d.field for d in diff(rally, RallyPoints(), "px4")] == ["count"]


def test_comparing_different_kinds_or_for_an_unknown_autopilot_is_a_mistake():
    with pytest.raises(TypeError, match="cannot compare Mission with Geofence"):
        diff(SENT, Geofence(), "px4")
    with pytest.raises(InputError, match="px4 or ardupilot"):
        diff(SENT, SENT, "inav")


def test_a_fence_whose_vertex_counts_disagree_is_not_what_was_sent():
    ring = (Point(0, 0), Point(0, 90), Point(90, 90))
    wire = fence_to_wire(Geofence((FencePolygon(ring),)))
    damaged = fence_from_wire([replace(item, param1=4.0) for item in wire])
    assert [d.field for d in diff(Geofence((FencePolygon(ring),)), damaged, "px4")] == ["vertex count"]
