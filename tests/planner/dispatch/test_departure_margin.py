"""Margins that a fleet is planned with: what the check before a take-off wants, by the same check."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import DEPART, make_wind, make_world, on_level_ground

from skyway.models.composition.composition import State
from skyway.planner.dispatch.departure_margin import LONGEST, SHORTEST, departure_margin, fitted
from skyway.planner.online.departure_gate import DepartureGate
from skyway.planner.online.following import Step
from skyway.planner.online.information import Information
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.request import Request


def margin(scenario, wind, **more):
    return departure_margin(scenario, wind, DEPART, scenario.drones[0].id, USUAL, drag=None, reserve=0.2, **more)


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(3)
    scenario = on_level_ground(make_world(rng, stations=7))
    return scenario, make_wind(rng, mean_mps=5.0, turn_back=0.0)


@pytest.mark.slow
def test_it_is_within_what_the_check_wants_of_all_legs(world):
    scenario, wind = world
    network = scenario.network
    request = Request(
        state=State(DEPART, "s0", None, 1.0),
        destination="s1",
        payload_kg=0.0,
        drone=scenario.drones[0].id,
        escape=False,
    )
    policy = OnlinePolicy(scenario, request, USUAL)
    found = []
    for segment in range(len(network.tail)):
        station = network.stations[int(network.tail[segment])].id
        info = Information(
            time_s=DEPART.timestamp(), soc=1.0, forecast=wind, belief=scenario.drones[0].energy_belief, station=station
        )
        p = policy.problem(info)
        takes = p.soc_fixed + p.soc_per_s * float(p.fastest_s((segment,)))
        least = DepartureGate(policy, info, p).check(Step((segment,), 1.0)).soc
        if SHORTEST <= takes <= LONGEST:
            found.append(((1.0 if least is None else least) - 0.2) / takes - 1.0)
    known = margin(scenario, wind)
    assert min(found) - 1e-6 <= known.of(np.array([5.0])) <= max(found) + 1e-6
    assert min(found) - 1e-6 <= known.of(np.array([20.0])) <= max(found) + 1e-6


@pytest.mark.slow
def test_it_grows_with_what_is_not_known_of_the_wind(world):
    scenario, wind = world
    calm = replace(wind, north=0.0 * wind.north, east=0.0 * wind.east)
    along = np.concatenate([calm.east - 5.0, calm.east, calm.east + 5.0])
    either = replace(
        calm, north=0.0 * along, east=along, probability=np.full(3, 1.0 / 3.0), labels=("west", "calm", "east")
    )
    fast = np.array([15.0])
    assert margin(scenario, either).of(fast) > margin(scenario, calm).of(fast) + 0.02


@given(share=st.floats(0.2, 2.0), pace=st.floats(0.0, 20.0), count=st.integers(4, 20), seed=st.integers(0, 2**16))
def test_what_legs_want_on_a_line_is_found_again(share, pace, count, seed):
    speed = np.random.default_rng(seed).uniform(5.0, 20.0, count)
    wanted = np.maximum(share + pace / speed, 1.0)
    known = fitted(speed, wanted)
    assert known.least == pytest.approx(wanted.min())
    assert ((known.least - 1.0 - 1e-9 <= known.of(speed)) & (known.of(speed) <= known.most - 1.0 + 1e-9)).all()
    if (wanted > 1.0).all() and np.ptp(1.0 / speed) > 1e-3:
        assert known.of(speed) == pytest.approx(wanted - 1.0, abs=1e-6)


def test_few_legs_are_all_alike():
    assert fitted(np.array([10.0, 12.0]), np.array([1.5, 1.5])).of(np.array([3.0, 20.0])) == pytest.approx([0.5, 0.5])


def test_without_legs_there_is_none(world):
    scenario, wind = world
    stations = tuple(replace(one, pads=1 if number == 0 else 0) for number, one in enumerate(scenario.network.stations))
    alone = replace(scenario, network=replace(scenario.network, stations=stations))
    assert margin(alone, wind) is None
