"""The air that a fleet flies in: thin, warm and cold, against the formulas of a textbook."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.building import build_scenario
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.power import MomentumEnergy
from skyway.models.scenario.air import air_notes, fleet_in_air
from skyway.models.wind.ensemble import HourlyWeather
from skyway.models.wind.forecast import constant_wind


def region(ground_m, drone=M200_V2):
    rows = [{"id": name, "lat": 47.0 + 0.02 * n, "lon": 9.0, "elevation_m": ground_m} for n, name in enumerate("ab")]
    return build_scenario(rows, drones=[drone])


def told(**temperatures_k):
    values = {name: np.full(30, value) for name, value in temperatures_k.items()}
    return replace(
        constant_wind(5.0, 0.0, datetime.fromtimestamp(0, UTC), 30, 47.0, 9.0, 60.0),
        weather=HourlyWeather(0.0, 3600.0, values),
    )


def power_w(scenario):
    return scenario.drones[0].energy_model.power_w(5.0)


def test_below_500_m_without_a_temperature_nothing_is_changed():
    assert fleet_in_air(region(400.0)).drones == (M200_V2,)


@pytest.mark.parametrize(
    "model", [None, MomentumEnergy({"climb": (80.0, 0.0), "cruise": (70.0, 0.0), "descent": (60.0, 0.0)})]
)
def test_power_grows_as_the_root_of_the_density_falls(model):
    low, high = (fleet_in_air(region(ground, replace(M200_V2, energy=model))) for ground in (0.0, 1940.0))
    assert power_w(high) / power_w(low) == pytest.approx(math.sqrt(1.225 / 1.00649), rel=1e-3)  # ISO 2533 at 2,000 m
    assert fleet_in_air(high).drones == high.drones


def test_heat_and_cold_count_where_they_are_forecast():
    drone = replace(M200_V2, cold=((-20.0, 0.5), (0.0, 0.9), (20.0, 1.0)))
    scenario = region(0.0, drone)
    hot = fleet_in_air(scenario, told(coldest=303.15, warmest=313.15), 7200.0)
    expected = 101_325.0 / (287.05 * 313.15)
    assert power_w(hot) / power_w(scenario) == pytest.approx(math.sqrt(1.225 / expected), rel=4e-3)
    assert hot.drones[0].battery_j == drone.battery_j
    cold = told(coldest=263.15, warmest=275.15)
    found = fleet_in_air(scenario, cold, 7200.0).drones[0]
    assert found.battery_j == pytest.approx(0.7 * drone.battery_j)
    assert fleet_in_air(replace(scenario, drones=(found,)), cold, 7200.0).drones == (found,)
    assert any("batteries hold 70 %" in note for note in air_notes(found, cold, 7200.0))
    assert any("is not counted" in note for note in air_notes(M200_V2, cold, 7200.0))
    assert (
        fleet_in_air(scenario, told(warmest=313.15), 31 * 3600.0).drones == scenario.drones
    )  # after its end nothing is known
