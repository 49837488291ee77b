"""What is done on the ground between two flights: decide, wait for a pad, charge, check, upload, ask, start."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from link.mission_words import MissionKind
from link.pads import ManualPads
from link.supervisor.context import Leg, Turn
from link.supervisor.foreign import refuse_foreign
from link.supervisor.legs import plan_leg, with_places
from link.supervisor.modelled_use import ModelledUse
from link.supervisor.preflight import run_checks
from link.supervisor.states import State
from link.verified import UploadState
from models.errors import CommandRefusedError, InputError, LinkError
from models.pad_service import PadServiceError
from planner.replan import Decision, Grounded

if TYPE_CHECKING:
    from link.supervisor.context import After, Context
    from link.supervisor.legs import LegMission
    from models.pad_service import DroneOnPad
    from models.services import DroneService

POLL_S = 10.0
REDECIDE_S = 600.0
"""A drone that waits for a pad thinks again this often."""
CHECK_AGAIN_S, CHECK_PATIENCE_S = 5.0, 120.0
ARM_PATIENCE_S = 90.0
TAKE_OFF_S = 60.0
FRESH_S = 2.0
"""So long we listen before a take-off, so that what is known is of now."""
UPLOADS = 3
STARTS = 3
_UNUSABLE_S = 900.0
"""A station that could not be used is not tried again for so long."""


def replanning(ctx: Context) -> After:
    """Decide where to fly next, with how much charge, and when."""
    if ctx.stop_after_leg:
        return State.STOPPED, f"the operator asked to stay at {ctx.station}"
    standing = _standing(ctx)
    planner = ctx.replanner()
    forecast = ctx.wind.forecast(ctx.now_s, now=True)
    if ctx.mandate.replanning is None:
        decision = _as_planned(ctx, standing)
    else:
        decision = planner.decide(standing, ctx.plan, forecast, ctx.belief)
    figures = dict(decision.figures) | {"wind_source": ctx.wind.source, "soc_source": ctx.soc_source}
    ctx.note("decision", decision.reason, action=decision.action, where="ground", **figures)
    ctx.tell(f"{decision.action}: {decision.reason}")
    if decision.composition is not None:
        ctx.plan = with_places(decision.composition, ctx.mandate.scenario, decision.diverts)
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


def _standing(ctx: Context) -> Grounded:
    """What is known where the drone stands."""
    ctx.unusable = {name: since for name, since in ctx.unusable.items() if ctx.now_s < since + _UNUSABLE_S}
    if ctx.station is None or not math.isfinite(ctx.soc):
        raise Turn(State.STOPPED, "where the vehicle stands, or its state of charge, is not known")
    busy: dict[str, int] = {}
    ahead = () if ctx.plan is None else tuple(service.destination for service in ctx.plan.services[:3])
    for name in (ctx.station, *ahead):
        try:
            status = ctx.pads.status(name)
        except (LinkError, InputError):
            continue
        busy[name] = status.busy
        full = status.busy >= status.pads and status.holding_free == 0 and status.pads > 0
        if full and name != ctx.station and ahead and name == ahead[0]:
            ctx.unusable[name] = ctx.now_s
    return Grounded(
        ctx.station,
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


# Pads


def waiting(ctx: Context) -> After:
    """Ask for a pad until there is one."""
    begun_s = ctx.now_s
    said = ""
    while True:
        try:
            told = ctx.pads.charge(ctx.station or "", _drone(ctx), ctx.charge_to or 1.0)
        except PadServiceError as error:
            if str(error) != said:
                said = str(error)
                ctx.note("pad", said, answer="refused")
                ctx.tell(f"pads: {said}")
        else:
            if told.state in ("charging", "done"):
                _note_pad(ctx, told)
                return State.CHARGING, f"on a pad of {ctx.station}"
            line = f"waits for a pad at {ctx.station}, {told.place_in_line} before it"
            if line != said:
                said = line
                _note_pad(ctx, told)
                ctx.tell(line)
        if ctx.now_s > begun_s + REDECIDE_S:
            return State.REPLANNING, f"no pad for {REDECIDE_S / 60:.0f} min: think again"
        ctx.wait_until(ctx.now_s + POLL_S)


def charging(ctx: Context) -> After:
    """Wait until it is charged."""
    target = ctx.charge_to or 1.0
    compared = ctx.charged
    while True:
        _hear_charged(ctx)
        try:
            told = ctx.pads.charge(ctx.station or "", _drone(ctx), target)
        except PadServiceError as error:
            ctx.note("pad", str(error), answer="refused")
            return State.REPLANNING, f"charging ended: {error}"
        if told.state == "waiting":
            return State.WAITING, "it lost its pad"
        if told.soc is not None:
            if not compared:
                compared = True
                ctx.learn_gauge(ctx.told_soc, told.soc)
            ctx.soc, ctx.soc_source = told.soc, "the pad"
        if told.state == "done" or (told.soc is not None and told.soc >= target - 1e-6):
            break
        left = POLL_S if told.done_s is None else told.done_s - ctx.now_s
        ctx.wait_until(ctx.now_s + min(max(left + 0.5, 1.0), 60.0))
        if told.soc is not None:
            ctx.soc = told.soc
    _note_pad(ctx, told)
    _reset_counter(ctx, told.soc)
    ctx.charged = True
    ctx.tell(f"charged to {100 * ctx.soc:.0f} % at {ctx.station}")
    return State.REPLANNING, f"charged to {100 * ctx.soc:.0f} %"


def _hear_charged(ctx: Context) -> None:
    """Where people charge, they say ``charged``, or ``charged 83`` for 83 %."""
    while ctx.words and isinstance(ctx.pads, ManualPads):
        word, _, percent = ctx.words.pop(0).partition(" ")
        if word != "charged":
            ctx.operator.ask("say charged when it is done")
            continue
        known = percent.strip(" %").replace(".", "", 1).isdigit()
        ctx.pads.charged(_drone(ctx), float(percent.strip(" %")) / 100.0 if known else ctx.charge_to or 1.0)


def _reset_counter(ctx: Context, soc: float | None) -> None:
    """Tell an autopilot that counts charge what the battery holds; one that estimates it refuses, and that is right."""
    if soc is None:
        return
    try:
        reported = ctx.vehicle.reset_battery(soc)
    except CommandRefusedError:
        ctx.wait(2.0)
        return
    ctx.note("battery", f"the vehicle's counter was set to {100 * soc:.0f} %", soc=soc, reported=reported)
    if math.isfinite(reported):
        ctx.soc, ctx.told_soc, ctx.soc_source = reported, reported, "the vehicle"


def _drone(ctx: Context) -> str:
    s = ctx.sample
    return str(1 if s is None else s.system)


def _note_pad(ctx: Context, told: DroneOnPad) -> None:
    ctx.note(
        "pad", f"{told.state} at {ctx.station}", answer=told.state, soc=told.soc, to_soc=told.to_soc,
        place_in_line=told.place_in_line, pad_free_s=told.pad_free_s, done_s=told.done_s,
    )  # fmt: skip


# To the take-off


def next_service(ctx: Context, speed_mps: float | None = None) -> DroneService:
    """Return the leg to be flown next, with its divert stations and the ground speed that the wind gives, or this one."""
    if ctx.plan is None or not ctx.plan.services:
        raise Turn(State.STOPPED, "there is no plan from here")
    service = ctx.plan.services[0]
    if speed_mps is not None:
        return replace(service, diverts=ctx.diverts, ground_speed_mps=speed_mps)
    reach = ctx.replanner().reach(ctx.wind.forecast(ctx.now_s), ctx.belief)
    way = reach.way(service.origin, service.via, service.destination)
    cruise_s = float(reach.expected(reach.along(way, ctx.now_s).time_s[:, -1]))
    speed = min(service.distance_m / max(cruise_s, 1.0), reach.drone.max_ground_speed_mps)
    return replace(service, diverts=ctx.diverts, ground_speed_mps=round(speed, 2))


def make_leg(ctx: Context, speed_mps: float | None = None) -> tuple[DroneService, LegMission]:
    """Make the mission of the next leg."""
    service = next_service(ctx, speed_mps)
    if ctx.plan is None:
        raise Turn(State.STOPPED, "there is no plan from here")
    mandate = ctx.mandate
    plan = replace(with_places(ctx.plan, mandate.scenario, service.diverts), services=(service, *ctx.plan.services[1:]))
    last = service.destination == mandate.request.destination
    return service, plan_leg(plan, service, ctx.vehicle.family.name, mandate.options, last=last)


def preflight(ctx: Context) -> After:
    """Go through the list until all is in order; what cannot come right stops, with the reason."""
    service, leg = make_leg(ctx)
    end = ctx.clock.now_s() + CHECK_PATIENCE_S
    while True:
        try:
            checks = run_checks(ctx, service, leg)
        except LinkError as error:
            if ctx.clock.now_s() >= end:
                return State.STOPPED, f"preflight: {error}"
            ctx.wait(CHECK_AGAIN_S)
            continue
        wrong = [check for check in checks if not check.ok]
        if not wrong or ctx.clock.now_s() >= end or any(not check.waits for check in wrong):
            break
        ctx.wait(CHECK_AGAIN_S)
    data = [{"name": c.name, "verdict": c.verdict, "said": c.said} for c in checks]
    ctx.note("preflight", "; ".join(map(str, wrong)) or "all in order", checks=data, failsafes=ctx.failsafes)
    if not wrong:
        return State.UPLOADING, "preflight in order"
    for check in wrong:
        ctx.tell(str(check))
    return _after_preflight(ctx, wrong[0].name, "; ".join(map(str, wrong)), service)


def _after_preflight(ctx: Context, name: str, reason: str, service: DroneService) -> After:
    if name == "pads":
        ctx.unusable[service.destination] = ctx.now_s
        return State.REPLANNING, reason
    if name in ("battery", "wind"):
        ctx.wait(POLL_S)
        return State.REPLANNING, reason
    return State.STOPPED, f"preflight: {reason}"


def uploading(ctx: Context) -> After:
    """Send fence, rally points and mission, and read them back."""
    service, leg = make_leg(ctx)
    parts = (
        (MissionKind.FENCE, leg.document.fence if leg.document.fence.areas else None),
        (MissionKind.RALLY, leg.document.rally if len(leg.document.rally) else None),
        (MissionKind.MISSION, leg.document.mission),
    )
    for kind, part in parts:
        reason = ""
        for _ in range(UPLOADS):
            try:
                if part is None:
                    ctx.vehicle.clear(kind)
                    reason = ""
                    break
                outcome = ctx.vehicle.upload(part)
            except LinkError as error:
                reason = str(error)
            else:
                reason = "" if outcome.verified else str(outcome)
                ctx.note("upload", str(outcome), part=kind.word, verified=outcome.verified, attempts=outcome.attempts)
                if outcome.verified or outcome.state is UploadState.REFUSED:
                    break
            ctx.wait(2.0)
        if reason:
            return State.STOPPED, f"the {kind.word} could not be uploaded: {reason}"
    ctx.vehicle.changes()  # what we have just sent
    ctx.leg = _new_leg(ctx, service, leg)
    return State.READY, f"the leg to {service.destination} is uploaded and verified"


def _new_leg(ctx: Context, service: DroneService, mission: LegMission) -> Leg:
    reach = ctx.replanner().reach(ctx.wind.forecast(ctx.now_s), ctx.belief.next_flight())
    flown = reach.to_the_end(reach.way(service.origin, service.via, service.destination), ctx.now_s, climbs=True)
    return Leg(
        origin=service.origin,
        destination=service.destination,
        via=service.via,
        diverts=service.diverts,
        mission=mission,
        commanded_mps=service.ground_speed_mps,
        planned_s=float(reach.expected(flown.time_s)),
        planned_soc=ctx.soc - float(reach.expected(flown.soc)) * ctx.belief.factor,
        modelled=ModelledUse(reach.soc_per_s, reach.soc_climb - reach.soc_per_s * reach.rules.climb_s, reach.load),
        last=service.destination == ctx.mandate.request.destination,
    )


def ready(ctx: Context) -> After:
    """Ask before the take-off where that was asked for."""
    leg = ctx.leg
    if leg is None:
        return State.PREFLIGHT, "the leg is prepared anew"
    mandate = ctx.mandate
    must = mandate.asking == "each" or (mandate.asking == "once" and not ctx.asked_once)
    if must:
        if not ctx.operator.present:
            return State.STOPPED, "nobody is there to allow the take-off (--yes for rehearsals)"
        question = (
            f"take off from {leg.origin} to {leg.destination}: {leg.planned_s / 60:.0f} min, landing with about "
            f"{100 * leg.planned_soc:.0f} %; yes or no?"
        )
        ctx.operator.ask(question)
        answer = ctx_answer(ctx, ("yes", "y", "no", "n"))
        ctx.note("operator", f"asked to {question} answered {answer}")
        if answer.startswith("n"):
            return State.STOPPED, f"the operator does not allow the take-off to {leg.destination}"
        ctx.asked_once = True
        if ctx.soc < (ctx.charge_to or 0.0) - 0.03:
            return State.REPLANNING, "the charge has fallen while waiting for the operator"
    if ctx.stop_after_leg:
        return State.STOPPED, f"the operator asked to stay at {ctx.station}"
    return State.ARMING, f"to {leg.destination}"


def ctx_answer(ctx: Context, words: tuple[str, ...]) -> str:
    """Let time pass until the operator says one of some words."""
    while True:
        while ctx.words:
            word = ctx.words.pop(0)
            if word in words:
                return word
            ctx.operator.ask(f"please answer {', '.join(words)}")
        ctx.tick()


def arming(ctx: Context) -> After:
    """Arm and start, until it is in the air."""
    leg = ctx.leg
    if leg is None or ctx.plan is None:
        return State.PREFLIGHT, "the leg is prepared anew"
    ctx.wait(FRESH_S)
    ctx.flight += 1
    leg.start_s, leg.soc_start, leg.told_start = ctx.now_s, ctx.soc, ctx.told_soc
    if leg.modelled is not None:
        leg.modelled.begin(ctx.now_s)
    if ctx.charged or not math.isfinite(ctx.flown_from[0]):
        ctx.flown_from = (ctx.told_soc, ctx.soc)
    ctx.note(
        "leg", f"flight {ctx.flight}: {leg.origin} to {leg.destination}",
        origin=leg.origin, destination=leg.destination, via=list(leg.via),
        planned_s=leg.planned_s, planned_soc=leg.planned_soc, soc=ctx.soc, told_soc=ctx.told_soc, ground_speed_mps=leg.commanded_mps,
        way=[list(point) for point in leg.mission.way], last=leg.last, **ctx.standing(),
    )  # fmt: skip
    problem = ""
    for _ in range(STARTS):
        try:
            ctx.vehicle.start(ARM_PATIENCE_S)
        except LinkError as error:
            problem = str(error)
            ctx.note("start", problem)
            ctx.wait(2.0)
            if ctx.in_air:
                break
            continue
        if _took_off(ctx):
            problem = ""
            break
        problem = "it does not take off"
    if problem and not ctx.in_air:
        return _disarmed(ctx, f"the take-off to {leg.destination} failed: {problem}")
    ctx.station = None
    ctx.charged = False
    ctx.charge_to = None
    return State.FLYING, f"in the air to {leg.destination}"


def _took_off(ctx: Context) -> bool:
    end = ctx.clock.now_s() + TAKE_OFF_S
    while ctx.clock.now_s() < end:
        refuse_foreign(ctx, ctx.tick(), ("mission", "takeoff", "guided"))
        s = ctx.sample
        if ctx.in_air and s is not None and s.height_m > 2.0:
            return True
    return False


def _disarmed(ctx: Context, reason: str) -> After:
    """Leave it disarmed on the ground."""
    for _ in range(STARTS):
        if ctx.on_ground:
            break
        try:
            ctx.vehicle.disarm()
        except LinkError as error:
            ctx.note("start", str(error))
        ctx.wait(2.0)
    ctx.flight -= 1
    return (State.STOPPED if ctx.on_ground else State.HOLDING), reason
