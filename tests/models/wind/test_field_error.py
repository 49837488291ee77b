"""The wind between the sites is off by an error whose size and likeness a record tells; a measurement there says how much."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import slot_variance, update_forecast
from skyway.models.wind.field_error import EXPONENT, REFERENCE_M, FieldError

START_S = 1_700_000_000.0
SITE_LAT, SITE_LON = np.array([40.69, 40.64, 40.78]), np.array([-74.17, -73.78, -73.87])


def forecast(members=15, seed=0):
    generator = np.random.default_rng(seed)
    north, east = generator.normal(0.0, 3.0, (2, members, 1, 1)) + generator.normal(0.0, 1.0, (2, members, 4, 3))
    return WindEnsemble(
        SITE_LAT, SITE_LON, START_S, 3600.0, north, east, np.full(members, 1.0 / members),
        tuple(str(number) for number in range(members)), 60.0,
    )  # fmt: skip


def seen(north, east, lat, lon, time_s=START_S + 1800.0, variance=0.3):
    return WindObservation(time_s, lat, lon, north, east, variance)


def mean_at(ensemble, lat, lon, time_s=START_S + 1800.0):
    north, east = ensemble.wind_at(lat, lon, ensemble.slot_at(time_s))
    return float(ensemble.probability @ north), float(ensemble.probability @ east)


places = st.lists(st.tuples(st.floats(40.5, 40.9), st.floats(-74.3, -73.6)), min_size=1, max_size=6)


@given(places=places)
@settings(max_examples=40)
def test_the_error_has_a_covariance_and_there_is_none_at_the_sites(places):
    error = FieldError(0.8)
    lat, lon = (
        np.concatenate((part, sites))
        for part, sites in zip(zip(*places, strict=True), (SITE_LAT, SITE_LON), strict=True)
    )
    found = error.covariance(lat, lon, forecast(2).weights(lat, lon), SITE_LAT, SITE_LON)
    assert np.allclose(found, found.T, atol=1e-9)
    assert np.linalg.eigvalsh(found).min() > -1e-6
    assert np.allclose(found[-3:], 0.0, atol=1e-6)


def test_a_record_drawn_from_the_structure_function_gives_its_own_size_back():
    generator = np.random.default_rng(1)
    distance, _ = geodesy.inverse(SITE_LAT[:, None], SITE_LON[:, None], SITE_LAT[None], SITE_LON[None])
    gamma = 0.9 * (1.0 + 10.0 / 2.0) * (distance / REFERENCE_M) ** EXPONENT
    root = np.linalg.cholesky(10.0 * gamma.max() - gamma)  # beside differences between the sites a wind that all have
    drawn = generator.standard_normal((2, 20_000, 3)) @ root.T
    drawn -= drawn.mean(axis=2, keepdims=True)
    drawn += 0.123 * 10.0 * generator.standard_normal(drawn.shape)  # gusts in means of two minutes
    drawn[0] += 10.0

    class History:
        sites = tuple(type("Site", (), {"lat": a, "lon": b})() for a, b in zip(SITE_LAT, SITE_LON, strict=True))
        north, east = drawn

    assert FieldError.of(History()).variance == pytest.approx(0.9, rel=0.1)


def test_wind_grows_with_height_and_its_error_with_it():
    low = FieldError(0.6)
    high = low.at_height(1.3)
    assert float(high.gamma(np.array(5_000.0)) * high.in_wind(13.0)) == pytest.approx(
        1.69 * float(low.gamma(np.array(5_000.0)) * low.in_wind(10.0))
    )


@pytest.mark.parametrize(("begin_m", "end_m"), [(0.0, 6000.0), (2000.0, 6000.0), (9000.0, 9100.0)])
def test_the_mean_over_a_stretch_is_off_as_winds_drawn_along_it_are(begin_m, end_m):
    """Judge: the structure function summed over places along the way."""
    error, steps = FieldError(0.8), 400
    along = begin_m + (end_m - begin_m) * (np.arange(steps) + 0.5) / steps
    within = error.gamma(np.abs(np.subtract.outer(along, along))).mean()
    judged = float(error.gamma(along).mean() - 0.5 * within)
    assert float(error.gamma_of_stretch(begin_m, end_m)) == pytest.approx(judged, rel=2e-3)


def test_neighbours_differ_as_winds_drawn_along_them_do():
    """Judge: the same for two adjoining stretches."""
    error, steps, length_m = FieldError(0.8), 400, 2250.0
    along = length_m * (np.arange(2 * steps) + 0.5) / steps
    gamma = error.gamma(np.abs(np.subtract.outer(along, along)))
    judged = float(gamma[:steps, steps:].mean() - 0.5 * (gamma[:steps, :steps].mean() + gamma[steps:, steps:].mean()))
    assert float(error.gamma_of_neighbours(length_m)) == pytest.approx(judged, rel=5e-3)


@pytest.mark.parametrize("wrong", [{"variance": -1.0}, {"tau_s": 0.0}, {"gusty_mps": float("nan")}])
def test_an_error_out_of_range_is_refused_by_name(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        FieldError(**wrong)


def test_what_was_measured_between_the_sites_counts_there_and_little_at_the_sites():
    before, here = forecast(), (40.75, -73.98)
    there = mean_at(before, *here)
    measured = [seen(there[0] + 5.0, there[1], *here)]
    plain = update_forecast(before, measured, slot_s=3600.0)
    local = update_forecast(before, measured, slot_s=3600.0, field=FieldError(2.0), here=here)
    assert mean_at(local, *here)[0] - there[0] > 4.0
    sites = list(zip(SITE_LAT, SITE_LON, strict=True))
    moved = [[mean_at(one, *site)[0] - mean_at(before, *site)[0] for site in sites] for one in (plain, local)]
    assert np.all(np.abs(moved[1]) < 0.8 * np.abs(moved[0]))
    near = mean_at(local, 40.76, -73.97)[0] - mean_at(before, 40.76, -73.97)[0]
    far = mean_at(local, 41.2, -73.4)[0] - mean_at(before, 41.2, -73.4)[0]
    assert 5.0 > near > far


def test_the_wind_here_is_the_conditional_mean_of_a_joint_normal_distribution():
    """Judge: the conditional mean worked out from the joint covariance of every value at once, for one member."""
    field, model, here = FieldError(1.2), ResidualModel(sigma_mps=2.0, tau_s=7200.0), (40.74, -73.95)
    before = replace(forecast(1), north=np.zeros((1, 4, 3)), east=np.zeros((1, 4, 3)))
    lat, lon = np.array([40.70, 40.72, 40.74]), np.array([-74.05, -74.0, -73.95])
    time_s = START_S + 7200.0 + np.array([-900.0, -450.0, 0.0])
    told = np.array([[4.0, 5.0, 6.5], [0.5, -0.5, 1.0]])
    variance = 2.5
    measured = [seen(*told[:, k], lat[k], lon[k], time_s[k], variance) for k in range(3)]
    after = update_forecast(before, measured, model, slot_s=600.0, field=field, here=here)
    found = [float(part[0, after.slot_at(time_s[2] - 1.0), 3]) for part in (after.north, after.east)]
    # joint: residuals of the sites, errors between them at the places, gusts; all at their own times, and at the end of the slot's known part
    distance = geodesy.inverse(SITE_LAT[:, None], SITE_LON[:, None], SITE_LAT[None], SITE_LON[None])[0]
    at_sites = 4.0 * np.exp(-distance / model.length_m)
    rows = before.weights(np.append(lat, here[0]), np.append(lon, here[1]))
    begin = after.start_s + 600.0 * after.slot_at(time_s[2] - 1.0)
    times = np.append(time_s, min(begin + 300.0, time_s[2]))
    apart = np.abs(times[:, None] - times)
    speed = np.hypot(*told).mean()
    local = field.covariance(np.append(lat, here[0]), np.append(lon, here[1]), rows, SITE_LAT, SITE_LON) * (
        1.0 + speed / 2.0
    )
    joint = rows @ at_sites @ rows.T * np.exp(-apart / 7200.0) + local * np.exp(-apart / field.tau_s)
    gust = np.sqrt(np.minimum(variance, (0.15 * np.hypot(*told)) ** 2))
    metres = geodesy.inverse(lat[:, None], lon[:, None], lat[None], lon[None])[0]
    noise = gust * gust[:, None] * np.exp(-apart[:3, :3] / 180.0 - metres / 5000.0) + np.diag(variance - gust**2)
    expected = joint[3, :3] @ np.linalg.solve(joint[:3, :3] + noise, told.T)
    assert found == pytest.approx(expected.tolist(), rel=1e-9)


def test_shorter_slots_of_one_flight_say_no_more_than_a_longer_one():
    before, here = forecast(), (40.75, -73.98)
    there = mean_at(before, *here)
    weight = []
    for count in (1, 4):
        length = 600.0 / count
        measured = [
            seen(there[0] + 4.0, there[1], *here, START_S + 1200.0 + (k + 0.5) * length, slot_variance(10.0, length))
            for k in range(count)
        ]
        after = update_forecast(before, measured, ResidualModel(), slot_s=3600.0)
        weight.append(mean_at(after, *here)[0] - there[0])
    assert weight[1] == pytest.approx(weight[0], rel=0.06)


def test_a_lattice_has_no_error_between_its_nodes():
    lat, lon = np.repeat([40.6, 40.8], 2), np.tile([-74.1, -73.8], 2)
    before = replace(
        forecast(), site_lat=lat, site_lon=lon, north=np.zeros((15, 4, 4)), east=np.zeros((15, 4, 4)), lattice=(2, 2)
    )
    measured = [seen(5.0, 0.0, 40.7, -73.9)]
    plain, told = (
        update_forecast(before, measured, **more) for more in ({}, {"field": FieldError(), "here": (40.7, -73.9)})
    )
    assert np.array_equal(plain.north, told.north)
