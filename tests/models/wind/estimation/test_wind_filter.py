"""The wind filter finds the wind, knows how well, and cannot be locked out."""

import math

import numpy as np
import pytest
from batch_filter import filter_log, nees
from drone_truth import fly

from skyway.models.base.errors import InputError
from skyway.models.drones.drag import DragModel
from skyway.models.wind.estimation.blocks import blocks
from skyway.models.wind.estimation.drag_monitor import check_drag
from skyway.models.wind.estimation.filter import GATE_99, WindFilter, WindFilterSettings
from skyway.models.wind.estimation.health import ConsistencyMonitor, chi2_band
from skyway.models.wind.estimation.measurement import measurements, tilt_air_velocity

TRUE_DRAG = DragModel(linear_per_s=0.15, quadratic_per_m=0.010, sigma_mps2=0.115)
MEAN = np.array([-4.0, 3.0])
SETTINGS = WindFilterSettings()


def estimate(truth, run=0, drag=TRUE_DRAG, settings=SETTINGS, forecast=MEAN):
    """Return the filter's course over a run, and the true wind averaged over the same seconds."""
    air = blocks(truth.track(run))
    taken = measurements(air, drag)
    course = filter_log(taken.time_s, taken.wind, taken.noise, forecast, settings)
    number = np.floor(truth.time_s - truth.time_s[0]).astype(int)
    wanted = np.floor(taken.time_s - truth.time_s[0]).astype(int)
    seconds = np.stack([np.bincount(number, truth.wind[:, run, part]) / np.bincount(number) for part in (0, 1)], axis=1)
    return course, seconds[wanted]


@pytest.fixture(scope="module")
def hundred_runs():
    truth = fly(seed=1, runs=100, duration_s=240.0)
    return [estimate(truth, run) for run in range(100)]


def test_the_compiled_filter_and_the_live_one_give_the_same(hundred_runs):
    generator = np.random.default_rng(3)
    count = 200
    time_s = np.cumsum(generator.exponential(0.7, count))
    wind = generator.normal(0.0, 2.0, (count, 2))
    wind[120:] += 15.0
    wind[50] = np.nan
    noise = np.tile([0.5, 0.1, 0.3], (count, 1))
    course = filter_log(time_s, wind, noise, np.array([1.0, -1.0]))
    live = WindFilter(float(time_s[0]), 1.0, -1.0)
    for row in range(count):
        live.predict(float(time_s[row]))
        used = live.update(tuple(wind[row]), [[0.5, 0.1], [0.1, 0.3]])
        assert used == course.accepted[row]
        now = live.estimate
        assert (now.north_mps, now.east_mps) == pytest.approx(tuple(course.wind[row]), abs=1e-9)
        assert (now.var_north, now.cov_north_east, now.var_east) == pytest.approx(
            tuple(course.covariance[row]), abs=1e-9
        )


def test_one_long_step_is_the_same_as_many_short_ones():
    steady = WindFilterSettings(gust_intensity=0.0)  # else the gusts go with a wind that changes on the way
    one, many = WindFilter(0.0, 5.0, 0.0, steady), WindFilter(0.0, 5.0, 0.0, steady)
    for each in (one, many):
        each.update((0.0, 0.0), 0.1)
    one.predict(100.0)
    for step in range(1, 101):
        many.predict(float(step))
    assert one.estimate.north_mps == pytest.approx(many.estimate.north_mps)
    assert one.estimate.var_north == pytest.approx(many.estimate.var_north)


def test_in_cruise_with_gusts_the_wind_is_found_to_half_a_metre_per_second(hundred_runs):
    miss = np.concatenate([(course.wind - wind)[30:] for course, wind in hundred_runs])
    print(f"vector RMSE {math.sqrt((miss**2).sum(axis=1).mean()):.2f} m/s")
    assert math.sqrt((miss**2).sum(axis=1).mean()) <= 0.5


def test_above_3_mps_its_direction_is_found_to_10_degrees(hundred_runs):
    apart = []
    for course, wind in hundred_runs:
        strong = np.hypot(*wind[30:].T) > 3.0
        found, true = (np.arctan2(values[30:, 1], values[30:, 0])[strong] for values in (course.wind, wind))
        apart.append(np.degrees((found - true + np.pi) % (2 * np.pi) - np.pi))
    print(f"direction RMSE {math.sqrt((np.concatenate(apart) ** 2).mean()):.1f} degrees")
    assert math.sqrt((np.concatenate(apart) ** 2).mean()) <= 10.0


def test_nees_over_100_runs_lies_in_its_band_at_nine_steps_of_ten(hundred_runs):
    squares = np.array([nees(course, wind) for course, wind in hundred_runs]).mean(axis=0)
    low, high = chi2_band(100)
    print(
        f"NEES in its band at {((squares > low) & (squares < high)).mean():.1%} of {len(squares)} steps, mean {squares.mean():.3f}"
    )
    assert ((squares > low) & (squares < high)).mean() >= 0.9


def test_nis_before_the_gate_over_100_runs_lies_in_its_band_at_nine_steps_of_ten(hundred_runs):
    nis = np.array([course.nis for course, _ in hundred_runs]).mean(axis=0)
    low, high = chi2_band(100)
    print(f"NIS in its band at {((nis > low) & (nis < high)).mean():.1%} of {len(nis)} steps, mean {nis.mean():.3f}")
    assert ((nis > low) & (nis < high)).mean() >= 0.9


def test_a_wind_that_turns_by_90_degrees_is_followed_within_10_seconds_and_never_lost():
    """From 9 m/s towards the east to 9 m/s towards the north, in gusts of 1.3 m/s; settled: errors of the ordinary size."""
    settled, later = [], []
    for seed in range(20):
        truth = fly(seed=seed, duration_s=240.0, mean=(0.0, 9.0), sigma_mps=0.5, shift=(120.0, 9.0, -9.0))
        course, wind = estimate(truth, forecast=np.array([0.0, 9.0]))
        miss = np.hypot(*(course.wind - wind)[course.time_s >= truth.time_s[0] + 120.0].T)
        settled.append(next(second for second in range(len(miss)) if (miss[second : second + 5] < 1.5).all()))
        later.append(miss[15:])
        assert course.accepted[-60:].mean() > 0.95
    print(f"settles after {np.median(settled):.0f} s in the median, {max(settled)} s at most")
    assert max(settled) <= 10
    assert math.sqrt((np.concatenate(later) ** 2).mean()) <= 0.6


def test_a_drag_wrong_by_30_percent_is_noticed_after_a_turn_and_not_before():
    wrong = DragModel(linear_per_s=0.15 * 1.3, quadratic_per_m=0.010 * 1.3, sigma_mps2=0.115)
    for seed in range(5):
        truth = fly(seed=seed, duration_s=180.0, courses_deg=(0.0, 90.0), leg_s=90.0, sigma_mps=0.7)
        air = blocks(truth.track(0))
        before = np.arange(len(air)) < 85
        for drag, expected in ((wrong, True), (TRUE_DRAG, False)):
            seen = tilt_air_velocity(air, drag)
            assert not check_drag(air.velocity[before], seen[before]).wrong
            assert check_drag(air.velocity, seen).wrong is expected


def test_the_innovations_tell_of_a_wrong_drag_at_the_turn():
    wrong = DragModel(linear_per_s=0.15 * 1.3, quadratic_per_m=0.010 * 1.3, sigma_mps2=0.115)
    truth = fly(seed=2, duration_s=180.0, courses_deg=(0.0, 90.0), leg_s=90.0, sigma_mps=0.7)
    verdicts = []
    for drag in (wrong, TRUE_DRAG):
        course, _ = estimate(truth, drag=drag)
        monitor = ConsistencyMonitor(window=20)
        for nis in course.nis[70:100]:
            monitor.add(float(nis))
        verdicts.append(monitor.verdict)
    assert verdicts[0] == "overconfident"
    assert verdicts[1] != "overconfident"


def test_a_single_wild_measurement_is_not_believed():
    calm = WindFilter(0.0, 0.0, 0.0)
    for second in range(60):
        calm.predict(float(second))
        calm.update((0.0, 0.0), 0.3)
    calm.predict(60.0)
    assert not calm.update((20.0, 0.0), 0.3)
    assert abs(calm.estimate.north_mps) < 0.1


def test_two_wild_seconds_of_a_manoeuvre_do_not_make_good_measurements_useless():
    """As the climb goes over into the cruise: they are rejected, and the next estimates are still to be used."""
    wind = WindFilter(0.0, 0.0, 0.0)
    for second in range(20):
        wind.advance(float(second))
        assert wind.update((20.0, 20.0) if second in (5, 6) else (3.0, 0.0), 0.3) is (second not in (5, 6))
        assert wind.estimate.source == "measured"


def test_a_filter_that_rejects_every_other_measurement_finds_itself_wrong():
    wind = WindFilter(0.0, 0.0, 0.0)
    for second in range(40):
        wind.advance(float(second))
        wind.update((20.0, 20.0) if second % 2 else (3.0, 0.0), 0.3)
    assert wind.estimate.source == "inconsistent"


def test_measurements_that_are_not_numbers_change_nothing():
    wind = WindFilter(0.0, 3.0, 0.0)
    assert not wind.update((math.nan, 1.0), 0.3)
    assert not wind.update((1.0, 1.0), math.inf)
    assert wind.estimate.north_mps == 3.0


def test_time_that_goes_backwards_stands_still():
    wind = WindFilter(100.0, 3.0, 0.0)
    wind.update((0.0, 0.0), 0.1)
    before = wind.estimate
    assert wind.predict(50.0) == before


def test_before_the_first_measurement_the_wind_is_the_forecast_and_says_so():
    wind = WindFilter(0.0, 3.0, -4.0)
    assert wind.estimate.source == "forecast"
    assert wind.estimate.speed_mps == pytest.approx(5.0)
    assert wind.estimate.from_deg == pytest.approx(126.87, abs=0.01)
    wind.update((3.0, -4.0), 0.5)
    assert wind.estimate.source == "measured"
    assert wind.predict(10_000.0).source == "held"


def test_without_measurements_the_wind_returns_to_the_forecast_and_its_uncertainty_to_that_of_the_forecast():
    wind = WindFilter(0.0, 0.0, 0.0)
    wind.update((6.0, 0.0), 0.01)
    wind.predict(20_000.0, (2.0, 1.0))
    later = wind.predict(40_000.0, (2.0, 1.0))
    assert (later.north_mps, later.east_mps) == pytest.approx((2.0, 1.0), abs=1e-6)
    gust = SETTINGS.gust_intensity * math.hypot(2.0, 1.0)
    assert later.sigma_mps == pytest.approx(math.hypot(SETTINGS.sigma_mps, gust), rel=1e-3)
    assert wind.steady.sigma_mps == pytest.approx(SETTINGS.sigma_mps)


def test_the_gate_lets_99_of_100_good_measurements_pass():
    values = np.random.default_rng(0).chisquare(2, 100_000)
    assert (values <= GATE_99).mean() == pytest.approx(0.99, abs=0.002)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="tau_s"):
        WindFilterSettings(tau_s=0.0)
    with pytest.raises(InputError, match="patience"):
        WindFilterSettings(patience_count=0)
