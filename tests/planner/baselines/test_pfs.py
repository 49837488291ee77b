"""The paper's forward search, repaired: it never gives up where there is a way."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from skyway.models.base.errors import NoRouteError
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.baselines.pfs import ForwardSearch, charging_time_per_flight_s
from skyway.planner.baselines.pfs_strict import StrictForwardSearch
from skyway.planner.baselines.shortest import ShortestFlight
from skyway.planner.problem.problem import Problem
from skyway.planner.schedule.itinerary import fly_expected
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN


def single_member_problem(seed, recharge, *, utilisation=0.0, mean_mps=None):
    """A forecast of one member that is the truth, and stations nobody else uses (so that waits are known too)."""
    rng = np.random.default_rng(seed)
    stations = int(rng.integers(4, 8))
    scenario = make_world(rng, stations, length_m=9_000.0 * stations, utilisation=utilisation, target=seed % 5 == 4)
    mean = float(rng.choice([2.0, 4.0, 7.0, 9.0])) if mean_mps is None else mean_mps
    wind = make_wind(rng, mean_mps=mean)
    request = make_request(scenario, rng, recharge=recharge, payload_kg=float(rng.uniform(0, 0.9)))
    return Problem(scenario, request, scenario.drones[0], wind)


def solved_by_ies(problem):
    """Whether there is a way that lands at the end of every segment, as the forward searches do."""
    search = ExhaustiveSearch(problem, problem.queue_paths(range(len(problem.network)), 0))
    stops = search._stop_labels
    table, pieces_from = stops.table, stops.pieces_from

    def single_segments(stop, useful):
        pieces = pieces_from(stop, useful)
        adjacent = set(table.head[table.first[stop.node] : table.first[stop.node + 1]].tolist())
        return lambda node: pieces(node) if node in adjacent else np.empty((0, 4))

    stops.pieces_from = single_segments
    try:
        search.solve()
    except NoRouteError:
        return False
    return True


@pytest.mark.parametrize("block", range(10))
def test_it_finds_a_route_wherever_the_exhaustive_search_does_when_it_knows_the_wind(block):
    solved = 0
    for seed in range(50 * block, 50 * block + 50):
        problem = single_member_problem(seed, "full" if seed % 2 else "enough")
        if solved_by_ies(problem):
            solved += 1
            assert ForwardSearch(problem).solve(), seed
    assert solved >= 20


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("recharge", ["full", "enough"])
def test_in_a_known_wind_every_landing_keeps_the_reserve(seed, recharge):
    problem = single_member_problem(1000 + seed, recharge, mean_mps=3.0)
    for search in (ForwardSearch(problem), ForwardSearch(problem, charge_aware=True), ShortestFlight(problem)):
        try:
            itinerary = search.solve()
        except NoRouteError:
            continue
        schedule = fly_expected(problem, itinerary)[0]
        assert np.all(np.isfinite(schedule[:, TOUCH_DOWN]))
        assert np.all(schedule[:, SOC_LANDING] >= problem.reserve - 1e-6)
        heads = [int(problem.network.head[leg.segments[-1]]) for leg in itinerary]
        assert heads[-1] == problem.destination
        assert len(set(heads)) == len(heads), "no station twice"


def test_it_never_visits_a_station_twice_in_an_uncertain_wind_either():
    rng = np.random.default_rng(5)
    for _ in range(20):
        scenario = make_world(rng, 8, length_m=60_000.0)
        problem = Problem(
            scenario, make_request(scenario, rng), scenario.drones[0], make_wind(rng, members=20, mean_mps=3.0)
        )
        try:
            itinerary = ForwardSearch(problem).solve()
        except NoRouteError:
            continue
        nodes = [problem.origin, *(int(problem.network.head[leg.segments[-1]]) for leg in itinerary)]
        assert len(set(nodes)) == len(nodes)


def test_a_second_of_flight_costs_several_seconds_of_charging():
    problem = single_member_problem(1, "full")
    empty = replace(problem.request, payload_kg=0.0)
    full = replace(problem.request, payload_kg=1.45)
    low = charging_time_per_flight_s(Problem(problem.scenario, empty, problem.drone, problem.ensemble))
    high = charging_time_per_flight_s(Problem(problem.scenario, full, problem.drone, problem.ensemble))
    # 1.28 h / 0.8 of charging per full battery, 38 and 24 min of flight on it
    assert low == pytest.approx(1.2808 * 60 / 0.8 / 38, rel=1e-3)
    assert high == pytest.approx(1.2808 * 60 / 0.8 / 24, rel=1e-3)


def test_algorithm_1_as_printed_can_fail_where_the_repaired_one_does_not():
    strict_failures = 0
    for seed in range(60):
        problem = single_member_problem(seed, "full", mean_mps=3.0)
        try:
            ForwardSearch(problem).solve()
        except NoRouteError:
            continue
        try:
            StrictForwardSearch(problem).solve()
        except NoRouteError:
            strict_failures += 1
    assert strict_failures > 0
