"""The exhaustive search is the referee: it must be exact, and its plans must fly."""

import math

import numpy as np
import pytest
from referee_grid import Grid
from worlds import make_request, make_wind, make_world

from skyway.models.base.errors import NoRouteError
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.problem.problem import Problem
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN


def instance(seed, **world):
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, **({"stations": 5} | world))
    wind = make_wind(rng, mean_mps=float(rng.choice([2.0, 3.0, 5.0])))
    reserve = float(rng.choice([0.1, 0.2, 0.5]))
    problem = Problem(scenario, make_request(scenario, rng, reserve_soc=reserve), scenario.drones[0], wind)
    return problem, problem.queue_paths(range(len(scenario.network)), 0)


def solve(problem, queues):
    search = ExhaustiveSearch(problem, queues)
    try:
        itinerary = search.solve()
    except NoRouteError:
        return None, math.inf
    schedule = fly_true(problem, itinerary, queues)[0]
    return schedule, float(schedule[-1, TOUCH_DOWN]) - problem.depart_s


@pytest.mark.parametrize("seed", range(40))
def test_it_is_never_worse_than_a_search_on_a_grid_of_times_nor_much_better(seed):
    problem, queues = instance(seed, utilisation=0.8, target=seed % 4 == 3)
    _, time = solve(problem, queues)
    grid = Grid(problem, queues).delivery_time_s()
    if math.isinf(time):
        assert math.isinf(grid)
        return
    if math.isinf(grid):
        assert time > 6.5 * 3600.0, "the grid ends after 7 hours"
        return
    assert time <= grid + 1e-3
    assert grid - time <= 60.0 + 0.01 * time


@pytest.mark.parametrize("seed", range(100, 160))
def test_its_plan_flown_in_the_truth_keeps_the_reserve_and_arrives_when_it_says(seed):
    problem, queues = instance(seed, stations=8, length_m=55_000.0, utilisation=0.9)
    search = ExhaustiveSearch(problem, queues)
    try:
        itinerary = search.solve()
    except NoRouteError:
        return
    schedule = fly_true(problem, itinerary, queues)[0]
    assert np.all(schedule[:, SOC_LANDING] >= problem.reserve - 1e-6)
    assert schedule[-1, TOUCH_DOWN] == pytest.approx(search.best_s, abs=0.02)
    assert search.complete


def test_many_of_these_worlds_have_an_answer_with_recharging():
    legs = [
        schedule
        for schedule, _ in (solve(*instance(seed, utilisation=0.8, target=seed % 4 == 3)) for seed in range(40))
    ]
    assert sum(schedule is not None and len(schedule) > 1 for schedule in legs) >= 20
    assert sum(schedule is None for schedule in legs) >= 3


def test_a_time_limit_is_kept_and_told():
    problem, queues = instance(3, stations=9)
    search = ExhaustiveSearch(problem, queues, time_limit_s=1e-9)
    with pytest.raises(NoRouteError):
        search.solve()
    assert not search.complete
