"""On the ground: the next flight of the work, its charge and take-off time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import Decided, WorkBegun
from skyway.link.supervisor.legs import Leg
from skyway.link.supervisor.observed.link_watch import ASK_AGAIN_S, ASK_FOR_S, request_telemetry, rest, unanswered
from skyway.link.supervisor.soc.modelled_use import ModelledUse
from skyway.link.supervisor.states import State, Turn
from skyway.link.supervisor.work.task import Known
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.work.task import WorkFlight, WorkPlanner
    from skyway.models.composition.service import DroneService

ENOUGH_SOC = 0.012
"""Tolerance of a charge reported in whole percent."""
MAX_TURNED_BACK = 3
WAITS_S = 30.0
"""A take-off that is planned later than this is waited for, s."""
LOOK_AGAIN_S = 300.0


class PlannedUse(ModelledUse):
    """Modelled charge of a flight of the work so far: by its progress, not by its time."""

    def hear(self, time_s: float, velocity: tuple[float, float], wind: tuple[float, float]) -> None:
        """Ignore time: see `reach`."""

    def reach(self, soc: float) -> None:
        """Set the modelled use at the present progress."""
        self.soc = soc


def planner_of(ctx: Context) -> WorkPlanner:
    """Return the planner of the work."""
    if ctx.job.work is None:
        raise Turn(State.STOPPED, "there is no work to plan")
    return ctx.job.work


def known_now(ctx: Context, *, by_hour: bool) -> Known:
    """Return the information on the ground."""
    forecast = ctx.wind.forecast_by_hour() if by_hour else ctx.wind.forecast(ctx.now_s, now=True)
    return Known(time_s=ctx.now_s, soc=ctx.battery.soc, forecast=forecast, belief=ctx.energy.belief)


def deciding(ctx: Context) -> After:
    """Plan the remaining work with present information; then charge, wait, or prepare the next flight."""
    if ctx.conversation.stays:
        return State.STOPPED, f"stopped at {ctx.delivery.station} as ordered: the drone stands disarmed"
    _look(ctx)
    if ctx.work.turned_back >= MAX_TURNED_BACK:
        return (
            State.STOPPED,
            (
                f"{MAX_TURNED_BACK} flights in a row turned back without any work done: the drone needs more energy than its model says. "
                "Check the drone, then continue with --resume"
            ),
        )
    planner = planner_of(ctx)
    plan_with = planner.plan if ctx.job.replanning else planner.as_cut
    try:
        plan = plan_with(ctx.vehicle.family, ctx.work.begin, known_now(ctx, by_hour=True))
    except InputError as error:
        return State.STOPPED, f"the remaining work cannot be flown from {ctx.delivery.station}: {error}"
    ctx.delivery.take_plan(plan.composition)
    flight = planner.flight(ctx.vehicle.family, plan.span, known_now(ctx, by_hour=False))
    ctx.work.take(flight)
    lacks = plan.charge_to > ctx.battery.soc + (ENOUGH_SOC if ctx.delivery.charged else 1e-3)
    has_pad = planner.pad_of(ctx.delivery.station) is not None
    ctx.delivery.prepare(flight.diverts, plan.charge_to if lacks and has_pad else None)
    waits = not lacks and plan.leave_s > ctx.now_s + WAITS_S
    action = "charge" if lacks else "wait" if waits else "continue"
    figures = dict(plan.figures) | {"wind_source": ctx.wind.source, "soc_source": ctx.battery.source}
    ctx.note(Decided(action=action, where="ground", figures=figures), plan.said)
    ctx.tell(f"{action}: {plan.said}")
    if lacks and not has_pad:
        return (
            State.STOPPED,
            f"{percent(plan.charge_to)} of charge is needed, the battery has {percent(ctx.battery.soc)}, and {ctx.delivery.station} has no pad",
        )
    ctx.note_plan(plan.said)
    if lacks:
        return State.WAITING, f"charge to {percent(plan.charge_to)}"
    if waits:
        rest(ctx)
        ctx.wait_until(min(plan.leave_s, ctx.now_s + LOOK_AGAIN_S))
        return State.REPLANNING, "the wait is over: deciding again"
    return State.PREFLIGHT, plan.said


def _look(ctx: Context) -> None:
    """Wait until position and charge are known; missing data are requested again."""
    unknown, end = "the drone does not report its position or its state of charge", ctx.clock.now_s() + ASK_FOR_S
    while True:
        station = ctx.delivery.station or ctx.here_station()
        ctx.delivery.stand_at(station)
        if station is not None and math.isfinite(ctx.battery.soc):
            return
        if ctx.clock.now_s() >= end:
            raise Turn(State.STOPPED, unknown)
        unanswered(ctx, unknown)
        request_telemetry(ctx)
        ctx.wait(ASK_AGAIN_S)


def next_flight(ctx: Context) -> tuple[DroneService, WorkFlight]:
    """Return the next flight, as a service and as a mission."""
    plan, flight = ctx.delivery.plan, ctx.work.flight
    if plan is None or not plan.services or flight is None:
        raise Turn(State.STOPPED, f"the work has no flight from {ctx.delivery.station or 'here'}")
    return plan.services[0], flight


def leg_of(ctx: Context, flight: WorkFlight) -> Leg:
    """Return a flight as a leg for supervision."""
    use = PlannedUse(per_s=flight.modelled_soc / max(flight.planned_s, 1.0), fixed=0.0)
    return Leg(
        origin=flight.origin,
        destination=flight.destination,
        via=(),
        diverts=flight.diverts,
        mission=flight.mission,
        commanded_mps=flight.speed_mps,
        planned_s=flight.planned_s,
        planned_soc=ctx.battery.soc - flight.modelled_soc * ctx.energy.belief.mean_ratio,
        planned_soc_sd=flight.soc_sd,
        modelled=use,
    )


def note_begun(ctx: Context) -> None:
    """Journal the flight of the work that is about to begin."""
    flight = ctx.work.flight
    if flight is None:
        return
    ctx.work.begin_flight()
    begin, end = flight.span.begin or (None, None), flight.span.end or (None, None)
    entry = WorkBegun(begin_point=begin[0], begin_pad=begin[1], end_point=end[0], end_pad=end[1])
    ctx.note(entry, f"the work from {flight.origin} to {flight.destination}")
