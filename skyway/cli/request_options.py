"""Options of a delivery to plan: package, places, time and wind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from skyway.cli import completion, options
from skyway.models.composition.release import Release
from skyway.planning import Conditions, Delivery, Pads

Depart = Annotated[str | None, typer.Option(help="Departure with UTC offset, 2013-07-10T14:00-04:00. Default: now.")]
OBSERVED_HELP = (
    "Wind observed before the departure: SITE=SPEED@FROM[@TIME] (m/s@degrees FROM, at the site's anemometer), or a file: METARs, a table, "
    "a journal of fly; repeatable."
)
FORECAST_HELP = "Weather forecast, in any format that skyway weather reads (GRIB, NetCDF, Open-Meteo, TAF, CSV), or a folder of them; repeatable."
ERROR_HELP = "Error of such forecasts by lead time, from skyway weather verify -o. Default: published figures."
_PLACE = "station id, part of its name, or lat,lon."


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestOptions(Delivery):
    """Options of the package, its places, and its drone."""

    start: Annotated[str, typer.Option("--from", help=f"Start: {_PLACE}", autocompletion=completion.stations)]
    to: Annotated[str, typer.Option(help=f"Destination: {_PLACE}", autocompletion=completion.stations)]
    payload: Annotated[float, typer.Option(help="Mass of the package, kg.")]
    drone: Annotated[
        str | None, typer.Option(help="Drone id. Without it the planner chooses.", autocompletion=completion.drones)
    ] = None
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0
    soc: Annotated[float, typer.Option(help="Charge at the start, percent.")] = 100.0
    airspeed: Annotated[float | None, typer.Option(help="Planned airspeed, m/s. Default: the drone's.")] = None
    recharge: Annotated[
        str, typer.Option(help="At each stop charge to 100 % (full) or to what the next flight needs (enough).")
    ] = "enough"
    seed: Annotated[int, typer.Option(help="Random seed of all sampling.", min=0, max=2**32 - 1)] = 0
    not_before: Annotated[
        str | None,
        typer.Option(
            help="Earliest arrival of the package, with UTC offset: the drone waits on the ground (planners with a forecast)."
        ),
    ] = None
    stop_at: Annotated[
        list[str] | None,
        typer.Option(
            help="Station to stop at on the way, in the order given; repeatable (planner robust).",
            autocompletion=completion.stations,
        ),
    ] = None
    return_to: Annotated[
        str,
        typer.Option(
            "--return",
            help="Destination of the drone after the delivery: home, nearest-pad (where the target has pads: it stays), a station, none.",
            autocompletion=completion.stations,
        ),
    ] = "nearest-pad"
    dwell: Annotated[
        str | None, typer.Option(help="Time at the target before the drone leaves it (loading, a signature): 5min.")
    ] = None
    if_undelivered: Annotated[
        str | None,
        typer.Option(
            help="Destination of a package that cannot be handed over: back, or a station; the charge for that flight is reserved.",
            autocompletion=completion.stations,
        ),
    ] = None
    release: Annotated[
        Release,
        typer.Option(
            help="How the package is released: after a landing, by the gripper or by hand; or without a landing, lowered by a winch, or placed on "
            "the ground (ArduPilot)."
        ),
    ] = "gripper"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionOptions(Conditions):
    """Where and when it is flown, and in which wind."""

    scenario: options.ScenarioArgument = None
    depart: Depart = None
    wind: Annotated[str | None, typer.Option(help="One constant wind at cruise height, m/s@degrees FROM: 8@270.")] = (
        None
    )
    forecast: Annotated[list[Path] | None, typer.Option(help=FORECAST_HELP)] = None
    forecast_error: Annotated[Path | None, typer.Option(help=ERROR_HELP)] = None
    truth: Annotated[
        str | None,
        typer.Option(
            "--actual-wind",
            help="True wind, for planners with perfect information: a day of the record (2013-07-10) or a forecast file with one member.",
        ),
    ] = None

    observed: Annotated[
        list[str] | None,
        typer.Option(help=OBSERVED_HELP),
    ] = None

    terrain: options.TerrainFiles = None
    obstacles: options.ObstacleFiles = None
    zones: options.Zones = None
    authorized: options.Authorized = None
    avoid: Annotated[
        list[str] | None,
        typer.Option(
            help="Station not to land at, or segment FROM:TO not to fly in either direction; repeatable.",
            autocompletion=completion.stations,
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOptions(Pads):
    """Which pads are busy."""

    pads: Annotated[
        str | None,
        typer.Option(
            help="Present state of the pads: a pad service tcp:HOST:PORT, read once, or a file of its answers."
        ),
    ] = None
