"""Commands ``mission``, ``convert`` and ``show``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import airspace_options, options
from skyway.cli.options import FamilyName
from skyway.cli.views.sheet import Column, Sheet
from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import stored_degrees
from skyway.models.base.views import counted
from skyway.models.composition.release import Release
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.builder.from_composition import Export
    from skyway.missions.items.document import MissionDocument
    from skyway.models.composition.composition import Composition


def mission(
    plan: Annotated[Path, typer.Argument(help="Plan, as written by skyway plan -o.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write: .plan or .waypoints.")],
    whole: Annotated[bool, typer.Option("--whole", help="All legs in one mission (the default).")] = False,
    leg: Annotated[int | None, typer.Option(help="One leg only, numbered from 1.")] = None,
    autopilot: Annotated[FamilyName, typer.Option(help="Autopilot of the vehicle.")] = NAMES[0],
    firmware: Annotated[
        str,
        typer.Option(
            help="Firmware version, such as 4.6, 1.16 or main; parameter names depend on it. Default: the newest release."
        ),
    ] = "",
    armed_hold: Annotated[
        bool, typer.Option("--armed-hold", help="Stay armed on the pads and take off by the clock. Dangerous.")
    ] = False,
    width: Annotated[float, typer.Option(help="Width of the fenced corridor, m; 0 writes no fence.")] = 400.0,
    release: Annotated[
        Release | None,
        typer.Option(help="How the package is released. Default: as planned; in the air only where planned so."),
    ] = None,
    undelivered: Annotated[
        bool,
        typer.Option(
            "--undelivered", help="Write the flights with the package still on board, for a plan with --if-undelivered."
        ),
    ] = False,
    cruise_height: Annotated[
        float | None, typer.Option(help="Cruise height above ground, m. Default: the plan's.")
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
        Path | None, typer.Option(help="Scenario folder: its zones must permit every leg at its time.")
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
    from skyway.flying import heights, release_of, terrain_of, zone_files
    from skyway.missions import family_named
    from skyway.missions.builder.from_composition import armed_mission, leg_mission, whole_mission
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.models.composition.file import load

    if leg is not None and (whole or armed_hold):
        other = "--whole" if whole else "--armed-hold"
        raise InputError("one leg and all legs exclude each other", field=f"--leg, {other}")
    composition, flown_by = load(plan), family_named(autopilot)
    if undelivered:
        composition, release = _with_the_package(composition), "hand"
    how = MissionOptions(
        cruise_height, climb, descent, max_speed, width or None, release_of(composition, release), elevation_m=heights(None, elevation),
        over=terrain_of(composition, terrain, obstacles),
    )  # fmt: skip
    files = zone_files(composition, zones or ())
    if files or scenario is not None:
        region = None if scenario is None else load_scenario(scenario)
        planned_in = composition.scenario_sha256
        if region is not None and None not in (region.sha256, planned_in) and region.sha256 != planned_in:
            typer.echo(
                f"warning: {region.path} differs from the scenario of the plan; only its zones are used", err=True
            )
        places = [(one.lat, one.lon) for one in composition.stations.values()]
        closed = airspace_options.zones_of(region, files, composition.authorized, places)
        airspace_options.refuse_closed(composition, flown_by, how, closed)
    if leg is not None:
        export = leg_mission(composition, _leg_index(leg, len(composition.there_and_back.services)), flown_by, how)
    elif armed_hold:
        export = armed_mission(composition, flown_by, how)
    else:
        export = whole_mission(composition, flown_by, how)
    settings = flown_by.parameter_file(export.parameters, firmware or flown_by.released)
    _write_export(export, settings, output, force=force)


def _with_the_package(composition: Composition) -> Composition:
    """Return the way on of a package that could not be delivered."""
    kept = None if composition.way_back is None else composition.way_back.undelivered
    if kept is None:
        remedy = "plan with --if-undelivered back"
        raise InputError("the plan has no flights for a package that cannot be handed over", remedy=remedy)
    return kept


def _leg_index(number: int, legs: int) -> int:
    """Index of a leg that a person has typed: they count from 1."""
    if not 1 <= number <= legs:
        known = "the plan has one leg: 1" if legs == 1 else f"legs are numbered from 1: the plan has legs 1 to {legs}"
        raise InputError("no such leg", field="--leg", value=number, remedy=known)
    return number - 1


def _write_export(export: Export, parameters: str, output: Path, *, force: bool) -> None:
    """Write every mission of an export and its parameters, or nothing."""
    from skyway.missions.builder.export_files import planned_files, targets_of, write_export

    options.refuse_overwriting(*planned_files(export, output), force=force)
    for warning in export.warnings:
        typer.echo(f"warning: {warning}", err=True)
    written = write_export(export, parameters, output, force=force)
    for document, target in zip(export.documents, targets_of(export, output), strict=True):
        files = [file for file in written if file.name.startswith(f"{target.stem}.") and file.suffix == target.suffix]
        _echo_written(document, files)
    typer.echo(f"wrote {written[-1]} (parameters that the vehicle needs)")
    for note in export.notes:
        typer.echo(note)


def _echo_written(document: MissionDocument, files: Sequence[Path]) -> None:
    """Return what went into each file."""
    items = counted(len(document.mission.items), "item")
    fence, rally = counted(len(document.fence.areas), "fence area"), counted(len(document.rally.points), "rally point")
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

    A .waypoints file contains only the mission; fence and rally points go to separate files. The command reports what
    the new format cannot hold.

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
