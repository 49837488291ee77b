"""Exact composition equals the exhaustive search, faster, and never claims what does not fly."""

import math

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from models.errors import NoRouteError
from planner.course_kernels import SOC_DOWN, TOUCH_DOWN
from planner.exact import ExactSearch
from planner.ies import ExhaustiveSearch
from planner.itinerary import fly_true
from planner.problem import Problem

RELATIVE = 1e-6


def instance(seed):
    """Up to 10 stations; calm to strong and turning wind, short to long queues, easy to impossible reserves."""
    rng = np.random.default_rng(seed)
    stations = int(rng.integers(4, 11))
    scenario = make_world(
        rng,
        stations,
        length_m=9_000.0 * stations,
        utilisation=float(rng.choice([0.0, 0.5, 0.9, 1.2])),
        target=seed % 4 == 3,
    )
    wind = make_wind(rng, mean_mps=float(rng.choice([1.0, 4.0, 7.0])), turning=float(rng.choice([10.0, 60.0])))
    reserve = float(rng.choice([0.1, 0.2, 0.3, 0.5]))
    request = make_request(scenario, rng, reserve_soc=reserve, payload_kg=float(rng.uniform(0.0, 1.0)))
    problem = Problem(scenario, request, scenario.drones[0], wind)
    return problem, problem.queue_paths(range(stations), 0)


def best_time(search):
    try:
        itinerary = search.solve()
    except NoRouteError:
        return None, math.inf
    return itinerary, search.best_s - search.problem.depart_s


def compare(seeds):
    """Relative differences to the exhaustive search; every answer is flown in the truth."""
    differences, infeasible = [], 0
    for seed in seeds:
        problem, queues = instance(seed)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        itinerary, exact = best_time(ExactSearch(problem, queues))
        if itinerary is None:
            assert math.isinf(referee), seed
            infeasible += 1
            continue
        course = fly_true(problem, itinerary, queues)[0]
        assert course[-1, TOUCH_DOWN] - problem.depart_s == pytest.approx(exact, abs=0.02), seed
        assert np.all(course[:, SOC_DOWN] >= problem.reserve - 1e-6), seed
        differences.append((exact - referee) / referee)
    return np.array(differences), infeasible


def test_it_equals_the_exhaustive_search():
    differences, infeasible = compare(range(150))
    assert np.max(np.abs(differences)) <= RELATIVE
    assert len(differences) >= 50
    assert infeasible >= 10


@pytest.mark.slow
def test_it_equals_the_exhaustive_search_a_thousand_times():
    differences, infeasible = compare(range(1000, 2600))
    assert np.max(differences) <= RELATIVE, "never above it"
    assert np.mean(np.abs(differences)) <= 1e-4
    assert np.max(np.abs(differences)) <= 1e-3
    assert len(differences) + infeasible >= 1000
    print(f"{len(differences)} solved, {infeasible} infeasible, largest difference {np.max(np.abs(differences)):.2e}")
