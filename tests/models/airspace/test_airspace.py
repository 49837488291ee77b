"""May this way be flown: in plan, in height and in time, against answers worked out without shapely."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import GROUND, NO_CEILING, Limit
from skyway.models.airspace.pressure import Pressure
from skyway.models.airspace.ways import chosen, columns, flown_at, level_flights
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.base.errors import InputError
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station

BOX = shapely.box(8.0, 47.0, 8.02, 47.02)
DAY = datetime(2026, 8, 5, tzinfo=UTC).timestamp()


def airspace(floor=GROUND, ceiling=NO_CEILING, kind="prohibited", periods=None, **rules):
    return Airspace(
        (Zone("Z1", "Zone", kind, (Volume(BOX, floor, ceiling),), Activation(periods) if periods else Activation()),),
        **rules,
    )


def across(height_m, ground_m, lon=8.01):
    ground = np.array([ground_m])
    return flown_at((47.01, lon - 0.05, 47.01, lon + 0.05), (height_m, height_m), (ground, ground))


@pytest.mark.parametrize(
    ("floor", "ceiling", "open_at", "closed_at"),
    [
        (GROUND, Limit(50.0, "AGL"), [451.0], [430.0, 450.0]),
        (GROUND, Limit(450.0, "AMSL"), [451.0], [410.0]),
        (Limit(100.0, "AGL"), NO_CEILING, [499.0], [500.0, 3000.0]),
        (Limit(600.0, "AMSL"), Limit(900.0, "AMSL"), [599.0, 901.0], [600.0, 750.0]),
        (Limit(3000.0, "FL"), NO_CEILING, [2140.0], [2150.0]),  # 955 hPa, and 40 degrees colder than usual
        (Limit(3000.0, "FL", Pressure((1030.0, 1030.0), (15.0, 15.0), sure=True)), NO_CEILING, [3000.0], [3160.0]),
        (Limit(1000.0, "WGS84"), NO_CEILING, [913.0], [914.0]),  # where the geoid is highest
        (GROUND, Limit(500.0, "WGS84"), [608.0], [607.0]),  # and lowest
        (GROUND, NO_CEILING, [], [400.0, 20_000.0]),
    ],
)
def test_a_way_over_or_under_a_zone_is_open(floor, ceiling, open_at, closed_at):
    zones = airspace(floor, ceiling)
    assert not any(zones.conflicts(across(height, 400.0)) for height in open_at)
    assert all(zones.conflicts(across(height, 400.0)) for height in closed_at)
    assert not zones.conflicts(across(450.0, 400.0, lon=8.5))


def test_where_the_ground_is_not_known_heights_above_the_sea_count_as_any():
    low = airspace(GROUND, Limit(100.0, "AMSL"))
    assert not low.conflicts(across(200.0, math.nan))
    unknown = level_flights((47.01, 7.95, 47.01, 8.05), (math.nan, 10.0), 60.0)
    assert low.conflicts(unknown)
    assert not airspace(GROUND, Limit(50.0, "AGL")).conflicts(unknown)


def test_a_climb_under_a_zone_is_open_and_into_it_is_not():
    zones = airspace(Limit(50.0, "AGL"))
    here = np.array([47.01]), np.array([8.01])
    assert not zones.conflicts(columns(*here, 400.0, 49.0))
    assert zones.conflicts(columns(*here, 400.0, 60.0))


def test_margins_are_kept_on_all_sides():
    zones = airspace(GROUND, Limit(50.0, "AGL"), margin_m=200.0, height_margin_m=10.0)
    assert zones.conflicts(across(459.0, 400.0))
    assert not zones.conflicts(across(461.0, 400.0))
    for metres, closed in ((199.0, True), (206.0, False)):
        north = 47.02 + metres / 111_180.0
        beside = flown_at((north, 8.0, north, 8.02), (420.0, 420.0), (400.0, 400.0))
        assert bool(zones.conflicts(beside)) == closed
        east = 8.02 + metres / (111_320.0 * math.cos(math.radians(47.01)))
        assert bool(zones.conflicts(flown_at((47.0, east, 47.02, east), (420.0, 420.0), (400.0, 400.0)))) == closed


@pytest.mark.parametrize(
    ("from_h", "until_h", "closed"),
    [(8, 9, False), (9.5, 10.5, True), (10.2, 10.4, True), (11, 12, False), (9, 10, False), (7, 12, True)],
)
def test_a_zone_counts_while_it_is_active_and_no_longer(from_h, until_h, closed):
    zones = airspace(periods=(Period(DAY + 36_000.0, DAY + 39_600.0),))
    found = zones.conflicts(across(450.0, 400.0), DAY + 3600.0 * from_h, DAY + 3600.0 * until_h)
    assert bool(found) == closed
    assert zones.conflicts(across(450.0, 400.0))  # at any time


def test_authorizations_open_what_needs_them_and_are_told():
    zones = airspace(kind="authorization")
    way = across(450.0, 400.0)
    assert zones.conflicts(way)
    assert zones.told(way) == []
    opened = zones.with_authorized(["Z1"])
    assert opened.conflicts(way) == []
    assert [one.zone.id for one in opened.told(way)] == ["Z1"]
    assert [one.zone.id for one in airspace(kind="conditional").told(way)] == ["Z1"]
    assert airspace(kind="information").told(way) == []
    with pytest.raises(InputError, match="is prohibited: no authorization opens it"):
        airspace().with_authorized(["Z1"])
    with pytest.raises(InputError, match="did you mean 'Z1'"):
        zones.with_authorized(["Z1a"])


coordinate = st.floats(-0.05, 0.05)
limit = st.one_of(st.none(), st.tuples(st.floats(0.0, 800.0), st.sampled_from(["AGL", "AMSL"])))


@given(
    ends=st.tuples(coordinate, coordinate, coordinate, coordinate),
    heights=st.tuples(st.floats(200.0, 900.0), st.floats(200.0, 900.0)),
    ground=st.floats(0.0, 200.0),
    floor=limit,
    ceiling=limit,
)
def test_the_answer_is_that_of_points_along_the_way(ends, heights, ground, floor, ceiling):
    lat1, lon1, lat2, lon2 = ends
    volume = Volume(
        shapely.box(-0.01, -0.01, 0.01, 0.01),
        GROUND if floor is None else Limit(*floor),
        NO_CEILING if ceiling is None else Limit(*ceiling),
    )
    zones = Airspace((Zone("z", "z", "prohibited", (volume,)),))
    found = bool(zones.conflicts(flown_at((lat1, lon1, lat2, lon2), heights, (ground, ground))))
    inside = False
    for k in range(401):
        share = k / 400.0
        lat, lon = lat1 + share * (lat2 - lat1), lon1 + share * (lon2 - lon1)
        height = heights[0] + share * (heights[1] - heights[0])
        above = floor is None or height - (ground if floor[1] == "AGL" else 0.0) >= floor[0]
        below = ceiling is None or height - (ground if ceiling[1] == "AGL" else 0.0) <= ceiling[0]
        inside |= abs(lat) <= 0.01 and abs(lon) <= 0.01 and above and below
    assert found or not inside  # never open where a point is inside; closed by the whole span of heights


def test_many_ways_are_answered_as_each_alone():
    rng = np.random.default_rng(3)
    boxes = [shapely.box(x, y, x + 0.01, y + 0.01) for x, y in rng.uniform(-0.1, 0.1, (40, 2))]
    zones = Airspace.of_polygons([str(n) for n in range(40)], boxes)
    ends = rng.uniform(-0.1, 0.1, (4, 500))
    ways = flown_at(tuple(ends), (100.0, 100.0), (0.0, 0.0))
    together = zones.crossed_by(ways)
    alone = [bool(zones.conflicts(chosen(ways, np.array([n])))) for n in range(500)]
    assert together.tolist() == alone
    assert 0 < sum(alone) < 500


def test_a_network_keeps_segments_that_are_closed_at_times_and_drops_those_that_always_are():
    stations = [
        Station("a", "A", 47.01, 7.95, 400.0), Station("b", "B", 47.01, 8.07, 400.0), Station("c", "C", 47.1, 8.0, 400.0)
    ]  # fmt: skip
    rule = ConnectionRule(max_length_m=30_000.0)
    for zones, segments, restricted in (
        (airspace(), 4, 0),
        (airspace(periods=(Period(0.0, 1.0),)), 6, 2),
        (airspace(kind="authorization"), 6, 2),
        (airspace(ceiling=Limit(50.0, "AGL")), 6, 0),
        (airspace(max_height_m=50.0), 0, 0),
    ):
        network = build_network(stations, rule, zones=zones)
        assert (len(network.tail), len(network.restricted)) == (segments, restricted)
        for segment, volume in network.restricted.tolist():
            assert {int(network.tail[segment]), int(network.head[segment])} == {0, 1}
            assert volume == 0
        wider = network.with_target(47.01, 8.04)  # the same segments, elsewhere in order
        named = {
            (wider.stations[wider.tail[s]].id, wider.stations[wider.head[s]].id) for s, _ in wider.restricted.tolist()
        }
        more = {("a", "target"), ("target", "a"), ("a", "b"), ("b", "a")} if restricted else set()
        assert named == more
