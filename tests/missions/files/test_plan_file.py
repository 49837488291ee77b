"""QGroundControl plans: read in all three generations, written with QGroundControl's keys, nothing lost."""

import json
from dataclasses import replace

import pytest

from skyway.missions.files import plan_reader, plan_writer
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import InputError


def item(**fields):
    return {
        "type": "SimpleItem",
        "command": 16,
        "frame": 3,
        "autoContinue": True,
        "doJumpId": 1,
        "params": [0, 0, 0, None, 47.5, 8.5, 50],
        **fields,
    }


def plan(*items, **mission):
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {"version": 2, "items": list(items), "plannedHomePosition": [47.5, 8.5, 400], **mission},
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
    }


def read(content):
    return plan_reader.loads(json.dumps(content), "some.plan")


def rewritten(document):
    return json.loads(plan_writer.dumps(document))


def test_null_yaw_is_left_open_and_stays_null():
    document = read(plan(item()))
    assert str(document.mission.items[0].param4) == "nan"
    assert rewritten(document)["mission"]["items"][0]["params"] == [0, 0, 0, None, 47.5, 8.5, 50]


def test_the_older_generations_of_items_mean_the_same():
    newest = read(plan(item()))
    older = item(params=[0, 0, 0, None], coordinate=[47.5, 8.5, 50])
    oldest = {key: value for key, value in older.items() if key != "params"}
    oldest |= {"type": "missionItem", "param1": 0, "param2": 0, "param3": 0, "param4": None}
    assert read(plan(older)) == newest
    assert read(plan(oldest)) == newest


def test_keys_that_we_do_not_know_are_kept():
    content = plan(item(MISSION_ITEM_ID="7"), weather="fair")
    content["pilot"] = {"name": "Ada"}
    content["geoFence"]["breachColour"] = "red"
    content["geoFence"]["polygons"] = [
        {"version": 1, "inclusion": True, "polygon": [[1, 1], [1, 2], [2, 2]], "label": "field"}
    ]
    content["geoFence"]["circles"] = [
        {"version": 1, "inclusion": False, "circle": {"center": [1, 1], "radius": 5, "height": 9}}
    ]
    written = rewritten(read(content))
    assert written["mission"]["items"][0]["MISSION_ITEM_ID"] == "7"
    assert written["mission"]["weather"] == "fair"
    assert written["pilot"] == {"name": "Ada"}
    assert written["geoFence"]["breachColour"] == "red"
    assert written["geoFence"]["polygons"][0]["label"] == "field"
    assert written["geoFence"]["circles"][0]["circle"]["height"] == 9


def test_what_we_write_has_every_key_that_qgroundcontrol_requires():
    home = Home(Point.of_degrees(47, 8), 400.0)
    document = MissionDocument(
        Mission((MissionItem(Command.NAV_LAND, Frame.GLOBAL_RELATIVE_ALT, x=1, y=2, z=0.0),), home),
        Geofence((FencePolygon((Point(0, 0), Point(0, 9), Point(9, 9))),), (FenceCircle(Point(1, 1), 50.0, False),)),
        RallyPoints((RallyPoint(Point(5, 5), 60.0),)),
    )
    written = rewritten(document)
    assert written["fileType"] == "Plan"
    assert (written["version"], written["mission"]["version"]) == (1, 2)
    assert (written["geoFence"]["version"], written["rallyPoints"]["version"]) == (2, 2)
    needed = {"cruiseSpeed", "hoverSpeed", "firmwareType", "vehicleType", "plannedHomePosition", "items"}
    assert needed <= set(written["mission"])
    assert set(written["mission"]["items"][0]) >= {"type", "command", "frame", "params", "autoContinue", "doJumpId"}
    assert written["mission"]["items"][0]["AltitudeMode"] == 1
    assert written["geoFence"]["circles"][0] == {
        "version": 1,
        "inclusion": False,
        "circle": {"center": [1e-7, 1e-7], "radius": 50},
    }
    assert written["rallyPoints"]["points"] == [[5e-7, 5e-7, 60]]


def test_an_unknown_home_is_filled_in_for_qgroundcontrol_and_still_unknown_to_us():
    document = MissionDocument(Mission((MissionItem(16, Frame.GLOBAL_RELATIVE_ALT, x=10, y=20, z=5.0),)))
    written = rewritten(document)
    assert len(written["mission"]["plannedHomePosition"]) == 3
    assert read(written) == document


def test_an_unknown_home_altitude_stays_unknown():
    content = plan(item(), plannedHomePosition=[47.5, 8.5, None])
    assert read(content).mission.home == Home(Point.of_degrees(47.5, 8.5), None)
    assert rewritten(read(content))["mission"]["plannedHomePosition"] == [47.5, 8.5, None]


def test_jumps_follow_their_ids_whatever_numbers_those_are():
    content = plan(
        item(doJumpId=100), item(doJumpId=200), item(command=177, frame=2, doJumpId=300, params=[200, 3, 0, 0, 0, 0, 0])
    )
    document = read(content)
    assert document.mission.items[2].jump_target == 1
    again = rewritten(document)["mission"]["items"]
    assert again[2]["params"][0] == again[1]["doJumpId"]


def test_an_item_that_says_its_place_twice_is_refused_as_in_qgroundcontrol():
    twice = item(params=[0, 0, 0, None, 47.5, 8.5, 0], coordinate=[47.6, 8.6, 120])
    with pytest.raises(InputError, match=r"items\[0\].coordinate: repeats.*QGroundControl refuses such a plan"):
        read(plan(twice))
    older = item(params=[0, 0, 0, None], coordinate=[47.6, 8.6, 120])
    assert read(plan(older)).mission.items[0].z == 120.0


def test_a_jump_that_leads_nowhere_is_kept_as_one():
    content = plan(item(), item(command=177, frame=2, doJumpId=2, params=[99, 1, 0, 0, 0, 0, 0]))
    document = read(content)
    assert document.mission.items[1].jump_target == 98
    assert read(rewritten(document)) == document


def test_an_ambiguous_jump_is_refused():
    jump = item(command=177, frame=2, doJumpId=9, params=[3, 1, 0, 0, 0, 0, 0])
    with pytest.raises(InputError, match="ambiguous: several items have doJumpId 3"):
        read(plan(item(doJumpId=3), item(doJumpId=3), jump))


def survey(*inner):
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "angle": 90,
        "TransectStyleComplexItem": {"version": 1, "Items": list(inner)},
    }


def test_a_survey_becomes_its_items_and_is_written_as_the_survey_it_was():
    document = read(plan(item(), survey(item(doJumpId=2), item(doJumpId=3)), item(doJumpId=4)))
    assert len(document.mission.items) == 4
    written = rewritten(document)["mission"]["items"]
    assert [entry["type"] for entry in written] == ["SimpleItem", "ComplexItem", "SimpleItem"]
    assert written[2]["doJumpId"] == 4


def test_a_survey_whose_items_were_changed_is_written_as_items():
    document = read(plan(survey(item(doJumpId=1), item(doJumpId=2))))
    higher = tuple(replace(entry, z=80.0) for entry in document.mission.items)
    changed = replace(document, mission=replace(document.mission, items=higher))
    assert [entry["type"] for entry in rewritten(changed)["mission"]["items"]] == ["SimpleItem"] * 2
    assert read(rewritten(changed)).mission.items == higher


def landing(**fields):
    return {
        "type": "ComplexItem",
        "complexItemType": "fwLandingPattern",
        "version": 2,
        "altitudesAreRelative": True,
        "landCoordinate": [47.51, 8.51, 0],
        "landingApproachCoordinate": [47.52, 8.52, 40],
        "loiterClockwise": False,
        "loiterRadius": 75,
        "useLoiterToAlt": True,
        "valueSetIsDistance": False,
        **fields,
    }


def test_a_landing_pattern_is_flown_as_qgroundcontrol_expands_it_and_kept_as_one():
    document = read(plan(item(), landing(stopTakingPhotos=True, stopVideoPhotos=True)))
    assert [i.command for i in document.mission.items] == [16, 189, 206, 2001, 2501, 31, 21]
    turn, land = document.mission.items[-2:]
    assert (turn.params, turn.point, turn.z) == ((1.0, -75.0, 0.0, 1.0), Point.of_degrees(47.52, 8.52), 40.0)
    assert (land.frame, land.point, land.z) == (Frame.GLOBAL_RELATIVE_ALT, Point.of_degrees(47.51, 8.51), 0.0)
    assert rewritten(document)["mission"]["items"][1] == landing(stopTakingPhotos=True, stopVideoPhotos=True)
    assert read(rewritten(document)) == document
    straight = read(plan(landing(useLoiterToAlt=False, complexItemType="vtolLandingPattern", version=1)))
    assert [i.command for i in straight.mission.items] == [189, 16, 85]


def test_a_landing_pattern_of_the_oldest_form_has_a_loiter_and_two_references():
    old = landing(
        version=1, loiterCoordinate=[47.52, 8.52, 500], loiterAltitudeRelative=False, landingAltitudeRelative=True
    )
    del old["landingApproachCoordinate"], old["altitudesAreRelative"], old["useLoiterToAlt"]
    items = read(plan(old)).mission.items
    assert [(i.command, i.frame) for i in items[1:]] == [(31, Frame.GLOBAL), (21, Frame.GLOBAL_RELATIVE_ALT)]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"version": 3}, "version: is a version of fwLandingPattern that skyway does not know"),
        ({"landCoordinate": None}, r"items\[0\].landCoordinate: is not a list"),
        ({"landCoordinate": [95, 8, 0]}, "latitude is not between -90 and 90"),
        ({"landingApproachCoordinate": [47.5, 8.5]}, r"is not \[latitude, longitude, altitude\]"),
        ({"loiterRadius": None}, "loiterRadius: is missing: a number is needed"),
        ({"loiterClockwise": 1}, "loiterClockwise: is neither true nor false"),
        ({"altitudesAreRelative": None}, "altitudesAreRelative: is neither true nor false"),
        ({"useDoChangeSpeed": True}, "finalApproachSpeed: is missing: a number is needed"),
        ({"useDoChangeSpeed": True, "finalApproachSpeed": 0}, "finalApproachSpeed: is not above 0"),
        ({"useDoChangeSpeed": 1, "finalApproachSpeed": 9}, "useDoChangeSpeed: is neither true nor false"),
    ],
)
def test_a_landing_pattern_that_cannot_be_flown_as_it_is_is_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        read(plan(landing(**wrong)))


def test_a_landing_pattern_that_orders_a_speed_flies_the_approach_at_it():
    pattern = landing(useDoChangeSpeed=True, finalApproachSpeed=14, stopTakingPhotos=True)
    document = read(plan(pattern))
    assert [i.command for i in document.mission.items] == [189, 178, 206, 2001, 31, 21]
    speed = document.mission.items[1]
    assert (speed.frame, speed.params) == (Frame.MISSION, (0.0, 14.0, -1.0, 0.0))
    assert rewritten(document)["mission"]["items"] == [pattern]
    assert read(plan(landing(useDoChangeSpeed=False, finalApproachSpeed=14))) == read(plan(landing()))


@pytest.mark.parametrize("kind", ["survey", "CorridorScan", "orchard"])
def test_a_pattern_without_its_items_is_not_supported_and_named(kind):
    pattern = {"type": "ComplexItem", "complexItemType": kind, "version": 2 if kind == "CorridorScan" else 4}
    with pytest.raises(InputError, match=rf"not supported: {kind} \(item 1\)"):
        read(plan(item(), pattern))


@pytest.mark.parametrize(
    ("kind", "version", "style"), [("survey", 9, 2), ("survey", None, 1), ("CorridorScan", 3, 1), ("survey", 5, 7)]
)
def test_a_pattern_of_a_version_that_qgroundcontrol_refuses_is_refused(kind, version, style):
    pattern = {"type": "ComplexItem", "complexItemType": kind, "version": version}
    pattern["TransectStyleComplexItem"] = {"version": style, "Items": [item()]}
    with pytest.raises(InputError, match=r"items\[1\].*version: is a version of .* that skyway does not know"):
        read(plan(item(), pattern))
    pattern |= {"version": {"survey": 5, "CorridorScan": 2}[kind]}
    pattern["TransectStyleComplexItem"]["version"] = 1
    assert len(read(plan(item(), pattern)).mission) == 2


def test_the_oldest_files_name_the_autopilot_by_another_key():
    old = {"version": "1.0", "groundStation": "QGroundControl", "MAV_AUTOPILOT": 3, "complexItems": [], "items": []}
    assert read(old).mission.firmware == 3
    assert not read(old).mission.extra


@pytest.mark.parametrize("home", [[None, None, None], [None, None], [0, 0, 0], None])
def test_a_home_that_says_nothing_is_unknown(home):
    content = plan(plannedHomePosition=home)
    content["geoFence"]["circles"] = [{"version": 1, "inclusion": True, "circle": {"center": [1, 1], "radius": 5}}]
    document = read(content)
    assert document.mission.home is None
    assert read(rewritten(document)) == document


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (plan(item(), version=7), r"mission.version: is an unknown mission version \(got '7'\)"),
        ({**plan(item()), "version": 3}, "an unknown plan version"),
        ({**plan(item()), "fileType": "Parameters"}, "is not a mission plan"),
        ({"fileType": "Plan", "version": 1, "geoFence": {"version": 2}}, "mission: is not a mission plan: it has no"),
        ([], "is not an object"),
        (
            {"schema": "skyway.composition/1"},
            "is a composition, not a mission .*; make missions of it with skyway mission",
        ),
        (plan(item(params=[0, 0, 0])), "does not have 7 parameters"),
        (plan(item(params=[0, 0, 0, 0, 91, 8, 5])), "latitude is not between -90 and 90"),
        (plan(item(params=["0", 0, 0, 0, 1, 8, 5])), r"items\[0\].params: is not a number"),
        (plan(item(command=70000)), "is not a whole number from 0 to 65535"),
        (plan({"type": "SimpleItem", "frame": 3}), r"items\[0\].command: is missing"),
        (plan(item(), plannedHomePosition=[1]), r"is not \[latitude, longitude\]"),
        ({**plan(item()), "geoFence": {"version": 9}}, "an unknown fence version"),
        (
            {**plan(item()), "geoFence": {"version": 2, "polygons": [{"inclusion": True, "polygon": [[1, 1]]}]}},
            "fewer than 3 vertices",
        ),
        (
            {**plan(item()), "geoFence": {"version": 2, "circles": [{"circle": {"center": [1, 1], "radius": 0}}]}},
            "radius: is not a positive length",
        ),
        ({**plan(item()), "rallyPoints": {"version": 2, "points": [[200, 0, 0]]}}, "latitude is not between"),
    ],
)
def test_wrong_plans_are_refused_with_the_field_and_what_is_wrong(content, message):
    with pytest.raises(InputError, match=message) as caught:
        read(content)
    assert "\n" not in str(caught.value.faults[0])
    assert "some.plan" in str(caught.value)


def test_every_wrong_item_is_reported_at_once():
    with pytest.raises(InputError) as caught:
        read(plan(item(command=-1), item(), item(frame="x")))
    assert len(caught.value.faults) == 2


def test_deeply_nested_json_is_refused():
    with pytest.raises(InputError, match="is not JSON"):
        plan_reader.loads("[" * 100_000, "deep.plan")


def test_an_altitude_above_terrain_keeps_both_of_its_heights():
    above = {"AltitudeMode": 3, "Altitude": 40, "AMSLAltAboveTerrain": 512.5}
    document = read(plan(item(frame=0, params=[0, 0, 0, None, 47, 8, 512.5], **above)))
    written = rewritten(document)["mission"]["items"][0]
    assert above.items() <= written.items()


def test_a_shown_altitude_never_disagrees_with_the_flown_one():
    document = read(plan(item(AltitudeMode=1, Altitude=50, AMSLAltAboveTerrain=50)))
    moved = replace(document.mission.items[0], z=90.0)
    written = rewritten(replace(document, mission=replace(document.mission, items=(moved,))))
    entry = written["mission"]["items"][0]
    assert (entry["Altitude"], entry["params"][6], entry["AMSLAltAboveTerrain"]) == (90, 90, None)


def test_fence_points_among_the_items_go_to_the_fence_and_jumps_keep_their_aim():
    corner = {"command": 5001, "frame": 0}
    corners = [item(doJumpId=i, params=[3, 0, 0, 0, i, i * i, 0], **corner) for i in (1, 2, 3)]
    jump = item(command=177, frame=2, doJumpId=5, params=[4, 1, 0, 0, 0, 0, 0])
    document = read(plan(*corners, item(doJumpId=4), jump))
    assert len(document.fence.polygons[0].vertices) == 3
    assert [entry.command for entry in document.mission.items] == [16, 177]
    assert document.mission.items[1].jump_target == 0
