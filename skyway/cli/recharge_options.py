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
        typer.Option(help="Vans with pads: where each stands from when until when (CSV, GeoJSON)."),
    ] = None
    reorder: Annotated[
        bool,
        typer.Option(
            "--reorder",
            help="Fly independent parts (survey lines, inspected places) in the order that ends first, and show a bound.",
        ),
    ] = False
    packs: Annotated[
        int | None,
        typer.Option(help="Number of batteries, including the one in the drone. Default: as many as necessary."),
    ] = None
    chargers: Annotated[
        int | None, typer.Option(help="How many of the batteries of --packs are charged at a time. Default: 1.")
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
            help="Seconds on the ground at each stop beside waiting, charging and changing: upload, list, arming. Default: 20."
        ),
    ] = None
    drones: Annotated[
        int,
        typer.Option(help="How many drones share the mission and its pads, at once.", min=1, max=20),
    ] = 1
