"""Commands ``demo`` and ``serve``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import options
from skyway.cli.options import FamilyName
from skyway.cli.request_options import ERROR_HELP, FORECAST_HELP, OBSERVED_HELP
from skyway.missions.autopilots import NAMES
from skyway.models.base.errors import InputError, refuse
from skyway.models.base.ranges import range_faults
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence


def demo(
    day: Annotated[str | None, typer.Option(help="Day of 2013 whose wind is simulated.")] = None,
    seed: Annotated[int, typer.Option(help="Random seed of gusts, other drones and errors.")] = 1,
    autopilot: Annotated[FamilyName, typer.Option(help="Autopilot to simulate.")] = NAMES[0],
    planner: Annotated[str, typer.Option(help="Planner. Default: the default planner.")] = "",
    plan_only: Annotated[bool, typer.Option("--plan-only", help="Plan only; this compiles the kernels.")] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for plan, journal and report.")] = Path(
        "out/demo"
    ),
    calibration_flight: Annotated[
        Path | None, typer.Option(help="Fly a square twice as a calibration flight, and record it: FILE.tlog.")
    ] = None,
    payload: Annotated[
        float | None, typer.Option(help="Mass of the package on the calibration flight, kg. Default: 0.8.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the recording of a calibration flight.")] = False,
) -> None:
    """Run a whole delivery: planned, flown by a simulated vehicle in a wind that was not forecast, replanned, delivered.

    It needs no vehicle and no network, and runs in virtual time. Other days and seeds give other deliveries.

    Examples
    --------
      skyway demo
      skyway demo --day 2013-05-20 --seed 3 --autopilot ardupilot -o out/other
      skyway demo --calibration-flight flight.tlog --payload 0.7
    """
    if calibration_flight is not None:
        _prove(calibration_flight, payload, force=force)
        return
    if payload is not None:
        remedy = "the demonstration carries 0.8 kg; skyway plan and skyway fly take any mass"
        raise InputError("goes with --calibration-flight only", field="--payload", value=payload, remedy=remedy)
    from skyway.demo import DemoOptions, plan_demo, run_demo, tell_end, with_day

    wanted = with_day(DemoOptions(folder=output, seed=seed, autopilot=autopilot, planner=planner), day)
    if plan_only:
        typer.echo(str(plan_demo(wanted)))
        return
    outcome = run_demo(wanted, typer.echo)
    for line in tell_end(wanted, outcome):
        typer.echo(line)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def serve(
    scenario: options.ScenarioArgument = None,
    host: Annotated[str, typer.Option(help="Address to listen at; any but loopback needs --token.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen at.")] = 8080,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="SKYWAY_TOKEN",
            help="Token that each browser must give once; safer in SKYWAY_TOKEN, which no list of processes shows.",
        ),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            help="Work folder: plans, missions, journals and logs are read and written there, and nowhere else."
        ),
    ] = Path(),
    show_demo: Annotated[
        bool,
        typer.Option(
            "--demo",
            help="Fly a simulated delivery, ten times faster than real time (sixty times on the ground), and show it.",
        ),
    ] = False,
    forecast: Annotated[list[Path] | None, typer.Option(help=FORECAST_HELP)] = None,
    forecast_error: Annotated[Path | None, typer.Option(help=ERROR_HELP)] = None,
    observed: Annotated[list[str] | None, typer.Option(help=OBSERVED_HELP)] = None,
    pads: Annotated[
        str | None,
        typer.Option(help="Present state of the pads: tcp:HOST:PORT of their service, or a file; see skyway plan."),
    ] = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    base: Annotated[
        Path | None, typer.Option("--map", help="Base map, FILE.mbtiles or FILE.pmtiles, drawn beneath the network.")
    ] = None,
    tiles: Annotated[
        str | None,
        typer.Option(
            help="Base map of a tile server: https://HOST/{z}/{x}/{y}.png, or .pbf for vectors. Browsers then contact that host; without it they contact none."
        ),
    ] = None,
    attribution: Annotated[
        str, typer.Option(help="Attribution shown on the base map. Default: that of its file, or its host.")
    ] = "",
    outline: Annotated[
        Path | None, typer.Option(help="GeoJSON with coast, water and streets, drawn beneath the network.")
    ] = None,
) -> None:
    """Serve the operator's page: plan, check, fly, replay and watch in a browser.

    Examples
    --------
      skyway serve
      skyway serve --demo --folder out/demo
      skyway serve my-scenario --port 8081 --outline coast.geojson --map city.pmtiles
      SKYWAY_TOKEN=$(openssl rand -hex 16) skyway serve --host 0.0.0.0
    """
    from skyway.web.server import ServeOptions
    from skyway.web.server import serve as run
    from skyway.web.tiles.base import BaseMap
    from skyway.web.work.weather_and_zones import Given

    known = Given(
        forecast=_absolute(forecast), forecast_error="" if forecast_error is None else str(forecast_error.resolve()),
        observed=tuple(str(Path(one).resolve()) if Path(one).exists() else one for one in observed or ()), pads=pads or "",
        terrain=_absolute(terrain), obstacles=_absolute(obstacles), zones=_absolute(zones), authorized=tuple(authorized or ()),
    )  # fmt: skip
    given = ServeOptions(
        scenario=scenario,
        host=host,
        port=port,
        token=token,
        folder=folder,
        outline=outline,
        demo=show_demo,
        base=BaseMap(base, tiles, attribution),
        given=known,
    )
    run(given, lambda words: typer.echo(words, err=True))


def _absolute(files: Sequence[str | Path] | None) -> tuple[str, ...]:
    """Paths as other processes find them."""
    return tuple(str(Path(one).resolve()) for one in files or ())


def _prove(path: Path, payload: float | None, *, force: bool) -> None:
    """Record a calibration flight of the drone of the demonstration."""
    from skyway.calibration_flight import record_square
    from skyway.demo import DRONE, PAYLOAD_KG

    if path.suffix.lower() != ".tlog":
        remedy = "a recording is a MAVLink log: name it FILE.tlog"
        raise InputError("has another ending than .tlog", field="--calibration-flight", value=str(path), remedy=remedy)
    options.refuse_overwriting(path, force=force)
    drone = load_scenario(None).drone(DRONE)
    carried = PAYLOAD_KG if payload is None else payload
    remedy = f"0 to {drone.max_payload_kg:g} kg, what the {drone.name} lifts"
    faults = range_faults("--payload", carried, 0.0, drone.max_payload_kg, remedy)
    refuse(faults)
    record_square(drone, carried, path, force=force)
    typer.echo(f"wrote {path}: a square flown twice with {carried:g} kg by a simulated {drone.name}")
