"""A delivery under supervision: connected, flown, shown, and ended with its journal and report."""

from __future__ import annotations

from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import typer

from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from datetime import datetime

    from skyway.cli.connection_options import Link
    from skyway.cli.views.flight import FlightView
    from skyway.flights.live import LiveFile
    from skyway.link.pads import TcpPads
    from skyway.link.supervisor import DeliveryJob, Operator, Outcome
    from skyway.link.supervisor.context import Context
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.base.clock import Clock
    from skyway.models.queues.pad_service import PadService
    from skyway.models.scenario.scenario import Scenario


def supervised(
    link: Link,
    job: Callable[[datetime, Vehicle], DeliveryJob],
    service: TcpPads | None,
    orders: Path | None,
    journal: Path | None,
    resume: Path | None,
    report: Path | None,
    region: Scenario | None,
    *,
    yes: bool,
    fetch_log: bool,
    as_json: bool,
) -> None:
    """Fly, show it, and exit by how it ended."""
    from skyway.cli.console import Console
    from skyway.cli.views.flight import view_for
    from skyway.flights.live import live_file, requests_at
    from skyway.link.supervisor.command.request_file import RequestFile

    zone = ZoneInfo("UTC" if region is None else region.timezone)
    view = view_for(as_json=as_json, zone=zone)
    console = Console(listens=not yes and orders is None, show=view.say, keys=view.lives)
    view.typed = lambda: console.typed
    operator = console if orders is None else RequestFile(requests_at(orders), view.say)
    with console.reading_keys(), view.shown(), live_file(orders) as live:
        outcome, path, logs = _flown(
            link, job, service, operator, view, live, resume or journal, report,
            resumes=resume is not None, fetch_log=fetch_log,
        )  # fmt: skip
    _end(outcome, path, report, logs, as_json=as_json)


def _flown(
    link: Link,
    job_at: Callable[[datetime, Vehicle], DeliveryJob],
    pads: TcpPads | None,
    operator: Operator,
    view: FlightView,
    live: LiveFile | None,
    path: Path | None,
    report: Path | None,
    *,
    resumes: bool,
    fetch_log: bool,
) -> tuple[Outcome, Path, list[Path]]:
    """Connect and fly; returns how it ended, where its journal is, and the logs that were fetched."""
    from skyway.cli.console import counting_interrupts
    from skyway.flights.after_flight import LogsHome, keep_vibration
    from skyway.flying import journal_name
    from skyway.link.supervisor import Journal, Supervisor
    from skyway.link.vehicle.health_book import VibrationWatch
    from skyway.models.base.units import from_posix
    from skyway.report.report import write_report

    def doing(what: str) -> None:
        view.doing(what)
        if live is not None:
            live.doing(what)

    def tick(context: Context) -> None:
        view.tick(context)
        if live is not None:
            live.tick(context)

    doing(f"connecting: {', '.join(link.addresses)}")
    with link.aboard() as vehicle:
        if vehicle.connection.forwarder is not None:
            vehicle.connection.forwarder.tell = None  # told and journaled by the supervisor
        doing("waiting for telemetry and the time of the vehicle")
        clock = _clock(vehicle, operator, path if resumes else None)
        now = from_posix(clock.posix_s())
        job = job_at(now, vehicle)
        if not (resumes or job.asking == "never" or operator.present):
            remedy = "run it at a terminal, or give --yes in a simulation"
            raise InputError("take-offs cannot be confirmed: standard input has ended", remedy=remedy)
        if job.drag is None:
            operator.tell(
                "no --drag: the wind is not measured on the way unless the autopilot reports it; until then a landing below the reserve may come "
                "with 1 %, and more flights turn back; skyway calibrate wind finds the drag"
            )
        if path is None:
            name = journal_name(job.composition.origin, job.composition.destination, now)
            book = Journal.beside_others(_journal_path(link.record, name), clock.posix_s)
        else:
            book = Journal(path, clock.posix_s, resume=resumes)
        book.listeners += [view.take] if live is None else [view.take, live.take]
        operator.tell(f"journal: {book.path}")
        try:
            with counting_interrupts(operator), _served(pads, job, operator, clock) as service:
                supervisor = Supervisor(job, vehicle, clock, service, operator, book, resume=resumes, on_tick=tick)
                logs = LogsHome(supervisor.context, link.record, operator.tell, resumed=resumes) if fetch_log else None
                shakes = VibrationWatch(vehicle)
                outcome = supervisor.run()
                keep_vibration(supervisor.context, shakes)
                if live is not None:
                    live.outcome(outcome)
            return outcome, book.path, [] if logs is None else logs.fetch()  # Ctrl-C ends the transfer alone
        finally:
            book.close()
            if report is not None and book.count:  # also of a flight that broke off
                write_report(book.path, report, scenario=job.scenario)


def _clock(vehicle: Vehicle, operator: Operator, resumed: Path | None) -> Clock:
    """Take the vehicle's clock: it may live at another time, and at another speed, also from some moment on only; that of a journal is continued."""
    from skyway.flying import FAR_S
    from skyway.link.supervisor.journal.file import read_journal
    from skyway.link.supervisor.journal.standing import last_standing
    from skyway.link.telemetry.vehicle_time import VehicleTime

    wall = vehicle.connection.clock
    vehicle.request_telemetry()
    for _ in vehicle.samples(4.0):
        pass
    if resumed is not None:
        records = read_journal(resumed).records
        before = last_standing(records)
        if before is not None and before.booted_s is not None:
            vehicle.live.clock.go_on(before.booted_s, records[-1].time_s)
            for _ in vehicle.samples(1.0):
                pass
    base, sample = vehicle.live.clock, vehicle.live.sample
    far = sample is not None and base.base.absolute and abs(sample.time_s - wall.posix_s()) >= FAR_S
    if far or base.simulated:
        operator.tell(
            "the clock of the vehicle differs from that of this computer (a simulation): the vehicle's time is used"
        )
    return VehicleTime(vehicle, wall)


def _journal_path(folder: Path, name: str) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise file_error("made", folder, error) from error
    return folder / name


@contextmanager
def _served(pads: TcpPads | None, job: DeliveryJob, operator: Operator, clock: Clock) -> Iterator[PadService]:
    """Serve the pads that were requested, and hang up at the end."""
    from skyway.link.pads import ManualPads

    if pads is not None:
        with closing(pads):
            yield pads
        return
    known = {station.id: station.pads for station in job.scenario.network.stations}
    yield ManualPads(operator.ask, known, clock.posix_s)


def _end(outcome: Outcome, journal: Path, report: Path | None, logs: list[Path], *, as_json: bool) -> None:
    """Say how it ended, and exit by it."""
    from skyway import flying

    if as_json:
        typer.echo(json_text(flying.summary(outcome, journal, report, logs)))
    else:
        typer.echo(outcome.reason if outcome.delivered or outcome.done else f"{outcome.state}: {outcome.reason}")
        if outcome.proof:
            typer.echo(f"package {outcome.proof}: {outcome.proof_reason}")
        typer.echo(f"journal: {journal}" + ("" if report is None else f"; report: {report}"))
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)
