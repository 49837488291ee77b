"""One airspace for all: where the planner may fly, the mission that it becomes passes the check, and where not, it does not."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import shapely

from skyway.building import build_scenario
from skyway.missions.autopilots.registry import family_named
from skyway.missions.builder.from_composition import leg_mission
from skyway.missions.checks.energy import FlightConditions
from skyway.missions.checks.report import check
from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import GROUND, NO_CEILING, Limit
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.composition.composition import State
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.kernels import land
from skyway.models.flight.rules import air_over
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request

NOON = datetime(2026, 8, 5, 12, tzinfo=UTC)
STATIONS = [
    Station("a", "A", 47.0, 8.0, 400.0),
    Station("b", "B", 47.06, 8.0, 430.0),
    Station("c", "C", 47.03, 8.03, 410.0),
]
CALM = constant_wind(0.0, 0.0, NOON - timedelta(hours=2), 12, 47.0, 8.0, 60.0)
PX4 = family_named("px4")


def random_zone(rng, number):
    lat, lon = 47.0 + rng.uniform(0.0, 0.06), 8.0 + rng.uniform(-0.01, 0.03)
    floor, ceiling = GROUND, NO_CEILING
    if rng.random() < 0.6:
        floor = (
            Limit(float(rng.uniform(0.0, 120.0)), "AGL")
            if rng.random() < 0.5
            else Limit(float(rng.uniform(380.0, 560.0)))
        )
    if rng.random() < 0.6:
        ceiling = (
            Limit(float(rng.uniform(30.0, 150.0)), "AGL")
            if rng.random() < 0.5
            else Limit(float(rng.uniform(400.0, 600.0)))
        )
    begin = NOON.timestamp() + 300.0 * int(rng.integers(-12, 12))
    when = (
        Activation() if rng.random() < 0.3 else Activation((Period(begin, begin + 300.0 * int(rng.integers(1, 24))),))
    )
    kind = str(rng.choice(["prohibited", "authorization", "conditional", "information"]))
    return Zone(
        f"z{number}", "", kind, (Volume(shapely.box(lon, lat, lon + 0.012, lat + 0.012), floor, ceiling),), when
    )


def to(scenario, goal):
    """The mission of the straight leg from a to another station."""
    request = Request(state=State(NOON, "a", None, 1.0), destination=goal, payload_kg=0.1)
    composition = plan(scenario, request, planner="exact", forecast=CALM).composition
    assert [(leg.via, leg.destination) for leg in composition.services] == [((), goal)]
    return leg_mission(composition, 0, PX4).documents[0]


def zone_errors(report):
    return [finding for finding in report.findings if finding.code == "no-fly-zone"]


def test_kernels_and_checks_give_the_same_answer_for_every_leg_and_time():
    open_ = build_scenario(STATIONS, segments=ConnectionRule(max_length_m=20_000.0))
    legs = {goal: to(open_, goal) for goal in ("b", "c")}
    answers = {True: 0, False: 0}
    for seed in range(15):
        rng = np.random.default_rng(seed)
        airspace = Airspace(tuple(random_zone(rng, n) for n in range(3)), margin_m=float(rng.choice([0.0, 100.0])))
        scenario = build_scenario(STATIONS, segments=ConnectionRule(max_length_m=20_000.0), zones=airspace)
        network = scenario.network
        air = air_over(network, CALM.in_shorter_slots(12), M200_V2, scenario.rules)
        kept = {(int(a), int(b)): n for n, (a, b) in enumerate(zip(network.tail, network.head, strict=True))}
        for goal in ("b", "c"):
            segment = kept.get((0, network.index[goal]))
            flown_by = FlightConditions(M200_V2, stations=network.stations)
            for minutes in (-50, 0, 35, 90):
                depart = NOON + timedelta(minutes=minutes, seconds=1)
                by_planner = segment is not None and land(air, 0, (segment,), depart.timestamp()) < math.inf
                report = check(legs[goal], conditions=flown_by, zones=network.zones, depart_s=depart.timestamp())
                assert by_planner == (not zone_errors(report)), (
                    seed,
                    goal,
                    minutes,
                    [str(f) for f in zone_errors(report)],
                    airspace.zones,
                )
                answers[by_planner] += 1
    assert min(answers.values()) >= 15


def test_a_plan_that_waited_passes_at_its_time_and_not_before():
    closed = Period(NOON.timestamp() - 3600.0, NOON.timestamp() + 2400.0)
    zone = Zone("z", "Fair", "prohibited", (Volume(shapely.box(7.99, 47.03, 8.06, 47.035)),), Activation((closed,)))
    scenario = build_scenario(STATIONS, segments=ConnectionRule(max_length_m=20_000.0), zones=Airspace((zone,)))
    request = Request(state=State(NOON, "a", None, 1.0), destination="b", payload_kg=0.1)
    composition = plan(scenario, request, planner="exact", forecast=CALM).composition
    first = composition.services[0].depart
    assert first - NOON == timedelta(minutes=40)
    document = leg_mission(composition, 0, PX4).documents[0]
    for depart, closed in ((first, False), (NOON, True), (None, True)):
        time_s = None if depart is None else depart.timestamp()
        assert bool(zone_errors(check(document, zones=scenario.network.zones, depart_s=time_s))) == closed


def test_conditions_and_authorizations_on_the_way_are_told_and_heights_kept():
    kinds = (("c", "conditional"), ("a", "authorization"), ("i", "information"))
    box = shapely.box(7.99, 47.03, 8.06, 47.035)
    zones = tuple(Zone(name, name, kind, (Volume(box),), message="call the tower") for name, kind in kinds)
    airspace = Airspace(zones).with_authorized(["a"])
    scenario = build_scenario(STATIONS, segments=ConnectionRule(max_length_m=20_000.0), zones=airspace)
    request = Request(state=State(NOON, "a", None, 1.0), destination="b", payload_kg=0.1)
    document = leg_mission(plan(scenario, request, planner="exact", forecast=CALM).composition, 0, PX4).documents[0]
    report = check(document, zones=scenario.network.zones)
    told = sorted(finding.message for finding in report.findings if finding.code == "zone-conditions")
    assert ["authorization for a" in told[1], "conditions of c: call the tower" in told[0], len(told)] == [
        True,
        True,
        2,
    ]
    assert zone_errors(check(document, zones=Airspace(zones)))
    low = replace(M200_V2, max_height_m=80.0)  # over the start, which lies 30 m lower, the way is 90 m above the ground
    for zones_of, drone in ((Airspace(max_height_m=80.0), M200_V2), (Airspace(), low)):
        found = check(document, conditions=FlightConditions(drone), zones=zones_of).findings
        assert [finding.severity for finding in found if finding.code == "above-max-height"][:1] == ["error"]
    assert not [f for f in check(document, zones=Airspace(max_height_m=95.0)).findings if f.code == "above-max-height"]
