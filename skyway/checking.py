"""Conditions of mission checks from typed values: vehicle, wind, terrain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway import typed_values
from skyway.models.base.errors import InputError
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.weather import Weather
    from skyway.models.drones.drone import Drone
    from skyway.models.flight.way_heights import Over
    from skyway.models.scenario.scenario import Scenario


def over_of(
    region: Scenario | None, terrain: list[str] | None, obstacles: list[str] | None, clearance_m: float | None
) -> Over | None:
    """Return the terrain that a mission is checked over, and what it keeps."""
    from dataclasses import replace

    from skyway.models.flight.rules import FlightRules
    from skyway.models.flight.way_heights import Over
    from skyway.models.terrain.files import read_terrain
    from skyway.scenarios import with_terrain

    if region is not None:
        over = with_terrain(region, terrain, obstacles).network.over
    elif terrain or obstacles:
        rules = FlightRules()
        over = Over(read_terrain(terrain or (), obstacles or ()), rules.clearance, rules.cruise_height_m)
    else:
        over = None
    if clearance_m is None:
        return over
    if not 0.0 <= clearance_m <= 1000.0:
        raise InputError("is not between 0 and 1000 m", field="--clearance", value=clearance_m)
    if over is None:
        raise InputError("needs a terrain model", field="--clearance", remedy="give --terrain too")
    return replace(over, clearance=replace(over.clearance, least_m=clearance_m))


def obstacle_notes(over: Over | None, places: Sequence[tuple[float, float]]) -> list[str]:
    """Return a note on each file of obstacles that lies nowhere near a mission; those with lat and lon exchanged are refused."""
    import numpy as np

    from skyway.models.scenario.checks import misplaced_obstacles

    if over is None or not places:
        return []
    return misplaced_obstacles(np.array(places), over.terrain.obstacles, "the mission")


def weather_of(
    region: Scenario | None, wind: str | None, depart: str | None, forecast: list[Path] | None, *, zoned: bool
) -> Weather | None:
    """Return the wind of a check; a departure alone may be meant for the zones."""
    from skyway.missions import ForecastWind, SteadyWind

    if wind is not None:
        if (depart is not None and not zoned) or forecast:
            raise InputError("a steady wind and a forecast exclude each other", field="--wind, --depart")
        return SteadyWind(*typed_values.parse_wind(wind))
    if depart is None and forecast:
        raise InputError("a forecast needs a departure", field="--forecast", remedy="give --depart, the first take-off")
    if depart is None or (region is None and zoned and not forecast):
        return None
    if region is None:
        raise InputError("a forecast needs a scenario", field="--depart", remedy="give --scenario too, or --wind")
    start = parse_instant(depart, field="--depart")
    rules = region.rules
    found = region.forecast_from(forecast, start, 24) if forecast else region.forecast(start, 24)
    return ForecastWind(found, start.timestamp(), rules.wind_profile_exponent)


def conditions_of(
    region: Scenario | None,
    drone: str | None,
    weather: Weather | None,
    payload_kg: float,
    soc_percent: float,
    reserve_percent: float,
    fleet: Path | None = None,
) -> FlightConditions:
    """Return the vehicle, its package and charge, and the wind that it flies in; a fleet file comes before the scenario's fleet."""
    from skyway.missions import FlightConditions, ForecastWind, SteadyWind
    from skyway.models.scenario.air import fleet_in_air

    if region is not None and isinstance(weather, ForecastWind):
        region = fleet_in_air(region, weather.ensemble, weather.depart_s)
    if not 0.0 <= payload_kg <= 1000.0:
        raise InputError("is not between 0 and 1000", field="--payload", value=payload_kg)
    vehicle, assumed = _vehicle(region, drone) if fleet is None else (_of_fleet(fleet, drone), False)
    rules = region.rules if region else None
    return FlightConditions(
        vehicle,
        payload_kg,
        typed_values.percent(soc_percent, "--soc"),
        typed_values.percent(reserve_percent, "--reserve"),
        rules.climb_rate_mps if rules else 5.0,
        rules.descent_rate_mps if rules else 3.0,
        weather or SteadyWind(),
        region.network.stations if region else (),
        assumed,
    )


def _vehicle(region: Scenario | None, identity: str | None) -> tuple[Drone, bool]:
    """Return the vehicle, and whether nobody named it."""
    from skyway.models.drones.drone import BUILT_IN

    if identity is None:
        if region is not None and len(region.drones) == 1:
            return region.drones[0], False
        return BUILT_IN["m200-v2"], True
    if region is not None and any(drone.id == identity for drone in region.drones):
        return region.drone(identity), False
    if identity in BUILT_IN:
        return BUILT_IN[identity], False
    if region is not None:
        return region.drone(identity), False
    remedy = f"built in: {', '.join(BUILT_IN)}; a scenario brings its own fleet"
    raise InputError("no such drone", field="--drone", value=identity, remedy=remedy)


def _of_fleet(fleet: Path, identity: str | None) -> Drone:
    from skyway.models.drones.fleet import read_fleet

    drones = read_fleet(fleet)
    if identity is None and len(drones) == 1:
        return drones[0]
    for drone in drones:
        if drone.id == identity:
            return drone
    known = ", ".join(drone.id for drone in drones)
    raise InputError("no such drone", str(fleet), field="--drone", value=identity, remedy=f"the fleet has {known}")
