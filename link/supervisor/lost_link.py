"""Lost link: the supervisor sends no commands and listens until the vehicle answers again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.departure.failsafes import left_words
from skyway.link.supervisor.journal.entries import LinkNote
from skyway.link.supervisor.observed.link_watch import request_telemetry
from skyway.link.supervisor.resume import take_up
from skyway.link.supervisor.states import IN_AIR, State
from skyway.models.base.errors import VehicleTimeoutError
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

BACK_S = 3.0
"""A vehicle heard within this time is in contact again, s."""


def lost_link(ctx: Context) -> After:
    """Listen until the vehicle is heard and answers again, then determine its state."""
    before = ctx.status.before
    alone = f"without the link {left_words(ctx)}" if before in IN_AIR else "the drone was on the ground"
    ctx.tell(f"link lost: {alone}. Sending no commands; listening until the drone answers")
    begun = ctx.clock.now_s()
    strange: set[int] = set()
    while True:
        ctx.tick()
        if ctx.vehicle.silent_s >= BACK_S or not ctx.vehicle.answers() or not _is_ours(ctx, strange):
            continue
        try:
            return _found_again(ctx, before, ctx.clock.now_s() - begun)
        except VehicleTimeoutError as error:
            ctx.note(LinkNote(), f"the link was lost again: {error}")


def _is_ours(ctx: Context, strange: set[int]) -> bool:
    """Whether what answers is the drone of this delivery; others, of the same system id, are told once, and kept in `strange`."""
    if not ctx.observed.uid:
        return True
    who = ctx.vehicle.identify()
    if ctx.observed.is_another(who.uid):
        if who.uid not in strange:
            strange.add(who.uid)
            ctx.say(
                LinkNote(),
                f"{who} answers, but is not the drone of this delivery: listening on; give each its own system id",
            )
        ctx.vehicle.connection.forget_address(ctx.vehicle.system)
    return who.uid == ctx.observed.uid


def _found_again(ctx: Context, before: State, gone_s: float) -> After:
    reason = f"the link is back after {duration(gone_s)}"
    ctx.say(LinkNote(gone_s=gone_s), reason)
    ctx.link.found_again()
    if before is State.CONNECTING:
        return State.CONNECTING, reason
    request_telemetry(ctx)
    ctx.wait(3.0)
    if before is State.HOLDING:
        return State.HOLDING, f"{reason}; somebody else had control before"
    return take_up(ctx)
