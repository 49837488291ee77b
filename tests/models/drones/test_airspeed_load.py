"""Power over airspeed: less than in hover at medium speed, more beyond; and so it is in real flights."""

import csv

import numpy as np
import pytest

from skyway.models.drones.airspeed_load import AirspeedLoad
from skyway.models.drones.drag import DragModel

M200 = AirspeedLoad(DragModel(linear_per_s=0.037, quadratic_per_m=0.005))


def test_it_is_that_of_hover_at_first_dips_and_rises():
    speeds = np.arange(0.0, 24.0, 0.5)
    load = M200.factor(speeds)
    assert load[0] == pytest.approx(1.0)
    least = speeds[np.argmin(load)]
    assert 7.0 < least < 15.0
    assert 0.75 < load.min() < 0.9
    assert (np.diff(load[speeds >= least]) > 0.0).all()
    assert M200.factor(20.0) > 1.05


def test_more_drag_takes_more_power_and_the_sign_of_the_speed_does_not_matter():
    heavy = AirspeedLoad(DragModel(linear_per_s=0.08, quadratic_per_m=0.01))
    assert (heavy.factor([5.0, 10.0, 20.0]) > M200.factor([5.0, 10.0, 20.0])).all()
    assert M200.factor(-8.0) == M200.factor(8.0)


@pytest.mark.parametrize("flight", [268, 272])
def test_real_flights_with_an_anemometer_take_less_at_medium_airspeed_by_about_as_much(flight, shared_data):
    """CMU's Matrice 100, level cruise, wind and ground speed mixed: nothing of the model was fitted to it."""
    path = shared_data / "power" / f"m100_flight_{flight}.csv"
    if not path.exists():
        pytest.skip("the flights are not here")
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if row["regime"] == "cruise"]
    speed, power, up = (np.array([float(row[name]) for row in rows]) for name in ("wind_speed", "y", "twist_linear_z"))
    level = (power > 100.0) & (np.abs(up) < 0.5)
    slow, medium = (np.median(power[level & (low <= speed) & (speed < low + 2.0)]) for low in (2.0, 8.0))
    measured, told = medium / slow, M200.factor(9.0) / M200.factor(3.0)
    assert measured < 0.96
    assert told == pytest.approx(measured, abs=0.12)
