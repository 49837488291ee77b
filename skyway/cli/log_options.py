"""Options shared by the commands that read logs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from zoneinfo import ZoneInfo

import typer

from skyway import typed_values
from skyway.link.logs.reader import FORMATS, titles
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import distance_text, percent
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.logs.common.log import Log
    from skyway.models.drones.airspeed import AirspeedModel
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.filter import WindFilterSettings
    from skyway.models.wind.estimation.live import Forecast

LogFile = Annotated[Path, typer.Argument(help=f"Flight log: {titles()}.")]
Columns = Annotated[Path | None, typer.Option("--columns", help="For a CSV log: TOML file that maps its columns.")]
System = Annotated[int | None, typer.Option("--system", help="MAVLink system id. Default: the first.")]
VehicleKind = Annotated[
    str | None,
    typer.Option("--vehicle", help="Kind of vehicle, if the log does not state it: multirotor, 'fixed wing', VTOL, …."),
]

DAMAGED = 0.05
"""Share of a log that cannot be read, from which on it is reported; real logs of good flights have up to 1 %."""

ScenarioName = Annotated[
    str | None,
    typer.Option("--scenario", help="Scenario folder (newyork: built in) whose wind record gives the forecast."),
]
Drag = Annotated[Path | None, typer.Option("--drag", help="Drag of the drone, from skyway calibrate wind.")]
FAR_M, ELSEWHERE_M = 300_000.0, 2_000_000.0
"""A forecast for sites further away than the first says little about a flight, than the second nothing."""


def air_of(path: Path | None) -> tuple[DragModel | None, AirspeedModel | None]:
    """Return drag and airspeed of a file of ``calibrate wind``; None where none is given."""
    from skyway.models.drones.drag_file import read_air

    if path is None:
        return None, None
    found = read_air(path)
    return found.drag, found.airspeed


def drone_of(named: Path, scenario: str | None = None) -> Drone:
    """Read the one drone of a fleet file, or return a drone by its id: of the fleet of a scenario, as plans name it, or a built-in one."""
    from skyway.models.drones.drone import BUILT_IN
    from skyway.models.drones.fleet import read_fleet

    if str(named) in BUILT_IN:
        return BUILT_IN[str(named)]
    if named.suffix != ".toml" and not named.exists():
        region = load_named(scenario)
        if any(drone.id == str(named) for drone in region.drones):
            return region.drone(str(named))
        fleet = ", ".join(drone.id for drone in region.drones)
        remedy = f"a fleet file, or a drone of the scenario {region.name} ({fleet}), or a built-in one ({', '.join(BUILT_IN)})"
        raise InputError("no such drone", field="--drone", value=str(named), remedy=remedy)
    drones = read_fleet(named)
    if len(drones) > 1:
        names = ", ".join(drone.id for drone in drones)
        raise InputError("holds several drones", str(named), field="--drone", value=names, remedy="keep one")
    return drones[0]


def load_named(name: str | None) -> Scenario:
    """Read the scenario named; ``newyork``, or none, is the built-in one."""
    return load_scenario(None if name is None else Path(str(name)))


def log_forecast(
    log: Log, path: Path, wind: str | None, file: Sequence[Path] | None, scenario: str | None
) -> tuple[Forecast | None, WindFilterSettings | None]:
    """Forecast for a log, and the wind's deviation from it; None without a forecast, or where that is unknown."""
    if wind is not None:
        if file or scenario is not None:
            raise InputError("--wind excludes --forecast and --scenario", remedy="give one of them")
        north, east = towards(wind)
        return (lambda *_: (north, east)), None
    if not file and scenario is None:
        return None, None
    from skyway.models.base.units import from_posix
    from skyway.models.wind.estimation.live import forecast_of, settings_for

    world = load_named(scenario)
    start = from_posix(dated(log, path))
    ensemble = typed_values.wind_forecast(
        world, start, None, file, None, start.astimezone(ZoneInfo(world.timezone)).date()
    )
    warn_if_far(log, ensemble, path)
    rules = world.rules
    aloft = ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    return forecast_of(ensemble, rules.wind_profile_exponent), settings_for(aloft)


def dated(log: Log, path: Path, remedy: str = "give the wind with --wind") -> float:
    """Start of a log in POSIX seconds; an `InputError` with a remedy where it does not know the date."""
    summary = log.summary
    if not summary.time_base.absolute or not math.isfinite(summary.start_s):
        raise InputError("has no date, so no forecast can be found for it", str(path), remedy=remedy)
    return summary.start_s


def warn_if_far(log: Log, ensemble: WindEnsemble, path: Path) -> None:
    """Warn on stderr that the flight was far from every site of a forecast; one of another part of the world is refused."""
    import numpy as np

    from skyway.models.base import geodesy

    for track in log.tracks():
        placed = np.flatnonzero(np.isfinite(track["lat_deg"]) & np.isfinite(track["lon_deg"]))
        if len(placed):
            here = float(track["lat_deg"][placed[0]]), float(track["lon_deg"][placed[0]])
            distance, _ = geodesy.inverse(*here, ensemble.site_lat, ensemble.site_lon)
            if float(distance.min()) > FAR_M:
                away = f"{distance_text(float(distance.min()))} from the nearest site of the forecast"
                if float(distance.min()) > ELSEWHERE_M:
                    remedy = "give the scenario, or a forecast, of where it was flown"
                    raise InputError(f"the flight was {away}", str(path), remedy=remedy)
                typer.echo(f"skyway: the flight was {away}", err=True)
            return


def open_any(path: Path, columns: Path | None) -> Log:
    """Open a log of any format; warns on stderr if its suffix is another, or if much of it is damaged."""
    from skyway.link.logs.csv_log import read_columns
    from skyway.link.logs.reader import open_log

    opened = open_log(path, None if columns is None else read_columns(columns))
    if not opened.summary.messages:
        raise InputError("holds no valid message", str(path), remedy=titles())
    usual = FORMATS[opened.summary.format].suffix
    names = [part.lower().lstrip(".") for part in path.suffixes]
    if usual not in names:
        typer.echo(f"skyway: {path} has another suffix, but is a .{usual} log", err=True)
    lost = opened.summary.skipped_bytes / path.stat().st_size
    if lost > DAMAGED and "gz" not in names:
        what = "it is in rows without a time" if usual == "csv" else "its bytes belong to no message"
        typer.echo(f"skyway: {path}: {percent(lost)} of {what}: what is missing is not in the result", err=True)
    return opened


def refuse_wrong_units(log: Log, path: Path, *names: str) -> None:
    """Refuse a table whose times (``wrong_time``) or power (``wrong_power``) cannot be in their unit."""
    for name in names:
        if (problem := getattr(log, name, None)) is not None:
            raise InputError(problem, str(path), remedy="map it with --columns (docs/how-to/replay.md, Tables)")


def towards(text: str) -> tuple[float, float]:
    """Read ``SPEED@FROM`` as (north, east) TOWARDS, m/s."""
    from skyway.models.wind.triangle import vector

    north, east = vector(*typed_values.parse_wind(text))
    return float(north), float(east)
