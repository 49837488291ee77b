"""Resuming work: from its journal, and from the vehicle that flies it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import WorkBegun, WorkDone, WorkStands, WorkTurned
from skyway.link.supervisor.states import State
from skyway.link.supervisor.work.air import leave_at
from skyway.link.supervisor.work.ground import leg_of, planner_of
from skyway.link.supervisor.work.task import Known
from skyway.missions.recharge.spans import Span

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.journal.entries import LegBegun
    from skyway.link.supervisor.journal.file import Record
    from skyway.link.supervisor.legs import Leg


def restore_work(ctx: Context, record: Record) -> None:
    """Restore from a record of a journal, if it belongs to the work."""
    work = ctx.work
    if stands := record.entry(WorkStands):
        _stand(ctx, stands)
    elif begun := record.entry(WorkBegun):
        begin, end = _pair(begun.begin_point, begun.begin_pad), _pair(begun.end_point, begun.end_pad)
        _take(ctx, Span(begin, end), record.time_s)
        work.begin_flight()
    elif (done := record.entry(WorkDone)) and done.step is not None and done.share is not None:
        work.advance((done.step, done.share))
    elif (turned := record.entry(WorkTurned)) and work.flight is not None and turned.begun is not None:
        span = Span(work.flight.span.begin, _pair(turned.point, turned.pad))
        if turned.begun:
            work.intend(span)
        else:
            _take(ctx, span, record.time_s)


def _pair(point: int | None, pad: int | None) -> tuple[int, int] | None:
    return None if point is None or pad is None else (point, pad)


def _stand(ctx: Context, entry: WorkStands) -> None:
    pad = planner_of(ctx).pad_of(entry.pad)
    if entry.finished:
        ctx.work.finish()
    elif entry.point is None or pad is None:
        ctx.work.back_at_start()
    else:
        ctx.work.stand(entry.point, pad)


def _take(ctx: Context, span: Span, time_s: float) -> None:
    known = Known(time_s=time_s, soc=1.0, forecast=ctx.job.forecast, belief=ctx.energy.belief)
    ctx.work.take(planner_of(ctx).flight(ctx.vehicle.family, span, known))
    ctx.work.intend(None)
    if ctx.delivery.leg is not None and ctx.work.flight is not None:
        flight = ctx.work.flight
        changed = replace(
            ctx.delivery.leg, mission=flight.mission, destination=flight.destination, diverts=flight.diverts
        )
        ctx.delivery.take_leg(changed)


def restored_leg(ctx: Context, entry: LegBegun, time_s: float) -> Leg | None:
    """Rebuild the present leg from the record before its take-off."""
    flight = ctx.work.flight
    if flight is None:
        return None
    numbers = (entry.soc, entry.told_soc, entry.planned_s, entry.planned_soc)
    soc, reported_soc, planned_s, planned_soc = (float("nan") if one is None else one for one in numbers)
    return replace(
        leg_of(ctx, flight),
        start_s=time_s,
        commanded_s=time_s,
        soc_start=soc,
        reported_start=reported_soc,
        planned_s=planned_s,
        planned_soc=planned_soc,
    )


def turning(ctx: Context) -> After | None:
    """Finish a change of the mission that began before the program ended; None if there was none."""
    span, s = ctx.work.intended, ctx.observed.sample
    if span is None or ctx.work.flight is None or s is None or not s.mission_item >= 0.0:
        return None
    if ctx.vehicle.mode not in ("mission", "hold"):
        return None
    item = int(s.mission_item) - ctx.vehicle.family.home_items
    return leave_at(ctx, span, max(item, 0)) or (
        State.FLYING,
        f"on its way to {ctx.work.flight.destination}: changing its mission again",
    )
