"""Winds are measured only where something measures them."""

import numpy as np
import pytest

from models.drag import DragModel
from models.telemetry import TelemetryTrack
from models.wind_filter_measurement import airspeed_wind, autopilot_wind, blocks, measurements, tilt_wind

START_S = 1_700_000_000.0


def flight(count=600, rate_hz=10.0, **columns):
    """Straight and level to the north at 15 m/s, 60 m up."""
    known = {
        "vel_north_mps": np.full(count, 15.0) + 1e-6 * np.arange(count),
        "vel_east_mps": np.zeros(count),
        "vel_down_mps": np.zeros(count),
        "roll_rad": 1e-6 * np.arange(count),
        "pitch_rad": np.zeros(count),
        "yaw_rad": np.zeros(count),
        "height_m": np.full(count, 60.0),
        "landed": np.zeros(count),
    }
    filled = {
        name: np.broadcast_to(np.asarray(values, dtype=float), count) for name, values in (known | columns).items()
    }
    return TelemetryTrack.of_columns(1, START_S + np.arange(count) / rate_hz, filled)


def test_level_flight_is_flight_with_the_wind():
    wind = tilt_wind(blocks(flight()), DragModel()).wind
    assert wind.mean(axis=0) == pytest.approx((15.0, 0.0), abs=0.05)


def test_a_plane_with_18_mps_airspeed_and_15_over_the_ground_has_3_mps_against_it():
    track = flight(fixed_wing=1.0, airspeed_mps=18.0)
    wind = airspeed_wind(blocks(track)).wind
    assert wind.mean(axis=0) == pytest.approx((-3.0, 0.0), abs=0.01)
    assert len(tilt_wind(blocks(track), DragModel())) == 0


def test_the_airspeed_of_a_multirotor_is_not_believed():
    assert len(airspeed_wind(blocks(flight(fixed_wing=0.0, airspeed_mps=18.0)))) == 0


def test_an_airspeed_that_only_repeats_the_ground_speed_is_not_believed():
    assert len(airspeed_wind(blocks(flight(fixed_wing=1.0, airspeed_mps=15.0)))) == 0


def test_on_the_ground_there_is_no_wind_by_tilt():
    assert len(measurements(blocks(flight(landed=1.0)), DragModel())) == 0


def test_the_autopilots_estimate_is_taken_once_in_ten_seconds():
    found = autopilot_wind(blocks(flight(wind_north_mps=-2.0, wind_east_mps=1.0)))
    assert len(found) in {6, 7}
    assert found.wind[0] == pytest.approx((-2.0, 1.0))


def test_a_log_without_attitude_measures_nothing():
    assert len(measurements(blocks(flight(roll_rad=np.nan, pitch_rad=np.nan)), DragModel())) == 0


def test_a_stuck_sensor_measures_nothing():
    stuck = flight(roll_rad=0.05, pitch_rad=0.02)
    assert len(tilt_wind(blocks(stuck), DragModel())) == 0


def test_a_velocity_that_is_stuck_measures_nothing():
    assert len(tilt_wind(blocks(flight(vel_north_mps=15.0, vel_east_mps=2.0)), DragModel())) == 0


def test_a_gap_of_the_link_measures_nothing_beside_it():
    track = flight()
    cut = track.part((track.time_s < START_S + 20.0) | (track.time_s > START_S + 30.0))
    times = tilt_wind(blocks(cut), DragModel()).time_s - START_S
    assert not ((times > 19.0) & (times < 31.0)).any()


def test_upside_down_nothing_is_measured():
    assert len(tilt_wind(blocks(flight(roll_rad=3.0 + 1e-6 * np.arange(600))), DragModel())) == 0


def test_an_empty_track_measures_nothing():
    assert len(measurements(blocks(TelemetryTrack.joined(())), DragModel())) == 0
