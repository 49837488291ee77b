"""Reports of uploads, and their output: a preview, and the result."""

from __future__ import annotations

import math
import os
import sys
from typing import TYPE_CHECKING

import msgspec
import typer

from skyway.cli.views.sheet import Column, Sheet
from skyway.missions.items.finding import Finding
from skyway.models.base.formatting import stored_degrees

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.protocol.verified import Part, UploadOutcome
    from skyway.link.vehicle.vehicle import Identity
    from skyway.missions.autopilots.read_back import Difference
    from skyway.missions.items.mission import MissionItem

_FEW = 10


class VehicleIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """Identity of a vehicle; None is unknown."""

    system: int
    autopilot: str
    type: int
    version: str | None
    capabilities: tuple[str, ...]
    uid: str | None

    @classmethod
    def of(cls, identity: Identity) -> VehicleIdentity:
        """Make it from the vehicle's report."""
        return cls(
            system=identity.system, autopilot=identity.autopilot, type=identity.kind, version=identity.version or None,
            capabilities=identity.words, uid=f"{identity.uid:016x}" if identity.uid else None,
        )  # fmt: skip


class PartDifference(msgspec.Struct, frozen=True, kw_only=True):
    """Difference between a vehicle's list and a file."""

    kind: str
    item: int | None
    field: str
    text: str

    @classmethod
    def of(cls, kind: str, difference: Difference) -> PartDifference:
        """Make it from a difference; values in the vehicle's form."""
        return cls(kind=kind, item=difference.item, field=difference.field, text=on_board(difference))


class PartPlanned(msgspec.Struct, frozen=True, kw_only=True):
    """Planned upload, with the differences from the vehicle's list."""

    kind: str
    differences: list[PartDifference]


class PartSent(msgspec.Struct, frozen=True, kw_only=True):
    """Result of an upload."""

    kind: str
    state: str
    holds: str
    reason: str | None
    items: tuple[int, ...]
    differences: list[str]
    transfers: int

    @classmethod
    def of(cls, outcome: UploadOutcome) -> PartSent:
        """Make it from the outcome of a verified upload."""
        return cls(
            kind=outcome.kind.name.lower(), state=outcome.state.value, holds=outcome.holds, reason=outcome.reason or None,
            items=outcome.items, differences=[str(one) for one in outcome.differences], transfers=outcome.attempts,
        )  # fmt: skip


class ParameterState(msgspec.Struct, frozen=True, kw_only=True, rename={"now": "is"}):
    """A parameter that a mission requires: old value, new value, and the result."""

    name: str
    was: float | None
    now: float | None
    state: str


class UploadReport(msgspec.Struct, frozen=True, kw_only=True):
    """Actual or planned actions of ``skyway upload``."""

    schema: str = "skyway.upload/1"
    ok: bool
    sent: bool
    vehicle: VehicleIdentity
    findings: tuple[Finding, ...] = ()
    """As of ``skyway check``."""
    parameters: list[ParameterState]
    parts: list[PartSent] | list[PartPlanned]
    besides: list[str]
    """What the vehicle holds that the file does not have, for a person."""


class DownloadReport(msgspec.Struct, frozen=True, kw_only=True):
    """Files written by ``skyway download``."""

    schema: str = "skyway.download/1"
    ok: bool = True
    files: list[str]
    items: int
    fence_areas: int
    rally_points: int
    not_read: list[str]
    """Kinds of lists that the vehicle does not have, or cannot tell."""


class ClearReport(msgspec.Struct, frozen=True, kw_only=True):
    """Lists cleared, or to be cleared, by ``skyway clear``."""

    schema: str = "skyway.clear/1"
    ok: bool = True
    cleared: bool
    vehicle: VehicleIdentity
    held: dict[str, int]


class VerifyReport(msgspec.Struct, frozen=True, kw_only=True):
    """Findings of ``skyway verify``."""

    schema: str = "skyway.verify/1"
    ok: bool
    differences: list[PartDifference]
    besides: list[str]
    """What the vehicle holds that the file does not have, for a person."""


def progress() -> Callable[[str, int, int], None] | None:
    """Return a line that is overwritten, if the output is a terminal; lines if SKYWAY_PROGRESS requests them."""
    if os.environ.get("SKYWAY_PROGRESS"):
        return lambda what, done, total: typer.echo(f"{what} {done}/{total}", err=True)
    if not sys.stderr.isatty():
        return None

    def told(what: str, done: int, total: int) -> None:
        sys.stderr.write(f"\r\033[K{what} {done}/{total}")
        if done == total:
            sys.stderr.write("\r\033[K")
        sys.stderr.flush()

    return told


def show_findings(findings: Sequence[Finding]) -> None:
    """Print errors and warnings, as ``skyway check`` does."""
    for finding in findings:
        if finding.severity != "info":
            typer.echo(str(finding))


def show_plan(part: Part, differences: Sequence[Difference]) -> None:
    """Print the planned upload, beside the vehicle's present list."""
    from skyway.link.protocol.verified import kind_of
    from skyway.missions.items.mission import Mission

    same = "the vehicle holds the same" if not differences else f"{len(differences)} differences from what it holds"
    typer.echo(f"{kind_of(part).word}: {size_of(part)} to send; {same}")
    if not isinstance(part, Mission):
        for difference in differences[:_FEW]:
            typer.echo(f"  {on_board(difference)}")
        return
    left = ("command", "on board")
    names = ("item", "command", "latitude", "longitude", "height", "on board")
    sheet = Sheet([Column(name, justify="left" if name in left else "right") for name in names], names=2)
    for number, item in enumerate(part.items):
        found = [difference for difference in differences if difference.item == number]
        sheet.add(str(number), item.name, *_place(item), _on_board_of_item(found))
    sheet.show()
    more = [difference for difference in differences if difference.item is None or difference.item >= len(part)]
    for difference in more[:_FEW]:
        typer.echo(f"  {on_board(difference)}")


def count_of(part: Part) -> int:
    """Return the number of items, areas or points."""
    from skyway.missions.items.geofence import Geofence

    return len(part.areas) if isinstance(part, Geofence) else len(part)


def size_of(part: Part) -> str:
    """Return the size, for a person."""
    from skyway.missions.items.geofence import Geofence

    return f"{count_of(part)} {'areas' if isinstance(part, Geofence) else 'items'}"


def _place(item: MissionItem) -> tuple[str, str, str]:
    point = item.point
    place = ("", "") if point is None else stored_degrees(point.lat, point.lon)
    return (*place, f"{item.z:g} m" if item.is_located and not math.isnan(item.z) else "")


def _on_board_of_item(found: Sequence[Difference]) -> str:
    if not found:
        return "the same"
    if found[0].read is None and found[0].field == "command":
        return "nothing"
    return "; ".join(f"{difference.name} {difference.words(difference.read)}" for difference in found)


def on_board(difference: Difference) -> str:
    """Return the vehicle's differences from the file."""
    where = difference.name if difference.item is None else f"item {difference.item} {difference.name}"
    on_vehicle, in_file = difference.words(difference.read), difference.words(difference.sent)
    return f"{where}: on the vehicle {on_vehicle}, in the file {in_file}"


def show_outcome(outcome: UploadOutcome) -> None:
    """Print the result of one upload."""
    typer.echo(str(outcome))
    for difference in outcome.differences[:_FEW]:
        typer.echo(f"  {difference}")
