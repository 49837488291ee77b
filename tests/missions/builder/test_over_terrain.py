"""Plan, mission, check and report answer alike which heights a leg flies, on random terrain."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.building import build_scenario
from skyway.link.supervisor.legs import plan_leg
from skyway.missions import FlightConditions, check, family_named
from skyway.missions.builder.from_composition import armed_mission, leg_mission, whole_mission
from skyway.missions.builder.leg_builder import LegBuilder
from skyway.missions.builder.mission_options import MissionOptions
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
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


def region(seed):
    """A scenario of six stations over random hills."""
    rng = np.random.default_rng(seed)
    stations = [
        Station(f"s{k}", f"s{k}", NORTH - rng.uniform(0.02, 0.11), WEST + 0.02 + 0.028 * k, None, 4) for k in range(6)
    ]
    flat = build_scenario(stations, segments=ConnectionRule(max_length_m=9_000.0))
    return over_terrain(flat, terrain_of(hills(seed)))


def planned(world, planner="exact"):
    wind = constant_wind(5.0, 250.0, DEPART, 48, NORTH, WEST, 60.0)
    request = Request(state=State(DEPART, "s0", None, 1.0), destination="s5", payload_kg=0.5)
    return plan(world, request, planner=planner, forecast=wind)


@pytest.mark.parametrize("seed", range(3))
def test_plan_mission_and_check_fly_the_same_heights(seed):
    world = region(seed)
    composition = planned(world).composition
    assert composition.terrain is not None
    over = world.network.over
    options = MissionOptions(over=over)
    for name in ("px4", "ardupilot"):
        family = family_named(name)
        for number, service in enumerate(composition.services):
            document = leg_mission(composition, number, family, options).documents[0]
            base = composition.stations[service.origin].elevation_m
            told = service.heights
            last = number == len(composition.services) - 1
            flown = plan_leg(composition, service, family, options, last=last).document  # what fly uploads
            assert flown.mission.items == document.mission.items
            # the mission: heights over the way, from the items alone
            items = [item for item in document.mission.items if item.point is not None and item.is_flown_to][1:-1]
            flown_m = [item.z + base for item in items]
            planned_m = list(told.path_height_m)
            assert max(flown_m) == pytest.approx(max(planned_m), abs=0.06)
            assert flown_m[0] == pytest.approx(planned_m[0], abs=0.06)
            assert flown_m[-1] == pytest.approx(planned_m[-1], abs=0.06)
            # the check: sampled again from the file, judged against the ground itself
            report = check(document, conditions=FlightConditions(world.drones[0]), over=over)
            assert not [
                one
                for one in report.findings
                if one.code in ("below-terrain", "below-terrain-clearance", "terrain-unknown")
            ]
            checked = report.heights[0]
            assert checked.least_m == pytest.approx(told.least_m, abs=1.0)
            assert checked.least_m >= over.clearance.least_m - 0.5
            rises = np.diff([base, *flown_m])
            assert rises[rises > 0].sum() == pytest.approx(np.maximum(np.diff([base, *planned_m]), 0).sum(), abs=0.5)
    assert from_json(json_text(to_json(composition))) == composition


def test_the_energy_of_a_leg_counts_its_climbs():
    world = region(1)
    result = planned(world)
    composition, problem = result.composition, result.problem
    options, family = MissionOptions(over=world.network.over), family_named("px4")
    wind = constant_wind(5.0, 250.0, DEPART, 48, NORTH, WEST, 60.0)
    from skyway.missions import ForecastWind

    for number, service in enumerate(composition.services):
        document = leg_mission(composition, number, family, options).documents[0]
        drone = world.drones[0]
        weather = ForecastWind(wind, service.depart.timestamp(), problem.rules.wind_profile_exponent)
        conditions = FlightConditions(
            drone, 0.5, 1.0, 0.2, problem.rules.climb_rate_mps, problem.rules.descent_rate_mps, weather
        )
        leg = check(document, conditions=conditions, over=world.network.over).legs[0]
        # the planner's climbs last no less than they take, and little more
        assert leg.energy_wh - 0.5 <= service.energy_wh <= 1.12 * leg.energy_wh
        flat = replace(world, network=replace(world.network, over=None))
        alone = planned(flat).composition.energy_wh
    assert composition.energy_wh > alone


def test_rally_points_turns_and_returns_clear_the_ground_on_their_ways():
    world = region(2)
    composition = planned(world, "robust").composition
    over = world.network.over
    build = LegBuilder(composition, family_named("ardupilot"), MissionOptions(over=over))
    rng = np.random.default_rng(0)
    for number, service in enumerate(composition.services):
        base = composition.stations[service.origin].elevation_m
        export = leg_mission(composition, number, family_named("ardupilot"), MissionOptions(over=over))
        for point in export.documents[0].rally.points:
            stops = [composition.stations[one] for one in (service.origin, *service.via, service.destination)]
            for share in rng.uniform(0, 1, 5):
                leg = int(rng.integers(len(stops) - 1))
                a, b = stops[leg], stops[leg + 1]
                here = a.lat + share * (b.lat - a.lat), a.lon + share * (b.lon - a.lon)
                way = geodesy.along(*here, point.point.lat, point.point.lon, 60)
                ground = over.terrain.ground_m(*np.array(way).T)
                assert (base + point.altitude_m - ground).min() >= over.clearance.least_m - 0.1
        for station in service.diverts:
            a = composition.stations[service.origin]
            here = a.lat - 0.01, a.lon + 0.01
            turn = build.turn(station, (*here, 10.0), base, 15.0, last=False, home=None).mission
            to = composition.stations[station]
            ground = over.terrain.ground_m(*np.array(geodesy.along(*here, to.lat, to.lon, 60)).T)
            assert turn.items[0].z == turn.items[2].z
            assert (base + turn.items[2].z - ground).min() >= over.clearance.least_m - 0.1


def test_a_mission_that_touches_the_ground_or_an_obstacle_is_an_error_with_the_place():
    world = region(1)
    composition = planned(world).composition
    over = world.network.over
    low = replace(composition, terrain=None, services=tuple(replace(one, heights=None) for one in composition.services))
    export = whole_mission(low, family_named("px4"), MissionOptions(cruise_height_m=5.0))
    ridge = terrain_of(hills(1) + np.where(np.arange(220) % 40 == 0, 400.0, 0.0))
    report = check(export.documents[0], over=replace(over, terrain=ridge))
    errors = [one for one in report.findings if one.code == "below-terrain"]
    assert errors
    assert not report.ok
    assert "touches the ground at" in errors[0].message
    beyond = check(export.documents[0], over=replace(over, terrain=terrain_of(hills(1)[:, :60])))
    assert [one.severity for one in beyond.findings if one.code == "terrain-unknown"][:1] == ["error"]


def test_a_plan_over_terrain_is_no_mission_without_it():
    composition = planned(region(0)).composition
    with pytest.raises(InputError, match="made over a terrain model, which is not given"):
        armed_mission(composition, family_named("px4"))
