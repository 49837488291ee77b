"""Fleets of drones, as TOML (``schema = "skyway.fleet/1"``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.fields import Table, read_toml
from skyway.models.base.formatting import energy_text, mass_text
from skyway.models.base.units import AIR_DENSITY_KG_M3, J_PER_WH, S_PER_H, S_PER_MIN
from skyway.models.drones.drone import BUILT_IN, Drone
from skyway.models.drones.energy_belief import RANGES, EnergyBelief
from skyway.models.drones.power import M100_COEFFICIENTS, PHASES, EnergyModel, MomentumEnergy, Phase
from skyway.models.drones.weather_limits import NO_LIMITS, read_limits

if TYPE_CHECKING:
    from pathlib import Path

SCHEMA = "skyway.fleet/1"
MAX_DRONES = 1000
MAX_WH_PER_KG = 2000.0
"""Energy aboard per kg of the drone, beyond any battery, fuel cell or tank with generator."""
MIN_W_PER_KG = 1.0
"""Mean power per kg that keeps nothing in the air: a glider takes some watts."""


def read_fleet(path: Path) -> tuple[Drone, ...]:
    """Read a fleet; an `InputError` lists every fault in the file."""
    faults: list[Fault] = []
    top = Table(read_toml(path), str(path), "", faults)
    top.text("schema", SCHEMA, choices=(SCHEMA,))
    tables = top.tables("drone")
    top.finish()
    drones = [_drone(table) for table in tables[:MAX_DRONES]]
    if len(tables) > MAX_DRONES:
        top.fault("drone", f"more than {MAX_DRONES} drones", len(tables))
    if not tables and not faults:
        top.fault("drone", "the fleet is empty", remedy="add a [[drone]] table")
    seen: set[str] = set()
    for table, drone in zip(tables, drones, strict=False):
        if drone.id and drone.id in seen:
            table.fault("id", "two drones have the same id", drone.id)
        seen.add(drone.id)
    if faults:
        raise InputError(faults)
    return tuple(drones)


def _drone(table: Table) -> Drone:
    base_id = table.text("base", "none", choices=("none", *BUILT_IN))
    base = BUILT_IN.get(base_id)

    def number(key: str, attribute: str, low: float, high: float, unit: float = 1.0) -> float:
        of_base = None if base is None else getattr(base, attribute) / unit
        return unit * table.number(key, of_base, low=low, high=high)

    mass = number("mass_kg", "mass_kg", 0.05, 1000)
    payload = number("max_payload_kg", "max_payload_kg", 0, 1000)
    battery = number("battery_wh", "battery_j", 1, 1e6, J_PER_WH)
    empty = number("endurance_empty_min", "endurance_empty_s", 1, 1e5, S_PER_MIN)
    full = number("endurance_full_min", "endurance_full_s", 1, 1e5, S_PER_MIN)
    airspeed = number("max_airspeed_mps", "max_airspeed_mps", 1, 150)
    ground = table.number("max_ground_speed_mps", base.max_ground_speed_mps if base else 20.0, low=1, high=150)
    limit = number("wind_limit_mps", "wind_limit_mps", 1, 60)
    height = table.number("max_height_m", base.max_height_m if base else math.inf, above=0)
    recharge = number("recharge_full_h", "recharge_full_s", 0.01, 100, S_PER_H)
    price = table.number("price_per_km", low=0, high=1e6) if "price_per_km" in table else None
    wear_h = table.number("wear_per_flight_h", 0.0, low=0, high=1e6)
    wear_cycle = table.number("wear_per_cycle", 0.0, low=0, high=1e6)
    if full > empty:
        table.fault("endurance_full_min", "is longer than endurance_empty_min", full / S_PER_MIN)
    _check_energy(table, battery, mass, empty)
    energy, belief = _energy(table, mass), _energy_belief(table)
    drone = Drone(
        id=table.text("id"),
        name=table.text("name", base.name if base else None),
        provider=table.text("provider", base.provider if base else None),
        mass_kg=mass,
        max_payload_kg=payload,
        battery_j=battery,
        endurance_empty_s=empty,
        endurance_full_s=full,
        max_airspeed_mps=airspeed,
        max_ground_speed_mps=ground,
        wind_limit_mps=limit,
        recharge_full_s=recharge,
        price_per_km=price,
        wear_per_flight_h=wear_h,
        wear_per_cycle=wear_cycle,
        energy=energy,
        energy_belief=belief,
        max_height_m=height,
        limits=read_limits(table.table("limits")) if "limits" in table else NO_LIMITS if base is None else base.limits,
        cold=_cold(table),
    )
    table.finish()
    return drone


def _check_energy(table: Table, battery_j: float, mass_kg: float, endurance_s: float) -> None:
    """Find a battery given in another unit: too much energy for its mass, or too little for its endurance."""
    least_j, most_j = MIN_W_PER_KG * mass_kg * endurance_s, MAX_WH_PER_KG * mass_kg * J_PER_WH
    told = f"for {mass_text(mass_kg)} and endurance_empty_min"
    remedy = f"watt-hours of all batteries together, from {energy_text(least_j)} to {energy_text(most_j)} {told}"
    if battery_j > most_j:
        table.fault(
            "battery_wh", f"is more than any battery of {mass_text(mass_kg)} holds", battery_j / J_PER_WH, remedy
        )
    elif battery_j < least_j:
        table.fault("battery_wh", "is too little to fly for endurance_empty_min", battery_j / J_PER_WH, remedy)


def _cold(table: Table) -> tuple[tuple[float, float], ...]:
    """Read the share that the battery holds by temperature."""
    found = []
    for row in table.tables("cold_battery"):
        found.append((row.number("temperature_c", low=-60, high=60), row.number("held", above=0, high=1)))
        row.finish()
    if len({degrees for degrees, _ in found}) < len(found):
        table.fault("cold_battery", "has two rows of one temperature")
    return tuple(sorted(found))


def _energy_belief(table: Table) -> EnergyBelief:
    usual = EnergyBelief()
    if "energy_belief" not in table:
        return usual
    values = table.table("energy_belief")
    found = {
        name: values.number(name, getattr(usual, name), low=low, high=high) for name, (low, high) in RANGES.items()
    }
    values.finish()
    return EnergyBelief(**found)


def _energy(table: Table, mass_kg: float) -> EnergyModel | None:
    kind = table.text("energy_model", "endurance", choices=("endurance", "momentum"))
    if kind == "endurance":
        if "momentum" in table:
            table.table("momentum")
            table.fault("momentum", "is not used", None, 'energy_model = "momentum" uses it')
        return None
    values = table.table("momentum")
    coefficients: dict[Phase, tuple[float, float]] = {}
    density = values.number("air_density_kg_m3", AIR_DENSITY_KG_M3, low=0.3, high=2.0)
    for phase in PHASES:
        slope, offset = M100_COEFFICIENTS[phase]
        part = values.table(phase)
        b1, b0 = part.number("b1", slope, above=0, high=1e5), part.number("b0", offset, low=-1e5, high=1e5)
        part.finish()
        coefficients[phase] = (b1, b0)
        power = MomentumEnergy(coefficients, density).power_w(mass_kg, phase)
        if power <= 0.0:
            part.fault("b0", f"makes the power of the empty drone {power:.0f} W", b0, "it must stay above 0 W")
    values.finish()
    return MomentumEnergy(coefficients, density)
