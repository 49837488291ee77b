"""Every form of a mission keeps the clearance, and the forms agree item by item: one builder makes them all.

The oracle knows nothing of the builder: it walks the items, interpolates the height between them, and compares it
with the ground of the stations that each part of the way joins.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from skyway.link.supervisor.legs import plan_leg, turn_leg
from skyway.missions import MissionOptions, armed_mission, family_named, leg_mission, whole_mission
from skyway.missions.items.commands import Command
from skyway.models.composition.service import Place, Stop
from skyway.models.flight.heights import cleared_grounds_m, wind_factors
from skyway.models.flight.rules import FlightRules

CRUISE_M = 60.0
FORMS = {"px4": family_named("px4"), "ardupilot": family_named("ardupilot")}
FLOWN = (Command.NAV_TAKEOFF, Command.NAV_WAYPOINT)


def random_plan(small, rng):
    """Two legs with up to three stations overflown, every ground between -10 and 2,000 m."""
    counts = rng.integers(0, 4, 2)
    names = [f"s{n}" for n in range(int(counts.sum()) + 4)]
    lat, lon = np.cumsum(rng.uniform(-0.05, 0.05, (2, len(names))), axis=1)
    ground = rng.uniform(-10.0, 2000.0, len(names)).round(2)
    stations = {name: Place(46.0 + lat[i], 8.0 + lon[i], float(ground[i]), name, 4) for i, name in enumerate(names)}
    first, second = names[: counts[0] + 2], names[counts[0] + 1 : -1]
    if len(second) < 2:
        second = [first[-1], names[-2]]
    aside = names[-1]
    one = small.service(0, first[0], first[-1], via=first[1:-1], diverts=(aside,), depart=small.NOON, stations=stations)
    stop = Stop(first[-1], one.arrive, 0.0, 600.0, 0.0, 0.6, 0.9)
    two = small.service(
        1, second[0], second[-1], via=second[1:-1], diverts=(aside,), depart=stop.leave, stations=stations
    )
    plan = small.compose((one, two), (stop,), stations)
    return replace(plan, cruise_height_m=CRUISE_M)


def station_heights(service, plan):
    return [plan.stations[name].elevation_m for name in (service.origin, *service.via, service.destination)]


def assert_clear(items, service, plan, home_ground_m):
    """Walk the items of one leg: nowhere lower than the cruise height above the higher end of the segment."""
    names = (service.origin, *service.via, service.destination)
    where = {(round(plan.stations[n].lat * 1e7), round(plan.stations[n].lon * 1e7)): i for i, n in enumerate(names)}
    flown = [item for item in items if item.command in FLOWN]
    grounds = station_heights(service, plan)
    segment = -1
    for before, after in pairwise(flown):
        segment = where.get((before.x, before.y), segment)
        required = max(grounds[segment : segment + 2]) + CRUISE_M
        assert min(before.z, after.z) + home_ground_m >= required - 0.02
    lands = [item for item in items if item.command == Command.NAV_LAND]
    assert [item.z + home_ground_m for item in lands] == [pytest.approx(grounds[-1], abs=0.01)]
    assert (lands[0].x, lands[0].y) == (flown[-1].x, flown[-1].y)  # straight down


def assert_as_windy_as_planned(items, service, plan, home_ground_m):
    """The height above the ground half-way along each segment is that which plans work out the wind at."""
    flown = [item for item in items if item.command in FLOWN]
    at = {(item.x, item.y): item.z + home_ground_m for item in flown}
    names = (service.origin, *service.via, service.destination)
    top = np.array([at[round(plan.stations[n].lat * 1e7), round(plan.stations[n].lon * 1e7)] for n in names])
    ground = np.array(station_heights(service, plan))
    above = 0.5 * (top[:-1] + top[1:]) - 0.5 * (ground[:-1] + ground[1:])
    cleared = np.array(cleared_grounds_m(ground.tolist()))
    linear = FlightRules(cruise_height_m=CRUISE_M, wind_profile_exponent=1.0)
    ends = ground[:-1], ground[1:]
    np.testing.assert_allclose(CRUISE_M * wind_factors(linear, ends, (cleared[:-1], cleared[1:])), above, atol=0.02)
    alone = CRUISE_M * wind_factors(linear, ends)  # as plans count it, segment by segment
    assert (alone <= above + 0.02).all()
    if len(names) == 2:
        np.testing.assert_allclose(alone, above, atol=0.02)


def legs_of(items):
    """Split a mission at its landings."""
    legs = [[]]
    for item in items:
        legs[-1].append(item)
        if item.command == Command.NAV_LAND:
            legs.append([])
    return legs[:2]


def flown_heights(items, home_ground_m):
    """Places and heights above sea level of what is flown."""
    kept = (*FLOWN, Command.NAV_LAND)
    return [(i.x, i.y, round(i.z + home_ground_m, 2)) for i in items if i.command in kept]


@pytest.mark.parametrize("family", list(FORMS))
def test_a_thousand_legs_keep_their_clearance_and_are_the_same_in_every_form(small, family):
    rng = np.random.default_rng(11)
    autopilot = FORMS[family]
    options = MissionOptions(corridor_width_m=None)
    for _ in range(250):  # two legs each, two families: 1,000
        plan = random_plan(small, rng)
        grounds = [plan.stations[s.origin].elevation_m for s in plan.services]
        armed = legs_of(armed_mission(plan, autopilot, options).documents[0].mission.items)
        whole = [d.mission.items for d in whole_mission(plan, autopilot, options).documents]
        whole = legs_of(whole[0]) if len(whole) == 1 else whole
        for number, service in enumerate(plan.services):
            alone = leg_mission(plan, number, autopilot, options).documents[0]
            flies = plan_leg(plan, service, autopilot, options, last=number == 1).document
            assert flies == alone
            assert_clear(alone.mission.items, service, plan, grounds[number])
            assert_as_windy_as_planned(alone.mission.items, service, plan, grounds[number])
            assert_clear(armed[number], service, plan, grounds[0])
            written = [flown_heights(whole[number], grounds[number]), flown_heights(armed[number], grounds[0])]
            wanted = flown_heights(alone.mission.items, grounds[number])
            for found in written:  # an export may leave out the TAKEOFF of a later leg, never a waypoint
                shift = len(wanted) - len(found)
                assert shift in (0, 1)
                np.testing.assert_allclose(found, wanted[shift:], atol=0.011)
            lowest = max(station_heights(service, plan)) + CRUISE_M - grounds[number]
            assert all(p.altitude_m >= lowest - 0.01 for p in alone.rally.points)


@pytest.mark.parametrize("family", list(FORMS))
def test_a_turn_in_the_air_clears_home_the_new_station_and_never_sinks_on_the_way(small, family):
    rng = np.random.default_rng(5)
    for _ in range(200):
        plan = random_plan(small, rng)
        name, home = plan.services[0].diverts[0], float(rng.uniform(-10.0, 2000.0))
        height = float(rng.uniform(-500.0, 500.0))
        leg = turn_leg(
            plan, name, (46.0, 8.0, height), home, 12.0, FORMS[family], MissionOptions(), last=False, home=None
        )  # fmt: skip
        items = leg.document.mission.items
        ground = plan.stations[name].elevation_m
        ways = [item.z for item in items if item.command == Command.NAV_WAYPOINT]
        assert ways[0] == ways[1] >= round(max(height, CRUISE_M, ground - home + CRUISE_M), 2)
        assert items[-1].z == pytest.approx(ground - home, abs=0.01)


def test_eighty_metres_down_to_two_is_flown_level_and_then_straight_down(small):
    stations = {"a": Place(46.0, 8.0, 80.0), "b": Place(46.0, 8.1, 2.0)}
    plan = small.compose((small.service(0, "a", "b", depart=small.NOON, stations=stations),), (), stations)
    items = leg_mission(plan, 0, FORMS["px4"]).documents[0].mission.items
    assert [item.z for item in items if item.is_flown_to] == [60.0, 60.0, 60.0, -78.0]
    back = small.compose((small.service(0, "b", "a", depart=small.NOON, stations=stations),), (), stations)
    items = leg_mission(back, 0, FORMS["px4"]).documents[0].mission.items
    assert [item.z for item in items if item.is_flown_to] == [138.0, 138.0, 138.0, 78.0]
