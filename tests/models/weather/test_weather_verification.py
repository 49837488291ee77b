"""Forecasts compared with observations: the scores, and what is learnt from them, on errors that are known."""

import numpy as np
import pytest
import weather_files as wf
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from skyway.models.base.errors import InputError
from skyway.models.weather.forecasting import forecast_ensemble
from skyway.models.weather.region import Region
from skyway.models.weather.verification import Pairs, crps, gaussian_crps, learn, pairs_of, scores
from skyway.models.weather.weather import EAST, NORTH, FieldKey, Places, Weather
from skyway.models.wind.estimation.field import WindObservation
from skyway.scenarios import load_scenario

HOURS = 24


@given(members=st.lists(st.floats(-20, 20), min_size=1, max_size=8), truth=st.floats(-20, 20))
def test_the_score_of_members_is_its_definition(members, truth):
    x = np.array(members)
    twice = np.abs(x[:, None] - x[None]).mean()
    assert crps(x, truth) == pytest.approx(np.abs(x - truth).mean() - 0.5 * twice, abs=1e-9)


@pytest.mark.parametrize(("error", "sigma"), [(0.0, 1.0), (2.0, 0.5), (-1.5, 3.0)])
def test_the_score_of_a_gaussian_is_the_integral_that_defines_it(error, sigma):
    whole = (
        quad(lambda y: norm.cdf(y, 0.0, sigma) ** 2, -40.0, error, limit=200)[0]
        + quad(lambda y: norm.sf(y, 0.0, sigma) ** 2, error, 40.0, limit=200)[0]
    )
    assert gaussian_crps(np.array([error]), np.array([sigma]))[0] == pytest.approx(whole, abs=1e-6)


def test_members_from_all_sides_that_are_as_strong_as_the_wind_have_no_bias_of_the_speed():
    rng = np.random.default_rng(3)
    forecast = tuple(rng.normal(0.0, 3.0, (2, 40)) for _ in range(300))
    count = np.zeros(300, dtype=np.int64)
    pairs = Pairs(
        np.full(300, 1800.0), count, count, forecast, rng.normal(0.0, 3.0, (300, 2)), np.array([[40.0, -74.0]])
    )
    (score,) = scores(pairs)
    assert score.speed_bias_mps == pytest.approx(0.0, abs=0.3)
    assert score.speed_rmse_mps == pytest.approx(3.0 * np.sqrt(2.0 - np.pi / 2.0), rel=0.1)
    assert score.component_rmse_mps == pytest.approx(3.0, rel=0.1)


def test_members_count_by_their_probability():
    """A wind of 5 m/s that is 90 % probable, and one of 15 m/s; the wind that came was 5 m/s."""
    time = 1e9 + 3600.0 * np.arange(3)
    fields = {FieldKey(EAST, 10.0): np.array([[[5.0]] * 3, [[15.0]] * 3]), FieldKey(NORTH, 10.0): np.zeros((2, 3, 1))}
    lat, lon = np.array([40.0]), np.array([-74.0])
    made = ("made.csv",), "CSV", "made", float(time[0]), Places(lat, lon, "1 point"), ("likely", "storm"), time, fields
    seen = [WindObservation(at, 40.0, -74.0, 0.0, 5.0, 1.0, 10.0) for at in time]
    (score,) = scores(pairs_of([Weather(*made, probability=np.array([0.9, 0.1]))], seen, 0.2))
    assert score.speed_bias_mps == pytest.approx(1.0, abs=0.02)
    assert score.crps_mps == pytest.approx(0.1 * 10.0 - 0.9 * 0.1 * 10.0, abs=0.02)
    (equal,) = scores(pairs_of([Weather(*made)], seen, 0.2))
    assert equal.speed_bias_mps == pytest.approx(5.0)


KEEP = float(np.exp(-1.0 / 6.0))


def strayed(rng, sigma_h, count, keep=KEEP):
    """Errors of the size ``sigma_h`` by hour that fade within six hours, (count, hours, 2)."""
    found = np.empty((count, len(sigma_h), 2))
    found[:, 0] = rng.standard_normal((count, 2))
    for hour in range(1, len(sigma_h)):
        found[:, hour] = keep * found[:, hour - 1] + np.sqrt(1.0 - keep**2) * rng.standard_normal((count, 2))
    return found * sigma_h[None, :, None]


@pytest.fixture(scope="module")
def world():
    """Forecasts of real days of the New York record, with known errors: their size by lead, a bias, members too close together."""
    record = load_scenario(None).history
    rng = np.random.default_rng(5)
    sigma = 1.0 + 0.05 * np.arange(HOURS)
    starts = [row for row in range(0, len(record) - HOURS, 61) if record.complete[row : row + HOURS].all()][:140]
    lat, lon = (np.array([getattr(site, part) for site in record.sites[:1]]) for part in ("lat", "lon"))

    def issue(row, members, number):
        truth = np.stack((record.north[row : row + HOURS, 0], record.east[row : row + HOURS, 0]), axis=-1)
        middle = truth + strayed(rng, sigma, 1)[0] + np.array([0.5, -1.0])
        narrow = strayed(rng, 0.4 * sigma, members) if members > 1 else np.zeros((1, HOURS, 2))
        values = (middle + narrow)[..., None]
        time = record.start_s + 3600.0 * np.arange(row, row + HOURS)
        fields = {FieldKey(NORTH, 10.0): values[:, :, 0], FieldKey(EAST, 10.0): values[:, :, 1]}
        return Weather(
            (f"{number}.nc",),
            "GRIB",
            "made",
            float(time[0]),
            Places(lat, lon, "1 point"),
            tuple(map(str, range(members))),
            time,
            fields,
        )

    def seen(rows):
        return [
            WindObservation(record.start_s + 3600.0 * (row + hour), float(lat[0]), float(lon[0]), record.north[row + hour, 0], record.east[row + hour, 0], 1.0, 10.0)
            for row in rows for hour in range(HOURS)
        ]  # fmt: skip

    return starts, issue, seen, sigma


@pytest.mark.parametrize("members", [1, 12])
def test_the_error_of_known_forecasts_is_found_by_lead_and_used(world, members):
    starts, issue, seen, sigma = world
    train, held = starts[0::2], starts[1::2]
    pairs = pairs_of([issue(row, members, row) for row in train], seen(train), 0.2)
    found, told = learn(pairs, "learnt from the test"), scores(pairs)
    assert len(pairs) == len(train) * HOURS
    spread = (
        np.hypot(1.0, 0.4 if members > 1 else 0.0) * sigma if members == 1 else sigma * np.sqrt(1.0 + 0.16 / members)
    )
    np.testing.assert_allclose(np.mean(np.array(found.sigma_mps) / spread), 1.0, atol=0.06)
    np.testing.assert_allclose(np.mean(found.bias_mps, axis=0), [0.5, -1.0], atol=0.2)
    assert found.tau_s == pytest.approx(6 * 3600.0, rel=0.35)
    assert np.mean([one.calibrated_crps_mps for one in told]) < 0.9 * np.mean([one.crps_mps for one in told])
    if members > 1:
        ratio = np.mean([one.spread_mps / one.component_rmse_mps for one in told])
        assert 0.3 < ratio < 0.45
    inside, ranked = [], 0
    for row in held:  # other days: do 90 of 100 winds lie between the 5 and 95 % of the members?
        place = np.array([40.7]), np.array([-74.0])
        one = issue(row, members, row)
        region = Region(*place, float(one.times_s[0]) + 1.0, HOURS, 10.0, 0.2, seed=row)
        ensemble = forecast_ensemble([one], region, found)
        truth = seen([row])
        for hour in (2, 8, 14, 20):
            mid = 0.5 * (truth[hour].east_mps + truth[hour + 1].east_mps)
            low, high = np.quantile(ensemble.east[:, hour, 0], [0.05, 0.95])
            inside.append(low <= mid <= high)
            ranked += 1
    # of 60 courses the outer quantiles hold 0.9 * 59 / 61 = 87 of 100; means over an hour stray a little less than instants
    assert np.mean(inside) == pytest.approx(0.89, abs=0.05)


def test_observations_of_another_time_or_place_are_one_clear_line(world):
    starts, issue, seen, _ = world
    one = issue(starts[0], 1, 0)
    with pytest.raises(InputError, match="no observation lies in the time of a forecast"):
        pairs_of([one], seen([starts[5]]), 0.2)
    far = [WindObservation(float(one.times_s[2]), 50.0, 8.0, 1.0, 1.0, 1.0, 10.0)]
    with pytest.raises(InputError, match="does not cover the region"):
        pairs_of([one], far, 0.2)


def test_forecasts_at_another_height_are_brought_to_that_of_the_observations(tmp_path):
    path = wf.write_grib(
        tmp_path / "a.grib2", lambda _m, _h, z, lat, _lon: (z**0.3 + 0 * lat, 0 * lat), hours=(0, 1), heights=(10, 80)
    )
    from skyway.models.weather.readers.reading import read_weather

    seen = [WindObservation(wf.ISSUED_S + 1800.0, 40.7, -74.0, 0.0, 40.0**0.3, 1.0, 40.0)] * 20
    (score,) = scores(pairs_of(read_weather([path]), seen, 0.2))
    assert score.speed_rmse_mps < 0.01
