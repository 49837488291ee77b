"""Commands ``logs list`` and ``logs fetch``."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import typer

from skyway.cli import options
from skyway.cli.connection_options import Link
from skyway.cli.option_groups import with_groups
from skyway.models.base.errors import InputError, LinkError, SkywayError, one_line
from skyway.models.base.formatting import bytes_text, date_clock, duration, percent, spent
from skyway.models.base.json_text import json_text
from skyway.models.base.units import from_posix, iso

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.files.aboard import LogAboard, LogStore
    from skyway.link.files.fetching import Fetched

By = Annotated[
    Literal["auto", "ftp", "requests"],
    typer.Option("--by", help="MAVLink FTP, or log requests; auto uses FTP if the vehicle supports it."),
]
_TELL_S = 5.0


class LogOfVehicle(msgspec.Struct, frozen=True, kw_only=True):
    """One log on the vehicle; `time` is its begin or end, as far as the vehicle reports it."""

    number: int
    name: str
    size_bytes: int
    time: str | None


class LogsOfVehicle(msgspec.Struct, frozen=True, kw_only=True):
    """All logs on the vehicle, the newest last."""

    schema: str = "skyway.logs/1"
    by: str
    logs: list[LogOfVehicle]


class LogFetched(msgspec.Struct, frozen=True, kw_only=True):
    """A log that is here now; `crc32` in hexadecimal digits, `verified` by ``crc32`` or ``size``."""

    name: str
    file: str
    size_bytes: int
    crc32: str
    verified: str
    came_bytes: int
    took_s: float
    notes: list[str]


class LogsFetched(msgspec.Struct, frozen=True, kw_only=True):
    """The downloaded logs."""

    schema: str = "skyway.logs-fetched/1"
    logs: list[LogFetched]


logs = typer.Typer(help="List and download the flight logs of a vehicle.", no_args_is_help=True)


@logs.command("list")
@with_groups
def logs_list(link: Link, by: By = "auto", as_json: options.AsJson = False) -> None:
    """List the logs on a vehicle, the newest last.

    Examples
    --------
      skyway logs list --connect tcp:127.0.0.1:5760
    """
    from skyway.link.files.aboard import LogStore

    with link.aboard() as vehicle:
        store = LogStore(vehicle, by)
        found = _listed(store)
    if as_json:
        rows = [LogOfVehicle(number=n, name=one.name, size_bytes=one.size_bytes, time=_time(one)) for n, one in found]
        typer.echo(json_text(LogsOfVehicle(by=store.way, logs=rows)))
        return
    if not found:
        typer.echo("no logs")
    for number, one in found:
        begun = date_clock(from_posix(float(one.time_utc)), named=True) if one.time_utc else ""
        typer.echo(f"{number:>4}  {one.name:<32} {bytes_text(one.size_bytes):>10}  {begun}".rstrip())


@logs.command("fetch")
@with_groups
def logs_fetch(
    link: Link,
    wanted: Annotated[
        list[str] | None, typer.Argument(help="Numbers or names from skyway logs list, latest, or all.")
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option("--to", "--output", "-o", help="Folder for the logs. Default: the folder of --record."),
    ] = None,
    by: By = "auto",
    as_json: options.AsJson = False,
    force: options.Force = False,
) -> None:
    """Download logs from a disarmed vehicle: the latest, or the named ones.

    A log that fails does not stop the others. An interrupted download resumes where it stopped. The file gets its final name once its size, and its checksum if the
    vehicle reports one, match the vehicle's.

    Examples
    --------
      skyway logs fetch --connect tcp:127.0.0.1:5760
      skyway logs fetch 3 4 --to logs --connect /dev/ttyUSB0,57600
    """
    from skyway.link.files.aboard import LogStore
    from skyway.link.files.catalog import remember
    from skyway.link.files.fetching import fetch

    folder = to or link.record
    rows = []
    failed: dict[str, SkywayError] = {}
    with link.aboard() as vehicle:
        store = LogStore(vehicle, by)
        chosen = _chosen(_listed(store), wanted or ["latest"])
        for one in chosen:
            if not as_json:
                typer.echo(f"{one.name}: {bytes_text(one.size_bytes)}")
            tell = _Progress(err=as_json)
            try:
                found = fetch(store, one, folder, force=force, progress=tell)
            except (InputError, LinkError) as error:
                if len(chosen) == 1 or not _is_of_this_log(error):
                    raise
                failed[one.name] = error
                typer.echo(f"skyway: {one.name} not fetched: {one_line(str(error))}", err=True)
                continue
            remember(found, vehicle.system)
            rows.append(_row(one, found))
            if not as_json:
                _say(found)
    if as_json:
        typer.echo(json_text(LogsFetched(logs=rows)))
    if failed:
        worst = max(failed.values(), key=lambda error: error.exit_code)
        raise type(worst)(f"{len(failed)} of {len(chosen)} logs not fetched: {', '.join(failed)}")


def _is_of_this_log(error: SkywayError) -> bool:
    """Whether others may succeed: its file is in the way, or its transfer failed; not if the vehicle refuses, or no longer answers."""
    return isinstance(error, InputError) or type(error) is LinkError


def _listed(store: LogStore) -> list[tuple[int, LogAboard]]:
    """Logs with their numbers from 1; invalid names are reported and skipped."""
    found = list(enumerate(store.logs(), start=1))
    store.end()
    for name in store.skipped:
        typer.echo(f"skyway: ignored an invalid file name on the card: {name!r}", err=True)
    return found


def _chosen(found: Sequence[tuple[int, LogAboard]], wanted: Sequence[str]) -> list[LogAboard]:
    """Those that are named."""
    if not found:
        raise InputError("the vehicle has no logs", remedy="fly first; logging may be off, or the card missing")
    chosen: dict[str, LogAboard] = {}
    for word in wanted:
        matching = {
            "all": [one for _, one in found],
            "latest": [found[-1][1]],
        }.get(word) or [one for number, one in found if word in (str(number), one.name)]
        if not matching:
            remedy = f"1 to {len(found)}, latest, all, or a name from skyway logs list"
            raise InputError("no such log", field="LOG", value=word, remedy=remedy)
        chosen |= {one.name: one for one in matching}
    return list(chosen.values())


def _time(one: LogAboard) -> str | None:
    return iso(from_posix(float(one.time_utc))) if one.time_utc else None


def _row(one: LogAboard, found: Fetched) -> LogFetched:
    return LogFetched(
        name=one.name,
        file=str(found.path),
        size_bytes=found.size_bytes,
        crc32=f"{found.crc32:08x}",
        verified="crc32" if found.by_crc else "size",
        came_bytes=found.came_bytes,
        took_s=round(found.took_s, 2),
        notes=list(found.notes),
    )


def _say(found: Fetched) -> None:
    for note in found.notes:
        typer.echo(f"  {note}")
    took = duration(found.took_s) if found.took_s >= 60.0 else spent(found.took_s)
    how = f" in {took}, {bytes_text(found.rate_byteps)}/s" if found.took_s > 0.0 else ""
    typer.echo(f"  {found.path}: {bytes_text(found.size_bytes)}{how}; verified by {found.verified_by}")


class _Progress:
    """Says every few seconds how far a transfer is."""

    def __init__(self, *, err: bool) -> None:
        self._err, self._begun_s, self._told_s, self._first = err, time.monotonic(), time.monotonic(), -1

    def __call__(self, came_bytes: int, size_bytes: int) -> None:
        now = time.monotonic()
        self._first = came_bytes if self._first < 0 else self._first
        if now < self._told_s + _TELL_S or not (sys.stderr if self._err else sys.stdout).isatty():
            return
        self._told_s = now
        rate = max(came_bytes - self._first, 1) / (now - self._begun_s)
        left = duration((size_bytes - came_bytes) / rate)
        typer.echo(f"  {percent(came_bytes / size_bytes)}, {bytes_text(rate)}/s, {left} left", err=self._err)
