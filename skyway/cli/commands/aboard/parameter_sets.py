"""Saving and restoring sets of parameters: shows the changes first and asks once."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import msgspec
import typer

from skyway.models.base.errors import CommandRefusedError, LinkError
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.cli.connection_options import Link
    from skyway.link.protocol.parameter_set import SavedSet, SetChange, SetDifference

SET_ENDINGS = (".param", ".parm", ".params")
"""Endings of the files of sets; others are journals."""


class SetSaved(msgspec.Struct, frozen=True, kw_only=True):
    """A set that was saved."""

    schema: str = "skyway.parameters-saved/1"
    file: str
    parameters: int


class SetValue(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter that a set changes, and the result."""

    name: str
    now: float
    then: float
    file_name: str
    done: str


class SetRestored(msgspec.Struct, frozen=True, kw_only=True):
    """Changes of a set; `problem` if not all could be set."""

    schema: str = "skyway.parameter-set-restore/1"
    ok: bool
    parameters: list[SetValue]
    same: int
    renamed: dict[str, str]
    absent: list[str]
    left: dict[str, str]
    problem: str | None


def save_set(link: Link, file: Path, *, as_json: bool, force: bool) -> None:
    """Save all parameters."""
    from datetime import UTC, datetime

    from skyway.cli import options
    from skyway.link.protocol.parameter_set import check_ending, set_text
    from skyway.models.base.files import write_atomically
    from skyway.models.base.units import iso

    check_ending(file)
    options.refuse_overwriting(file, force=force)
    with link.aboard() as vehicle:
        identity = vehicle.identify()
        values = list(vehicle.parameters().values())
        head = (f"Parameters of {identity}", f"Saved by skyway at {iso(datetime.now(UTC))}")
        text = set_text(file, values, head, vehicle.family.name, vehicle.system)
    write_atomically(file, text, force=force)
    if as_json:
        typer.echo(json_text(SetSaved(file=str(file), parameters=len(values))))
    else:
        typer.echo(f"{file}: {counted(len(values), 'parameter')} of {identity}")


def restore_from_set(link: Link, file: Path, *, yes: bool, as_json: bool) -> None:
    """Show what a set changes, ask for it once, and set it."""
    from skyway.link.protocol.parameter_set import compare_set, read_set
    from skyway.link.vehicle.parameter_restore import restore_set

    saved = read_set(file)
    done: dict[str, str] = {}
    problem, now_there = "", []
    with link.aboard() as vehicle:
        difference = compare_set(saved, vehicle.parameters(), vehicle.family)
        if not as_json:
            _show(saved, difference)
        agreed = bool(difference.changes) and (yes or asked(len(difference.changes), as_json=as_json))
        if agreed:
            if vehicle.armed:
                raise CommandRefusedError("restore parameters", "the vehicle is armed: on the ground only")

            def tell(change: SetChange, what: str) -> None:
                done[change.name] = what
                if not as_json:
                    typer.echo(f"{change.name}: {what}{' and read back' if what == 'set' else ''}")

            problem = restore_set(vehicle, difference.changes, tell)
            if difference.absent and not problem:  # a switch that was set brings the parameters of what it switches on
                now_there = [name for name in vehicle.parameters() if name in difference.absent]
    if as_json:
        typer.echo(json_text(_told(difference, done, problem)))
    elif now_there:
        typer.echo(f"{len(now_there)} new parameters appeared: restore once more for {', '.join(now_there)}")
    elif difference.changes and not agreed:
        typer.echo("nothing was changed; add --yes to restore")
    if problem:
        raise LinkError(f"not all parameters were restored: {problem}")


def asked(count: int, *, as_json: bool) -> bool:
    """Ask the person at a terminal; without one the answer is no."""
    if as_json or not sys.stdin.isatty():
        return False
    return typer.confirm(f"set {count} parameter{'' if count == 1 else 's'}?")


def others_ignored(lines: int) -> str:
    """Say that lines of a file do not concern the autopilot."""
    return f"{counted(lines, 'line')} for other components, ignored"


def _show(saved: SavedSet, difference: SetDifference) -> None:
    """Say what the set changes, and what it does not."""
    for change in difference.changes:
        typer.echo(f"{change.name}: {change.now:.9g} -> {change.then:.9g}")
    for file_name, name in difference.renamed:
        typer.echo(f"{file_name} is called {name} on the vehicle")
    for name, why in difference.left:
        typer.echo(f"{name} is left as it is: {why}")
    if difference.absent:
        typer.echo(f"unknown to the vehicle: {', '.join(difference.absent)}")
    if saved.of_others:
        typer.echo(others_ignored(saved.of_others))
    typer.echo(f"{len(difference.changes)} to change, {difference.same} as the file says")


def _told(difference: SetDifference, done: dict[str, str], problem: str) -> SetRestored:
    rows = [
        SetValue(name=c.name, now=c.now, then=c.then, file_name=c.file_name, done=done.get(c.name, "would be set"))
        for c in difference.changes
    ]
    return SetRestored(
        ok=not problem, parameters=rows, same=difference.same, renamed=dict(difference.renamed),
        absent=list(difference.absent), left=dict(difference.left), problem=problem or None,
    )  # fmt: skip
