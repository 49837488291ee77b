"""A sampled wind that no site tells has the covariance that the record tells."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.models.wind.field_error import FieldError
from skyway.models.wind.forecast import constant_wind
from skyway.planner.evaluation.local_wind import LocalWind

BEGIN = datetime(2013, 7, 10, 18, tzinfo=UTC)
FIELD = FieldError(1.5)
PLACES = ((40.70, -73.95), (40.75, -73.90), (40.90, -73.80), (41.05, -73.70))
SAMPLES = 1500


@pytest.fixture(scope="module")
def wind():
    """Three sites."""
    one = constant_wind(2.0, 40.0, BEGIN, 4, 40.7, -74.0, 60.0)
    lat, lon = np.array([40.69, 40.64, 40.78]), np.array([-74.17, -73.78, -73.87])
    return replace(
        one, site_lat=lat, site_lon=lon, north=np.repeat(one.north, 3, axis=2), east=np.repeat(one.east, 3, axis=2)
    )


def sampled(wind, times_s, speed_mps=0.0):
    """Errors at the places, at each of some times after the begin: shape (samples, times, places, 2)."""
    found = []
    for seed in range(SAMPLES):
        local = LocalWind(FIELD, wind, np.random.default_rng(seed))
        found.append([[local.at(*one, wind.start_s + time_s, speed_mps) for one in PLACES] for time_s in times_s])
    return np.array(found)


def test_errors_between_the_sites_have_the_covariance_of_the_record_and_fade(wind):
    found = sampled(wind, (0.0, FIELD.tau_s))
    lat, lon = np.array(PLACES).T
    wanted = FIELD.covariance(lat, lon, wind.weights(lat, lon), wind.site_lat, wind.site_lon)
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    for component in range(2):
        now, later = found[:, 0, :, component], found[:, 1, :, component]
        assert np.abs(now.T @ now / SAMPLES - wanted).max() < 0.12 * scale.max()
        kept = np.diag(now.T @ later) / np.diag(now.T @ now)
        assert kept == pytest.approx(np.full(len(PLACES), np.exp(-1.0)), abs=0.12)


def test_it_grows_with_the_wind_and_vanishes_at_a_site(wind):
    local = LocalWind(FIELD, wind, np.random.default_rng(1))
    calm, windy = (np.array(local.at(*PLACES[2], wind.start_s, speed)) for speed in (0.0, 3.0 * FIELD.gusty_mps))
    assert windy == pytest.approx(2.0 * calm)
    at_site = local.at(float(wind.site_lat[0]), float(wind.site_lon[0]), wind.start_s, 5.0)
    assert at_site == pytest.approx((0.0, 0.0), abs=1e-9)
    exact = LocalWind(FieldError(0.0), wind, np.random.default_rng(1))
    assert exact.at(*PLACES[2], wind.start_s, 5.0) == (0.0, 0.0)
