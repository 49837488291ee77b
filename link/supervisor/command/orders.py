"""Commands in the air: which are possible now, and the effect of each. The console and the page use the same words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.flight.call_off import UNDELIVERED, call_off
from skyway.link.supervisor.flight.turn import intend
from skyway.link.supervisor.journal.entries import Ordered
from skyway.link.supervisor.states import IN_AIR, ON_GROUND, State
from skyway.models.base.errors import LinkError

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.operators import Said

DEFERRED = ("pause", "go", "divert", "return", "land", UNDELIVERED)
"""Commands that are executed at the next step of the flight; `stay` and `leave` take effect at once."""


def offered(ctx: Context) -> tuple[str, ...]:
    """Return the commands that the operator may type now; one for each station to which the drone can be sent."""
    from skyway.link.pads import ManualPads

    talk = ctx.conversation
    if talk.question is not None:
        return talk.answers
    if ctx.state is State.HOLDING:
        return ("go", "land", "leave") if ctx.in_air else ("go", "leave")
    if ctx.state in IN_AIR:
        return _in_the_air(ctx)
    words = ("go",) if talk.stays else ("stay",)
    if ctx.state is State.LOST_LINK:
        return ("leave",)
    if ctx.state is State.CHARGING and isinstance(ctx.pads, ManualPads):
        return ("charged", *words)
    return words if ctx.state in (State.CONNECTING, State.ARMING, State.LANDED, *ON_GROUND) else ()


def _in_the_air(ctx: Context) -> tuple[str, ...]:
    leg, talk = ctx.delivery.leg, ctx.conversation
    if leg is None or leg.destination == "here" or ctx.delivery.plan is None:
        return ("leave",)
    words = ["go" if ctx.stands_in_air or talk.stays else "stay", *(() if talk.paused else ("pause",))]
    if ctx.stands_in_air and not talk.stays:
        words.append("stay")
    if leg.origin and leg.origin != leg.destination:
        words.append("return")
    if ctx.delivery.onward is None and ctx.job.request.payload_kg > 0.0:
        words.append(UNDELIVERED)
    return (*words, *(f"divert {name}" for name in refuges(ctx)), "land", "leave")


def refuges(ctx: Context) -> tuple[str, ...]:
    """Return the stations to which the drone can be sent now: those inside its fence, including the planned one."""
    leg, plan = ctx.delivery.leg, ctx.delivery.plan
    if leg is None or plan is None:
        return ()
    planned = (plan.services[0].destination,) if plan.services else ()
    known = ctx.job.scenario.network.index
    names = dict.fromkeys((*planned, *leg.diverts, *leg.via, leg.origin))
    return tuple(name for name in names if name in known and name != leg.destination)


def matching(word: str, words: tuple[str, ...]) -> str | None:
    """Return the word that an input matches, or None; ``charged 83`` is ``charged`` with a value."""
    plain = " ".join(word.split()).casefold()
    if "charged" in words and plain.split(" ")[0] == "charged":
        return plain
    return next((one for one in words if one.casefold() == plain), None)


def obey(ctx: Context) -> After | None:
    """Execute the next pending command; None continues the flight."""
    said = ctx.conversation.next_order()
    leg = ctx.delivery.leg
    if said is None or leg is None:
        return None
    word, _, station = said.word.partition(" ")
    if word in ("pause", "go"):
        _hold(ctx, said, pauses=word == "pause")
        return None
    by = f"{said.name or 'the operator'} ordered it"
    if word == UNDELIVERED:
        return _call_off(ctx, by)
    _fly_again(ctx)
    ctx.conversation.ask_again(stays=word != "divert")
    leg.learn_nothing()
    if word == "land":
        ctx.divert.call_off()
        intend(ctx, None)
        return State.DIVERTING, f"landing where it is: {by}"
    station = leg.origin if word == "return" else station
    ctx.divert.to(station)
    return State.DIVERTING, f"diverting to {station}: {by}"


def _call_off(ctx: Context, by: str) -> After | None:
    """Divert the package to its destination for undelivered packages, or back. If the drone continues to its target, its hold, if any, stays."""
    after = call_off(ctx, refuges(ctx), by)
    if after is not None:
        _fly_again(ctx)
    return after


def _fly_again(ctx: Context) -> None:
    """Cancel a hold in the air: the drone is sent elsewhere."""
    ctx.conversation.pause(on=False)
    ctx.give_way.end()


def _hold(ctx: Context, said: Said, *, pauses: bool) -> None:
    """Hold the vehicle at its position, or continue."""
    leg = ctx.delivery.leg
    if leg is None or pauses is (ctx.conversation.paused if pauses else ctx.stands_in_air):
        return
    try:
        if pauses:
            ctx.vehicle.pause()
        else:
            ctx.vehicle.resume()
    except LinkError as error:
        ctx.say(Ordered(word=said.word, id=said.id or None, done="failed"), f"{said.word} was not carried out: {error}")
        return
    ctx.conversation.pause(on=pauses)
    if not pauses:
        ctx.give_way.overrule()
    leg.learn_nothing()  # the energy of a hover is no measure for flights
    leg.command(leg.commanded_mps, ctx.now_s)
    word = "the drone has stopped, and is still supervised" if pauses else "the drone flies on"
    ctx.say(Ordered(word=said.word, id=said.id or None, done="done"), word)
