"""What a plan says that a leg takes, what `check` says of its mission and what a supervisor expects at take-off are one energy.

What differs has a name. A plan counts the hover before a landing for which there is no room yet, which nobody else knows of. A
mission commands one ground speed for a leg, in whole centimetres a second.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from skyway.missions import FlightConditions, MissionOptions, check, family_named, leg_mission
from skyway.missions.checks.weather import ForecastWind
from skyway.models.base.errors import InfeasibleError
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.flight.energy import FlightPower
from skyway.models.flight.kernels import land
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.reach.reach import Reach

WORLDS = 5
COMMANDED_MPS = 0.01


def random_plans(members, slots, *, highest_m=40.0):
    """Plans on flat ground with their worlds; the wind is constant where there is one slot, else it changes every ten minutes."""
    for seed in range(WORLDS):
        rng = np.random.default_rng(seed)
        scenario = make_world(rng)
        if highest_m > 40.0:
            hills = tuple(replace(one, elevation_m=rng.uniform(40.0, highest_m)) for one in scenario.network.stations)
            scenario = replace(scenario, network=replace(scenario.network, stations=hills))
        wind = make_wind(rng, members=members, slots=slots, slot_s=600.0, turn_back=10.0, mean_mps=4.0)
        request = make_request(scenario, rng)
        try:
            one = wind if members == 1 else wind.member(0)
            yield scenario, wind, request, plan(scenario, request, planner="shortest", forecast=one).composition
        except InfeasibleError:
            continue


def expected_at_take_off(scenario, wind, composition, leg):
    """Charge that a leg takes in each member by what a supervisor asks."""
    drone = scenario.drones[0]
    reach = Reach(scenario, wind, drone, composition.payload_kg, EnergyBelief(), airspeed_mps=composition.airspeed_mps)
    way = reach.way(leg.origin, leg.via, leg.destination)
    return reach.to_the_end(way, leg.depart.timestamp(), climbs=True).soc


@pytest.mark.parametrize("slots", [1, 48])
def test_plan_check_and_take_off_agree_about_the_energy_of_a_leg(slots):
    compared = 0
    for scenario, wind, _, composition in random_plans(1, slots):
        drone, rules = scenario.drones[0], scenario.rules
        power = FlightPower.of(drone, composition.payload_kg)
        for number, leg in enumerate(composition.services):
            cruise_s = leg.distance_m / leg.ground_speed_mps
            spent_s = (leg.arrive - leg.depart).total_seconds()
            hover_j = power.cruise_w * (spent_s - rules.climb_s - cruise_s - rules.descent_s)
            assert hover_j > -2.0  # times are told to the millisecond
            planned_j = leg.energy_j - hover_j
            expected_j = float(expected_at_take_off(scenario, wind, composition, leg)[0]) * drone.battery_j
            assert expected_j == pytest.approx(planned_j, abs=2.0)
            conditions = FlightConditions(
                drone, composition.payload_kg, leg.soc_depart, composition.reserve_soc,
                rules.climb_rate_mps, rules.descent_rate_mps, ForecastWind(wind, leg.depart.timestamp(), 0.2),
            )  # fmt: skip
            export = leg_mission(composition, number, family_named("px4"), MissionOptions())
            (checked,) = check(export.documents[0], conditions=conditions).legs
            rounding_j = power.cruise_w * cruise_s * COMMANDED_MPS / leg.ground_speed_mps
            if checked.least_airspeed_margin_mps < 0.0:  # a slot's wind does not allow it: it is flown slower there
                assert checked.energy_j > planned_j - 2.0 - rounding_j
            else:
                assert checked.energy_j == pytest.approx(planned_j, abs=2.0 + rounding_j)
            compared += 1
    assert compared >= 10


@pytest.mark.parametrize("highest_m", [40.0, 300.0])
def test_a_take_off_expects_in_each_member_what_planners_fly_in_it(highest_m):
    compared = 0
    for scenario, wind, request, composition in random_plans(5, 48, highest_m=highest_m):
        problem = Problem(scenario, replace(request, drone=composition.drone), scenario.drones[0], wind)
        network = problem.network
        ends = list(zip(network.tail.tolist(), network.head.tolist(), strict=True))
        for leg in composition.services:
            nodes = [network.index[name] for name in (leg.origin, *leg.via, leg.destination)]
            segments = np.array([ends.index(pair) for pair in pairwise(nodes)])
            found = expected_at_take_off(scenario, wind, composition, leg)
            for member, soc in enumerate(found.tolist()):
                flight_s = land(problem.air, member, segments, leg.depart.timestamp()) - leg.depart.timestamp()
                if flight_s < np.inf and (
                    highest_m == 40.0 or not leg.via
                ):  # between hills a leg over stations is higher
                    assert soc == pytest.approx(problem.soc_fixed + problem.soc_per_s * flight_s, abs=1e-6)
                    compared += 1
    assert compared >= (20 if highest_m == 40.0 else 5)
