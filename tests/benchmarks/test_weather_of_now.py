"""The tables of the weather of now: no look ahead, and a score as it is defined."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.independent.information import Order
from benchmarks.independent.product import planning
from benchmarks.tables.weather_of_now import leaving, observed, published
from benchmarks.tables.wind_observed import crps

DAY_S = 86_400.0


@pytest.mark.parametrize(("minute", "report_h"), [(0, 17), (55, 17), (56, 18), (59, 18)])
def test_a_plan_knows_what_was_out_at_its_departure_and_no_more(minute, report_h):
    city = planning.city("new-york")
    depart_s = 1_373_479_200.0 + 60.0 * minute  # 2013-07-10T18:00Z
    found = published(city, Order("bellevue", "jacobi", depart_s, 0.8), 3 * DAY_S)
    for site in city.sites:
        time_s, north, east = found[site.id]
        assert time_s == 1_373_479_200.0 + 3600.0 * (report_h - 18) + 51 * 60.0
        row = np.searchsorted(site.time_s, 1_373_479_200.0 + 3600.0 * (report_h - 18) + 3 * DAY_S)
        assert (north, east) == tuple(site.wind[row])


@pytest.mark.parametrize(("minute", "share"), [(51, 0.0), (6, 0.25), (21, 0.5)])
def test_the_wind_at_a_departure_lies_between_two_reports(minute, share):
    city = planning.city("new-york")
    hour_s = 1_373_479_200.0  # 2013-07-10T18:00Z
    order = leaving(Order("bellevue", "jacobi", hour_s + 1234.0, 0.8), minute)
    assert order.depart_s == hour_s + 60.0 * minute
    found = observed(city, order, 3 * DAY_S)
    for site in city.sites:
        first = np.searchsorted(site.time_s, hour_s + 3 * DAY_S - (3600.0 if minute < 51 else 0.0))
        time_s, *wind = found[site.id]
        assert time_s == order.depart_s
        np.testing.assert_allclose(wind, (1.0 - share) * site.wind[first] + share * site.wind[first + 1], atol=1e-9)


@given(
    st.lists(st.tuples(st.floats(-20, 20), st.floats(0.01, 1.0)), min_size=1, max_size=12), st.floats(-30, 30)
)  # fmt: skip
def test_crps_is_what_it_is_defined_as(members, truth):
    values, weight = (np.array(part) for part in zip(*members, strict=True))
    weight = weight / weight.sum()
    mean_miss = weight @ np.abs(values - truth)
    mean_gap = weight @ np.abs(values[:, None] - values[None]) @ weight
    assert crps(values[:, None], weight, np.array([truth]))[0] == pytest.approx(mean_miss - 0.5 * mean_gap, abs=1e-9)
