"""Commands ``upload``, ``download``, ``clear``, ``verify`` and ``watch``."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import options
from skyway.cli.connection_options import Armed, Line, Link, Yes, refuse_armed
from skyway.cli.option_groups import with_groups
from skyway.models.base.errors import (
    CommandRefusedError,
    Fault,
    InputError,
    LinkError,
    ListUnsupportedError,
    VehicleTimeoutError,
    refuse,
)
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.cli.views.link import ParameterState
    from skyway.link.protocol.parameters import ParameterCheck
    from skyway.link.protocol.verified import Part, UploadOutcome
    from skyway.link.vehicle.vehicle import Identity, Vehicle
    from skyway.missions.autopilots.family import Family
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.parameters import Parameter


class Kind(StrEnum):
    """Kinds of lists on a vehicle."""

    MISSION = "mission"
    FENCE = "fence"
    RALLY = "rally"
    ALL = "all"


MissionFile = Annotated[Path, typer.Argument(help="Mission file: .plan or .waypoints.")]


def _parts(document: MissionDocument) -> list[Part]:
    """What a file holds, fence and rally points first: they must be there before the mission is flown."""
    found: list[Part] = [document.fence] if document.fence else []
    if len(document.rally):
        found.append(document.rally)
    if len(document.mission):
        found.append(document.mission)
    return found


def _read_parts(file: Path) -> tuple[MissionDocument, list[Part]]:
    from skyway.missions import read

    document = read(file)
    parts = _parts(document)
    if not parts:
        remedy = "use skyway clear to clear a vehicle"
        raise InputError("has no mission, fence or rally points", str(file), remedy=remedy)
    return document, parts


def _besides(vehicle: Vehicle, parts: Sequence[Part]) -> list[str]:
    """Say what the vehicle holds, or may hold, besides the contents of a file: a fence is in force during its mission, too."""
    from skyway.cli.views.link import count_of
    from skyway.link.protocol.mission_words import MissionKind
    from skyway.link.protocol.verified import kind_of

    sent = {kind_of(part) for part in parts}
    said = []
    for kind, noun in ((MissionKind.FENCE, "area"), (MissionKind.RALLY, "point")):
        if kind in sent:
            continue
        try:
            count = count_of(vehicle.download(kind))
        except CommandRefusedError:
            continue  # it has no such lists
        except LinkError as error:
            said.append(f"{kind.word}: not in the file, and what the vehicle holds is unknown: {error}")
            continue
        if count:
            remedy = f"to remove: skyway clear --kind {kind.name.lower()}"
            said.append(
                f"{kind.word}: not in the file, but the vehicle holds and uses {counted(count, noun)}; {remedy}"
            )
    return said


@with_groups
def upload(
    link: Link,
    file: MissionFile,
    parameters: Annotated[
        Path | None, typer.Option(help="Parameter file for the mission, as written by skyway mission.")
    ] = None,
    yes: Yes = False,
    armed: Armed = False,
    with_errors: Annotated[
        bool, typer.Option("--with-errors", help="Upload it although the check of the mission finds errors.")
    ] = False,
    as_json: options.AsJson = False,
) -> None:
    """Check a mission with its fence and rally points, upload it, read it back, and compare.

    A mission with errors (as of skyway check, for the vehicle's autopilot) is refused.
    Without --yes nothing is sent; the mission is shown with its differences from the vehicle's.

    Examples
    --------
      skyway upload delivery.plan --connect udpin:127.0.0.1:14540
      skyway upload delivery.plan --connect /dev/ttyUSB0,57600 --yes
      skyway upload delivery.waypoints --connect tcp:127.0.0.1:5760 --system 2 --parameters delivery.param --yes
    """
    from skyway.cli.views.link import PartSent, UploadReport, VehicleIdentity, show_findings, show_outcome
    from skyway.link.protocol.parameter_file import read_required
    from skyway.missions import check

    document, parts = _read_parts(file)
    wanted = () if parameters is None else read_required(parameters)
    with link.aboard() as vehicle:
        identity = vehicle.identify()
        if not as_json:
            typer.echo(str(identity))
        _refuse_missing_fence(file, document, parameters, wanted, vehicle.family)
        findings = check(document, dialect=vehicle.family).findings
        if not with_errors:
            _refuse_errors(file, findings)
        if not as_json:
            show_findings(findings)
        if yes:
            refuse_armed(vehicle, "upload a mission", allowed=armed)
            vehicle.check_ground_station()
            vehicle.check_uploads(parts)
        checks = _check_parameters(vehicle, wanted, parameters, yes=yes, as_json=as_json)
        if not yes:
            _show_dry_run(vehicle, identity, parts, checks, findings, as_json=as_json)
            return
        outcomes = _send(vehicle, parts)
        besides = _besides(vehicle, parts) if all(outcome.verified for outcome in outcomes) else []
    report = UploadReport(
        ok=all(outcome.verified for outcome in outcomes), sent=True, vehicle=VehicleIdentity.of(identity),
        findings=findings, parameters=checks, parts=[PartSent.of(outcome) for outcome in outcomes],
        besides=besides,
    )  # fmt: skip
    if as_json:
        typer.echo(json_text(report))
    else:
        for outcome in outcomes:
            show_outcome(outcome)
        for line in besides:
            typer.echo(line)
    if not report.ok:
        raise typer.Exit(3)


def _refuse_errors(file: Path, findings: Sequence[Finding]) -> None:
    """Refuse a mission with errors, and name the option that sends it all the same."""
    found = [finding for finding in findings if finding.severity == "error"]
    faults = [
        Fault(f.message, str(file), field="mission" if f.item is None else f"item {f.item}", remedy=f.remedy)
        for f in found
    ]
    if faults:
        remedy = "correct the mission, or upload it all the same with --with-errors"
        refuse([*faults, Fault("nothing was sent", str(file), remedy=remedy)])


def _refuse_missing_fence(
    file: Path, document: MissionDocument, parameters: Path | None, wanted: Sequence[Parameter], family: Family
) -> None:
    """Refuse parameters that were made for a mission with a fence where the mission file has none."""
    values = {one.key: one.value for one in wanted if one.value is not None}
    if document.fence or parameters is None or not family.relies_on_fence(values):
        return
    remedy = (
        "upload it with its fence (beside a .waypoints file the file .fence.waypoints), or remove the fence's lines"
    )
    problem = f"is for a mission with a fence, and {file} has none; nothing was sent"
    raise InputError(problem, str(parameters), remedy=remedy)


def _check_parameters(
    vehicle: Vehicle, wanted: Sequence[Parameter], file: Path | None, *, yes: bool, as_json: bool
) -> list[ParameterState]:
    """Read the parameters that a mission needs; with consent set those that will not do, and read them back.

    An `InputError` refuses values of parameters that the vehicle does not have, or cannot hold, before any is set.
    """
    from skyway.cli.views.link import ParameterState
    from skyway.link.protocol.parameters import misfit

    rows: list[ParameterState] = []
    checks = vehicle.check_required(wanted)
    remedy = "correct the name, or remove its line"
    refuse(
        [Fault(c.problem, str(file), remedy=remedy) for c in checks if c.actual is None and c.wanted.value is not None]
    )
    values = {check.wanted.name: check.to_set for check in checks if check.to_set is not None}
    problems = {name: misfit(value, vehicle.parameter(name).kind) for name, value in values.items()}
    refuse([Fault(why, str(file), field=name, value=f"{values[name]:.9g}") for name, why in problems.items() if why])
    for check in checks:
        try:
            state, value = _parameter_state(vehicle, check, yes=yes)
        except LinkError:
            done = [f"{row.name} (it was {row.was:g})" for row in rows if row.was is not None and row.was != row.now]
            if done:
                typer.echo(f"no mission was sent; set before, and left so: {', '.join(done)}", err=True)
            raise
        rows.append(ParameterState(name=check.wanted.name, was=check.actual, now=value, state=state))
        if not as_json:
            was = "unknown" if check.actual is None else f"{check.actual:g}"
            typer.echo(f"parameter {check.wanted.name} is {was}: {state}")
    return rows


def _parameter_state(vehicle: Vehicle, check: ParameterCheck, *, yes: bool) -> tuple[str, float | None]:
    if check.ok:
        return "ok", check.actual
    why = f": {check.wanted.why}" if check.wanted.why else ""
    if check.to_set is None:
        lacks = "the vehicle does not have it; " if check.actual is None else ""
        return f"{lacks}must be checked by a person{why}", check.actual
    if not yes:
        return f"would be set to {check.to_set:g}{why}", check.actual
    value = vehicle.set_parameter(check.wanted.name, check.to_set).value
    return f"set to {value:g}", value


def _show_dry_run(
    vehicle: Vehicle,
    identity: Identity,
    parts: list[Part],
    checks: list[ParameterState],
    findings: tuple[Finding, ...],
    *,
    as_json: bool,
) -> None:
    from skyway.cli.views.link import PartDifference, PartPlanned, UploadReport, VehicleIdentity, show_plan
    from skyway.link.protocol.verified import kind_of

    rows = []
    for part in parts:
        kind, differences = kind_of(part).name.lower(), vehicle.verify(part)
        rows.append(PartPlanned(kind=kind, differences=[PartDifference.of(kind, one) for one in differences]))
        if not as_json:
            show_plan(part, differences)
    besides = _besides(vehicle, parts)
    if as_json:
        who = VehicleIdentity.of(identity)
        report = UploadReport(
            ok=True, sent=False, vehicle=who, findings=findings, parameters=checks, parts=rows, besides=besides
        )
        typer.echo(json_text(report))
    else:
        for line in besides:
            typer.echo(line)
        typer.echo("nothing was sent; add --yes to upload")


def _send(vehicle: Vehicle, parts: list[Part]) -> list[UploadOutcome]:
    """Upload part by part, up to the first that is not verified."""
    from skyway.cli.views.link import progress

    outcomes: list[UploadOutcome] = []
    try:
        for part in parts:
            outcomes.append(vehicle.upload(part, progress=progress()))
            if not outcomes[-1].verified:
                break
    except KeyboardInterrupt:
        if vehicle.blocked is not None:
            typer.echo(f"\n{vehicle.blocked}; upload again before it is started", err=True)
        raise
    return outcomes


@with_groups
def download(
    link: Link,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write: .plan or .waypoints.")],
    kind: Annotated[Kind, typer.Option(help="What to read.")] = Kind.ALL,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Read mission, fence and rally points of a vehicle into a file, or one of them.

    Examples
    --------
      skyway download -o vehicle.plan --connect udpin:127.0.0.1:14540
      skyway download --kind fence -o site.fence.waypoints --connect tcp:127.0.0.1:5760
    """
    from skyway.cli.views.link import DownloadReport
    from skyway.link.protocol.mission_words import MissionKind
    from skyway.missions import write
    from skyway.missions.files.mission_file import files_of
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.geofence import Geofence
    from skyway.missions.items.mission import Mission
    from skyway.missions.items.rally import RallyPoints

    options.refuse_overwriting(output, force=force)
    options.refuse_overwriting(*files_of(MissionDocument(), output), force=force)
    kinds = list(MissionKind) if kind is Kind.ALL else [MissionKind[kind.name]]
    parts: list[Part] = []
    not_read = []
    with link.aboard() as vehicle:
        for each in kinds:
            try:
                parts.append(vehicle.download(each))
            except CommandRefusedError as error:  # it has no such lists
                if kind is not Kind.ALL or each is MissionKind.MISSION:
                    raise
                not_read.append(each.name.lower())
                typer.echo(f"{each.word}: not read: {error}", err=True)
    mission = next((part for part in parts if isinstance(part, Mission)), Mission())
    fence = next((part for part in parts if isinstance(part, Geofence)), Geofence())
    rally = next((part for part in parts if isinstance(part, RallyPoints)), RallyPoints())
    written = write(MissionDocument(mission, fence, rally), output, force=force)
    report = DownloadReport(
        files=[str(path) for path in written],
        items=len(mission),
        fence_areas=len(fence.areas),
        rally_points=len(rally),
        not_read=not_read,
    )
    if as_json:
        typer.echo(json_text(report))
        return
    counts = {
        MissionKind.MISSION: counted(report.items, "item"),
        MissionKind.FENCE: counted(report.fence_areas, "fence area"),
        MissionKind.RALLY: counted(report.rally_points, "rally point"),
    }
    typer.echo(", ".join(counts[each] for each in kinds))
    for path in written:
        typer.echo(f"wrote {path}")


@with_groups
def clear(
    link: Link,
    kind: Annotated[Kind, typer.Option(help="What to clear.")] = Kind.MISSION,
    yes: Yes = False,
    armed: Armed = False,
    as_json: options.AsJson = False,
) -> None:
    """Clear the mission of a vehicle, and verify that it is gone.

    Examples
    --------
      skyway clear --kind all --yes --connect udpin:127.0.0.1:14540
    """
    from skyway.cli.views.link import ClearReport, VehicleIdentity, count_of, size_of
    from skyway.link.protocol.mission_words import MissionKind

    kinds = list(MissionKind) if kind is Kind.ALL else [MissionKind[kind.name]]
    held = {}
    with link.aboard() as vehicle:
        identity = vehicle.identify()
        if not as_json:
            typer.echo(str(identity))
        if yes:
            refuse_armed(vehicle, "clear it", allowed=armed)
        for each in kinds:
            try:
                part = vehicle.download(each)
            except ListUnsupportedError as error:
                if kind is not Kind.ALL:
                    raise
                typer.echo(f"{each.word}: none: {error}", err=True)
                continue
            held[each.name.lower()] = count_of(part)
            if yes:
                vehicle.clear(each)
            if not as_json:
                typer.echo(f"{each.word}: {size_of(part)}, {'cleared' if yes else 'would be cleared; add --yes'}")
    if as_json:
        typer.echo(json_text(ClearReport(cleared=yes, vehicle=VehicleIdentity.of(identity), held=held)))


@with_groups
def verify(link: Link, file: MissionFile, as_json: options.AsJson = False) -> None:
    """Compare the mission of a vehicle with a file; exit code 1 if they differ in meaning.

    Examples
    --------
      skyway verify delivery.plan --connect udpin:127.0.0.1:14540
    """
    from skyway.cli.views.link import PartDifference, VerifyReport, on_board
    from skyway.link.protocol.verified import kind_of

    _, parts = _read_parts(file)
    with link.aboard() as vehicle:
        found = [(kind_of(part), difference) for part in parts for difference in vehicle.verify(part)]
        besides = _besides(vehicle, parts)
    if as_json:
        rows = [PartDifference.of(kind.name.lower(), difference) for kind, difference in found]
        typer.echo(json_text(VerifyReport(ok=not found, differences=rows, besides=besides)))
    else:
        for kind, difference in found:
            typer.echo(f"{kind.word}: {on_board(difference)}")
        for line in besides:
            typer.echo(line)
        typer.echo("the vehicle holds the mission of the file" if not found else f"{len(found)} differences")
    if found:
        raise typer.Exit(1)


@with_groups
def watch(
    link: Line,
    lasting: Annotated[
        float | None, typer.Option("--duration", help="End after this time, s. Default: at Ctrl-C.")
    ] = None,
    every: Annotated[
        float, typer.Option(help="With line output: report changes this often, s, 0.05 to 1; everything each second.")
    ] = 1.0,
    as_json: options.AsJson = False,
) -> None:
    """Watch all vehicles on a connection: position, charge, wind, mode, link. Ctrl-C ends it.

    Where the output is not a terminal, one line per second and vehicle is printed.

    Examples
    --------
      skyway watch --connect udpin:127.0.0.1:14540
      skyway watch --connect tcp:127.0.0.1:5760 --duration 10 --json
    """
    from skyway.cli.views.watch import Watched, show

    if lasting is not None and not 0.0 < lasting < math.inf:
        raise InputError("out of range", field="--duration", value=lasting, remedy="seconds, above 0")
    if not 0.05 <= every <= 1.0:
        raise InputError("out of range", field="--every", value=every, remedy="0.05 to 1 seconds")
    with link.opened() as connection:
        watched = Watched(connection)
        begun_s = connection.clock.now_s()
        try:
            show(watched, math.inf if lasting is None else begun_s + lasting, as_json=as_json, every_s=every)
        except KeyboardInterrupt:
            typer.echo("", err=True)
        if not watched.vehicles:
            raise VehicleTimeoutError("no heartbeat", connection.clock.now_s() - begun_s)
