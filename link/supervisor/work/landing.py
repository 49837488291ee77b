"""After a landing: progress of the work, and whether it is finished."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import WorkStands
from skyway.link.supervisor.states import State
from skyway.link.supervisor.work.ground import PlannedUse, planner_of
from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.legs import Leg
    from skyway.link.supervisor.work.task import WorkFlight


WHOLE = 0.9
"""Share of the planned time from which a flight that lands at its destination counts as complete, although its end
was not observed."""


def settle_use(ctx: Context, station: str | None) -> None:
    """Compare the flight with its modelled use; one that did not end as planned is not used."""
    leg, flight = ctx.delivery.leg, ctx.work.flight
    if leg is None or flight is None or not isinstance(leg.modelled, PlannedUse):
        return
    if station == flight.destination and ctx.divert.station is None:
        leg.modelled.reach(flight.modelled_soc)
    else:
        leg.learn_nothing()


def after_flight(ctx: Context, station: str, leg: Leg | None) -> After:
    """Record the flight's progress, and continue from the pad where the drone stands."""
    work, planner = ctx.work, planner_of(ctx)
    flight = work.flight
    planned = flight is not None and _as_planned(ctx, flight, station, leg)
    if work.finished or (planned and flight is not None and flight.span.end is None):
        work.finish()
        ctx.note(WorkStands(point=None, pad=None, finished=True), "the work is done")
        return State.DONE, f"the work is done; the drone stands disarmed at {station} with {percent(ctx.battery.soc)}"
    pad = planner.pad_of(station)
    if flight is not None:
        point = flight.span.end[0] if planned and flight.span.end is not None else _done_point(ctx)
        if point == 0 and pad is None:
            work.back_at_start()
        elif pad is None:
            return (
                State.STOPPED,
                f"the drone stands at {station}, which has no pad: bring it to a pad, then start again with --resume",
            )
        else:
            work.stand(point, pad)
        ctx.note(WorkStands(point=point, pad=station, finished=False), f"the work is done as far as point {point}")
    if ctx.conversation.stays:
        return State.STOPPED, f"stopped at {station} as ordered: the drone stands disarmed; --resume continues the work"
    return State.REPLANNING, f"at {station}"


def _as_planned(ctx: Context, flight: WorkFlight, station: str, leg: Leg | None) -> bool:
    """Whether the flight was completed: as observed, or by its duration."""
    if station != flight.destination or ctx.divert.station is not None:
        return False
    flown_s = math.nan if leg is None else ctx.now_s - leg.start_s
    return planner_of(ctx).is_done(flight.span, ctx.work.done) or flown_s >= WHOLE * flight.planned_s


def _done_point(ctx: Context) -> int:
    """Return the point from which interrupted work continues."""
    point = planner_of(ctx).point_at(ctx.work.done)
    begin = ctx.work.begin
    return max(point, 0 if begin is None else begin[0])
