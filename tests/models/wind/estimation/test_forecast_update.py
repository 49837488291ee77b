"""What drones measure makes the forecast better, and nothing is counted twice."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import direct
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.filter import WindEstimate
from skyway.models.wind.estimation.forecast_update import SlotAverages, refined, update_forecast, worth
from skyway.models.wind.forecast import analogue_ensemble, truth_series

START_S = 1_700_000_000.0


def ensemble(members=20, slots=6, sites=1, seed=0, slot_s=3600.0):
    generator = np.random.default_rng(seed)
    shape = (members, slots, sites)
    return WindEnsemble(
        site_lat=np.full(sites, 40.7),
        site_lon=np.linspace(-74.0, -73.5, sites),
        start_s=START_S,
        slot_s=slot_s,
        north=np.broadcast_to(generator.normal(0.0, 3.0, (members, 1, 1)), shape).copy(),
        east=np.broadcast_to(generator.normal(0.0, 3.0, (members, 1, 1)), shape).copy(),
        probability=np.full(members, 1.0 / members),
        labels=tuple(str(number) for number in range(members)),
        height_m=60.0,
    )


def seen(north, east, time_s=START_S + 1800.0, variance=0.5, lat=40.7, lon=-74.0):
    return WindObservation(time_s, lat, lon, north, east, variance)


def test_members_like_what_was_measured_gain_weight():
    before = ensemble()
    member = 7
    after = update_forecast(before, [seen(before.north[member, 0, 0], before.east[member, 0, 0])])
    assert after.probability[member] == after.probability.max()
    assert after.probability.sum() == pytest.approx(1.0)


def test_one_measurement_leaves_weight_on_as_many_members_as_are_asked_for():
    many = ensemble(members=40)
    windy = [seen(9.0, 0.0, variance=0.1)]
    sharp, flat = (update_forecast(many, windy, least_members=least).probability for least in (1.0, 12.0))
    assert worth(sharp) < 12.0
    assert worth(flat) == pytest.approx(12.0, rel=1e-3)
    assert np.all(np.diff(flat[np.argsort(sharp)]) >= -1e-12)  # the order is what was measured
    assert flat.sum() == pytest.approx(1.0)


def test_each_member_is_moved_by_its_own_residual_which_fades_with_the_horizon():
    before = ensemble()
    model = ResidualModel(sigma_mps=3.0, tau_s=7200.0)
    after = update_forecast(before, [seen(10.0, 0.0, variance=1e-6)], model, slot_s=3600.0)
    for slot, horizon_s in ((0, 0.0), (1, 3600.0), (3, 10_800.0)):
        moved = after.north[:, slot, 0] - before.north[:, slot, 0]
        assert moved == pytest.approx((10.0 - before.north[:, 0, 0]) * np.exp(-horizon_s / 7200.0), rel=1e-3)


def test_the_updated_forecast_says_what_was_measured_where_it_was_measured_however_far_the_sites_are():
    before = replace(
        ensemble(members=30, sites=3), site_lat=np.array([40.6, 40.7, 40.8]), site_lon=np.array([-73.8, -74.2, -73.9])
    )
    lat, lon = 41.05, -73.7  # 30 km and more from each site
    measured = [seen(8.0, -6.0, lat=lat, lon=lon, variance=0.5)]
    after = update_forecast(before, measured)
    north, east = after.wind_at(lat, lon, after.slot_at(measured[0].time_s))
    assert float(after.probability @ north) == pytest.approx(8.0, abs=0.8)
    assert float(after.probability @ east) == pytest.approx(-6.0, abs=0.8)
    assert (
        np.ptp(after.north[:, after.slot_at(measured[0].time_s)].mean(axis=0)) > 0.1
    )  # the sites farther off learn less


def test_the_same_slot_told_a_hundred_times_over_by_a_filter_is_one_observation():
    averages = SlotAverages()
    for number in range(3000):
        averages.add(WindEstimate(START_S + 0.2 * number, 5.0, 1.0, 0.1, 0.0, 0.1), 40.7, -74.0)
    observations = averages.observations()
    assert len(observations) <= 5
    assert min(one.variance for one in observations) >= 0.25
    assert (observations[0].north_mps, observations[0].lat_deg) == pytest.approx((5.0, 40.7))


def test_without_observations_the_forecast_stays():
    before = ensemble()
    assert update_forecast(before, []) is before


def test_finer_slots_hold_the_same_wind():
    before = ensemble()
    fine = refined(before, 600.0)
    assert fine.slots == 6 * before.slots
    for time_s in (START_S, START_S + 3599.0, START_S + 3601.0, START_S + 20_000.0):
        assert fine.north[3, fine.slot_at(time_s), 0] == before.north[3, before.slot_at(time_s), 0]


def test_an_observation_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="not a wind observation"):
        update_forecast(ensemble(), [seen(float("nan"), 0.0)])
    with pytest.raises(InputError, match="not a wind observation"):
        update_forecast(ensemble(), [seen(1.0, 0.0, variance=0.0)])


def crps(values, probability, truth):
    """Continuous ranked probability score of a weighted ensemble of numbers; smaller is better, in their unit.

    The mean distance to the truth minus half the mean distance between members: for one member it is the absolute error.

    Source: T. Gneiting, A. Raftery, "Strictly proper scoring rules, prediction, and estimation", JASA 102 (2007), eq. 21.
    """
    members = np.asarray(values, dtype=np.float64)
    weight = np.asarray(probability, dtype=np.float64)
    order = np.argsort(members)
    members, weight = members[order], weight[order]
    below = np.cumsum(weight) - weight
    spread = 2.0 * float((weight * members * (2.0 * below + weight - 1.0)).sum())
    return float((weight * np.abs(members - truth)).sum()) - 0.5 * spread


def test_crps_of_one_member_is_its_error_and_of_two_even_ones_half_their_distance():
    assert crps([3.0], [1.0], 5.0) == pytest.approx(2.0)
    assert crps([0.0, 2.0], [0.5, 0.5], 1.0) == pytest.approx(0.5)
    assert crps([2.0, 0.0, 7.0], [0.5, 0.5, 0.0], 1.0) == pytest.approx(0.5)


def test_crps_of_many_members_is_that_of_the_density():
    values = np.random.default_rng(0).normal(0.0, 1.0, 4000)
    assert crps(values, np.full(4000, 1 / 4000), 0.0) == pytest.approx(0.2337, abs=0.01)  # (sqrt 2 - 1) / sqrt pi


def mean_crps(forecast, truth, slots):
    scores = [
        crps(getattr(forecast, name)[:, slot, site], forecast.probability, getattr(truth, name)[0, slot, site])
        for slot in slots
        for site in range(len(forecast.site_lat))
        for name in ("north", "east")
    ]
    return float(np.mean(scores))


def test_on_the_record_the_updated_forecast_beats_the_plain_one_at_1_2_and_3_hours():
    """New York 2013: three hours measured by one drone at one airport, scored at all three."""
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario.file import read_scenario

    history = read_scenario(NEW_YORK).history
    generator = np.random.default_rng(0)
    plain, updated = np.zeros(3), np.zeros(3)
    flown = 0
    while flown < 60:
        depart = datetime(2013, 1, 10, tzinfo=UTC) + timedelta(hours=int(generator.integers(0, 340 * 24)))
        try:
            before, truth = analogue_ensemble(history, depart, 8), truth_series(history, depart.date(), depart, 8)
        except InputError:
            continue
        flown += 1
        noise = generator.normal(0.0, 0.5, (3, 2))
        measured = [
            seen(
                float(truth.north[0, slot, 0] + noise[slot, 0]),
                float(truth.east[0, slot, 0] + noise[slot, 1]),
                before.start_s + (slot + 0.5) * 3600.0,
                0.25 + 0.49,
                float(before.site_lat[0]),
                float(before.site_lon[0]),
            )
            for slot in range(3)
        ]
        after = update_forecast(before, measured, slot_s=3600.0)
        for hour in range(3):
            plain[hour] += mean_crps(before, truth, [3 + hour])
            updated[hour] += mean_crps(after, truth, [3 + hour])
    print("CRPS at 1, 2, 3 h: plain", (plain / flown).round(2), "updated", (updated / flown).round(2))
    assert (updated / plain < (0.65, 0.75, 0.80)).all()


def simulated_region(generator, drones=5, minutes=70, length_m=20_000.0, tau_s=5400.0, sigma=2.0):
    """True wind residuals at drones' places each 10 min: one draw of a field that fades with distance and time."""
    bearings = generator.uniform(0.0, 360.0, drones)
    places = [direct(40.7, -74.0, float(bearing), float(generator.uniform(0.0, 20_000.0))) for bearing in bearings]
    lat, lon = (np.array(values) for values in zip(*places, strict=True))
    times = np.arange(-20, minutes + 1, 10) * 60.0
    grid = (np.repeat(times, drones), np.tile(lat, len(times)), np.tile(lon, len(times)))
    covariance = ResidualModel(sigma_mps=sigma, tau_s=tau_s, length_m=length_m).covariance(grid, grid)
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance)))
    return lat, lon, times, (root @ generator.normal(0.0, 1.0, (len(covariance), 2))).reshape(len(times), drones, 2)


def test_five_drones_forecast_30_percent_better_than_one_drones_persistence_at_10_30_and_60_minutes():
    generator = np.random.default_rng(4)
    model = ResidualModel(sigma_mps=2.0, tau_s=5400.0, length_m=20_000.0)
    ours, plain, persistence = {10: [], 30: [], 60: []}, {10: [], 30: [], 60: []}, {10: [], 30: [], 60: []}
    for trial in range(40):
        lat, lon, times, residual = simulated_region(generator)
        before = replace(ensemble(members=30, slots=4, sites=len(lat), seed=trial), site_lat=lat, site_lon=lon)
        true_member = int(generator.integers(30))
        base = np.array([before.north[true_member, 0, 0], before.east[true_member, 0, 0]])
        now = START_S + 1800.0
        noise = generator.normal(0.0, 0.5, residual.shape)
        measured = [
            seen(*(base + residual[row, drone] + noise[row, drone]), now + times[row], 0.25, lat[drone], lon[drone])
            for row in range(3)
            for drone in range(len(lat))
        ]
        after = update_forecast(before, measured, model, slot_s=600.0)
        held = base + residual[2, 0] + noise[2, 0]
        for horizon in ours:
            row = 2 + horizon // 10
            for drone in range(len(lat)):
                truth = base + residual[row, drone]
                for forecast, kept in ((after, ours), (before, plain)):
                    slot = forecast.slot_at(now + horizon * 60.0)
                    north, east = forecast.north[:, slot, drone], forecast.east[:, slot, drone]
                    kept[horizon] += [
                        crps(north, forecast.probability, truth[0]),
                        crps(east, forecast.probability, truth[1]),
                    ]
                persistence[horizon] += list(np.abs(held - truth))
    for horizon, scores in ours.items():
        print(
            f"{horizon} min: CRPS updated {np.mean(scores):.2f}, plain {np.mean(plain[horizon]):.2f}, "
            f"one drone's persistence {np.mean(persistence[horizon]):.2f}"
        )
        assert np.mean(scores) < 0.7 * np.mean(persistence[horizon])
        assert np.mean(scores) < np.mean(plain[horizon])


def test_a_measured_wind_is_that_of_the_forecast_here_and_a_gust_which_are_told_apart():
    """What one wind was, most probably, adds up to what was measured; a forecast without the gust would be off by it at once."""
    before, here = ensemble(slot_s=600.0), (40.7, -74.0)
    speed = 18.0
    told = seen(speed, 0.0, START_S + 60.0, variance=(0.15 * speed) ** 2)
    after = update_forecast(before, [told], here=here)
    north, east = (float(after.probability @ one) for one in after.wind_at(*here, 0))
    assert speed - north > 3.0
    assert (north + after.gust.north_mps, east + after.gust.east_mps) == pytest.approx((speed, 0.0), abs=1e-6)
    assert (after.gust.time_s, after.gust.lat_deg, after.gust.lon_deg) == (told.time_s, *here)
    assert after.at_height(120.0, 0.2).gust.north_mps == pytest.approx(after.gust.north_mps * 2.0**0.2)
    assert update_forecast(before, [told]).gust is None


def test_the_gust_told_is_that_where_the_drone_is_not_that_of_a_report_from_afar():
    here, away = (40.7, -74.0), direct(40.7, -74.0, 90.0, 30_000.0)
    drone = seen(12.0, 0.0, START_S + 30.0, variance=3.0)
    report = seen(2.0, 0.0, START_S + 60.0, variance=1.0, lat=away[0], lon=away[1])
    for told in ([report, drone], [drone, report]):
        assert update_forecast(ensemble(slot_s=600.0), told, here=here).gust.time_s == drone.time_s
