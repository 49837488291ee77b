"""Legs raised over zones: plan, mission and check agree, judged by points along the mission alone."""

from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest
import shapely

from skyway.building import build_scenario
from skyway.missions import FlightConditions, ForecastWind, check, family_named
from skyway.missions.builder.from_composition import leg_mission
from skyway.missions.builder.mission_options import MissionOptions
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import GROUND, Limit
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.base import geodesy
from skyway.models.base.json_text import json_text
from skyway.models.composition.composition import State
from skyway.models.composition.file import from_json, to_json
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.scenario.ground import over_terrain
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from tests.models.terrain.grids import NORTH, WEST, hills, terrain_of

DEPART = datetime(2026, 7, 1, 2, tzinfo=UTC)
LAT, LON = NORTH - 0.06, WEST + 0.02
MIDDLE, RADIUS_DEG = (LAT, LON + 0.045), 0.02
WIND = constant_wind(6.0, 200.0, DEPART, 48, LAT, LON, 60.0)


def airspace(ceiling, **changes):
    return Airspace(
        (
            Zone(
                "Z1", "Park", "prohibited", (Volume(shapely.Point(*MIDDLE[::-1]).buffer(RADIUS_DEG), GROUND, ceiling),)
            ),
        ),
        **{"margin_m": 50.0, "height_margin_m": 10.0, "max_height_m": 120.0, "max_detour": 1.5} | changes,
    )


def region(ceiling, *, terrain=False, **changes):
    """Two stations with a zone between them, too wide to fly around quickly."""
    ground = None if terrain else 150.0
    stations = [Station("a", "A", LAT, LON, ground), Station("b", "B", LAT, LON + 0.09, ground)]
    flat = build_scenario(stations, segments=ConnectionRule(max_length_m=9_000.0), zones=airspace(ceiling, **changes))
    return over_terrain(flat, terrain_of(hills(4, high_m=100.0))) if terrain else flat


def planned(world):
    request = Request(state=State(DEPART, "a", None, 1.0), destination="b", payload_kg=0.5)
    return plan(world, request, planner="exact", forecast=WIND)


def flown(document, base_m):
    """Points 20 m apart along the items of a mission: latitude, longitude, height above the sea."""
    items = [item for item in document.mission.items if item.point is not None and item.is_flown_to]
    rows = []
    for one, other in pairwise(items):
        apart_m = geodesy.distance_m(one.point.lat, one.point.lon, other.point.lat, other.point.lon)
        steps = np.linspace(0.0, 1.0, 2 + int(apart_m / 20.0))
        rows.append(
            np.column_stack(
                [
                    one.point.lat + steps * (other.point.lat - one.point.lat),
                    one.point.lon + steps * (other.point.lon - one.point.lon),
                    base_m + one.z + steps * (other.z - one.z),
                ]
            )
        )
    return np.concatenate(rows).T


@pytest.mark.parametrize(
    ("ceiling", "terrain"),
    [(Limit(80.0, "AGL"), False), (Limit(250.0, "AMSL"), False), (Limit(75.0, "AGL"), True)],
    ids=["above ground", "above the sea", "over terrain"],
)
def test_a_leg_is_raised_over_a_zone_alike_in_plan_mission_and_check(ceiling, terrain):
    world = region(ceiling, terrain=terrain)
    result = planned(world)
    composition = result.composition
    assert composition.services[0].via == ("over-Z1-1", "over-Z1-2")
    assert from_json(json_text(to_json(composition))) == composition
    over = world.network.over
    document = leg_mission(composition, 0, family_named("px4"), MissionOptions(over=over)).documents[0]
    base_m = composition.stations["a"].elevation_m
    lat, lon, height_m = flown(document, base_m)
    ground_m = over.terrain.ground_m(lat, lon) if terrain else np.full(len(lat), 150.0)
    inside = np.abs(lon - MIDDLE[1]) < RADIUS_DEG  # the way is a circle of latitude, to some metres
    assert inside.sum() > 50
    top_m = ceiling.value_m + (ground_m if ceiling.datum == "AGL" else 0.0)
    assert (height_m - top_m)[inside].min() >= 10.0
    assert (height_m - ground_m).max() <= 120.5
    assert np.median((height_m - ground_m)[~inside]) < 80.0  # and is no higher than elsewhere
    drone, problem = world.drones[0], result.problem
    weather = ForecastWind(WIND, DEPART.timestamp(), problem.rules.wind_profile_exponent)
    conditions = FlightConditions(drone, 0.5, 1.0, 0.2, weather=weather, stations=world.network.stations[:2])
    report = check(document, conditions=conditions, over=over, zones=world.network.zones)
    assert not [one for one in report.findings if one.severity == "error"]
    lower = replace(world.network.zones, height_margin_m=80.0)
    found = {one.code for one in check(document, conditions=conditions, over=over, zones=lower).findings}
    assert "no-fly-zone" in found
    leg = report.legs[0]
    assert leg.energy_wh - 0.5 <= composition.services[0].energy_wh <= 1.1 * leg.energy_wh


def test_a_zone_that_is_too_high_is_flown_around():
    assert all(name.startswith("around") for name in planned(region(Limit(110.0, "AGL"))).composition.services[0].via)
    low = planned(region(Limit(110.0, "AGL"), max_height_m=150.0)).composition.services[0]
    assert low.via == ("over-Z1-1", "over-Z1-2")


def test_grounds_that_only_the_terrain_knows_open_zones_above_the_sea():
    world = region(Limit(120.0, "AMSL"), terrain=True)  # all of the ground is higher
    assert planned(world).composition.services[0].via == ()
