"""Meeting the vehicle at the beginning: who it is, where it is, what it holds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.observed.link_watch import must_answer, request_telemetry
from skyway.link.supervisor.resume import resume
from skyway.link.supervisor.states import State, Turn
from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

KNOWN_S = 45.0
"""So long we wait for position, charge and whether it is armed."""
LOOK_AGAIN_S = 15.0
"""What would end a delivery before it has begun is looked at for so long."""


def connecting(ctx: Context) -> After:
    """Meet it; for the first time it must stand disarmed where the plan begins."""
    _meet(ctx)
    must_answer(ctx, "it does not say who it is")
    who = ctx.vehicle.identify()
    ctx.observed.restarted(ctx.vehicle.reboots)
    if ctx.delivery.resumed:
        return resume(ctx, who)
    ctx.observed.identify(who.uid)
    ctx.note("vehicle", str(who), system=who.system, autopilot=who.autopilot, uid=who.uid)
    ctx.tell(str(who))
    origin = ctx.job.composition.origin
    end = ctx.clock.now_s() + LOOK_AGAIN_S
    while not (ctx.on_ground and ctx.here_station() == origin) and ctx.clock.now_s() < end:
        ctx.tick()
    if not ctx.on_ground:
        armed = State.LEFT if ctx.vehicle.armed else State.STOPPED
        return State.HOLDING if ctx.in_air else armed, "the vehicle does not stand disarmed on the ground"
    station = ctx.here_station()
    ctx.delivery.stand_at(station)
    if station != origin:
        return State.STOPPED, f"the vehicle stands at {station or 'no station'}, and the plan begins at {origin}"
    ctx.delivery.take_plan(ctx.job.composition)
    ctx.delivery.visit(origin)
    ctx.note_plan("the plan as given")
    return State.REPLANNING, f"at {origin} with {percent(ctx.battery.soc)}"


def _meet(ctx: Context) -> None:
    """Wait until position, charge, and whether it is armed and landed are known."""
    request_telemetry(ctx)
    end = ctx.clock.now_s() + KNOWN_S
    asked = ctx.clock.now_s()
    while ctx.clock.now_s() < end:
        ctx.tick()
        s = ctx.observed.sample
        if s is not None and ctx.place is not None and all(map(math.isfinite, (s.armed, s.landed, ctx.battery.soc))):
            return
        if ctx.clock.now_s() > asked + 10.0:
            must_answer(ctx, "it does not send what it is asked for")
            asked = ctx.clock.now_s()
            request_telemetry(ctx)
    s = ctx.observed.sample
    lacking = ["position"] if ctx.place is None else []
    if not math.isfinite(ctx.battery.soc):
        lacking.append("state of charge")
    if s is None or not math.isfinite(s.armed + s.landed):
        lacking.append("whether it is armed and landed")
    raise Turn(State.STOPPED, f"the vehicle does not tell its {', its '.join(lacking)}")
