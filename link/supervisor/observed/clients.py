"""Other participants of the link: ground stations (``--forward``), radios, other aircraft; reported and journaled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import AircraftNear, ClientNote, LinkNote

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context


def tell_clients(ctx: Context) -> None:
    """Report the actions of other ground stations since the last call."""
    forwarder = ctx.vehicle.connection.forwarder
    for note in () if forwarder is None else forwarder.notes():
        entry = ClientNote(
            client=note.client, system=note.system, component=note.component, what=note.what, order=note.order
        )
        ctx.say(entry, note.said)


def tell_radios(ctx: Context) -> None:
    """Report when a radio falls silent or the radio in use changes; the new one may be another channel, on which nothing was requested yet."""
    radios = ctx.vehicle.connection.radios
    used = None if radios is None else radios.used
    for note in () if radios is None else radios.notes():
        ctx.say(LinkNote(), note)
        if used is not None and note.startswith(f"radio {used}"):
            ctx.vehicle.nudge_telemetry()


def tell_traffic(ctx: Context) -> None:
    """Report aircraft that have come near."""
    for one in ctx.vehicle.traffic.alerts():
        entry = AircraftNear(
            aircraft=one.name, lat=one.lat_deg, lon=one.lon_deg, away_m=one.away_m,
            above_m=None if math.isnan(one.above_m) else one.above_m,
        )  # fmt: skip
        ctx.say(entry, str(one))
