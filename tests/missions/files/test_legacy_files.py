"""Old fences and rally points of MAVProxy."""

import pytest

from skyway.missions.files import mission_file
from skyway.missions.items.coordinates import Point
from skyway.models.base.errors import InputError


def read(text):
    return mission_file.loads(text.encode(), "old.txt")


def test_the_first_line_of_an_old_fence_is_its_return_point_and_the_ring_is_closed():
    fence = read("-35.36\t149.16\n1.0 1.0\n1.0 2.0\n2.0 2.0\n1.0 1.0\n").fence
    assert fence.return_point == Point.of_degrees(-35.36, 149.16)
    assert [vertex.lat for vertex in fence.polygons[0].vertices] == [1.0, 1.0, 2.0]
    assert fence.polygons[0].inclusion


def test_rally_lines_keep_what_we_do_not_use():
    rally = read("RALLY -35.363160\t149.164101\t60.000000\t40.000000\t0.000000\t0").rally
    assert rally.points[0].point == Point(-353631600, 1491641010)
    assert rally.points[0].altitude_m == 60.0
    assert rally.points[0].extra["breakAltitude"] == 40.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.0 2.0\n3.0\n", "old.txt:2: is not a line of latitude and longitude"),
        ("1.0 2.0\n1 1\n2 2\n", "is not a fence"),
        ("1.0 2.0\n1 1\n2 2\n95 1\n", "is not a latitude and a longitude"),
        ("RALLY 1 2 3\n", "is not a rally line"),
        ("RALLY 1 2 3 4 5 x\n", "is not a line of numbers"),
        ("RALLY 1 200 3 4 5 6\n", "is not a latitude and a longitude"),
        ("RALLY 1 2 nan 4 5 6\n", "number out of range"),
        ("hello\n", "is not a known mission format"),
        ("", "is not a known mission format"),
        ('<?xml version="1.0"?><kml/>', "is XML .*save it as .plan or .waypoints"),
        ("latitude,longitude,altitude(m)\n47,8,50\n", "is a table .*save it as .plan or .waypoints"),
        ("0 1 0 16 0 0 0 0 47 8 400 1\n", "is a waypoint file without its first line.*QGC WPL 110"),
        (
            "QGC WPL 110\n1 0 3 16 0 0 0 0 149.2 -35.4 60 1\n",
            "latitude is not between.*are latitude and longitude exchanged",
        ),
    ],
)
def test_wrong_lines_are_refused_with_line_and_reason(text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_bytes_that_are_no_text_are_refused():
    with pytest.raises(InputError, match="is not UTF-8 text"):
        mission_file.loads(b"\xff\xfe\x00", "x")
    with pytest.raises(InputError, match=r"x: is a ZIP or KMZ archive, not a mission file; .*\.plan or \.waypoints"):
        mission_file.loads(b"PK\x03\x04\x14\x00", "x")
