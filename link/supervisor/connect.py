"""Connection to the vehicle at the beginning: its identity, position and stored mission."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.flight.pilot_intervention import first_order
from skyway.link.supervisor.journal.entries import Met
from skyway.link.supervisor.observed.link_watch import must_answer, request_telemetry
from skyway.link.supervisor.resume import resume
from skyway.link.supervisor.states import State, Turn
from skyway.models.base.formatting import duration, percent

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

KNOWN_S = 45.0
"""Maximum wait for position, charge and arming state, s."""
TOLD_S = 3.0
"""Time after which such a wait is told, s."""
LOOK_AGAIN_S = 15.0
"""Wait after a fault that would end a delivery before its start, s; then the vehicle is checked again."""


def connecting(ctx: Context) -> After:
    """Connect to the vehicle; at the first start it must stand disarmed at the origin of the plan."""
    first_order(ctx)
    ctx.remote_id.begin(ctx)
    _meet(ctx)
    must_answer(ctx, "the drone does not answer when asked who it is")
    who = ctx.vehicle.identify()
    ctx.observed.restarted(ctx.vehicle.reboots)
    if ctx.delivery.resumed:
        return resume(ctx, who)
    ctx.observed.identify(who.uid)
    ctx.note(Met(system=who.system, autopilot=who.autopilot, uid=who.uid), str(who))
    ctx.tell(f"connected to {who}")
    origin = ctx.job.composition.origin
    end = ctx.clock.now_s() + LOOK_AGAIN_S
    while not (ctx.on_ground and ctx.here_station() == origin) and ctx.clock.now_s() < end:
        ctx.tick()
    if not ctx.on_ground:
        armed = State.LEFT if ctx.vehicle.armed else State.STOPPED
        if ctx.in_air:
            return State.HOLDING, "the drone is in the air already, on a flight that this delivery did not begin"
        return armed, f"the drone does not stand disarmed on the ground: disarm it at {origin}, then start again"
    station = ctx.here_station()
    ctx.delivery.stand_at(station)
    if station != origin:
        return State.STOPPED, _wrong_place(station, origin)
    ctx.delivery.take_plan(ctx.job.composition)
    ctx.delivery.visit(origin)
    ctx.note_plan("the plan from the file")
    return State.REPLANNING, f"at {origin} with {percent(ctx.battery.soc)}: decide on the next leg"


def _meet(ctx: Context) -> None:
    """Wait until position, charge, arming and landed state are known; what is waited for is told."""
    request_telemetry(ctx)
    begun_s = requested_s = ctx.clock.now_s()
    told = False
    while ctx.clock.now_s() < begun_s + KNOWN_S:
        ctx.tick()
        lacking = _lacking(ctx)
        if not lacking:
            return
        if not told and ctx.clock.now_s() > begun_s + TOLD_S:
            told = True
            ctx.tell(f"waiting for up to {duration(KNOWN_S)}: the drone does not report its {', its '.join(lacking)}")
        if ctx.clock.now_s() > requested_s + 10.0:
            must_answer(ctx, "the drone does not send the telemetry it was asked for")
            requested_s = ctx.clock.now_s()
            request_telemetry(ctx)
    remedy = "check GPS, battery monitor and radio, then start again"
    raise Turn(State.STOPPED, f"the drone does not report its {', its '.join(_lacking(ctx))}: {remedy}")


def _lacking(ctx: Context) -> list[str]:
    """What the drone has not reported yet, and must."""
    s = ctx.observed.sample
    lacking = ["position"] if ctx.place is None else []
    if not math.isfinite(ctx.battery.soc):
        lacking.append("state of charge")
    if s is None or not math.isfinite(s.armed + s.landed):
        lacking.append("armed and landed state")
    return lacking


def _wrong_place(station: str | None, origin: str) -> str:
    """Describe the fault if the vehicle does not stand at the origin of the plan."""
    where = "not at a known station" if station is None else f"at {station}"
    return f"the drone is {where}, and the plan begins at {origin}: bring it there, or plan from where it is"
