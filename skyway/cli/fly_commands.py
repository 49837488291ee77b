"""The command that flies: ``fly``."""

from __future__ import annotations

import json
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from models.errors import Fault, InputError
from skyway.cli import options
from skyway.cli.aboard import AsJson, Link, linked

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime

    from link.mavlink_vehicle import MavlinkVehicle
    from link.supervisor import Mandate, Outcome
    from models.clock import Clock
    from models.pad_service import PadService
    from skyway.cli.console import Console

FLY_HELP = """Fly a plan leg by leg, learn the wind on the way, and plan anew where that is better.

Before each leg a list is gone through, the mission is uploaded and read back, and a divert station is known for every
point of the way. Everything is written into a journal; a flight that was interrupted goes on with --resume. The take-off
is asked for once, with --manual each time. Ctrl-C lands and stays at the next station, twice leaves the vehicle alone.

\b
Examples:
  skyway fly plan.json --connect udpin:127.0.0.1:14540 --pads tcp:127.0.0.1:5790 --drag drag.toml
  skyway fly plan.json --connect /dev/ttyUSB0,57600 --pads manual --manual
  skyway fly plan.json --connect tcp:127.0.0.1:5760 --pads tcp:127.0.0.1:5790 --resume recordings/delivery.jsonl
"""

Plan = Annotated[Path, typer.Argument(help="Composition, as skyway plan -o writes it.")]
PadAddress = Annotated[str, typer.Option("--pads", help="Where the pads are: tcp:HOST:PORT, or manual: people charge.")]
Manual = Annotated[bool, typer.Option("--manual", help="Ask before each take-off.")]
Rehearsal = Annotated[bool, typer.Option("--yes", help="Ask nothing: for rehearsals.")]
JournalFile = Annotated[
    Path | None,
    typer.Option(
        "--journal", help="Write the journal here; without it into the folder of --record.", show_default=False
    ),
]
Resume = Annotated[
    Path | None, typer.Option("--resume", help="Go on with the delivery of this journal.", show_default=False)
]
Report = Annotated[
    Path | None, typer.Option("--report", help="Write a report at the end: FILE.html.", show_default=False)
]
Drag = Annotated[
    Path | None,
    typer.Option(
        "--drag", help="Drag of the drone, from skyway calibrate wind: its tilt tells the wind.", show_default=False
    ),
]
ScenarioFolder = Annotated[
    Path | None,
    typer.Option("--scenario", help="Scenario folder, where it is not the one the plan names.", show_default=False),
]
ForecastFile = Annotated[
    Path | None, typer.Option("--forecast", help="Forecast file instead of the scenario's.", show_default=False)
]
ConstantWind = Annotated[
    str | None, typer.Option("--wind", help="One wind at cruise height instead: 8@270.", show_default=False)
]
Planner = Annotated[str, typer.Option("--planner", help="Planner of replanning.")]
NoReplan = Annotated[bool, typer.Option("--no-replan", help="Fly the plan as it is, whatever comes.")]
Release = Annotated[Literal["gripper", "operator"], typer.Option("--release", help="Who lets the package go.")]
Elevation = Annotated[
    list[str] | None,
    typer.Option(
        "--elevation", help="STATION=METRES: ground height the plan does not know; repeatable.", show_default=False
    ),
]
Keep = Annotated[bool, typer.Option("--keep-parameters", help="Set no parameter; stop where one will not do.")]


@linked
def fly(
    plan: Plan,
    link: Link,
    pads: PadAddress = "manual",
    manual: Manual = False,
    yes: Rehearsal = False,
    journal: JournalFile = None,
    resume: Resume = None,
    report: Report = None,
    drag: Drag = None,
    scenario: ScenarioFolder = None,
    forecast: ForecastFile = None,
    wind: ConstantWind = None,
    planner: Planner = "",
    no_replan: NoReplan = False,
    release: Release = "gripper",
    elevation: Elevation = None,
    keep_parameters: Keep = False,
    as_json: AsJson = False,
) -> None:
    """Fly a plan (the help text is `FLY_HELP`)."""
    from link.supervisor import Journal, Mandate, Supervisor
    from missions.mission_options import MissionOptions
    from models.composition_file import load
    from models.units import from_posix
    from planner.replan import DEFAULT_PLANNER, ReplanSettings
    from skyway import flying
    from skyway.cli.console import Console
    from skyway.cli.flight_view import view_for
    from skyway.flight_report import write_report

    if manual and yes:
        raise InputError(Fault("--manual and --yes exclude each other", remedy="give one of them"))
    if resume is not None and journal is not None:
        raise InputError(Fault("--journal and --resume exclude each other", remedy="a resumed journal goes on"))
    options.refuse_overwriting(journal, report, force=False)
    begun = None if resume is None else _begun(resume)
    composition = load(plan)
    region = flying.scenario_of(composition, scenario)
    request = flying.request_of(composition, region)
    view, take, say = view_for(as_json=as_json)
    console = Console(listens=not yes, show=say)
    drag_model = flying.read_drag_file(drag)
    heights = flying.heights(region, elevation)
    with link.aboard() as vehicle:
        clock = _clock(vehicle, console)
        now = from_posix(clock.posix_s())
        mandate = Mandate(
            composition=composition,
            scenario=region,
            request=request,
            forecast=options.wind_forecast(region, begun or now, wind, forecast, None, None),
            options=MissionOptions(release=release, elevation_m=heights),
            drag=drag_model,
            planner=planner or DEFAULT_PLANNER,
            replanning=None if no_replan else ReplanSettings(),
            asking="never" if yes else "each" if manual else "once",
            set_parameters=not keep_parameters,
            manual_pads=pads == "manual",
        )
        if drag_model is None:
            console.tell("no --drag: the wind is taken as forecast, unless the autopilot itself tells it")
        path = resume or journal or _journal_path(link.record, flying.journal_name(composition, now))
        book = Journal(path, clock.posix_s, resume=resume is not None)
        book.listeners.append(take)
        console.tell(f"journal: {path}")
        try:
            with console.counting_interrupts(), view.shown(), _pads(pads, mandate, console, clock) as service:
                outcome = Supervisor(mandate, vehicle, clock, service, console, book, resume=resume is not None).run()
        finally:
            book.close()
            if report is not None and book.count:  # also of a flight that broke off
                write_report(path, report, scenario=region)
    _end(outcome, path, report, as_json=as_json)


def _clock(vehicle: MavlinkVehicle, console: Console) -> Clock:
    """Take the vehicle's clock: it may live at another time, and at another speed, also from some moment on only."""
    from link.vehicle_time import VehicleTime
    from skyway.flying import FAR_S

    wall = vehicle.connection.clock
    vehicle.request_telemetry()
    for _ in vehicle.samples(4.0):
        pass
    base, sample = vehicle.live.clock, vehicle.live.sample
    far = sample is not None and base.base.absolute and abs(sample.time_s - wall.posix_s()) >= FAR_S
    if far or base.simulated:
        console.tell("the vehicle lives at another time than this computer (a simulation): its time is taken")
    return VehicleTime(vehicle, wall)


def _begun(journal: Path) -> datetime:
    from link.supervisor import read_journal
    from models.units import parse_instant

    return parse_instant(read_journal(journal).records[0].time)


def _journal_path(folder: Path, name: str) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(Fault(f"cannot be made: {error.strerror or error}", str(folder))) from None
    return folder / name


@contextmanager
def _pads(text: str, mandate: Mandate, console: Console, clock: Clock) -> Iterator[PadService]:
    """Serve the pads that were asked for, and hang up at the end."""
    from link.pads import ManualPads, TcpPads

    if text != "manual":
        with closing(TcpPads(text)) as service:
            yield service
        return
    known = {station.id: station.pads for station in mandate.scenario.network.stations}
    yield ManualPads(console.ask, known, clock.posix_s)


def _end(outcome: Outcome, journal: Path, report: Path | None, *, as_json: bool) -> None:
    """Say how it ended, and exit by it."""
    if as_json:
        ended = {
            "schema": "skyway.fly/1", "delivered": outcome.delivered, "state": outcome.state, "reason": outcome.reason,
            "station": outcome.station, "flights": outcome.flights, "journal": str(journal),
            "report": None if report is None else str(report),
        }  # fmt: skip
        typer.echo(json.dumps(ended))
    else:
        typer.echo(outcome.reason if outcome.delivered else f"{outcome.state}: {outcome.reason}")
        typer.echo(f"journal: {journal}" + ("" if report is None else f"; report: {report}"))
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("fly", help=FLY_HELP)(fly)
