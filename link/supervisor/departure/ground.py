"""What is decided on the ground: where to fly next, with how much charge, and when."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.context import ASK_AGAIN_S, ASK_FOR_S
from skyway.link.supervisor.legs import with_places
from skyway.link.supervisor.states import State, Turn
from skyway.models.base.errors import InputError, LinkError
from skyway.planner.online.replan import Decision, Grounded

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context

POLL_S = 10.0
_UNUSABLE_S = 900.0
"""A station that could not be used is not tried again for so long."""


def replanning(ctx: Context) -> After:
    """Decide where to fly next, with how much charge, and when."""
    if ctx.stop_after_leg:
        return State.STOPPED, f"the operator asked to stay at {ctx.station}"
    standing = _standing(ctx)
    planner = ctx.replanner()
    forecast = ctx.wind.forecast(ctx.now_s, now=True)
    if ctx.job.replanning is None:
        decision = _as_planned(ctx, standing)
    else:
        decision = planner.decide(standing, ctx.plan, forecast, ctx.belief)
    figures = dict(decision.figures) | {"wind_source": ctx.wind.source, "soc_source": ctx.soc_source}
    ctx.note("decision", decision.reason, action=decision.action, where="ground", **figures)
    ctx.tell(f"{decision.action}: {decision.reason}")
    if decision.composition is not None:
        ctx.plan = with_places(decision.composition, ctx.job.scenario, decision.diverts)
    ctx.diverts, ctx.charge_to = decision.diverts, decision.charge_to
    if decision.action == "stop":
        return _stopped(ctx, decision)
    ctx.note_plan(decision.reason)
    if decision.action == "wait":
        ctx.wait_until(max(decision.until_s or 0.0, ctx.now_s + POLL_S))
        return State.REPLANNING, "the wait is over"
    if decision.charge_to is not None:
        return State.WAITING, f"charge to {100 * decision.charge_to:.0f} %"
    return State.PREFLIGHT, decision.reason


def _stopped(ctx: Context, decision: Decision) -> After:
    """Give stations that could not be used another chance before giving up."""
    if not ctx.unusable:
        return State.STOPPED, decision.reason
    ctx.wait_until(POLL_S + min(ctx.unusable.values(), default=ctx.now_s) + _UNUSABLE_S)
    return State.REPLANNING, "stations that could not be used may be usable again"


def _look_again(ctx: Context) -> str:
    """Return where it stands, once that and its charge are known; what is not told is asked for again."""
    unknown, end = "where the vehicle stands, or its state of charge, is not known", ctx.clock.now_s() + ASK_FOR_S
    while True:
        ctx.station = ctx.station or ctx.here_station()
        if ctx.station is not None and math.isfinite(ctx.soc):
            return ctx.station
        if ctx.clock.now_s() >= end:
            raise Turn(State.STOPPED, unknown)
        ctx.unanswered(unknown)
        ctx.request_telemetry()
        ctx.wait(ASK_AGAIN_S)


def _standing(ctx: Context) -> Grounded:
    """What is known where the drone stands."""
    ctx.unusable = {name: since for name, since in ctx.unusable.items() if ctx.now_s < since + _UNUSABLE_S}
    station = _look_again(ctx)
    busy: dict[str, int] = {}
    ahead = () if ctx.plan is None else tuple(service.destination for service in ctx.plan.services[:3])
    for name in (station, *ahead):
        try:
            status = ctx.pads.status(name)
        except (LinkError, InputError):
            continue
        busy[name] = status.busy
        full = status.busy >= status.pads and status.holding_free == 0 and status.pads > 0
        if full and name != ctx.station and ahead and name == ahead[0]:
            ctx.unusable[name] = ctx.now_s
    return Grounded(
        station,
        ctx.now_s,
        ctx.soc,
        frozenset(ctx.visited),
        busy,
        frozenset(ctx.unusable),
        planned_soc=_planned(ctx),
    )


def _planned(ctx: Context) -> float | None:
    """Charge that the present plan leaves with here."""
    if ctx.charge_to is not None:
        return ctx.charge_to
    stops = () if ctx.plan is None else ctx.plan.stops
    return next((stop.soc_to for stop in stops if stop.station == ctx.station and stop.recharge_s > 0.0), None)


def _as_planned(ctx: Context, standing: Grounded) -> Decision:
    """Fly the plan as it is, whatever comes: what supervision is compared with."""
    if ctx.plan is None:
        return Decision("stop", "there is no plan from here")
    service = ctx.plan.services[0]
    stop = next((s for s in ctx.plan.stops if s.station == service.origin), None)
    target = stop.soc_to if stop is not None and stop.soc_to > standing.soc + 0.01 and not ctx.charged else None
    return Decision("continue", f"as planned to {service.destination}", {}, ctx.plan, service.destination, None, target,
                    service.diverts or (service.origin,))  # fmt: skip
