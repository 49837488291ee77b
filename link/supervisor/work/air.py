"""In the air: if the rest of the flight does not keep the reserve, leave the work earlier, at a place from which it continues exactly."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.flight.turn import turn
from skyway.link.supervisor.journal.entries import Decided, Uploaded, WorkDone, WorkTurned
from skyway.link.supervisor.journal.parts import Expected
from skyway.link.supervisor.legs import cross_track_m
from skyway.link.supervisor.states import State, Turn
from skyway.link.supervisor.work.ground import PlannedUse, known_now, planner_of
from skyway.link.supervisor.work.progress import reached
from skyway.link.supervisor.work.task import Aloft, Judgement
from skyway.models.base.errors import LinkError, VehicleTimeoutError
from skyway.models.base.formatting import duration, percent, probability

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.missions.recharge.spans import Span

LEAVES = 0.01
"""Least probability of missing the reserve at which it leaves earlier; or that of the plan, if greater: it took off
with no greater one, and measurements in flight have noise."""
CLEARLY = 0.5
"""Greatest ratio of that probability with and without leaving earlier."""
HOPELESS = 0.1
"""Least probability of missing the reserve at which it flies straight to a pad, which repeats some pictures."""


def look(ctx: Context) -> After | None:
    """Judge the rest of the flight, and leave the work earlier if it would not keep the reserve; None continues the flight."""
    aloft = _aloft(ctx)
    leg = ctx.delivery.leg
    if aloft is None or leg is None:
        return None
    planner, family = planner_of(ctx), ctx.vehicle.family
    first = planner.judge(family, aloft)
    if isinstance(leg.modelled, PlannedUse):
        flight = ctx.work.flight
        whole = first.left_soc if flight is None else flight.modelled_soc
        leg.modelled.reach(max(whole - first.left_soc, 0.0))
    aloft = replace(aloft, belief=ctx.energy.now(leg, ctx.battery.soc))
    judged = planner.judge(family, aloft)
    _expect(ctx, judged)
    if not ctx.job.replanning or judged.p_below <= max(planner.epsilon, LEAVES):
        return None
    found = planner.earlier(family, aloft, judged)
    if found is None or found[1].p_below > CLEARLY * judged.p_below:
        return _to_refuge(ctx, aloft, judged)
    span, then = found
    reason = (
        f"landing at {leg.destination} with {percent(judged.soc_land)} would be below the reserve with probability {probability(judged.p_below, 1)}:"
        f" leaving the work earlier, landing with {percent(then.soc_land)} in {duration(then.left_s)} (probability {probability(then.p_below, 1)})"
    )
    figures = {
        "p_below_reserve": judged.p_below, "soc_land": judged.soc_land, "left_s": judged.left_s,
        "then_p_below_reserve": then.p_below, "then_soc_land": then.soc_land, "then_left_s": then.left_s,
        "energy_factor": aloft.belief.mean_ratio,
    }  # fmt: skip
    ctx.note(Decided(action="leave", where="flight", figures=figures), reason)
    ctx.tell(f"leave: {reason}")
    return leave_at(ctx, span, aloft.item)


def _to_refuge(ctx: Context, aloft: Aloft, judged: Judgement) -> After | None:
    """Fly straight to a pad if no place ahead helps, and the reserve would be missed; None continues the flight."""
    found = planner_of(ctx).refuge(aloft)
    if found is None or judged.p_below < HOPELESS or found[1].p_below > CLEARLY * judged.p_below:
        return None
    station, then = found
    reason = (
        f"landing at {aloft_end(ctx)} with {percent(judged.soc_land)} would be below the reserve with probability {probability(judged.p_below, 1)}:"
        f" straight to {station}, landing with {percent(then.soc_land)} (probability {probability(then.p_below, 1)})"
    )
    ctx.note(Decided(action="divert", where="flight", figures={"p_below_reserve": judged.p_below}), reason)
    ctx.tell(f"divert: {reason}")
    leg = ctx.delivery.leg
    if leg is not None:  # a repetition would give the same result: the energy of this way is learnt
        ctx.energy.keep(leg, ctx.battery.soc)
        leg.learn_nothing()
    ctx.work.turn_back()
    ctx.divert.to(station)
    return State.DIVERTING, reason


def aloft_end(ctx: Context) -> str:
    """Landing place of the current flight."""
    return "the end" if ctx.work.flight is None else ctx.work.flight.destination


def advance(ctx: Context) -> None:
    """Record the progress of the work; each point is journaled once."""
    flight, item, place = ctx.work.flight, _item(ctx), ctx.place
    if flight is None or item is None or place is None:
        return
    planner = planner_of(ctx)
    before = planner.point_at(ctx.work.done)
    ctx.work.advance(reached(flight, item, place))
    done = ctx.work.done
    if done is not None and planner.point_at(done) > before:
        ctx.note(WorkDone(step=done[0], share=done[1]), f"the work is done as far as point {planner.point_at(done)}")


def _item(ctx: Context) -> int | None:
    """Return the current item, in our numbering; None if unknown, or another mission is flown."""
    flight, s = ctx.work.flight, ctx.observed.sample
    if flight is None or s is None or not math.isfinite(s.mission_item) or ctx.vehicle.mode != "mission":
        return None
    item = int(s.mission_item) - ctx.vehicle.family.home_items
    return item if 0 <= item < len(flight.reaches) else None


def _aloft(ctx: Context) -> Aloft | None:
    """Return the information in flight; None if incomplete."""
    flight, s, place, item = ctx.work.flight, ctx.observed.sample, ctx.place, _item(ctx)
    if flight is None or s is None or place is None or item is None or not math.isfinite(ctx.battery.soc + s.height_m):
        return None
    return Aloft(
        time_s=ctx.now_s,
        soc=ctx.battery.soc,
        forecast=ctx.wind.forecast(ctx.now_s),
        belief=ctx.energy.now(ctx.delivery.leg, ctx.battery.soc),
        span=flight.span,
        item=item,
        done=ctx.work.done,
        place=place,
        height_m=s.height_m,
    )


def _expect(ctx: Context, judged: Judgement) -> None:
    """Store the expectation with the leg."""
    leg, place = ctx.delivery.leg, ctx.place
    if leg is None or place is None:
        return
    leg.expect(
        Expected(
            destination=leg.destination,
            left_s=judged.left_s,
            late_s=ctx.now_s - leg.start_s + judged.left_s - leg.planned_s,
            soc_land=judged.soc_land,
            planned_soc_land=leg.planned_soc,
            p_below_reserve=judged.p_below,
            cross_track_m=cross_track_m(leg.mission.way, *place),
            commanded_mps=leg.commanded_mps,
            energy_factor=ctx.energy.now(leg, ctx.battery.soc).mean_ratio,
        )
    )


def leave_at(ctx: Context, span: Span, item: int) -> After | None:
    """Change the mission in flight so that it leaves the work at another place: all before that stays unchanged."""
    leg, planner = ctx.delivery.leg, planner_of(ctx)
    if leg is None or ctx.work.flight is None or ctx.place is None:
        return None
    flight = planner.flight(ctx.vehicle.family, span, known_now(ctx, by_hour=False))
    ctx.work.intend(span)
    ctx.note(_turned(span, begun=True), f"leaving the work on the way to {flight.destination}")
    try:
        outcome = ctx.vehicle.change_in_flight(
            flight.mission.document.mission, item, holds=not ctx.vehicle.family.takes_uploads_whole
        )
    except VehicleTimeoutError as error:
        raise Turn(State.LOST_LINK, f"the link was lost while the mission was changed: {error}") from error
    except LinkError as error:
        return _to_pad(ctx, flight.destination, str(error))
    ctx.note(Uploaded(part="mission", verified=outcome.verified, attempts=outcome.attempts), str(outcome))
    if not outcome.verified:
        return _to_pad(ctx, flight.destination, str(outcome))
    ctx.vehicle.changes()
    ctx.work.take(flight)
    ctx.work.intend(None)
    changed = replace(
        leg, destination=flight.destination, mission=flight.mission, diverts=flight.diverts, lookahead=None
    )
    ctx.delivery.take_leg(changed)
    ctx.note(_turned(span, begun=False), f"leaving the work earlier, landing at {flight.destination}")
    return None


def _to_pad(ctx: Context, station: str, why: str) -> After:
    """Fly to the pad by a separate mission, or by reposition: the vehicle's mission is now unknown."""
    ctx.note(WorkTurned(verified=False), f"the mission could not be changed: {why}")
    ctx.divert.to(station)
    return turn(ctx, station, State.DIVERTING)


def _turned(span: Span, *, begun: bool) -> WorkTurned:
    end = span.end or (None, None)
    return WorkTurned(point=end[0], pad=end[1], begun=begun)
