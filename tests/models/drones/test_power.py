"""Power in flight: the published endurances of the M200, and momentum theory as measured on the M100."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.drones.drone import M200_V2
from skyway.models.drones.power import M100_COEFFICIENTS, PHASES, EnduranceEnergy, MomentumEnergy

MODEL = M200_V2.energy_model


def test_the_m200_has_the_figures_of_its_maker():
    assert M200_V2.battery_j / 3600.0 == pytest.approx(349.0, abs=0.5)
    assert M200_V2.mass_kg + M200_V2.max_payload_kg == pytest.approx(6.14)
    assert M200_V2.flight_range_m == pytest.approx(32_400.0)
    assert M200_V2.wind_limit_mps == 12.0
    assert M200_V2.max_airspeed_mps * 3.6 == pytest.approx(81.0)


def test_the_m200_takes_552_watts_empty_and_grows_with_mass_to_the_power_of_1_71():
    assert isinstance(MODEL, EnduranceEnergy)
    assert MODEL.empty_power_w == pytest.approx(552.0, abs=0.6)
    assert MODEL.kappa == pytest.approx(1.71, abs=0.005)


def test_a_full_battery_lasts_the_published_38_and_24_minutes():
    assert M200_V2.battery_j / MODEL.power_w(4.69) / 60.0 == pytest.approx(38.0)
    assert M200_V2.battery_j / MODEL.power_w(4.69 + 1.45) / 60.0 == pytest.approx(24.0)


@given(st.floats(4.69, 6.14), st.floats(4.69, 6.14), st.sampled_from(PHASES))
def test_a_heavier_drone_takes_more(a, b, phase):
    light, heavy = sorted((a, b))
    assert MODEL.power_w(light, phase) <= MODEL.power_w(heavy, phase)
    assert MomentumEnergy().power_w(light, phase) <= MomentumEnergy().power_w(heavy, phase)


def test_a_drone_that_lifts_nothing_follows_momentum_theory():
    model = EnduranceEnergy(1e6, 2.0, 2.0, 1800.0, 1800.0)
    assert model.kappa == 1.5
    assert model.power_w(2.0) == pytest.approx(1e6 / 1800.0)


@pytest.mark.parametrize(
    ("phase", "b1", "b0"), [("climb", 80.4, 13.8), ("cruise", 68.9, 16.8), ("descent", 71.5, -24.3)]
)
def test_the_momentum_model_has_the_published_coefficients(phase, b1, b0):
    assert M100_COEFFICIENTS[phase] == (b1, b0)
    assert MomentumEnergy().power_w(3.68, phase) == pytest.approx(b1 * 3.68**1.5 / math.sqrt(1.225) + b0)


def test_thin_air_costs_power():
    assert MomentumEnergy(air_density_kg_m3=0.9).power_w(4.0) > MomentumEnergy().power_w(4.0)


def test_charging_takes_as_many_times_the_flying_as_the_design_says():
    per_flight_second = M200_V2.recharge_full_s / M200_V2.battery_j
    assert MODEL.power_w(4.69) * per_flight_second == pytest.approx(3.5, abs=0.05)
    assert MODEL.power_w(6.14) * per_flight_second == pytest.approx(5.6, abs=0.05)
