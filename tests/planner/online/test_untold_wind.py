"""Wind that no site tells and no member holds: told arrivals count it, against drawn fields of wind."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from bellevue_flights import standing, wind
from drawn_winds import drawn_times

from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EXACT
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.field_error import FieldError
from skyway.planner.online.following import Step
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.online.told_plan import segments_of, told_plan
from skyway.planner.online.untold_wind import with_untold_wind
from skyway.planner.problem.error_model import Errors
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.robust.out_of_sample import simulate_fixed
from skyway.planner.schedule.itinerary import Leg, typical_member
from skyway.planner.schedule.schedule_kernels import TAKE_OFF, TOUCH_DOWN

DEPART = datetime(2013, 7, 10, 18, 0, tzinfo=UTC)
GUSTS = Errors(energy=EXACT)
WAY = ["yankee-stadium", "montefiore", "lawrence"]


@pytest.fixture(scope="module")
def problem(newyork):
    request = Request(state=State(DEPART, "yankee-stadium"), destination="white-plains", payload_kg=0.8, drone="m300")
    return OnlinePolicy(newyork, request).problem(
        standing(newyork.forecast(DEPART, HORIZON_H), station="yankee-stadium")
    )


def test_flights_take_as_much_longer_and_shorter_as_in_drawn_winds(problem):
    itinerary = (Leg(segments_of(problem.network, WAY)),)
    _, course = typical_member(problem, itinerary)
    errors = with_untold_wind(problem, itinerary, course, GUSTS)
    alike = [simulate_fixed(problem, itinerary, one, 60 * len(problem.probability)) for one in (errors, GUSTS)]
    told, gusts, drawn, rng = [], [], [], np.random.default_rng(5)
    for member in range(len(problem.probability)):
        for runs, found in zip(alike, (told, gusts), strict=True):
            own = runs.schedule[runs.member == member, -1]
            at_once = own[np.isclose(own[:, TAKE_OFF], problem.depart_s)]
            found.append(float(np.std(at_once[:, TOUCH_DOWN] - problem.depart_s)) if len(at_once) > 20 else np.nan)
        times = drawn_times(problem, itinerary[0].segments, member, 0, rng, 400)
        drawn.append(float(np.std(times)))
    known = np.isfinite(told) & np.isfinite(gusts)
    told, gusts, drawn = (float(np.mean(np.array(one)[known])) for one in (told, gusts, drawn))
    assert drawn > 1.2 * gusts
    assert told == pytest.approx(np.hypot(drawn, gusts), rel=0.25)


def test_where_nothing_is_known_of_it_errors_are_as_they_were(newyork, problem):
    policy = OnlinePolicy(newyork, problem.request)
    steady = policy.problem(standing(wind(), station="yankee-stadium"))
    itinerary = (Leg(segments_of(steady.network, WAY)),)
    _, course = typical_member(steady, itinerary)
    assert with_untold_wind(steady, itinerary, course, GUSTS) is GUSTS


def test_the_told_arrival_is_less_sure_where_the_wind_differs_more_from_place_to_place(newyork, monkeypatch):
    request = Request(state=State(DEPART, "bellevue"), destination="yankee-stadium", payload_kg=0.3, drone="m300")
    known = standing(newyork.forecast(DEPART, HORIZON_H))
    spreads = []
    for variance in (0.0, 1.0, 4.0):
        monkeypatch.setattr(Scenario, "field_error", FieldError(variance))
        arrival = OnlinePolicy(replace(newyork), request).on_ground(known, tell=True).composition.arrival
        spreads.append((arrival.p95 - arrival.p50).total_seconds())
    assert spreads == sorted(spreads)
    assert spreads[-1] > 1.3 * spreads[0]


def test_a_leg_that_may_be_turned_arrives_later_on_average_by_the_way_back_and_the_charge_for_it(newyork):
    request = Request(state=State(DEPART, "bellevue"), destination="yankee-stadium", payload_kg=0.3, drone="m300")
    policy = OnlinePolicy(newyork, request)
    known = standing(newyork.forecast(DEPART, HORIZON_H), soc=0.6)
    seen = policy.hindsight(known)
    p = seen.problem
    step = Step(segments_of(p.network, ["bellevue", "yankee-stadium"]), 0.6)
    means = []
    for p_turned in (0.0, 0.5, 1.0):
        plan = told_plan(seen, step, None, GUSTS, lambda *_: None, p_turned)
        means.append(plan.arrival.mean.timestamp())
    spent = p.parameters.online.turned_share * (0.6 - p.reserve)
    away_s, charges_s = spent / p.soc_per_s, p.charge_time_s(p.origin, 0.6 - spent, 0.6)
    assert means[2] - means[0] == pytest.approx(away_s + charges_s + p.parameters.online.stop_s, rel=1e-3)
    assert means[1] - means[0] == pytest.approx(0.5 * (means[2] - means[0]), rel=0.2)
