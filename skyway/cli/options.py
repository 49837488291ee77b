"""Parsing of command-line values, shared by all commands."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import Fault, refuse

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario

if TYPE_CHECKING:
    FamilyName = str
    FamilyNameOrAuto = str
else:  # choices for typer
    FamilyName = Literal[NAMES]
    FamilyNameOrAuto = Literal[("auto", *NAMES)]
"""Name of an autopilot family; ``auto`` asks the vehicle."""

ScenarioArgument = Annotated[Path | None, typer.Argument(help="Scenario folder. Default: New York, built in.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files.")]
Plot = Annotated[Path | None, typer.Option("--plot", help="Draw a picture: FILE.png or FILE.svg.")]
Zones = Annotated[
    list[Path] | None,
    typer.Option(
        help="Airspace in addition to that of the scenario: ED-269, ED-318, GeoJSON, OpenAir, KML; repeatable. The pressure can be appended: FILE@Q1013, FILE@Q1013,15C, FILE@metar=METARS."
    ),
]
Authorized = Annotated[
    list[str] | None, typer.Option(help="Id of a zone for which an authorization was given; repeatable.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="A tuned parameter: planner.robust.members=50; repeatable. `skyway settings` lists them."
    )
]  # fmt: skip

TERRAIN_HELP = (
    "Terrain model: GeoTIFF, COG, SRTM .hgt (.zip, .gz); repeatable. Append what a file does not state: FILE@ellipsoid, FILE@msl, "
    "FILE@ft."
)
OBSTACLES_HELP = "Obstacles: CSV or GeoJSON; repeatable."
TerrainFiles = Annotated[list[str] | None, typer.Option("--terrain", help=TERRAIN_HELP)]
ObstacleFiles = Annotated[list[str] | None, typer.Option("--obstacles", help=OBSTACLES_HELP)]


def hint_at_warnings(scenario: Scenario, path: Path | None) -> None:
    """Print on stderr that the input has warnings, and which command shows them.

    Those of the built-in scenario are nothing that a person could mend.
    """
    count = len(scenario.warnings)
    if count and path is not None:
        what = "1 warning" if count == 1 else f"{count} warnings"
        typer.echo(f"skyway: {what} about the input, see: skyway scenario check {path}", err=True)


def refuse_overwriting(*paths: Path | None, force: bool) -> None:
    """Refuse at the beginning what could not be written at the end."""
    given = [path for path in paths if path is not None]
    faults = []
    for number, path in enumerate(given):
        folder = path.parent
        if str(path) == "-":
            faults.append(
                Fault("is not a file, and standard output is not written to", "-", remedy="name a file, or use --json")
            )
        elif path in given[:number]:
            faults.append(Fault("is named for two outputs", str(path), remedy="give each output its own name"))
        elif path.is_dir():
            faults.append(Fault("is a folder", str(path), remedy="name a file"))
        elif path.exists() and not force:
            faults.append(Fault("exists already", str(path), remedy="give another name, or --force to overwrite it"))
        elif not folder.is_dir():
            faults.append(Fault("no such folder", str(folder), remedy="create it first"))
        elif not os.access(folder, os.W_OK):
            faults.append(Fault("cannot be written to", str(folder), remedy="choose another folder"))
    refuse(faults)


def say_written(*paths: Path | None) -> None:
    """Print on standard error which files were written."""
    for path in paths:
        if path is not None:
            typer.echo(f"wrote {path}", err=True)


def check_picture(path: Path | None) -> None:
    """Refuse pictures of a format that is not drawn."""
    from skyway.plots.pictures import check_format

    if path is not None:
        check_format(path, "--plot")
