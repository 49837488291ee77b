"""Winds are measured only where something measures them, and never by what comes later."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.drones.drag import DragModel
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.blocks import BlockMaker, Blocks, blocks
from skyway.models.wind.estimation.measurement import airspeed_wind, autopilot_wind, measurements, tilt_wind

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


def test_where_airspeed_tells_the_wind_the_autopilots_estimate_of_the_same_sensor_is_not_counted_again():
    track = flight(fixed_wing=1.0, airspeed_mps=18.0, wind_north_mps=-6.0, wind_east_mps=1.0)
    assert set(measurements(blocks(track), None).source) == {"airspeed"}
    track["airspeed_mps"][100:] = np.nan
    found = measurements(blocks(track), None)
    since = found.time_s[found.source == "autopilot"] - found.time_s[found.source == "airspeed"][-1]
    assert since.min() > 30.0


def test_a_log_without_attitude_measures_nothing():
    assert len(measurements(blocks(flight(roll_rad=np.nan, pitch_rad=np.nan)), DragModel())) == 0


@pytest.mark.parametrize("stuck", [{"roll_rad": 0.05, "pitch_rad": 0.02}, {"vel_north_mps": 15.0, "vel_east_mps": 2.0}])
def test_a_sensor_that_has_been_stuck_for_5_seconds_measures_nothing(stuck):
    times = tilt_wind(blocks(flight(**stuck)), DragModel()).time_s - START_S
    assert (times < 6.0).all()


def test_a_gap_of_the_link_measures_nothing_beside_it():
    track = flight()
    cut = track.part((track.time_s < START_S + 20.0) | (track.time_s > START_S + 30.0))
    times = tilt_wind(blocks(cut), DragModel()).time_s - START_S
    assert not ((times > 19.0) & (times < 31.0)).any()


def test_upside_down_nothing_is_measured():
    assert len(tilt_wind(blocks(flight(roll_rad=3.0 + 1e-6 * np.arange(600))), DragModel())) == 0


def test_an_empty_track_measures_nothing():
    assert len(measurements(blocks(TelemetryTrack.joined(())), DragModel())) == 0


@settings(max_examples=30)
@given(cuts=st.lists(st.integers(0, 600), max_size=12))
def test_how_a_stream_is_cut_does_not_matter(cuts):
    generator = np.random.default_rng(5)
    wave = generator.normal(0.0, 0.1, 600)
    track = flight(roll_rad=np.where(np.arange(600) < 200, 0.03, wave), airspeed_mps=16.0 + wave, fixed_wing=1.0)
    maker = BlockMaker()
    edges = [0, *sorted(cuts), 600]
    parts = [maker.feed(track.part(slice(begin, end))) for begin, end in itertools.pairwise(edges)]
    pieces, whole = Blocks.joined([*parts, maker.flush()]), blocks(track)
    for name in Blocks.__dataclass_fields__:
        assert np.array_equal(getattr(pieces, name), getattr(whole, name), equal_nan=getattr(whole, name).dtype != bool)


def test_blocks_do_not_change_when_more_is_heard():
    track = flight(count=300, roll_rad=0.01 * np.sin(np.arange(300)))
    whole = BlockMaker().feed(track)
    early = BlockMaker().feed(track.part(slice(0, 152)))
    assert len(early) == 15
    assert early.drag == pytest.approx(whole.drag[:15], nan_ok=True, abs=0.0)
