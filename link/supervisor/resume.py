"""Going on with a delivery: from its journal after a crash of the program, and from the vehicle itself."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.departure.departure import make_leg
from skyway.link.supervisor.legs import Leg
from skyway.link.supervisor.soc.modelled_use import ModelledUse
from skyway.link.supervisor.standing import restore_standing
from skyway.link.supervisor.states import State, Turn
from skyway.models.base.errors import InputError, LinkError, VehicleTimeoutError
from skyway.models.base.formatting import percent
from skyway.models.composition.file import from_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.journal import Record
    from skyway.link.vehicle.vehicle import Identity

SETTLE_S = 90.0
"""Armed on the ground, it either takes off or disarms within this time."""


# From the journal


def restore(ctx: Context, records: Sequence[Record]) -> None:
    """Bring back what the journal knows: plan, place, energy, wind, and the leg under way."""
    delivery = ctx.delivery
    delivery.restore_flight(max(record.flight for record in records))
    ctx.parameters.follow(records)
    for record in records:
        data = record.data
        if record.event == "vehicle":
            ctx.observed.identify(int(data.get("uid") or 0))
        if record.event == "plan" and data.get("plan") is not None:
            delivery.take_plan(from_json(json.dumps(data["plan"]), file="journal"))
        if record.event in ("plan", "leg", "landed"):
            restore_standing(ctx, data)
        if record.event == "leg":
            delivery.note_landing(None)
            delivery.take_leg(_restored_leg(ctx, data, record.time_s))
            ctx.divert.call_off()
        elif record.event == "track" and delivery.leg is not None and delivery.leg.modelled is not None:
            if data.get("modelled_soc") is not None:
                delivery.leg.modelled.restore(float(data["modelled_soc"]), record.time_s)
        elif record.event == "turn" and delivery.leg is not None and data.get("destination"):
            ctx.divert.to(str(data["destination"]), turned=not data.get("begun"))
        elif record.event == "landed":
            delivery.take_leg(None)
            ctx.divert.call_off()
            delivery.note_landing(data.get("station"))
            delivery.reach(data.get("station"))  # a later plan in the journal replaces what is left of this one


def _restored_leg(ctx: Context, data: dict[str, Any], time_s: float) -> Leg | None:
    """Make the leg under way again from what was written before its take-off."""
    if ctx.delivery.plan is None or not ctx.delivery.plan.services:
        return None
    try:
        _, mission = make_leg(ctx, _number(data.get("ground_speed_mps")))
    except (InputError, Turn):
        return None
    use = ModelledUse.by(ctx.replanner().reach(ctx.job.forecast, ctx.energy.belief))
    use.begin(time_s)
    soc, planned_s, planned_soc = (_number(data.get(key)) for key in ("soc", "planned_s", "planned_soc"))
    return Leg(
        origin=str(data["origin"]),
        destination=str(data["destination"]),
        via=tuple(data.get("via", ())),
        diverts=tuple(data.get("diverts", ())),
        mission=mission,
        commanded_mps=_number(data.get("ground_speed_mps")),
        start_s=time_s,
        soc_start=soc,
        told_start=_number(data.get("told_soc")),
        planned_s=planned_s,
        planned_soc=planned_soc,
        modelled=use,
        last=bool(data.get("last")),
    )


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


# From the vehicle


def resume(ctx: Context, who: Identity) -> After:
    """Find the vehicle where it is, and go on from there: never upload or start what was flown already."""
    if ctx.observed.is_another(who.uid):
        return State.STOPPED, f"{who} is not the vehicle of this journal"
    ctx.note("resume", f"found {who} {'in the air' if ctx.in_air else 'on the ground'}", mode=ctx.vehicle.mode)
    return take_up(ctx)


def take_up(ctx: Context) -> After:
    """Tell from the vehicle itself where the delivery stands."""
    if not ctx.on_ground and not ctx.in_air:
        _settle(ctx)
    if ctx.in_air:
        return _in_the_air(ctx)
    if not ctx.on_ground:
        return State.HOLDING, "it is armed on the ground, and not by us"
    delivery = ctx.delivery
    station, leg = ctx.here_station(), delivery.leg
    if leg is not None and station != leg.origin:
        return State.LANDED, f"flight {delivery.flight} has ended while nobody watched"
    if leg is not None:
        delivery.take_leg(None)
        delivery.not_begun()
        ctx.note("start", f"the flight from {leg.origin} was not begun")
    delivery.stand_at(station)
    if station is None or station == ctx.job.request.destination:
        return State.LANDED, f"it stands at {station or 'no station'}"
    if not delivery.begins_at(station):
        delivery.take_plan(None)
    return State.REPLANNING, f"at {station} with {percent(ctx.battery.soc)}"


def _settle(ctx: Context) -> None:
    """Wait for a vehicle that is armed on the ground to take off or to disarm; disarm it if it does neither."""
    end = ctx.clock.now_s() + SETTLE_S
    while ctx.clock.now_s() < end and not ctx.on_ground and not ctx.in_air:
        ctx.tick()
    if not ctx.on_ground and not ctx.in_air:
        try:
            ctx.vehicle.disarm()
        except LinkError as error:
            ctx.note("start", str(error))
        ctx.wait(3.0)


def _in_the_air(ctx: Context) -> After:
    """Go on with a flight where the vehicle flies what we gave it."""
    leg, divert = ctx.delivery.leg, ctx.divert
    if leg is None or ctx.delivery.plan is None:
        return State.HOLDING, "it is in the air, and not on a leg of this delivery"
    mode = ctx.vehicle.mode
    if divert.station is not None and not divert.turned:
        if mode in ("mission", "hold", "guided"):
            return State.DIVERTING, f"the turn to {divert.station} was not finished"
        return State.HOLDING, f"it is in mode {mode}, which we did not command"
    if mode not in ("mission", "takeoff"):
        return State.HOLDING, f"it is in mode {mode}, which we did not command"
    if divert.station is not None:
        return State.DIVERTING, f"on its way to {divert.station}"
    try:
        differences = ctx.vehicle.verify(leg.mission.document.mission)
    except VehicleTimeoutError:
        raise
    except LinkError as error:
        raise Turn(State.HOLDING, f"it could not be told whether it flies our mission: {error}") from None
    if differences:
        return State.HOLDING, f"it flies another mission than ours: {differences[0]}"
    return State.FLYING, f"on its way to {leg.destination}"
