"""Speeds over segments: the bound that searches cut by is one."""

import numpy as np
import pytest

from skyway.planner.problem.problem import Problem
from skyway.planner.problem.speeds import MeanSpeeds
from tests.planner.worlds import make_request, make_wind, make_world


@pytest.mark.parametrize("mean_mps", [3.0, 9.0])
@pytest.mark.parametrize("number", range(10))
def test_no_mean_speed_exceeds_the_bound_of_its_slots(number, mean_mps):
    rng = np.random.default_rng((0x5BEED, number))
    scenario = make_world(rng, 6)
    wind = make_wind(rng, members=8, mean_mps=mean_mps)
    problem = Problem(scenario, make_request(scenario, rng), scenario.drones[0], wind)
    speeds = MeanSpeeds(problem.air, problem.probability, 4.0)
    every = np.arange(len(problem.network.head))
    for first, last in [(0, 0), (0, 2), (1, 4), (3, 30)]:
        assert speeds.over(first, last, every).max() <= speeds.fastest_mps(first, last) + 1e-9
    assert speeds.over(0, 4, every).max() > 0.0
    assert speeds.fastest_mps(0, 4) == max(speeds.fastest_mps(slot, slot) for slot in range(5))
