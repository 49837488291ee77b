"""Command ``check``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway import typed_values
from skyway.cli import airspace_options, options
from skyway.cli.options import FamilyName
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text, duration, energy_text, percent, probability
from skyway.models.base.json_text import json_text
from skyway.models.base.units import parse_instant
from skyway.models.composition.heights import least_words
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.report import CheckReport
    from skyway.missions.checks.weather import Weather
    from skyway.models.drones.drone import Drone
    from skyway.models.flight.way_heights import Over
    from skyway.models.scenario.scenario import Scenario


def check(
    file: Annotated[Path, typer.Argument(help="Mission file in any known format.")],
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario folder: its fleet, pads, no-fly zones, rules and wind are used.")
    ] = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    drone: Annotated[str | None, typer.Option(help="Drone id; m200-v2 is built in.")] = None,
    autopilot: Annotated[FamilyName | None, typer.Option(help="Autopilot to check the mission for.")] = None,
    wind: Annotated[str | None, typer.Option(help="Steady wind at flying height, m/s@degrees FROM: 8@270.")] = None,
    depart: Annotated[
        str | None, typer.Option(help="First take-off, with UTC offset. With --scenario, its forecast is used.")
    ] = None,
    forecast: Annotated[
        list[Path] | None,
        typer.Option(help="Weather forecast, as for skyway plan; repeatable. Goes with --scenario, --depart."),
    ] = None,
    payload: Annotated[float, typer.Option(help="Mass of the package, kg.")] = 0.0,
    soc: Annotated[float, typer.Option(help="Charge at the first take-off, percent.")] = 100.0,
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    clearance: Annotated[
        float | None, typer.Option(help="Clearance over terrain and obstacles, m. Without it: the scenario's, or 30.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the heights over the terrain: FILE.png or FILE.svg.")] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Check any mission file: structure, flyability, fence, wind and battery.

    Exit code 0: no errors; 1: errors, or a battery that does not last; 2: the file cannot be read.

    Examples
    --------
      skyway check survey.plan
      skyway check delivery.plan --drone m200-v2 --wind 8@270 --payload 1
      skyway check delivery.plan --scenario newyork --depart 2013-07-10T14:00-04:00 --json
      skyway check survey.plan --terrain S36E149.hgt.zip --obstacles towers.csv --plot heights.png
      skyway check survey.plan --zones national.json --depart 2026-08-05T14:00+02:00
    """
    from skyway.missions import check as check_mission
    from skyway.missions import family_named, read

    options.check_picture(plot)
    options.refuse_overwriting(plot, force=force)
    document = read(file)
    region = None if scenario is None else load_scenario(scenario)
    over = _over(region, terrain, obstacles, clearance)
    if plot is not None and over is None:
        raise InputError("there are no heights to draw", field="--plot", remedy="give a terrain model with --terrain")
    airspace = airspace_options.zones_of(region, zones or (), authorized or ())
    weather = _weather(region, wind, depart, forecast, zoned=bool(zones))
    conditions = _conditions(region, drone, weather, payload, soc, reserve)
    report = check_mission(
        document,
        dialect=family_named(autopilot) if autopilot else None,
        conditions=conditions,
        zones=airspace,
        over=over,
        depart_s=None if depart is None else parse_instant(depart, field="--depart").timestamp(),
    )
    if plot is not None:
        from skyway.plots.heights import plot_heights

        plot_heights(report.heights, plot, title=file.name)
        options.say_written(plot)
    if as_json:
        typer.echo(json_text(report, indent=1))
    else:
        typer.echo(_circumstances(conditions, wind, None if region is None else depart))
        _print_report(report)
    if not report.ok:
        raise typer.Exit(1)


def _over(
    region: Scenario | None, terrain: list[str] | None, obstacles: list[str] | None, clearance_m: float | None
) -> Over | None:
    """Terrain that a mission is checked over, and what it keeps."""
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


def _weather(
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


def _conditions(
    region: Scenario | None,
    drone: str | None,
    weather: Weather | None,
    payload_kg: float,
    soc_percent: float,
    reserve_percent: float,
) -> FlightConditions:
    from skyway.missions import FlightConditions, SteadyWind

    if not 0.0 <= payload_kg <= 1000.0:
        raise InputError("is not between 0 and 1000", field="--payload", value=payload_kg)
    vehicle, assumed = _vehicle(region, drone)
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


def _circumstances(conditions: FlightConditions, wind: str | None, depart: str | None) -> str:
    """Say in one line what the battery was checked with."""
    air = f"wind {wind}" if wind else f"forecast for {depart}" if depart else "still air"
    assumed = " (assumed)" if conditions.drone_is_assumed else ""
    return f"{conditions.drone.name}{assumed}, package {conditions.payload_kg:g} kg, {air}"


def _print_report(report: CheckReport) -> None:
    for finding in report.findings:
        typer.echo(str(finding))
    for number, leg in enumerate(report.legs, start=1):
        cells = [
            f"leg {number}: items {leg.item_from} to {leg.item_to}",
            distance_text(leg.distance_m),
        ]
        if leg.time_s is not None and leg.energy_j is not None and leg.soc_end is not None:
            cells += [
                duration(leg.time_s),
                energy_text(leg.energy_j),
                f"ends at {percent(leg.soc_end)}" if leg.soc_end > 0 else "the battery does not last",
                f"keeps the reserve with probability {probability(leg.p_reserve, 1)}",
            ]
        elif report.vehicle_judged:
            cells.append("no end, or cannot be flown")
        typer.echo(", ".join(cells))
        if number <= len(report.heights) and (heights := report.heights[number - 1]) is not None:
            typer.echo(f"  {least_words(heights)}")
    typer.echo(_verdict(report))


def _verdict(report: CheckReport) -> str:
    """Say ok only where nothing but information was found."""
    counts = []
    for severity in ("error", "warning"):
        number = sum(finding.severity == severity for finding in report.findings)
        if number:
            counts.append(f"{number} {severity}{'s' if number != 1 else ''}")
    told = ", ".join(counts) or "ok"
    return told if report.ok or "error" in told else f"{told}: not ok"
