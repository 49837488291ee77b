"""What is tabled of flights is what flying them in every member gives."""

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from skyway.models.flight.kernels import leg, slot_of
from skyway.planner.lookahead.flight_kernels import least_time, lower_time, mean_flight
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.problem.problem import Problem


def make_outlook(seed, mean_mps):
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, 6, length_m=50_000.0)
    wind = make_wind(rng, members=25, mean_mps=mean_mps, slot_s=900.0)
    return Lookahead(Problem(scenario, make_request(scenario, rng), scenario.drones[0], wind)), rng


def flown(problem, air, segment, time_s):
    """Mean time and greatest charge of a flight, from each member's own take-off and touch-down."""
    flights = np.array([leg(air, member, segment, time_s) for member in range(len(problem.probability))])
    off, down = flights[np.isfinite(flights[:, 1])].T
    if not len(off):
        return np.inf, np.inf
    at_once = off <= time_s
    mean = np.mean((down - time_s)[at_once] if at_once.any() else down - time_s)
    return mean, problem.soc_fixed + problem.soc_per_s * np.max(down - off)


@pytest.mark.parametrize("mean_mps", [3.0, 8.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_flight_takes_what_it_takes_in_each_member_whenever_it_leaves(seed, mean_mps):
    lookahead, rng = make_outlook(seed, mean_mps)
    problem = lookahead.problem
    for time_s in problem.depart_s + rng.uniform(-1800.0, 14 * 3600.0, 60):
        segment = int(rng.integers(len(problem.network.tail)))
        mean, charge, _ = lookahead.flight(segment, time_s)
        assert (mean, charge) == pytest.approx(flown(problem, problem.air, segment, time_s), abs=1e-5)


@pytest.mark.parametrize("mean_mps", [3.0, 8.0])
def test_no_flight_to_the_destination_takes_less_than_its_bound(mean_mps):
    lookahead, rng = make_outlook(7, mean_mps)
    direct, need = lookahead.world.direct, lookahead.need
    tight = 0
    for time_s in lookahead.problem.depart_s + rng.uniform(0.0, 14 * 3600.0, 100):
        node = int(rng.integers(len(lookahead.problem.network) - 1))
        mean = mean_flight(direct, need, node, time_s)
        bound = lower_time(direct, slot_of(direct.air, time_s), node)
        assert mean == pytest.approx(flown(lookahead.problem, direct.air, node, time_s)[0], abs=1e-5)
        assert bound <= mean + 1e-6
        tight += bound > least_time(direct.air, node)
    assert tight > 20
