"""Ways to pads around what is closed: no piece of them is in it, and none is longer than the shortest one by much."""

import math

import numpy as np
import pytest
import shapely
from mission_interpreter import assert_same_work
from mission_worlds import FAMILIES, at, mission_of, options, pad

from skyway.missions import Command, MissionDocument
from skyway.missions.items.geofence import FencePolygon, Geofence
from skyway.missions.recharge.bent_ways import BentWays
from skyway.models.airspace.airspace import Airspace
from skyway.models.base.errors import InputError
from skyway.recharge.recharged import recharged


def polygon(*corners, inclusion=False):
    return FencePolygon(tuple(at(*corner).point for corner in corners), inclusion)


def metres(places, origin):
    scale = 111_195.0
    return [
        ((lon - origin[1]) * scale * math.cos(math.radians(origin[0])), (lat - origin[0]) * scale)
        for lat, lon in places
    ]


WALL = polygon((200, -300), (300, -300), (300, 300), (200, 300))
BAY = polygon(
    (-200, -100), (700, -100), (700, 500), (400, 500), (400, 200), (100, 200), (100, 500), (-200, 500), inclusion=True
)


@pytest.mark.parametrize(
    ("fence", "here", "goal", "shortest_m"),
    [
        (WALL, (0, 0), (500, 0), 2.0 * math.hypot(200, 300) + 100.0),
        (BAY, (0, 400), (600, 400), math.hypot(100, 200) + 300.0 + math.hypot(200, 200)),
    ],
)
def test_the_way_around_is_the_shortest_one_and_stays_where_it_may_be(fence, here, goal, shortest_m):
    origin, end = at(*here).point, at(*goal).point
    places = np.array([(origin.lat, origin.lon), (end.lat, end.lon)])
    bent = BentWays(Geofence((fence,)), None, lambda ends: np.zeros(len(ends), dtype=bool), every=False, places=places)
    (via,) = bent.to(np.array([[origin.lat, origin.lon]]), (end.lat, end.lon))
    chain = shapely.LineString(metres([(origin.lat, origin.lon), *via, (end.lat, end.lon)], (origin.lat, origin.lon)))
    assert shortest_m <= chain.length <= shortest_m + 40.0
    area = shapely.Polygon(metres([(one.lat, one.lon) for one in fence.vertices], (origin.lat, origin.lon)))
    assert chain.within(area) if fence.inclusion else not chain.intersects(area)


def there_and_back():
    legs = [at(100.0 * (number % 2), 20.0 * number - 300.0) for number in range(30)]
    return mission_of([*legs, at(0, 0, Command.NAV_LAND, 0.0)])


def test_a_mission_is_cut_at_a_pad_behind_a_wall_and_every_flight_keeps_to_the_fence():
    mission, pads = there_and_back(), [pad("far", 500, 0)]
    free = recharged(MissionDocument(mission), pads, FAMILIES, options(share=0.2))
    found = recharged(MissionDocument(mission, Geofence((WALL,))), pads, FAMILIES, options(share=0.2))
    assert found.plan.stops
    assert found.plan.end_s > free.plan.end_s
    assert found.problem.ways.via
    for name, flights in found.flights.items():
        missions = [flight.document.mission for flight in flights]
        grounds = [one.home.altitude_m - mission.home.altitude_m for one in missions]
        assert_same_work(mission, missions, grounds, speed=8.0, ardupilot=name == "ardupilot")
        for flight in flights:
            assert not [one for one in flight.report.findings if one.severity == "error"]
            assert flight.report.legs[-1].p_reserve >= 0.999 - 1e-9
    first, flight = found.plan.stops[0], found.told[0]
    flown_s = sum(leg.time_s for leg in flight.report.legs)
    assert flown_s == pytest.approx(first.arrive_s - found.plan.depart_s, rel=0.03)


def test_a_zone_is_gone_around_likewise():
    corners = [(one.lon, one.lat) for one in WALL.vertices]
    zones = Airspace.of_polygons(["wall"], [shapely.Polygon(corners)])
    chosen = options(share=0.2)
    rules = type(chosen.transit)(chosen.transit.speed_mps, zones=zones)
    chosen = type(chosen)(chosen.conditions, rules)
    found = recharged(MissionDocument(there_and_back()), [pad("far", 500, 0)], FAMILIES, chosen)
    assert found.plan.stops
    assert found.problem.ways.via


def test_a_pad_that_is_closed_all_around_is_none():
    ring = polygon((450, -50), (550, -50), (550, 50), (450, 50))
    with pytest.raises(InputError, match="no pad in reach"):
        recharged(
            MissionDocument(there_and_back(), Geofence((ring,))), [pad("far", 500, 0)], FAMILIES, options(share=0.1)
        )
