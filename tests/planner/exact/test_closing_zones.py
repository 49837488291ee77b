"""Zones that close during a delivery: drones wait, go around or land before, as an exhaustive search says."""

import itertools
import math
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
import shapely
from worlds import DEPART, best_time, make_request, make_wind, make_world

from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.composition.composition import State
from skyway.models.drones.drone import M200_V2
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.forecast import constant_wind
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.request import Request
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import TAKE_OFF, TOUCH_DOWN

START_S = DEPART.timestamp()
CRUISE_M, CLIMB_MPS, DESCENT_MPS = 60.0, 5.0, 3.0


def window(rng, *, late_min=120):
    """Some minutes, in fives, during which a zone is active."""
    begin = 5.0 * int(rng.integers(-6, late_min // 5))
    return Period(START_S + 60.0 * begin, START_S + 60.0 * (begin + 5.0 * int(rng.integers(1, 16))))


def zones_over(rng, stations, count, *, half=0.004):
    """Boxes over the middles of random pairs of stations, each closed for a while or two."""
    found = []
    for number in range(count):
        a, b = (stations[i] for i in rng.choice(len(stations), 2, replace=False))
        lat, lon = (a.lat + b.lat) / 2.0, (a.lon + b.lon) / 2.0
        box = (lon - half, lat - half, lon + half, lat + half)
        when = Activation(tuple(window(rng) for _ in range(int(rng.integers(1, 3)))))
        found.append(Zone(f"z{number}", f"z{number}", "prohibited", (Volume(shapely.box(*box)),), when))
    return Airspace(tuple(found))


def test_with_charging_wind_and_queues_it_equals_the_exhaustive_search_of_the_planners():
    closed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        world = make_world(rng, 7, length_m=45_000.0, utilisation=0.5)
        zones = zones_over(rng, world.network.stations, 6)
        network = build_network(world.network.stations, world.network.rule, zones=zones)
        world = replace(world, network=network)
        wind = make_wind(rng, mean_mps=4.0)
        problem = Problem(world, make_request(world, rng, reserve_soc=0.2, payload_kg=0.5), world.drones[0], wind)
        queues = SampledQueues(problem, 0)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        itinerary, exact = best_time(ExactSearch(problem, queues))
        assert exact == pytest.approx(referee, rel=1e-6), seed
        free = Problem(replace(world, network=replace(network, zones=None)), problem.request, problem.drone, wind)
        if itinerary is not None:
            schedule = fly_true(problem, itinerary, queues)[0]
            for leg, row in zip(itinerary, schedule, strict=True):
                assert closing(zones, network, leg.segments, row[TAKE_OFF], row[TOUCH_DOWN]) == [], seed
            closed += exact > best_time(ExactSearch(free, SampledQueues(free, 0)))[1] + 1.0
    assert closed >= 4  # else the zones closed nothing


def test_around_zones_it_equals_the_exhaustive_search_too_and_lands_at_no_bend():
    bent = 0
    for seed in range(8):
        rng = np.random.default_rng(50 + seed)
        world = make_world(rng, 6, length_m=45_000.0, utilisation=0.5)
        zones = replace(zones_over(rng, world.network.stations, 2, half=0.01), max_detour=1.6, margin_m=30.0)
        network = build_network(world.network.stations, world.network.rule, zones=zones)
        load = world.load.extended(len(network) - len(world.network))
        world = replace(world, network=network, load=load)
        request = make_request(world, rng, reserve_soc=0.2, payload_kg=0.5, destination="s5")
        problem = Problem(world, request, world.drones[0], make_wind(rng, mean_mps=4.0))
        queues = SampledQueues(problem, 0)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        itinerary, exact = best_time(ExactSearch(problem, queues))
        assert exact == pytest.approx(referee, rel=1e-6), seed
        for leg in itinerary or ():
            assert not network.stations[network.head[leg.segments[-1]]].flyover
            bent += any(network.stations[network.head[s]].flyover for s in leg.segments)
    assert bent >= 2


def crosses(box, a, b):
    """Whether the straight line of the map between two stations touches a box (Liang and Barsky 1984)."""
    west, south, east, north = box
    low, high = 0.0, 1.0
    for start, step, least, most in ((a.lon, b.lon - a.lon, west, east), (a.lat, b.lat - a.lat, south, north)):
        if step == 0.0:
            if not least <= start <= most:
                return False
            continue
        first, last = sorted(((least - start) / step, (most - start) / step))
        low, high = max(low, first), min(high, last)
    return low <= high


def closing(zones, network, segments, off_s, down_s):
    """Zones active during a flight that one of its segments crosses, without the code that plans are made with."""
    found = []
    for zone in zones.zones:
        box = zone.volumes[0].area.bounds
        active = any(p.begin_s < down_s - 1e-3 and p.end_s > off_s + 1e-3 for p in zone.activation.periods)
        ends = ((network.stations[network.tail[s]], network.stations[network.head[s]]) for s in segments)
        if active and any(crosses(box, a, b) for a, b in ends):
            found.append(zone.id)
    return found


def exhaustive(network, speed_mps, origin, goal):
    """Earliest arrival over all simple paths, and all ways to land on them, each flight leaving when it first can."""
    boxes = [(z.volumes[0].area.bounds, z.activation.periods) for z in network.zones.zones]
    edges = sorted({edge for _, periods in boxes for p in periods for edge in (p.begin_s, p.end_s)})
    length = {
        (int(a), int(b)): float(d) for a, b, d in zip(network.tail, network.head, network.distance_m, strict=True)
    }
    over = {
        pair: [periods for box, periods in boxes if crosses(box, *(network.stations[node] for node in pair))]
        for pair in length
    }

    def fly(pairs, ready_s):
        flight_s = CRUISE_M / CLIMB_MPS + CRUISE_M / DESCENT_MPS + sum(length[p] for p in pairs) / speed_mps
        for off_s in [ready_s, *(edge for edge in edges if edge > ready_s)]:
            shut = (p for pair in pairs for periods in over[pair] for p in periods)
            if not any(p.begin_s < off_s + flight_s - 1e-6 and p.end_s > off_s + 1e-6 for p in shut):
                return off_s + flight_s
        raise AssertionError

    nodes, best = [n for n in range(len(network)) if n not in (origin, goal)], math.inf
    for count in range(len(nodes) + 1):
        for middle in itertools.permutations(nodes, count):
            path = [origin, *middle, goal]
            pairs = list(itertools.pairwise(path))
            if not all(pair in length for pair in pairs):
                continue
            for landings in itertools.product((False, True), repeat=count):
                now, begun = START_S, 0
                for number, lands in enumerate((*landings, True)):
                    if lands:
                        now, begun = fly(pairs[begun : number + 1], now), number + 1
                best = min(best, now)
    return best


def test_it_equals_all_paths_landings_and_take_offs_tried_by_hand():
    waited = 0
    for seed in range(25):
        rng = np.random.default_rng(100 + seed)
        stations = [
            Station(f"s{k}", f"S{k}", 52.5 + rng.uniform(-0.03, 0.03), 13.0 + 0.03 * k + rng.uniform(-0.01, 0.01), 40.0, 3)
            for k in range(5)
        ]  # fmt: skip
        zones = zones_over(rng, stations, 5)
        network = build_network(stations, ConnectionRule(max_length_m=6_000.0), zones=zones)
        scenario = Scenario("s", network, (M200_V2,), make_world(rng, 3).rules, PadLoad.none(5, "UTC"))
        if not {0, 4} <= set(network.tail.tolist()) or len(network.parts()) > 1:
            continue
        wind = constant_wind(0.0, 0.0, DEPART - timedelta(minutes=20), 8, 52.5, 13.0, 60.0)
        request = Request(state=State(DEPART, "s0", None, 1.0), destination="s4", payload_kg=0.1)
        answer = plan(scenario, request, planner="exact", forecast=wind).composition
        expected = exhaustive(network, min(M200_V2.cruise_airspeed_mps, M200_V2.max_ground_speed_mps), 0, 4)
        assert answer.arrive.timestamp() == pytest.approx(expected, abs=0.05), seed
        free = exhaustive(replace(network, zones=Airspace()), 20.0, 0, 4)
        waited += expected > free + 1.0
    assert waited >= 5
