"""The studies of forecasts: their errors are as large as they say, nothing looks ahead, and what does not fit is refused."""

from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pytest

from benchmarks.cases.day_forecast import COMPONENT_RMSE_MPS, HOURS, LEAD_H, DayForecasts, rest_by_lead
from benchmarks.independent.information import Order
from benchmarks.independent.product import planning
from benchmarks.independent.weather.reports import new_york
from benchmarks.link.supervision import days, story_of
from benchmarks.tables.anemometer import crps
from benchmarks.tables.forecast_gain import CITY, Service, held_out_days, learning_days
from skyway.models.base.errors import InputError
from skyway.planner.evaluation.evaluate import fly_charging, held_out_forecast, sample_realizations


def test_forecasts_of_days_are_as_far_off_as_they_say():
    sites = new_york()
    days = learning_days(held_out_days(7))
    made = DayForecasts(sites, rest_by_lead(sites, [issue(day, 6) for day in days]))
    lat, lon = (np.array([getattr(site, name) for site in sites]) for name in ("lat", "lon"))
    errors = []
    for day in days:
        begin_s = issue(day, 18)
        wind = made.wind(begin_s, lat, lon)
        for column, site in enumerate(sites):
            rows = np.searchsorted(site.time_s, begin_s + 3600.0 * np.arange(HOURS))
            errors.append(0.5 * (wind[:-1, column] + wind[1:, column]) - site.wind[rows])
    rmse = np.sqrt((np.array(errors) ** 2).mean(axis=(0, 2)))
    wanted = np.interp(np.arange(HOURS), LEAD_H, COMPONENT_RMSE_MPS)
    assert abs(rmse[:7].mean() / wanted[:7].mean() - 1.0) < 0.15
    assert abs(rmse[12:].mean() / wanted[12:].mean() - 1.0) < 0.15


def issue(day, hour):
    return datetime(day.year, day.month, day.day, hour, tzinfo=UTC).timestamp()


def test_studies_use_what_was_out_and_no_day_twice(tmp_path):
    held_out = held_out_days(1919)
    assert len(set(held_out)) == 24
    assert min(abs((a - b).days) for a in held_out for b in learning_days(held_out)) > 3
    service = Service(DayForecasts(new_york(), np.zeros(HOURS + 1)), tmp_path, tmp_path / "error.json")
    at_s = issue(date(2013, 7, 10), 14) + 900.0
    assert at_s - int(service.newest(at_s).stem) == 3600.0 + 900.0


def test_crps_of_two_members_is_what_it_is_by_hand():
    assert crps(np.array([1.0, 3.0]), np.array([0.5, 0.5]), 2.0) == pytest.approx(1.0 - 0.5)


@pytest.mark.slow
def test_a_policy_is_not_flown_where_other_sites_measure_the_wind():
    scenario = planning.told_scenario(CITY, "")
    order = Order("bellevue", "jacobi", issue(date(2013, 7, 10), 18), 0.5)
    request, day = planning.request_of(CITY, order), date(2013, 7, 10)
    forecast = held_out_forecast(scenario, request, [day]).at_sites(np.array([40.7]), np.array([-73.9]))
    plan = planning.planned_on(scenario, request, forecast)
    truths = sample_realizations(scenario, request, [day], runs=2)
    with pytest.raises(InputError, match="sites"):
        fly_charging(truths, "m200", plan.result.robust.policy)


def test_supervised_deliveries_are_planned_without_their_day_and_with_a_forecast_that_was_out(tmp_path):
    story, _ = story_of(8200, answers=tmp_path)
    (answer,) = story.weather
    issued_s, departs_s = int(answer.stem), story.instant().timestamp()
    assert 3600.0 <= departs_s - issued_s < 7200.0
    assert story.day() in days()
    names = replace(story, weather=()).plan()[1].labels
    assert len(names) > 10
    assert str(story.day()) not in names
    assert story.plan()[1].labels != names
