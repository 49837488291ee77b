"""Storms in which nobody can fly: the search that begins when they end proves the same answers as every sequence of stops tried."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import best_time, make_request, make_wind, make_world

from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact import guided_search
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.fluid_bound import fluid_bound_s
from skyway.planner.parameters.exact import ExactParameters
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

NEAR = replace(USUAL, exact=ExactParameters(near_stations=4, dense_segments=1))
FINER = replace(USUAL, exact=replace(NEAR.exact, many_labels=3))
"""Searches are given up after a few labels, and done again with finer cells."""


def stormy(rng, *, sites=1):
    """Winds with hours of 25 m/s in between, and other winds at each site."""
    wind = make_wind(rng, mean_mps=float(rng.choice([1.0, 4.0, 7.0])))
    north, east = (np.repeat(values, sites, axis=2) for values in (wind.north, wind.east))
    north += rng.normal(0.0, 2.0, north.shape) * (sites > 1)
    slot = 1
    while slot < 20:
        lasts = int(rng.integers(1, 4))
        north[:, slot : slot + lasts] = 25.0
        slot += lasts + int(rng.integers(1, 4))
    lat, lon = 52.5 + rng.uniform(-0.2, 0.2, sites), 13.4 + rng.uniform(-0.3, 0.3, sites)
    return replace(wind, site_lat=lat, site_lon=lon, north=north, east=east)


def delayed(seed, *, parameters=USUAL, stations=8, target=False, sites=1):
    """A delivery that is too long for the hours between storms."""
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, stations, length_m=55_000.0, utilisation=float(rng.choice([0.3, 0.9])), target=target)
    request = make_request(scenario, rng, payload_kg=float(rng.choice([0.2, 1.0])), reserve_soc=0.2)
    return Problem(scenario, request, scenario.drones[0], stormy(rng, sites=sites), parameters=parameters)


def patchy(seed, *, stations, sites, parameters=NEAR):
    """A delivery over a city of which each part is closed by winds in other hours."""
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, stations, length_m=55_000.0, utilisation=float(rng.choice([0.3, 0.9])))
    request = make_request(scenario, rng, payload_kg=float(rng.choice([0.2, 1.0])), reserve_soc=0.2)
    wind = make_wind(rng, mean_mps=float(rng.choice([1.0, 4.0])))
    north, east = (np.repeat(values, sites, axis=2) for values in (wind.north, wind.east))
    for site in range(sites):
        slot = int(rng.integers(0, 3))
        while slot < 20:
            lasts = int(rng.integers(1, 4))
            north[:, slot : slot + lasts, site] = 30.0
            slot += lasts + int(rng.integers(1, 3))
    lat, lon = 52.5 + rng.uniform(-0.2, 0.2, sites), 13.4 + rng.uniform(-0.3, 0.3, sites)
    wind = replace(wind, site_lat=lat, site_lon=lon, north=north, east=east)
    return Problem(scenario, request, scenario.drones[0], wind, parameters=parameters)


def count_gates(monkeypatch, *, with_drones_aloft=True):
    """Record the gates that searches use; those with drones in the air can be left out."""
    used = []
    last_gates = guided_search.last_gates

    def counted(*how, **more):
        found = [one for one in last_gates(*how, **more) if with_drones_aloft or one.shut]
        used.extend(found)
        return found

    monkeypatch.setattr(guided_search, "last_gates", counted)
    return used


@pytest.mark.parametrize("target", [False, True])
@pytest.mark.parametrize("parameters", [USUAL, NEAR, FINER])
def test_in_storms_it_equals_the_exhaustive_search(monkeypatch, target, parameters):
    gates = count_gates(monkeypatch)
    for seed in range(10):
        problem = delayed(seed, parameters=parameters, target=target)
        queues = SampledQueues(problem, 0)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        search = ExactSearch(problem, queues)
        itinerary, found = best_time(search)
        assert found == pytest.approx(referee, rel=1e-6), seed
        assert search.complete
        if itinerary is not None:
            assert search.lower_bound_s <= search.best_s + 1e-6
            schedule = fly_true(problem, itinerary, queues)[0]
            assert schedule[-1, TOUCH_DOWN] - problem.depart_s == pytest.approx(found, abs=0.02), seed
            assert np.all(schedule[:, SOC_LANDING] >= problem.reserve - 1e-6), seed
    assert parameters is USUAL or len(gates) > 3


@pytest.mark.parametrize("parameters", [NEAR, FINER])
def test_where_parts_of_a_city_open_at_other_hours_it_equals_the_exhaustive_search(monkeypatch, parameters):
    gates = count_gates(monkeypatch)
    given_up = []
    is_hard = guided_search.Round.is_hard.fget
    monkeypatch.setattr(
        guided_search.Round, "is_hard", property(lambda one: given_up.append(is_hard(one)) or given_up[-1])
    )
    for seed in range(24):
        problem = patchy(seed, stations=8, sites=2, parameters=parameters)
        queues = SampledQueues(problem, 0)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        search = ExactSearch(problem, queues)
        _, found = best_time(search)
        assert found == pytest.approx(referee, rel=1e-6), seed
        assert search.complete
    assert sum(not gate.shut for gate in gates) > 3
    assert (sum(given_up) > 3) == (parameters is FINER)


def test_the_last_opening_proves_an_answer_in_few_labels(monkeypatch):
    problems = [patchy(seed, stations=80, sites=3) for seed in (38, 54)]
    found = []
    for with_drones_aloft in (True, False):
        with monkeypatch.context() as patch:
            count_gates(patch, with_drones_aloft=with_drones_aloft)
            searches = [ExactSearch(problem, SampledQueues(problem, 0)) for problem in problems]
            found.append([(best_time(search)[1], search.labels_expanded) for search in searches])
    for (arrives, labels), (same, more) in zip(*found, strict=True):
        assert arrives == pytest.approx(same, rel=1e-9)
        assert 2 * labels < more


def test_in_storms_near_the_straight_way_first_it_equals_the_search_of_the_whole_city():
    for seed in range(4):
        times = []
        for parameters in (NEAR, USUAL):
            problem = delayed(seed, parameters=parameters, stations=40)
            times.append(best_time(ExactSearch(problem, SampledQueues(problem, 0)))[1])
        assert times[0] == pytest.approx(times[1], rel=1e-9), seed


def test_nothing_arrives_before_the_bound_that_is_told_at_once():
    close = []
    for seed in range(24):
        problem = delayed(seed, sites=1 + 2 * (seed % 2))
        _, best = best_time(ExactSearch(problem, SampledQueues(problem, 0)))
        bound = float(fluid_bound_s(problem)[0]) - problem.depart_s
        assert 0.0 < bound <= best, seed
        if np.isfinite(best):
            close.append(bound / best)
    assert len(close) > 8
    assert np.median(close) > 0.3
