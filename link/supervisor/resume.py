"""Resuming a delivery: from its journal after a crash of the program, and from the vehicle itself."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.departure.departure import make_leg
from skyway.link.supervisor.journal.entries import (
    Landed,
    LegBegun,
    Met,
    Ordered,
    PlanTaken,
    Resumed,
    StartNote,
    Tracked,
    Turned,
    WentOn,
)
from skyway.link.supervisor.journal.standing import restore_standing
from skyway.link.supervisor.legs import Leg
from skyway.link.supervisor.onward import Onward, over_target
from skyway.link.supervisor.soc.modelled_use import ModelledUse
from skyway.link.supervisor.states import State, Turn
from skyway.link.supervisor.work.resume import restore_work, restored_leg, turning
from skyway.models.base.errors import InputError, LinkError, VehicleTimeoutError
from skyway.models.base.formatting import percent
from skyway.models.composition.file import from_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.journal.file import Record
    from skyway.link.vehicle.vehicle import Identity

SETTLE_S = 90.0
"""Time within which a vehicle armed on the ground takes off or disarms, s."""


# From the journal


def restore(ctx: Context, records: Sequence[Record]) -> None:
    """Restore the contents of the journal: plan, place, energy, wind, and the present leg."""
    delivery = ctx.delivery
    delivery.restore_flight(max(record.flight for record in records))
    ctx.parameters.follow(records)
    ctx.proof.restore(records, ctx.job.request.payload_kg)
    for record in records:
        if ctx.job.work is not None:
            restore_work(ctx, record)
        if met := record.entry(Met):
            ctx.observed.identify(met.uid or 0)
        elif ordered := record.entry(Ordered):
            ctx.conversation.restore(ordered)
        elif went := record.entry(WentOn):
            onward = Onward(went.destination or "", bool(went.loaded), bool(went.delivered), went.leave_s or 0.0)
            back = from_json(json.dumps(went.plan), file="journal") if went.plan else None
            if delivery.leg is not None and back is not None:
                way = ctx.job.composition.way_back
                over_target(delivery, delivery.leg, onward, back, 0.0 if way is None else way.dwell_s)
            elif delivery.leg is not None:
                delivery.call_off(onward)
            else:
                delivery.go_on(onward)
                delivery.take_plan(back)
        elif taken := record.entry(PlanTaken):
            if taken.plan:
                delivery.take_plan(from_json(json.dumps(taken.plan), file="journal"))
            restore_standing(ctx, taken.standing)
        elif begun := record.entry(LegBegun):
            restore_standing(ctx, begun.standing)
            delivery.note_landing(None)
            delivery.take_leg(_restored_leg(ctx, begun, record.time_s))
            ctx.divert.call_off()
        elif landed := record.entry(Landed):
            restore_standing(ctx, landed.standing)
            delivery.take_leg(None)
            ctx.divert.call_off()
            delivery.note_landing(landed.standing.station)
            delivery.reach(landed.standing.station)  # a later plan in the journal replaces the rest of this one
        elif delivery.leg is not None:
            _restore_flight(ctx, delivery.leg, record)


def _restore_flight(ctx: Context, leg: Leg, record: Record) -> None:
    """Restore the state of a leg in the air: its modelled use so far, and its destination."""
    if (point := record.entry(Tracked)) and leg.modelled is not None and point.modelled_soc is not None:
        leg.modelled.restore(point.modelled_soc, record.time_s)
    elif (turned := record.entry(Turned)) and turned.destination:
        ctx.divert.to(turned.destination, turned=not turned.begun)


def _restored_leg(ctx: Context, entry: LegBegun, time_s: float) -> Leg | None:
    """Rebuild the present leg from the record before its take-off."""
    if ctx.job.work is not None:
        return restored_leg(ctx, entry, time_s)
    if ctx.delivery.plan is None or not ctx.delivery.plan.services:
        return None
    try:
        _, mission = make_leg(ctx, _number(entry.ground_speed_mps))
    except (InputError, Turn):
        return None
    use = ModelledUse.by(ctx.policy().reach(ctx.job.forecast, ctx.energy.belief))
    use.begin(time_s)
    return Leg(
        origin=entry.origin or "",
        destination=entry.destination or "",
        via=entry.via,
        diverts=entry.standing.diverts,
        mission=mission,
        commanded_mps=_number(entry.ground_speed_mps),
        start_s=time_s,
        soc_start=_number(entry.soc),
        reported_start=_number(entry.told_soc),
        planned_s=_number(entry.planned_s),
        planned_soc=_number(entry.planned_soc),
        modelled=use,
        last=bool(entry.last),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value


# From the vehicle


def resume(ctx: Context, who: Identity) -> After:
    """Locate the vehicle and continue from there: never upload or start again what was flown already."""
    if ctx.observed.is_another(who.uid):
        return (
            State.STOPPED,
            f"{who} is not the drone of this journal: connect the right drone, or give the journal of this drone with --resume",
        )
    where = "in the air" if ctx.in_air else "on the ground"
    ctx.note(Resumed(mode=ctx.vehicle.mode), f"found {who} {where}")
    return take_up(ctx)


def take_up(ctx: Context) -> After:
    """Determine the stage of the delivery from the vehicle itself."""
    if not ctx.on_ground and not ctx.in_air:
        _settle(ctx)
    if ctx.in_air:
        return _in_the_air(ctx)
    if not ctx.on_ground:
        return State.HOLDING, "the drone is armed on the ground, but not by this program"
    delivery = ctx.delivery
    station, leg = ctx.here_station(), delivery.leg
    if leg is not None and (station != leg.origin or ctx.work.done is not None):
        return State.LANDED, f"flight {delivery.flight} ended while this program was not connected"
    if leg is not None:
        delivery.take_leg(None)
        delivery.not_begun()
        ctx.note(StartNote(), f"the flight from {leg.origin} had not begun")
    delivery.stand_at(station)
    if station is None or station == ctx.request.destination:
        return State.LANDED, f"the drone stands at {station or 'no known station'}"
    if not delivery.begins_at(station):
        delivery.take_plan(None)
    return State.REPLANNING, f"at {station} with {percent(ctx.battery.soc)}: decide on the next leg"


def _settle(ctx: Context) -> None:
    """Wait for a vehicle that is armed on the ground to take off or to disarm; disarm it if it does neither."""
    end = ctx.clock.now_s() + SETTLE_S
    while ctx.clock.now_s() < end and not ctx.on_ground and not ctx.in_air:
        ctx.tick()
    if not ctx.on_ground and not ctx.in_air:
        try:
            ctx.vehicle.disarm()
        except LinkError as error:
            ctx.note(StartNote(), f"the drone was not disarmed: {error}")
        ctx.wait(3.0)


def _in_the_air(ctx: Context) -> After:
    """Continue a flight if the vehicle flies our mission."""
    leg, divert = ctx.delivery.leg, ctx.divert
    if leg is None or ctx.delivery.plan is None:
        return State.HOLDING, "the drone is in the air, and not on a leg of this delivery"
    if (after := turning(ctx)) is not None:
        return after
    mode = ctx.vehicle.mode
    if mode == "hold" and ctx.stands_in_air:
        return (State.DIVERTING if divert.station else State.FLYING), "still paused, as ordered"
    strange = f"somebody else switched the drone to mode {mode}"
    if divert.station is not None and not divert.turned:
        if mode in ("mission", "hold", "guided"):
            return State.DIVERTING, f"the divert to {divert.station} was not finished: sending it again"
        return State.HOLDING, strange
    if mode not in ("mission", "takeoff"):
        return State.HOLDING, strange
    if divert.station is not None:
        return State.DIVERTING, f"on its way to {divert.station}"
    try:
        differences = ctx.vehicle.verify(leg.mission.document.mission)
    except VehicleTimeoutError:
        raise
    except LinkError as error:
        raise Turn(
            State.HOLDING, f"could not check whether the drone flies the mission of this delivery: {error}"
        ) from error
    if differences:
        return State.HOLDING, f"the drone does not fly the mission of this delivery: {differences[0]}"
    return State.FLYING, f"on its way to {leg.destination}"
