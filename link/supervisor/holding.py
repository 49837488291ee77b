"""Holding: somebody else has control; the supervisor monitors and sends no commands until the operator answers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.protocol.verified import kind_of
from skyway.link.supervisor.departure.failsafes import left_words
from skyway.link.supervisor.flight.crash import crash_end
from skyway.link.supervisor.journal.entries import OperatorNote
from skyway.link.supervisor.observed.link_watch import request_telemetry
from skyway.link.supervisor.resume import take_up
from skyway.link.supervisor.states import State
from skyway.models.base.errors import LinkError

if TYPE_CHECKING:
    from skyway.link.protocol.verified import Part
    from skyway.link.supervisor.context import After, Context

SHOWN = 5
"""Number of differences of a changed mission that are listed."""
WORDS = "go (take control, continue the delivery), land (land where it is) or leave (end the program)"


def holding(ctx: Context) -> After:
    """Send no commands; monitor, record, and continue only on the operator's answer."""
    ctx.conversation.forget()
    if ctx.link.resting:  # its present actions are seen within seconds, unlike at the resting rate
        request_telemetry(ctx)
    _tell_what_differs(ctx)
    if ctx.operator.present:
        ctx.operator.ask(f"sending no commands until you answer: {WORDS}")
    else:
        ctx.tell("sending no commands; nobody can answer, so the drone is watched until it stands disarmed")
    ground_s = math.nan
    while True:
        ctx.tick()
        word = ctx.conversation.next_word()
        after = None if word is None else _word(ctx, word)
        if after is not None:
            return after
        if ctx.operator.present:
            continue
        ground_s = (ctx.clock.now_s() if math.isnan(ground_s) else ground_s) if ctx.on_ground else math.nan
        if ctx.clock.now_s() - ground_s > 30.0:
            crash = crash_end(ctx, ctx.status.entered_s)
            if crash is not None:
                return crash
            station = ctx.here_station()
            ctx.delivery.stand_at(station)
            if station is None:
                where = "at an unknown position" if ctx.place is None else "away from any station"
                return State.ENDED_ELSEWHERE, f"somebody else landed the drone, {where}: fetch it there"
            return (
                State.STOPPED,
                f"somebody else landed the drone at {station}, and nobody can answer: start again with --resume",
            )


def _word(ctx: Context, word: str) -> After | None:
    ctx.note(OperatorNote(), f"the operator said {word}")
    if word == "leave":
        return State.LEFT, f"the operator ended the program; {left_words(ctx)}"
    if word == "land" and ctx.in_air:
        ctx.divert.call_off()
        return State.DIVERTING, "the operator ordered a landing where it is"
    if word == "go":
        return _go_on(ctx)
    ctx.operator.ask(f"not understood. Type {WORDS}")
    return None


def _tell_what_differs(ctx: Context) -> None:
    """List the differences if the vehicle flies, or is about to fly, another mission than ours."""
    leg = ctx.delivery.leg
    if not ctx.vehicle.take_lists_changed() or leg is None or ctx.divert.station is not None:
        return
    document = leg.mission.document
    parts: list[Part] = [document.mission]
    if document.fence:
        parts.append(document.fence)
    if len(document.rally):
        parts.append(document.rally)
    try:
        found = [(kind_of(part).word, difference) for part in parts for difference in ctx.vehicle.verify(part)]
        for word, difference in found[:SHOWN]:
            ctx.say(OperatorNote(), f"changed by somebody else: {word}, {difference}")
        if not found:
            ctx.tell("the drone still has what this delivery sent")
    except LinkError as error:
        ctx.tell(f"the change could not be read: {error}")


def _restored_turn(ctx: Context) -> bool:
    """Whether it was diverted before the program restarted: its mission is then not that of the leg, and unknown here."""
    leg = ctx.delivery.leg
    return ctx.divert.turned and leg is not None and leg.destination != ctx.divert.station


def _go_on(ctx: Context) -> After | None:
    """Resume control of the vehicle on the operator's answer."""
    ctx.vehicle.changes()
    if ctx.on_ground:
        return take_up(ctx)
    leg = ctx.delivery.leg
    if not ctx.in_air or leg is None or ctx.delivery.plan is None:
        ctx.operator.ask("the drone is not on a leg of this delivery: land it, then type go")
        return None
    try:
        if not _restored_turn(ctx) and ctx.vehicle.verify(leg.mission.document.mission):
            outcome = ctx.vehicle.upload(leg.mission.document.mission)
            if not outcome.verified:
                ctx.operator.ask(f"the mission of this delivery could not be sent again ({outcome}). Type {WORDS}")
                return None
        ctx.vehicle.resume()
        ctx.wait(3.0)
    except LinkError as error:
        ctx.operator.ask(f"control could not be taken: {error}. Type {WORDS}")
        return None
    ctx.vehicle.changes()
    ctx.conversation.pause(on=False)
    ctx.give_way.overrule()
    return (State.DIVERTING if ctx.divert.station is not None else State.FLYING), "the operator gave control back"
