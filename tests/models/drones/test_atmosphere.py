"""The standard atmosphere, by the table of ISO 2533."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.drones.atmosphere import density_kg_m3, height_of_pressure_m, pressure_pa


@pytest.mark.parametrize(
    ("height_m", "pressure", "density"),
    [(0.0, 101_325.0, 1.22500), (1000.0, 89_874.6, 1.11164), (2000.0, 79_495.2, 1.00649), (5000.0, 54_019.9, 0.736116)],
)
def test_pressure_and_density_are_those_of_the_table(height_m, pressure, density):
    assert float(pressure_pa(height_m)) == pytest.approx(pressure, rel=2e-4)
    assert density_kg_m3(height_m) == pytest.approx(density, rel=2e-4)


@given(st.floats(-400.0, 10_900.0), st.floats(230.0, 320.0))
def test_heights_come_back_and_density_follows_the_gas_law(height_m, temperature_k):
    pressure = float(pressure_pa(height_m))
    assert float(height_of_pressure_m(pressure)) == pytest.approx(height_m, abs=1e-3)
    assert density_kg_m3(height_m, temperature_k) == pytest.approx(pressure / 287.053 / temperature_k, rel=1e-3)
    assert np.all(np.diff(pressure_pa([height_m, height_m + 10.0])) < 0.0)
