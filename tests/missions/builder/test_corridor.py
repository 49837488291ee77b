"""The corridor: one simple polygon of few vertices, around the route and every way to a divert station."""

import math

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.missions.builder.corridor import corridor
from skyway.models.base.errors import InputError

ROUTE = [(40.70, -74.00), (40.72, -73.95), (40.74, -73.92)]
SCHOOL = (40.71, -73.90)


def polygon_of(fence):
    return shapely.Polygon([(vertex.lon, vertex.lat) for vertex in fence.vertices])


def disc(lat, lon, radius_m):
    """A circle, seen in longitude and latitude."""
    turns = [math.radians(10 * i) for i in range(36)]
    metre = 180 / math.pi / 6_371_008.8
    scale = metre / math.cos(math.radians(lat))
    return shapely.Polygon(
        [(lon + radius_m * scale * math.sin(t), lat + radius_m * metre * math.cos(t)) for t in turns]
    )


def test_the_corridor_is_as_wide_as_asked_all_along_the_route():
    area = polygon_of(corridor(ROUTE, width_m=400.0))
    line = shapely.LineString([(lon, lat) for lat, lon in ROUTE])
    for share in range(11):
        at = line.interpolate(share / 10, normalized=True)
        assert area.covers(disc(at.y, at.x, 199.0))
    assert not area.covers(disc(40.72, -73.95, 450.0))


def test_the_way_from_anywhere_on_the_route_to_its_divert_station_is_inside():
    fence = corridor(ROUTE, [(ROUTE, SCHOOL)], width_m=300.0)
    area = polygon_of(fence)
    line = shapely.LineString([(lon, lat) for lat, lon in ROUTE])
    for share in range(21):
        at = line.interpolate(share / 20, normalized=True)
        assert area.covers(shapely.LineString([at, (SCHOOL[1], SCHOOL[0])]))
    assert fence.inclusion


places = st.tuples(st.floats(-60, 60), st.floats(-170, 170))


@settings(max_examples=60)
@given(
    places,
    st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)), min_size=2, max_size=25),
    st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)), max_size=6),
    st.sampled_from([50.0, 400.0, 3000.0]),
)
def test_any_corridor_is_one_simple_polygon_that_both_autopilots_store(origin, steps, stations, width_m):
    route = [(origin[0] + a, origin[1] + b) for a, b in steps]
    diverts = [(route, (origin[0] + a, origin[1] + b)) for a, b in stations]
    fence = corridor(route, diverts, width_m=width_m)
    area = polygon_of(fence)
    assert area.is_valid
    assert 3 <= len(fence.vertices) <= 70
    assert area.covers(shapely.LineString([(lon, lat) for lat, lon in route]))
    for _, (lat, lon) in diverts:
        for way_lat, way_lon in route:
            assert area.covers(shapely.LineString([(way_lon, way_lat), (lon, lat)]))


def test_a_route_that_stays_in_place_has_a_corridor_too():
    assert len(corridor([(47.0, 8.0), (47.0, 8.0)]).vertices) >= 3


@pytest.mark.parametrize("width_m", [0.0, 5.0, float("nan"), 1e6])
def test_an_impossible_width_is_refused(width_m):
    with pytest.raises(InputError, match="is not between 20 and 100000 m"):
        corridor(ROUTE, width_m=width_m)


def test_a_fence_across_the_180th_meridian_is_refused():
    with pytest.raises(InputError, match="crosses the 180th meridian"):
        corridor([(0.0, 179.9), (0.0, -179.9)])
