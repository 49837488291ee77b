"""The air of a fleet: its density by height and temperature, and the effect of cold on a battery."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import percent
from skyway.models.base.units import AIR_DENSITY_KG_M3
from skyway.models.drones.atmosphere import LAPSE_K_M, density_kg_m3

if TYPE_CHECKING:
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble

LOW_M = 500.0
"""Below this height, air of an unknown temperature counts as that at sea level: 2.5 % of the power at most."""
HIGH_SHARE = 0.9
"""Quantile of the stations' heights: one in ten may be higher than the assumed air."""
TOLD_SHARE = 0.005
"""A power that differs from that at sea level by more is reported."""
AHEAD_S = 6 * 3600.0
"""Temperatures from the departure to this much later count."""
ZERO_C_K = 273.15
COLD_C = 5.0
"""Below this temperature, batteries hold less than their nameplate energy."""
NOT_COUNTED = "what the cold takes of the battery is not counted ([[drone.cold_battery]] in the fleet file says it)"


def fleet_in_air(scenario: Scenario, forecast: WindEnsemble | None = None, begin_s: float = 0.0) -> Scenario:
    """Return a scenario whose drones fly in the air over its stations, at the temperatures forecast from an instant on.

    Without a temperature, the standard atmosphere applies, from `LOW_M` on; another density in a fleet file is kept.
    """
    ground_m = scenario.network.ground_m
    known = ground_m[np.isfinite(ground_m)]
    high_m = (float(np.quantile(known, HIGH_SHARE)) if len(known) else 0.0) + scenario.rules.cruise_height_m
    coldest_k, warmest_k = _temperatures(forecast, begin_s)
    if warmest_k is not None:
        density = density_kg_m3(high_m, warmest_k - LAPSE_K_M * scenario.rules.cruise_height_m)
        return replace(
            scenario,
            drones=tuple(one.in_air(density).in_cold((coldest_k or warmest_k) - ZERO_C_K) for one in scenario.drones),
        )
    if high_m < LOW_M:
        return scenario
    standard = density_kg_m3(high_m)
    return replace(
        scenario,
        drones=tuple(
            one.in_air(standard) if one.energy_model.air_density_kg_m3 == AIR_DENSITY_KG_M3 else one
            for one in scenario.drones
        ),
    )


def air_notes(drone: Drone, forecast: WindEnsemble, begin_s: float) -> list[str]:
    """Describe the effect of the air on the flights of a drone, and cold whose effect is unknown."""
    density = drone.energy_model.air_density_kg_m3
    more = drone.energy_model.power_w(drone.mass_kg) / drone.energy_model.in_air(AIR_DENSITY_KG_M3).power_w(
        drone.mass_kg
    )
    notes = []
    if abs(more - 1.0) > TOLD_SHARE:
        word = "more" if more > 1.0 else "less"
        notes.append(
            f"air of {density:.2f} kg/m³: flights take {percent(abs(more - 1.0))} {word} power than at sea level at 15 °C"
        )
    coldest_k, _ = _temperatures(forecast, begin_s)
    if coldest_k is not None and coldest_k - ZERO_C_K < COLD_C:
        held = f"batteries hold {percent(drone.battery_held)}" if drone.cold else NOT_COUNTED
        notes.append(f"down to {coldest_k - ZERO_C_K:.0f} °C: {held}")
    return notes


def _temperatures(forecast: WindEnsemble | None, begin_s: float) -> tuple[float | None, float | None]:
    """Lowest and highest temperature forecast from an instant on, K."""
    if forecast is None or forecast.weather is None:
        return None, None
    found = []
    for name, extreme in (("coldest", np.min), ("warmest", np.max)):
        told = forecast.weather.between(name, begin_s, begin_s + AHEAD_S)
        found.append(float(extreme(told)) if len(told) else None)
    return found[0], found[1]
