"""Files of vans: where each stands from when until when, and everything that can be wrong with them."""

import json

import pytest

from skyway.models.base.errors import InputError
from skyway.models.base.units import parse_instant
from skyway.models.network.van_stands import read_van_stands

HEADER = "van,lat,lon,elevation_m,from,until,pads\n"
DEPART_S = parse_instant("2026-08-05T14:00+02:00").timestamp()


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_stands_are_read_and_numbered_in_order_of_time(tmp_path):
    text = HEADER + "b,47.5,8.5,,2026-08-05T14:30+02:00,2026-08-05T12:50Z,2\nb,47.4,8.5,410,0:05,0:20:30,\n"
    first, second = read_van_stands(written(tmp_path / "vans.csv", text), DEPART_S)
    assert (first.station.id, first.from_s, first.until_s, first.station.pads) == ("b-1", 300.0, 1230.0, 1)
    assert (second.station.id, second.from_s, second.until_s, second.station.pads) == ("b-2", 1800.0, 3000.0, 2)
    assert (first.station.elevation_m, second.station.elevation_m) == (410.0, None)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("a,47,8,,0:30,0:10,\n", ":2: until: is not later than from"),
        ("a,47,8,,0:00,0:30,\na,47.1,8,,0:20,0:50,\n", ":3: from: van a still stands elsewhere"),
        ("a,47,8,,0:00,0:30,\na,48,8,,0:31,0:50,\n", "cannot drive 111.2 km in 1 min"),
        ("a,97,8,,0:00,0:30,\n", "lat: out of range"),
        ("a,47,8,,2026-08-05T14:00+02:00,0:30,\n", "give --depart"),
        ("a,47,8,,5,0:30,\n", "hours and minutes after the first take-off"),
        ("a,47,8,,0:00,0:30,0\n", "pads: out of range"),
        (",47,8,,0:00,0:30,\n", "van: is missing"),
        ("", "has a header but no rows"),
    ],
)
def test_a_fault_names_its_line_and_remedy(tmp_path, rows, said):
    with pytest.raises(InputError) as caught:
        read_van_stands(written(tmp_path / "vans.csv", HEADER + rows))
    assert said in str(caught.value)
    assert "vans.csv" in str(caught.value)


def road(times, **properties):
    line = {"type": "LineString", "coordinates": [[8.5, 47.4], [8.51, 47.4], [8.52, 47.4]]}
    feature = {"type": "Feature", "geometry": line, "properties": {"van": "v", "times": times} | properties}
    return json.dumps({"type": "FeatureCollection", "features": [feature]})


def test_on_a_road_a_van_stands_until_it_must_drive_on(tmp_path):
    path = written(tmp_path / "road.geojson", road(["0:00", "0:10", "0:20"], until="0:40", speed_mps=10))
    stands = read_van_stands(path)
    assert [stand.from_s for stand in stands] == [0.0, 600.0, 1200.0]
    # 755 m at 10 m/s
    assert [stand.until_s for stand in stands] == pytest.approx([600.0 - 76.0, 1200.0 - 76.0, 2400.0], abs=1.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (road(["0:00", "0:10"], until="0:40"), "times: must be a list as long as the line"),
        (road(["0:00", "0:01", "0:20"], until="0:40"), "until: is not later than from"),
        (road(["0:00", "0:10", "0:20"]), "until: is missing"),
        (road(["0:00", "0:10", "0:20"], until="0:40", speed_mps=0), "speed_mps: out of range"),
        ("{}", "is not GeoJSON"),
    ],
)
def test_a_road_that_cannot_be_driven_is_refused(tmp_path, text, said):
    with pytest.raises(InputError) as caught:
        read_van_stands(written(tmp_path / "road.geojson", text))
    assert said in str(caught.value)
