"""Decisions on the ground: next station, charge, and take-off time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.journal.entries import Decided
from skyway.link.supervisor.legs import with_places
from skyway.link.supervisor.observed.link_watch import ASK_AGAIN_S, ASK_FOR_S, request_telemetry, rest, unanswered
from skyway.link.supervisor.onward import another_pad, stay_until_due
from skyway.link.supervisor.states import State, Turn
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.formatting import duration, percent
from skyway.models.flight.energy import FlightPower
from skyway.planner.online.information import Decision, Information

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.models.network.station import Station

POLL_S = 10.0
MAX_ASKED = 60
"""Maximum number of stations whose pads are requested: over a slow link each request takes time."""
_UNTOLD_S = 300.0


def replanning(ctx: Context) -> After:
    """Decide the next station, the charge, and the take-off time."""
    if ctx.conversation.stays:
        return State.STOPPED, f"stopped at {ctx.delivery.station} as ordered: the drone stands disarmed"
    stay_until_due(ctx)
    known = information(ctx)
    if another_pad(ctx, known):
        known = information(ctx)
    if not ctx.job.replanning:
        decision = _as_planned(ctx, known)
    elif ctx.job.dispatched:
        decision = ctx.policy().keep_to_plan(known, charged=ctx.delivery.charged)
    else:
        policy = ctx.policy()
        decision = policy.on_ground(known, tell=True)
    figures = dict(decision.figures) | {"wind_source": ctx.wind.source, "soc_source": ctx.battery.source}
    ctx.note(Decided(action=decision.action, where="ground", figures=figures), decision.reason)
    ctx.tell(f"{decision.action}: {decision.reason}")
    if decision.composition is not None:
        ctx.delivery.take_plan(with_places(decision.composition, ctx.job.scenario, decision.diverts))
    elif decision.departure is not None and decision.departure.segments:
        _check_wait(ctx, "no wind of the forecast allows the next leg")
        ctx.wait_until(ctx.now_s + _UNTOLD_S)
        return State.REPLANNING, "no wind of the forecast allows the next leg: deciding again"
    ctx.delivery.prepare(decision.diverts, decision.charge_to, decision.least_soc)
    if decision.action == "stop":
        return State.STOPPED, decision.reason
    ctx.note_plan(decision.reason)
    if decision.action == "wait" and decision.charge_to is None:
        _check_wait(ctx, decision.reason)
        rest(ctx)
        ctx.wait_until(max(decision.until_s or 0.0, ctx.now_s + POLL_S))
        return State.REPLANNING, "the wait is over: deciding again"
    if decision.charge_to is not None:
        return State.WAITING, f"charge to {percent(decision.charge_to)}"
    if ctx.delivery.flight == 0 and ctx.now_s < ctx.job.not_before_s:
        rest(ctx)
        ctx.wait_until(ctx.job.not_before_s)
        return State.REPLANNING, "the package is ready: deciding again"
    return State.PREFLIGHT, decision.reason


def _check_wait(ctx: Context, reason: str) -> None:
    """End the flight here if it has waited for longer than its job allows."""
    waited_s = ctx.delivery.waited_s(ctx.now_s)
    if waited_s >= ctx.job.longest_wait_s:
        raise Turn(State.STOPPED, f"waited for {duration(waited_s)}: {reason}")


def _look_again(ctx: Context) -> str:
    """Return the station of the vehicle once it and the charge are known; missing data are requested again."""
    unknown, end = "the drone does not report its position or its state of charge", ctx.clock.now_s() + ASK_FOR_S
    while True:
        station = ctx.delivery.station or ctx.here_station()
        ctx.delivery.stand_at(station)
        if station is not None and math.isfinite(ctx.battery.soc):
            return station
        if ctx.clock.now_s() >= end:
            raise Turn(State.STOPPED, unknown)
        unanswered(ctx, unknown)
        request_telemetry(ctx)
        ctx.wait(ASK_AGAIN_S)


def information(ctx: Context) -> Information:
    """Information available at the drone's station."""
    station = _look_again(ctx)
    busy: dict[str, int] = {}
    behind, plan = 0, ctx.delivery.plan
    for one in _in_reach(ctx, station):
        try:
            status = ctx.pads.status(one.id)
        except (LinkError, InputError):
            continue
        busy[one.id], after = status.others(ctx.observed.system)
        behind += after
    return Information(
        time_s=ctx.now_s,
        soc=ctx.battery.soc,
        forecast=ctx.wind.forecast_by_hour(),
        near_forecast=ctx.wind.forecast(ctx.now_s, now=True),
        belief=ctx.energy.belief,
        station=station,
        visited=frozenset(ctx.delivery.visited),
        left=frozenset(ctx.delivery.visited) - {station},
        busy_pads=busy,
        behind=behind,
        roughness=ctx.wind.roughness,
        wind_measured_s=ctx.wind.measured_s,
        measures_wind=ctx.wind.measures,
        plan=plan,
        planned_soc=_planned(ctx),
    )


def _in_reach(ctx: Context, station: str) -> list[Station]:
    """Stations whose pads a decision can use: the present one, those of the plan, and the nearest within reach of one charge."""
    job, plan = ctx.job, ctx.delivery.plan
    network, drone = job.scenario.network, job.scenario.drone(job.request.drone or "")
    row = network.index.get(station)
    lat, lon = (ctx.place or (math.nan, math.nan)) if row is None else (network.lat[row], network.lon[row])
    planned = {station, *(() if plan is None else (one.destination for one in plan.services))}
    reach_m = drone.max_ground_speed_mps / FlightPower.of(drone, ctx.request.payload_kg).soc_per_s
    away_m = geodesy.inverse(lat, lon, network.lat, network.lon)[0]
    away_m[[row for row, one in enumerate(network.stations) if one.id in planned]] = 0.0
    nearest = np.argsort(away_m, kind="stable")[: MAX_ASKED + len(planned)]
    return [one for row in nearest if away_m[row] <= reach_m and (one := network.stations[row]).pads > 0]


def _planned(ctx: Context) -> float | None:
    """Charge at departure from here by the present plan."""
    if ctx.delivery.charge_to is not None:
        return ctx.delivery.charge_to
    plan = ctx.delivery.plan
    if plan is None or not plan.services or plan.services[0].origin != ctx.delivery.station:
        return None
    stop = plan.stop_before(plan.services[0])
    return stop.soc_to if stop is not None and stop.recharge_s > 0.0 else None


def _as_planned(ctx: Context, known: Information) -> Decision:
    """Fly the plan unchanged: the baseline with which supervision is compared."""
    if ctx.delivery.plan is None:
        return Decision("stop", "the plan has no leg from here: plan again, then fly that plan")
    service = ctx.delivery.plan.services[0]
    stop = ctx.delivery.plan.stop_before(service)
    target = stop.soc_to if stop is not None and stop.soc_to > known.soc + 0.01 and not ctx.delivery.charged else None
    return Decision("continue", f"as planned to {service.destination}", {}, ctx.delivery.plan, service.destination, None, target,
                    service.diverts or (service.origin,))  # fmt: skip
