"""Information in the air, as input of the policy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.link.supervisor.legs import cross_track_m, waypoint_m
from skyway.planner.online.information import FlightMemory, Information

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.legs import Leg

OBEYED_AFTER_S, DISOBEYED_MPS, BRAKING_M = 30.0, 2.0, 250.0
"""A command counts as not obeyed if, this long after it, the ground speed still differs by this much; not within
this distance of a waypoint, where the vehicle may brake for a step over terrain."""
SUDDEN_S = 15.0
"""Time for which a loss of charge counts as sudden, s."""


def information(ctx: Context, memory: FlightMemory, pads: Mapping[str, int]) -> Information | None:
    """Information available in the air; None while the position or the charge is unknown."""
    leg, place = ctx.delivery.leg, ctx.place
    if leg is None or place is None or not math.isfinite(ctx.battery.soc):
        return None
    return Information(
        here=place,
        time_s=ctx.now_s,
        soc=ctx.battery.soc,
        forecast=ctx.wind.forecast(ctx.now_s),
        belief=ctx.energy.now(leg, ctx.battery.soc),
        visited=frozenset(ctx.delivery.visited),
        busy_pads=pads,
        roughness=ctx.wind.roughness,
        measures_wind=ctx.wind.measures,
        via=_ahead(ctx),
        destination=leg.destination,
        commanded_mps=_obeyed_mps(ctx, leg),
        diverts=tuple(dict.fromkeys((*leg.diverts, leg.origin, *leg.via))),
        left=frozenset((leg.origin, *ctx.delivery.visited)),
        cleared_m=leg.top_m - ctx.job.scenario.rules.cruise_height_m,
        sudden=ctx.now_s < ctx.battery.lost_s + SUDDEN_S,
        airspeed_limit_mps=_airspeed_limit(ctx),
        flight=memory,
    )


def _obeyed_mps(ctx: Context, leg: Leg) -> float:
    """Commanded ground speed; the flown one if it has long been different, so that the command is repeated."""
    s, commanded_mps = ctx.observed.sample, leg.commanded_mps
    if s is None or ctx.lean.limited or not ctx.now_s > leg.commanded_s + OBEYED_AFTER_S:
        return commanded_mps
    steps = ctx.job.scenario.network.over is not None
    if steps and ctx.place is not None and waypoint_m(leg, *ctx.place) < BRAKING_M:
        return commanded_mps
    flown_mps = math.hypot(s.vel_north_mps, s.vel_east_mps)
    return flown_mps if abs(flown_mps - commanded_mps) > DISOBEYED_MPS else commanded_mps


def _airspeed_limit(ctx: Context) -> float:
    """Airspeed limit due to the lean angle, m/s; infinite if the vehicle flies as fast as commanded."""
    estimate = ctx.wind.estimate
    if estimate is None:
        return math.inf
    expected = None if ctx.delivery.leg is None else ctx.delivery.leg.lookahead
    north, east = (None, None) if expected is None else (expected.believed_north_mps, expected.believed_east_mps)
    if north is None or east is None:
        north, east = estimate.north_mps, estimate.east_mps
    return ctx.lean.airspeed_mps(
        (float(north), float(east))
    )  # the wind of the computation that uses it, so that it gives the observed speed


def _ahead(ctx: Context) -> tuple[str, ...]:
    """Stations of the leg that are still to be overflown, from the vehicle's progress along the route."""
    leg = ctx.delivery.leg
    if leg is None or ctx.place is None or not leg.via:
        return ()
    way = leg.mission.way
    distances = [cross_track_m(way[k : k + 2], *ctx.place) for k in range(len(way) - 1)]
    piece = min(range(len(distances)), key=lambda k: distances[k])
    return leg.via[piece:] if len(way) == len(leg.via) + 2 else ()
