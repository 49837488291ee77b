"""Options shared by all commands that connect to vehicles."""

from __future__ import annotations

import re
from contextlib import closing, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skyway.cli import options
from skyway.models.base.errors import CommandRefusedError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.link.protocol.connection import Connection
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.missions.autopilots.family import Family


_ASKED = "auto"
"""Autopilot that the vehicle names itself."""


class Driver(StrEnum):
    """Implementation of the protocols."""

    PYMAVLINK = "pymavlink"
    MAVSDK = "mavsdk"


DEFAULT_CONNECT = "udpin:127.0.0.1:14540"
CONNECT_HELP = (
    "udpin:, udpout:, tcp: or tcpin:HOST:PORT, or DEVICE,BAUD; repeatable: several radios to one vehicle. "
    f"Default: {DEFAULT_CONNECT}."
)
FORWARD_HELP = (
    "Forward the link to other ground stations, such as udpout:127.0.0.1:14550; repeatable. They may command "
    "the flight (modes, arming), not change missions and parameters; see --forward-commands."
)
Yes = Annotated[bool, typer.Option("--yes", help="Execute the command; without --yes nothing is changed.")]
Armed = Annotated[
    bool,
    typer.Option("--armed", help="Execute it although the vehicle is armed: it may be flying, and act on it at once."),
]


def refuse_armed(vehicle: Vehicle, what: str, *, allowed: bool) -> None:
    """Refuse to change what an armed vehicle may be flying by; `what` says what."""
    if vehicle.armed and not allowed:
        raise CommandRefusedError(what, "it is armed and may be flying: on the ground only, disarmed, or with --armed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A connection as a person names it: to whom, as whom, signed with what, recorded where."""

    connect: Annotated[list[str] | None, typer.Option(help=CONNECT_HELP)] = None
    ground: Annotated[int, typer.Option("--gcs-system", help="System id of this ground station.")] = 255
    key_file: Annotated[
        Path | None,
        typer.Option(help="File with the MAVLink signing key; or set SKYWAY_SIGNING_KEY in the environment."),
    ] = None
    record: Annotated[Path, typer.Option(help="Folder for recordings (.tlog).")] = Path("recordings")
    forward: Annotated[list[str] | None, typer.Option(help=FORWARD_HELP)] = None
    forward_commands: Annotated[
        Literal["none", "pilot", "all"],
        typer.Option(help="Commands permitted to other ground stations; see --forward."),
    ] = "pilot"

    @property
    def addresses(self) -> list[str]:
        """Connection strings of the vehicle."""
        return self.connect or [DEFAULT_CONNECT]

    @contextmanager
    def opened(self) -> Iterator[Connection]:
        """Open the connection; everything on it is recorded, and forwarded where requested."""
        from skyway.link.forwarding.permission import Permission
        from skyway.link.protocol.opening import open_connection, read_key

        connection = open_connection(
            self.addresses, record=self.record, system=self.ground, key=read_key(self.key_file),
            forward=self.forward or (), permission=Permission(self.forward_commands),
        )  # fmt: skip
        if connection.forwarder is not None:
            connection.forwarder.tell = lambda note: typer.echo(note.said, err=True)
        try:
            yield connection
        finally:
            connection.close()
            if connection.recorder is not None and connection.recorder.problem:
                typer.echo(connection.recorder.problem, err=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link(Line):
    """The way to one vehicle."""

    system: Annotated[int | None, typer.Option(help="System id of the vehicle, if there are several.")] = None
    autopilot: Annotated[
        options.FamilyNameOrAuto, typer.Option(help="Autopilot of the vehicle; auto asks the vehicle.")
    ] = _ASKED
    driver: Annotated[Driver, typer.Option(help="Implementation of the protocols; mavsdk has no signed links.")] = (
        Driver.PYMAVLINK
    )

    parameter_name: Annotated[
        list[str] | None,
        typer.Option(help="SETTING=NAME:UNIT, for a parameter name that skyway does not know; repeatable."),
    ] = None

    @contextmanager
    def aboard(self) -> Iterator[Vehicle]:
        """Open the connection and find the vehicle."""
        from skyway.link.protocol.opening import check_system

        if self.system is not None:
            check_system(self.system, "--system")
        family = None if self.autopilot == _ASKED else self.autopilot
        with self.opened() as connection, closing(self._driver()(connection, self.system, family)) as vehicle:
            if connection.wants_key:
                typer.echo(
                    "the vehicle signs its packets; without its key (--key-file) it may ignore commands", err=True
                )
            if connection.rejected.elsewhere:
                typer.echo(
                    f"packets in the name of system {vehicle.system} also come from another address, and are ignored: if that is another "
                    "vehicle, give it another system id; this one may be the wrong one",
                    err=True,
                )
            vehicle.own_names = own_names(self.parameter_name or (), vehicle.family)
            yield vehicle

    def _driver(self) -> type[Vehicle]:
        if self.driver is Driver.MAVSDK:
            from skyway.link.vehicle.mavsdk_vehicle import MavsdkVehicle

            return MavsdkVehicle
        from skyway.link.vehicle.vehicle import Vehicle

        return Vehicle


def own_names(given: Sequence[str], family: Family) -> dict[str, tuple[str, str]]:
    """Read names that a person gives to settings: ``mission-speed=WP_SPEED:m/s``."""
    settings = family.settings
    found: dict[str, tuple[str, str]] = {}
    for text in given:
        key, _, rest = text.partition("=")
        name, _, unit = rest.partition(":")
        if key not in settings.keys:
            known = ", ".join(settings.keys)
            raise InputError(f"no such setting of {family.name}", field="--parameter-name", value=key, remedy=known)
        if not re.fullmatch(r"[A-Z][A-Z0-9_]{0,15}", name):
            remedy = "for example mission-speed=WP_SPD:m/s"
            raise InputError("is not SETTING=NAME:UNIT", field="--parameter-name", value=text, remedy=remedy)
        settings[key].need("read", None, "").called(name, unit)  # refuses a unit of something else
        found[key] = (name, unit)
    return found
