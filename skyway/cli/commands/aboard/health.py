"""Command ``health``."""

from __future__ import annotations

from typing import Literal

import msgspec
import typer

from skyway.cli import options
from skyway.cli.connection_options import Link
from skyway.cli.option_groups import with_groups
from skyway.models.base.json_text import json_text


class ItemTold(msgspec.Struct, frozen=True, kw_only=True):
    """One checked item; `needed`: no delivery begins while it is unknown."""

    name: str
    verdict: Literal["ok", "no", "unknown"]
    said: str
    needed: bool


class HealthTold(msgspec.Struct, frozen=True, kw_only=True):
    """Health of a vehicle; `ok` if it may fly."""

    schema: str = "skyway.health/1"
    ok: bool
    vehicle: str
    time: str
    kept_in: str | None
    items: list[ItemTold]


@with_groups
def health(link: Link, as_json: options.AsJson = False) -> None:
    """Check calibration and health of a disarmed vehicle, before its first flight of a day: sensors, filter, compass, battery, GPS, motors, vibration.

    The command changes nothing. What the vehicle does not report is unknown, never good. The result is stored in the folder
    of --record for skyway fly. Exit code 1: an item is not in order, or a required one is unknown.

    Examples
    --------
      skyway health --connect tcp:127.0.0.1:5760
    """
    from skyway.link.vehicle.health import look_at
    from skyway.link.vehicle.health_book import HealthBook
    from skyway.models.base.errors import CommandRefusedError
    from skyway.models.base.units import from_posix, iso

    book = HealthBook(link.record)
    with link.aboard() as vehicle:
        if vehicle.armed:
            raise CommandRefusedError("be checked", "it is armed: on the ground only")
        identity = vehicle.identify()
        items = []
        if not as_json:
            typer.echo(str(identity))
        for one in look_at(vehicle, book.last_flight(identity.uid)):
            items.append(one)
            if not as_json:
                typer.echo(str(one))
        now_s = vehicle.connection.clock.posix_s()
    book.add(identity.uid, now_s, items)
    good = all(one.ok for one in items)
    if as_json:
        told = [ItemTold(name=one.name, verdict=one.verdict, said=one.said, needed=one.needed) for one in items]
        kept = str(book.path) if identity.uid else None
        typer.echo(
            json_text(HealthTold(ok=good, vehicle=str(identity), time=iso(from_posix(now_s)), kept_in=kept, items=told))
        )
    elif good:
        typer.echo(
            f"good for today: {book.path}"
            if identity.uid
            else "good; not stored, since the vehicle reports no hardware id"
        )
    else:
        typer.echo("not in order: " + ", ".join(one.name for one in items if not one.ok))
    if not good:
        raise typer.Exit(1)
