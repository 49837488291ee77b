"""A plane that turns tells how wrong its airspeed sensor is, and by how much it flies askew."""

import math

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.calibration.airspeed import identify_airspeed
from skyway.models.drones.airspeed import AirspeedModel
from skyway.models.drones.drag import DragModel
from skyway.models.drones.drag_file import drag_file, read_air, read_drag
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.blocks import blocks
from skyway.models.wind.estimation.measurement import airspeed_wind

WIND = np.array([3.0, -2.0])


def flight(*, seed=0, factor=1.0, offset_deg=0.0, turn_deg_s=2.0, seconds=300, climb_mps=0.0):
    """A plane at 20 m/s true airspeed in circles; its sensor reads ``true / factor``, its nose points off by the offset."""
    generator = np.random.default_rng(seed)
    time_s = 1_700_000_000.0 + np.arange(seconds * 5) / 5.0
    towards = np.radians(turn_deg_s) * (time_s - time_s[0])
    level = math.sqrt(20.0**2 - climb_mps**2)
    velocity = level * np.stack([np.cos(towards), np.sin(towards)], axis=1) + WIND
    velocity += generator.normal(0.0, 0.1, velocity.shape)
    count = len(time_s)
    columns = {
        "vel_north_mps": velocity[:, 0],
        "vel_east_mps": velocity[:, 1],
        "vel_down_mps": np.full(count, -climb_mps),
        "yaw_rad": towards - math.radians(offset_deg) + generator.normal(0.0, 0.02, count),
        "airspeed_mps": (20.0 + generator.normal(0.0, 0.5, count)) / factor,
        "landed": np.zeros(count),
        "fixed_wing": np.ones(count),
    }
    return blocks(TelemetryTrack.of_columns(1, time_s, columns))


@pytest.mark.parametrize(("factor", "offset_deg", "climb_mps"), [(1.0, 0.0, 0.0), (0.93, 8.0, 0.0), (1.1, -5.0, 4.0)])
def test_factor_offset_and_wind_are_found_in_circles(factor, offset_deg, climb_mps):
    air = flight(factor=factor, offset_deg=offset_deg, climb_mps=climb_mps)
    fit = identify_airspeed(air)
    assert fit.model.factor == pytest.approx(factor, abs=4.0 * fit.factor_sigma + 0.002)
    assert math.degrees(fit.model.heading_offset_rad) == pytest.approx(offset_deg, abs=0.7)
    assert (fit.wind_north_mps, fit.wind_east_mps) == pytest.approx(tuple(WIND), abs=0.3)
    assert airspeed_wind(air, fit.model).wind.mean(axis=0) == pytest.approx(tuple(WIND), abs=0.3)


def test_the_stated_uncertainty_of_the_factor_is_of_the_right_size():
    scores = []
    for seed in range(20):
        fit = identify_airspeed(flight(seed=seed, factor=0.95, seconds=120, turn_deg_s=4.0))
        scores.append((fit.model.factor - 0.95) / fit.factor_sigma)
    assert 0.2 < float(np.sqrt(np.mean(np.square(scores)))) < 2.0


def test_a_straight_flight_cannot_tell_and_says_why():
    fit = identify_airspeed(flight(turn_deg_s=0.05, seconds=200))
    assert fit.model is None
    assert "courses" in fit.reason


def test_a_short_flight_cannot_tell():
    assert "30 are needed" in identify_airspeed(flight(seconds=20)).reason


@pytest.mark.parametrize("drag", [None, DragModel(linear_per_s=0.3)])
def test_a_file_reads_back_what_was_written(tmp_path, drag):
    model = AirspeedModel(factor=0.93, heading_offset_rad=0.15, sigma_mps=0.8, slip_sigma_rad=0.07)
    path = tmp_path / "drag.toml"
    path.write_text(drag_file(drag, ["found in flight.tlog"], model))
    found = read_air(path)
    assert found.drag == (None if drag is None else drag.another_flight())
    assert found.airspeed.factor == model.factor
    assert found.airspeed.heading_offset_rad == pytest.approx(model.heading_offset_rad)
    if drag is None:
        with pytest.raises(InputError, match="linear_per_s"):
            read_drag(path)


def test_a_file_tells_every_fault(tmp_path):
    path = tmp_path / "drag.toml"
    path.write_text('schema = "skyway.drag/1"\n[airspeed]\nfactor = 9.0\nheading = 3\n')
    with pytest.raises(InputError) as caught:
        read_air(path)
    assert "factor" in str(caught.value)
    assert "heading" in str(caught.value)
    with pytest.raises(InputError, match="airspeed"):
        AirspeedModel(factor=0.0)
