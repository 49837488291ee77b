"""Commands ``check`` and ``recharge``: a mission against its battery, and cut if the battery does not last."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import airspace_options, options
from skyway.cli.option_groups import with_groups
from skyway.cli.options import FamilyName
from skyway.cli.recharge_options import CrewOptions
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text, duration, energy_text, modelled, percent
from skyway.models.base.json_text import json_text
from skyway.models.base.units import parse_instant
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.checks.report import CheckReport
    from skyway.models.scenario.scenario import Scenario
    from skyway.recharge.made_of import MadeOf
    from skyway.recharge.several import SharedWork


def check(
    file: Annotated[Path, typer.Argument(help="Mission file in any known format.")],
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario folder: its fleet, pads, no-fly zones, rules and wind are used.")
    ] = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    drone: Annotated[str | None, typer.Option(help="Drone id; m200-v2 is built in.")] = None,
    fleet: Annotated[Path | None, typer.Option(help="Fleet file (drones.toml) with the drone.")] = None,
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
        float | None, typer.Option(help="Clearance over terrain and obstacles, m. Default: the scenario's, or 30.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the heights over the terrain: FILE.png or FILE.svg.")] = None,
    fix: Annotated[
        Path | None,
        typer.Option(
            help="Write the mission with those findings corrected that have only one correction: .plan or .waypoints."
        ),
    ] = None,
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
    from skyway.checking import conditions_of, obstacle_notes, over_of, weather_of
    from skyway.missions import check as check_mission
    from skyway.missions import family_named, read

    options.check_picture(plot)
    options.refuse_overwriting(plot, fix, force=force)
    document = read(file)
    region = None if scenario is None else load_scenario(scenario)
    over = over_of(region, terrain, obstacles, clearance)
    for note in obstacle_notes(over, document.places):
        typer.echo(f"warning: {note}", err=True)
    if plot is not None and over is None:
        raise InputError("there are no heights to draw", field="--plot", remedy="give a terrain model with --terrain")
    airspace = airspace_options.zones_of(region, zones or (), authorized or (), document.places)
    weather = weather_of(region, wind, depart, forecast, zoned=bool(zones))
    conditions = conditions_of(region, drone, weather, payload, soc, reserve, fleet)
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
    if fix is not None:
        from skyway.missions import write
        from skyway.missions.checks.fixes import fixed

        mended, told = fixed(document, report.findings)
        if told:
            write(mended, fix, force=force)
        for line in told or (f"no finding has a certain correction: {fix} was not written",):
            typer.echo(line, err=True)
        options.say_written(fix if told else None)
    if as_json:
        typer.echo(json_text(report, indent=1))
    else:
        if document.mission.items:
            speed_unknown = document.mission.hover_speed_mps is None
            typer.echo(
                _circumstances(conditions, wind, None if region is None else depart, speed_unknown=speed_unknown)
            )
        _print_report(report)
    if not report.ok:
        raise typer.Exit(1)


def _circumstances(conditions: FlightConditions, wind: str | None, depart: str | None, *, speed_unknown: bool) -> str:
    """Say in one line what the battery was checked with."""
    from skyway.missions.checks.route import DEFAULT_SPEED_MPS

    air = f"wind {wind}" if wind else f"forecast for {depart}" if depart else "still air"
    assumed = " (assumed)" if conditions.drone_is_assumed else ""
    speed = f", {DEFAULT_SPEED_MPS:g} m/s until the mission sets a speed" if speed_unknown else ""
    return f"{conditions.drone.name}{assumed}, package {conditions.payload_kg:g} kg, {air}{speed}"


def _print_report(report: CheckReport) -> None:
    from skyway.models.composition.heights import least_words

    for finding in report.findings:
        typer.echo(str(finding))
    for number, leg in enumerate(report.legs, start=1):
        cells = [
            f"leg {number}: items {leg.item_from} to {leg.item_to}",
            distance_text(leg.distance_m),
        ]
        if leg.time_s is not None and leg.energy_j is not None:
            cells += [duration(leg.time_s), energy_text(leg.energy_j)]
            if leg.soc_end is None:
                cells.append("not judged: the flight before does not reach its landing")
            else:
                cells += [
                    f"ends at {percent(leg.soc_end)}" if leg.soc_end > 0 else "the battery does not last",
                    f"keeps the reserve with probability {modelled(leg.p_reserve)}",
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


@with_groups
def recharge(
    mission: Annotated[Path, typer.Argument(help="Mission file in any known format.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write: one mission a battery.")],
    crew: CrewOptions,
    pads: Annotated[Path | None, typer.Option(help="Stations with pads (CSV, GeoJSON), or a scenario folder.")] = None,
    wind: Annotated[str | None, typer.Option(help="Steady wind at flying height, m/s@degrees FROM: 8@270.")] = None,
    depart: Annotated[
        str | None, typer.Option(help="First take-off, with UTC offset. With a scenario, its forecast is used.")
    ] = None,
    forecast: Annotated[
        list[Path] | None,
        typer.Option(help="Weather forecast, as for skyway plan; repeatable. Goes with a scenario and --depart."),
    ] = None,
    drone: Annotated[str | None, typer.Option(help="Drone id; m200-v2 is built in.")] = None,
    fleet: Annotated[Path | None, typer.Option(help="Fleet file (drones.toml) with the drone.")] = None,
    autopilot: Annotated[
        FamilyName | None, typer.Option(help="Autopilot. Default: all that can fly the mission.")
    ] = None,
    payload: Annotated[float, typer.Option(help="Mass of the package, kg.")] = 0.0,
    soc: Annotated[float, typer.Option(help="Charge at the first take-off, percent.")] = 100.0,
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    epsilon: Annotated[float, typer.Option(help="Probability with which a landing may miss the reserve.")] = 0.001,
    transit_speed: Annotated[
        float | None, typer.Option(help="Ground speed of ways to pads, m/s. Default: the greatest of the mission.")
    ] = None,
    transit_height: Annotated[
        float | None,
        typer.Option(help="Least height of ways to pads above home, m. Default: the greatest of the mission."),
    ] = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    clearance: Annotated[
        float | None, typer.Option(help="Clearance over terrain and obstacles, m. Default: the scenario's, or 30.")
    ] = None,
    level_ground: Annotated[
        bool, typer.Option("--level-ground", help="Pads whose ground height is unknown are as high as home.")
    ] = False,
    home: Annotated[str | None, typer.Option(help="Home of the mission where its file has none: lat,lon.")] = None,
    home_elevation: Annotated[float | None, typer.Option(help="Ground of home above the sea, m.")] = None,
    laps: Annotated[int, typer.Option(help="Number of repetitions of endless jumps.")] = 1,
    swap: Annotated[
        float | None,
        typer.Option(help="Duration of a battery change, s. Default: it is charged on the pad."),
    ] = None,
    single: Annotated[
        bool,
        typer.Option("--single", help="Also one mission for all batteries, with disarmed stays on the pads."),
    ] = False,
    seed: Annotated[int, typer.Option(help="Random seed of the simulated flights.", min=0, max=2**32 - 1)] = 0,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Cut a mission that is longer than a battery into one mission for each battery, with charging on pads on the way.

    Each mission continues exactly where the previous one left the work, with every state restored. The places to leave it, the pads and
    the charges are chosen so that the work is finished earliest and every landing keeps the reserve.

    Examples
    --------
      skyway recharge survey.plan --pads pads.csv -o flights
      skyway recharge survey.plan --pads pads.csv --wind 6@250 --drone m200-v2 --autopilot px4 -o flights
      skyway recharge survey.plan --vans vans.csv -o flights
      skyway recharge survey.plan --pads pads.csv --reorder -o flights
      skyway recharge survey.plan --pads pads.csv --swap 90 --packs 3 --chargers 1 -o flights
      skyway recharge survey.plan --pads pads.csv --drones 3 --reorder -o flights
      skyway recharge patrol.waypoints --pads newyork --depart 2013-07-10T14:00-04:00 --laps 5 -o flights
    """
    from skyway.checking import obstacle_notes
    from skyway.cli.views.recharge import print_recharge
    from skyway.missions import family_named, read
    from skyway.missions.autopilots import NAMES
    from skyway.models.drones.time_belief import GROUND_S
    from skyway.recharge.asking import Asked, options_of, pads_of, region_of, stands_of, with_home
    from skyway.recharge.made_of import MadeOf, texts_of
    from skyway.recharge.output import names_of, refuse_folder, write_folder
    from skyway.recharge.pad_bookings import desk_of, with_windows
    from skyway.recharge.recharged import recharged
    from skyway.recharge.several import shared_among
    from skyway.recharge.simulated import simulated
    from skyway.recharge.summary import summary_of

    refuse_folder(output, force=force)
    asked = Asked(
        pads=pads,
        vans=crew.vans,
        drone=drone,
        fleet=fleet,
        wind=wind,
        depart=depart,
        forecast=forecast,
        payload_kg=payload,
        soc_percent=soc,
        reserve_percent=reserve,
        epsilon=epsilon,
        transit_speed_mps=transit_speed,
        transit_height_m=transit_height,
        terrain=terrain,
        obstacles=obstacles,
        clearance_m=clearance,
        level_ground=level_ground,
        home=home,
        home_elevation_m=home_elevation,
        laps=laps,
        swap_s=swap,
        packs=crew.packs,
        chargers=crew.chargers,
        single=single,
        seed=seed,
        reorder=crew.reorder,
        ground_s=GROUND_S if crew.ground_time is None else crew.ground_time,
        windows=None if crew.ledger is None else {},
    )
    document = with_home(read(mission), asked)
    region = region_of(asked)
    airspace = airspace_options.zones_of(region, zones or (), authorized or (), document.places)
    families = [family_named(name) for name in ((autopilot,) if autopilot else NAMES)]
    stands = stands_of(asked)
    chosen = options_of(asked, document, region, airspace, stands)
    for note in obstacle_notes(chosen.transit.over, document.places):
        typer.echo(f"warning: {note}", err=True)
    made_of = MadeOf(
        asked=asked, mission=mission, autopilot=autopilot, zones=tuple(zones or ()), authorized=tuple(authorized or ())
    )
    all_pads = pads_of(asked, region, stands)
    with ExitStack() as open_until_written:
        desk = None
        if crew.ledger is not None:
            desk = open_until_written.enter_context(desk_of(crew.ledger, output, asked.depart))
            chosen = replace(chosen, held=desk.held(all_pads))
        if crew.drones > 1:
            work = shared_among(document, all_pads, families, chosen, crew.drones)
            if desk is not None:
                work = open_until_written.enter_context(desk.cut_for_several(work))
            _write_shared(work, mission.name, made_of, region, output, force=force, as_json=as_json)
            return
        if desk is None:
            found = recharged(document, all_pads, families, chosen)
        else:
            found = open_until_written.enter_context(desk.cut_for_one(document, all_pads, families, chosen))
            made_of = replace(made_of, asked=with_windows(asked, found))
        summary = summary_of(found, simulated(found), mission.name, names_of(found))
        files = write_folder(
            found, summary, output, force=force, beside=lambda texts: texts_of(made_of, region, texts)
        )  # fmt: skip
    if as_json:
        typer.echo(json_text(summary, indent=1))
    else:
        print_recharge(summary)
    options.say_written(*files)


def _write_shared(
    work: SharedWork,
    mission: str,
    made_of: MadeOf,
    region: Scenario | None,
    output: Path,
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Write and tell a mission that several drones share."""
    from skyway.cli.views.recharge_drones import print_drones
    from skyway.recharge.shared_summary import drones_summary_of, write_shared

    told = drones_summary_of(work, mission)
    files = write_shared(work, told, made_of, region, output, force=force)
    if as_json:
        typer.echo(json_text(told, indent=1))
    else:
        print_drones(told)
    options.say_written(*files)
