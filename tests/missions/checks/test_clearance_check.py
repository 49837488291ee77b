"""A mission that sinks, or climbs too late, over grounds that it knows itself is found."""

from dataclasses import replace

import numpy as np
import pytest
from test_one_builder import random_plan

from skyway.missions import (
    FlightConditions,
    MissionOptions,
    armed_mission,
    check,
    family_named,
    leg_mission,
    whole_mission,
)
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.models.base.geodesy import along
from skyway.models.composition.service import Place
from skyway.models.drones.drone import M200_V2
from skyway.models.network.station import Station

HOME = Home(Point.of_degrees(46.0, 8.0), 80.0)
STATIONS = (Station("a", "a", 46.0, 8.0, 80.0, pads=2), Station("b", "b", 46.0, 8.1, 2.0, pads=2))


def at(command, lon, z, frame=Frame.GLOBAL_RELATIVE_ALT):
    point = Point.of_degrees(46.0, lon)
    return MissionItem(command, frame, x=point.lat_e7, y=point.lon_e7, z=z)


def sloped(start_m, heights, land_m, home=HOME, stations=()):
    """Findings on clearance of: up over A, through evenly spaced heights to above B, down."""
    lons = [8.0 + 0.1 * (i + 1) / len(heights) for i in range(len(heights))]
    ways = [at(Command.NAV_WAYPOINT, lon, z) for lon, z in zip(lons, heights, strict=True)]
    items = (at(Command.NAV_TAKEOFF, 8.0, start_m), *ways, at(Command.NAV_LAND, 8.1, land_m))
    report = check(Mission(items, home), conditions=FlightConditions(M200_V2, stations=stations))
    return [(f.severity, f.item) for f in report.findings if f.code == "below-clearance"], report.ok


def test_the_slope_from_80_m_to_2_m_is_an_error():
    assert sloped(60.0, [-18.0], -78.0) == ([("error", 1)], False)


def test_the_same_slope_split_into_pieces_is_the_same_error():
    heights = [60.0 - 78.0 * (i + 1) / 5 for i in range(5)]
    assert sloped(60.0, heights, -78.0)[0] == [("error", 5)]


def test_a_slope_that_stays_above_the_ground_and_below_its_own_clearance_is_a_warning():
    assert sloped(60.0, [10.0], -50.0) == ([("warning", 1)], True)


def test_uphill_it_climbs_before_it_leaves():
    assert sloped(60.0, [138.0], 78.0)[0] == [("error", 1)]  # leaves at 60 m towards a hill of 78 m
    assert sloped(138.0, [138.0], 78.0)[0] == []


def test_level_flight_is_clear_in_every_frame():
    assert sloped(60.0, [60.0, 60.0], -78.0)[0] == []
    assert sloped(60.0, [60.0, 60.0], 0.0)[0] == []
    low = at(Command.NAV_WAYPOINT, 8.08, 30.0, Frame.GLOBAL_TERRAIN_ALT)
    landing = at(Command.NAV_LAND, 8.08, -78.0)
    assert not check(Mission((at(Command.NAV_TAKEOFF, 8.0, 60.0), low, landing), HOME)).findings


def test_the_ground_of_stations_is_known_with_the_scenario_and_whatever_a_landing_says():
    assert ("error", 1) in sloped(60.0, [-18.0], 0.0, stations=STATIONS)[0]
    uphill = Home(Point.of_degrees(46.0, 8.0), None)
    hill = (replace(STATIONS[0], elevation_m=2.0), replace(STATIONS[1], elevation_m=80.0))
    assert ("error", 1) in sloped(60.0, [60.0], 0.0, home=uphill, stations=hill)[0]


def test_a_place_below_the_station_under_it_is_an_error_whatever_lies_around_it():
    hill = Station("hill", "hill", 46.0, 8.05, 300.0)
    found, ok = sloped(60.0, [70.0, 60.0, 70.0, 60.0], 0.0, stations=(STATIONS[0], hill))
    assert ("error", 2) in found
    assert not ok


def test_the_altitude_of_a_landing_that_means_nothing_is_not_taken_for_ground():
    assert sloped(50.0, [50.0, 50.0], 50.0)[0] == []
    assert sloped(30.0, [30.0], 100.0)[0] == []


@pytest.mark.parametrize("family", ["px4", "ardupilot"])
@pytest.mark.parametrize("form", [whole_mission, armed_mission])
@pytest.mark.parametrize("end", [(60.2, 9.4), (59.9, 8.5)])
def test_own_missions_are_clear_in_every_form(small, family, form, end):
    mid = along(60.0, 8.0, *end, 1)[0]
    stations = {"a": Place(60.0, 8.0, 900.0), "b": Place(*mid, 20.0), "c": Place(*end, 400.0)}
    one = small.service(0, "a", "c", via=("b",), depart=small.NOON, stations=stations)
    plan = small.compose((one,), (), stations)
    known = tuple(Station(name, name, p.lat, p.lon, p.elevation_m, pads=1) for name, p in stations.items())
    documents = form(plan, family_named(family), MissionOptions()).documents
    assert documents == leg_mission(plan, 0, family_named(family), MissionOptions()).documents
    for conditions in (FlightConditions(M200_V2), FlightConditions(M200_V2, stations=known)):
        report = check(documents[0], dialect=family_named(family), conditions=conditions)
        assert not [f for f in report.findings if f.code == "below-clearance"]


@pytest.mark.parametrize("family", ["px4", "ardupilot"])
@pytest.mark.parametrize("form", [whole_mission, armed_mission])
def test_heights_of_own_missions_over_wild_ground_are_never_blamed(small, family, form):
    rng = np.random.default_rng(3)
    for _ in range(12):
        plan = random_plan(small, rng)
        known = tuple(Station(a, a, p.lat, p.lon, p.elevation_m, pads=1) for a, p in plan.stations.items())
        for document in form(plan, family_named(family), MissionOptions(corridor_width_m=None)).documents:
            for stations in ((), known):
                conditions = FlightConditions(M200_V2, stations=stations)
                codes = {f.code for f in check(document, dialect=family_named(family), conditions=conditions).findings}
                assert not codes & {"below-clearance", "takeoff-too-low"}
                assert not (stations and "not-above-ground" in codes)
