"""Diverting the vehicle in flight: by another mission, or if that cannot be verified, by reposition; landing at the current position."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

from skyway.link.supervisor.flight.pilot_intervention import landed, refuse_foreign
from skyway.link.supervisor.journal.entries import Turned, Uploaded
from skyway.link.supervisor.legs import turn_leg, with_places
from skyway.link.supervisor.states import State, Turn
from skyway.link.vehicle.divert import Diversion, Refuge
from skyway.missions.recharge.parts import orders_off
from skyway.models.base import geodesy
from skyway.models.base.errors import LinkError, VehicleTimeoutError

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.legs import Leg, LegMission

LAND_AGAIN_S = 5.0


def intend(ctx: Context, station: str | None) -> None:
    """Store the destination with the leg: the last record on disk before the command."""
    leg = ctx.delivery.leg
    if leg is None:
        return
    ctx.delivery.take_leg(replace(leg, destination=station or "here", via=(), last=False))
    ctx.note(Turned(destination=station, begun=True), f"diverting to {station}" if station else "landing here")


def turn(ctx: Context, station: str, state: State) -> After:
    """Change the mission in flight so that it lands at another station."""
    leg, s = ctx.delivery.leg, ctx.observed.sample
    if leg is None or s is None or ctx.place is None or ctx.delivery.plan is None:
        return State.HOLDING, f"the drone cannot be diverted to {station}: its position is not known"
    intend(ctx, station)
    last = ctx.delivers_at(station)
    back = ctx.job.onward if last else None
    places = [station] if back is None else [station, back.destination, *back.via]
    plan = with_places(ctx.delivery.plan, ctx.job.scenario, places)
    home_ground = s.alt_msl_m - s.height_m
    here, speed_mps = (*ctx.place, _height_m(ctx, leg, s.height_m)), _speed_mps(ctx, ctx.place, station)
    mission = turn_leg(
        plan, station, here, home_ground, speed_mps, ctx.vehicle.family, ctx.job.options,
        last=last, home=leg.mission.document.mission.home, onward=back,
    )  # fmt: skip
    if ctx.work.flight is not None:
        mission = _with_all_off(mission, ctx.work.flight.mission)
    try:
        outcome = ctx.vehicle.change_in_flight(mission.document.mission, 0)
    except VehicleTimeoutError as error:
        _unfinished(ctx, station, error)
    except LinkError as error:
        ctx.note(Turned(verified=False), f"the divert mission was not accepted: {error}")
        return _reposition(ctx, station, plan, mission)
    ctx.note(Uploaded(part="mission", verified=outcome.verified, attempts=outcome.attempts), str(outcome))
    if not outcome.verified:
        return _reposition(ctx, station, plan, mission)
    ctx.vehicle.changes()
    leg.command(speed_mps, ctx.now_s)
    ctx.delivery.take_leg(replace(leg, destination=station, via=(), mission=mission, last=last, lookahead=None))
    ctx.divert.done()
    ctx.note(Turned(destination=station, begun=False), f"diverted to {station}")
    return state, f"diverted to {station}"


def _with_all_off(mission: LegMission, work: LegMission) -> LegMission:
    """Stop, before the first place of a mission, what the work runs on its way (pictures, video, spraying)."""
    whole = mission.document.mission
    first, *others = whole.items
    items = (first, *orders_off(work.document.mission.items), *others)
    return replace(mission, document=replace(mission.document, mission=replace(whole, items=items)))


def _height_m(ctx: Context, leg: Leg, now_m: float) -> float:
    """Height of the route to a station above home, m: over zones and terrain as high as the leg, for which the route was found free."""
    network = ctx.job.scenario.network
    highest_m = leg.top_m - leg.home_ground_m
    if (network.zones is None and network.over is None) or not math.isfinite(highest_m):
        return now_m
    return max(now_m, highest_m)


def _speed_mps(ctx: Context, here: tuple[float, float], station: str) -> float:
    """Ground speed of the planned airspeed on the route to a station, in the wind as now known; for work that of its ways to pads."""
    if ctx.job.work is not None:
        return ctx.job.work.transit_mps
    cleared_m = (
        -math.inf if ctx.delivery.leg is None else ctx.delivery.leg.top_m - ctx.job.scenario.rules.cruise_height_m
    )
    reach = ctx.policy().reach(ctx.wind.forecast(ctx.now_s), ctx.energy.belief, cleared_m=cleared_m)
    way = reach.way(here, (), station)
    return round(reach.ground_speed_mps(way, geodesy.distance_m(*way[0], *way[1]), ctx.now_s), 1)


def _reposition(ctx: Context, station: str, plan: Any, mission: LegMission) -> After:
    """Fly to a station by reposition or GUIDED, at the height of the mission there, and land."""
    place = plan.stations[station]
    height_m = mission.document.mission.items[0].z
    diversion = Diversion(ctx.vehicle, Refuge(place.lat, place.lon, height_m))
    try:
        diversion.begin()
        while not diversion.state.over:
            ctx.tick()
            if ctx.observed.sample is not None:
                diversion.hear(ctx.observed.sample)
    except VehicleTimeoutError as error:
        _unfinished(ctx, station, error)
    except LinkError as error:
        return State.HOLDING, f"the drone could not be diverted to {station}: {error}"
    if landed(ctx):
        return State.LANDED, f"landed at {station}, sent there by reposition"
    return State.HOLDING, f"the divert to {station} by reposition ended: {diversion.reason}"


def _unfinished(ctx: Context, station: str, error: VehicleTimeoutError) -> NoReturn:
    """Return to the state for an unfinished turn: its commands are repeated when the link is back."""
    ctx.divert.to(station)
    raise Turn(State.LOST_LINK, f"the link was lost while the drone was diverted to {station}: {error}") from error


def land_here(ctx: Context) -> After:
    """Land at the present position; the command is repeated until the vehicle lands."""
    commanded_s = -math.inf
    while True:
        if ctx.vehicle.mode != "land" and ctx.vehicle.armed and ctx.now_s >= commanded_s + LAND_AGAIN_S:
            try:
                ctx.vehicle.land()
            except LinkError as error:
                ctx.note(Turned(), f"the order to land was not accepted: {error}")
            commanded_s = ctx.now_s
        refuse_foreign(ctx, ctx.tick(), ("land", "mission"))
        if landed(ctx):
            return State.LANDED, "landed and disarmed where it was"
