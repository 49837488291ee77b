"""A drone's derived figures, which the skyline compares and the planners use."""

from dataclasses import replace

import pytest

from skyway.models.drones.drone import M200_V2
from skyway.models.drones.power import EnduranceEnergy, MomentumEnergy


def test_a_drone_flies_no_faster_than_its_autopilot_accepts():
    assert M200_V2.cruise_airspeed_mps == 20.0
    assert replace(M200_V2, max_airspeed_mps=15.0).cruise_airspeed_mps == 15.0


def test_the_recharge_rate_is_the_mean_power_of_a_full_recharge():
    assert M200_V2.recharge_rate_w * M200_V2.recharge_full_s == pytest.approx(M200_V2.battery_j)
    assert M200_V2.recharge_rate_w == pytest.approx(156.0, abs=1.0)


def test_a_drone_without_its_own_energy_model_follows_its_endurances():
    assert M200_V2.energy_model == EnduranceEnergy(M200_V2.battery_j, 4.69, 4.69 + 1.45, 2280.0, 1440.0)
    assert replace(M200_V2, energy=MomentumEnergy()).energy_model.name == "momentum"


def test_a_changed_drone_has_its_own_derived_figures():
    assert M200_V2.energy_model.power_w(4.69) == pytest.approx(551.2, abs=0.5)
    doubled = replace(M200_V2, battery_j=2.0 * M200_V2.battery_j)
    assert doubled.energy_model.power_w(4.69) == pytest.approx(2.0 * 551.2, abs=1.0)


def test_a_pad_of_unknown_power_limits_nothing():
    assert M200_V2.charging_curve().total_s == pytest.approx(2.24 * 3600.0)
    assert M200_V2.charging_curve(100.0).total_s > 2.24 * 3600.0
