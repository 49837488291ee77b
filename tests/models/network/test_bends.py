"""Ways around zones: as short as exact visibility graphs on the zones' own corners say, and never nearer than the margin."""

import itertools
import math
from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
import shapely

from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import Limit
from skyway.models.airspace.ways import at_any_height
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.base import geodesy
from skyway.models.network.bends import Bends
from skyway.models.network.builders import build_network, with_zones
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule, Station

START, GOAL = (0.0, -0.06), (0.0, 0.06)
M_PER_DEG = 111_195.0


def random_polygons(rng):
    """Star-shaped polygons, convex or not, some of which lie on each other, on the straight way."""
    found = []
    for _ in range(int(rng.integers(1, 6))):
        x, y = rng.uniform(-0.03, 0.03, 2)
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(3, 8))))
        radius = rng.uniform(0.004, 0.015, len(angle))
        area = shapely.make_valid(
            shapely.Polygon(np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle))))
        )
        if isinstance(area, shapely.Polygon) and area.area > 0.0:
            found.append(area)
    return found


def length_m(places):
    return sum(geodesy.distance_m(*a, *b) for a, b in itertools.pairwise(places))


def exact_m(polygons, margin_m):
    """Length of the shortest way outside of polygons, by networkx on the corners of the finely buffered areas."""
    wide = shapely.union_all([polygon.buffer(margin_m / M_PER_DEG, quad_segs=8) for polygon in polygons])
    inner = wide.buffer(-1e-9)
    corners = shapely.get_coordinates(wide).tolist() if margin_m else shapely.get_coordinates(polygons).tolist()
    places = [START[::-1], GOAL[::-1], *map(tuple, corners)]
    graph = nx.Graph()
    for i, j in itertools.combinations(range(len(places)), 2):
        if not shapely.LineString([places[i], places[j]]).intersects(inner):
            graph.add_edge(i, j, weight=geodesy.distance_m(*places[i][::-1], *places[j][::-1]))
    return nx.shortest_path_length(graph, 0, 1, weight="weight") if nx.has_path(graph, 0, 1) else math.inf


@pytest.mark.parametrize("margin_m", [0.0, 150.0])
def test_ways_around_random_polygons_are_as_short_as_can_be_and_keep_the_margin(margin_m):
    longer = []
    for seed in range(4 if margin_m else 30):
        polygons = random_polygons(np.random.default_rng(seed))
        airspace = Airspace.of_polygons([str(n) for n in range(len(polygons))], polygons)
        airspace = replace(airspace, margin_m=margin_m, max_detour=4.0)
        straight = at_any_height(*START, *GOAL)
        bends = Bends(airspace).around(straight, airspace.closed)
        assert bends is not None
        places = [START, *((lat, lon) for _, lat, lon in bends), GOAL]
        pieces = np.array([(*a, *b) for a, b in itertools.pairwise(places)])
        assert not airspace.crossed_by(at_any_height(*pieces.T)).any()
        line = shapely.LineString([(lon, lat) for lat, lon in places])
        assert min(line.distance(polygon) for polygon in polygons) * M_PER_DEG >= margin_m
        least_m = exact_m(polygons, margin_m)
        assert length_m(places) >= 0.9999 * least_m
        longer.append(length_m(places) / least_m - 1.0)
    assert max(longer) < 0.012
    assert np.mean(longer) < 0.004


CIRCLE = shapely.Point(0.0, 0.0).buffer(0.01)
STATIONS = [
    Station("a", "A", 0.0, -0.03, 100.0, 2),
    Station("b", "B", 0.0, 0.03, 150.0, 2),
    Station("c", "C", 0.03, 0.0, 80.0, 2),
]
RULE = ConnectionRule(max_length_m=20_000.0)


def zone(name="fair", area=CIRCLE, **changes):
    return Zone(name, name, "prohibited", (Volume(area, **changes.pop("volume", {})),), **changes)


def reached(network):
    """Length of the shortest way from a to b, by networkx."""
    return nx.shortest_path_length(network.graph, "a", "b", weight="distance_m")


def test_a_network_gets_bends_that_nobody_lands_at():
    airspace = Airspace((zone(),), margin_m=50.0, max_detour=1.5)
    network = build_network(STATIONS, RULE, zones=airspace)
    bends = [station for station in network.stations if station.flyover]
    assert [station.id for station in network.stations[:3]] == ["a", "b", "c"]
    assert len(bends) > 2
    assert {(one.pads, one.holding_spots, one.elevation_m) for one in bends} == {(0, 0, 150.0)}
    radius_m, apart_m = 0.01 * 111_320.0 + 50.0, 0.03 * 111_320.0
    tangent = math.sqrt(apart_m**2 - radius_m**2)
    exact = 2.0 * tangent + radius_m * (math.pi - 2.0 * math.acos(radius_m / apart_m))
    assert exact <= reached(network) < 1.006 * exact
    assert "3 stations" in repr(network)
    none = build_network(STATIONS, RULE, zones=replace(airspace, max_detour=1.0))
    assert len(none) == 3
    assert reached(none) > 2.0 * 4000.0  # by way of c
    short = build_network(STATIONS, RULE, zones=replace(airspace, max_detour=1.01))
    assert len(short) == 3


def test_targets_and_given_segments_get_bends_and_stay_the_last_node():
    airspace = Airspace((zone(),), margin_m=50.0, max_detour=1.5)
    pairs = np.array([[0, 1], [1, 0]])
    network = Network.from_pairs(STATIONS, pairs, zones=airspace)
    assert reached(network) < 7200.0
    wider = network.with_target(0.005, 0.02)
    assert wider.stations[-1].id == "target"
    names = {one.id for one in wider.stations}
    assert len(names) == len(wider)
    assert {one.id for one in network.stations} <= names
    assert nx.shortest_path_length(wider.graph, "a", "target", weight="distance_m") < 6000.0
    ends = list(zip(wider.tail.tolist(), wider.head.tolist(), strict=True))
    assert len(ends) == len(set(ends))
    assert not airspace.crossed_by(at_any_height(*(values[wider.tail] for values in (wider.lat, wider.lon)),
                                                 *(values[wider.head] for values in (wider.lat, wider.lon)))).any()  # fmt: skip


def test_a_zone_that_ends_keeps_the_straight_segment_beside_the_way_around():
    timed = zone("fair", activation=Activation((Period(0.0, 1.0),)))
    fixed = zone("tower", shapely.box(-0.001, -0.004, 0.001, 0.001))
    network = build_network(STATIONS[:2], RULE, zones=Airspace((timed, fixed), max_detour=1.5))
    lengths = []
    for closed in (True, False):  # while the fair is on, and afterwards
        graph = network.graph.copy()
        if closed:
            graph.remove_edges_from(
                [
                    (network.stations[network.tail[s]].id, network.stations[network.head[s]].id)
                    for s, _ in network.restricted.tolist()
                ]
            )
        lengths.append(nx.shortest_path_length(graph, "a", "b", weight="distance_m"))
    assert lengths[0] > 1.03 * lengths[1]
    assert lengths[1] < 6700.0  # closely around the tower, through the place of the fair


def test_zones_above_or_below_are_not_flown_around_and_other_zones_make_other_bends():
    high = Airspace((zone(volume={"floor": Limit(100.0, "AGL")}),), max_detour=1.5, cruise_height_m=40.0)
    network = build_network(STATIONS, RULE, zones=high)
    assert len(network) == 3 or all(not one.flyover for one in network.stations)
    closed = with_zones(network, replace(high, zones=(zone(),)))
    assert any(one.flyover for one in closed.stations)
    assert len(with_zones(closed, replace(high, zones=()))) == 3
