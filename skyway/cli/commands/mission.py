"""Commands ``mission``, ``convert``, ``check`` and ``show``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skyway.cli import airspace_options, options
from skyway.cli.options import FamilyName
from skyway.cli.views.sheet import Column, Sheet
from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text, duration, energy_text, percent, probability, stored_degrees
from skyway.models.base.json_text import json_text
from skyway.models.base.units import parse_instant
from skyway.models.composition.heights import least_words
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.builder.from_composition import Export
    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.report import CheckReport
    from skyway.missions.checks.weather import Weather
    from skyway.missions.items.document import MissionDocument
    from skyway.models.drones.drone import Drone
    from skyway.models.flight.way_heights import Over
    from skyway.models.scenario.scenario import Scenario


def mission(
    plan: Annotated[Path, typer.Argument(help="Plan, as written by skyway plan -o.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write: .plan or .waypoints.")],
    whole: Annotated[bool, typer.Option("--whole", help="All legs in one mission (the default).")] = False,
    leg: Annotated[int | None, typer.Option(help="One leg only, numbered from 1.")] = None,
    autopilot: Annotated[FamilyName, typer.Option(help="Autopilot of the vehicle.")] = NAMES[0],
    firmware: Annotated[
        str,
        typer.Option(
            help="Firmware version, such as 4.6, 1.16 or main; parameter names depend on it. Without it: the newest release."
        ),
    ] = "",
    armed_hold: Annotated[
        bool, typer.Option("--armed-hold", help="Stay armed on the pads and take off by the clock. Dangerous.")
    ] = False,
    width: Annotated[float, typer.Option(help="Width of the fenced corridor, m; 0 writes no fence.")] = 400.0,
    release: Annotated[
        Literal["gripper", "operator"], typer.Option(help="How the package is released at the end.")
    ] = "gripper",
    cruise_height: Annotated[
        float | None, typer.Option(help="Cruise height above ground, m. Without it: the plan's.")
    ] = None,
    climb: Annotated[float | None, typer.Option(help="Climb rate, m/s.")] = None,
    descent: Annotated[float | None, typer.Option(help="Descent rate, m/s.")] = None,
    max_speed: Annotated[float | None, typer.Option(help="Highest ground speed, m/s.")] = None,
    elevation: Annotated[
        list[str] | None, typer.Option(help="Ground height of a station that lacks it: ID=METRES; repeatable.")
    ] = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario folder: its zones must let every leg be flown at its time.")
    ] = None,
    zones: options.Zones = None,
    force: options.Force = False,
) -> None:
    """Turn a composition into missions for a ground station, with fence, rally points and parameters.

    Examples
    --------
      skyway mission plan.json -o delivery.plan
      skyway mission plan.json -o delivery.waypoints --autopilot ardupilot
      skyway mission plan.json -o leg1.plan --leg 1 --width 600
      skyway mission plan.json -o delivery.plan --zones national.json
    """
    from skyway.flying import heights, terrain_of
    from skyway.missions import family_named
    from skyway.missions.builder.from_composition import armed_mission, leg_mission, whole_mission
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.models.composition.file import load

    if leg is not None and (whole or armed_hold):
        other = "--whole" if whole else "--armed-hold"
        raise InputError("one leg and all legs exclude each other", field=f"--leg, {other}")
    composition, flown_by = load(plan), family_named(autopilot)
    how = MissionOptions(
        cruise_height, climb, descent, max_speed, width or None, release, elevation_m=heights(None, elevation),
        over=terrain_of(composition, terrain, obstacles),
    )  # fmt: skip
    if zones or scenario is not None:
        region = None if scenario is None else load_scenario(scenario)
        airspace_options.refuse_closed(
            composition, flown_by, how, airspace_options.zones_of(region, zones or (), composition.authorized)
        )
    if leg is not None:
        export = leg_mission(composition, _leg_index(leg, len(composition.services)), flown_by, how)
    elif armed_hold:
        export = armed_mission(composition, flown_by, how)
    else:
        export = whole_mission(composition, flown_by, how)
    settings = flown_by.parameter_file(export.parameters, firmware or flown_by.released)
    _write_export(export, settings, output, force=force)


def _leg_index(number: int, legs: int) -> int:
    """Index of a leg that a person has typed: they count from 1."""
    if not 1 <= number <= legs:
        known = "the plan has one leg: 1" if legs == 1 else f"legs are numbered from 1: the plan has legs 1 to {legs}"
        raise InputError("no such leg", field="--leg", value=number, remedy=known)
    return number - 1


def _write_export(export: Export, parameters: str, output: Path, *, force: bool) -> None:
    """Write every mission of an export and its parameters, or nothing."""
    from skyway.missions import write
    from skyway.missions.files.mission_file import files_of
    from skyway.models.base.files import write_atomically

    count = len(export.documents)
    targets = [
        output if count == 1 else output.with_name(f"{output.stem}.leg{number}{output.suffix}")
        for number in range(1, count + 1)
    ]
    settings = output.with_suffix(".param")
    planned = [file for pair in zip(export.documents, targets, strict=True) for file in files_of(*pair)]
    options.refuse_overwriting(*planned, settings, force=force)
    for warning in export.warnings:
        typer.echo(f"warning: {warning}", err=True)
    for document, target in zip(export.documents, targets, strict=True):
        _echo_written(document, write(document, target, force=force))
    write_atomically(settings, parameters, force=force)
    typer.echo(f"wrote {settings} (parameters that the vehicle needs)")
    for note in export.notes:
        typer.echo(note)


def _echo_written(document: MissionDocument, files: Sequence[Path]) -> None:
    """Return what went into each file."""
    items = f"{len(document.mission.items)} items"
    fence, rally = f"{len(document.fence.areas)} fence areas", f"{len(document.rally.points)} rally points"
    for file in files:
        if file.name.endswith(".fence.waypoints"):
            held = fence
        elif file.name.endswith(".rally.waypoints"):
            held = rally
        else:
            held = items if len(files) > 1 or file.suffix != ".plan" else f"{items}, {fence}, {rally}"
        typer.echo(f"wrote {file} ({held})")


def convert(
    source: Annotated[Path, typer.Argument(help="Mission, fence or rally file in any known format.")],
    target: Annotated[Path, typer.Argument(help="File to write: .plan or .waypoints.")],
    force: options.Force = False,
) -> None:
    """Convert a mission file between QGroundControl and Mission Planner formats.

    A .waypoints file holds the mission alone; fence and rally points go to separate files. What the new
    format cannot hold is reported.

    Examples
    --------
      skyway convert survey.plan survey.waypoints
      skyway convert old-fence.txt fence.plan
    """
    from skyway.missions import read, write
    from skyway.missions.files.dropped import dropped

    document = read(source)
    _echo_written(document, write(document, target, force=force))
    for line in dropped(document, target.suffix):
        typer.echo(f"not kept: {line}", err=True)


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
        return SteadyWind(*options.parse_wind(wind))
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
        options.percent(soc_percent, "--soc"),
        options.percent(reserve_percent, "--reserve"),
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


def show(
    file: Annotated[Path, typer.Argument(help="Mission file in any known format.")],
    plot: Annotated[Path | None, typer.Option(help="Draw map and height profile: FILE.png or FILE.svg.")] = None,
    force: options.Force = False,
) -> None:
    """Show a mission file as a table, and draw it.

    Examples
    --------
      skyway show survey.plan
      skyway show delivery.waypoints --plot delivery.png
    """
    from skyway.missions import read

    options.check_picture(plot)
    options.refuse_overwriting(plot, force=force)
    document = read(file)
    _print_table(document)
    if plot is not None:
        from skyway.plots.mission import plot_mission

        plot_mission(document, plot, title=file.name)
        typer.echo(f"wrote {plot}")


def _print_table(document: MissionDocument) -> None:
    from skyway.missions.items.altitude_frames import frame_name

    home = document.mission.home
    if home is not None:
        altitude = "unknown" if home.altitude_m is None else f"{home.altitude_m:g} m"
        typer.echo(f"home {home.point}, ground {altitude}")
    left = ("command", "frame")
    names = ("item", "command", "frame", "p1", "p2", "p3", "p4", "latitude", "longitude", "altitude")
    sheet = Sheet([Column(name, justify="left" if name in left else "right") for name in names], names=2)
    for number, item in enumerate(document.mission.items):
        numbers = ("" if math.isnan(value) else f"{value:g}" for value in item.params)
        point = item.point
        place = stored_degrees(point.lat, point.lon) if point else ("", "")
        height = f"{item.z:g}" if item.is_located and not math.isnan(item.z) else ""
        sheet.add(str(number), item.name, frame_name(item.frame), *numbers, *place, height)
    if document.mission.items:
        sheet.show()
    for number, area in enumerate(document.fence.areas):
        kind = "stay inside" if area.inclusion else "stay outside"
        what = f"{len(area.vertices)} vertices" if hasattr(area, "vertices") else f"circle of {area.radius_m:g} m"
        typer.echo(f"fence area {number}: {kind}, {what}")
    for number, rally in enumerate(document.rally.points):
        typer.echo(f"rally point {number}: {rally.point}, {rally.altitude_m:g} m above home")
