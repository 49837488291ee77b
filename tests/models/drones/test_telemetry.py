"""Samples and tracks say the same, and what is not known is NaN."""

import math

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.drones.telemetry import QUANTITIES, TelemetrySample, TelemetryTrack


def test_what_is_not_said_is_not_known():
    sample = TelemetrySample(time_s=1.0)
    assert all(math.isnan(getattr(sample, name)) for name in QUANTITIES)
    assert math.isnan(sample.ground_speed_mps)


def test_samples_become_a_track_and_come_back_the_same():
    samples = [
        TelemetrySample(time_s=float(second), system=3, vel_north_mps=3.0, vel_east_mps=4.0, soc=0.5)
        for second in range(5)
    ]
    track = TelemetryTrack.of_samples(samples)
    back = list(track.samples())
    assert [(one.time_s, one.system, one.soc, one.ground_speed_mps) for one in back] == [
        (one.time_s, one.system, one.soc, 5.0) for one in samples
    ]
    assert math.isnan(back[0].lat_deg)


def test_a_track_is_of_one_vehicle():
    with pytest.raises(InputError, match="one vehicle"):
        TelemetryTrack.of_samples([TelemetrySample(time_s=0.0, system=1), TelemetrySample(time_s=1.0, system=2)])


def test_a_part_of_a_track_has_its_first_moment_and_not_its_last():
    track = TelemetryTrack.of_columns(1, np.arange(10.0), {"soc": np.linspace(1.0, 0.1, 10)})
    assert track.between(2.0, 5.0).time_s.tolist() == [2.0, 3.0, 4.0]
    assert len(track.between(20.0, 30.0)) == 0


def test_nothing_joined_is_an_empty_track():
    assert len(TelemetryTrack.joined(())) == 0
    assert list(TelemetryTrack.of_samples(()).samples()) == []


def test_columns_of_another_length_are_refused():
    with pytest.raises(InputError, match="do not fit"):
        TelemetryTrack(1, np.zeros(3), np.zeros((2, len(QUANTITIES))))


def test_a_sample_of_a_row_is_the_sample_that_the_constructor_makes():
    row = [float(number) for number in range(len(QUANTITIES))]
    made = TelemetrySample.of_row(5.0, 3, row)
    assert made == TelemetrySample(time_s=5.0, system=3, **dict(zip(QUANTITIES, row, strict=True)))
    with pytest.raises(ValueError, match="zip"):
        TelemetrySample.of_row(5.0, 3, row[1:])
