"""The command that looks back: ``replay``."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from models.errors import Fault, InputError
from skyway.cli import calibrate_commands, options
from skyway.cli.log_options import AsJson, Columns, Force, LogFile, System, open_any, towards, write

if TYPE_CHECKING:
    from collections.abc import Iterator

    from link.logs.log import Log
    from link.replay import Replay
    from models.drag import DragModel

REPLAY_HELP = """Go through a flight log as if it were live: legs, battery, wind, events.

Reads MAVLink .tlog, ArduPilot .bin, PX4 .ulg and .csv. Times are H:MM:SS after the beginning of the log.

Examples:

  skyway replay flight.tlog

  skyway replay flight.tlog --from 00:05:00 --to 00:10:00 --wind 6@270 --plot flight.png

  skyway replay flight.tlog --speed 10 --follow wind,battery

  skyway replay flight.tlog --connect udpout:127.0.0.1:14550 --control 5790
"""
_CLOCK = re.compile(r"^(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)$|^(\d+(?:\.\d+)?)$")
FOLLOWED = ("wind", "battery", "mission")
FOLLOW_EVERY_S = {"wind": 10.0, "battery": 30.0}


def replay(  # noqa: D103  the help text is REPLAY_HELP
    log: LogFile,
    speed: Annotated[str, typer.Option("--speed", help="Times real time: 1, 10, max.")] = "max",
    begin: Annotated[str | None, typer.Option("--from", help="Begin here, H:MM:SS.", show_default=False)] = None,
    end: Annotated[str | None, typer.Option("--to", help="End here, H:MM:SS.", show_default=False)] = None,
    system: System = None,
    follow: Annotated[
        str | None, typer.Option("--follow", help="Print as it happens: wind,battery,mission.", show_default=False)
    ] = None,
    wind: Annotated[
        str | None, typer.Option("--wind", help="Wind that was forecast, m/s@degrees FROM: 8@270.", show_default=False)
    ] = None,
    drag: Annotated[
        Path | None, typer.Option("--drag", help="Drag of the drone, from calibrate wind.", show_default=False)
    ] = None,
    columns: Columns = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw the flight: FILE.png or FILE.svg.", show_default=False)
    ] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", help="Write a table, one row a second.", show_default=False)
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option("--connect", help="Send the log as MAVLink: udpout:127.0.0.1:14550.", show_default=False),
    ] = None,
    control: Annotated[
        int | None,
        typer.Option("--control", help="With --connect: obey JSON lines on this TCP port.", show_default=False),
    ] = None,
    as_json: AsJson = False,
    force: Force = False,
) -> None:
    from link.replay import replay as go_through

    factor = _speed(speed)
    followed = _followed(follow)
    options.check_picture(plot)
    options.refuse_overwriting(plot, csv, force=force)
    if control is not None and connect is None:
        raise InputError(Fault("needs --connect", field="--control", value=control))
    opened = open_any(log, columns)
    first, last = _part(opened, begin, end)
    if connect is not None:
        _serve(opened, connect, control, factor, first)
        return
    found = go_through(
        opened,
        system=system,
        from_s=first,
        to_s=last,
        drag=_drag(drag),
        forecast=None if wind is None else towards(wind),
    )
    if followed:
        _follow(found, followed, factor, as_json=as_json)
    _write_outputs(found, plot, csv, force=force)
    if as_json:
        from link.replay_report import as_json as report

        typer.echo(json.dumps(report(found), allow_nan=False))
    else:
        _tell(found, log)


def _speed(text: str) -> float:
    if text == "max":
        return math.inf
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < abs(value) <= 1000.0:
        raise InputError(
            Fault("is no speed", field="--speed", value=text, remedy="1, 10, max; below 0 backwards with --connect")
        )
    return value


def _followed(text: str | None) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(",")) if text else ()
    for name in names:
        if name not in FOLLOWED:
            raise InputError(
                Fault("cannot be followed", field="--follow", value=name, remedy="of " + ", ".join(FOLLOWED))
            )
    return names


def _offset(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    match = _CLOCK.match(text.strip())
    if match is None:
        raise InputError(Fault("is no time of the log", field=option, value=text, remedy="H:MM:SS, MM:SS or seconds"))
    if match[4] is not None:
        return float(match[4])
    return int(match[1] or 0) * 3600.0 + int(match[2]) * 60.0 + float(match[3])


def _part(log: Log, begin: str | None, end: str | None) -> tuple[float, float]:
    first, last = _offset(begin, "--from"), _offset(end, "--to")
    if first is not None and last is not None and first >= last:
        raise InputError(Fault("is not after --from", field="--to", value=end))
    zero = log.summary.start_s
    length = log.summary.end_s - zero
    if first is not None and math.isfinite(length) and first > length:
        raise InputError(
            Fault("is after the end of the log", field="--from", value=begin, remedy=f"it is {_clock(length)} long")
        )
    return (-math.inf if first is None else zero + first), (math.inf if last is None else zero + last)


def _drag(path: Path | None) -> DragModel | None:
    from models.drag_file import read_drag

    return None if path is None else read_drag(path)


def _write_outputs(found: Replay, plot: Path | None, csv: Path | None, *, force: bool) -> None:
    if csv is not None:
        from link.replay_report import as_csv

        write(csv, as_csv(found), force=force)
    if plot is not None:
        from skyway.plot_replay import plot_replay

        plot_replay(found, plot)


def _serve(log: Log, connect: str, control: int | None, factor: float, first: float) -> None:
    from link.replay_player import Player, packets_of
    from link.replay_server import ControlServer, Output, play

    if control is not None and not 0 <= control <= 65535:
        raise InputError(Fault("port out of range", field="--control", value=control, remedy="0 to 65535"))
    source = packets_of(log)
    output = Output(connect)
    player = Player(source, output.send, speed=factor)
    if math.isfinite(first):
        player.seek(first - source.start_s)
    elif factor < 0.0:
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


def _follow(found: Replay, followed: tuple[str, ...], factor: float, *, as_json: bool) -> None:
    """Print lines as they would have come; with ``--json`` on stderr, so that stdout stays one object."""
    last = None
    for time_s, line in sorted(_lines(found, followed)):
        if last is not None and math.isfinite(factor):
            time.sleep(max(time_s - last, 0.0) / abs(factor))
        last = time_s
        typer.echo(line, err=as_json)
        (sys.stderr if as_json else sys.stdout).flush()


def _lines(found: Replay, followed: tuple[str, ...]) -> Iterator[tuple[float, str]]:
    from models.wind import speed_from

    zero = found.summary.start_s
    if "wind" in followed:
        due = -math.inf
        speed, direction = speed_from(found.wind.wind[:, 0], found.wind.wind[:, 1])
        for row, time_s in enumerate(found.wind.time_s.tolist()):
            if time_s >= due:
                due = time_s + FOLLOW_EVERY_S["wind"]
                sigma = found.wind.sigma_mps[row]
                yield (
                    time_s,
                    f"{_clock(time_s - zero)}  wind {speed[row]:.1f} ± {sigma:.1f} m/s from {direction[row]:.0f}°",
                )
    if "battery" in followed:
        due = -math.inf
        table = found.seconds
        for time_s, soc, power in zip(
            table.time_s.tolist(), table["soc"].tolist(), table["power_w"].tolist(), strict=True
        ):
            if time_s >= due and (math.isfinite(soc) or math.isfinite(power)):
                due = time_s + FOLLOW_EVERY_S["battery"]
                yield time_s, f"{_clock(time_s - zero)}  battery {_percent(soc)}, {_figure(power, 'W', 0)}"
    if "mission" in followed:
        for event in found.events:
            yield event.time_s, f"{_clock(event.time_s - zero)}  {event.text}"


def _clock(seconds: float) -> str:
    if not math.isfinite(seconds):
        return "-:--:--"
    whole = max(0, round(seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _percent(value: float) -> str:
    return f"{value:.0%}" if math.isfinite(value) else "unknown charge"


def _figure(value: float, unit: str, digits: int = 1) -> str:
    return f"{value:.{digits}f} {unit}" if math.isfinite(value) else f"unknown {unit}"


def _tell(found: Replay, path: Path) -> None:
    from link.replay_report import as_json as report

    facts = report(found)
    summary = found.summary
    typer.echo(f"{path.name}: {summary.format}, {summary.messages} messages, {summary.skipped_bytes} bytes skipped")
    typer.echo(f"  {facts['start']} to {facts['end']} by {summary.time_base.source}")
    for doubt in summary.time_base.doubts:
        typer.echo(f"  doubt: {doubt}")
    shown = ", ".join(str(number) for number in summary.systems) or "none"
    typer.echo(f"  vehicles: {shown}" + ("" if found.system is None else f"; shown: {found.system}"))
    for number, leg in enumerate(found.legs, 1):
        typer.echo(
            f"  leg {number}: {_clock(leg.start_s - summary.start_s)} to {_clock(leg.end_s - summary.start_s)}, "
            f"{leg.distance_m / 1000:.2f} km, {_percent(leg.soc_start)} to {_percent(leg.soc_end)}, "
            f"{_figure(leg.energy_j / 3600.0, 'Wh')}"
        )
    for name, phase in found.phases.items():
        if phase.time_s > 0.0:
            typer.echo(f"  {name}: {phase.time_s:.0f} s, {_figure(phase.energy_j / phase.time_s, 'W', 0)}")
    _tell_wind(found, facts["wind_summary"])
    for event in found.events:
        typer.echo(f"  {_clock(event.time_s - summary.start_s)}  {event.text}")


def _tell_wind(found: Replay, facts: dict[str, object]) -> None:
    if not len(found.wind):
        typer.echo("  wind: not measured")
        return
    typer.echo(
        f"  wind: {facts['mean_speed_mps']} m/s from {facts['mean_from_deg']}° in the mean, ± "
        f"{float(found.wind.sigma_mps[-1]):.1f} m/s at the end ({found.drag_source} drag)"
    )
    forecast = facts["forecast"]
    if isinstance(forecast, dict):
        typer.echo(
            f"  forecast: {forecast['speed_mps']} m/s from {forecast['from_deg']}°, "
            f"{forecast['vector_difference_mps']} m/s apart"
        )


def register(app: typer.Typer) -> None:
    """Add the commands that look back, ``calibrate`` included."""
    app.command("replay", help=REPLAY_HELP)(replay)
    calibrate_commands.register(app)
