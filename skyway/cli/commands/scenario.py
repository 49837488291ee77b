"""Commands ``network``, ``airspace``, ``wind``, ``scenario init`` and ``scenario check``."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.option_groups import with_groups
from skyway.cli.request_options import ConditionOptions
from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import distance_text, duration, kilometres, place_text
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from skyway.models.airspace.reading import AirspaceFile
    from skyway.models.airspace.zone import Zone
    from skyway.models.scenario.scenario import Scenario

AIRSPACE_SCHEMA = "skyway.airspace/1"


def network(
    scenario: options.ScenarioArgument = None,
    plot: options.Plot = None,
    geojson: Annotated[Path | None, typer.Option(help="Write stations and segments: FILE.geojson.")] = None,
    graphml: Annotated[
        Path | None, typer.Option(help="Write stations and segments for Gephi, yEd, igraph, networkx.")
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            help="Write stations.csv and segments.csv into this folder, to edit and to build a scenario from."
        ),
    ] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Show the stations and segments that were read.

    Examples
    --------
      skyway network
      skyway network my-scenario --plot network.svg --geojson network.geojson
    """
    from skyway.models.network.files import (
        to_geojson,
        write_geojson,
        write_graphml,
        write_segments_csv,
        write_stations_csv,
    )

    stations, segments = (None, None) if csv is None else (csv / "stations.csv", csv / "segments.csv")
    options.refuse_overwriting(plot, geojson, graphml, stations, segments, force=force)
    options.check_picture(plot)
    world = load_scenario(scenario)
    options.hint_at_warnings(world, scenario)
    if geojson is not None:
        write_geojson(world.network, geojson, force=force)
    if graphml is not None:
        write_graphml(world.network, graphml, force=force)
    if stations is not None and segments is not None:
        write_stations_csv(world.network, stations, force=force)
        write_segments_csv(world.network, segments, force=force)
    if plot is not None:
        from skyway.plots.map import plot_network

        plot_network(world, plot)
    options.say_written(geojson, graphml, stations, segments, plot)
    if as_json:
        typer.echo(json_text(to_geojson(world.network), indent=1))
        return
    _print_network(world)


def _print_network(world: Scenario) -> None:
    import numpy as np

    net = world.network
    left = ("id", "name", "nearest")
    names = ("id", "name", "lat", "lon", "ground m", "pads", "spots", "segments", "nearest")
    sheet = Sheet([Column(name, justify="left" if name in left else "right") for name in names], names=2)
    for number, s in enumerate(net.stations):
        if s.flyover:
            continue
        segments = slice(int(net.first[number]), int(net.first[number + 1]))
        nearest = "none"
        if segments.stop > segments.start:
            best = segments.start + int(np.argmin(net.distance_m[segments]))
            nearest = f"{net.stations[int(net.head[best])].id} {distance_text(net.distance_m[best])}"
        height = "unknown" if s.elevation_m is None else f"{s.elevation_m:.0f}"
        sheet.add(
            s.id,
            s.name,
            *place_text(s.lat, s.lon).split(","),
            height,
            str(s.pads),
            str(s.holding_spots),
            str(segments.stop - segments.start),
            nearest,
        )
    sheet.show()
    say("")
    zones = len(net.zones.names) if net.zones is not None else 0
    count = sum(not station.flyover for station in net.stations)
    both = len({tuple(sorted(pair)) for pair in zip(net.tail.tolist(), net.head.tolist(), strict=True)})
    parts = len(net.parts())
    joined = "all joined" if parts == 1 else f"in {parts} parts"
    if len(net.distance_m):
        lengths = f"{kilometres(net.distance_m.min())} to {kilometres(net.distance_m.max())} km"
        bends = f", {counted(len(net) - count, 'bend')} around them" if len(net) > count else ""
        say(
            f"{counted(count, 'station')}, {counted(both, 'segment')} ({lengths}), {joined}, {counted(zones, 'no-fly zone')}{bends}"
        )
    else:
        say(f"{counted(count, 'station')}, no segments, {counted(zones, 'no-fly zone')}")
    if find_spec("networkx") and (alone := net.articulation_stations()):
        say(f"stations whose closure would part the network: {', '.join(alone)}")
    for drone in world.drones:
        say(
            f"{drone.id}: {drone.name} of {drone.provider}, lifts {drone.max_payload_kg:g} kg, "
            f"still-air range {distance_text(drone.flight_range_m)} fully loaded, wind up to {drone.wind_limit_mps:g} m/s, "
            f"recharge {duration(drone.recharge_full_s)}",
        )


def airspace(
    files: Annotated[list[Path], typer.Argument(help="Airspace files: ED-269, ED-318, GeoJSON, OpenAir, KML, KMZ.")],
    depart: Annotated[
        str | None, typer.Option(help="Only zones that are active then: a time with UTC offset, or now.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Show the contents of airspace files, and what was not understood.

    Exit code 0: every zone has a position; 1: some have none, and the file is not used; 2: it is not an airspace file.

    Examples
    --------
      skyway airspace zones.json
      skyway airspace national.json airspace.txt --depart 2026-08-05T14:00+02:00 --json
    """
    from skyway.models.airspace.reading import inspect_airspace

    at_s = None if depart is None else _instant_s(depart)
    found: list[AirspaceFile] = []
    errors: list[Fault] = []
    for file in files:
        try:
            found.append(inspect_airspace(file))
        except InputError as error:
            errors += error.faults
    if errors:
        raise InputError(errors)
    if as_json:
        typer.echo(json_text({"schema": AIRSPACE_SCHEMA, "files": [_file_json(one, at_s) for one in found]}, indent=1))
    else:
        for one in found:
            _show_airspace(one, at_s)
    if any(one.faults for one in found):
        raise typer.Exit(1)


def _instant_s(text: str) -> float:
    from skyway.models.base.units import parse_instant

    return parse_instant(text, field="--depart").timestamp()


def _chosen(file: AirspaceFile, at_s: float | None) -> list[Zone]:
    return [zone for zone in file.zones if at_s is None or zone.activation.spans(at_s, at_s)]


def _show_airspace(file: AirspaceFile, at_s: float | None) -> None:
    from skyway.models.airspace.notes import CLOSES_NOTHING

    zones = _chosen(file, at_s)
    say(f"{file.path}: {file.form}, {_counts(zones)}" + ("" if at_s is None else f", of {len(file.zones)} in all"))
    left = ("id", "name", "kind", "floor to ceiling", "active")
    sheet = Sheet([Column(name, justify="left") for name in left], names=2)
    for zone in zones:
        heights = "; ".join(dict.fromkeys(str(volume) for volume in zone.volumes))
        sheet.add(zone.id, zone.name, zone.kind, heights, str(zone.activation))
    if zones:
        sheet.show()
    open_ = [fault for fault in file.notes if (fault.remedy or "").startswith(CLOSES_NOTHING)]
    closed = [fault for fault in file.notes if fault not in open_]
    for head, faults in (
        ("not understood, counted as closed", closed), ("closes nothing", open_), ("cannot be placed", file.faults)
    ):  # fmt: skip
        if faults:
            say(f"{head}: {len(faults)}")
            for fault in faults:
                say(f"  {fault}")
    say("")


def _counts(zones: list[Zone]) -> str:
    kinds = Counter(zone.kind for zone in zones)
    volumes = sum(len(zone.volumes) for zone in zones)
    said = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    return f"{counted(len(zones), 'zone')} with {counted(volumes, 'volume')}" + (f" ({said})" if said else "")


def _file_json(file: AirspaceFile, at_s: float | None) -> dict[str, Any]:
    import shapely

    return {
        "file": file.path,
        "form": file.form,
        "zones": [
            {
                "id": zone.id,
                "name": zone.name,
                "kind": zone.kind,
                "active": str(zone.activation),
                "message": zone.message,
                "authority": zone.authority,
                "volumes": [
                    {
                        "floor": str(volume.floor),
                        "ceiling": str(volume.ceiling),
                        "area": shapely.geometry.mapping(volume.area),
                    }
                    for volume in zone.volumes
                ],
            }
            for zone in _chosen(file, at_s)
        ],
        "not_understood": [str(fault) for fault in file.notes],
        "faults": [str(fault) for fault in file.faults],
    }


@with_groups
def wind(
    conditions: ConditionOptions,
    hours: Annotated[int, typer.Option(help="Hours ahead.", min=1, max=48)] = 12,
    plot: options.Plot = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Show the wind forecast for a departure: speed and direction by hour.

    Examples
    --------
      skyway wind --depart 2013-07-10T14:00-04:00
      skyway wind --depart 2013-07-10T14:00-04:00 --observed EWR=8@270 --observed JFK=6@230
      skyway wind my-scenario --depart 2026-07-10T14:00-04:00 --plot wind.svg
    """
    options.refuse_overwriting(plot, force=force)
    options.check_picture(plot)
    world = conditions.loaded()
    with typed_values.as_typed():
        known, true = conditions.winds(world, conditions.instant, conditions.truth)
        ensemble = known.forecast
    options.hint_at_warnings(world, conditions.scenario)
    from zoneinfo import ZoneInfo

    from skyway.cli.views.wind import print_wind
    from skyway.models.flight.weather_closures import closures_told
    from skyway.now import told_conditions
    from skyway.plots.wind_summary import wind_report

    report = wind_report(ensemble, world, hours, true)
    if plot is not None:
        from skyway.plots.wind import plot_wind

        plot_wind(ensemble, world, hours, plot, true)
        options.say_written(plot)
    if as_json:
        typer.echo(json_text(report, indent=1))
        return
    print_wind(report, world)
    zone, begin_s = ZoneInfo(world.timezone), conditions.instant.timestamp()
    for drone in world.drones:
        for closed in closures_told(ensemble, drone, world.rules, zone, begin_s, begin_s + hours * 3600.0):
            say(f"{drone.id}: {closed}")
    for note in (*told_conditions(known.conditions), *known.notes, *ensemble.notes):
        say(f"Note: {note}")


scenario = typer.Typer(help="Create and check scenarios.", no_args_is_help=True, rich_markup_mode=None)


@scenario.command("init")
def init(
    folder: Annotated[Path, typer.Argument(help="Folder to write; it must not exist or be empty.")],
    example: Annotated[
        Literal["template", "hills"],
        typer.Option(help="template: every part of a scenario; hills: terrain model and obstacles."),
    ] = "template",
) -> None:
    """Write a commented example scenario.

    Examples
    --------
      skyway scenario init my-scenario
      skyway scenario init hills --example hills
    """
    from skyway.scenario_template import write_template

    for path in write_template(folder, example):
        typer.echo(f"wrote {path}")
    typer.echo(f"next: edit {folder / 'scenario.toml'}, then: skyway scenario check {folder}")


@scenario.command("check")
def check(
    folder: options.ScenarioArgument = None,
    as_json: options.AsJson = False,
) -> None:
    """Check a scenario and report all its faults at once.

    Exit code 2: it has faults, or no request can be planned in it.

    Examples
    --------
      skyway scenario check my-scenario
    """
    from skyway.models.scenario.checks import NO_SEGMENTS, planning_faults
    from skyway.planner.problem.problem import HORIZON_H

    if as_json:
        _check_json(folder)
        return
    world = load_scenario(folder)
    faults = planning_faults(world, HORIZON_H)
    for warning in world.warnings:
        if not faults or warning != NO_SEGMENTS:
            typer.echo(f"warning: {warning}", err=True)
    if faults:
        raise InputError(faults)
    record = "no wind record" if world.history is None else f"wind of {world.history.covers}"
    say(
        f"{world.path}: {world.name}: {counted(len(world.network), 'station')}, {counted(len(world.drones), 'drone')}, {record}: ready to plan"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioCheck:
    """Result of a scenario check."""

    schema: str = "skyway.scenario-check/1"
    ok: bool
    faults: tuple[Fault, ...]
    warnings: tuple[str, ...]


def _check_json(folder: Path | None) -> None:
    from skyway.models.scenario.checks import planning_faults
    from skyway.planner.problem.problem import HORIZON_H

    faults: tuple[Fault, ...] = ()
    warnings: tuple[str, ...] = ()
    try:
        world = load_scenario(folder)
        warnings, faults = world.warnings, tuple(planning_faults(world, HORIZON_H))
    except InputError as error:
        faults = tuple(replace(one, value=None if one.value is None else str(one.value)) for one in error.faults)
    typer.echo(json_text(ScenarioCheck(ok=not faults, faults=faults, warnings=warnings), indent=1))
    if faults:
        raise typer.Exit(2)
