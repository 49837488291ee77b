"""The commands that look back: ``replay``, ``calibrate wind`` and ``calibrate energy``."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from models.errors import Fault, InputError, one_line
from skyway.cli import options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from link.logs.log import Log
    from link.replay import Replay
    from models.calibration_energy import EnergyFit, ModelName, PowerRecord
    from models.calibration_wind import DragFit
    from models.drag import DragModel
    from models.drone import Drone

REPLAY_HELP = """Go through a flight log as if it were live: legs, battery, wind, events.

Reads MAVLink .tlog, ArduPilot .bin, PX4 .ulg and .csv. Times are H:MM:SS after the beginning of the log.

Examples:

  skyway replay flight.tlog

  skyway replay flight.tlog --from 00:05:00 --to 00:10:00 --wind 6@270 --plot flight.png

  skyway replay flight.tlog --speed 10 --follow wind,battery

  skyway replay flight.tlog --connect udpout:127.0.0.1:14550 --control 5790
"""
WIND_HELP = """Find the drag of a drone in a log of its flight, so that its tilt tells the wind.

Needs flight on two courses (out and back, a circle), or --wind, the wind as it was. Says when a flight cannot tell the drag.

Examples:

  skyway calibrate wind flight.tlog -o drag.toml

  skyway calibrate wind hover.ulg --wind 4@230
"""
ENERGY_HELP = """Fit the energy models to logs of flights and write a drone file that plan uses.

Each flight is predicted by a fit to the others; that error is printed beside each, and that of the published coefficients.

Examples:

  skyway calibrate energy flight1.tlog flight2.tlog --mass 4.69 --payload 0 --payload 0.8 -o drones.toml

  skyway calibrate energy m100_*.csv --mass 3.68 --model momentum --json
"""
_CLOCK = re.compile(r"^(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)$|^(\d+(?:\.\d+)?)$")
FOLLOWED = ("wind", "battery", "mission")
FOLLOW_EVERY_S = {"wind": 10.0, "battery": 30.0}
calibrate = typer.Typer(
    name="calibrate",
    help="Fit the models to what a drone really did.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

LogFile = Annotated[Path, typer.Argument(help="Flight log: .tlog, .bin, .ulg or .csv.", show_default=False)]
Columns = Annotated[
    Path | None,
    typer.Option("--columns", help="For a CSV: TOML file that says which column is what.", show_default=False),
]
System = Annotated[
    int | None, typer.Option("--system", help="MAVLink system. Without it: the first.", show_default=False)
]
AsJson = Annotated[bool, typer.Option("--json", help="Answer as JSON.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files.")]


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
    opened = _open(log, columns)
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
        forecast=None if wind is None else _towards(wind),
    )
    if followed:
        _follow(found, followed, factor, as_json=as_json)
    _write_outputs(found, plot, csv, force=force)
    if as_json:
        from link.replay_report import as_json as report

        typer.echo(json.dumps(report(found), allow_nan=False))
    else:
        _tell(found, log)


def calibrate_wind(  # noqa: D103  the help text is WIND_HELP
    log: LogFile,
    wind: Annotated[
        str | None, typer.Option("--wind", help="Wind as it was, m/s@degrees FROM: 4@230.", show_default=False)
    ] = None,
    system: System = None,
    columns: Columns = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the drag here.", show_default=False)
    ] = None,
    as_json: AsJson = False,
    force: Force = False,
) -> None:
    import numpy as np

    from link.replay import PERIOD_S, choose_system, reduce_log
    from models.calibration_wind import fit_known_wind, identify_drag
    from models.drag_file import drag_file

    options.refuse_overwriting(output, force=force)
    opened = _open(log, columns)
    _, air = reduce_log(opened, choose_system(opened.summary, system), -math.inf, math.inf)
    fit = identify_drag(air, PERIOD_S)
    model = fit.drag
    if wind is not None:
        model = fit_known_wind(air, np.broadcast_to(np.array(_towards(wind)), (len(air), 2)), PERIOD_S)
    if output is not None and model is not None:
        _write(
            output,
            drag_file(
                model, [f"drag found in {one_line(log.name)}", fit.reason if wind is None else f"known wind {wind}"]
            ),
            force=force,
        )
    if as_json:
        typer.echo(json.dumps(_drag_json(fit, model, known=wind is not None), allow_nan=False))
    else:
        _tell_drag(fit, model, known=wind is not None)
    if model is None:
        raise typer.Exit(1)


def calibrate_energy(  # noqa: D103  the help text is ENERGY_HELP
    logs: Annotated[list[Path], typer.Argument(help="Flight logs with battery power.", show_default=False)],
    mass: Annotated[float | None, typer.Option("--mass", help="Drone with batteries, kg.", show_default=False)] = None,
    payload: Annotated[
        list[float] | None,
        typer.Option("--payload", help="Package, kg: one for all, or one for each log in turn.", show_default=False),
    ] = None,
    drones: Annotated[
        Path | None, typer.Option("--drones", help="Fleet file with the drone to start from.", show_default=False)
    ] = None,
    drone: Annotated[str, typer.Option("--drone", help="Drone to start from.")] = "m200-v2",
    model: Annotated[
        Literal["best", "endurance", "momentum"], typer.Option("--model", help="Which is written.")
    ] = "best",
    density: Annotated[float, typer.Option("--air-density", help="During the flights, kg/m3.")] = 1.225,
    system: System = None,
    columns: Columns = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the drone file here.", show_default=False)
    ] = None,
    as_json: AsJson = False,
    force: Force = False,
) -> None:
    from dataclasses import replace

    from models.calibration_energy import MODELS, calibrated, drone_file, fit_energy, published_errors

    options.refuse_overwriting(output, force=force)
    if not 0.3 <= density <= 2.0:
        raise InputError(Fault("out of range", field="--air-density", value=density, remedy="0.3 to 2.0 kg/m3"))
    base = _base_drone(drones, drone)
    if mass is not None:
        if not 0.05 <= mass <= 1000.0:
            raise InputError(Fault("out of range", field="--mass", value=mass, remedy="0.05 to 1000 kg"))
        base = replace(base, mass_kg=mass)
    records = [
        _record(path, number, len(logs), base.mass_kg, payload, system, columns) for number, path in enumerate(logs)
    ]
    fits: dict[ModelName, EnergyFit] = {name: fit_energy(records, name, base, density) for name in MODELS}
    chosen: ModelName = model if model != "best" else min(fits, key=lambda name: _rank(fits[name]))
    written = calibrated(base, fits[chosen].model)
    if output is not None:
        names = ", ".join(one_line(Path(record.name).name) for record in records)
        notes = [f"{chosen} model fitted to {len(records)} flights: {names}"]
        if len(records) > 1:
            notes.append(
                f"error on a flight left out: worst {fits[chosen].worst:.1%}, median {fits[chosen].median:.1%}"
            )
        _write(output, drone_file(written, notes), force=force)
    published = published_errors(records, density)
    if as_json:
        typer.echo(json.dumps(_energy_json(records, fits, published, chosen, written), allow_nan=False))
    else:
        _tell_energy(records, fits, published, chosen, output)


def _open(path: Path, columns: Path | None) -> Log:
    from link.logs.csv_log import read_columns
    from link.logs.reader import SUFFIX, open_log

    opened = open_log(path, None if columns is None else read_columns(columns))
    usual = SUFFIX[opened.summary.format]
    names = [part.lower().lstrip(".") for part in path.suffixes]
    if usual not in names:
        typer.echo(f"skyway: {path} is named otherwise, but is a .{usual}", err=True)
    return opened


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


def _towards(text: str) -> tuple[float, float]:
    from models.wind import vector

    north, east = vector(*options.parse_wind(text))
    return float(north), float(east)


def _drag(path: Path | None) -> DragModel | None:
    from models.drag_file import read_drag

    return None if path is None else read_drag(path)


def _write(path: Path, text: str, *, force: bool) -> None:
    from models.files import write_atomically

    write_atomically(path, text, force=force)


def _write_outputs(found: Replay, plot: Path | None, csv: Path | None, *, force: bool) -> None:
    if csv is not None:
        from link.replay_report import as_csv

        _write(csv, as_csv(found), force=force)
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


def _drag_json(fit: DragFit, model: DragModel | None, *, known: bool) -> dict[str, object]:
    from dataclasses import asdict

    return {
        "schema": "skyway.calibrate-wind/1",
        "identified": model is not None,
        "reason": "found from the wind that was given" if known and model is not None else fit.reason,
        "relative_sigma": fit.relative_sigma if math.isfinite(fit.relative_sigma) and not known else None,
        "course_spread_deg": round(fit.course_spread_deg, 1),
        "wind": None
        if known or not math.isfinite(fit.wind_north_mps)
        else {"north_mps": round(fit.wind_north_mps, 3), "east_mps": round(fit.wind_east_mps, 3)},
        "drag": None if model is None else asdict(model),
    }


def _tell_drag(fit: DragFit, model: DragModel | None, *, known: bool) -> None:
    if model is None:
        typer.echo(f"the drag cannot be identified: {fit.reason}")
        return
    typer.echo("drag found from the wind that was given" if known else f"drag {fit.reason}")
    typer.echo(f"  linear {model.linear_per_s:.4f} 1/s, quadratic {model.quadratic_per_m:.5f} 1/m")
    typer.echo(f"  level bias forward {model.bias_forward_mps2:+.3f}, right {model.bias_right_mps2:+.3f} m/s²")
    if not known:
        from models.wind import speed_from

        speed, direction = speed_from(fit.wind_north_mps, fit.wind_east_mps)
        typer.echo(
            f"  sure to ± {fit.relative_sigma:.0%}; mean wind {float(speed):.1f} m/s from {float(direction):.0f}°"
        )


def _base_drone(path: Path | None, name: str) -> Drone:
    from models.fleet import BUILT_IN, read_fleet

    known = BUILT_IN if path is None else {drone.id: drone for drone in read_fleet(path)}
    if path is not None and name not in known and len(known) == 1:
        return next(iter(known.values()))
    if name not in known:
        raise InputError(Fault("no such drone", field="--drone", value=name, remedy="one of " + ", ".join(known)))
    return known[name]


def _record(
    path: Path,
    number: int,
    count: int,
    mass: float,
    payload: list[float] | None,
    system: int | None,
    columns: Path | None,
) -> PowerRecord:
    from link.replay import choose_system
    from models.calibration_energy import power_record
    from models.telemetry import TelemetryTrack

    opened = _open(path, columns)
    if payload is not None and len(payload) not in (1, count):
        raise InputError(Fault("must be given once, or once for each log", field="--payload", value=len(payload)))
    if payload is not None:
        package = payload[number if len(payload) > 1 else 0]
        if not 0.0 <= package <= 1000.0:
            raise InputError(Fault("out of range", field="--payload", value=package, remedy="0 to 1000 kg"))
    else:
        package = getattr(opened, "payload_kg", math.nan)
        if math.isnan(package):
            raise InputError(Fault("does not say what was carried", str(path), remedy="give --payload, kg"))
    chosen = choose_system(opened.summary, system)
    track = TelemetryTrack.joined(track for track in opened.tracks() if track.system == chosen)
    return power_record(str(path), track, mass + package)


def _rank(fit: EnergyFit) -> float:
    return fit.worst if not math.isnan(fit.worst) else math.inf


def _energy_json(
    records: list[PowerRecord],
    fits: dict[ModelName, EnergyFit],
    published: tuple[float, ...],
    chosen: str,
    drone: Drone,
) -> dict[str, object]:
    def known(value: float) -> float | None:
        return round(value, 5) if math.isfinite(value) else None

    return {
        "schema": "skyway.calibrate-energy/1",
        "flights": [
            {
                "log": record.name,
                "mass_kg": round(record.mass_kg, 4),
                "time_s": round(record.total_s, 1),
                "idle_s": round(record.idle_s, 1),
                "energy_wh": round(record.total_j / 3600.0, 3),
                "left_out_error": {name: known(fit.left_out_error[number]) for name, fit in fits.items()},
                "published_error": known(published[number]),
            }
            for number, record in enumerate(records)
        ],
        "models": {name: {"worst": known(fit.worst), "median": known(fit.median)} for name, fit in fits.items()},
        "published": {"worst": known(max(abs(error) for error in published))},
        "written": chosen,
        "endurance_empty_min": known(drone.endurance_empty_s / 60.0),
        "endurance_full_min": known(drone.endurance_full_s / 60.0),
    }


def _tell_energy(
    records: list[PowerRecord],
    fits: dict[ModelName, EnergyFit],
    published: tuple[float, ...],
    chosen: str,
    output: Path | None,
) -> None:
    typer.echo("error of the energy of each flight, by a fit to the others:")
    typer.echo(f"  {'flight':32} {'kg':>6} {'s':>6} {'Wh':>7} {'endurance':>10} {'momentum':>10} {'published':>10}")
    for number, record in enumerate(records):
        errors = [fits[name].left_out_error[number] for name in fits] + [published[number]]
        cells = " ".join(f"{error:>+10.1%}" if math.isfinite(error) else f"{'-':>10}" for error in errors)
        name = Path(record.name).name[-32:]
        typer.echo(f"  {name:32} {record.mass_kg:6.2f} {record.total_s:6.0f} {record.total_j / 3600.0:7.1f} {cells}")
        if record.idle_s > 5.0:
            typer.echo(f"  {'':32} {record.idle_s:.0f} s with the motors off are left out")
    if len(records) > 1:
        for name, fit in fits.items():
            typer.echo(f"  {name}: worst {fit.worst:.1%}, median {fit.median:.1%}")
    else:
        typer.echo("  one flight cannot be checked against another: the error on unseen flights is unknown")
    typer.echo(
        f"{chosen} model" + (" (use -o FILE to write a drone file)" if output is None else f" written to {output}")
    )


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("replay", help=REPLAY_HELP)(replay)
    calibrate.command("wind", help=WIND_HELP)(calibrate_wind)
    calibrate.command("energy", help=ENERGY_HELP)(calibrate_energy)
    app.add_typer(calibrate)
