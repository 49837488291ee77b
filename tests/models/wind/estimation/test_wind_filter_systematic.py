"""The wind filter stays honest where drag, level, airspeed sensor or compass are off by the same through a whole flight."""

import itertools
import math

import numpy as np
import pytest
from batch_filter import filter_log, nees
from drone_truth import fly

from skyway.models.drones.airspeed import AirspeedModel
from skyway.models.drones.drag import DragModel
from skyway.models.drones.drag_file import drag_file, read_air
from skyway.models.wind.estimation.blocks import blocks
from skyway.models.wind.estimation.filter import WindFilter, WindFilterSettings
from skyway.models.wind.estimation.live import NOMINAL_DRAG, LiveWind
from skyway.models.wind.estimation.measurement import PLAIN_SENSOR, MeanWind, measurements
from skyway.models.wind.estimation.systematic import COUNT, Dependence, dependence, prior_sigma

RELATIVE, LEVEL_MPS2 = 0.10, 0.10
CHI2_95 = 5.991464547107979
ONE_COURSE, SQUARE = (40.0,), (0.0, 90.0, 180.0, 270.0)


def drawn(generator):
    """A drag as another flight of the same drone would have given it: true is 0.15 and 0.010, a level that is level."""
    scale = 1.0 + RELATIVE * generator.normal()
    forward, right = LEVEL_MPS2 * generator.normal(size=2)
    return DragModel(
        linear_per_s=0.15 / scale,
        quadratic_per_m=0.010 / scale,
        bias_forward_mps2=forward,
        bias_right_mps2=right,
        sigma_mps2=0.115,
        relative_sigma=RELATIVE,
        bias_sigma_mps2=LEVEL_MPS2,
    )


def errors(courses_deg, mean, runs=60, drag_of=drawn, seed=7):
    """Errors squared against the covariance, and length of the errors, of every second of many flights: (runs, seconds) each."""
    generator = np.random.default_rng(seed)
    truth = fly(seed=seed, runs=runs, duration_s=240.0, courses_deg=courses_deg, leg_s=60.0, mean=mean, sigma_mps=0.5)
    number = np.floor(truth.time_s - truth.time_s[0]).astype(int)
    squares, length = [], []
    for run in range(runs):
        drag = drag_of(generator)
        taken = measurements(blocks(truth.track(run)), drag)
        course = filter_log(
            taken.time_s,
            taken.wind,
            taken.noise,
            np.zeros(2),
            WindFilterSettings(tau_s=1800.0, sigma_mps=5.0),
            dependence(taken, drag),
            prior_sigma(drag, PLAIN_SENSOR),
        )
        wanted = np.floor(taken.time_s - truth.time_s[0]).astype(int)
        wind = np.stack([np.bincount(number, truth.wind[:, run, i]) / np.bincount(number) for i in (0, 1)], axis=1)
        squares.append(nees(course, wind[wanted])[5:230])
        length.append(np.hypot(*(course.wind - wind[wanted]).T)[5:230])
    return np.array(squares), np.array(length)


@pytest.mark.parametrize("mean", [(-4.0, 3.0), (1.2, -0.9), (-7.0, -7.0)])
@pytest.mark.parametrize("courses_deg", [ONE_COURSE, SQUARE])
def test_the_true_wind_lies_in_the_95_percent_ellipse_as_often_as_said(courses_deg, mean):
    squares, length = errors(courses_deg, mean)
    inside = float((squares <= CHI2_95).mean())
    print(f"{inside:.1%} inside, mean NEES {squares.mean():.2f}, mean error {length.mean():.2f} m/s")
    assert 0.90 <= inside <= 1.0
    assert 0.8 <= squares.mean() <= 2.7


def test_turns_make_the_drag_known_and_the_wind_better():
    _, on_one_course = errors(ONE_COURSE, (-4.0, 3.0))
    _, round_a_square = errors(SQUARE, (-4.0, 3.0))
    assert round_a_square[:, 150:].mean() < 0.7 * on_one_course[:, 150:].mean()


def test_a_drag_that_nobody_knows_gives_a_wind_on_one_course_that_says_how_little_it_knows():
    squares, _ = errors(ONE_COURSE, (-4.0, 3.0), drag_of=lambda _: NOMINAL_DRAG)
    assert (squares <= CHI2_95).mean() >= 0.9


def test_a_hover_in_the_wind_with_an_unknown_drag_is_not_explained_away():
    """Noise must not look like an error of the drag that multiplies it: the wind found is not pulled to 0."""
    truth = fly(
        seed=4, runs=20, duration_s=240.0, courses_deg=ONE_COURSE, speed_mps=0.0, mean=(4.0, 0.0), sigma_mps=0.3
    )
    drag = DragModel(linear_per_s=0.15, quadratic_per_m=0.010, sigma_mps2=0.115, relative_sigma=0.3)
    found = []
    for run in range(20):
        wind = LiveWind(drag=drag)
        found.append(wind.feed(truth.track(run)).wind[-60:].mean(axis=0))
    assert np.mean(found, axis=0) == pytest.approx((4.0, 0.0), abs=0.5)


@pytest.mark.parametrize("mean", [(4.0, 3.0), (6.0, 0.0)])
def test_gusts_on_a_straight_leg_are_not_explained_by_a_level_that_slides_away(mean):
    """The drag is right, and only as sure as that of another flight; the curve is steep where a gust from behind makes the air slow."""
    truth = fly(
        seed=21,
        runs=20,
        duration_s=300.0,
        courses_deg=(0.0,),
        speed_mps=14.0,
        mean=mean,
        sigma_mps=0.2,
        c1=0.043,
        c2=0.0052,
    )
    drag = DragModel(linear_per_s=0.043, quadratic_per_m=0.0052, sigma_mps2=0.115).another_flight()
    missed = []
    for run in range(20):
        found = LiveWind(drag=drag).feed(truth.track(run)).wind[-60:].mean(axis=0)
        missed.append(found - truth.wind[-600:, run].mean(axis=0))
    print(np.mean(missed, axis=0))
    assert np.mean(missed, axis=0) == pytest.approx((0.0, 0.0), abs=0.5)


@pytest.mark.parametrize("mean", [(0.6, 0.8), (1.5, 2.0), (5.4, 7.2)])
def test_a_hover_with_the_drag_of_another_flight_is_as_honest_in_light_wind_as_in_strong(mean):
    generator = np.random.default_rng(3)
    truth = fly(seed=25, runs=12, duration_s=240.0, courses_deg=(0.0,), speed_mps=0.0, mean=mean, sigma_mps=0.2)
    number = np.floor(truth.time_s - truth.time_s[0]).astype(int)
    inside, squares = [], []
    for run in range(12):
        course = LiveWind(drag=drawn(generator)).feed(truth.track(run))
        wind = np.stack([np.bincount(number, truth.wind[:, run, i]) / np.bincount(number) for i in (0, 1)], axis=1)
        wind = wind[: len(course)]
        inside.append((nees(course, wind)[5:230] <= CHI2_95).mean())
        squares.append(((course.wind - wind)[5:230] ** 2).sum(axis=1).mean())
    print(f"{np.mean(inside):.1%} inside, RMSE {math.sqrt(np.mean(squares)):.2f} m/s")
    assert np.mean(inside) >= 0.85
    assert math.sqrt(np.mean(squares)) <= 1.2  # a level that is off by 0.1 m/s2 is 0.6 m/s in each direction


def test_how_a_flight_is_cut_does_not_change_its_wind():
    truth = fly(seed=22, duration_s=60.0, courses_deg=SQUARE, leg_s=15.0)
    track, cuts = truth.track(0), [0, 7, 130, 131, 420, len(truth.time_s)]
    drag = drawn(np.random.default_rng(1))
    whole, pieces = LiveWind(drag=drag), LiveWind(drag=drag)
    expected = whole.feed(track).wind
    found = [pieces.feed(track.part(slice(*edges))).wind for edges in itertools.pairwise(cuts)]
    assert np.array_equal(np.concatenate(found), expected)


def test_the_mean_wind_is_that_before_each_measurement_without_what_nobody_flies_in():
    mean, time_s = MeanWind(), np.arange(4.0)
    told = mean.before(time_s, np.array([[2.0, 0.0], [90.0, 0.0], [4.0, 0.0], [4.0, 0.0]]))
    assert told[0] == pytest.approx((2.0, 0.0))
    assert told[2] == pytest.approx((2.0, 0.0))
    assert 2.9 < told[3, 0] < 3.1
    assert mean.before(np.array([1e6]), np.array([[-4.0, 0.0]]))[0, 0] < 4.0  # the last that was known
    assert mean.before(np.array([1e6 + 1.0]), np.array([[-4.0, 0.0]]))[0] == pytest.approx((-4.0, 0.0))


def test_the_compiled_filter_and_the_live_one_give_the_same_with_systematic_errors():
    generator = np.random.default_rng(9)
    count = 150
    time_s = np.cumsum(generator.exponential(0.8, count))
    wind = generator.normal(0.0, 2.0, (count, 2))
    wind[100:] += 12.0
    scale = generator.integers(-1, 1, count)
    turn = np.where(scale >= 0, generator.choice([-1, 4], count), -1)
    depends = Dependence(generator.normal(0.0, 3.0, (count, 2, COUNT)), scale, turn)
    sigma = np.array([0.1, 0.2, 0.2, 0.3, 0.1, 1.0, 1.0])
    noise = np.tile([0.5, 0.1, 0.3], (count, 1))
    course = filter_log(time_s, wind, noise, np.array([1.0, -1.0]), None, depends, sigma)
    live = WindFilter(float(time_s[0]), 1.0, -1.0, None, sigma)
    for row in range(count):
        live.predict(float(time_s[row]))
        used = live.update(tuple(wind[row]), [[0.5, 0.1], [0.1, 0.3]], depends, row)
        assert used == course.accepted[row]
        now = live.estimate
        assert (now.north_mps, now.east_mps) == pytest.approx(tuple(course.wind[row]), abs=1e-9)
        assert (now.var_north, now.cov_north_east, now.var_east) == pytest.approx(
            tuple(course.covariance[row]), abs=1e-9
        )


def test_an_autopilots_own_wind_is_never_known_better_than_the_autopilot_may_be_wrong():
    wind = WindFilter(0.0, 0.0, 0.0, WindFilterSettings(), prior_sigma(None, PLAIN_SENSOR))
    depends = Dependence.none(1)
    depends.sensitivity[0, 0, 5] = depends.sensitivity[0, 1, 6] = 1.0
    for second in range(0, 600, 10):
        wind.predict(float(second))
        wind.update((3.0, 1.0), 1.0, depends)
    assert wind.estimate.sigma_mps > 1.0


def test_a_calibration_is_less_sure_of_another_flight_than_of_its_own(tmp_path):
    drag = DragModel(linear_per_s=0.2, relative_sigma=0.03, bias_sigma_mps2=0.02)
    sensor = AirspeedModel(factor_sigma=0.01, heading_sigma_rad=0.01)
    file = tmp_path / "drag.toml"
    file.write_text(drag_file(drag, airspeed=sensor))
    found = read_air(file)
    assert found.drag.relative_sigma == pytest.approx(math.hypot(0.03, 0.10))
    assert found.drag.bias_sigma_mps2 == pytest.approx(math.hypot(0.02, 0.10))
    assert found.drag.manoeuvre_share > 0.0
    assert found.airspeed.factor_sigma > 0.03
    assert found.airspeed.heading_sigma_rad > math.radians(3.0)


def test_a_drag_file_that_says_no_uncertainty_is_not_taken_for_certain(tmp_path):
    file = tmp_path / "drag.toml"
    file.write_text('schema = "skyway.drag/1"\nlinear_per_s = 0.2\n\n[airspeed]\nfactor = 1.02\n')
    found = read_air(file)
    assert found.drag.relative_sigma >= 0.1
    assert found.drag.bias_sigma_mps2 >= 0.1
    assert found.airspeed.factor_sigma >= 0.03
