"""Commands ``params get``, ``params set``, ``params diff``, ``params save`` and ``params restore``."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from skyway.cli import options
from skyway.cli.connection_options import Armed, Link, Yes, refuse_armed
from skyway.cli.option_groups import with_groups
from skyway.models.base.errors import CommandRefusedError, Fault, InputError, LinkError, refuse
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.departure.parameter_changes import ParameterChanges
    from skyway.link.vehicle.vehicle import Vehicle


class ParameterValues(msgspec.Struct, frozen=True, kw_only=True):
    """Values by name."""

    schema: str = "skyway.parameters/1"
    parameters: dict[str, float]


class ParameterSet(msgspec.Struct, frozen=True, kw_only=True):
    """A value that was set, or would be."""

    schema: str = "skyway.parameter/1"
    name: str
    was: float
    value: float
    set: bool


class ParameterDifference(msgspec.Struct, frozen=True, kw_only=True):
    """A value of a file that the vehicle has otherwise, or not at all."""

    name: str
    file: float
    vehicle: float | None


class ParametersDiff(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle compared with a file."""

    schema: str = "skyway.parameters-diff/1"
    ok: bool
    compared: int
    differences: list[ParameterDifference]


class ParameterRestored(msgspec.Struct, frozen=True, kw_only=True):
    """A value that a flight changed, and the result of restoring it."""

    name: str
    now: float
    before: float
    done: str


class ParametersRestore(msgspec.Struct, frozen=True, kw_only=True):
    """The restored parameters; `problem` if not all could be restored."""

    schema: str = "skyway.parameters-restore/1"
    ok: bool
    parameters: list[ParameterRestored]
    problem: str | None


_WOULD_BE_RESTORED = "would be restored"
params = typer.Typer(help="Read, set, compare and restore parameters.", no_args_is_help=True)


@params.command("get")
@with_groups
def params_get(
    link: Link,
    names: Annotated[list[str] | None, typer.Argument(help="Names of parameters. Default: all.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Print parameters as NAME,VALUE lines, which ground stations read.

    Examples
    --------
      skyway params get > all.param
      skyway params get RTL_ALT FS_OPTIONS --connect tcp:127.0.0.1:5760
    """
    with link.aboard() as vehicle:
        found = [vehicle.parameter(name) for name in names] if names else list(vehicle.parameters().values())
    if as_json:
        values = {value.name: value.value for value in found}
        typer.echo(json_text(ParameterValues(parameters=values)))
        return
    for value in found:
        typer.echo(f"{value.name},{value.value:.9g}")


@params.command("set", context_settings={"ignore_unknown_options": True})  # negative values
@with_groups
def params_set(
    link: Link,
    name: Annotated[str, typer.Argument(help="Name of the parameter.")],
    value: Annotated[float, typer.Argument(help="New value.")],
    yes: Yes = False,
    armed: Armed = False,
    as_json: options.AsJson = False,
) -> None:
    """Set a parameter and read it back.

    Examples
    --------
      skyway params set RTL_ALT 6000 --yes --connect tcp:127.0.0.1:5760
    """
    from skyway.link.protocol.parameter_file import IMPLAUSIBLE
    from skyway.link.protocol.parameters import is_whole, misfit

    with link.aboard() as vehicle:
        if yes:
            refuse_armed(vehicle, "set a parameter", allowed=armed)
        found = vehicle.parameter(name)
        before = found.value
        why = misfit(value, found.kind)
        if why:
            whole = is_whole(found.kind) and math.isfinite(value) and value != round(value)
            raise InputError(why, field=name, value=f"{value:.9g}", remedy=f"{value:.0f}" if whole else "")
        expected = vehicle.family.settings.range_left(name, value)
        if expected:
            raise InputError(IMPLAUSIBLE, field=name, value=f"{value:.9g}", remedy=expected)
        after = vehicle.set_parameter(name, value).value if yes else value
    if as_json:
        typer.echo(json_text(ParameterSet(name=name, was=before, value=after, set=yes)))
    else:
        typer.echo(f"{name}: {before:.9g} -> {after:.9g}{'' if yes else ' would be set; add --yes'}")


@params.command("diff")
@with_groups
def params_diff(
    link: Link,
    file: Annotated[Path, typer.Argument(help="Parameter file with NAME,VALUE lines.")],
    as_json: options.AsJson = False,
) -> None:
    """Compare the vehicle with a parameter file; exit code 1 where it differs.

    Examples
    --------
      skyway params diff delivery.param --connect tcp:127.0.0.1:5760
    """
    from skyway.cli.commands.aboard.parameter_sets import others_ignored
    from skyway.link.protocol.parameter_set import read_set
    from skyway.link.protocol.parameters import same_value

    saved = read_set(file)
    wanted = saved.values
    with link.aboard() as vehicle:
        actual = vehicle.parameters()
    rows = []
    for name, value in wanted.items():
        has = actual.get(name)
        if has is None or not same_value(value, has.value, has.kind):
            rows.append(ParameterDifference(name=name, file=value, vehicle=None if has is None else has.value))
    if as_json:
        typer.echo(json_text(ParametersDiff(ok=not rows, compared=len(wanted), differences=rows)))
    else:
        for row in rows:
            has_it = "has none" if row.vehicle is None else f"{row.vehicle:.9g}"
            typer.echo(f"{row.name}: file {row.file:.9g}, vehicle {has_it}")
        if saved.of_others:
            typer.echo(others_ignored(saved.of_others))
        typer.echo(f"{len(rows)} of {len(wanted)} differ" if rows else f"all {len(wanted)} are as the file says")
    if rows:
        raise typer.Exit(1)


@params.command("save")
@with_groups
def params_save(
    link: Link,
    file: Annotated[Path, typer.Argument(help="FILE.param (Mission Planner) or FILE.params (QGroundControl).")],
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Save all parameters of a vehicle as a set, which ground stations read, too.

    Examples
    --------
      skyway params save before.param --connect tcp:127.0.0.1:5760
    """
    from skyway.cli.commands.aboard.parameter_sets import save_set

    save_set(link, file, as_json=as_json, force=force)


@params.command("restore")
@with_groups
def params_restore(
    link: Link,
    file: Annotated[
        Path, typer.Argument(help="Set: FILE.param or FILE.params; or the journal of a flight: recordings/….jsonl.")
    ],
    yes: Yes = False,
    as_json: options.AsJson = False,
) -> None:
    """Restore a saved set, or the parameters that a flight changed and did not restore; each is read back.

    The command first shows the changes. At a terminal it asks once; elsewhere it changes nothing without --yes. With a
    journal, it does not restore a value that was changed since.

    Examples
    --------
      skyway params restore before.param --connect tcp:127.0.0.1:5760
      skyway params restore recordings/delivery.jsonl --yes --connect tcp:127.0.0.1:5760
    """
    from skyway.cli.commands.aboard.parameter_sets import SET_ENDINGS, restore_from_set

    if file.suffix.lower() in SET_ENDINGS:
        restore_from_set(link, file, yes=yes, as_json=as_json)
    else:
        _restore_from_journal(link, file, yes=yes, as_json=as_json)


def _restore_from_journal(link: Link, journal: Path, *, yes: bool, as_json: bool) -> None:
    """Restore what a flight changed: shown first, agreed to once, and nothing if one of the values cannot be set."""
    from datetime import UTC, datetime

    from skyway.cli.commands.aboard.parameter_sets import asked
    from skyway.link.supervisor import Journal, read_journal
    from skyway.link.supervisor.departure.parameter_changes import changes_of, restore_all
    from skyway.link.supervisor.journal.entries import ParameterNote

    records = read_journal(journal).records
    changes = changes_of(records)
    rows: list[ParameterRestored] = []
    problem = ""
    agreed = yes
    if changes.before:
        with link.aboard() as vehicle:
            rows = _planned(vehicle, changes, journal)
            if not as_json:
                _show(rows)
            agreed = yes or (_to_restore(rows) > 0 and asked(_to_restore(rows), as_json=as_json))
            if agreed and vehicle.armed:
                raise CommandRefusedError(
                    "restore parameters", "the vehicle is armed: failsafes are not changed in flight"
                )
            if agreed:
                book = Journal(journal, lambda: datetime.now(UTC).timestamp(), resume=True)
                rows = []

                def told(name: str, done: str, sentence: str, value: float) -> None:
                    entry = ParameterNote(name=name, done=done, value=value)
                    book.write(records[-1].state, entry, sentence, flight=records[-1].flight)
                    rows.append(ParameterRestored(name=name, now=value, before=changes.before[name], done=done))

                with closing(book):
                    problem = restore_all(vehicle, changes, told)
    if as_json:
        typer.echo(json_text(ParametersRestore(ok=not problem, parameters=rows, problem=problem or None)))
    else:
        if agreed:
            _show(rows)
        if not changes.before:
            typer.echo("nothing to restore: the journal lists no changed parameter")
        elif not agreed:
            typer.echo(f"nothing was changed{'; add --yes to restore' if _to_restore(rows) else ''}")
    if problem:
        raise LinkError(f"not all parameters were restored: {problem}")


def _to_restore(rows: Sequence[ParameterRestored]) -> int:
    return sum(row.done == _WOULD_BE_RESTORED for row in rows)


def _planned(vehicle: Vehicle, changes: ParameterChanges, journal: Path) -> list[ParameterRestored]:
    """What would be restored. An `InputError` refuses all if the vehicle cannot hold one of the values."""
    from skyway.link.protocol.parameters import misfit
    from skyway.link.supervisor.departure.parameter_changes import state_of

    done = {
        "as before": "is so again",
        "of somebody else": "would be left: it was changed since",
        "changed": _WOULD_BE_RESTORED,
    }
    rows, faults = [], []
    for name, before in changes.before.items():
        now = vehicle.parameter(name)
        state = state_of(now.value, before, changes.ours[name])
        why = misfit(before, now.kind)
        if why and state == "changed":
            faults.append(Fault(why, str(journal), field=name, value=f"{before:.9g}", remedy="nothing was restored"))
        rows.append(ParameterRestored(name=name, now=now.value, before=before, done=done[state]))
    refuse(faults)
    return rows


def _show(rows: Sequence[ParameterRestored]) -> None:
    for row in rows:
        typer.echo(f"{row.name}: {row.now:.9g} (before the flight: {row.before:.9g}) {row.done}")
