"""Drones: payload, endurance, recharge time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from skyway.models.base.units import J_PER_WH, S_PER_H, S_PER_MIN
from skyway.models.drones.charging import ChargingCurve
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.drones.power import EnduranceEnergy, EnergyModel
from skyway.models.drones.weather_limits import NO_LIMITS, WeatherLimits


@dataclass(frozen=True, kw_only=True)
class Drone:
    """A model of drone that a provider operates.

    Attributes
    ----------
    id, name, provider : str
        Unique id, name for people, operator.
    mass_kg : float
        With batteries, without package.
    max_payload_kg : float
        Heaviest package.
    battery_j : float
        Nameplate energy of all batteries.
    endurance_empty_s, endurance_full_s : float
        Endurance without package and with the heaviest.
    max_airspeed_mps, max_ground_speed_mps : float
        Fastest the airframe flies through the air, and over the ground: multirotor autopilots hold ground speed and
        accept at most 20 m/s.
    wind_limit_mps : float
        Strongest wind it may fly in, at flying height.
    recharge_full_s : float
        0 to 100 % on a pad.
    price_per_km : float or None
        Price, in any one currency; only compared.
    wear_per_flight_h, wear_per_cycle : float
        Wear of the drone per hour of flight, and of its battery per full charge of flight, in the scenario's currency.
    energy : EnergyModel or None
        Power in flight; None is the `endurance` model of the figures above.
    energy_belief : EnergyBelief
        Uncertainty of that model for its flights; by default that of a drone without measurements.
    max_height_m : float
        Greatest height above the ground that it may be flown at.
    limits : WeatherLimits
        Of the weather besides the wind.
    cold : tuple of (float, float)
        Share of its nameplate energy that the battery holds at temperatures of the air, °C ascending; empty if unknown.
    battery_held : float
        Share of it that the battery holds now; `battery_j` is already reduced by it.
    """

    id: str
    name: str
    provider: str
    mass_kg: float
    max_payload_kg: float
    battery_j: float
    endurance_empty_s: float
    endurance_full_s: float
    max_airspeed_mps: float
    wind_limit_mps: float
    recharge_full_s: float
    max_ground_speed_mps: float = 20.0
    price_per_km: float | None = None
    wear_per_flight_h: float = 0.0
    wear_per_cycle: float = 0.0
    energy: EnergyModel | None = field(default=None)
    energy_belief: EnergyBelief = field(default=EnergyBelief())
    max_height_m: float = math.inf
    limits: WeatherLimits = NO_LIMITS
    cold: tuple[tuple[float, float], ...] = ()
    battery_held: float = 1.0

    @cached_property
    def energy_model(self) -> EnergyModel:
        """The model in force."""
        return self.energy or EnduranceEnergy(
            self.battery_j,
            self.mass_kg,
            self.mass_kg + self.max_payload_kg,
            self.endurance_empty_s,
            self.endurance_full_s,
        )

    def in_air(self, density_kg_m3: float) -> Drone:
        """Return the same drone in air of another density."""
        return replace(self, energy=self.energy_model.in_air(density_kg_m3))

    def in_cold(self, temperature_c: float) -> Drone:
        """Return the same drone with the energy that its battery holds at a temperature of the air."""
        if not self.cold:
            return self
        degrees, share = zip(*self.cold, strict=True)
        held = float(np.interp(temperature_c, degrees, share))
        nameplate_j = self.battery_j / self.battery_held
        return replace(self, energy=self.energy_model, battery_j=held * nameplate_j, battery_held=held)

    @property
    def flight_range_m(self) -> float:
        """Range in still air with the heaviest package at full airspeed (81 km/h x 24 min = 32.4 km for the M200 V2)."""
        return self.endurance_full_s * self.max_airspeed_mps

    @property
    def recharge_rate_w(self) -> float:
        """Mean power of a full recharge: what the skyline compares."""
        return self.battery_j / self.recharge_full_s

    @property
    def cruise_airspeed_mps(self) -> float:
        """Planned airspeed, unless the request gives one."""
        return min(self.max_airspeed_mps, self.max_ground_speed_mps)

    @property
    def figures(self) -> dict[str, float]:
        """The figures in the units and by the names of fleet files."""
        return {
            "mass_kg": self.mass_kg,
            "max_payload_kg": self.max_payload_kg,
            "battery_wh": self.battery_j / J_PER_WH,
            "endurance_empty_min": self.endurance_empty_s / S_PER_MIN,
            "endurance_full_min": self.endurance_full_s / S_PER_MIN,
            "max_airspeed_mps": self.max_airspeed_mps,
            "max_ground_speed_mps": self.max_ground_speed_mps,
            "wind_limit_mps": self.wind_limit_mps,
            "recharge_full_h": self.recharge_full_s / S_PER_H,
        }

    def charging_curve(self, pad_power_w: float | None = None) -> ChargingCurve:
        """Charging on a pad, limited by the pad's power where that is known."""
        if pad_power_w is None:
            return ChargingCurve(self.recharge_full_s)
        return ChargingCurve(self.recharge_full_s, pad_power_w / self.battery_j)


M200_V2 = Drone(
    id="m200-v2",
    name="DJI Matrice 200 V2",
    provider="skyway",
    mass_kg=4.69,
    max_payload_kg=1.45,
    battery_j=2 * 7.660 * 22.8 * J_PER_WH,
    endurance_empty_s=38 * S_PER_MIN,
    endurance_full_s=24 * S_PER_MIN,
    max_airspeed_mps=22.5,
    max_ground_speed_mps=20.0,
    wind_limit_mps=12.0,
    recharge_full_s=2.24 * S_PER_H,
)
"""The paper's drone (table 1) with two TB55 batteries; figures of the maker and of the paper."""
BUILT_IN = {drone.id: drone for drone in (M200_V2,)}
"""Drones that a fleet may start from with ``base``, and the fleet where none is given."""
