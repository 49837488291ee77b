"""Winds of drones assimilated into a forecast: against the exact answer for Gaussian errors, and what it must keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.estimation.assimilation import LEAST_MEMBERS, assimilated
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.field_error import EXACT_FIELD, FieldError

LAT, LON = np.array([40.0, 40.0, 40.0]), np.array([10.0, 10.1, 11.0])
HOURS = 6


def forecast(members=2000, sigma=2.0, length_deg=0.3, seed=1):
    """Winds of 5 m/s towards the east with Gaussian errors that are alike nearby and last."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(np.exp(-np.abs(LON[:, None] - LON) / length_deg))
    parts = [sigma * rng.standard_normal((members, 3)) @ root.T for _ in range(2)]
    north, east = (np.repeat(part[:, None], HOURS, axis=1) for part in parts)
    labels = tuple(map(str, range(members)))
    return WindEnsemble(LAT, LON, 0.0, 3600.0, north, 5.0 + east, np.full(members, 1.0 / members), labels, 60.0)


def seen(lon, east, variance=1.0, time_s=1800.0):
    return WindObservation(time_s, 40.0, lon, 0.0, east, variance, 60.0)


def update(ensemble, observations, field=EXACT_FIELD, slot_s=3600.0):
    return assimilated(ensemble, observations, field, ResidualModel(), slot_s=slot_s)


def test_one_measurement_moves_each_site_as_far_as_gaussian_errors_say():
    before, one = forecast(), seen(10.0, 9.0)
    after = update(before, [one])
    cov = np.exp(-np.abs(LON - 10.0) / 0.3) * 4.0
    gain = cov / (4.0 + 1.0)  # conditional mean and variance of a Gaussian
    gust = 1.0
    assert one.variance == gust
    np.testing.assert_allclose(after.probability @ after.east[:, 3], 5.0 + gain * 4.0, atol=0.25)
    np.testing.assert_allclose(after.east[:, 3].var(axis=0), 4.0 - gain * cov, rtol=0.12)
    np.testing.assert_allclose(after.north[:, 3].var(axis=0), 4.0 - gain * cov, rtol=0.12)


def test_what_no_forecast_knows_makes_twenty_drones_in_one_place_count_little_more_than_one():
    before = forecast()
    local = FieldError(variance=2.0, gusty_mps=1e4)
    far = 2  # the site 85 km away
    one, many = (update(before, [seen(10.0 + 0.001 * k, 9.0, 0.05) for k in range(n)], local) for n in (1, 20))
    moved = [float((after.east - before.east)[:, 3, far].mean()) for after in (one, many)]
    assert 0.0 < moved[0] < moved[1] < 1.4 * moved[0]
    sure = update(before, [seen(10.0 + 0.001 * k, 9.0, 0.05) for k in range(20)])
    assert float((sure.east - before.east)[:, 3, far].mean()) > 1.2 * moved[1]


@settings(max_examples=20)
@given(st.integers(LEAST_MEMBERS, 40), st.floats(-20, 20), st.floats(0.05, 9.0), st.integers(1, 6))
def test_members_keep_their_number_names_and_probabilities_and_come_nearer_to_what_was_measured(
    count, east, variance, drones
):
    before = forecast(count)
    weight = np.linspace(1.0, 3.0, count)
    before = before.weighted(weight / weight.mean())
    after = update(before, [seen(10.0 + 0.02 * k, east, variance) for k in range(drones)], FieldError(), slot_s=900.0)
    assert after.labels == before.labels
    assert after.slots == 4 * before.slots
    np.testing.assert_array_equal(after.probability, before.probability)
    off = [abs(east - float(one.probability @ one.east[:, one.slot_at(1800.0), 0])) for one in (before, after)]
    assert off[1] <= off[0] + 0.5


def test_few_members_are_updated_by_the_usual_residual():
    before = forecast(LEAST_MEMBERS - 1)
    after = update(before, [seen(10.0, 9.0, 0.01)])
    assert float(after.probability @ after.east[:, 0, 0]) == pytest.approx(9.0, abs=0.3)


def test_nothing_measured_changes_nothing_and_no_number_is_refused():
    before = forecast(20)
    assert update(before, []) is before
    with pytest.raises(InputError, match="is not a wind observation"):
        update(before, [seen(10.0, np.nan)])
