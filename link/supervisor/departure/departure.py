"""Actions before a take-off: build the leg, check, upload, ask, arm and start."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.verified import UploadState
from skyway.link.supervisor.departure.briefing import Checklist, brief
from skyway.link.supervisor.departure.parameter_changes import apply
from skyway.link.supervisor.departure.preflight import run_checks
from skyway.link.supervisor.flight.crash import crashed
from skyway.link.supervisor.flight.pilot_intervention import refuse_foreign
from skyway.link.supervisor.journal.entries import LegBegun, ListDone, OperatorNote, StartNote, Uploaded
from skyway.link.supervisor.journal.parts import Checked, winds
from skyway.link.supervisor.journal.standing import standing
from skyway.link.supervisor.legs import Leg, plan_leg, with_places
from skyway.link.supervisor.observed.link_watch import must_answer, unanswered, wake
from skyway.link.supervisor.observed.vehicle_texts import tell_texts
from skyway.link.supervisor.soc.modelled_use import ModelledUse
from skyway.link.supervisor.states import State, Turn
from skyway.link.supervisor.work import ground as work_ground
from skyway.models.base.errors import CommandRefusedError, LinkError, VehicleTimeoutError
from skyway.models.base.formatting import duration, percent

if TYPE_CHECKING:
    from skyway.link.protocol.verified import Part
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.departure.preflight import Check
    from skyway.link.supervisor.legs import LegMission
    from skyway.models.composition.service import DroneService

CHECK_AGAIN_S, CHECK_PATIENCE_S = 5.0, 120.0
UNKNOWN_PATIENCE_S = 840.0
"""Maximum wait for unknown data, s: longer than for a known fault, and nearly as long as the state may last."""
REPLAN_AGAIN_S = 10.0
ARM_PATIENCE_S = 90.0
TAKE_OFF_S = 60.0
FRESH_S = 2.0
"""Time to receive telemetry before a take-off, s, so that the data are current."""
UPLOADS = 3
STARTS = 3


def next_service(ctx: Context, speed_mps: float | None = None) -> DroneService:
    """Return the next leg, with its divert stations and ground speed in the wind; the given one if nothing changed."""
    if ctx.delivery.plan is None or not ctx.delivery.plan.services:
        raise Turn(State.STOPPED, _no_plan(ctx))
    service = ctx.delivery.plan.services[0]
    if speed_mps is not None:
        return replace(service, diverts=ctx.delivery.diverts, ground_speed_mps=speed_mps)
    reach = ctx.policy().reach(ctx.wind.forecast(ctx.now_s), ctx.energy.belief)
    way = reach.way(service.origin, service.via, service.destination)
    speed = reach.ground_speed_mps(way, service.distance_m, ctx.now_s)
    return replace(service, diverts=ctx.delivery.diverts, ground_speed_mps=round(speed, 2))


def _no_plan(ctx: Context) -> str:
    return f"the plan has no leg from {ctx.delivery.station or 'here'}: plan again from there, then fly that plan"


def make_leg(ctx: Context, speed_mps: float | None = None) -> tuple[DroneService, LegMission]:
    """Build the mission of the next leg."""
    if ctx.job.work is not None:
        service, flight = work_ground.next_flight(ctx)
        return service, flight.mission
    service = next_service(ctx, speed_mps)
    if ctx.delivery.plan is None:
        raise Turn(State.STOPPED, _no_plan(ctx))
    job = ctx.job
    plan = replace(
        with_places(ctx.delivery.plan, job.scenario, service.diverts),
        services=(service, *ctx.delivery.plan.services[1:]),
    )
    last = ctx.delivers_at(service.destination)
    back = job.onward if last else None
    if back is not None:
        plan = with_places(plan, job.scenario, (back.destination, *back.via, *back.diverts))
    return service, plan_leg(plan, service, ctx.vehicle.family, job.options, last=last, onward=back)


def preflight(ctx: Context) -> After:
    """Go through the checklist until all entries are in order; a fault that cannot disappear ends the delivery with its reason."""
    wake(ctx)
    service, leg = make_leg(ctx)
    begun_s, shown = ctx.clock.now_s(), Checklist(ctx)
    while True:
        waited_s = ctx.clock.now_s() - begun_s
        try:
            checks = [shown.take(check) for check in run_checks(ctx, service, leg)]
        except LinkError as error:
            if isinstance(error, VehicleTimeoutError):
                unanswered(ctx, error)
            if waited_s >= (UNKNOWN_PATIENCE_S if isinstance(error, VehicleTimeoutError) else CHECK_PATIENCE_S):
                return State.STOPPED, f"not ready for take-off: {error}"
            shown.waits(f"the checks are not finished: {error}", CHECK_PATIENCE_S - waited_s)
            ctx.wait(CHECK_AGAIN_S)
            continue
        wrong = [check for check in checks if not check.ok]
        unknown = [check for check in wrong if check.verdict == "unknown" and check.waits]
        if unknown:
            must_answer(ctx, "; ".join(map(str, unknown)))
        elif not wrong or any(not check.waits for check in wrong):
            break  # a failed entry may follow from an unknown one
        patience_s = UNKNOWN_PATIENCE_S if len(unknown) == len(wrong) else CHECK_PATIENCE_S
        if waited_s >= patience_s:
            break
        shown.waits("; ".join(map(str, wrong)), patience_s - waited_s)
        ctx.wait(CHECK_AGAIN_S)
    checked = tuple(Checked(name=one.name, verdict=one.verdict, said=one.said) for one in checks)
    reason = "; ".join(map(str, wrong)) or "all checks passed"
    ctx.note(ListDone(checks=checked, failsafes=ctx.failsafes.values), reason)
    if not wrong:
        return State.UPLOADING, reason
    return _after_preflight(ctx, wrong[0], reason)


def _after_preflight(ctx: Context, first: Check, reason: str) -> After:
    """Replan if another station, more charge or another hour helps; otherwise stop: never take off with unknown data."""
    if first.verdict == "unknown":
        return State.STOPPED, f"not ready for take-off: {reason}"
    if first.name == "attitude":
        return State.CRASHED, first.said
    if first.name in ("battery", "pads", "wind", "traffic"):
        ctx.wait(REPLAN_AGAIN_S)
        return State.REPLANNING, reason
    return State.STOPPED, f"not ready for take-off: {reason}"


def uploading(ctx: Context) -> After:
    """Upload fence, rally points and mission, and read them back."""
    service, leg = make_leg(ctx)
    parts = (
        (MissionKind.FENCE, leg.document.fence if leg.document.fence.areas else None),
        (MissionKind.RALLY, leg.document.rally if len(leg.document.rally) else None),
        (MissionKind.MISSION, leg.document.mission),
    )
    with ctx.texts.of_last_mission(on_board=ctx.delivery.flight > 0):
        for kind, part in parts:
            reason = _upload(ctx, kind, part)
            if reason:
                remedy = "Check the radio link, then continue with --resume"
                return State.STOPPED, f"the {kind.word} could not be uploaded: {reason}. {remedy}"
        tell_texts(ctx)
    ctx.vehicle.changes()  # the lists that were just uploaded
    ctx.vehicle.watch_lists(watched=True)
    ctx.delivery.take_leg(_new_leg(ctx, service, leg))
    return State.READY, f"the leg to {service.destination} is uploaded and verified"


def _upload(ctx: Context, kind: MissionKind, part: Part | None) -> str:
    """Upload one list, or clear it; return why that was not possible. A lost link does not count as an attempt."""
    reason = ""
    for _ in range(UPLOADS):
        try:
            if part is None:
                ctx.vehicle.clear(kind)
                return ""
            outcome = ctx.vehicle.upload(part)
        except LinkError as error:
            reason = str(error)
        else:
            reason = "" if outcome.verified else str(outcome)
            ctx.note(Uploaded(part=kind.word, verified=outcome.verified, attempts=outcome.attempts), str(outcome))
            if outcome.verified or outcome.state is UploadState.REFUSED:
                return reason
        must_answer(ctx, f"the {kind.word} could not be uploaded: {reason}")
        ctx.wait(2.0)
    return reason


def _new_leg(ctx: Context, service: DroneService, mission: LegMission) -> Leg:
    if ctx.work.flight is not None:
        return work_ground.leg_of(ctx, ctx.work.flight)
    reach = ctx.policy().reach(ctx.wind.forecast(ctx.now_s), ctx.energy.belief.next_flight())
    flown = reach.to_the_end(reach.way(service.origin, service.via, service.destination), ctx.now_s, climbs=True)
    return Leg(
        origin=service.origin,
        destination=service.destination,
        via=service.via,
        diverts=service.diverts,
        mission=mission,
        commanded_mps=service.ground_speed_mps,
        planned_s=float(reach.expected(flown.time_s)),
        planned_soc=ctx.battery.soc - float(reach.expected(flown.soc)) * ctx.energy.belief.mean_ratio,
        planned_soc_sd=reach.soc_sd(flown),
        modelled=ModelledUse.by(reach),
        last=ctx.delivers_at(service.destination),
    )


def ready(ctx: Context) -> After:
    """Ask for confirmation of the take-off, if that is configured."""
    leg = ctx.delivery.leg
    if leg is None:
        return State.PREFLIGHT, "preparing the leg again"
    job = ctx.job
    brief(ctx, leg)
    must = job.asking == "each" or (
        job.asking == "once" and not (ctx.conversation.take_off_confirmed and _at_pads(ctx))
    )
    if must or (job.asking != "never" and ctx.parameters.unconfirmed):
        if not ctx.conversation.attended:
            return (
                State.STOPPED,
                "nobody can allow the take-off: run skyway fly at a terminal, or with --yes in a simulation",
            )
        count = len(ctx.parameters.proposed)
        sets = "" if not count else f"set {count} parameter{'s' if count > 1 else ''} as listed, and "
        question = (
            f"{sets}take off from {leg.origin} to {leg.destination}? {duration(leg.planned_s)}, landing with about "
            f"{percent(leg.planned_soc)} of charge; yes or no?"
        )
        before = max(ctx.battery.soc, ctx.delivery.charge_to or 0.0)
        answer = ctx.conversation.answer(ctx, question, ("yes", "y", "no", "n"))
        ctx.note(OperatorNote(), f"the operator answered {answer} to: {question}")
        if answer.startswith("n"):
            return (
                State.STOPPED,
                f"the operator said no to the take-off to {leg.destination}; the drone stays at {leg.origin}, disarmed",
            )
        ctx.conversation.allow()
        if ctx.battery.soc < before - 0.03:
            fell = f"the charge fell from {percent(before)} to {percent(ctx.battery.soc)} while waiting for the answer"
            ctx.tell(f"{fell}: the leg is decided and checked again before the take-off")
            return State.REPLANNING, f"{fell}: deciding again"
    if ctx.conversation.stays:
        return State.STOPPED, f"stopped at {ctx.delivery.station} as ordered: the drone stands disarmed"
    try:
        apply(ctx)
    except LinkError as error:
        return State.STOPPED, f"a parameter that the leg to {leg.destination} needs was not set: {error}"
    return State.ARMING, f"ready to take off to {leg.destination}"


def _at_pads(ctx: Context) -> bool:
    """Whether the vehicle stands at a station with pads: elsewhere, in public space, a person must confirm arming."""
    network = ctx.job.scenario.network
    row = network.index.get(ctx.delivery.station or "")
    return row is not None and network.stations[row].pads > 0


def arming(ctx: Context) -> After:
    """Arm and start until the vehicle is in the air."""
    leg = ctx.delivery.leg
    if leg is None or ctx.delivery.plan is None:
        return State.PREFLIGHT, "preparing the leg again"
    ctx.wait(FRESH_S)
    if (aircraft := ctx.give_way.bars(ctx)) is not None:
        return State.PREFLIGHT, f"take-off delayed: {aircraft}"
    ctx.delivery.begin_flight()
    ctx.divert.call_off()  # from an earlier flight
    ctx.lean.begin()
    leg.begin(ctx.now_s, ctx.battery.soc, ctx.battery.reported_soc)
    ctx.battery.begin_flight(charged=ctx.delivery.charged)
    work_ground.note_begun(ctx)
    ctx.note(
        LegBegun(
            origin=leg.origin,
            destination=leg.destination,
            via=leg.via,
            way=leg.mission.way,
            planned_s=leg.planned_s,
            planned_soc=leg.planned_soc,
            planned_soc_sd=leg.planned_soc_sd,
            wind=winds(ctx.wind.on_way(leg.mission.way, ctx.now_s, leg.planned_s)),
            wind_origin=ctx.wind.origin,
            soc=ctx.battery.soc,
            told_soc=ctx.battery.reported_soc,
            ground_speed_mps=leg.commanded_mps,
            last=leg.last,
            standing=standing(ctx),
        ),
        f"flight {ctx.delivery.flight}: {leg.origin} to {leg.destination}",
    )
    problem = _start(ctx)
    if problem and not ctx.in_air:
        return _disarmed(ctx, f"the take-off to {leg.destination} failed: {problem}")
    ctx.delivery.take_off()
    return State.FLYING, f"in the air, on the way to {leg.destination}"


def _start(ctx: Context) -> str:
    """Arm and start until the vehicle is in the air; a refused order is repeated.

    Messages of the vehicle are processed meanwhile. An order whose answer was lost may have been executed: an armed vehicle is
    given time to take off before the order is repeated. Returns why it did not take off; empty if it did.
    """
    problem, tries = "", 0
    end = ctx.clock.now_s() + ARM_PATIENCE_S
    while tries < STARTS:
        if ctx.conversation.stays:
            return "the operator ordered the drone to stay"
        try:
            ctx.vehicle.start()
            tries += 1
            problem = f"it did not leave the ground within {duration(TAKE_OFF_S)}"
        except LinkError as error:
            refused = isinstance(error, CommandRefusedError)
            tries += int(not refused or ctx.clock.now_s() >= end)
            if isinstance(error, VehicleTimeoutError):
                unanswered(ctx, error)
            elif str(error) != problem:
                ctx.say(StartNote(), f"the drone does not start: {error}")
            problem = str(error)
            ctx.wait(2.0)
            if not ctx.vehicle.armed:
                continue
        if _took_off(ctx):
            return ""
    return problem


def _took_off(ctx: Context) -> bool:
    end = ctx.clock.now_s() + TAKE_OFF_S
    while ctx.clock.now_s() < end:
        refuse_foreign(ctx, ctx.tick(), ("mission", "takeoff", "guided"))
        s = ctx.observed.sample
        if ctx.in_air and s is not None and s.height_m > 2.0:
            return True
    return False


def _disarmed(ctx: Context, reason: str) -> After:
    """Ensure that the vehicle is disarmed on the ground."""
    for _ in range(STARTS):
        if ctx.on_ground:
            break
        try:
            ctx.vehicle.disarm()
        except LinkError as error:
            ctx.note(StartNote(), f"the drone was not disarmed: {error}")
        ctx.wait(2.0)
    ctx.delivery.not_begun()
    if not ctx.on_ground:
        return State.HOLDING, reason
    crash = crashed(ctx, ctx.status.entered_s)
    return (State.CRASHED, f"{reason}; {crash}") if crash else (State.STOPPED, reason)
