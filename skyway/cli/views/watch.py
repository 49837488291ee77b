"""Output of ``skyway watch``: a row for each vehicle, in a table or as JSON."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import msgspec
import typer

from skyway.cli.views.sheet import width
from skyway.link.vehicle.remote_id import module_status
from skyway.models.base.formatting import duration, height_text, percent, place_text, speed_text, wind_text
from skyway.models.base.json_text import json_text
from skyway.models.base.units import from_posix

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.table import Table

    from skyway.link.protocol.connection import Connection
    from skyway.link.telemetry.vehicle_monitor import VehicleMonitor
    from skyway.link.wire.frames import Rejected

_EVERY_S, _LINE_EVERY_S, _ASK_EVERY_S = 0.5, 1.0, 5.0
WIDE = 110
"""Number of columns from which on the table has a row for each vehicle."""
_SILENT_S = 5.0
_TABLE_NOTES, _LINE_NOTES = 5, 200
"""Number of the newest notes about other ground stations that are shown."""
_UNKNOWN = "unknown"


class VehicleRow(msgspec.Struct, frozen=True, kw_only=True):
    """State of a vehicle; None is unknown."""

    system: int
    autopilot: str
    mode: str
    armed: bool
    lat: float | None
    lon: float | None
    height_m: float | None
    ground_speed_mps: float | None
    soc: float | None
    wind_mps: float | None
    wind_from_deg: float | None
    item: float | None
    mission: str
    time: str | None
    clock: str
    silent_s: float
    loss: float
    doubts: list[str]
    rejected: Rejected
    conflict: bool
    radios: list[str]
    traffic: list[str]
    remote_id: str


def _row(vehicle: VehicleMonitor) -> VehicleRow:
    latest = vehicle.live.latest
    sample = vehicle.live.sample
    north, east = latest("wind_north_mps"), latest("wind_east_mps")
    apart = vehicle.batteries.apart(vehicle.connection.clock.now_s())
    return VehicleRow(
        system=vehicle.system,
        autopilot=vehicle.family.name,
        mode=vehicle.mode,
        armed=vehicle.armed,
        lat=_known(latest("lat_deg"), 7),
        lon=_known(latest("lon_deg"), 7),
        height_m=_known(latest("height_m"), 1),
        ground_speed_mps=_known(math.hypot(latest("vel_north_mps"), latest("vel_east_mps")), 1),
        soc=_known(latest("soc"), 3),
        wind_mps=_known(math.hypot(north, east), 1),
        wind_from_deg=_known(math.degrees(math.atan2(-east, -north)) % 360.0, 0),
        item=_known(latest("mission_item"), 0),
        mission=vehicle.mission_state,
        time=None
        if sample is None
        else from_posix(sample.time_s).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        clock=vehicle.live.clock.base.source,
        silent_s=round(vehicle.silent_s, 1),
        loss=round(vehicle.live.loss, 3),
        doubts=[
            *(f"{name}: {why}" for name, why in vehicle.live.doubts.items()),
            *((f"soc: {apart}",) if apart else ()),
            *(str(check) for check in vehicle.rates.checks if check.measured_hz and not check.ok),
        ],
        rejected=vehicle.connection.rejected,
        conflict=vehicle.connection.conflict is not None,
        radios=_radios(vehicle.connection),
        remote_id=str(module_status(vehicle.peer, vehicle.connection.clock.now_s())),
        traffic=[str(one) for one in vehicle.traffic.near(vehicle.connection.clock.now_s())],
    )


def _radios(connection: Connection) -> list[str]:
    """Each radio with its quality, the active one first."""
    return [str(one) for one in connection.qualities]


def _known(value: float, digits: int) -> float | None:
    return None if math.isnan(value) else round(value, digits)


_COLUMNS = (
    "vehicle",
    "mode",
    "position",
    "height",
    "speed",
    "charge",
    "wind",
    "mission",
    "link",
    "remote id",
    "doubts",
)


def _cells(row: VehicleRow) -> list[str]:
    """The same for a person, in the order of the columns."""
    silent = row.silent_s > _SILENT_S
    place = _UNKNOWN if row.lat is None or row.lon is None else place_text(row.lat, row.lon)
    from_deg = row.wind_from_deg
    wind = _UNKNOWN if row.wind_mps is None or from_deg is None else wind_text(row.wind_mps, from_deg)
    item = "" if row.item is None else f"item {row.item:.0f}"
    state = "" if row.mission == _UNKNOWN else row.mission
    return [
        f"{row.system} {row.autopilot}",
        f"{row.mode}{', armed' if row.armed else ''}",
        place,
        height_text(row.height_m),
        speed_text(row.ground_speed_mps),
        percent(row.soc),
        wind,
        " ".join(word for word in (item, state) if word) or _UNKNOWN,
        f"silent for {duration(row.silent_s)}" if silent else percent(1 - row.loss),
        row.remote_id,
        "; ".join(row.doubts),
    ]


class Watched:
    """All vehicles on a connection, added as they appear; this never waits for an answer."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.vehicles: dict[int, VehicleMonitor] = {}
        self.strange: dict[int, int] = {}
        self._lately: deque[str] = deque(maxlen=_TABLE_NOTES)
        self._news: deque[str] = deque(maxlen=_LINE_NOTES)
        if connection.forwarder is not None:
            connection.forwarder.tell = lambda note: self._note([note.said])
        self._asked_s: dict[int, float] = {}
        self._told: dict[int, float] = {}

    def run_for(self, duration_s: float) -> None:
        """Process received data, and request telemetry from vehicles that send none."""
        self.connection.run_for(duration_s)
        now = self.connection.clock.now_s()
        for system, peer in list(self.connection.peers.items()):
            if system not in self.vehicles and self.strange.get(system) != peer.autopilot:
                self._meet(system, peer.autopilot)
        for system, vehicle in self.vehicles.items():
            fresh = vehicle.live.sample is not None and not math.isnan(vehicle.live.sample.roll_rad)
            if not fresh and now >= self._asked_s.get(system, -math.inf) + _ASK_EVERY_S:
                self._asked_s[system] = now
                vehicle.nudge_telemetry()

    def _meet(self, system: int, autopilot: int) -> None:
        from skyway.link.telemetry.vehicle_monitor import VehicleMonitor
        from skyway.missions.autopilots.registry import family_of

        if family_of(autopilot) is None:
            self.strange[system] = autopilot
        else:
            self.strange.pop(system, None)  # an onboard computer beat before it
            self.vehicles[system] = VehicleMonitor(self.connection, system)

    def rows(self) -> list[VehicleRow]:
        """Return the known state of each vehicle, in the order of their ids."""
        return [_row(self.vehicles[system]) for system in sorted(self.vehicles)]

    def changed(self) -> list[VehicleRow]:
        """Return the known state of each vehicle that has reported its position since the last call."""
        found = []
        for system in sorted(self.vehicles):
            sample = self.vehicles[system].live.sample
            if sample is not None and sample.time_s != self._told.get(system):
                self._told[system] = sample.time_s
                found.append(_row(self.vehicles[system]))
        return found

    def remarks(self) -> list[str]:
        """Problems of the connection itself, in words."""
        said = [f"vehicle {n}: unknown autopilot {kind}" for n, kind in self.strange.items()]
        rejected = self.connection.rejected
        counts = (rejected.unsigned, rejected.forged, rejected.replayed, rejected.elsewhere)
        words = ("unsigned", "forged", "replayed", "from another address")
        if rejected.untrusted:
            told = ", ".join(f"{count} {word}" for count, word in zip(counts, words, strict=True) if count)
            said.append(f"packets rejected: {told}")
        if self.connection.conflict is not None:
            said.append(str(self.connection.conflict))
        return said

    def news(self) -> list[str]:
        """Events of other stations, radios and aircraft since the last call."""
        self._collect()
        found = list(self._news)
        self._news.clear()
        return found

    def lately(self) -> list[str]:
        """The latest of all such notes."""
        self._collect()
        return list(self._lately)

    def _collect(self) -> None:
        if self.connection.radios is not None:
            self._note(self.connection.radios.notes())
        for vehicle in self.vehicles.values():
            self._note(f"vehicle {vehicle.system}: {one}" for one in vehicle.traffic.alerts())

    def _note(self, said: Iterable[str]) -> None:
        for one in said:
            self._lately.append(one)
            self._news.append(one)


def show(watched: Watched, end_s: float, *, as_json: bool, every_s: float = _LINE_EVERY_S) -> None:
    """Show the vehicles until a time: as a live table on a terminal, otherwise line by line.

    Line by line, after a header, each vehicle is printed once a second; with a smaller `every_s` its changes are printed at that interval as well.
    """
    from rich.console import Console
    from rich.live import Live

    clock = watched.connection.clock
    if Console().is_terminal and not as_json:
        with Live(_table(watched), auto_refresh=False) as live:
            while clock.now_s() < end_s:
                watched.run_for(min(_EVERY_S, end_s - clock.now_s()))
                live.update(_table(watched), refresh=True)
        return
    if not as_json:
        typer.echo("  ".join(_COLUMNS))
    told: list[str] = []
    all_s = -math.inf
    while clock.now_s() < end_s:
        watched.run_for(min(every_s, end_s - clock.now_s()))
        whole = every_s >= _LINE_EVERY_S or clock.now_s() >= all_s + _LINE_EVERY_S - 1e-3
        all_s = clock.now_s() if whole else all_s
        changed = watched.changed() if every_s < _LINE_EVERY_S else []
        for row in watched.rows() if whole else changed:
            typer.echo(json_text(row) if as_json else "  ".join(_cells(row)))
        fresh = [remark for remark in watched.remarks() if remark not in told]
        told += fresh
        for line in (*fresh, *watched.news()):
            typer.echo(line, err=True)


def _table(watched: Watched) -> Table:

    from rich.table import Table

    rows = watched.rows()
    table = Table(caption="\n".join([*watched.remarks(), *watched.lately()]) or None, caption_style="bold red")
    if rows and (width() or WIDE) < WIDE:  # a narrow terminal: a line for each value, broken only between words
        table.add_column("vehicle")
        for row in rows:
            table.add_column(_cells(row)[0], overflow="fold")
        for name, *values in zip(_COLUMNS[1:], *(_cells(row)[1:] for row in rows), strict=True):
            table.add_row(name, *values)
        return table
    for name in _COLUMNS if rows else ("waiting for a heartbeat",):
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*_cells(row))
    return table
