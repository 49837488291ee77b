"""Flights that may turn back: what comes of them in gusts and winds that nobody foresees."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EXACT, EnergyBelief
from skyway.models.flight.kernels import land, slot_end, slot_of
from skyway.models.wind.forecast import constant_wind
from skyway.planner.evaluation.evaluate import NO_ERRORS, Errors, fly_policy, sample_realizations, season_days
from skyway.planner.online.information import Departure
from skyway.planner.online.turn_back import LIKELY, TurnBacks
from skyway.planner.online.turn_back_kernels import out_or_back
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.robust.charge_policy import known_at

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)
GUSTY = Errors(energy=EXACT)
KEYS = np.random.default_rng(3).integers(0, 2**63, 3000).astype(np.uint64)


def turns_in(world, wind, errors=GUSTY, epsilon=1e-3, wind_mps=None, angle_deg=0.0):
    """Turns over the longest segment, in a forecast or in a certain wind that comes from ahead at an angle; and the segment."""
    segment = int(np.argmax(world.network.distance_m))
    origin = world.network.stations[int(world.network.tail[segment])].id
    if wind is None:
        from_deg = (float(world.network.bearing_deg[segment]) + angle_deg) % 360.0
        wind = constant_wind(wind_mps, from_deg, DEPART, HORIZON_H, 40.7, -74.0, world.rules.cruise_height_m)
    end = next(one.id for one in world.network.stations if one.id != origin)
    request = Request(state=State(DEPART, origin), destination=end, payload_kg=0.8, drone="m200")
    problem = Problem(world, request, world.drone("m200"), wind)
    known = known_at(problem, errors, measured=True, epsilon=epsilon)._replace(measured=False)
    return problem, TurnBacks(problem, known, errors.energy_of(problem.drone)), segment


def flown(problem, how, segment, charge, keys, off_s=None, member=0):
    """Times in the air, charge on landing and whether it turned back, of flights in many gusts."""
    off = problem.depart_s if off_s is None else off_s
    found = [out_or_back(problem.air, member, segment, off, charge, 1.0, key, how) for key in keys]
    seconds = np.array([down for down, _ in found]) - off
    left = charge - problem.soc_fixed - problem.soc_per_s * seconds
    return seconds, left, np.array([turned for _, turned in found])


def usual_charge(problem, segment):
    seconds = land(problem.air, 0, np.array([segment]), problem.depart_s) - problem.depart_s
    return problem.reserve + problem.soc_fixed + problem.soc_per_s * seconds


def test_without_gusts_and_with_charge_enough_it_is_a_flight_as_any(newyork):
    problem, turns, segment = turns_in(newyork, None, Errors(gust_sd=0.0, energy=EXACT), wind_mps=6.0)
    how = turns.over(segment)
    down, turned = out_or_back(problem.air, 0, segment, problem.depart_s, 1.0, 1.0, KEYS[0], how)
    assert not turned
    assert down == pytest.approx(land(problem.air, 0, np.array([segment]), problem.depart_s))


def test_with_a_charge_that_is_not_enough_it_comes_back_with_the_reserve(newyork):
    problem, turns, segment = turns_in(newyork, None, Errors(gust_sd=0.0, energy=EXACT), wind_mps=6.0)
    charge = usual_charge(problem, segment) - 0.05
    _, left, turned = flown(problem, turns.over(segment), segment, charge, KEYS[:1])
    assert turned.all()
    assert problem.reserve <= left[0] < charge - 0.1  # it looked how it goes before it turned


@pytest.mark.parametrize("angle_deg", [0.0, 60.0, 120.0, 180.0])
@pytest.mark.parametrize("more", [0.02, 0.1, 0.25])
def test_it_lands_with_the_reserve_as_often_as_was_said_wherever_the_wind_is_from(newyork, angle_deg, more):
    epsilon = 0.01
    problem, turns, segment = turns_in(newyork, None, epsilon=epsilon, wind_mps=8.0, angle_deg=angle_deg)
    usual = usual_charge(problem, segment)
    charge = usual + more * (usual - problem.reserve)
    _, left, turned = flown(problem, turns.over(segment), segment, charge, KEYS)
    assert np.mean(left < problem.reserve) <= epsilon
    assert np.mean(~turned) >= 4.0 * more - 0.1  # and does not turn for nothing
    if more == 0.25 and angle_deg == 180.0:
        assert not turned.any()  # behind the wind a quarter more is plenty


@settings(max_examples=40)
@given(
    key=st.sampled_from(KEYS.tolist()), more=st.floats(0.0, 0.4), step=st.floats(0.0, 0.2), wind=st.floats(0.0, 10.0)
)
def test_in_the_same_gusts_more_charge_never_makes_it_turn(newyork, key, more, step, wind):
    problem, turns, segment = turns_in(newyork, None, wind_mps=wind)
    usual = usual_charge(problem, segment)
    how, keys = turns.over(segment), [np.uint64(key)]
    less, most = (flown(problem, how, segment, usual + one, keys)[2][0] for one in (more, more + step))
    assert less or not most


def test_when_the_wind_changes_on_the_way_one_end_is_reached_whatever_follows(newyork):
    forecast = newyork.forecast(DEPART, HORIZON_H)
    # All members agree until the hour, then each goes its way: what is known of the wind at a take-off.
    start = forecast.slot_at(DEPART.timestamp())
    north, east = forecast.north.copy(), forecast.east.copy()
    north[:, : start + 1], east[:, : start + 1] = north[:1, : start + 1], east[:1, : start + 1]
    problem, turns, segment = turns_in(
        newyork, replace(forecast, north=north, east=east), Errors(gust_sd=0.0, energy=EXACT)
    )
    how = turns.over(segment)
    usual = usual_charge(problem, segment)
    change = float(slot_end(problem.air, slot_of(problem.air, problem.depart_s)))
    both = set()
    for ahead_s in (60.0, 180.0, 300.0, 420.0, 540.0):
        for more in (0.01, 0.03, 0.06, 0.1):
            for member in range(len(north)):
                _, left, turned = flown(problem, how, segment, usual + more, KEYS[:1], change - ahead_s, member)
                both.add(bool(turned[0]))
                assert left[0] >= problem.reserve - 1e-9, (ahead_s, more, member)
    assert both == {True, False}


def test_a_hungry_vehicle_keeps_the_reserve_too_as_far_as_it_was_believed_it_could_be(newyork):
    errors = Errors(energy=EnergyBelief(1.0, 0.025, 0.0))
    problem, turns, segment = turns_in(newyork, None, errors, epsilon=0.01, wind_mps=8.0)
    how = turns.over(segment)
    charge = usual_charge(problem, segment) + 0.03
    for energy in (0.95, 1.0, 1.05):  # of the model's; `how` counts on the most
        multiple = energy * problem.soc_per_s / how.soc_per_s
        off = problem.depart_s
        found = [out_or_back(problem.air, 0, segment, off, charge, multiple, key, how) for key in KEYS]
        seconds = np.array([down for down, _ in found]) - off
        left = charge - energy * (problem.soc_fixed + problem.soc_per_s * seconds)
        assert np.mean(left < problem.reserve) <= 0.01
        if energy < 1.0:
            assert 0.0 < np.mean([turned for _, turned in found]) < 1.0


def test_a_trial_tells_what_comes_of_it(newyork):
    problem, turns, segment = turns_in(newyork, None, wind_mps=8.0)
    how = turns.over(segment)
    taken = usual_charge(problem, segment) - problem.reserve
    charges = turns.charges(taken, 1.5)
    assert charges == sorted(charges)
    assert charges[0] > problem.reserve + taken
    shares = []
    for charge in charges:
        trial = turns.trial(segment, how, charge, problem.depart_s)
        _, left, turned = flown(problem, how, segment, charge, KEYS)
        if trial is None:
            assert np.mean(~turned) < LIKELY + 0.2
            continue
        shares.append(trial.there)
        assert trial.there == pytest.approx(np.mean(~turned), abs=0.2)  # 64 gusts: three deviations
        if turned.any() and trial.there < 1.0:
            assert trial.soc == pytest.approx(left[turned].mean(), abs=0.05)
    assert shares == sorted(shares)
    assert turns.charges(taken, problem.reserve + 0.9 * taken) == []


def test_a_flight_that_could_end_two_winds_later_is_not_tried(newyork):
    problem, turns, segment = turns_in(newyork, None, wind_mps=8.0)
    how = turns.over(segment)
    assert turns.in_time(how, 1.0, problem.depart_s)
    slow = how._replace(soc_per_s=how.soc_per_s / 10.0)  # a flight of hours
    assert not turns.in_time(slow, 1.0, problem.depart_s)
    assert turns.trial(segment, slow, 1.0, problem.depart_s) is None


@pytest.mark.parametrize("ahead_s", [120.0, 300.0, 480.0])
def test_gusts_and_the_next_wind_together_break_the_reserve_as_seldom_as_was_said(newyork, ahead_s):
    forecast = newyork.forecast(DEPART, HORIZON_H)
    start = forecast.slot_at(DEPART.timestamp())
    north, east = forecast.north.copy(), forecast.east.copy()
    north[:, : start + 1], east[:, : start + 1] = north[:1, : start + 1], east[:1, : start + 1]
    epsilon = 0.01
    problem, turns, segment = turns_in(newyork, replace(forecast, north=north, east=east), epsilon=epsilon)
    how = turns.over(segment)
    usual = usual_charge(problem, segment)
    change = float(slot_end(problem.air, slot_of(problem.air, problem.depart_s)))
    for more in (0.02, 0.06, 0.12):
        found = [
            flown(problem, how, segment, usual + more, KEYS[member :: len(north)], change - ahead_s, member)[1]
            for member in range(len(north))
        ]
        assert np.mean(np.concatenate(found) < problem.reserve) <= epsilon


class GoesOnceTooSoon:
    """Takes off with what it has, which is not enough; after that with a full battery."""

    def __init__(self, segment, turn_back):
        self.segment, self.turn_back, self.asked = segment, turn_back, 0

    def leave(self, standing):
        self.asked += 1
        if standing.visited:
            return Departure((self.segment,), 1.0, lambda _: 1.0)
        return Departure((self.segment,), standing.soc, lambda _: standing.soc, turn_back=self.turn_back)

    def over(self, flying, rest):
        raise AssertionError("there is nothing on the way")


def test_a_flight_that_turned_back_lands_where_it_took_off_and_the_delivery_goes_on(newyork):
    network = newyork.network
    segment = int(np.argmax(np.where(network.pads[network.tail] > 0, network.distance_m, 0.0)))
    origin, end = (network.stations[int(node[segment])].id for node in (network.tail, network.head))
    request = Request(state=State(DEPART, origin), destination=end, payload_kg=0.8, drone="m200")
    days = season_days(newyork, request, 1, seed=2)
    calm = sample_realizations(newyork, request, days, runs=1, errors=NO_ERRORS)
    charge = usual_charge(calm.problem("m200"), segment) - 0.05
    low = replace(request, state=replace(request.state, soc=charge))
    realizations = sample_realizations(newyork, low, days, runs=1, errors=NO_ERRORS)
    problem = realizations.problem("m200")
    known = known_at(problem, NO_ERRORS, measured=True, epsilon=1e-3)
    policy = GoesOnceTooSoon(segment, TurnBacks(problem, known, EXACT).over(segment))
    flown_, done = fly_policy(realizations, "m200", policy)
    assert [leg.segments for leg in done[0]] == [(segment, policy.turn_back.back), (segment,)]
    assert flown_.delivered.all()
    assert not flown_.below_reserve.any()
    assert flown_.lowest_soc[0] < charge
    assert flown_.delivery_s[0] == pytest.approx((flown_.flight_s + flown_.wait_s + flown_.recharge_s)[0])
