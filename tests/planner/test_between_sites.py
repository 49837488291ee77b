"""Wind that no site tells: how often a plan breaks the reserve in it, and how often it is turned, against drawn fields of wind."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from drawn_winds import drawn_times

from skyway.models.base.geodesy import distance_m
from skyway.models.composition.composition import State
from skyway.models.wind.forecast import constant_wind
from skyway.plan_document import between_sites_words
from skyway.planner.between_sites import between_sites, chance_above, slower_sd_s
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN

DEPART = datetime(2013, 7, 10, 18, 0, tzinfo=UTC)


@pytest.fixture(scope="module")
def answer(newyork):
    request = Request(state=State(DEPART, "siuh-north"), destination="white-plains", payload_kg=0.8, drone="m300")
    return plan(newyork, request).robust


def test_flights_break_the_reserve_as_often_as_in_drawn_winds(answer):
    problem, runs, rng = answer.policy.problem, answer.out_of_sample, np.random.default_rng(3)
    met, told = [], []
    for leg, flight in enumerate(answer.policy.itinerary):
        for run in rng.choice(len(runs.weight), 12, replace=False):
            off_s = runs.schedule[run, leg, TAKE_OFF]
            if not np.isfinite(runs.schedule[run, leg, TOUCH_DOWN]):
                continue
            member = int(runs.member[run])
            slot = int((off_s - problem.air.start_s) // problem.air.slot_s)
            times = drawn_times(problem, flight.segments, member, slot, rng, 400)
            sd_s = slower_sd_s(problem, flight.segments, np.array([member]), np.array([off_s]))[0]
            cost = runs.energy[run, leg] * problem.soc_per_s
            left = runs.schedule[run, leg, SOC_LANDING] - problem.reserve
            met.append((cost * (times - np.median(times)) > left).mean())
            told.append(float(chance_above(np.array([left]), cost * sd_s)[0]))
    assert np.mean(told) > 0.002
    assert np.mean(told) == pytest.approx(np.mean(met), rel=0.35, abs=0.004)


def test_what_is_turned_is_more_and_arrives_later(answer):
    found = between_sites(answer)
    assert answer.policy.problem.epsilon < found.p_below < found.p_turned < 0.5
    assert found.turned.mean_s > answer.outcome.mean_s
    assert (found.turned.arrival_s >= answer.outcome.arrival_s).all()
    late = found.turned.arrival_s - answer.outcome.arrival_s
    assert (late > 0.0).mean() == pytest.approx(found.p_turned, abs=0.03)
    assert late[late > 0.0].min() > 60.0
    said = " ".join(between_sites_words(found, 0.001))
    assert found.station in said
    assert "fly" in said
    assert between_sites_words(found, 0.5) == []


def test_the_place_that_is_named_is_far_from_all_sites(answer, newyork):
    found = between_sites(answer)
    sites = [(one.lat, one.lon) for one in newyork.wind_sites]
    nodes = {newyork.network.tail[one] for leg in answer.policy.itinerary for one in leg.segments} | {
        answer.policy.problem.destination
    }
    nearest_m = {
        newyork.network.stations[int(node)].id: min(
            distance_m(float(newyork.network.lat[node]), float(newyork.network.lon[node]), *site) for site in sites
        )
        for node in nodes
    }
    assert nearest_m[found.station] > 0.6 * max(nearest_m.values())
    assert 0.5 < found.sd_mps < 4.0


def test_a_flight_that_uses_nothing_of_its_reserve_is_not_turned(answer):
    """More charge before each flight: fewer are turned, fewer break the reserve."""
    runs = answer.out_of_sample
    schedule = runs.schedule.copy()
    schedule[:, :, SOC_LANDING] += 0.15
    schedule[:, :, SOC_TAKE_OFF] += 0.15
    more = between_sites(replace(answer, out_of_sample=replace(runs, schedule=schedule)))
    less = between_sites(answer)
    assert more.p_below < 0.3 * less.p_below
    assert more.p_turned < 0.5 * less.p_turned


def test_a_forecast_that_is_no_record_has_errors_of_its_own(newyork):
    calm = constant_wind(3.0, 200.0, DEPART, HORIZON_H, 40.8, -73.9, 60.0)
    request = Request(state=State(DEPART, "bellevue"), destination="jacobi", payload_kg=0.2, drone="m300")
    assert between_sites(plan(newyork, request, forecast=calm).robust) is None
