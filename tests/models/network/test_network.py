"""The network: what it refuses, how its arrays and graph agree, how a person names a station."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.airspace.airspace import Airspace
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.network.builders import build_network
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule, Station

BRONX = Station("bronx", "Bronx Hospital", 40.85, -73.90)
HARLEM = Station("harlem", "Harlem Hospital", 40.81, -73.94)
QUEENS = Station("queens", "Queens Library", 40.74, -73.82, pads=2)
BAY = Station("bay", "Bay Ridge Clinic", 40.62, -74.03)
CITY = (BRONX, HARLEM, QUEENS, BAY)


def joined(*pairs: tuple[int, int], stations=CITY) -> Network:
    return Network.from_pairs(stations, np.array(pairs, dtype=np.int64).reshape(-1, 2))


def faults_of(call) -> list[str]:
    with pytest.raises(InputError) as caught:
        call()
    return [str(fault) for fault in caught.value.faults]


@given(st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)).filter(lambda pair: pair[0] != pair[1])))
def test_segments_leaving_a_station_are_found_by_their_range(pairs):
    network = joined(*pairs)
    assert set(zip(network.tail.tolist(), network.head.tolist(), strict=True)) == pairs
    for node in range(4):
        out = slice(network.first[node], network.first[node + 1])
        assert set(network.head[out].tolist()) == {head for tail, head in pairs if tail == node}
        assert (network.tail[out] == node).all()


def test_every_segment_has_the_length_and_bearing_of_its_geodesic():
    network = joined((0, 1), (1, 0), (2, 3))
    there, back = network.bearing_deg[0], network.bearing_deg[1]
    assert network.distance_m[0] == network.distance_m[1] == geodesy.distance_m(40.85, -73.90, 40.81, -73.94)
    assert there == geodesy.bearing_deg(40.85, -73.90, 40.81, -73.94)
    assert abs(back - there) == pytest.approx(180.0, abs=0.1)
    lat, lon = (part[2] for part in network.midpoints)
    half = network.distance_m[2] / 2.0
    assert geodesy.distance_m(lat, lon, 40.74, -73.82) == pytest.approx(half, abs=1e-3)
    assert geodesy.distance_m(lat, lon, 40.62, -74.03) == pytest.approx(half, abs=1e-3)


def test_the_graph_says_the_same_as_the_arrays():
    network = joined((0, 1), (1, 2))
    assert list(network.graph.nodes) == ["bronx", "harlem", "queens", "bay"]
    assert network.graph.nodes["queens"]["pads"] == 2
    assert network.graph.edges["harlem", "queens"]["distance_m"] == network.distance_m[1]
    assert network.graph.number_of_edges() == 2


@given(st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)).filter(lambda pair: pair[0] != pair[1])))
def test_a_station_whose_closure_parts_the_network_is_named(pairs):
    network = joined(*pairs)
    expected = []
    for gone, station in enumerate(CITY):
        rest = joined(*(pair for pair in pairs if gone not in pair))
        alone_before = (station.id,) in network.parts()
        if len(rest.parts()) - 1 > len(network.parts()) - alone_before:
            expected.append(station.id)
    assert network.articulation_stations() == sorted(expected)


def test_parts_that_no_segment_joins_are_told_largest_first():
    assert joined((0, 1), (2, 1)).parts() == [("bronx", "harlem", "queens"), ("bay",)]
    assert joined().parts() == [("bronx",), ("harlem",), ("queens",), ("bay",)]


def test_unknown_ends_loops_and_double_ids_are_told_all_at_once():
    twice = (*CITY, Station("bay", "Bay again", 40.0, -74.0))
    faults = faults_of(lambda: joined((0, 1), (2, 2), (7, 0), (-1, 2), stations=twice))
    assert len(faults) == 4
    assert any("two stations have the same id (got 'bay')" in fault for fault in faults)
    assert any("from a station to itself (got 'queens')" in fault for fault in faults)
    assert sum("names no node" in fault for fault in faults) == 2


def test_a_station_is_found_by_id_or_by_an_unambiguous_part_of_its_name():
    network = joined()
    assert network.find("queens") == network.find(" QUEENS ") == network.find("library") == 2
    assert network.find("Harlem Hospital") == 1
    assert network.find("ridge") == 3


def test_an_id_wins_over_names_that_contain_it():
    network = joined(stations=(*CITY, Station("ridge", "Somewhere", 40.0, -74.0)))
    assert network.find("ridge") == 4


@pytest.mark.parametrize("text", ["hospital", "HOSPITAL"])
def test_an_ambiguous_name_shows_what_it_fits(text):
    assert faults_of(lambda: joined().find(text)) == [
        f"station: fits several stations (got '{text}'); choose one of bronx, harlem"
    ]


@pytest.mark.parametrize("text", ["harlm", "Harlem Hopsital", "haarlem"])
def test_a_misspelt_station_shows_the_nearest_names(text):
    (fault,) = faults_of(lambda: joined().find(text))
    assert "no such station" in fault
    assert "did you mean harlem" in fault


@pytest.mark.parametrize("text", ["", "   ", "xyzzy", "\x1b[2J", "\ud800"])
def test_a_name_like_nothing_points_to_the_list(text):
    (fault,) = faults_of(lambda: joined().find(text))
    assert fault.endswith("skyway network lists the stations")
    assert fault.isprintable()


def test_looking_for_a_misspelt_name_among_ten_thousand_stations_finds_the_nearest():
    stations = [Station(f"s{n}", f"Public Hospital number {n}", 40.0 + n * 1e-4, -74.0) for n in range(10_000)]
    network = joined(stations=stations)
    assert "did you mean" in faults_of(lambda: network.find("Publik Hopsital number 77"))[0]


@pytest.mark.parametrize(
    ("lat", "lon", "said"),
    [
        (91.0, 0.0, "lat: latitude out of range (got '91.0'); lat and lon may be swapped"),
        (-95.0, 100.0, "lat: latitude out of range (got '-95.0'); degrees from -90 to 90"),
        (145.1, -37.7, "lat: latitude out of range (got '145.1'); lat and lon may be swapped"),
        (0.0, 180.5, "lon: longitude out of range (got '180.5'); degrees from -180 to 180"),
        (float("nan"), 0.0, "lat: latitude out of range (got 'nan'); degrees from -90 to 90"),
        (4.07e8, 0.0, "lat: latitude out of range (got '407000000.0'); degrees, not ten-millionths of them"),
    ],
)
def test_a_position_that_cannot_be_is_refused_with_a_hint(lat, lon, said):
    assert [str(fault) for fault in coordinate_faults(lat, lon)] == [said]


def test_all_that_is_wrong_with_a_position_is_said():
    assert len(coordinate_faults(float("nan"), float("inf"))) == 2
    assert coordinate_faults(90.0, -180.0) == []


def test_a_delivery_target_is_joined_both_ways_to_what_the_rule_reaches():
    network = build_network(CITY, ConnectionRule(max_length_m=12_000.0))
    target = network.with_target(40.80, -73.90)
    assert target.stations[-1].pads == 0
    assert len(target) == 5
    near = {n for n, s in enumerate(CITY) if geodesy.distance_m(40.80, -73.90, s.lat, s.lon) <= 12_000.0}
    assert near == {0, 1, 2}
    pairs = set(zip(target.tail.tolist(), target.head.tolist(), strict=True))
    assert pairs == set(zip(network.tail.tolist(), network.head.tolist(), strict=True)) | {
        pair for n in near for pair in ((n, 4), (4, n))
    }


@pytest.mark.parametrize("kind", ["max-length", "nearest", "gabriel"])
def test_a_network_with_a_target_is_as_if_built_anew(kind):
    network = build_network(CITY, ConnectionRule(kind, 12_000.0, 2)).with_target(40.80, -73.90)
    pairs = np.column_stack((network.tail, network.head))
    again = Network.from_pairs(network.stations, pairs)
    assert (again.tail == network.tail).all()
    assert (again.head == network.head).all()
    assert (again.distance_m == network.distance_m).all()
    assert (again.bearing_deg == network.bearing_deg).all()
    assert network.rule == ConnectionRule(kind, 12_000.0, 2)


@given(
    places=st.lists(st.tuples(st.floats(40.5, 41.0), st.floats(-74.2, -73.7)), min_size=1, max_size=12, unique=True),
    target=st.tuples(st.floats(40.5, 41.0), st.floats(-74.2, -73.7)),
)
def test_a_target_in_a_gabriel_network_gets_gabriel_segments(places, target):
    stations = [Station(f"s{n}", f"s{n}", *place) for n, place in enumerate(places)]
    network = build_network(stations, ConnectionRule("gabriel", 40_000.0)).with_target(*target)
    joined_to = set(network.head[network.first[len(places)] :].tolist())
    north, east = geodesy.local_offsets_m(network.lat, network.lon, *target)
    points = np.column_stack((north, east))
    for node in range(len(places)):
        others = np.delete(points[:-1], node, axis=0)
        middle, radius = points[node] / 2.0, np.hypot(*points[node]) / 2.0
        margin = np.hypot(*(others - middle).T).min(initial=np.inf) - radius
        if abs(margin) > 0.5 and abs(2.0 * radius - 40_000.0) > 0.5:
            assert (node in joined_to) == (margin > 0.0 and 2.0 * radius < 40_000.0)


def test_a_target_near_given_segments_is_joined_within_the_longest_of_them():
    network = joined((0, 1), (1, 2)).with_target(40.80, -73.90)
    longest = network.distance_m[network.tail < 4].max()
    assert (network.distance_m[network.tail == 4] <= longest).all()
    assert len(joined().with_target(40.80, -73.90).tail) == 0


def test_a_target_named_like_a_station_gets_another_name():
    network = joined().with_target(40.80, -73.90, id="bay")
    assert [s.id for s in network.stations][3:] == ["bay", "bay-new"]


def test_a_target_out_of_range_or_in_a_no_fly_zone_is_refused():
    import shapely

    zones = Airspace.of_polygons(("airport",), (shapely.box(-73.95, 40.75, -73.85, 40.80),))
    network = build_network(CITY, ConnectionRule(), zones=zones)
    assert "lies in the no-fly zone airport" in faults_of(lambda: network.with_target(40.78, -73.90))[0]
    assert "swapped" in faults_of(lambda: network.with_target(-173.9, 40.78))[0]
    assert faults_of(lambda: network.with_target(float("nan"), -73.9))


def test_segments_to_a_target_do_not_cross_a_zone_either():
    import shapely

    zones = Airspace.of_polygons(("airport",), (shapely.box(-73.95, 40.815, -73.85, 40.82),))
    network = build_network(CITY, ConnectionRule(), zones=zones).with_target(40.80, -73.90)
    assert 0 not in network.head[network.tail == 4]
    assert 1 in network.head[network.tail == 4]


def test_a_target_on_top_of_a_station_is_a_metre_away():
    network = build_network(CITY, ConnectionRule()).with_target(QUEENS.lat, QUEENS.lon)
    own = (network.tail == 4) & (network.head == 2)
    assert network.distance_m[own].tolist() == [1.0]


def test_another_number_of_pads_leaves_targets_without():
    network = joined().with_target(40.80, -73.90).with_pads(7)
    assert network.pads.tolist() == [7, 7, 7, 7, 0]
