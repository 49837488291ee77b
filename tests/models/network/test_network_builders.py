"""Rules that join stations, against their definitions tried on every pair and every third station."""

import itertools

import numpy as np
import pytest
import shapely
from geographiclib.geodesic import Geodesic
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skyway.models.airspace.airspace import Airspace
from skyway.models.base.errors import InputError
from skyway.models.network import builders as network_builders
from skyway.models.network.builders import build_network
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule, Station

REGIONS = st.sampled_from([(40.7, -74.0), (-37.8, 145.0), (69.6, 18.9), (0.0, 0.0), (-17.0, 179.99)])
SPREAD = st.floats(-0.3, 0.3)
OFFSETS = st.lists(st.tuples(SPREAD, SPREAD), min_size=0, max_size=12)


def stations_at(places) -> list[Station]:
    return [Station(f"s{n}", f"s{n}", lat, lon) for n, (lat, lon) in enumerate(places)]


def around(region, offsets) -> list[Station]:
    wrap = [(region[0] + a, (region[1] + b + 180.0) % 360.0 - 180.0) for a, b in offsets]
    return stations_at(wrap)


def length(a: Station, b: Station) -> float:
    return Geodesic.WGS84.Inverse(a.lat, a.lon, b.lat, b.lon)["s12"]


def pairs_of(network: Network) -> set[tuple[int, int]]:
    return set(zip(network.tail.tolist(), network.head.tolist(), strict=True))


def assert_joined(network: Network, wanted) -> None:
    """Compare with `wanted(i, j)`: True, False, or None where the definition is on edge.

    Two stations within two units of the last decimal are on edge, too: whether they stand at one place is rounding.
    """
    found = pairs_of(network)
    for i, j in itertools.permutations(range(len(network)), 2):
        a, b = network.stations[i], network.stations[j]
        apart = max(abs(a.lat - b.lat), abs(a.lon - b.lon))
        verdict = None if 0.0 < apart < 2.0 * 10.0**-network_builders.DECIMALS else wanted(i, j)
        assert verdict is None or ((i, j) in found) == verdict, (i, j, verdict)


@given(REGIONS, OFFSETS, st.floats(100.0, 60_000.0))
def test_max_length_joins_all_pairs_not_farther_apart(region, offsets, limit):
    stations = around(region, offsets)

    def wanted(i, j):
        d = length(stations[i], stations[j])
        return None if abs(d - limit) < 1e-3 else 0.0 < d <= limit

    assert_joined(build_network(stations, ConnectionRule("max-length", limit)), wanted)


@example((0.0, 0.0), [(0.0, 0.0), (0.0, 0.015625), (3.7e-182, 0.0)], 1, 1740.0)
@given(REGIONS, OFFSETS, st.integers(1, 5), st.floats(1000.0, 60_000.0))
@settings(max_examples=40)
@example((0.0, 0.0), [(0.0, 0.0), (0.0, 0.25), (0.25, 0.0), (2.220446049250313e-16, 0.25)], 1, 27_830.0)
def test_nearest_joins_each_station_to_its_nearest_and_them_to_it(region, offsets, count, limit):
    stations = around(region, offsets)

    def reaches(i, j):
        d = [length(stations[i], other) for other in stations]
        if d[j] == 0.0 or d[j] > limit + 1e-3:
            return False
        place = [tuple(np.round((s.lat, s.lon), network_builders.DECIMALS).tolist()) for s in stations]
        places = {place[n]: d[n] for n in range(len(stations)) if d[n] > 0.0 and place[n] != place[i]}
        here = place[j]
        nearer = sum(other < d[j] - 1e-2 for other in places.values())
        tied = sum(abs(other - d[j]) <= 1e-2 for place, other in places.items() if place != here)
        if nearer >= count:
            return False
        return None if nearer + tied >= count or abs(d[j] - limit) < 1e-3 else True

    def wanted(i, j):
        verdicts = reaches(i, j), reaches(j, i)
        return True if True in verdicts else None if None in verdicts else False

    assert_joined(build_network(stations, ConnectionRule("nearest", limit, count)), wanted)


def earth_xyz(station: Station) -> np.ndarray:
    from pyproj import Transformer

    return np.array(Transformer.from_crs(4979, 4978).transform(station.lat, station.lon, 0.0))


def free_ball(points: np.ndarray, i: int, j: int) -> float:
    """By how many metres the ball between two points is free of all others (negative: it is not); what is no millimetre away is no other."""
    middle, radius = (points[i] + points[j]) / 2.0, np.linalg.norm(points[i] - points[j]) / 2.0
    others = [k for k in range(len(points)) if min(np.linalg.norm(points[[i, j]] - points[k], axis=1)) > 1e-3]
    return float(np.linalg.norm(points[others] - middle, axis=1).min(initial=np.inf) - radius)


@pytest.mark.parametrize("few", [0, 150])
@settings(max_examples=60)
@given(region=REGIONS, offsets=OFFSETS)
@example(region=(40.7, -74.0), offsets=[(0.0, 0.0), (0.25, 0.0), (6.711545725016408e-10, 0.0)])
def test_gabriel_joins_two_stations_when_no_third_lies_between(few, region, offsets):
    stations = around(region, offsets)
    points = np.array([earth_xyz(s) for s in stations]).reshape(-1, 3)

    def wanted(i, j):
        d = length(stations[i], stations[j])
        margin = free_ball(points, i, j)
        beside_an_end = any(0.0 < np.linalg.norm(points[end] - one) < 1e-2 for end in (i, j) for one in points)
        return (
            None  # a third millimetres from an end: which of the two is joined is rounding
            if abs(margin) < 1e-4 * d or beside_an_end or abs(d - 30_000.0) < 1e-3
            else margin > 0.0 and 0.0 < d <= 30_000.0
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(network_builders, "FEW", few)
        assert_joined(build_network(stations, ConnectionRule("gabriel", 30_000.0)), wanted)


@pytest.mark.parametrize("kind", network_builders.RULES)
def test_stations_that_agree_in_all_decimals_stand_at_one_place(kind):
    network = build_network(
        stations_at([(40.7, -74.0), (40.7, -74.0 + 1e-10), (40.71, -74.0)]), ConnectionRule(kind, 30_000.0, 1)
    )
    assert pairs_of(network) == {(0, 2), (2, 0), (1, 2), (2, 1)}


@pytest.mark.parametrize("kind", network_builders.RULES)
def test_many_stations_are_joined_as_few_are(kind):
    rng = np.random.default_rng(5)
    places = np.column_stack((rng.uniform(40.5, 41.0, 400), rng.uniform(-74.2, -73.6, 400)))
    places = np.concatenate((places, places[:20]))
    rule = ConnectionRule(kind, 4_000.0, 3)
    networks = []
    for few in (0, 1000):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(network_builders, "FEW", few)
            networks.append(build_network(stations_at(places.tolist()), rule))
    assert pairs_of(networks[0]) == pairs_of(networks[1])
    assert len(networks[0].tail) > 400


@pytest.mark.parametrize("kind", network_builders.RULES)
def test_stations_at_one_place_have_the_same_neighbours_and_no_segment_between_them(kind):
    corner = [(40.7, -74.0)] * 5
    network = build_network(stations_at([*corner, (40.75, -74.0), (40.7, -73.95)]), ConnectionRule(kind, 10_000.0, 2))
    found = pairs_of(network)
    for n in range(5):
        assert {head for tail, head in found if tail == n} == {5, 6}
    assert (network.distance_m > 0.0).all()


@pytest.mark.parametrize("kind", network_builders.RULES)
@pytest.mark.parametrize(
    "places",
    [[], [(40.7, -74.0)], [(40.7, -74.0)] * 3, [(40.7 + n / 100, -74.0) for n in range(5)]],
    ids=["none", "one", "one place", "on a line"],
)
def test_degenerate_sets_make_networks_too(kind, places):
    network = build_network(stations_at(places), ConnectionRule(kind, 1500.0, 1))
    assert len(network) == len(places)
    steps = {(n, n + 1) for n in range(4)} | {(n + 1, n) for n in range(4)}
    assert pairs_of(network) == (steps if len(places) == 5 else set())


def test_stations_beside_the_antimeridian_are_neighbours():
    network = build_network(stations_at([(-17.0, 179.99), (-17.0, -179.99)]), ConnectionRule())
    assert pairs_of(network) == {(0, 1), (1, 0)}
    assert network.distance_m[0] < 3000.0


@given(
    places=st.lists(st.tuples(st.floats(40.5, 40.9), st.floats(-74.2, -73.8)), min_size=2, max_size=8, unique=True),
    box=st.tuples(st.floats(40.5, 40.9), st.floats(-74.2, -73.8), st.floats(0.001, 0.1), st.floats(0.001, 0.1)),
)
def test_a_no_fly_zone_removes_exactly_the_segments_that_cross_it(places, box):
    south, west, tall, wide = box
    zone = shapely.box(west, south, west + wide, south + tall)
    stations = stations_at(places)
    free = build_network(stations, ConnectionRule("max-length", 80_000.0))
    fenced = pairs_of(
        build_network(stations, ConnectionRule("max-length", 80_000.0), zones=Airspace.of_polygons(("z",), (zone,)))
    )
    for i, j in pairs_of(free):
        a, b = stations[i], stations[j]
        line = Geodesic.WGS84.InverseLine(a.lat, a.lon, b.lat, b.lon)
        points = [line.Position(line.s13 * k / 64) for k in range(65)]
        course = shapely.LineString([(p["lon2"], p["lat2"]) for p in points])
        if course.distance(zone.boundary) > 1e-4 or course.intersects(zone.buffer(-1e-4)):  # some 10 m
            assert ((i, j) in fenced) != course.intersects(zone)


def test_a_zone_beside_the_antimeridian_stops_what_crosses_it_and_nothing_else():
    fiji = Airspace.of_polygons(("fiji",), (shapely.box(179.995, -17.1, 180.0, -16.9),))
    greenwich = Airspace.of_polygons(("greenwich",), (shapely.box(-1.0, -18.0, 1.0, -16.0),))
    stations = stations_at([(-17.0, 179.99), (-17.0, -179.99), (-17.0, 179.95), (-17.2, -179.9)])
    assert pairs_of(build_network(stations, ConnectionRule(max_length_m=5000.0), zones=fiji)) == {(0, 2), (2, 0)}
    free = build_network(stations, ConnectionRule(max_length_m=30_000.0))
    assert len(free.tail) == 12
    assert pairs_of(build_network(stations, ConnectionRule(max_length_m=30_000.0), zones=greenwich)) == pairs_of(free)
    assert pairs_of(build_network(stations, ConnectionRule(max_length_m=30_000.0), zones=fiji)) == {
        *((0, 2), (2, 0), (1, 3), (3, 1)),
    }


@pytest.mark.parametrize(
    ("rule", "said"),
    [
        (ConnectionRule("gabrial"), "network.rule: unknown rule .*one of max-length, nearest, gabriel"),
        (ConnectionRule(max_length_m=0.0), "network.max_length_m: must be above 0"),
        (ConnectionRule(max_length_m=float("nan")), "network.max_length_m: must be above 0"),
        (ConnectionRule("nearest", nearest=0), "network.nearest: must be at least 1"),
    ],
)
def test_a_rule_that_cannot_be_is_refused(rule, said):
    with pytest.raises(InputError, match=said):
        build_network(stations_at([(40.7, -74.0), (40.8, -74.0)]), rule)


def test_more_pairs_than_can_be_planned_with_are_refused_before_they_are_made():
    rng = np.random.default_rng(1)
    places = np.column_stack((rng.uniform(40.6, 40.8, 10_000), rng.uniform(-74.1, -73.9, 10_000)))
    with pytest.raises(InputError, match=r"joins too many pairs .*use rule nearest"):
        build_network(stations_at(places.tolist()), ConnectionRule("max-length", 50_000.0))


def test_ten_thousand_stations_are_joined():
    rng = np.random.default_rng(1)
    places = np.column_stack((rng.uniform(40.0, 42.0, 10_000), rng.uniform(-75.0, -73.0, 10_000))).tolist()
    for kind in network_builders.RULES:
        assert len(build_network(stations_at(places), ConnectionRule(kind, 5_000.0)).tail) > 20_000
