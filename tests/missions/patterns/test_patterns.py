"""Patterns whose files hold no items: built as QGroundControl builds them, or refused with what is missing."""

import itertools
import json
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon

from skyway.missions import check
from skyway.missions.files import mission_file, plan_reader, plan_writer
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError

HERE = (46.9, 7.4)


PLANES_DIFFER_M = 0.05
"""A place 600 m away lies so differently, at most, in the plane around HERE and in that around a pattern's first vertex."""


def away(east, north):
    """Return the place so far from HERE as a plan file writes it."""
    return list(geodesy.direct(*HERE, math.degrees(math.atan2(east, north)), math.hypot(east, north)))


def metres(item):
    north, east = geodesy.local_offsets_m(item.param5, item.param6, *HERE)
    return float(east), float(north)


def square(side=200.0):
    """Clockwise from the south-west."""
    return [away(0, 0), away(0, side), away(side, side), away(side, 0)]


def style(**fields):
    camera = {"AdjustedFootprintSide": 45, "AdjustedFootprintFrontal": 40, "DistanceToSurface": 60, "DistanceMode": 1}
    return {
        "version": 2,
        "CameraCalc": camera | {"version": 2} | fields.pop("camera", {}),
        "TurnAroundDistance": 0,
        "CameraTriggerInTurnAround": False,
        "HoverAndCapture": False,
        "Refly90Degrees": False,
        "CameraShots": 0,
        "VisualTransectPoints": [],
        "Items": [],
        **fields,
    }


def survey(inner=None, **fields):
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "angle": 0,
        "entryLocation": 0,
        "flyAlternateTransects": False,
        "splitConcavePolygons": False,
        "polygon": square(),
        "TransectStyleComplexItem": style() if inner is None else inner,
        **fields,
    }


def old_survey(**fields):
    """Return a survey of version 3; `grid_` names a setting of its grid."""
    grid = {"altitude": 60, "angle": 0, "relativeAltitude": True, "spacing": 45, "turnAroundDistance": 0}
    grid |= {key[5:]: fields.pop(key) for key in list(fields) if key.startswith("grid_")}
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 3,
        "cameraTriggerDistance": 40,
        "cameraTriggerInTurnaround": False,
        "fixedValueIsAltitude": True,
        "manualGrid": True,
        "grid": grid,
        "polygon": square(),
        **fields,
    }


def corridor(**fields):
    return {
        "type": "ComplexItem",
        "complexItemType": "CorridorScan",
        "version": 2,
        "CorridorWidth": 90,
        "EntryPoint": 0,
        "polyline": [away(0, 0), away(0, 300), away(200, 300)],
        "TransectStyleComplexItem": style(),
        **fields,
    }


def structure(**fields):
    camera = {"AdjustedFootprintSide": 8, "AdjustedFootprintFrontal": 10, "DistanceToSurface": 15, "version": 2}
    return {
        "type": "ComplexItem",
        "complexItemType": "StructureScan",
        "version": 3,
        "CameraCalc": camera,
        "EntranceAltitude": 70,
        "GimbalPitch": -10,
        "Layers": 3,
        "ScanBottomAlt": 20,
        "StartFromTop": False,
        "StructureHeight": 45,
        "polygon": square(40.0),
        **fields,
    }


def items_of(*raw):
    text = json.dumps({"fileType": "Plan", "version": 1, "mission": {"version": 2, "items": list(raw)}})
    return plan_reader.loads(text, "some.plan").mission.items


def flown(items):
    return [metres(item) for item in items if item.command == Command.NAV_WAYPOINT]


def test_a_survey_of_qgroundcontrol_is_built_as_it_built_it(shared_data):
    plan = json.loads((shared_data / "missions" / "mavlink__qgroundcontrol_sample_with_survey.plan").read_text())
    raw = next(item for item in plan["mission"]["items"] if item["type"] == "ComplexItem")
    held = items_of(raw)
    built = items_of(raw | {"TransectStyleComplexItem": raw["TransectStyleComplexItem"] | {"Items": []}})
    assert [(i.command, i.frame, i.z) for i in built] == [(i.command, i.frame, i.z) for i in held]
    for ours, theirs in zip(built, held, strict=True):
        if ours.command == Command.NAV_WAYPOINT:
            assert geodesy.distance_m(ours.param5, ours.param6, theirs.param5, theirs.param6) < 0.1


@pytest.mark.parametrize("raw", [survey(entryLocation=1), old_survey(), old_survey(version=2)])
def test_a_survey_without_items_flies_lines_up_and_down_with_pictures_between_their_ends(raw):
    items = items_of(raw)
    lines = [items[i : i + 4] for i in range(0, len(items), 4)]
    assert len(lines) == 4  # 200 m wide, 45 m apart
    for number, (begin, on, end, off) in enumerate(lines):
        assert (on.command, on.param1, off.command, off.param1) == (206, 40.0, 206, 0.0)
        (x1, y1), (x2, y2) = metres(begin), metres(end)
        assert x1 == pytest.approx(x2, abs=0.05)
        assert abs(y2 - y1) == pytest.approx(200.0, abs=0.05)
        assert (y2 < y1) is (number % 2 == 0)
        assert (begin.frame, begin.z, math.isnan(begin.param4)) == (Frame.GLOBAL_RELATIVE_ALT, 60.0, True)
    easts = [metres(line[0])[0] for line in lines]
    assert easts == sorted(easts, reverse=True)  # entered at the right
    assert [a - b for a, b in itertools.pairwise(easts)] == pytest.approx([45.0] * 3, abs=0.05)


def test_pictures_in_turns_and_hovering_for_each_are_ordered_as_qgroundcontrol_orders_them():
    through = items_of(old_survey(cameraTriggerInTurnaround=True, grid_turnAroundDistance=15))
    commands = [(i.command, i.param1) for i in through if i.command != Command.NAV_WAYPOINT]
    assert commands == [(206, 40.0), *[(206, 40.0)] * 4, (206, 0.0)]
    assert flown(through)[0][1] == pytest.approx(215.0, abs=0.05)
    hovering = items_of(old_survey(hoverAndCapture=True, cameraTriggerDistance=45))
    stops = [i for i in hovering if i.command == Command.NAV_WAYPOINT]
    assert {i.param1 for i in stops} == {4.0}
    assert len(stops) == 4 * (2 + 200 // 45)
    assert [i.command for i in hovering[1::2]] == [Command.IMAGE_START_CAPTURE] * len(stops)
    without = items_of(old_survey(cameraTriggerDistance=0))
    assert {i.command for i in without} == {Command.NAV_WAYPOINT}


@given(
    st.lists(st.tuples(st.floats(10, 300), st.floats(0, 1)), min_size=3, max_size=9),
    st.floats(-180, 180),
    st.floats(15, 60),
    st.integers(0, 3),
    st.booleans(),
)
@example([(275.0, 0.3125), (214.0, 0.25), (10.0, 0.0)], 1.0, 15.0, 0, False)
@example([(274.0, 0.3125), (213.0, 0.25), (10.0, 0.0)], 0.0, 15.0, 0, False)
def test_transects_are_parallel_evenly_spaced_end_on_the_edge_and_leave_nothing_out(
    corners, angle, spacing, entry, alternate
):
    around = [(radius, 2 * math.pi * (n + 0.8 * turn) / len(corners)) for n, (radius, turn) in enumerate(corners)]
    shape = [(radius * math.sin(a), radius * math.cos(a)) for radius, a in around]
    area = Polygon(shape)
    settings = style(camera={"AdjustedFootprintSide": spacing, "AdjustedFootprintFrontal": 0})
    raw = survey(
        settings, polygon=[away(*c) for c in shape], angle=angle, entryLocation=entry, flyAlternateTransects=alternate
    )
    places = flown(items_of(raw))
    lines = [LineString(places[i : i + 2]) for i in range(0, len(places), 2)]
    heading = math.radians(angle)
    across = []
    for line in lines:
        (x1, y1), (x2, y2) = line.coords
        assert abs((x2 - x1) * math.cos(heading) - (y2 - y1) * math.sin(heading)) < PLANES_DIFFER_M
        across.append(x1 * math.cos(heading) - y1 * math.sin(heading))
        assert max(area.exterior.distance(Point(end)) for end in line.coords) < 0.1
    apart = sorted(across)
    assert all(b - a == pytest.approx(spacing, abs=PLANES_DIFFER_M) for a, b in itertools.pairwise(apart))
    along, beside = (math.sin(heading), math.cos(heading)), (math.cos(heading), -math.sin(heading))
    for line, offset in zip(lines, across, strict=True):
        ends = [[offset * b + sign * 1000 * a for a, b in zip(along, beside, strict=True)] for sign in (-1, 1)]
        # a line so far aside may end much sooner at a steep edge
        inside = LineString(ends).intersection(area.buffer(-PLANES_DIFFER_M))
        assert inside.difference(line.buffer(0.2)).is_empty
    sides = [x * beside[0] + y * beside[1] for x, y in shape]
    if len(lines) > 1:
        assert apart[0] - spacing < min(sides) + 0.1
        assert apart[-1] + spacing > max(sides) - 0.1


def test_a_survey_flown_again_at_a_right_angle_crosses_itself():
    once, twice = items_of(survey()), items_of(survey(style(Refly90Degrees=True)))
    assert twice[: len(once)] == once
    again = flown(twice[len(once) :])
    assert len(again) == 8
    assert all(abs(a[1] - b[1]) < 0.1 for a, b in zip(again[::2], again[1::2], strict=True))


@pytest.mark.parametrize("entry", [0, 1, 2, 3])
def test_a_corridor_is_flown_beside_its_line_from_each_of_its_ends(entry):
    items = items_of(corridor(EntryPoint=entry))
    line = LineString([(0, 0), (0, 300), (200, 300)])
    places = flown(items)
    assert len(places) == 6  # two lines of three points
    for one in (places[:3], places[3:]):
        assert all(line.distance(Point(place)) == pytest.approx(22.5, abs=0.05) for place in (one[0], one[2]))
        assert abs(line.hausdorff_distance(LineString(one)) - 22.5 * math.sqrt(2)) < 0.1
    assert (math.hypot(*places[0]) < 30.0) is (entry < 2)
    left = places[0][0] < 0 if entry < 2 else places[0][1] > 300
    assert left is (entry in (0, 2))
    assert len(flown(items_of(corridor(CorridorWidth=40)))) == 3


@pytest.mark.parametrize("polygon", [square(40.0), square(40.0)[::-1]])
@pytest.mark.parametrize("from_top", [False, True])
def test_a_structure_scan_flies_closed_rings_outside_the_structure_layer_over_layer(polygon, from_top):
    items = items_of(structure(polygon=polygon, StartFromTop=from_top))
    assert len(items) == 4 + 3 * (4 + 1 + 2)
    door, aim, *rings, free, leave = items
    assert (aim.command, aim.param5, aim.z, free.command) == (196, -10.0, 90.0, 197)
    assert door == leave
    assert door.z == 70.0
    building = Polygon([(0, 0), (0, 40), (40, 40), (40, 0)])
    for layer in range(3):
        first, on, *others, off = rings[7 * layer : 7 * layer + 7]
        assert (on.command, on.param1, on.param3, off.command, off.param1) == (206, 8.0, 1.0, 206, 0.0)
        ring = LineString([metres(first), *map(metres, others)])
        assert ring.is_ring
        assert Polygon(ring).contains(building)
        assert ring.distance(building) == pytest.approx(15.0, abs=0.02)
        assert {item.z for item in (first, *others)} == {40.0 - 10 * layer if from_top else 25.0 + 10 * layer}


@pytest.mark.parametrize("raw", [survey(), old_survey(), corridor(), structure()])
def test_a_built_pattern_is_checked_kept_in_a_plan_and_flown_from_waypoints(raw, tmp_path):
    plan = {"fileType": "Plan", "version": 1, "mission": {"version": 2, "items": [raw]}}
    (tmp_path / "a.plan").write_text(json.dumps(plan))
    document = mission_file.read(tmp_path / "a.plan")
    written = json.loads(plan_writer.dumps(document))
    assert written["mission"]["items"] == [raw]
    assert mission_file.loads(plan_writer.dumps(document).encode()) == document
    mission_file.write(document, tmp_path / "a.waypoints")
    assert mission_file.read(tmp_path / "a.waypoints").mission.items == document.mission.items
    report = check(document)
    assert sum(leg.distance_m for leg in report.legs) > 400.0
    built = [f for f in report.findings if f.code == "pattern-built"]
    assert [(f.severity, f.item) for f in built] == [("info", 0)]


CAMERA = {
    "focalLength": 20,
    "sensorWidth": 20,
    "resolutionWidth": 5000,
    "resolutionHeight": 2500,
    "orientationLandscape": True,
    "imageSideOverlap": 50,
    "imageFrontalOverlap": 20,
}
"""At 100 m it sees 100 x 50 m: lines 50 m apart, a picture every 40 m."""


def test_a_camera_that_agrees_with_the_grid_is_flown_and_another_is_refused():
    told = {"manualGrid": False, "grid_altitude": 100, "grid_spacing": 50, "camera": CAMERA}
    assert next(i.z for i in items_of(old_survey(**told))) == 100.0
    typo = {key.replace("imageSide", "imageSize"): value for key, value in CAMERA.items()}
    assert items_of(old_survey(**told | {"camera": typo})) == items_of(old_survey(**told))
    with pytest.raises(InputError, match=r"items\[0\].grid.spacing: contradicts the camera.*50.*25 m at this height"):
        items_of(old_survey(**told | {"camera": CAMERA | {"orientationLandscape": False}}))


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (survey({}), "not supported: survey .item 0. without the items it expands to"),
        (survey(version=9), "is a version of survey that skyway does not know"),
        (survey(style(FollowTerrain=True)), "above terrain without the items.*it knows the terrain"),
        (survey(style(camera={"DistanceMode": 3})), "above terrain without the items.*it knows the terrain"),
        (survey(style(camera={"DistanceMode": 2, "CameraName": "Sony a6000"})), "above sea level with a camera"),
        (survey(style(camera={"DistanceMode": 7})), "DistanceMode: is an unknown altitude mode"),
        (survey(style(camera={"AdjustedFootprintSide": None})), "AdjustedFootprintSide: is missing: a number"),
        (survey(style(camera={"DistanceToSurface": "50"})), "DistanceToSurface: is not a number"),
        (survey(style(camera={"AdjustedFootprintSide": -5})), "AdjustedFootprintSide: is below 0"),
        (survey(style(HoverAndCapture=1)), "HoverAndCapture: is neither true nor false"),
        (survey(style(camera={"AdjustedFootprintFrontal": 1e-6}, HoverAndCapture=True)), "more than 20000 items"),
        (survey(polygon=[[0, 0], [0, 60], [60, 60]]), "more than 20000 items.*area smaller"),
        (survey(polygon=[[47, 8], [47, 9]]), "polygon: does not have 3 to 20000 points"),
        (survey(polygon=[[47, 8]] * 4), "polygon: is not a polygon: no line crosses it"),
        (survey(polygon=[[47, 8], [97, 8], [47, 9]]), r"polygon\[1\]: latitude is not between"),
        (old_survey(grid_relativeAltitude=False), "survey of version 3 above sea level"),
        (old_survey(grid=None), r"items\[0\].grid: is not an object"),
        (corridor(version=1), "not supported: CorridorScan .item 0. without the items"),
        (corridor(polyline=[away(0, 0)] * 2), "polyline: has a point twice in a row"),
        (structure(version=2), "is a version of StructureScan that skyway does not know.*known: 3"),
        (structure(Layers=5), "Layers: is not the number of layers.*got '5.0'.*its heights make 3"),
        (structure(polygon=[away(0, 0), away(0, 0), away(0, 9), away(9, 9)]), "polygon: has a point twice"),
        (structure(CameraCalc={"AdjustedFootprintFrontal": 0}), "AdjustedFootprintFrontal: is not above 0"),
        (structure(StructureHeight=1e9, Layers=99999998), "more than 20000 items"),
    ],
)
def test_a_pattern_that_cannot_be_built_is_refused_with_the_setting_that_is_wrong(raw, message):
    with pytest.raises(InputError, match=message):
        items_of(raw)
