"""A flight on two courses tells the drag; a hover says that it cannot; a mast beside it can."""

import csv
import gzip
import math

import numpy as np
import pytest
from batch_filter import nees
from drone_truth import fly

from skyway.link.logs.reader import open_log
from skyway.models.base.errors import InputError
from skyway.models.calibration.wind import fit_known_wind, identify_drag
from skyway.models.drones.drag import DragModel, thrust_acceleration
from skyway.models.drones.drag_file import drag_file, read_drag
from skyway.models.wind.estimation.blocks import Blocks, blocks
from skyway.models.wind.estimation.live import LiveWind
from skyway.models.wind.estimation.measurement import tilt_wind

CHI2_95 = -2.0 * math.log(0.05)


def effective(model: DragModel, airspeed_mps: float) -> float:
    return model.linear_per_s + model.quadratic_per_m * airspeed_mps


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("courses", [(0.0, 180.0), (0.0, 90.0, 180.0, 270.0)])
def test_out_and_back_or_a_square_tells_drag_and_wind(seed, courses):
    truth = fly(seed=seed, courses_deg=courses, leg_s=50.0, sigma_mps=0.7, c2=0.0, c1=0.3)
    fit = identify_drag(blocks(truth.track(0)))
    assert fit.drag is not None, fit.reason
    assert effective(fit.drag, 16.0) == pytest.approx(0.3, rel=4.0 * fit.relative_sigma + 0.02)
    wind = truth.wind[:, 0].mean(axis=0)
    assert (fit.wind_north_mps, fit.wind_east_mps) == pytest.approx(tuple(wind), abs=1.0)


def test_the_stated_uncertainty_of_the_drag_is_of_the_right_size():
    scores = []
    for seed in range(20):
        truth = fly(seed=seed, courses_deg=(0.0, 180.0), leg_s=50.0, sigma_mps=0.7, c1=0.3, c2=0.0)
        fit = identify_drag(blocks(truth.track(0)))
        scores.append((effective(fit.drag, 16.0) / 0.3 - 1.0) / fit.relative_sigma)
    assert 0.2 < float(np.sqrt(np.mean(np.square(scores)))) < 2.0


def test_a_level_that_is_not_level_is_found():
    truth = fly(seed=1, duration_s=400.0, leg_s=50.0, sigma_mps=0.5, c1=0.3, c2=0.0, bias=(0.2, -0.1))
    fit = identify_drag(blocks(truth.track(0)))
    assert fit.drag is not None
    assert effective(fit.drag, 16.0) == pytest.approx(0.3, rel=0.1)


def test_a_hover_cannot_tell_the_drag_and_says_why():
    truth = fly(seed=1, speed_mps=0.0, sigma_mps=0.5)
    fit = identify_drag(blocks(truth.track(0)))
    assert fit.drag is None
    assert fit.drag is None
    assert "hovers" in fit.reason


def test_a_flight_on_one_course_cannot_tell_the_drag_and_says_why():
    truth = fly(seed=1, courses_deg=(30.0,), sigma_mps=0.7)
    fit = identify_drag(blocks(truth.track(0)))
    assert fit.drag is None
    assert "courses" in fit.reason


@pytest.mark.parametrize("seed", range(8))
def test_a_flight_that_tells_its_own_wind_refuses_another_and_takes_the_right_one(seed):
    truth = fly(seed=seed, courses_deg=(0.0, 180.0), leg_s=50.0, sigma_mps=0.7, c2=0.0, c1=0.3)
    air = blocks(truth.track(0))
    mean = truth.wind[:, 0].mean(axis=0)
    assert fit_known_wind(air, np.broadcast_to(mean, (len(air), 2))).linear_per_s == pytest.approx(0.3, rel=0.1)
    assert math.hypot(*mean) > 2.5
    for wrong in (-mean, 10.0 * mean):
        with pytest.raises(InputError, match="contradicts the given wind"):
            fit_known_wind(air, np.broadcast_to(wrong, (len(air), 2)))


def test_the_wind_found_with_the_drag_is_not_more_certain_than_it_is():
    scores = []
    for seed in range(20):
        truth = fly(seed=seed, courses_deg=(0.0, 180.0), leg_s=50.0, sigma_mps=0.7, c1=0.3, c2=0.0)
        fit = identify_drag(blocks(truth.track(0)))
        miss = np.array([fit.wind_north_mps, fit.wind_east_mps]) - truth.wind[:, 0].mean(axis=0)
        scores.append(miss / fit.wind_sigma_mps)
    assert float(np.sqrt(np.mean(np.square(scores)))) < 1.0


def test_a_short_flight_cannot_tell_the_drag():
    fit = identify_drag(blocks(fly(seed=1, duration_s=40.0).track(0)))
    assert fit.drag is None
    assert "60 are needed" in fit.reason


def test_a_flight_on_wings_cannot_tell_the_drag():
    track = fly(seed=1).track(0)
    track["fixed_wing"][:] = 1.0
    assert "wings" in identify_drag(blocks(track)).reason


def test_a_drone_that_leans_north_into_a_north_wind_feels_it_from_the_north():
    pitch = np.array([-0.2])  # nose down, the nose to the north
    lean = thrust_acceleration(np.zeros(1), pitch, np.zeros(1))
    assert lean[0, 0] == pytest.approx(9.80665 * math.tan(0.2))
    assert lean[0, 1] == pytest.approx(0.0)
    still = np.zeros((1, 2))
    air = Blocks(
        np.zeros(1),
        still,
        lean,
        np.zeros(1),
        np.full(1, np.nan),
        np.zeros((1, 2)),
        np.full((1, 2), np.nan),
        np.ones(1, bool),
        np.zeros(1, bool),
        np.full((1, 3), np.nan),
    )
    wind = tilt_wind(air, DragModel(linear_per_s=0.3)).wind
    assert wind[0, 0] < 0.0  # the air moves to the south


def test_a_roll_to_the_right_with_the_nose_north_pushes_east():
    push = thrust_acceleration(np.array([0.1]), np.zeros(1), np.zeros(1))
    assert push[0] == pytest.approx((0.0, 9.80665 * math.tan(0.1)))


@pytest.mark.parametrize("speed", [0.0, 0.3, 5.0, 20.0])
def test_air_velocity_undoes_drag(speed):
    model = DragModel(linear_per_s=0.2, quadratic_per_m=0.01)
    velocity = np.array([[speed * 0.6, -speed * 0.8]])
    assert model.air_velocity(model.drag(velocity)) == pytest.approx(velocity, abs=1e-6)


def test_a_drag_file_reads_back_what_was_written(tmp_path):
    model = DragModel(linear_per_s=0.21, quadratic_per_m=0.004, relative_sigma=0.05, bias_right_mps2=-0.03)
    path = tmp_path / "drag.toml"
    path.write_text(drag_file(model, ["found in flight.tlog"]))
    assert read_drag(path) == model.another_flight()


def test_a_drag_of_nothing_is_refused(tmp_path):
    path = tmp_path / "drag.toml"
    path.write_text('schema = "skyway.drag/1"\nlinear_per_s = 0.0\n')
    with pytest.raises(InputError, match="wind cannot be estimated"):
        read_drag(path)


@pytest.fixture(scope="module")
def hover(shared_data):
    """The hover beside the mast: averages of the flight, and of the mast's three upper anemometers."""
    path = shared_data / "wemuav" / "wemuav_hover_10hz.csv.gz"
    with gzip.open(path, "rt") as stream:
        rows = list(csv.DictReader(stream))
    mast = np.zeros((len(rows), 2))
    for height in ("14p7m", "18p0m", "21p3m"):
        speed = np.array([float(row[f"mast_{height}_wind_speed_mps"]) for row in rows])
        angle = np.radians([float(row[f"mast_{height}_wind_from_deg"]) for row in rows])
        mast -= np.stack([speed * np.cos(angle), speed * np.sin(angle)], axis=1) / 3.0
    (track,) = open_log(path).tracks()
    air = blocks(track)
    number = np.floor(track.time_s - track.time_s[0]).astype(int)
    wind = np.stack([np.bincount(number, mast[:, part]) / np.bincount(number) for part in (0, 1)], axis=1)
    return track, air, wind


def test_beside_the_mast_the_filter_as_a_replay_uses_it_beats_a_5_second_tilt_fit(hover):
    """Drag from the first third and the mast's mean wind there, scored on the rest; the plain fit: 0.43 and 0.81 m/s.

    Nothing of the filter is tuned to the mast. Its covariance has room for a drag and a level of another flight, which here are those
    of the same one; so it may be wider than the errors, and must not be narrower.
    """
    track, air, wind = hover
    count = len(air)
    first = slice(0, count // 3)
    mean = np.broadcast_to(wind[first].mean(axis=0), wind[first].shape)
    drag = fit_known_wind(air.part(first), mean)
    course = LiveWind(drag=drag.another_flight()).feed(track)
    truth = wind[np.searchsorted(air.time_s, course.time_s)]
    for begin in (count // 3, count // 2):
        rest = course.time_s >= air.time_s[begin]
        miss = (course.wind - truth)[rest]
        vector = math.sqrt((miss**2).sum(axis=1).mean())
        speed = math.sqrt(((np.hypot(*course.wind[rest].T) - np.hypot(*truth[rest].T)) ** 2).mean())
        squares = nees(course, truth)[rest]
        inside = float((squares <= CHI2_95).mean())
        print(
            f"from block {begin}: speed {speed:.3f}, vector {vector:.3f} m/s, NEES {squares.mean():.2f}, {inside:.1%} inside, {drag}"
        )
        assert speed <= 0.40
        assert vector <= 0.65
        assert squares.mean() <= 2.7
        assert inside >= 0.93
