"""Commands that speak with vehicles: ``upload``, ``download``, ``clear``, ``verify``, ``watch`` and ``params``."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from link.mavlink_vehicle import MavlinkVehicle
    from link.verified import Part, UploadOutcome
    from missions.document import MissionDocument
    from missions.parameters import Parameter


class Autopilot(StrEnum):
    """Whose way with missions."""

    AUTO = "auto"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class Kind(StrEnum):
    """What a vehicle holds."""

    MISSION = "mission"
    FENCE = "fence"
    RALLY = "rally"
    ALL = "all"


Connect = Annotated[
    str, typer.Option("--connect", help="udpin:, udpout:, tcp: or tcpin:HOST:PORT, or DEVICE,BAUD.", show_default=True)
]
System = Annotated[int | None, typer.Option("--system", help="System id of the vehicle.", show_default=False)]
Pilot = Annotated[Autopilot, typer.Option("--autopilot", help="Whose way with missions; auto asks the vehicle.")]
Ground = Annotated[int, typer.Option("--gcs-system", help="Our own system id.")]
KeyFile = Annotated[
    Path | None,
    typer.Option("--key-file", help="Signing key; or SKYWAY_SIGNING_KEY in the environment.", show_default=False),
]
Record = Annotated[Path, typer.Option("--record", help="Folder of the recordings (.tlog).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Yes = Annotated[bool, typer.Option("--yes", help="Do it without asking.")]
KindOption = Annotated[Kind, typer.Option("--kind", help="What.")]
DEFAULT_CONNECT = "udpin:127.0.0.1:14540"
RECORDINGS = Path("recordings")


@contextmanager
def aboard(
    connect: str, system: int | None, autopilot: Autopilot, ground: int, key_file: Path | None, record: Path
) -> Iterator[MavlinkVehicle]:
    """Open the connection and find the vehicle; everything is recorded."""
    from link.mavlink_vehicle import MavlinkVehicle
    from link.opening import open_connection, read_key

    connection = open_connection(connect, record=record, system=ground, key=read_key(key_file))
    try:
        yield MavlinkVehicle(connection, system, None if autopilot is Autopilot.AUTO else autopilot.value)
    finally:
        connection.close()


def _parts(document: MissionDocument) -> list[Part]:
    """What a file holds, fence and rally points first: they must be there before the mission is flown."""
    found: list[Part] = []
    if document.fence.areas or document.fence.return_point is not None:
        found.append(document.fence)
    if len(document.rally):
        found.append(document.rally)
    if len(document.mission):
        found.append(document.mission)
    return found


def upload(
    file: Annotated[Path, typer.Argument(help="Mission: .plan or .waypoints.")],
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    autopilot: Pilot = Autopilot.AUTO,
    parameters: Annotated[
        Path | None,
        typer.Option("--parameters", help="Parameters it needs, as skyway mission writes them.", show_default=False),
    ] = None,
    yes: Yes = False,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
    as_json: AsJson = False,
) -> None:
    """Upload a mission with its fence and rally points, and read it back: done means that it was compared.

    Without --yes nothing is sent: what would be is shown, beside what the vehicle holds.

    \b
    Examples:
      skyway upload delivery.plan --connect udpin:127.0.0.1:14540
      skyway upload delivery.plan --connect /dev/ttyUSB0,57600 --yes
      skyway upload delivery.waypoints --connect tcp:127.0.0.1:5760 --system 2 --parameters delivery.param --yes
    """  # noqa: D301  \b keeps the lines of the examples
    from link.parameter_file import read_required
    from missions import read
    from models.errors import Fault, InputError

    parts = _parts(read(file))
    if not parts:
        raise InputError(Fault("holds nothing to upload", str(file), remedy="use skyway clear to clear a vehicle"))
    wanted = () if parameters is None else read_required(parameters)
    with aboard(connect, system, autopilot, ground, key_file, record) as vehicle:
        _refuse_what_cannot_be_flown(read(file), vehicle.family.name)
        _tell(str(vehicle.identify()), as_json=as_json)
        _check_parameters(vehicle, wanted, yes=yes, as_json=as_json)
        if not yes:
            for part in parts:
                _show_plan(part, vehicle, as_json=as_json)
            _tell("nothing was sent; add --yes to upload", as_json=as_json)
            return
        vehicle.check_ground_station()
        outcomes = []
        for part in parts:
            outcomes.append(vehicle.upload(part, progress=_progress()))
            if not outcomes[-1].verified:
                break
    _end(outcomes, as_json=as_json)


def _refuse_what_cannot_be_flown(document: MissionDocument, family: str) -> None:
    from missions import dialect
    from models.errors import Fault, InputError

    found = [finding for finding in dialect(family).cannot_fly(document) if finding.severity == "error"]
    faults = [Fault(f.message, field=None if f.item is None else f"item {f.item}", remedy=f.remedy) for f in found]
    if faults:
        raise InputError(faults)


def _check_parameters(vehicle: MavlinkVehicle, wanted: Sequence[Parameter], *, yes: bool, as_json: bool) -> None:
    """Show the parameters that a mission needs; with consent set those that will not do, and read them back."""
    for check in vehicle.check_required(wanted):
        name, has = check.wanted.name, "unknown" if check.actual is None else f"{check.actual:g}"
        if check.ok:
            state = "ok"
        elif check.to_set is None:
            state = f"must be checked by hand: {check.wanted.why}"
        elif yes:
            state = f"set to {vehicle.set_parameter(name, check.to_set).value:g}"
        else:
            state = f"would be set to {check.to_set:g}: {check.wanted.why}"
        _tell(f"parameter {name} is {has}: {state}", as_json=as_json)


def _show_plan(part: Part, vehicle: MavlinkVehicle, *, as_json: bool) -> None:
    from link.verified import encode, kind_of

    kind = kind_of(part)
    differences = vehicle.verify(part)
    items = len(encode(part, vehicle.family.name))
    same = "the vehicle holds the same" if not differences else f"{len(differences)} differences from what it holds"
    _tell(f"{kind.word}: {items} items to send; {same}", as_json=as_json)
    for difference in differences[:10]:
        _tell(f"  item {difference.item} {difference.field}: {difference.read} -> {difference.sent}", as_json=as_json)


def _progress() -> Callable[[str, int, int], None] | None:
    """A line that is written over, where the output is a terminal."""
    if not sys.stderr.isatty():
        return None

    def told(what: str, done: int, total: int) -> None:
        end = "\n" if done == total else ""
        sys.stderr.write(f"\r{what} {done}/{total}   {end}")
        sys.stderr.flush()

    return told


def _end(outcomes: list[UploadOutcome], *, as_json: bool) -> None:
    """Say how it ended; 3 unless all is verified."""
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "schema": "skyway.upload/1",
                    "ok": all(o.verified for o in outcomes),
                    "parts": [
                        {
                            "kind": o.kind.name.lower(),
                            "state": o.state.value,
                            "holds": o.holds,
                            "reason": o.reason or None,
                            "items": list(o.items),
                            "differences": [str(d) for d in o.differences],
                        }
                        for o in outcomes
                    ],
                }
            )
        )
    else:
        for outcome in outcomes:
            typer.echo(str(outcome))
            for difference in outcome.differences[:10]:
                typer.echo(f"  {difference}")
    if not all(outcome.verified for outcome in outcomes):
        raise typer.Exit(3)


def _tell(text: str, *, as_json: bool) -> None:
    typer.echo(text, err=as_json)


def download(
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write: .plan or .waypoints.")],
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    autopilot: Pilot = Autopilot.AUTO,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files.")] = False,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
) -> None:
    """Read mission, fence and rally points of a vehicle into a file.

    \b
    Examples:
      skyway download -o aboard.plan --connect udpin:127.0.0.1:14540
    """  # noqa: D301
    from link.mission_words import MissionKind
    from missions import write
    from missions.document import MissionDocument
    from missions.geofence import Geofence
    from missions.mission import Mission
    from missions.rally import RallyPoints
    from skyway.cli import options

    options.refuse_overwriting(output, force=force)
    with aboard(connect, system, autopilot, ground, key_file, record) as vehicle:
        mission, fence, rally = (vehicle.download(kind) for kind in MissionKind)
    if not (isinstance(mission, Mission) and isinstance(fence, Geofence) and isinstance(rally, RallyPoints)):
        raise TypeError("a download of another kind than asked for")
    written = write(MissionDocument(mission, fence, rally), output, force=force)
    typer.echo(f"{len(mission)} items, {len(fence.areas)} fence areas, {len(rally)} rally points")
    for path in written:
        typer.echo(f"wrote {path}")


def clear(
    kind: KindOption = Kind.MISSION,
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    yes: Yes = False,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
) -> None:
    """Clear what a vehicle holds, and read back that it is gone.

    \b
    Examples:
      skyway clear --kind all --yes --connect udpin:127.0.0.1:14540
    """  # noqa: D301
    from link.mission_words import MissionKind

    kinds = list(MissionKind) if kind is Kind.ALL else [MissionKind[kind.name]]
    with aboard(connect, system, Autopilot.AUTO, ground, key_file, record) as vehicle:
        typer.echo(str(vehicle.identify()))
        for each in kinds:
            if yes:
                vehicle.clear(each)
            typer.echo(f"{each.word}: {'cleared' if yes else 'would be cleared; add --yes'}")


def verify(
    file: Annotated[Path, typer.Argument(help="Mission: .plan or .waypoints.")],
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    autopilot: Pilot = Autopilot.AUTO,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
    as_json: AsJson = False,
) -> None:
    """Compare what a vehicle holds with a file; exit code 1 where it differs in meaning.

    \b
    Examples:
      skyway verify delivery.plan --connect udpin:127.0.0.1:14540
    """  # noqa: D301
    from link.verified import kind_of
    from missions import read

    parts = _parts(read(file))
    found = []
    with aboard(connect, system, autopilot, ground, key_file, record) as vehicle:
        for part in parts:
            found += [(kind_of(part).name.lower(), difference) for difference in vehicle.verify(part)]
    if as_json:
        rows = [{"kind": kind, "item": d.item, "field": d.field, "text": str(d)} for kind, d in found]
        typer.echo(json.dumps({"schema": "skyway.verify/1", "ok": not found, "differences": rows}))
    else:
        for kind, difference in found:
            typer.echo(f"{kind} {difference}")
        typer.echo("the vehicle holds what the file says" if not found else f"{len(found)} differences")
    if found:
        raise typer.Exit(1)


def watch(
    connect: Connect = DEFAULT_CONNECT,
    lasting: Annotated[float | None, typer.Option("--for", help="End after so many seconds.")] = None,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
    as_json: AsJson = False,
) -> None:
    """Watch all vehicles on a connection: position, charge, wind, mode, link. Ctrl-C ends it.

    \b
    Examples:
      skyway watch --connect udpin:127.0.0.1:14540
      skyway watch --connect tcp:127.0.0.1:5760 --for 10 --json
    """  # noqa: D301
    from link.opening import open_connection, read_key
    from skyway.cli.watching import watch_all

    connection = open_connection(connect, record=record, system=ground, key=read_key(key_file))
    try:
        watch_all(connection, lasting, as_json=as_json)
    finally:
        connection.close()


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    for command in (upload, download, clear, verify, watch):
        app.command(command.__name__)(command)
    from skyway.cli.parameter_commands import params

    app.add_typer(params, name="params")
