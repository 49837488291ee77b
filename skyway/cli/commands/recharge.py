"""Command ``recharge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skyway.cli import airspace_options, options
from skyway.cli.options import FamilyName
from skyway.models.base.json_text import json_text


def recharge(
    mission: Annotated[Path, typer.Argument(help="Mission file in any known format.")],
    pads: Annotated[Path, typer.Option(help="Stations with pads (CSV, GeoJSON), or a scenario folder.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write: one mission a battery.")],
    wind: Annotated[str | None, typer.Option(help="Steady wind at flying height, m/s@degrees FROM: 8@270.")] = None,
    depart: Annotated[
        str | None, typer.Option(help="First take-off, with UTC offset. With a scenario, its forecast is used.")
    ] = None,
    forecast: Annotated[
        list[Path] | None,
        typer.Option(help="Weather forecast, as for skyway plan; repeatable. Goes with a scenario and --depart."),
    ] = None,
    drone: Annotated[str | None, typer.Option(help="Drone id; m200-v2 is built in.")] = None,
    fleet: Annotated[Path | None, typer.Option(help="Fleet file (drones.toml) that the drone is of.")] = None,
    autopilot: Annotated[
        FamilyName | None, typer.Option(help="Autopilot. Without it: all that fly the mission.")
    ] = None,
    payload: Annotated[float, typer.Option(help="Mass of the package, kg.")] = 0.0,
    soc: Annotated[float, typer.Option(help="Charge at the first take-off, percent.")] = 100.0,
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0,
    epsilon: Annotated[float, typer.Option(help="Probability with which a landing may miss the reserve.")] = 0.001,
    transit_speed: Annotated[
        float | None, typer.Option(help="Ground speed of ways to pads, m/s. Without it: the greatest of the mission.")
    ] = None,
    transit_height: Annotated[
        float | None,
        typer.Option(help="Least height of ways to pads above home, m. Without it: the greatest of the mission."),
    ] = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    clearance: Annotated[
        float | None, typer.Option(help="Clearance over terrain and obstacles, m. Without it: the scenario's, or 30.")
    ] = None,
    level_ground: Annotated[
        bool, typer.Option("--level-ground", help="Pads whose ground height is unknown are as high as home.")
    ] = False,
    home: Annotated[str | None, typer.Option(help="Home of the mission where its file has none: lat,lon.")] = None,
    home_elevation: Annotated[float | None, typer.Option(help="Ground of home above the sea, m.")] = None,
    laps: Annotated[int, typer.Option(help="How often jumps that never end are followed.")] = 1,
    single: Annotated[
        bool,
        typer.Option("--single", help="Also one mission with disarmed stays, where the autopilot flies one (PX4)."),
    ] = False,
    seed: Annotated[int, typer.Option(help="Random seed of the rehearsal.", min=0, max=2**32 - 1)] = 0,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Cut a mission that is longer than a battery into one mission a battery, with charges on pads on the way.

    Each mission goes on exactly where the one before left the work, with every state restored. Where to leave it, which pad, and how
    long to charge are such that the whole ends first and every landing keeps the reserve.

    Examples
    --------
      skyway recharge survey.plan --pads pads.csv -o flights
      skyway recharge survey.plan --pads pads.csv --wind 6@250 --drone m200-v2 --autopilot px4 -o flights
      skyway recharge patrol.waypoints --pads newyork --depart 2013-07-10T14:00-04:00 --laps 5 -o flights
    """
    from skyway.cli.views.recharge import print_recharge
    from skyway.missions import family_named, read
    from skyway.missions.autopilots import NAMES
    from skyway.recharge.asking import Asked, options_of, pads_of, region_of, with_home
    from skyway.recharge.cutting import recharged
    from skyway.recharge.output import names_of, refuse_folder, write_folder
    from skyway.recharge.rehearsal import rehearsed
    from skyway.recharge.summary import summary_of

    refuse_folder(output, force=force)
    asked = Asked(
        pads=pads,
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
        single=single,
        seed=seed,
    )
    document = with_home(read(mission), asked)
    region = region_of(asked)
    airspace = airspace_options.zones_of(region, zones or (), authorized or ())
    families = [family_named(name) for name in ((autopilot,) if autopilot else NAMES)]
    found = recharged(
        document, pads_of(asked, region), families, options_of(asked, document, region, airspace)
    )  # fmt: skip
    summary = summary_of(found, rehearsed(found), mission.name, names_of(found))
    files = write_folder(found, summary, output, force=force)
    if as_json:
        typer.echo(json_text(summary, indent=1))
    else:
        print_recharge(summary)
    options.say_written(*files)
