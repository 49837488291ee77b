"""What is done in the air: watch, learn, send the speed again, turn elsewhere; and find out where it has landed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

from skyway.link.supervisor.flight.pilot_intervention import landed, refuse_foreign
from skyway.link.supervisor.legs import cross_track_m, turn_leg, with_places
from skyway.link.supervisor.states import State, Turn
from skyway.link.vehicle.divert import Diversion, Refuge
from skyway.models.base.errors import InputError, LinkError, VehicleTimeoutError
from skyway.planner.online.replan_flight import Airborne, FlightReplanner

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.legs import LegMission
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.planner.online.energy_belief import EnergyBelief
    from skyway.planner.online.replan import Decision

DECIDE_EVERY_S = 10.0
LAND_AGAIN_S = 5.0
SUDDEN_S = 15.0
"""So long a loss of charge counts as sudden."""
LANDING_SHARE, MIN_DOUBTED_SOC = 2.0, 0.1
"""Below so many times the charge of a landing, or below this charge, a loss is not doubted for longer than wrong values last."""
LEARN_SOC = 0.04
"""From so much charge used on, the energy of this very flight is counted in."""
_WAY_MODES = ("mission", "takeoff")


def flying(ctx: Context) -> After:
    """Watch a leg to its landing, deciding every ten seconds."""
    leg = ctx.leg
    if leg is None:
        return State.HOLDING, "it flies, and which leg is not known"
    ctx.request_telemetry()
    _free_pad(ctx, leg.origin)
    replanner = _replanner(ctx)
    decided_s = ctx.now_s
    while True:
        refuse_foreign(ctx, ctx.tick(), _WAY_MODES)
        if landed(ctx):
            return State.LANDED, "landed and disarmed"
        if ctx.vehicle.changing or not (_due(ctx, decided_s) and _climbed(ctx)):
            continue
        decided_s = ctx.now_s
        decision = _decide(ctx, replanner)
        if decision is None:
            continue
        after = _act(ctx, decision)
        if after is not None:
            return after


def _free_pad(ctx: Context, station: str) -> None:
    """Give the pad back that it has left."""
    try:
        ctx.pads.release(station, str(ctx.sample.system if ctx.sample is not None else 1))
    except (LinkError, InputError) as error:
        ctx.note("pad", f"the pad at {station} could not be given back: {error}")


def _replanner(ctx: Context) -> FlightReplanner | None:
    return None if ctx.job.replanning is None else FlightReplanner(ctx.replanner())


def _due(ctx: Context, decided_s: float) -> bool:
    """Whether to decide again: every ten seconds, and at once where charge has been lost."""
    return ctx.now_s >= decided_s + DECIDE_EVERY_S or ctx.lost_s > decided_s


def _climbed(ctx: Context) -> bool:
    """Whether it cruises: not still climbing at the start, nor landing at the end."""
    s = ctx.sample
    return s is not None and s.height_m > 0.6 * ctx.job.scenario.rules.cruise_height_m and not _landing(ctx, s)


def _landing(ctx: Context, s: TelemetrySample) -> bool:
    if ctx.leg is None or ctx.place is None:
        return False
    end = ctx.leg.mission.way[-1]
    return cross_track_m([end, end], s.lat_deg, s.lon_deg) < 30.0


# Deciding


def airborne(ctx: Context) -> Airborne | None:
    """What is known of the flight; None while the position or the charge is not."""
    leg, place = ctx.leg, ctx.place
    if leg is None or place is None or not math.isfinite(ctx.soc):
        return None
    return Airborne(
        here=place,
        time_s=ctx.now_s,
        soc=ctx.soc,
        via=_ahead(ctx),
        destination=leg.destination,
        commanded_mps=leg.commanded_mps,
        diverts=tuple(dict.fromkeys((*leg.diverts, leg.origin, *leg.via))),
        behind=frozenset((leg.origin, *ctx.visited)),
        sudden=ctx.now_s < ctx.lost_s + SUDDEN_S,
        airspeed_limit_mps=_airspeed_limit(ctx),
    )


def _airspeed_limit(ctx: Context) -> float:
    """Airspeed that its lean does not let it exceed; infinite where it flies as fast as it is told."""
    estimate = ctx.wind.estimate
    if estimate is None:
        return math.inf
    north, east = ctx.outlook.get("believed_north_mps"), ctx.outlook.get("believed_east_mps")
    if north is None or east is None:
        north, east = estimate.north_mps, estimate.east_mps
    return ctx.lean.airspeed_mps(
        (float(north), float(east))
    )  # with what the rest is worked out with: it gives the speed seen


def _ahead(ctx: Context) -> tuple[str, ...]:
    """Stations of the leg that are still to be overflown: by how far along its way the vehicle is."""
    leg = ctx.leg
    if leg is None or ctx.place is None or not leg.via:
        return ()
    way = leg.mission.way
    distances = [cross_track_m(way[k : k + 2], *ctx.place) for k in range(len(way) - 1)]
    piece = min(range(len(distances)), key=lambda k: distances[k])
    return leg.via[piece:] if len(way) == len(leg.via) + 2 else ()


def belief_now(ctx: Context) -> EnergyBelief:
    """How much energy flights take, this one so far counted in."""
    leg = ctx.leg
    if leg is None or not math.isfinite(leg.soc_start):
        return ctx.belief.next_flight()
    used = leg.soc_start - ctx.soc
    if leg.modelled is None or not used > LEARN_SOC:
        return ctx.belief.next_flight()
    return ctx.belief.in_flight(used, leg.modelled.total)


def _decide(ctx: Context, replanner: FlightReplanner | None) -> Decision | None:
    known = airborne(ctx)
    if replanner is None or known is None:
        return None
    decision = replanner.decide(known, ctx.wind.forecast(ctx.now_s), belief_now(ctx))
    _outlook(ctx, decision.figures)
    if decision.action != "continue":
        _tell(ctx, decision)
    return decision


def _tell(ctx: Context, decision: Decision) -> None:
    estimate = ctx.wind.estimate
    wind = {} if estimate is None else {"wind_sigma_mps": estimate.sigma_mps, "wind_source": estimate.source}
    ctx.note("decision", decision.reason, action=decision.action, where="flight", **dict(decision.figures), **wind)
    ctx.tell(f"{decision.action}: {decision.reason}")


def _outlook(ctx: Context, figures: Any) -> None:
    """Keep expected against actual for the view and the track."""
    leg = ctx.leg
    if leg is None or ctx.place is None:
        return
    elapsed = ctx.now_s - leg.start_s
    ctx.outlook = {
        "destination": leg.destination,
        "left_s": figures.get("left_s"),
        "late_s": elapsed + float(figures.get("left_s", math.nan)) - leg.planned_s,
        "soc_land": figures.get("soc_land"),
        "planned_soc_land": leg.planned_soc,
        "p_below_reserve": figures.get("p_below_reserve"),
        "cross_track_m": cross_track_m(leg.mission.way, *ctx.place),
        "commanded_mps": leg.commanded_mps,
        "believed_north_mps": figures.get("wind_north_mps"),
        "believed_east_mps": figures.get("wind_east_mps"),
        "energy_factor": figures.get("energy_factor"),
        "limited": ctx.lean.said(leg.commanded_mps) if ctx.lean.limited else None,
    }


def _act(ctx: Context, decision: Decision) -> After | None:
    """Do what was decided; None flies on."""
    leg = ctx.leg
    if leg is None:
        return None
    if decision.action == "speed" and decision.speed_mps is not None:
        try:
            ctx.vehicle.change_speed(decision.speed_mps)
        except LinkError as error:
            ctx.note("speed", f"not taken over: {error}")
        else:
            leg.commanded_mps = decision.speed_mps
        return None
    if decision.action == "station" and decision.station is not None:
        after = _turn(ctx, decision.station, State.FLYING)
        return None if after[0] is State.FLYING else after
    if decision.action == "divert" and decision.station is not None:
        ctx.divert_to, ctx.turned = decision.station, False
        if leg.modelled is None or leg.modelled.load is None:
            ctx.belief = belief_now(ctx)  # what this way takes; the way back would tell another wind
            leg.learns = False
        return State.DIVERTING, f"to {decision.station}: {decision.reason}"
    if decision.action == "land":
        if _unsure(ctx):
            return None
        ctx.divert_to, ctx.turned = None, False
        _intend(ctx, None)
        return State.DIVERTING, decision.reason
    return None


def _intend(ctx: Context, station: str | None) -> None:
    """Keep in the leg where it is going now: the last thing on disk before it is commanded."""
    leg = ctx.leg
    if leg is None:
        return
    ctx.leg = replace(leg, destination=station or "here", via=(), last=False)
    ctx.note("turn", f"turns to {station}" if station else "lands here", destination=station, begun=True)


# Going elsewhere


def diverting(ctx: Context) -> After:
    """Go to the divert station by a new mission, or where that is not verified by reposition; watch it land."""
    if ctx.divert_to is None:
        return _land_here(ctx)
    if not ctx.turned:
        after = _turn(ctx, ctx.divert_to, State.DIVERTING)
        if after[0] is not State.DIVERTING:
            return after
    replanner, decided_s = FlightReplanner(ctx.replanner(), turned=True), ctx.now_s
    while True:
        refuse_foreign(ctx, ctx.tick(), _WAY_MODES)
        if landed(ctx):
            return State.LANDED, "landed and disarmed after a divert"
        if ctx.vehicle.changing or not (_due(ctx, decided_s) and _climbed(ctx)):
            continue
        decided_s = ctx.now_s
        end = _watch(ctx, replanner)
        if end is not None:
            return end


def _watch(ctx: Context, replanner: FlightReplanner) -> After | None:
    """Keep expected against actual up to date; turn again only where the battery would be empty before."""
    known = airborne(ctx)
    if known is None or ctx.leg is None or ctx.leg.destination == "here":
        return None
    decision = replanner.watch(known, ctx.wind.forecast(ctx.now_s), belief_now(ctx))
    _outlook(ctx, decision.figures)
    if decision.action == "continue" or ctx.job.replanning is None:
        return None
    _tell(ctx, decision)
    if decision.action == "speed":
        return _act(ctx, decision)
    if decision.action == "divert" and decision.station is not None:
        ctx.divert_to, ctx.turned = decision.station, False
        turned = _turn(ctx, decision.station, State.DIVERTING)
        return None if turned[0] is State.DIVERTING else turned
    if _unsure(ctx):
        return None
    ctx.divert_to, ctx.turned = None, False
    _intend(ctx, None)
    return _land_here(ctx)


def _unsure(ctx: Context) -> bool:
    """Whether a landing away from any station rests on a voltage that nothing else confirms."""
    if not ctx.voltage.doubtful(affordable=_affords_doubt(ctx)):
        return False
    ctx.say(
        "gauge",
        "it does not land here: the voltage fell, and neither does the current show that charge was lost, nor does it fall on",
    )
    return True


def _affords_doubt(ctx: Context) -> bool:
    """Whether the charge as it is feared to be is still more than a landing here takes."""
    leg = ctx.leg
    if leg is None or leg.modelled is None:
        return False
    landing_soc = leg.modelled.per_s * ctx.belief.factor * ctx.job.scenario.rules.descent_s
    return ctx.soc > max(LANDING_SHARE * landing_soc, MIN_DOUBTED_SOC)


def _turn(ctx: Context, station: str, state: State) -> After:
    """Change the mission in flight so that it lands at another station."""
    leg, s = ctx.leg, ctx.sample
    if leg is None or s is None or ctx.place is None or ctx.plan is None:
        return State.HOLDING, "it cannot be turned: where it is is not known"
    _intend(ctx, station)
    plan = with_places(ctx.plan, ctx.job.scenario, [station])
    last = station == ctx.job.request.destination
    home_ground = s.alt_msl_m - s.height_m
    here = (*ctx.place, s.height_m)
    mission = turn_leg(
        plan, station, here, home_ground, leg.commanded_mps, ctx.vehicle.family.name, ctx.job.options,
        last=last, home=leg.mission.document.mission.home,
    )  # fmt: skip
    try:
        outcome = ctx.vehicle.change_in_flight(mission.document.mission, 0)
    except VehicleTimeoutError as error:
        _unfinished(ctx, station, error)
    except LinkError as error:
        ctx.note("turn", f"not by a mission: {error}", verified=False)
        return _reposition(ctx, station, plan, mission)
    ctx.note("upload", str(outcome), part="mission", verified=outcome.verified, attempts=outcome.attempts)
    if not outcome.verified:
        return _reposition(ctx, station, plan, mission)
    ctx.vehicle.changes()
    ctx.leg = replace(leg, destination=station, via=(), mission=mission, last=last)
    ctx.outlook, ctx.turned = {}, True
    ctx.note("turn", f"turned to {station}", destination=station, begun=False)
    return state, f"turned to {station}"


def _reposition(ctx: Context, station: str, plan: Any, mission: LegMission) -> After:
    """Fly to a station by reposition or GUIDED, as high as the mission there would, and land."""
    place = plan.stations[station]
    height_m = mission.document.mission.items[0].z
    diversion = Diversion(ctx.vehicle, Refuge(place.lat, place.lon, height_m))
    try:
        diversion.begin()
        while not diversion.state.over:
            ctx.tick()
            if ctx.sample is not None:
                diversion.hear(ctx.sample)
    except VehicleTimeoutError as error:
        _unfinished(ctx, station, error)
    except LinkError as error:
        return State.HOLDING, f"it could not be turned to {station}: {error}"
    if landed(ctx):
        return State.LANDED, f"landed by reposition at {station}"
    return State.HOLDING, f"the divert to {station} by reposition ended: {diversion.reason}"


def _unfinished(ctx: Context, station: str, error: VehicleTimeoutError) -> NoReturn:
    """A turn whose orders are not answered is begun again when the link is back."""
    ctx.divert_to, ctx.turned = station, False
    raise Turn(State.LOST_LINK, f"while it was turned to {station}: {error}") from error


def _land_here(ctx: Context) -> After:
    """Land where it is; told again until it does."""
    told_s = -math.inf
    while True:
        if ctx.vehicle.mode != "land" and ctx.vehicle.armed and ctx.now_s >= told_s + LAND_AGAIN_S:
            try:
                ctx.vehicle.land()
            except LinkError as error:
                ctx.note("turn", f"landing was not taken over: {error}")
            told_s = ctx.now_s
        refuse_foreign(ctx, ctx.tick(), ("land", "mission"))
        if landed(ctx):
            return State.LANDED, "landed where it was"
