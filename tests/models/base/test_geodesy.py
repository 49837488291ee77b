"""Geodesics agree with Karney's own library to a millimetre and a billionth of a degree."""

import math
from itertools import pairwise

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import assume, given
from hypothesis import strategies as st

from skyway.models.base import geodesy

LAT = st.floats(-89.9, 89.9)
LON = st.floats(-180.0, 180.0)
KARNEY = Geodesic.WGS84


def apart_deg(a: float, b: float) -> float:
    return abs((a - b + 180.0) % 360.0 - 180.0)


@given(LAT, LON, st.floats(0.0, 360.0), st.floats(1.0, 1.5e6))
def test_distances_over_chords_are_karneys_to_some_millionths(lat, lon, bearing, length_m):
    there = KARNEY.Direct(lat, lon, bearing, length_m)
    points = geodesy.earth_xyz(np.array([(lat, lon), (there["lat2"], there["lon2"])]))
    within = 4e-6 if length_m <= 5e5 else 4e-5
    assert geodesy.spatial_distance_m(points[0], points[1]) == pytest.approx(length_m, rel=within, abs=1e-6)


@given(LAT, LON, LAT, LON)
def test_any_distance_is_karneys_to_a_millimetre(lat1, lon1, lat2, lon2):
    truth = KARNEY.Inverse(lat1, lon1, lat2, lon2)
    assert geodesy.distance_m(lat1, lon1, lat2, lon2) == pytest.approx(truth["s12"], abs=1e-3)


@given(LAT, LON, st.floats(0.0, 360.0), st.floats(100.0, 100_000.0))
def test_the_bearing_of_a_flight_is_karneys_to_a_billionth_of_a_degree(lat, lon, bearing, length):
    end = KARNEY.Direct(lat, lon, bearing, length)
    truth = KARNEY.Inverse(lat, lon, end["lat2"], end["lon2"])["azi1"]
    found = geodesy.bearing_deg(lat, lon, end["lat2"], end["lon2"])
    assert 0.0 <= found < 360.0
    assert apart_deg(found, truth) < 1e-9


@given(LAT, LON, st.floats(0.0, 360.0), st.floats(0.0, 1_000_000.0))
def test_flying_on_a_bearing_ends_where_karney_says(lat, lon, bearing, length):
    end = KARNEY.Direct(lat, lon, bearing, length)
    assume(abs(end["lat2"]) < 89.9)
    lat2, lon2 = geodesy.direct(lat, lon, bearing, length)
    assert abs(lat2 - end["lat2"]) < 1e-8
    assert apart_deg(lon2, end["lon2"]) < 1e-8 / math.cos(math.radians(lat2))


@given(LAT, LON, st.floats(0.0, 360.0), st.floats(1.0, 100_000.0))
def test_the_middle_of_a_segment_is_half_way(lat, lon, bearing, length):
    middle = geodesy.midpoint(lat, lon, bearing, length)
    truth = KARNEY.Direct(lat, lon, bearing, length / 2.0)
    gap = KARNEY.Inverse(float(middle[0]), float(middle[1]), truth["lat2"], truth["lon2"])["s12"]
    assert gap < 1e-3


def test_points_along_a_geodesic_divide_it_evenly():
    begin, end = (40.6413, -73.7781), (41.0340, -73.7629)
    points = [begin, *geodesy.along(*begin, *end, 4), end]
    steps = [geodesy.distance_m(*a, *b) for a, b in pairwise(points)]
    assert steps == pytest.approx([geodesy.distance_m(*begin, *end) / 5.0] * 5, abs=1e-3)
    assert geodesy.along(*begin, *end, 0) == []


def test_bearings_are_those_of_the_compass():
    assert geodesy.bearing_deg(40.0, -74.0, 41.0, -74.0) == 0.0
    assert geodesy.bearing_deg(0.0, 0.0, 0.0, 1.0) == 90.0
    assert geodesy.bearing_deg(41.0, -74.0, 40.0, -74.0) == 180.0
    assert geodesy.bearing_deg(0.0, 1.0, 0.0, 0.0) == 270.0


def test_many_geodesics_are_those_one_by_one_and_keep_their_shape():
    lat, lon = np.array([[40.0, 41.0, 40.5]]), np.array([[-74.0], [-73.5]])
    distance, bearing = geodesy.inverse(lat, lon, 40.7, -73.9)
    assert distance.shape == bearing.shape == (2, 3)
    assert distance[1, 2] == geodesy.distance_m(40.5, -73.5, 40.7, -73.9)
    assert bearing[1, 2] == geodesy.bearing_deg(40.5, -73.5, 40.7, -73.9)


def test_no_geodesics_are_no_geodesics():
    distance, bearing = geodesy.inverse([], [], [], [])
    assert distance.shape == bearing.shape == (0,)


def test_a_place_is_at_no_distance_from_itself():
    assert geodesy.distance_m(40.7, -74.0, 40.7, -74.0) == 0.0


@given(st.floats(-70.0, 70.0), LON, st.floats(0.0, 360.0), st.floats(1.0, 100_000.0))
def test_offsets_from_an_origin_have_its_distance_and_bearing(lat, lon, bearing, length):
    end = KARNEY.Direct(lat, lon, bearing, length)
    north, east = geodesy.local_offsets_m(end["lat2"], end["lon2"], lat, lon)
    assert math.hypot(float(north), float(east)) == pytest.approx(length, abs=1e-3)
    assert apart_deg(math.degrees(math.atan2(float(east), float(north))), bearing) * length < 1.0e-3 * 57.3


@given(LAT, LON, st.floats(0.0, 360.0), st.floats(1.0, 10_000_000.0))
def test_no_point_within_a_distance_is_left_out(lat, lon, bearing, length):
    end = KARNEY.Direct(lat, lon, bearing, length)
    assert geodesy.perhaps_within(lat, lon, end["lat2"], end["lon2"], length)
    assert not geodesy.perhaps_within(lat, lon, end["lat2"], end["lon2"], length / 1.03)
