"""Other ground stations on our link (``--forward``): what they order, and what they are refused, told and written down."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import ClientNote

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context


def tell_clients(ctx: Context) -> None:
    """Tell what was noticed of them since this was asked last."""
    forwarder = ctx.vehicle.connection.forwarder
    for note in () if forwarder is None else forwarder.notes():
        entry = ClientNote(
            client=note.client, system=note.system, component=note.component, what=note.what, order=note.order
        )
        ctx.say(entry, note.said)
