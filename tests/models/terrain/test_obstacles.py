"""Obstacles from CSV and GeoJSON: heights, units, places, and what is wrong with them."""

import json

import numpy as np
import pytest

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.terrain.obstacles import read_obstacles


def feature(geometry, **properties):
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def geojson(path, *features):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
    return path


@pytest.mark.parametrize(
    ("text", "agl_m", "amsl_m"),
    [
        ("name,lat,lon,height_m\nmast,40.7,-74.0,120\n", 120.0, np.nan),
        ("name,lat,lon,height_ft\nmast,40.7,-74.0,400\n", 121.92, np.nan),
        ("id,latitude,longitude,top_m\n1,40.7,-74.0,300\n", np.nan, 300.0),
        ("lat,lon,height\n40.7,-74.0,400 ft\n", 121.92, np.nan),
        ("OAS,COUNTRY,LATDEC,LONDEC,TYPE,AGL,AMSL\n36-1,US,40.7,-74.0,TOWER,400,1000\n", 121.92, 304.8),
    ],
)
def test_a_height_says_its_unit_and_from_where_it_counts(tmp_path, text, agl_m, amsl_m):
    (tmp_path / "o.csv").write_text(text)
    found = read_obstacles(tmp_path / "o.csv")
    assert (found.agl_m[0], found.amsl_m[0]) == pytest.approx((agl_m, amsl_m), nan_ok=True)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lat,lon,height_m\n40.7,-74.0,\n", "o.csv:2: has no height"),
        ("lat,lon,height\n40.7,-74.0,120\n", "o.csv:2: height: has no unit"),
        ("lat,lon,height_m\n40.7,-74.0,1300\n", "is it in feet, or above sea level"),
        ("lat,lon,height_m\n-74.0,140.7,50\n40.7,x,50\n", "has no place"),
        ("lat,lon,height_m\n140.7,-74.0,50\n", "lat and lon may be swapped"),
        ("a,b,height_m\n40.7,-74.0,50\n", "no such column"),
        ("lat,lon,height_m,radius_m\n40.7,-74.0,50,99999\n", "is not a radius"),
    ],
)
def test_what_is_wrong_with_an_obstacle_is_said_with_its_line(tmp_path, text, expected):
    (tmp_path / "o.csv").write_text(text)
    with pytest.raises(InputError, match=expected):
        read_obstacles(tmp_path / "o.csv")


def test_a_line_reaches_from_end_to_end_and_an_area_all_over(tmp_path):
    line = {"type": "LineString", "coordinates": [[-74.0, 40.7], [-74.0, 40.71]]}
    area = {
        "type": "Polygon",
        "coordinates": [[[-74.1, 40.7], [-74.1, 40.702], [-74.098, 40.702], [-74.098, 40.7], [-74.1, 40.7]]],
    }
    found = read_obstacles(
        geojson(tmp_path / "o.geojson", feature(line, name="wire", height_m=40), feature(area, top_m=90))
    )
    wire = np.array([name == "wire" for name in found.names])
    steps, _ = geodesy.inverse(found.lat[wire][:-1], found.lon[wire][:-1], found.lat[wire][1:], found.lon[wire][1:])
    assert steps.max() <= 20.5
    assert steps.sum() == pytest.approx(1110.5, abs=1.0)
    middle = geodesy.coarse_distance_m(40.701, -74.099, found.lat[~wire], found.lon[~wire])
    assert middle.min() < 20.0
    with pytest.raises(InputError, match=r"features\[0\]: has no height"):
        read_obstacles(geojson(tmp_path / "p.geojson", feature(line)))
    with pytest.raises(InputError, match="has no geometry"):
        read_obstacles(geojson(tmp_path / "q.geojson", feature({"type": "Point"}, height_m=4)))


def test_the_highest_within_a_radius_counts_the_reach_of_the_obstacle(tmp_path):
    (tmp_path / "o.csv").write_text("name,lat,lon,top_m,radius_m\nlow,40.7,-74.0,100,0\ncrane,40.7036,-74.0,150,300\n")
    found = read_obstacles(tmp_path / "o.csv")
    lat, lon = np.array([40.7, 40.69]), np.array([-74.0, -74.0])
    near = found.within(lat, lon, 100.0)
    top, which = found.highest(near, lat, lon, 150.0, np.array([100.0, 150.0]))
    assert (top[0], found.names[which[0]]) == (150.0, "crane")  # 400 m away, and reaches 300 m
    assert np.isnan(top[1])
    assert which[1] == -1
