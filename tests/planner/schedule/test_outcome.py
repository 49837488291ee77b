"""What simulated deliveries say as a whole."""

import numpy as np
from worlds import make_request, make_wind, make_world

from skyway.planner.problem.problem import Problem
from skyway.planner.schedule.outcome import outcome
from skyway.planner.schedule.schedule_kernels import COLUMNS


def test_if_none_arrives_the_probability_of_an_arrival_is_zero_though_weights_do_not_add_up_to_one():
    rng = np.random.default_rng(1)
    scenario = make_world(rng)
    problem = Problem(scenario, make_request(scenario, rng), scenario.drones[0], make_wind(rng))
    weight = np.array([0.5, 0.5 - 1e-16])
    assert weight.sum() < 1.0
    found = outcome(problem, np.full((2, 3, COLUMNS), np.inf), weight)
    assert found.p_arrive == 0.0
    assert len(found.arrival_s) == 0
