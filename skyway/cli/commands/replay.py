"""Command ``replay``."""

from __future__ import annotations

import math
import re
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from skyway import typed_values
from skyway.cli import log_options, options
from skyway.cli.log_options import Columns, LogFile, System, open_any
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import (
    counter,
    distance_text,
    duration,
    energy_text,
    mass_text,
    percent,
    speed_text,
    wind_text,
    with_unit,
)
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.logs.common.log import Log
    from skyway.link.logs.common.vehicle_kind import Kind
    from skyway.link.replay.monitors import Notice
    from skyway.link.replay.prediction import Prediction
    from skyway.link.replay.replay import Replay, ReplayOptions
    from skyway.link.replay.report import ReplayReport, WindSummary

_CLOCK = re.compile(r"^(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)$|^(\d+(?:\.\d+)?)$")
FOLLOWED = ("wind", "battery", "mission")


def replay(
    log: LogFile,
    speed: Annotated[
        str | None,
        typer.Option(help="Speed as a multiple of real time: 1, 10, max. Default: max; with --connect 1."),
    ] = None,
    begin: Annotated[str | None, typer.Option("--from", help="Start time in the log, H:MM:SS.")] = None,
    end: Annotated[str | None, typer.Option("--to", help="End time in the log, H:MM:SS.")] = None,
    system: System = None,
    vehicle: log_options.VehicleKind = None,
    follow: Annotated[str | None, typer.Option(help="Print events as they happen: wind,battery,mission.")] = None,
    wind: Annotated[str | None, typer.Option(help="Forecast wind, m/s@degrees FROM: 8@270.")] = None,
    forecast: Annotated[
        list[Path] | None, typer.Option(help="Weather forecast, as for skyway plan; repeatable.")
    ] = None,
    scenario: log_options.ScenarioName = None,
    drag: log_options.Drag = None,
    drone: Annotated[
        Path | None,
        typer.Option(
            help="Predict the flight's energy with this drone: fleet file, or id of a drone of the scenario or a built-in one."
        ),
    ] = None,
    payload: Annotated[float | None, typer.Option(help="Mass of the package carried, kg, for --drone.")] = None,
    aboard: Annotated[
        int | None,
        typer.Option(
            help="Replay the full log of the flight, fetched from the vehicle, instead of its recording: number N of several."
        ),
    ] = None,
    columns: Columns = None,
    plot: options.Plot = None,
    csv: Annotated[Path | None, typer.Option(help="Write a table with one row per second: FILE.csv.")] = None,
    connect: Annotated[str | None, typer.Option(help="Send the log as MAVLink: udpout:127.0.0.1:14550.")] = None,
    control: Annotated[
        int | None, typer.Option(help="With --connect: accept commands as JSON lines on this TCP port.")
    ] = None,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Replay a flight log as if it were live: legs, battery, wind, events.

    Times are H:MM:SS from the start of the log.

    Examples
    --------
      skyway replay flight.tlog
      skyway replay flight.tlog --from 00:05:00 --to 00:10:00 --wind 6@270 --plot flight.png
      skyway replay flight.tlog --speed 10 --follow wind,battery --drag drag.toml
      skyway replay flight.tlog --drone drones.toml --payload 0.8
      skyway replay flight.tlog --aboard
      skyway replay flight.tlog --connect udpout:127.0.0.1:14550 --control 5790
    """
    factor = _speed(speed or ("max" if connect is None else "1"), connect)
    followed = _followed(follow)
    options.check_picture(plot)
    options.refuse_overwriting(plot, csv, force=force)
    _check_control(control, connect)
    if connect is not None:
        _refuse_results({"--plot": plot, "--csv": csv, "--follow": follow, "--json": as_json or None})
    if payload is not None and drone is None:
        raise InputError("needs --drone", field="--payload", value=payload, remedy="name the drone that carries it")
    log, system = _chosen(log, system, aboard, quiet=as_json)
    predicted_by = None if drone is None else log_options.drone_of(drone, scenario)
    opened = open_any(log, columns)
    first, last = _part(opened, begin, end)
    if connect is not None:
        _check_system(opened, system)
        _serve(opened, connect, control, factor, (first, last), system)
        return
    from skyway.link.replay.replay import ReplayOptions
    from skyway.models.base.parameters import changed
    from skyway.models.wind.estimation.filter import WindFilterSettings
    from skyway.models.wind.estimation.live import NO_FORECAST

    expected, strays = log_options.log_forecast(opened, log, wind, forecast, scenario)
    if settings:
        usual = strays or (WindFilterSettings() if expected else NO_FORECAST)
        strays = typed_values.settings_of(settings, usual).wind.filter
    drag_model, sensor = log_options.air_of(drag)
    asked = ReplayOptions(
        system=system, vehicle=cast("Kind | None", vehicle), from_s=first, to_s=last,
        drag=drag_model, airspeed=sensor, forecast=expected, settings=strays,
    )  # fmt: skip
    if followed and drag is None:
        typer.echo(
            "skyway: the drag is estimated from the whole log first; with --drag FILE the replay equals the live flight",
            err=True,
        )
    found = _go_through(opened, asked, followed, factor, csv, err=as_json, force=force)
    if plot is not None:
        from skyway.plots.replay import plot_replay

        plot_replay(found, plot)
    options.say_written(csv, plot)
    from skyway.link.replay.prediction import predict
    from skyway.link.replay.report import replay_report

    prediction = None if predicted_by is None else predict(found, predicted_by, payload or 0.0)
    report = replay_report(found, prediction, changed(strays, "wind.filter") if settings and strays else None)
    if as_json:
        typer.echo(json_text(report))
        return
    _tell(found, report, log)
    if prediction is not None:
        _tell_prediction(prediction)


def _chosen(log: Path, system: int | None, aboard: int | None, *, quiet: bool) -> tuple[Path, int | None]:
    """Return the log to be replayed, and the vehicle in it: the one that is named, or the one that was fetched from the vehicle."""
    from skyway.link.files.catalog import logs_of

    full = logs_of(log, system)
    names = ", ".join(f"{number} {path.name}" for number, path in enumerate(full, start=1))
    if aboard is None:
        if full and not quiet:
            typer.echo(
                f"skyway: the full log of this flight was fetched from the vehicle; --aboard replays it: {names}",
                err=True,
            )
        return log, system
    if not log.exists():
        raise InputError("no such file", str(log))
    if not full:
        remedy = "fly with --fetch-log, or name the log that skyway logs fetch wrote"
        raise InputError("no log was fetched of this flight", str(log), field="--aboard", remedy=remedy)
    if aboard == 0 and len(full) > 1:
        raise InputError(
            "there are several logs of this flight", str(log), field="--aboard", remedy=f"--aboard N: {names}"
        )
    if not 0 <= aboard <= len(full):
        raise InputError("no such log of this flight", str(log), field="--aboard", value=aboard, remedy=names)
    chosen = full[max(aboard - 1, 0)]
    if not quiet:
        typer.echo(f"skyway: {chosen}, the full log of this flight", err=True)
    return chosen, None


def _go_through(
    log: Log,
    asked: ReplayOptions,
    followed: tuple[str, ...],
    factor: float,
    csv: Path | None,
    *,
    err: bool,
    force: bool,
) -> Replay:
    """Replay, telling on the way what is followed (on stderr where stdout is one object), and writing the table."""
    from skyway.link.replay.replay import replay as go_through
    from skyway.link.replay.report import Table
    from skyway.models.base.files import writing

    zero = log.summary.start_s

    def tell(notice: Notice) -> None:
        if notice.kind in followed:
            typer.echo(f"{counter(notice.time_s - zero)}  {notice.text}", err=err)

    with ExitStack() as stack:
        listener = None
        if csv is not None:
            table = Table(stack.enter_context(writing(csv, force=force)))
            stack.callback(table.close)
            listener = table.add
        return go_through(
            log,
            asked,
            notice=tell if followed else None,
            wait_until=_pace(factor) if followed and math.isfinite(factor) else None,
            listener=listener,
        )


def _pace(factor: float) -> Callable[[float], None]:
    """Wait so that the log is replayed at a multiple of real time."""
    begun: list[tuple[float, float]] = []

    def wait_until(time_s: float) -> None:
        if not begun:
            begun.append((time_s, time.monotonic()))
        log_s, wall_s = begun[0]
        time.sleep(max((time_s - log_s) / factor - (time.monotonic() - wall_s), 0.0))

    return wait_until


def _speed(text: str, connect: str | None) -> float:
    if text == "max":
        return math.inf
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < abs(value) <= 1000.0 or (value < 0.0 and connect is None):
        raise InputError(
            "is not a speed", field="--speed", value=text, remedy="1, 10, max; below 0 backwards with --connect"
        )
    return value


def _followed(text: str | None) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(",")) if text else ()
    for name in names:
        if name not in FOLLOWED:
            raise InputError("cannot be followed", field="--follow", value=name, remedy="of " + ", ".join(FOLLOWED))
    return names


def _offset(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    match = _CLOCK.match(text.strip())
    if match is None:
        raise InputError("is not a time of the log", field=option, value=text, remedy="H:MM:SS, MM:SS or seconds")
    if match[4] is not None:
        return float(match[4])
    return int(match[1] or 0) * 3600.0 + int(match[2]) * 60.0 + float(match[3])


def _part(log: Log, begin: str | None, end: str | None) -> tuple[float, float]:
    first, last = _offset(begin, "--from"), _offset(end, "--to")
    if first is not None and last is not None and first >= last:
        raise InputError("is not after --from", field="--to", value=end)
    zero = log.summary.start_s
    length = log.summary.end_s - zero
    if first is not None and math.isfinite(length) and first > length:
        raise InputError(
            "is after the end of the log", field="--from", value=begin, remedy=f"it is {counter(length)} long"
        )
    return (-math.inf if first is None else zero + first), (math.inf if last is None else zero + last)


def _check_control(control: int | None, connect: str | None) -> None:
    if control is not None and connect is None:
        raise InputError("needs --connect", field="--control", value=control)
    if control is not None and not 0 <= control <= 65535:
        raise InputError("port out of range", field="--control", value=control, remedy="0 to 65535")


def _refuse_results(asked: dict[str, object]) -> None:
    """Refuse options of a report, which is not made while a log is sent."""
    for option, value in asked.items():
        if value is not None:
            raise InputError(
                "cannot be combined with --connect", field=option, remedy="run the command once without it"
            )


def _check_system(log: Log, system: int | None) -> None:
    known = (*log.summary.systems, *log.summary.others)
    if system is not None and system not in known:
        spoke = ", ".join(str(number) for number in known) or "none"
        raise InputError("is not in this log", field="--system", value=system, remedy=f"systems in this log: {spoke}")


def _serve(
    log: Log, connect: str, control: int | None, factor: float, part: tuple[float, float], system: int | None
) -> None:
    from skyway.link.replay.player import Player, packets_of
    from skyway.link.replay.server import ControlServer, play
    from skyway.link.wire.address import parse_address
    from skyway.link.wire.transport import open_transport

    source = packets_of(log, system, *part)
    output = open_transport(parse_address(connect))
    player = Player(source, output.write, speed=factor)
    if factor < 0.0:
        player.position_s = source.end_s
    server = None
    try:
        if control is not None:
            server = ControlServer(player, control)
            typer.echo(f"control on tcp:127.0.0.1:{server.port}")
        sent = play(player, server, hold=server is not None)
    finally:
        if server is not None:
            server.close()
        output.close()
    typer.echo(f"sent {sent} packets to {connect}")


def _tell(found: Replay, report: ReplayReport, path: Path) -> None:
    summary = found.summary
    typer.echo(
        f"{path.name}: {summary.format}, {counted(summary.messages, 'message')}, {counted(summary.skipped_bytes, 'byte')} skipped"
    )
    begin, end = ("no time" if one is None else one for one in (report.start, report.end))
    typer.echo(f"  {begin} to {end} by {summary.time_base.source}")
    for doubt in summary.time_base.doubts:
        typer.echo(f"  warning: {doubt}")
    shown = ", ".join(str(number) for number in summary.systems) or "none"
    what = f"{found.vehicle.kind} ({found.vehicle.told_by})"
    typer.echo(f"  vehicles: {shown}" + ("" if found.system is None else f"; shown: {found.system}, {what}"))
    for number, leg in enumerate(found.legs, 1):
        typer.echo(
            f"  leg {number}: {counter(leg.start_s - summary.start_s)} to {counter(leg.end_s - summary.start_s)}, "
            f"{distance_text(leg.distance_m)}, charge {percent(leg.soc_start)} to {percent(leg.soc_end)}, "
            f"{energy_text(leg.energy_j)}"
        )
    for name, phase in found.phases.items():
        if phase.time_s > 0.0:
            used = f"{energy_text(phase.energy_j)}, {with_unit(phase.energy_j / phase.time_s, 'W', 0)}"
            typer.echo(f"  {name}: {duration(phase.time_s)}, {used}")
    _tell_wind(found, report.wind_summary)
    for event in found.events:
        typer.echo(f"  {counter(event.time_s - summary.start_s)}  {event.text}")


def _tell_prediction(made: Prediction) -> None:
    measured = "not in the log" if math.isnan(made.measured_j) else energy_text(made.measured_j)
    apart = "" if math.isnan(made.error) else f", {percent(made.error, 1, signed=True)}"
    typer.echo(
        f"  {made.drone.id} at {mass_text(made.mass_kg)} predicts {energy_text(made.total_j)}; measured {measured}{apart}"
    )
    for name, energy in made.predicted_j.items():
        typer.echo(f"    {name}: {energy_text(energy)} predicted")
    used = "" if math.isnan(made.measured_soc) else f"; the log says {percent(made.measured_soc)}"
    typer.echo(f"    of the battery: {percent(made.predicted_soc)} predicted{used}")


def _tell_wind(found: Replay, summary: WindSummary) -> None:
    from skyway.link.replay.wind_words import wind_sentence

    typer.echo(f"  wind: {wind_sentence(found)}")
    if (forecast := summary.forecast) is not None:
        typer.echo(
            f"  forecast: {_wind(forecast.speed_mps, forecast.from_deg)}; on average "
            f"{speed_text(forecast.vector_difference_mps)} apart, {speed_text(forecast.vector_rms_mps)} RMS"
        )


def _wind(speed_mps: float | None, from_deg: float | None) -> str:
    return wind_text(math.nan if speed_mps is None else speed_mps, math.nan if from_deg is None else from_deg)
