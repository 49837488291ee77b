"""Actions in the air: monitor, decide, repeat the speed command, divert."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.command.orders import obey, refuges
from skyway.link.supervisor.flight.known import information
from skyway.link.supervisor.flight.pads_ahead import PadsAhead
from skyway.link.supervisor.flight.phase import cruises
from skyway.link.supervisor.flight.pilot_intervention import landed, refuse_foreign
from skyway.link.supervisor.flight.release import ReleaseWatch, watch_release
from skyway.link.supervisor.flight.turn import intend, land_here, turn
from skyway.link.supervisor.journal.entries import Decided, GaugeNote, PadAnswered, SpeedNote
from skyway.link.supervisor.journal.parts import Expected
from skyway.link.supervisor.legs import cross_track_m
from skyway.link.supervisor.observed.link_watch import request_telemetry
from skyway.link.supervisor.states import State
from skyway.link.supervisor.work import air as work_air
from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.formatting import speed_text
from skyway.planner.online.information import FlightMemory

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.link.supervisor.context import After, Context
    from skyway.planner.online.information import Decision

DECIDE_EVERY_S = 10.0
LANDING_SHARE, MIN_DOUBTED_SOC = 2.0, 0.1
"""A loss is doubted no longer than wrong values last if the charge is below this multiple of that of a landing, or
below this SoC."""
_WAY_MODES = ("mission", "takeoff")


def flying(ctx: Context) -> After:
    """Monitor a leg until its landing, with a decision every ten seconds."""
    leg = ctx.delivery.leg
    if leg is None:
        return State.HOLDING, "the drone is in the air on an unknown leg"
    request_telemetry(ctx)
    _free_pad(ctx, leg.origin)
    if ctx.job.work is not None:
        return _until_landed(ctx, lambda: work_air.look(ctx), work_air.advance) or (State.LANDED, "landed and disarmed")
    memory, pads, watch = FlightMemory(), PadsAhead(ctx.pads, lambda: ctx.now_s), ReleaseWatch()
    end = _until_landed(ctx, lambda: _fly_on(ctx, memory, pads), lambda now: watch_release(now, watch))
    return end or (State.LANDED, "landed and disarmed")


def _until_landed(
    ctx: Context, decide: Callable[[], After | None], each: Callable[[Context], None] = lambda _: None
) -> After | None:
    """Monitor a flight, with a decision every ten seconds of its cruise; None once it has landed. `each` is called every second."""
    decided_s = ctx.now_s
    while True:
        refuse_foreign(ctx, ctx.tick(), (*_WAY_MODES, "hold") if ctx.stands_in_air else _WAY_MODES)
        if landed(ctx):
            return None
        each(ctx)
        ordered = obey(ctx)
        if ordered is not None:
            return ordered
        if ctx.give_way.holds or _cruises(ctx):
            gives_way = ctx.give_way.look(ctx, refuges(ctx))
            if gives_way is not None:
                return gives_way
        if ctx.vehicle.changing or not (_due(ctx, decided_s) and _cruises(ctx)):
            continue
        decided_s = ctx.now_s
        after = decide()
        if after is not None:
            return after


def _free_pad(ctx: Context, station: str) -> None:
    """Release the pad from which the drone took off."""
    try:
        ctx.pads.release(station, ctx.observed.system)
    except (LinkError, InputError) as error:
        ctx.note(PadAnswered(), f"the pad at {station} could not be released: {error}")


def _due(ctx: Context, decided_s: float) -> bool:
    """Whether a decision is due: every ten seconds, and at once after a loss of charge."""
    return ctx.now_s >= decided_s + DECIDE_EVERY_S or ctx.battery.lost_s > decided_s


def _cruises(ctx: Context) -> bool:
    return ctx.observed.sample is not None and cruises(ctx, ctx.observed.sample)


# Decisions


def _fly_on(ctx: Context, memory: FlightMemory, pads: PadsAhead) -> After | None:
    """Decide and act; None continues the flight."""
    known = information(ctx, memory, pads)
    if not ctx.job.replanning or known is None:
        return None
    decision = ctx.policy().in_air(known)
    look_ahead(ctx, decision.figures)
    if decision.action == "continue" or _waits(ctx, decision):
        return None
    _tell(ctx, decision)
    return _act(ctx, decision)


def _waits(ctx: Context, decision: Decision) -> bool:
    """Whether a decision can wait until a holding drone continues: all except diverting and landing."""
    leg = ctx.delivery.leg
    if leg is None or not ctx.stands_in_air:
        return False
    if decision.action in ("divert", "land"):
        ctx.conversation.pause(on=False)
        ctx.give_way.end()
        return False
    leg.command(leg.commanded_mps, ctx.now_s)  # it holds on an order
    return True


def look_ahead(ctx: Context, figures: Mapping[str, Any]) -> None:
    """Store the expectation of a decision with the leg."""
    leg, place = ctx.delivery.leg, ctx.place
    if leg is None or place is None:
        return
    left_s = figures.get("left_s")
    leg.expect(
        Expected(
            destination=leg.destination,
            left_s=left_s,
            late_s=None if left_s is None else ctx.now_s - leg.start_s + float(left_s) - leg.planned_s,
            soc_land=figures.get("soc_land"),
            planned_soc_land=leg.planned_soc,
            p_below_reserve=figures.get("p_below_reserve"),
            cross_track_m=cross_track_m(leg.mission.way, *place),
            commanded_mps=leg.commanded_mps,
            believed_north_mps=figures.get("wind_north_mps"),
            believed_east_mps=figures.get("wind_east_mps"),
            energy_factor=figures.get("energy_factor"),
            limited=ctx.lean.said(leg.commanded_mps) if ctx.lean.limited else None,
        )
    )


def _tell(ctx: Context, decision: Decision) -> None:
    estimate = ctx.wind.estimate
    wind = {} if estimate is None else {"wind_sigma_mps": estimate.sigma_mps, "wind_source": estimate.source}
    figures = dict(decision.figures) | wind
    ctx.note(Decided(action=decision.action, where="flight", figures=figures), decision.reason)
    ctx.tell(f"{decision.action}: {decision.reason}")


def _act(ctx: Context, decision: Decision) -> After | None:
    """Execute a decision; None continues the flight."""
    leg = ctx.delivery.leg
    if leg is None:
        return None
    if decision.action == "speed" and decision.speed_mps is not None:
        try:
            ctx.vehicle.change_speed(decision.speed_mps)
        except LinkError as error:
            ctx.note(SpeedNote(), f"the ground speed of {speed_text(decision.speed_mps)} was not accepted: {error}")
        else:
            leg.command(decision.speed_mps, ctx.now_s)
        return None
    if decision.action == "station" and decision.station is not None:
        after = turn(ctx, decision.station, State.FLYING)
        return None if after[0] is State.FLYING else after
    if decision.action == "divert" and decision.station is not None:
        ctx.divert.to(decision.station)
        if leg.modelled is None or leg.modelled.load is None:
            ctx.energy.keep(leg, ctx.battery.soc)  # the energy of this route; another route would have another wind
            leg.learn_nothing()
        return State.DIVERTING, f"diverting to {decision.station}: {decision.reason}"
    if decision.action == "land":
        if _unsure(ctx):
            return None
        ctx.divert.call_off()
        intend(ctx, None)
        return State.DIVERTING, decision.reason
    return None


# Divert


def diverting(ctx: Context) -> After:
    """Fly to the divert station by a new mission, or if that is not verified by reposition; monitor the landing."""
    if ctx.divert.station is None:
        return land_here(ctx)
    if not ctx.divert.turned:
        after = turn(ctx, ctx.divert.station, State.DIVERTING)
        if after[0] is not State.DIVERTING:
            return after
    memory, pads, watch = FlightMemory(turned=True), PadsAhead(ctx.pads, lambda: ctx.now_s), ReleaseWatch()
    end = _until_landed(ctx, lambda: _watch(ctx, memory, pads), lambda now: watch_release(now, watch))
    return end or (State.LANDED, "landed and disarmed after a divert")


def _watch(ctx: Context, memory: FlightMemory, pads: PadsAhead) -> After | None:
    """Update expected against actual; turn again only if the battery would be empty before the landing."""
    if ctx.job.work is not None:
        return None
    known = information(ctx, memory, pads)
    if known is None or ctx.delivery.leg is None or ctx.delivery.leg.destination == "here":
        return None
    decision = ctx.policy().in_air(known)
    look_ahead(ctx, decision.figures)
    if decision.action == "continue" or not ctx.job.replanning or _waits(ctx, decision):
        return None
    _tell(ctx, decision)
    if decision.action == "speed":
        return _act(ctx, decision)
    if decision.action == "divert" and decision.station is not None:
        ctx.divert.to(decision.station)
        turned = turn(ctx, decision.station, State.DIVERTING)
        return None if turned[0] is State.DIVERTING else turned
    if _unsure(ctx):
        return None
    ctx.divert.call_off()
    intend(ctx, None)
    return land_here(ctx)


def _unsure(ctx: Context) -> bool:
    """Whether a landing away from any station depends on a voltage that no other measurement confirms."""
    if not ctx.battery.doubtful(affordable=_affords_doubt(ctx)):
        return False
    ctx.say(
        GaugeNote(),
        "not landing here yet: the voltage fell, but neither the current nor a further fall confirms a loss of charge",
    )
    return True


def _affords_doubt(ctx: Context) -> bool:
    """Whether the charge after the feared loss still exceeds that of a landing here."""
    leg = ctx.delivery.leg
    if leg is None or leg.modelled is None:
        return False
    landing_soc = leg.modelled.per_s * ctx.energy.belief.mean_ratio * ctx.job.scenario.rules.descent_s
    return ctx.battery.soc > max(LANDING_SHARE * landing_soc, MIN_DOUBTED_SOC)
