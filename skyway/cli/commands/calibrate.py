"""Commands ``calibrate wind`` and ``calibrate energy``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from skyway.cli import options
from skyway.cli.log_options import Columns, LogFile, System, VehicleKind, open_any, refuse_wrong_units, towards
from skyway.models.base.errors import Fault, InputError, one_line
from skyway.models.base.formatting import percent
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from skyway.cli.views.calibration import Air
    from skyway.link.logs.common.vehicle_kind import Kind
    from skyway.models.calibration.energy import EnergyFit, ModelName, PowerRecord
    from skyway.models.drones.drone import Drone
    from skyway.models.wind.estimation.blocks import Blocks

MAX_SAMPLES = 300_000
"""Of a longer log every second, fourth, … sample is taken."""
calibrate = typer.Typer(help="Fit the models to recorded flights.", no_args_is_help=True, rich_markup_mode=None)


@calibrate.command("wind")
def calibrate_wind(
    log: LogFile,
    wind: Annotated[str | None, typer.Option(help="True wind during the flight, m/s@degrees FROM: 4@230.")] = None,
    system: System = None,
    vehicle: VehicleKind = None,
    columns: Columns = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Output file for the drag: FILE.toml.")] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Estimate the drag of a drone from a log of its flight, so that its tilt measures the wind.

    For a fixed wing: the scale factor of its airspeed sensor and the offset of its heading. The flight must cover two courses (out and back, or a circle), unless --wind gives the true wind. If a flight does not
    determine the drag, the command says so.

    Examples
    --------
      skyway calibrate wind flight.tlog -o drag.toml
      skyway calibrate wind hover.ulg --wind 4@230
    """
    from skyway.cli.views.calibration import Air, air_report, tell_air
    from skyway.link.replay.replay import choose_system, flight_blocks
    from skyway.link.replay.vehicle import no_wind, vehicle_of
    from skyway.models.base.files import write_atomically

    options.refuse_overwriting(output, force=force)
    opened = open_any(log, columns)
    refuse_wrong_units(opened, log, "wrong_time")
    chosen = choose_system(opened.summary, system)
    what = vehicle_of(opened.summary, chosen, cast("Kind | None", vehicle))
    nothing = no_wind(what)
    air = flight_blocks(opened, chosen, vehicle=what)
    found = Air(None, None, nothing) if nothing else _air_of(air, wind, log)
    if output is not None and found.known:
        from skyway.models.drones.drag_file import drag_file

        notes = [f"found in {one_line(log.name)}", found.reason]
        write_atomically(output, drag_file(found.drag, notes, found.airspeed), force=force)
        options.say_written(output)
    if as_json:
        typer.echo(json_text(air_report(found)))
    else:
        tell_air(found)
    if not found.known:
        raise typer.Exit(1)


def _air_of(air: Blocks, wind: str | None, log: Path) -> Air:
    """Find the drag in what was flown on rotors, the airspeed sensor in what was flown on wings."""
    import numpy as np

    from skyway.cli.views.calibration import Air
    from skyway.link.replay.monitors import PERIOD_S
    from skyway.models.calibration.airspeed import identify_airspeed
    from skyway.models.calibration.wind import fit_known_wind, identify_drag
    from skyway.models.wind.estimation.blocks import course_spread_deg

    spread = course_spread_deg(air.velocity[air.flying & np.isfinite(air.velocity).all(axis=1)])
    if wind is not None:
        known = towards(wind)
        try:
            drag = fit_known_wind(air, np.broadcast_to(np.array(known), (len(air), 2)), PERIOD_S)
        except InputError as error:
            faults = [replace(one, file=str(log), field="--wind", value=wind) for one in error.faults]
            raise InputError(faults) from error
        return Air(drag, None, f"found with the given wind, {wind}", wind=known, course_spread_deg=spread)
    sensor = identify_airspeed(air) if (air.flying & air.winged).any() else None
    if sensor is not None and (sensor.model is not None or air.winged[air.flying].mean() > 0.5):
        rotors = identify_drag(air.part(~air.winged), PERIOD_S)
        mean = (sensor.wind_north_mps, sensor.wind_east_mps)
        return Air(rotors.drag, sensor.model, sensor.reason, sensor.factor_sigma, mean, spread)
    fit = identify_drag(air, PERIOD_S)
    mean = (fit.wind_north_mps, fit.wind_east_mps)
    return Air(fit.drag, None, fit.reason, fit.relative_sigma, mean, fit.course_spread_deg)


@calibrate.command("energy")
def calibrate_energy(
    logs: Annotated[list[Path], typer.Argument(help="Flight logs with battery power.")],
    mass: Annotated[float | None, typer.Option(help="Mass of the drone with batteries, kg.")] = None,
    payload: Annotated[
        list[float] | None,
        typer.Option(help="Mass of the package, kg: one value for all logs, or one per log in order."),
    ] = None,
    drones: Annotated[Path | None, typer.Option(help="Fleet file that holds --drone.")] = None,
    drone: Annotated[str, typer.Option(help="Drone whose other properties are kept.")] = "m200-v2",
    identity: Annotated[str | None, typer.Option("--id", help="Id of the new drone.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the new drone.")] = None,
    battery: Annotated[float | None, typer.Option(help="Nameplate energy of its batteries, Wh.")] = None,
    model: Annotated[Literal["best", "endurance", "momentum"], typer.Option(help="Energy model to write.")] = "best",
    density: Annotated[float, typer.Option("--air-density", help="Air density during the flights, kg/m3.")] = 1.225,
    system: System = None,
    columns: Columns = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Output file for the drone: FILE.toml.")] = None,
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Fit the energy models to flight logs and write a drone file for skyway plan.

    Each flight is predicted from a fit to the others. The error is printed next to that of the published coefficients.

    Examples
    --------
      skyway calibrate energy flight1.tlog flight2.tlog --mass 4.69 --payload 0 --payload 0.8 -o drones.toml
      skyway calibrate energy m100_*.csv --mass 3.68 --id m100 --name "DJI Matrice 100" --battery 130 -o m100.toml
    """
    from skyway.cli.views.calibration import ONE_MASS, energy_report, tell_energy
    from skyway.models.base.files import write_atomically
    from skyway.models.calibration.energy import MODELS, calibrated, drone_file, fit_energy, one_mass, published_errors

    options.refuse_overwriting(output, force=force)
    if not 0.3 <= density <= 2.0:
        raise InputError(Fault("out of range", field="--air-density", value=density, remedy="0.3 to 2.0 kg/m3"))
    if mass is not None and not 0.05 <= mass <= 1000.0:
        raise InputError(Fault("out of range", field="--mass", value=mass, remedy="0.05 to 1000 kg"))
    if battery is not None and not 1.0 <= battery <= 1e6:
        raise InputError(Fault("out of range", field="--battery", value=battery, remedy="Wh, 1 to 1000000"))
    start = _base_drone(drones, drone)
    base = _this_aircraft(start, mass, identity, name, battery, writes=output is not None)
    records = [
        _record(path, number, len(logs), base.mass_kg, payload, system, columns) for number, path in enumerate(logs)
    ]
    fits: dict[ModelName, EnergyFit] = {name: fit_energy(records, name, base, density) for name in MODELS}
    chosen: ModelName = model if model != "best" else min(fits, key=lambda name: _rank(fits[name]))
    written = calibrated(base, fits[chosen])
    if output is not None:
        names = ", ".join(one_line(Path(record.name).name) for record in records)
        notes = [f"{chosen} model fitted to {counted(len(records), 'flight')}: {names}"]
        if len(records) > 1:
            notes.append(
                f"error on a flight that was not fitted: worst {percent(fits[chosen].worst, 1)}, median {percent(fits[chosen].median, 1)}"
            )
        if one_mass(records):
            notes.append(ONE_MASS)
        if written.id != start.id:
            notes.append(f"not measured, copied from {start.id}: maximum payload, airspeeds, wind limit, recharge time")
        write_atomically(output, drone_file(written, notes), force=force)
        options.say_written(output)
    published = published_errors(records, density)
    if as_json:
        typer.echo(json_text(energy_report(records, fits, published, chosen, written)))
    else:
        tell_energy(records, fits, published, chosen, output)


def _base_drone(path: Path | None, name: str) -> Drone:
    from skyway.models.drones.drone import BUILT_IN
    from skyway.models.drones.fleet import read_fleet

    known = BUILT_IN if path is None else {drone.id: drone for drone in read_fleet(path)}
    if path is not None and name not in known and len(known) == 1:
        return next(iter(known.values()))
    if name not in known:
        raise InputError(Fault("no such drone", field="--drone", value=name, remedy="one of " + ", ".join(known)))
    return known[name]


SAME_MASS = 0.03
"""A drone whose mass differs by more than this share is another aircraft."""


def _this_aircraft(
    base: Drone, mass: float | None, identity: str | None, name: str | None, battery_wh: float | None, *, writes: bool
) -> Drone:
    """Return the drone that flew; one of another mass does not keep name and battery of the one it was started from."""
    from skyway.models.base.units import J_PER_WH

    flew = replace(
        base,
        id=identity or base.id,
        name=name or identity or base.name,
        mass_kg=base.mass_kg if mass is None else mass,
        battery_j=base.battery_j if battery_wh is None else battery_wh * J_PER_WH,
    )
    other = abs(flew.mass_kg / base.mass_kg - 1.0) > SAME_MASS
    missing = [option for option, given in (("--id", identity), ("--battery", battery_wh)) if given is None]
    if writes and other and missing:
        problem = f"{flew.mass_kg:g} kg is not {base.name} ({base.mass_kg:g} kg)"
        remedy = f"identify the aircraft with {' and '.join(missing)} (and --name), or choose another --drone"
        raise InputError(Fault(problem, field="--mass", value=mass, remedy=remedy))
    return flew


ON_ROTORS = ("multirotor", "helicopter", "unknown")
"""Kinds of vehicles whose power follows the energy models; a table of power need not name the kind."""


def _record(
    path: Path,
    number: int,
    count: int,
    mass: float,
    payload: list[float] | None,
    system: int | None,
    columns: Path | None,
) -> PowerRecord:
    from skyway.link.replay.flight_monitor import Thinned
    from skyway.link.replay.replay import choose_system
    from skyway.models.calibration.energy import power_record
    from skyway.models.drones.telemetry import TelemetryTrack

    opened = open_any(path, columns)
    refuse_wrong_units(opened, path, "wrong_time", "wrong_power")
    if payload is not None and len(payload) not in (1, count):
        raise InputError(Fault("must be given once, or once per log", field="--payload", value=len(payload)))
    if payload is not None:
        package = payload[number if len(payload) > 1 else 0]
        if not 0.0 <= package <= 1000.0:
            raise InputError(Fault("out of range", field="--payload", value=package, remedy="0 to 1000 kg"))
    else:
        package = getattr(opened, "payload_kg", math.nan)
        if math.isnan(package):
            raise InputError(Fault("does not state the payload", str(path), remedy="give --payload, kg"))
    chosen = choose_system(opened.summary, system)
    flown = opened.summary.vehicle(chosen)
    if flown.kind not in ON_ROTORS:
        problem = f"is the log of a {flown.kind} ({flown.told_by}): the energy models are of a multirotor"
        raise InputError(Fault(problem, str(path), remedy="name logs of a multirotor"))
    kept = Thinned(TelemetryTrack, most=MAX_SAMPLES)
    for track in opened.tracks():
        if track.system == chosen:
            kept.add(track)
    return power_record(str(path), kept.rows(), mass + package)


def _rank(fit: EnergyFit) -> float:
    return fit.worst if not math.isnan(fit.worst) else math.inf
