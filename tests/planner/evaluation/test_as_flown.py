"""What is promised of deliveries as `fly` flies them."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.composition.composition import State
from skyway.models.wind.forecast import constant_wind
from skyway.plan_document import as_flown_words
from skyway.planner.evaluation.as_flown import as_flown
from skyway.planner.evaluation.decisions import fly_policy
from skyway.planner.evaluation.realizations import held_out_forecast, sample_realizations, season_days
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.report import plan_report

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


def request_to(destination):
    return Request(state=State(DEPART, "bellevue"), destination=destination, payload_kg=0.8, drone="m200")


@pytest.fixture(scope="module")
def short(newyork):
    """A plan of one flight, at which nothing is decided on the way."""
    found = plan(newyork, request_to("columbia"), planner="robust")
    assert len(found.itinerary) == 1
    return found


@pytest.fixture(scope="module")
def flown(short):
    return as_flown(short, 20)


def test_where_there_is_nothing_to_decide_it_is_what_the_fixed_route_promises(short, flown):
    mean, other = flown.outcome.delivery, short.outcome.delivery
    assert mean.low <= other.high
    assert other.low <= mean.high
    assert flown.outcome.quantile_s(0.5) == pytest.approx(short.outcome.quantile_s(0.5), abs=60.0)
    assert flown.below_reserve == flown.on_the_ground == 0


@pytest.mark.slow
def test_each_delivery_is_another_one_and_the_same_in_whatever_process(short, monkeypatch):
    flown = as_flown(short, 24)
    assert len(np.unique(flown.flown.lowest_soc)) == 24
    monkeypatch.setattr("skyway.planner.evaluation.as_flown.processors", lambda: 1)
    again = as_flown(short, 24)
    assert (again.flown.delivery_s == flown.flown.delivery_s).all()
    assert (again.flown.lowest_soc == flown.flown.lowest_soc).all()


@pytest.mark.slow
def test_the_truth_is_not_told(newyork):
    """In a forecast of calm days and one storm, told that storm too, a drone would wait for its end; not told, it stays in it to the end."""
    request = request_to("columbia")
    calm = constant_wind(2.0, 40.0, DEPART, HORIZON_H, 40.7, -74.0, newyork.rules.cruise_height_m)
    north = np.repeat(calm.north, 8, axis=0)
    north[7] *= 20.0  # 40 m/s at all hours
    storm = replace(
        calm, north=north, east=np.repeat(calm.east, 8, axis=0), probability=np.full(8, 0.125),
        labels=tuple(f"m{number}" for number in range(8)),
    )  # fmt: skip
    found = as_flown(plan(newyork, request, planner="robust", forecast=storm), 24)
    assert not found.flown.delivered[21:].any()
    assert found.flown.delivered[:21].all()
    assert found.outcome.p_arrive == pytest.approx(7 / 8)


@pytest.mark.parametrize(("runs", "wind", "said"), [(19, False, "at least 20"), (20, True, "a single wind series")])
def test_what_cannot_be_simulated_is_said(newyork, short, runs, wind, said):
    planned = short
    if wind:
        calm = constant_wind(3.0, 40.0, DEPART, HORIZON_H, 40.7, -74.0, newyork.rules.cruise_height_m)
        planned = plan(newyork, request_to("columbia"), planner="robust", forecast=calm)
    with pytest.raises(InputError, match=said):
        as_flown(planned, runs)


def test_other_planners_are_not_what_fly_decides_with(newyork):
    with pytest.raises(InputError, match="plan with robust"):
        plan_report(plan(newyork, request_to("columbia"), planner="shortest"), flown_runs=24)


def test_it_is_told_in_words(flown):
    said = "\n".join(as_flown_words(flown, DEPART.replace(hour=19), "19:00"))
    assert "20 simulated deliveries" in said
    assert "On time, by 19:00: " in said
    assert "0 of 20 landed below the reserve" in said


@pytest.mark.slow
def test_on_days_that_the_forecast_was_not_told_deliveries_are_as_promised(newyork):
    """The promise, of a forecast without these days, against the same policy flown on them by the evaluation."""
    request = replace(request_to("white-plains"), state=State(DEPART, "siuh-north"))
    days = season_days(newyork, request, 12)
    forecast = held_out_forecast(newyork, request, days)
    result = plan(newyork, request, planner="robust", forecast=forecast)
    promised = as_flown(result, 100)
    realizations = sample_realizations(newyork, result.problem.request, days, runs=48, seed=5)
    met, _ = fly_policy(realizations, "m200", RollingRobust(result.problem))
    mean = promised.outcome.delivery
    by_day = np.array([met.delivery_s[met.block == day].mean() for day in np.unique(met.block)])
    error = by_day.std(ddof=1) / np.sqrt(len(by_day))
    assert abs(by_day.mean() - mean.value) < 3.0 * np.hypot(error, mean.error)
    kept = (met.delivery_s <= promised.outcome.quantile_s(0.8) - promised.outcome.start_s).mean()
    assert kept > 0.6
