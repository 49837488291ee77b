"""In dense networks the exact planner looks near the straight way first: the answer stays the best there is, and bounds hold."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import best_time, make_request, make_wind, make_world

from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact import exact
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.explain import mean_bound_s
from skyway.planner.parameters.exact import ExactParameters
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.robust import charge_policy, composer, robust
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

NEAR = replace(USUAL, exact=ExactParameters(near_stations=3, dense_segments=1))
"""Every network counts as dense, and three stations as near."""
WHOLE = replace(USUAL, exact=ExactParameters(dense_segments=10**9))


def city(seed, *, parameters, stations=40, length_m=60_000.0):
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, stations, length_m=length_m, utilisation=float(rng.choice([0.5, 0.9])))
    wind = make_wind(rng, mean_mps=float(rng.choice([1.0, 4.0, 7.0])))
    request = make_request(scenario, rng, reserve_soc=0.2, payload_kg=0.5)
    return Problem(scenario, request, scenario.drones[0], wind, parameters=parameters)


def near_first(problem):
    same = Problem(problem.scenario, problem.request, problem.drone, problem.ensemble, parameters=NEAR)
    return same, SampledQueues(same, 0)


def test_near_the_straight_way_first_it_equals_the_exhaustive_search():
    for seed in range(10):
        problem = city(seed, parameters=USUAL, stations=8, length_m=50_000.0)
        _, referee = best_time(ExhaustiveSearch(problem, SampledQueues(problem, 0)))
        same, queues = near_first(problem)
        search = ExactSearch(same, queues)
        itinerary, exact = best_time(search)
        assert exact == pytest.approx(referee, rel=1e-6), seed
        assert search.complete, seed
        if itinerary is not None:
            schedule = fly_true(same, itinerary, queues)[0]
            assert schedule[-1, TOUCH_DOWN] - same.depart_s == pytest.approx(exact, abs=0.02), seed
            assert np.all(schedule[:, SOC_LANDING] >= same.reserve - 1e-6), seed


def test_near_the_straight_way_first_it_equals_the_search_of_the_whole_city():
    for seed in range(4):
        problem = city(seed, parameters=WHOLE)
        _, whole = best_time(ExactSearch(problem, SampledQueues(problem, 0)))
        _, near = best_time(ExactSearch(*near_first(problem)))
        assert near == pytest.approx(whole, rel=1e-9), seed


def test_cut_off_at_any_time_its_bound_holds():
    told = 0
    for seed in range(4):
        problem = city(seed, parameters=WHOLE)
        _, best = best_time(ExactSearch(problem, SampledQueues(problem, 0)))
        for limit_s in (1e-4, 0.01):
            search = ExactSearch(*near_first(problem), time_limit_s=limit_s)
            itinerary, found = best_time(search)
            assert search.lower_bound_s - problem.depart_s <= best * (1.0 + 1e-9), seed
            assert found >= best * (1.0 - 1e-9), seed
            assert itinerary is None or best >= found / (1.0 + search.gap) * (1.0 - 1e-9), seed
            told += itinerary is not None and not search.complete
    assert told


@pytest.mark.parametrize("near", [{"near_tries": 1}, {"near_tries": 100}, {"first_labels": 1}])
def test_a_first_answer_is_found_wherever_there_is_a_way(near):
    parameters = replace(NEAR, exact=replace(NEAR.exact, **near))
    for seed in range(6):
        problem = city(seed, parameters=parameters)
        _, best = best_time(ExactSearch(problem, SampledQueues(problem, 0)))
        search = ExactSearch(problem, SampledQueues(problem, 0), time_limit_s=0.0)
        _, found = best_time(search)
        assert np.isfinite(found) == np.isfinite(best), seed
        assert found >= best * (1.0 - 1e-9), seed


def test_no_way_near_the_straight_way_costs_a_first_answer_few_searches(monkeypatch):
    passes = []
    run_forward = exact.run_forward
    monkeypatch.setattr(exact, "run_forward", lambda *how, **more: passes.append(how) or run_forward(*how, **more))
    counts = []
    for tries in (2, 100):
        passes.clear()
        problem = city(1, parameters=replace(NEAR, exact=replace(NEAR.exact, near_stations=2, near_tries=tries)))
        assert ExactSearch(problem, SampledQueues(problem, 0), time_limit_s=0.0).find() is not None
        counts.append(len(passes))
    assert counts[0] < counts[1]


def test_queues_that_are_sampled_when_they_are_met_are_those_sampled_beforehand():
    problem = city(1, parameters=USUAL)
    met, all_of_them = SampledQueues(problem, 2)[7], problem.queue_paths(range(len(problem.network)), 2)[7]
    np.testing.assert_array_equal(met.pad_s, all_of_them.pad_s)


def test_robust_composes_no_route_twice(monkeypatch):
    problem = city(2, parameters=USUAL, stations=12)
    composed = []

    class Counted(ExactSearch):
        def __init__(self, problem, queues, *, margin_soc_per_s, stops, speeds, **limits):
            composed.append((margin_soc_per_s, stops.tobytes(), speeds))
            super().__init__(problem, queues, margin_soc_per_s=margin_soc_per_s, stops=stops, speeds=speeds, **limits)

    monkeypatch.setattr(composer, "ExactSearch", Counted)
    search = robust.RobustSearch(problem)
    search.solve()
    assert len(set(composed)) == len(composed) > 0


def test_robust_plans_the_same_with_queues_sampled_for_the_whole_horizon(monkeypatch):
    plans, quick = [], replace(USUAL, robust=replace(USUAL.robust, large_network=1, final_runs=200))
    for ahead in (charge_policy._AHEAD, 0.3, 1e9):  # as they are, for less than it takes, and for all of it
        monkeypatch.setattr(charge_policy, "_AHEAD", ahead)
        problem = city(2, parameters=quick, stations=8)
        wind = make_wind(np.random.default_rng(5), members=4)
        result = plan(problem.scenario, problem.request, forecast=wind, parameters=quick)
        plans.append((result.itinerary, result.outcome.arrival_s.tolist(), result.robust.typical.schedule.tolist()))
    assert plans[0] == plans[1] == plans[2]


def test_robust_in_a_hurry_tells_how_good_its_answer_is_at_least():
    problem = city(2, parameters=USUAL, stations=8)
    hurried = plan(problem.scenario, problem.request, forecast=problem.ensemble, time_limit_s=1e-6)
    assert not hurried.complete
    assert "cut off after 1e-06 s" in hurried.composition.notes[-1]
    _, best = best_time(ExactSearch(problem, SampledQueues(problem, 0)))
    assert 0.0 < mean_bound_s(hurried.problem) <= best


@pytest.mark.parametrize(("dense_degree", "waits_matter", "margins"), [(0.0, 1.0, 1), (0.0, 0.0, 3), (1e6, 1.0, 3)])
def test_in_dense_networks_without_waits_routes_of_short_flights_are_enough(
    monkeypatch, dense_degree, waits_matter, margins
):
    tuned = replace(USUAL.robust, large_network=1, dense_degree=dense_degree, waits_matter=waits_matter)
    problem = city(9, parameters=replace(USUAL, robust=tuned), stations=12, length_m=30_000.0)
    composed = set()

    class Counted(ExactSearch):
        def __init__(self, problem, queues, *, margin_soc_per_s, time_limit_s, **more):
            if time_limit_s == 0.0:  # a first route, none of short flights
                composed.add(margin_soc_per_s)
            super().__init__(problem, queues, margin_soc_per_s=margin_soc_per_s, time_limit_s=time_limit_s, **more)

    monkeypatch.setattr(composer, "ExactSearch", Counted)
    robust.RobustSearch(problem).candidates()
    assert len(composed) == margins


def test_in_a_large_network_there_is_a_route_however_few_labels_the_search_with_a_margin_has():
    tuned = replace(USUAL.robust, large_network=1, first_route_labels=1, final_runs_large=200)
    problem = city(2, parameters=replace(USUAL, robust=tuned))
    result = plan(problem.scenario, problem.request, forecast=problem.ensemble, parameters=problem.parameters)
    assert result.outcome.p_arrive > 0.5
