"""Remote ID of a delivery: the operator's data are sent continuously, and the status of the module is reported and journaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import RemoteIdNote
from skyway.link.vehicle.remote_id import ModuleStatus, RemoteIdSender, module_status

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context

PATIENCE_S = 8.0
"""Time after which missing data are reported, s: a module without any input yet reports everything as missing."""


@dataclass(slots=True)
class RemoteIdWatch:
    """The Remote ID module of one delivery; written only by its own methods."""

    _sender: RemoteIdSender | None = None
    _reported: ModuleStatus | None = None
    _begun_s: float = field(default=0.0)

    def begin(self, ctx: Context) -> None:
        """Send the operator's identity from now on, if one is given."""
        vehicle, who = ctx.vehicle, ctx.job.remote_id
        self._begun_s = vehicle.connection.clock.now_s()
        if who.given and self._sender is None:
            self._sender = RemoteIdSender(vehicle.connection, vehicle.peer, who)
            self._sender.begin()

    def end(self) -> None:
        """Stop sending."""
        if self._sender is not None:
            self._sender.end()

    def status(self, ctx: Context) -> ModuleStatus:
        """Return the status that the module broadcasts."""
        return module_status(ctx.vehicle.peer, ctx.vehicle.connection.clock.now_s())

    def watch(self, ctx: Context) -> None:
        """Report when the module appears, disappears, or changes its error status."""
        found = self.status(ctx)
        young = ctx.vehicle.connection.clock.now_s() < self._begun_s + PATIENCE_S
        if found == self._reported or (young and not found.ready):
            return
        first, self._reported = self._reported is None, found
        who = ctx.job.remote_id
        entry = RemoteIdNote(
            heard=found.heard, ready=found.ready, lacks=found.lacks or None, operator=who.operator_id or None,
            self_id=who.self_id or None,
        )  # fmt: skip
        if first and not found.heard and not who.given:
            ctx.note(entry, str(found))  # not requested: the checklist before the take-off states it
        else:
            ctx.say(entry, str(found))
