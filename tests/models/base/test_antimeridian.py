"""Lines across the antimeridian are cut as RFC 7946 asks for, and maps are centred on what they show."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from skyway.missions.examples import NEW_YORK
from skyway.models.base.geodesy import about, line_geometry, middle_longitude, wrapped
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.ensemble import WindEnsemble
from skyway.plots.wind_summary import over_region

LON = st.floats(-180.0, 180.0)
LAT = st.floats(-80.0, 80.0)
NEAR = st.tuples(LAT, st.floats(-20.0, 20.0))


def test_the_example_of_rfc_7946_is_cut_as_it_stands_there():
    line = line_geometry([(45.0, 170.0), (45.0, -170.0)])
    assert line == {
        "type": "MultiLineString",
        "coordinates": [[[170.0, 45.0], [180.0, 45.0]], [[-180.0, 45.0], [-170.0, 45.0]]],
    }


def test_a_line_that_stays_on_one_side_is_one_line():
    assert line_geometry([(1.0, 2.0), (3.0, 4.0)]) == {"type": "LineString", "coordinates": [[2.0, 1.0], [4.0, 3.0]]}


@given(places=st.lists(NEAR, min_size=2, max_size=8), centre=LON)
def test_no_part_is_longer_than_the_way_and_together_they_are_the_line(places, centre):
    """The oracle is shapely: the parts, moved together again, are the uncut line about any centre."""
    turned = [(lat, wrapped(centre + east)) for lat, east in places]
    geometry = line_geometry(turned)
    parts = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
    for part in parts:
        lon = [position[0] for position in part]
        assert all(-180.0 <= value <= 180.0 for value in lon)
        assert max(abs(b - a) for a, b in itertools.pairwise(lon)) <= 180.0
    pieces = [shapely.LineString([(about(x, centre), y) for x, y in _inward(part)]) for part in parts]
    whole = shapely.LineString([(about(lon, centre), lat) for lat, lon in turned])
    assert math.isclose(sum(piece.length for piece in pieces), whole.length, rel_tol=1e-6, abs_tol=1e-6)
    assert whole.hausdorff_distance(shapely.MultiLineString(pieces)) < 1e-6


def _inward(part):
    """A position on the antimeridian belongs to the side of its part."""
    side = math.copysign(1.0, next((x for x, _ in part if abs(x) < 180.0), part[0][0]))
    return [(x if abs(x) < 180.0 else side * (180.0 - 1e-12), y) for x, y in part]


@given(offsets=st.lists(st.floats(-80.0, 80.0), min_size=1, max_size=10), centre=LON)
def test_the_middle_holds_all_within_half_the_widest_arc(offsets, centre):
    lon = [wrapped(centre + east) for east in offsets]
    middle = middle_longitude(lon)
    assert -180.0 <= middle <= 180.0
    span = max(offsets) - min(offsets)
    assert np.abs(about(lon, middle) - middle).max() <= span / 2.0 + 1e-6


@pytest.mark.parametrize(
    ("lon", "middle"), [([179.0, -179.0], 180.0), ([10.0, 20.0], 15.0), ([], 0.0), ([-180.0, 180.0], 180.0)]
)
def test_middles_known_beforehand(lon, middle):
    assert abs(abs(middle_longitude(lon)) - abs(middle)) < 1e-9


def test_the_wind_of_a_region_across_the_antimeridian_is_that_of_its_middle():
    """Stations at 179.9 and -179.9: the mean of the numbers is Greenwich, and the wind was taken half a world away."""
    stations = [Station(f"s{k}", f"S{k}", -17.0, lon, 5.0, 2, 2) for k, lon in enumerate((179.95, -179.95))]
    network = build_network(stations, ConnectionRule("max-length", 20_000.0))
    fiji = dataclasses.replace(read_scenario(NEW_YORK), network=network)
    wind = WindEnsemble(
        site_lat=np.array([-17.0, -17.0]), site_lon=np.array([-179.99, 0.0]), start_s=0.0, slot_s=3600.0,
        north=np.array([[[5.0, -5.0]]]), east=np.zeros((1, 1, 2)), probability=np.ones(1), labels=("one",), height_m=60.0,
    )  # fmt: skip
    north, _ = over_region(wind, fiji)
    assert north[0, 0] == pytest.approx(5.0, abs=0.01)
