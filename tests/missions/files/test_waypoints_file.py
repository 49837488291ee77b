"""QGC WPL 110 text: home in row 0 or not, jumps in the file's own numbers, fences among the items."""

import pytest

from skyway.missions.files import mission_file, waypoints_file
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.base.errors import InputError

HOME = "0 1 0 16 0 0 0 0 47.5 8.5 400 1"


def read(*rows):
    return waypoints_file.loads("\n".join(["QGC WPL 110", *rows]), "some.waypoints")


def test_row_0_of_a_ground_station_is_home_and_no_item():
    document = read(HOME, "1 0 3 22 0 0 0 0 0 0 20 1")
    assert document.mission.home == Home(Point.of_degrees(47.5, 8.5), 400.0)
    assert [item.command for item in document.mission.items] == [Command.NAV_TAKEOFF]


@pytest.mark.parametrize(
    "row", ["0 1 5 22 0 0 0 0 47.5 8.5 15 1", "0 1 3 84 0 0 0 Nan 47.5 8.5 15 1", "0 0 0 5001 3 0 0 0 1 1 0 0"]
)
def test_a_take_off_or_a_fence_point_in_row_0_is_the_first_item(row):
    rest = ("1 0 0 5001 3 0 0 0 1 2 0 0", "2 0 0 5001 3 0 0 0 2 2 0 0") if "5001" in row else ()
    document = read(row, *rest)
    assert document.mission.home is None
    assert len(document.mission.items) + len(document.fence.polygons) == 1


@pytest.mark.parametrize("frame", [2, 3, 6, 10])
def test_row_0_is_home_whatever_its_frame_and_only_a_height_above_the_sea_is_its_ground(frame):
    document = read(
        f"0 1 {frame} 16 0 0 0 0 47.5 8.5 15 1", "1 0 3 177 2 1 0 0 0 0 0 1", "2 0 3 16 0 0 0 0 47.6 8.5 20 1"
    )
    assert document.mission.home == Home(Point.of_degrees(47.5, 8.5), None)
    assert document.mission.items[0].jump_target == 1
    assert waypoints_file.loads(waypoints_file.dumps_mission(document)).mission == document.mission


def test_commas_part_cells_as_in_mission_planner():
    plain = read(HOME, "1 0 3 16 0 0 0 0 1 1 9 1")
    assert read(HOME.replace(" ", ","), "1,0,3,16,0,0,0,0, 1,1,9,1") == plain


@pytest.mark.parametrize("row", ["1 0 3 16 0 0 0 47.5 8.5 20 1", "1 0 3 16 0 0 0 0 0 47.5 8.5 20 1"])
def test_a_row_with_a_cell_too_few_or_too_many_is_refused_since_nobody_knows_which(row):
    with pytest.raises(InputError, match=r"some.waypoints:3: is not a row of 12 numbers"):
        read(HOME, row)


def test_a_fence_around_wherever_home_is_is_refused_and_not_flown_to():
    with pytest.raises(InputError, match=r"not supported: a fence circle around wherever home is"):
        read("0 0 0 5005 50 0 0 0 0 0 0 0")


def test_mission_planners_empty_home_is_an_unknown_home():
    assert read("0 1 0 0 0 0 0 0 0 0 0 1", "1 0 3 21 0 0 0 0 1 1 0 1").mission.home is None


def test_jumps_count_home_in_the_file_and_not_in_ours():
    document = read(HOME, "1 0 3 16 0 0 0 0 1 1 9 1", "2 0 3 16 0 0 0 0 1 2 9 1", "3 0 3 177 2 1 0 0 0 0 0 1")
    assert document.mission.items[2].jump_target == 1
    assert "\t177\t2.000000\t" in waypoints_file.dumps_mission(document)


def test_jumps_in_a_file_without_home_are_numbered_as_ours():
    document = read("0 1 3 22 0 0 0 0 1 1 9 1", "1 0 3 16 0 0 0 0 1 2 9 1", "2 0 2 177 1 1 0 0 0 0 0 1")
    assert document.mission.items[2].jump_target == 1


def test_fence_rows_between_items_do_not_shift_the_jumps():
    fence = ["2 0 0 5002 3 0 0 0 1 1 0 0", "3 0 0 5002 3 0 0 0 1 2 0 0", "4 0 0 5002 3 0 0 0 2 2 0 0"]
    document = read(HOME, "1 0 3 16 0 0 0 0 1 1 9 1", *fence, "5 0 3 16 0 0 0 0 3 3 9 1", "6 0 3 177 5 1 0 0 0 0 0 1")
    assert [item.command for item in document.mission.items] == [16, 16, 177]
    assert document.mission.items[2].jump_target == 1
    assert not document.fence.polygons[0].inclusion


def test_set_current_item_refers_to_a_row_too():
    document = read(HOME, "1 0 3 16 0 0 0 0 1 1 9 1", "2 0 2 224 1 0 0 0 0 0 0 1", "3 0 2 224 -1 0 0 0 0 0 0 1")
    assert [item.param1 for item in document.mission.items[1:]] == [0.0, -1.0]


def test_blanks_tabs_comments_byte_order_mark_and_line_ends_do_not_matter():
    plain = read(HOME, "1 0 3 16 0 0 0 0 1 1 9 1")
    dressed = (
        "\ufeffQGC WPL 110\r\n\r\n# home\r\n0\t1\t0\t16\t0\t0\t0\t0\t47.5 \t8.5\t400\t1\r\n#gate\r\n"
        "1 0  3\t16 0 0 0 0 1 1 9 1"
    )
    document = mission_file.loads(dressed.encode(), "dressed.waypoints")
    assert document == plain
    assert document.mission.items[0].extra["comment"] == "gate"


def test_missing_values_in_any_spelling_are_not_given():
    document = read(HOME, "1 0 3 21 0 0 0 Nan NaN nan 0 1")
    item = document.mission.items[0]
    assert (item.x, item.y, str(item.param4)) == (None, None, "nan")
    assert waypoints_file.loads(waypoints_file.dumps_mission(document)).mission == document.mission


def test_home_is_always_written_because_ground_stations_take_row_0_for_it():
    text = waypoints_file.dumps_mission(MissionDocument(Mission((MissionItem(22, 3, x=1, y=2, z=3.0),))))
    rows = text.splitlines()
    assert rows[0] == "QGC WPL 110"
    assert rows[1].split("\t")[:4] == ["0", "1", "0", "16"]
    assert rows[2].split("\t")[0] == "1"
    assert all(len(row.split("\t")) == 12 for row in rows[1:])


def test_version_120_has_no_home():
    document = waypoints_file.loads("QGC WPL 120\n0 1 0 16 0 0 0 0 1 1 9 1")
    assert document.mission.home is None
    assert len(document.mission.items) == 1


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["1 0 3 16 0 0 0 0 1 1 9"], "some.waypoints:2: is not a row of 12 numbers"),
        (["1 0 3 16 0 0 0 0 x 1 9 1"], "latitude: is not a number .got .x..; write 0 or NaN"),
        (["1 0 3 16 0 0 0 0 95 1 9 1"], "latitude is not between"),
        (["1 0 3 16 0 0 0 0 5 181 9 1"], "longitude is not between"),
        (["1 0 3 16.5 0 0 0 0 5 1 9 1"], "command: is not a whole number"),
        (["1 0 300 16 0 0 0 0 5 1 9 1"], "frame: is not from 0 to 255 .got .300"),
        (["0 0 0 0 0 0 0 0 95 1 9 1"], "home is not a place on Earth"),
        (["0 0 2 5100 0 0 0 0 95 1 9 1"], "is not a place on Earth"),
        (["1 0 3 16 0 0 inf 0 5 1 9 1"], "param3: is too large for a mission .got .inf"),
        (["1 0 3 16 0 0 0 0 5 1 null 1"], "altitude: is not a number .got .null"),
        (["1 0 3 16 0,0 0,0 0,0 0,0 5,0 1,0 9,0 1"], "is not a row of 12 numbers.*decimals with a point"),
        (["1 0 3 93 0 0 0 0 1e300 1 9 1"], "latitude: is too large"),
        (["0 0 0 5003 0 0 0 0 1 1 0 0"], "circle has no radius"),
        (["0 0 0 5001 2 0 0 0 1 1 0 0", "1 0 0 5001 2 0 0 0 1 2 0 0"], "fewer than 3 vertices"),
        (["1 0 3 16 0 0 0 0 1 1 9 1", "1 0 3 16 0 0 0 0 1 1 9 1", "3 0 3 177 1 1 0 0 0 0 0 1"], "ambiguous"),
    ],
)
def test_wrong_rows_are_refused_with_line_and_reason(rows, message):
    with pytest.raises(InputError, match=message):
        read(*rows)


@pytest.mark.parametrize(("header", "message"), [("QGC WPL 100", "not supported"), ("hello", "is not a waypoint file")])
def test_other_headers_are_refused(header, message):
    with pytest.raises(InputError, match=message):
        waypoints_file.loads(f"{header}\n{HOME}")


def test_a_fence_that_claims_a_vertex_too_many_is_marked():
    document = read(*(f"{i} 0 0 5001 4 0 0 0 {i} {i * i} 0 0" for i in range(3)))
    assert len(document.fence.polygons[0].vertices) == 3
    assert document.fence.polygons[0].extra == {"claimedVertexCount": 4.0}
