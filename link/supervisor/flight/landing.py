"""Actions after a landing: determine the station, learn from the energy of the flight, hand over the package."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.flight.crash import crash_end
from skyway.link.supervisor.journal.entries import Landed, ReleaseNote
from skyway.link.supervisor.journal.standing import standing
from skyway.link.supervisor.observed.link_watch import ask, must_answer, request_telemetry
from skyway.link.supervisor.onward import after_failure, after_hand_over, arrived
from skyway.link.supervisor.states import State
from skyway.link.supervisor.work.landing import after_flight, settle_use
from skyway.models.base.errors import LinkError
from skyway.models.base.formatting import percent, place_text
from skyway.models.composition.release import hovers

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

RELEASES = 3
PLACE_S = 90.0
"""Time over which a station is looked for at the place of a landing, s: longer than a position may be wrong."""


def after_landing(ctx: Context) -> After:
    """Locate the drone after a landing, learn from the energy used, and continue from there."""
    leg = ctx.delivery.leg
    ctx.vehicle.watch_lists(watched=False)
    ctx.conversation.end_flight()
    ctx.give_way.end()
    ctx.wait(3.0)
    if ctx.in_air:
        return State.HOLDING, "the drone is in the air again"
    request_telemetry(ctx)
    if not _found(ctx):
        return State.HOLDING, "the drone is in the air again"
    flown_s = 0.0 if leg is None or not math.isfinite(leg.start_s) else ctx.now_s - leg.start_s
    crash = crash_end(ctx, ctx.clock.now_s() - flown_s)
    if crash is not None:
        return crash
    if ctx.place is None:
        must_answer(ctx, "the drone has landed and does not answer")
        return State.HOLDING, "the drone has landed and does not report its position: search at the end of its track"
    station = ctx.here_station()
    ctx.delivery.stand_at(station)
    settle_use(ctx, station)
    if leg is not None and math.isfinite(leg.soc_start) and leg.learns:
        ctx.energy.learn(ctx, leg)
    where = station or place_text(*ctx.place)
    planned = leg is not None and station == leg.destination
    if ctx.delivery.landed_at is None or leg is not None:
        _note_landing(ctx, where, planned=planned)
    if station is None:
        return State.ENDED_ELSEWHERE, f"the drone stands disarmed at {where}, away from any station: fetch it there"
    ctx.delivery.visit(station)
    ctx.delivery.reach(station)
    ctx.delivery.take_leg(None)
    if ctx.job.work is not None:
        return after_flight(ctx, station, leg)
    onward = ctx.delivery.onward
    if onward is None and station == ctx.job.request.destination:
        return _deliver(ctx) if ctx.job.hands_over else (State.DELIVERED, f"the drone stands disarmed at {station}")
    if onward is not None and station == onward.destination:
        return arrived(ctx, onward)
    if ctx.conversation.stays:
        return (
            State.STOPPED,
            f"stopped at {station} as ordered: the drone stands disarmed; --resume continues the delivery",
        )
    return State.REPLANNING, f"at {station}"


def _found(ctx: Context) -> bool:
    """Determine the station at the drone's position; return whether it has landed at all."""
    end = ctx.clock.now_s() + PLACE_S
    while ctx.here_station() is None and not ctx.in_air and ctx.clock.now_s() < end:
        ctx.tick()
    return not ctx.in_air


def _note_landing(ctx: Context, where: str, *, planned: bool) -> None:
    """Record the end of a flight; once, however often the drone is found there."""
    leg = ctx.delivery.leg
    ctx.delivery.note_landing(ctx.delivery.station or where)
    ctx.say(
        Landed(
            soc=ctx.battery.soc,
            planned=planned,
            planned_soc=math.nan if leg is None else leg.planned_soc,
            planned_s=math.nan if leg is None else leg.planned_s,
            flight_s=math.nan if leg is None else ctx.now_s - leg.start_s,
            standing=standing(ctx),
        ),
        f"landed at {where} with {percent(ctx.battery.soc)}",
    )


def _deliver(ctx: Context) -> After:
    """Release the package, by the gripper or by a person who confirms it."""
    destination = ctx.job.request.destination
    ctx.proof.before_release(ctx)
    if ctx.proof.lost:
        return after_failure(ctx, f"at {destination} without the package: {ctx.proof.verdict[1]}", loaded=False)
    if hovers(ctx.job.options.release):
        why = f"landed at {destination}, where the package should have been released in the air: it is still on board"
        return after_failure(ctx, why, loaded=True)
    if ctx.job.options.release == "gripper":
        refused = _release(ctx)
        if refused:
            return after_failure(ctx, f"at {destination}, but the gripper did not open: {refused}", loaded=True)
        ctx.note(ReleaseNote(), "the gripper is open")
    else:
        if not _taken_off(ctx, destination):
            return after_failure(ctx, f"at {destination}, but nobody took the package off", loaded=True)
        ctx.note(ReleaseNote(), "a person took the package off")
        ctx.proof.released(ctx, acknowledged=True, by_person=True)
    return after_hand_over(ctx, f"delivered at {destination}")


def _taken_off(ctx: Context, destination: str) -> bool:
    """Wait until a person confirms that the package is off; or, if it has a way on, that nobody takes it."""
    way = ctx.job.composition.way_back
    if way is None or way.undelivered is None:
        ctx.conversation.answer(ctx, f"take the package off at {destination}, then type done", ("done",))
        return True
    question = f"take the package off at {destination}, then type done; type undelivered to send it to {way.undelivered.destination}"
    return ctx.conversation.answer(ctx, question, ("done", "undelivered")) == "done"


def _release(ctx: Context) -> str:
    """Open the gripper; return why that was not possible, or an empty string."""
    refused = ""
    for _ in range(RELEASES):
        try:
            ask(ctx, ctx.vehicle.release)
        except LinkError as error:
            refused = str(error)
            ctx.note(ReleaseNote(), f"the gripper did not open: {refused}")
            ctx.wait(2.0)
        else:
            ctx.proof.released(ctx, acknowledged=True)
            return ""
    ctx.proof.released(ctx, acknowledged=False)
    return refused
