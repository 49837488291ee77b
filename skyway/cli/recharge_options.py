"""Options of missions that are cut at pads, besides those of checks: vans, batteries, drones, order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer


@dataclass(frozen=True, slots=True, kw_only=True)
class CrewOptions:
    """Options of the crew in the field."""

    vans: Annotated[
        Path | None,
        typer.Option(help="Vans with pads: places and times of each (CSV, GeoJSON)."),
    ] = None
    reorder: Annotated[
        bool,
        typer.Option(
            "--reorder",
            help="Fly independent parts (survey lines, inspected places) in the order that finishes earliest, and show a lower bound.",
        ),
    ] = False
    packs: Annotated[
        int | None,
        typer.Option(help="Number of batteries, including the one in the drone. Default: as many as necessary."),
    ] = None
    chargers: Annotated[
        int | None, typer.Option(help="Number of batteries of --packs charged at a time. Default: 1.")
    ] = None
    ledger: Annotated[
        str | None,
        typer.Option(
            help="Ledger of pads (file, postgresql://…): pads booked by others are not used, and the stays are booked. Goes with --depart."
        ),
    ] = None
    ground_time: Annotated[
        float | None,
        typer.Option(
            help="Seconds on the ground at each stop besides waiting, charging and changing: upload, list, arming. Default: 20."
        ),
    ] = None
    drones: Annotated[
        int,
        typer.Option(help="Number of drones that share the mission and its pads.", min=1, max=20),
    ] = 1
