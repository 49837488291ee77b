"""The online policy in evaluations: what it is told, and that it is as good as perfect information where it has that."""

import math
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from bellevue_flights import DEPART
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.composition.composition import State
from skyway.planner.evaluation.evaluate import NO_ERRORS, clairvoyant_times, fly_policy, sample_realizations
from skyway.planner.evaluation.policies import Standing
from skyway.planner.online.evaluated import MOST_SEEN, RollingRobust, with_measured
from skyway.planner.online.information import Departure
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.request import Request

HOURS = 12
DAY = date(2013, 7, 10)


@pytest.fixture(scope="module")
def forecast(newyork):
    return newyork.forecast(DEPART, HOURS)


def standing(forecast, time_s, winds):
    wind, *before = [(np.array(north), np.array(east)) for north, east in winds]
    return Standing(0, "bellevue", time_s, 1.0, (), wind, {}, (), before=tuple(before))


@given(st.integers(0, HOURS - 2), st.floats(0.0, 0.999), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_the_wind_that_was_measured_is_that_of_all_of_its_hour(forecast, hour, into, north, east):
    time_s = forecast.start_s + (hour + into) * forecast.slot_s
    sites = len(forecast.site_lat)
    told = with_measured(forecast, standing(forecast, time_s, [([north] * sites, [east] * sites)]))
    for then in (0.0, 0.5, 0.999):
        at_s = forecast.start_s + (hour + then) * forecast.slot_s
        found = told.at_times(forecast.site_lat, forecast.site_lon, np.full(sites, at_s))
        np.testing.assert_allclose(found[0], north, atol=0.01)
        np.testing.assert_allclose(found[1], east, atol=0.01)


def test_a_day_that_went_the_same_way_so_far_is_the_more_probable_one(forecast):
    alike, other = 0, 1
    two = replace(
        forecast,
        north=np.array(forecast.north[[alike, alike]]),
        east=np.array(forecast.east[[alike, alike]]),
        probability=np.array([0.5, 0.5]),
        labels=tuple(forecast.labels[:2]),
    )
    two.north[other, :3] += 4.0  # both have the same wind from the fourth hour on
    time_s = two.start_s + 3.5 * two.slot_s
    winds = [(two.north[alike, hour], two.east[alike, hour]) for hour in (3, 2, 1, 0)]
    now_alone = with_measured(two, standing(two, time_s, winds[:1]))
    np.testing.assert_allclose(now_alone.probability, 0.5)
    told = with_measured(two, standing(two, time_s, winds))
    assert told.probability[alike] > 0.9


def test_of_many_sites_only_the_last_hours_count(forecast):
    sites = MOST_SEEN // 2 + 1
    grown = np.linspace(0.0, 0.5, sites)
    many = replace(
        forecast,
        site_lat=forecast.site_lat[0] + grown,
        site_lon=forecast.site_lon[0] + grown,
        north=np.repeat(forecast.north[:, :, :1], sites, axis=2),
        east=np.repeat(forecast.east[:, :, :1], sites, axis=2),
    )
    time_s = many.start_s + 2.5 * many.slot_s
    winds = [([speed] * sites, [speed] * sites) for speed in (3.0, -5.0, 7.0)]
    with_all, with_last = (with_measured(many, standing(many, time_s, told)) for told in (winds, winds[:1]))
    np.testing.assert_array_equal(with_all.north, with_last.north)
    np.testing.assert_array_equal(with_all.probability, with_last.probability)


def test_who_waits_is_asked_at_each_new_wind_however_long_it_waits(newyork):
    asked_s = []

    class Waiting:
        def leave(self, standing):
            asked_s.append(standing.time_s)
            return Departure((), 1.0, lambda _: math.inf)

        def over(self, flying, rest):
            raise AssertionError

    request = Request(state=State(DEPART, "bellevue"), destination="jacobi", payload_kg=0.8, drone="m200")
    realizations = sample_realizations(newyork, request, [DAY], runs=1, errors=NO_ERRORS, seed=5)
    fly_policy(realizations, "m200", Waiting(), np.arange(1))
    winds_s = np.arange(asked_s[0], asked_s[-1] + 1.0, realizations.wind.slot_s)
    assert len(winds_s) > 30
    assert set(winds_s) <= set(asked_s)


def test_who_knows_the_wind_loses_next_to_nothing(newyork):
    """Charges that are just enough are enough: without gusts and in the wind as it will be, only the queues are unknown."""
    best_s = flown_s = 0.0
    for origin in ("siuh-north", "coney-island", "kings-county", "brooklyn-hospital"):
        request = Request(state=State(DEPART, origin), destination="white-plains", payload_kg=0.8, drone="m200")
        realizations = sample_realizations(newyork, request, [DAY], runs=2, errors=NO_ERRORS, seed=5)
        best, _, _ = clairvoyant_times(realizations, "m200", "exact", range(2))
        start = Problem(newyork, request, newyork.drone("m200"), realizations.wind.member(0))
        flown, _ = fly_policy(realizations, "m200", RollingRobust(start, NO_ERRORS), np.arange(2))
        assert not flown.below_reserve.any()
        best_s, flown_s = best_s + float(best.sum()), flown_s + float(flown.delivery_s.sum())
    assert best_s <= flown_s <= 1.012 * best_s
