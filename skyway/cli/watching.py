"""The live table of all vehicles on a connection."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from link.mavlink_vehicle import MavlinkVehicle
from models.errors import InputError, VehicleTimeoutError

if TYPE_CHECKING:
    from link.connection import Connection

_EVERY_S = 0.5
_JSON_EVERY_S = 1.0
_SILENT_S = 5.0


def watch_all(connection: Connection, lasting_s: float | None, *, as_json: bool) -> None:
    """Show every vehicle until the time is over."""
    vehicles: dict[int, MavlinkVehicle] = {}
    clock = connection.clock
    end = math.inf if lasting_s is None else clock.now_s() + lasting_s
    terminal = Console().is_terminal and not as_json
    if terminal:
        with Live(_table(connection, vehicles), refresh_per_second=2) as live:
            while clock.now_s() < end:
                connection.run_for(min(_EVERY_S, max(end - clock.now_s(), 0.0)))
                _meet(connection, vehicles)
                live.update(_table(connection, vehicles))
    else:
        while clock.now_s() < end:
            connection.run_for(min(_JSON_EVERY_S, max(end - clock.now_s(), 0.0)))
            _meet(connection, vehicles)
            for system in sorted(vehicles):
                row = _row(connection, vehicles[system])
                typer.echo(json.dumps(row) if as_json else "  ".join(f"{k} {_shown(v)}" for k, v in row.items()))
    if not vehicles:
        raise VehicleTimeoutError("no heartbeat", lasting_s or 0.0)


def _meet(connection: Connection, vehicles: dict[int, MavlinkVehicle]) -> None:
    for system in list(connection.peers):
        if system in vehicles:
            continue
        try:
            vehicles[system] = MavlinkVehicle(connection, system)
        except InputError:
            continue  # an autopilot that we do not know
        vehicles[system].request_telemetry()


def _row(connection: Connection, vehicle: MavlinkVehicle) -> dict[str, object]:
    latest, silent_s = vehicle.live.latest, connection.clock.now_s() - vehicle.peer.heard_s
    soc, wind = latest("soc"), math.hypot(latest("wind_north_mps"), latest("wind_east_mps"))
    return {
        "system": vehicle.system,
        "autopilot": vehicle.family.name,
        "mode": vehicle.mode,
        "armed": vehicle.armed,
        "lat": _known(latest("lat_deg"), 6),
        "lon": _known(latest("lon_deg"), 6),
        "height_m": _known(latest("height_m"), 1),
        "ground_speed_mps": _known(math.hypot(latest("vel_north_mps"), latest("vel_east_mps")), 1),
        "soc": _known(soc, 3),
        "wind_mps": _known(wind, 1),
        "item": _known(latest("mission_item"), 0),
        "link": "silent" if silent_s > _SILENT_S else f"{100 * (1 - vehicle.peer.loss):.0f} %",
        "doubts": [f"{name}: {why}" for name, why in vehicle.live.doubts.items()],
    }


def _known(value: float, digits: int) -> float | None:
    return None if math.isnan(value) else round(value, digits)


def _shown(value: object) -> str:
    return "unknown" if value is None else str(value)


def _table(connection: Connection, vehicles: dict[int, MavlinkVehicle]) -> Table:
    table = Table()
    rows = [_row(connection, vehicles[system]) for system in sorted(vehicles)]
    for name in rows[0] if rows else ("waiting for a heartbeat",):
        table.add_column(name)
    for row in rows:
        table.add_row(*(_shown(value) if not isinstance(value, list) else "; ".join(value) for value in row.values()))
    return table
