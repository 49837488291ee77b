"""Meeting the vehicle: at the beginning, after a crash of the program, after a lost link, and while somebody else has control."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.departure.departure import make_leg
from skyway.link.supervisor.departure.parameter_changes import changes_of
from skyway.link.supervisor.flight.crash import crash_end
from skyway.link.supervisor.legs import Leg
from skyway.link.supervisor.soc.modelled_use import ModelledUse
from skyway.link.supervisor.states import IN_AIR, State, Turn
from skyway.link.supervisor.wind_book import observations_of
from skyway.models.base.errors import InputError, LinkError, VehicleTimeoutError
from skyway.models.composition.file import from_json
from skyway.planner.online.energy_belief import EnergyBelief

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.journal import Record
    from skyway.link.vehicle.vehicle import Identity

KNOWN_S = 45.0
"""So long we wait for position, charge and whether it is armed."""
LOOK_AGAIN_S = 15.0
"""What would end a delivery before it has begun is looked at for so long."""
SETTLE_S = 90.0
"""Armed on the ground, it either takes off or disarms within this time."""
BACK_S = 3.0
WORDS = "go, land, leave"


def connecting(ctx: Context) -> After:
    """Meet it; for the first time it must stand disarmed where the plan begins."""
    _meet(ctx)
    ctx.must_answer("it does not say who it is")
    who = ctx.vehicle.identify()
    if ctx.resumed:
        return _resuming(ctx, who)
    ctx.uid, ctx.reboots = who.uid, ctx.vehicle.reboots
    ctx.note("vehicle", str(who), system=who.system, autopilot=who.autopilot, uid=who.uid)
    ctx.tell(str(who))
    origin = ctx.job.composition.origin
    end = ctx.clock.now_s() + LOOK_AGAIN_S
    while not (ctx.on_ground and ctx.here_station() == origin) and ctx.clock.now_s() < end:
        ctx.tick()
    if not ctx.on_ground:
        armed = State.LEFT if ctx.vehicle.armed else State.STOPPED
        return State.HOLDING if ctx.in_air else armed, "the vehicle does not stand disarmed on the ground"
    ctx.station = ctx.here_station()
    if ctx.station != origin:
        return State.STOPPED, f"the vehicle stands at {ctx.station or 'no station'}, and the plan begins at {origin}"
    ctx.plan = ctx.job.composition
    ctx.visited.add(origin)
    ctx.note_plan("the plan as given")
    return State.REPLANNING, f"at {origin} with {100 * ctx.soc:.0f} %"


def _meet(ctx: Context) -> None:
    """Wait until position, charge, and whether it is armed and landed are known."""
    ctx.request_telemetry()
    end = ctx.clock.now_s() + KNOWN_S
    asked = ctx.clock.now_s()
    while ctx.clock.now_s() < end:
        ctx.tick()
        s = ctx.sample
        if s is not None and ctx.place is not None and all(map(math.isfinite, (s.armed, s.landed, ctx.soc))):
            return
        if ctx.clock.now_s() > asked + 10.0:
            ctx.must_answer("it does not send what it is asked for")
            asked = ctx.clock.now_s()
            ctx.request_telemetry()
    s = ctx.sample
    lacking = ["position"] if ctx.place is None else []
    if not math.isfinite(ctx.soc):
        lacking.append("state of charge")
    if s is None or not math.isfinite(s.armed + s.landed):
        lacking.append("whether it is armed and landed")
    raise Turn(State.STOPPED, f"the vehicle does not tell its {', its '.join(lacking)}")


# After a crash of the program


def restore(ctx: Context, records: Sequence[Record]) -> None:
    """Bring back what the journal knows: plan, place, energy, wind, and the leg under way."""
    ctx.flight = max(record.flight for record in records)
    ctx.parameters = changes_of(records)
    for record in records:
        data = record.data
        if record.event == "vehicle":
            ctx.uid = int(data.get("uid") or 0)
        if record.event == "plan" and data.get("plan") is not None:
            ctx.plan = from_json(json.dumps(data["plan"]), file="journal")
        if record.event in ("plan", "leg", "landed"):
            _restore_standing(ctx, data)
        if record.event == "leg":
            ctx.landed_at = None
            ctx.leg, ctx.divert_to, ctx.turned = _restore_leg(ctx, data, record.time_s), None, False
        elif record.event == "track" and ctx.leg is not None and ctx.leg.modelled is not None:
            if data.get("modelled_soc") is not None:
                ctx.leg.modelled.soc, ctx.leg.modelled.heard_s = float(data["modelled_soc"]), record.time_s
        elif record.event == "turn" and ctx.leg is not None and data.get("destination"):
            ctx.divert_to, ctx.turned = str(data["destination"]), not data.get("begun")
        elif record.event == "landed":
            ctx.leg, ctx.divert_to, ctx.turned = None, None, False
            ctx.landed_at = data.get("station")
            _restore_progress(ctx, data)


def _restore_standing(ctx: Context, data: dict[str, Any]) -> None:
    ctx.station = data.get("station") or ctx.station
    ctx.visited = set(data.get("visited", ()))
    belief = data.get("belief")
    if belief:
        ctx.belief = EnergyBelief(**{key: float(value) for key, value in belief.items()})
    ctx.diverts = tuple(data.get("diverts", ()))
    ctx.charge_to = data.get("charge_to")
    ctx.asked_once = bool(data.get("asked_once"))
    ctx.gauge = float(data.get("gauge", 1.0))
    ctx.voltage.lost = float(data.get("lost_soc", 0.0))
    ctx.wind.earlier = observations_of(data.get("observations", ()))


def _restore_progress(ctx: Context, data: dict[str, Any]) -> None:
    """Take the flown leg from the plan; a later plan in the journal replaces it anyway."""
    station = data.get("station")
    if ctx.plan is not None and ctx.plan.services and ctx.plan.services[0].destination == station:
        rest = ctx.plan.services[1:]
        ctx.plan = replace(ctx.plan, services=rest, origin=str(station)) if rest else None
    elif not (ctx.plan is not None and ctx.plan.services and ctx.plan.services[0].origin == station):
        ctx.plan = None


def _restore_leg(ctx: Context, data: dict[str, Any], time_s: float) -> Leg | None:
    """Make the leg under way again from what was written before its take-off."""
    if ctx.plan is None or not ctx.plan.services:
        return None
    try:
        _, mission = make_leg(ctx, _number(data.get("ground_speed_mps")))
    except (InputError, Turn):
        return None
    reach = ctx.replanner().reach(ctx.job.forecast, ctx.belief)
    use = ModelledUse(reach.soc_per_s, reach.soc_climb - reach.soc_per_s * reach.rules.climb_s, reach.load)
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


def _resuming(ctx: Context, who: Identity) -> After:
    """Find the vehicle where it is, and go on from there: never upload or start what was flown already."""
    ctx.reboots = ctx.vehicle.reboots
    if ctx.uid and who.uid and who.uid != ctx.uid:
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
    station, leg = ctx.here_station(), ctx.leg
    if leg is not None and station != leg.origin:
        return State.LANDED, f"flight {ctx.flight} has ended while nobody watched"
    if leg is not None:
        ctx.leg = None
        ctx.flight -= 1
        ctx.note("start", f"the flight from {leg.origin} was not begun")
    ctx.station = station
    if station is None or station == ctx.job.request.destination:
        return State.LANDED, f"it stands at {station or 'no station'}"
    if ctx.plan is None or not ctx.plan.services or ctx.plan.services[0].origin != station:
        ctx.plan = None
    return State.REPLANNING, f"at {station} with {100 * ctx.soc:.0f} %"


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
    leg = ctx.leg
    if leg is None or ctx.plan is None:
        return State.HOLDING, "it is in the air, and not on a leg of this delivery"
    mode = ctx.vehicle.mode
    if ctx.divert_to is not None and not ctx.turned:
        if mode in ("mission", "hold", "guided"):
            return State.DIVERTING, f"the turn to {ctx.divert_to} was not finished"
        return State.HOLDING, f"it is in mode {mode}, which we did not command"
    if mode not in ("mission", "takeoff"):
        return State.HOLDING, f"it is in mode {mode}, which we did not command"
    if ctx.divert_to is not None:
        return State.DIVERTING, f"on its way to {ctx.divert_to}"
    try:
        differences = ctx.vehicle.verify(leg.mission.document.mission)
    except VehicleTimeoutError:
        raise
    except LinkError as error:
        raise Turn(State.HOLDING, f"it could not be told whether it flies our mission: {error}") from None
    if differences:
        return State.HOLDING, f"it flies another mission than ours: {differences[0]}"
    return State.FLYING, f"on its way to {leg.destination}"


# A lost link


def lost_link(ctx: Context) -> After:
    """Listen until it is heard and answers again, then find it where it is."""
    before = ctx.before
    ctx.tell(f"link lost; {ctx.left_words}" if before in IN_AIR else "link lost")
    begun = ctx.clock.now_s()
    while True:
        ctx.tick()
        if ctx.vehicle.silent_s >= BACK_S or not ctx.vehicle.answers():
            continue
        try:
            return _found_again(ctx, before, ctx.clock.now_s() - begun)
        except VehicleTimeoutError as error:
            ctx.note("link", f"lost again: {error}")


def _found_again(ctx: Context, before: State, gone_s: float) -> After:
    ctx.note("link", f"back after {gone_s:.0f} s", gone_s=gone_s)
    ctx.tell(f"link back after {gone_s:.0f} s")
    ctx.unanswered_said = ""
    if before is State.CONNECTING:
        return State.CONNECTING, "heard again"
    ctx.request_telemetry()
    ctx.wait(3.0)
    if before is State.HOLDING:
        return State.HOLDING, "heard again; somebody else has had control"
    return take_up(ctx)


# Somebody else has control


def holding(ctx: Context) -> After:
    """Command nothing; watch, record, and go on only on the operator's word."""
    ctx.words.clear()
    if ctx.operator.present:
        ctx.operator.ask(f"nothing is commanded any more; say {WORDS} when it is ours again")
    else:
        ctx.tell("nothing is commanded any more; nobody is there to give the word")
    ground_s = math.nan
    while True:
        ctx.tick()
        if ctx.words:
            after = _word(ctx, ctx.words.pop(0))
            if after is not None:
                return after
        if ctx.operator.present:
            continue
        ground_s = (ctx.clock.now_s() if math.isnan(ground_s) else ground_s) if ctx.on_ground else math.nan
        if ctx.clock.now_s() - ground_s > 30.0:
            crash = crash_end(ctx, ctx.entered_s)
            if crash is not None:
                return crash
            ctx.station = ctx.here_station()
            if ctx.station is None:
                return State.ENDED_ELSEWHERE, "it was landed away from any station, not by us"
            return State.STOPPED, f"it was landed at {ctx.station}, not by us; nobody is there to give the word"


def _word(ctx: Context, word: str) -> After | None:
    ctx.note("operator", f"said {word}")
    if word == "leave":
        return State.LEFT, f"left by the operator's word; {ctx.left_words}"
    if word == "land" and ctx.in_air:
        ctx.divert_to, ctx.turned = None, False
        return State.DIVERTING, "the operator wants it to land here"
    if word == "go":
        return _go_on(ctx)
    ctx.operator.ask(f"please say {WORDS}")
    return None


def _restored_turn(ctx: Context) -> bool:
    """Whether it was turned before the program was begun anew: then its mission is not the leg's, and is not known here."""
    return ctx.turned and ctx.leg is not None and ctx.leg.destination != ctx.divert_to


def _go_on(ctx: Context) -> After | None:
    """Take the vehicle over again by the operator's word."""
    ctx.vehicle.changes()
    if ctx.on_ground:
        return take_up(ctx)
    leg = ctx.leg
    if not ctx.in_air or leg is None or ctx.plan is None:
        ctx.operator.ask("it is not on a leg of this delivery; land it, then say go")
        return None
    try:
        if not _restored_turn(ctx) and ctx.vehicle.verify(leg.mission.document.mission):
            outcome = ctx.vehicle.upload(leg.mission.document.mission)
            if not outcome.verified:
                ctx.operator.ask(f"its mission is not ours and could not be sent anew ({outcome}); say {WORDS}")
                return None
        ctx.vehicle.resume()
        ctx.wait(3.0)
    except LinkError as error:
        ctx.operator.ask(f"it cannot be taken over: {error}; say {WORDS}")
        return None
    ctx.vehicle.changes()
    return (State.DIVERTING if ctx.divert_to is not None else State.FLYING), "ours again, by the operator's word"
