"""Long legs are split so that straight flight stays on the geodesic."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.missions.items.course import pieces, split_count
from skyway.models.base import geodesy


def rhumb_midpoint(lat1, lon1, lat2, lon2):
    """Middle of the rhumb line on a sphere, close enough for short pieces."""
    across = (lon2 - lon1 + 180) % 360 - 180
    lat = (lat1 + lat2) / 2
    if abs(lat2 - lat1) < 1e-9:
        return lat, lon1 + across / 2
    stretch = [math.asinh(math.tan(math.radians(v))) for v in (lat1, lat, lat2)]
    return lat, lon1 + across * (stretch[1] - stretch[0]) / (stretch[2] - stretch[0])


def largest_offset_m(lat1, lon1, lat2, lon2):
    points = [(lat1, lon1), *((lat, lon) for lat, lon, _ in pieces(lat1, lon1, lat2, lon2))]
    worst = 0.0
    for (a, b), (c, d) in pairwise(points):
        true = geodesy.along(a, b, c, d, 1)[0]
        across = (d - b + 180) % 360 - 180
        for lat, lon in (rhumb_midpoint(a, b, c, d), ((a + c) / 2, b + across / 2)):
            worst = max(worst, geodesy.distance_m(*true, lat, (lon + 180) % 360 - 180))
    return worst


@pytest.mark.parametrize("lat", [0.0, 40.7, 60.0, 75.0])
@pytest.mark.parametrize("length_km", [1, 10, 32, 100])
def test_a_leg_east_is_followed_within_10_metres(lat, length_km):
    end = geodesy.direct(lat, 8.0, 90.0, 1000.0 * length_km)
    assert largest_offset_m(lat, 8.0, *end) <= 10.0


@settings(max_examples=60)
@given(st.floats(-70, 70), st.floats(-180, 180), st.floats(0, 360), st.floats(10.0, 200_000.0))
def test_any_leg_is_followed_within_10_metres(lat, lon, bearing, length_m):
    end = geodesy.direct(lat, lon, bearing, length_m)
    assert largest_offset_m(lat, lon, *end) <= 10.0


def test_short_legs_are_not_split():
    assert split_count(40.7, -74.0, 40.75, -73.95) == 1
    assert split_count(40.7, -74.0, 40.7, -74.0) == 1


def test_pieces_are_even_and_end_at_the_end():
    ends = list(pieces(60.0, 8.0, 60.0, 10.0))
    assert ends[-1] == (60.0, 10.0, 1.0)
    assert [fraction for *_, fraction in ends] == pytest.approx([(i + 1) / len(ends) for i in range(len(ends))])
