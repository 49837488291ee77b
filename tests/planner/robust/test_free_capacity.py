"""Free capacity: how likely a station has room for a drone that flies there, by who is there now and who comes in which hours."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.composition.composition import State
from skyway.models.queues.load import PadLoad, hours_of_week
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.robust.free_capacity import (
    blocking_probabilities,
    blocking_probability_after,
    likely_free,
    no_place_probability,
    room_at,
    turned_for_room_probability,
)
from skyway.planner.robust.free_capacity_kernels import FreeCapacity, chance_full, expected, is_room
from tests.planner.worlds import make_request, make_wind, make_world
from tests.sampled_paths import sample_path

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


def leaving(scenario, at=DEPART):
    request = Request(state=State(at, "siuh-north"), destination="white-plains", payload_kg=0.8)
    return Problem(scenario, request, scenario.drone("m200"), scenario.forecast(at, HORIZON_H))


def test_the_chance_of_a_full_station_is_that_of_simulated_arrivals_and_departures():
    rng = np.random.default_rng(2)
    arrivals, services, pads, spots = 1.6, 0.3, 3, 1
    for present in range(7):
        came = rng.poisson(arrivals, 200_000)
        left = rng.poisson(services * min(pads, present), 200_000)
        share = float(np.mean(came - left >= pads + spots - present))
        assert chance_full(pads, spots, arrivals, services, present) == pytest.approx(share, abs=0.004)


@given(present=st.integers(0, 9), arrivals=st.floats(0.01, 6.0), services=st.floats(0.0, 2.0))
def test_more_others_make_a_full_station_likelier_and_more_spots_do_not(present, arrivals, services):
    chance = chance_full(4, 4, arrivals, services, present)
    assert 0.0 <= chance <= 1.0 + 1e-12
    assert chance_full(4, 5, arrivals, services, present) <= chance + 1e-12
    assert chance_full(4, 4, arrivals * 1.5, services, present) >= chance - 1e-12


@given(
    rates=st.lists(st.floats(0.0, 0.01), min_size=1, max_size=5),
    begin_s=st.floats(0.0, 20_000.0),
    first_s=st.floats(0.0, 20_000.0),
    then_s=st.floats(0.0, 20_000.0),
)
def test_expected_arrivals_are_the_sum_over_every_second_and_over_parts_of_a_flight(rates, begin_s, first_s, then_s):
    per_s, middle_s, end_s = np.array(rates), begin_s + first_s, begin_s + first_s + then_s
    whole = expected(per_s, begin_s, end_s)
    assert whole == pytest.approx(expected(per_s, begin_s, middle_s) + expected(per_s, middle_s, end_s), abs=1e-9)
    seconds = np.arange(begin_s, end_s, 10.0)
    summed = 10.0 * per_s[np.minimum(seconds // 3600.0, len(per_s) - 1).astype(int)].sum()
    assert whole == pytest.approx(summed, abs=0.4)


def test_room_is_judged_in_the_hours_of_the_flight():
    quiet, busy = 0.0, 20.0 / 3600.0  # the second hour is busy
    room = FreeCapacity(
        np.array([2]), np.array([1]), 0.0, np.array([[quiet, busy, quiet]]), np.array([[1.0 / 3600.0] * 3]), 0.01
    )
    roomy = [is_room(room, 0, 1, time_s, 600.0) for time_s in (0.0, 2900.0, 3300.0, 3600.0, 6600.0, 7200.0)]
    assert roomy == [True, True, False, False, False, True]


def test_a_station_that_is_busy_at_night_is_used_by_day(newyork):
    arrivals = np.array(newyork.load.arrivals_per_s)
    node = newyork.network.index["belvedere"]
    hours = hours_of_week(newyork.load.timezone, DEPART.timestamp(), 12)
    arrivals[node] = 0.0
    arrivals[node, hours[6:]] = 0.02  # from six hours after the departure on
    evening = replace(newyork, load=replace(newyork.load, arrivals_per_s=arrivals))

    early, late = leaving(evening), leaving(evening, DEPART + timedelta(hours=6))
    away_s = np.full(len(early.network), 900.0)
    assert blocking_probabilities(early)[node] == pytest.approx(0.0, abs=1e-9)
    assert blocking_probabilities(late)[node] > 0.5
    assert likely_free(early, 0.001, away_s)[node]
    assert not likely_free(late, 0.001, away_s)[node]


def test_those_present_are_those_who_came_and_have_not_left():
    rates, times = (np.full(80, 4.0 / 3600.0), np.full(80, 1.0 / 3600.0)), (0.0, 7200.0, 26 * 3600.0)
    for busy in (0, 2, 9):
        path = sample_path(np.random.default_rng(3), 5, 4, rates, times, busy)
        assert path.present_at(7200.0) == busy
        previous = path.present_at(7200.0)
        for time in np.unique(np.concatenate((path.arrival_s, path.left_s))):
            if time > 7200.0 + 24 * 3600.0:
                break
            step = int((path.arrival_s == time).sum()) - int((path.left_s == time).sum())
            now = path.present_at(float(time))
            assert now == previous + step >= 0
            previous = now
        # who arrives when a pad is free waits for none
        for time in np.linspace(7300.0, 80_000.0, 60):
            assert (path.present_at(float(time)) < 5) == (float(path.pad_time(time)) <= time)


def test_who_comes_after_a_drone_and_the_time_it_is_away_take_its_room(newyork):
    problem = leaving(newyork)
    chances = [blocking_probability_after(problem, away_s, behind=0) for away_s in (0.0, 600.0, 3600.0)]
    assert chances == sorted(chances)
    assert chances[0] < blocking_probability_after(problem, 0.0, behind=100) == 1.0


def test_a_target_without_pads_always_has_room():
    """A load that names every station (``*``) says nothing of one without pads."""
    rng = np.random.default_rng(2)
    scenario = make_world(rng, 4, target=True)
    busy = PadLoad(np.full((4, 168), 5.0 / 3600.0), np.full((4, 168), 3600.0), "UTC")
    scenario = replace(scenario, load=busy)
    problem = Problem(scenario, make_request(scenario, rng), scenario.drones[0], make_wind(rng))
    room = room_at(problem, [1, 3], 1e-3)
    assert (room.arrivals_per_s[0] > 0.0).all()
    assert (room.arrivals_per_s[1] == 0.0).all()


@given(
    present=st.integers(0, 14),
    away_s=st.floats(0.0, 3000.0),
    hover_s=st.floats(0.0, 3000.0),
    more=st.floats(0.0, 2000.0),
)
def test_the_longer_a_drone_can_hover_the_more_probably_it_finds_a_place(newyork, present, away_s, hover_s, more):
    node, now_s = newyork.network.index["bellevue"], DEPART.timestamp()

    def chance(count, seconds):
        return no_place_probability(newyork, node, count, now_s, now_s + away_s, seconds)

    assert 0.0 <= chance(present, hover_s + more) <= chance(present, hover_s) <= 1.0
    assert chance(present, hover_s) <= chance(present + 1, hover_s) + 1e-12


def test_a_flight_is_turned_for_room_as_often_as_others_drawn_one_by_one_come(newyork):
    """Judge: who is there halfway is drawn, and the chance from then on is asked for."""
    node, now_s, draws, most = newyork.network.index["bellevue"], DEPART.timestamp(), 100_000, 0.05
    station, load = newyork.network.stations[node], newyork.load
    hour = hours_of_week(load.timezone, now_s, 1)[0]
    room = station.pads + station.holding_spots
    rng = np.random.default_rng(3)
    seen = []
    for present in range(room - 3, room + 1):
        leaves_s, lands_s, hover_s = now_s + 300.0, now_s + 1500.0, 120.0
        half_s = 0.5 * (leaves_s + lands_s) - now_s
        came = rng.poisson(load.arrivals_per_s[node, hour] * half_s, draws)
        left = rng.poisson(min(station.pads, present) / load.mean_charging_s[node, hour] * half_s, draws)
        there = present + came - left
        then = [
            no_place_probability(newyork, node, count, now_s + half_s, lands_s, hover_s) for count in range(room + 1)
        ]
        least = next(count for count, chance in enumerate(then) if chance > most)
        chance = turned_for_room_probability(newyork, node, present, now_s, leaves_s, lands_s, hover_s, most)
        assert chance == pytest.approx(float(np.mean(there >= least)), abs=0.005)
        seen.append(chance)
    assert seen == sorted(seen)
    assert seen[0] < seen[-1]


def test_those_who_come_before_a_drone_and_those_who_leave_while_it_hovers_are_counted(newyork):
    """Against numbers drawn one by one."""
    node, now_s, draws = newyork.network.index["bellevue"], DEPART.timestamp(), 200_000
    station, load = newyork.network.stations[node], newyork.load
    hour = hours_of_week(load.timezone, now_s, 1)[0]
    rng = np.random.default_rng(1)
    for present, away_s, hover_s in ((9, 1200.0, 0.0), (9, 1200.0, 600.0), (10, 1800.0, 1500.0)):
        came = rng.poisson(load.arrivals_per_s[node, hour] * away_s, draws)
        leaving = min(station.pads, present) / load.mean_charging_s[node, hour]
        left = rng.poisson(leaving * (away_s + hover_s), draws)
        share = float(np.mean(came - left >= station.pads + station.holding_spots - present))
        chance = no_place_probability(newyork, node, present, now_s, now_s + away_s, hover_s)
        assert chance == pytest.approx(share, abs=0.004)
        assert 0.0 < chance < 1.0
