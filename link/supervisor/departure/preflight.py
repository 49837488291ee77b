"""The checklist before each take-off: every entry is in order, not in order, or unknown, with its values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from skyway.link.logs.common.vehicle_kind import MAV_KINDS
from skyway.link.supervisor.departure.health_of_day import health_of_day
from skyway.link.supervisor.departure.parameter_changes import ParameterChange
from skyway.link.supervisor.flight.crash import LIES_DEG, leans_deg
from skyway.link.supervisor.flight.lean import airspeed_at_lean
from skyway.link.supervisor.job import FlownKind
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError, LinkError, VehicleTimeoutError
from skyway.models.base.formatting import distance_text, height_text, percent, probability, speed_text
from skyway.models.base.units import from_posix, iso
from skyway.models.base.views import counted
from skyway.models.flight.weather_closures import weather_closures
from skyway.planner.robust.free_capacity import no_place_probability

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.legs import LegMission
    from skyway.link.vehicle.vehicle import Identity
    from skyway.models.composition.service import DroneService

Verdict = Literal["ok", "no", "unknown"]
AT_PLACE_M = 60.0
HOME_M = 60.0
LEAN_SLACK = 0.97
HOME_HEIGHT_M = 30.0
"""Maximum difference of heights of stations and of a satellite fix, m."""
SAID = 0.001
"""Probability of finding no place at the end below which it is not reported."""
SOC_SLACK = 0.015
"""Tolerance of a charge reported in whole percent."""


@dataclass(frozen=True, slots=True)
class Check:
    """One entry of the checklist."""

    name: str
    """Subject of the check."""
    verdict: Verdict
    """``ok``, ``no`` or ``unknown``."""
    said: str
    """The finding, with its values."""
    waits: bool = False
    """Whether a failed check may pass after a wait."""

    @property
    def ok(self) -> bool:
        """Whether the verdict is ``ok``."""
        return self.verdict == "ok"

    def __str__(self) -> str:
        mark = {"ok": "ok", "no": "NOT OK", "unknown": "UNKNOWN"}[self.verdict]
        return f"{self.name}: {mark}: {self.said}"


def run_checks(ctx: Context, service: DroneService, leg: LegMission) -> Iterator[Check]:
    """Run the checks, entry by entry; nothing is changed on the vehicle.

    Raises a `LinkError` if the vehicle did not answer.
    """
    yield from _identity(ctx)
    yield from _health(ctx)
    yield from _position(ctx, service)
    yield from _packs(ctx, service)
    yield _battery(ctx, service)
    yield from _wind(ctx, service)
    yield from _parameters(ctx, leg)
    yield _lean(ctx)
    yield _failsafe(ctx)
    yield _mission(ctx, leg)
    yield _diverts(ctx, service)
    yield _pads(ctx, service)
    yield _traffic(ctx)
    yield _remote_id(ctx)


def _identity(ctx: Context) -> Iterator[Check]:
    who = ctx.vehicle.identify()
    if ctx.observed.is_another(who.uid):
        yield Check("vehicle", "no", f"{who} is not the drone that began this delivery: connect that drone")
    else:
        ctx.observed.identify(ctx.observed.uid or who.uid)
        yield _kind(ctx, who)
    try:
        ctx.vehicle.check_ground_station()
    except VehicleTimeoutError as error:
        yield Check("ground station", "unknown", str(error), waits=True)
    except LinkError as error:
        yield Check("ground station", "no", str(error))
    else:
        yield Check("ground station", "ok", "the drone accepts this ground station")


def _kind(ctx: Context, who: Identity) -> Check:
    """Whether it is a kind of vehicle that is flown: one that does not report its kind is none, unless a person says so."""
    reported, given = MAV_KINDS.get(who.kind), ctx.job.vehicle_kind
    if reported in get_args(FlownKind):
        return Check("vehicle", "ok", str(who))
    if reported is not None:
        return Check("vehicle", "no", f"{who}: skyway flies multirotors only", waits=True)
    if given is not None:
        return Check("vehicle", "ok", f"{who}: a {given}, as given by --vehicle")
    remedy = f"{ctx.vehicle.family.kind_remedy}, or say what it is with --vehicle multirotor"
    return Check("vehicle", "unknown", f"{who}: does not report what kind of vehicle it is: {remedy}", waits=True)


def _health(ctx: Context) -> Iterator[Check]:
    """Calibration and health, once a day."""
    if (found := health_of_day(ctx)) is not None:
        verdict, said = found
        yield Check("health", verdict, said, waits=verdict != "ok")


def _position(ctx: Context, service: DroneService) -> Iterator[Check]:
    lean = leans_deg(ctx)
    if lean > LIES_DEG:
        yield Check("attitude", "no", f"the drone leans {lean:.0f}°: set it upright", waits=True)
    place = ctx.place
    station = ctx.delivery.plan.stations[service.origin] if ctx.delivery.plan is not None else None
    if place is None or station is None:
        yield Check("position", "unknown", "the drone does not report its position: wait for a GPS fix", waits=True)
        return
    away = geodesy.distance_m(*place, station.lat, station.lon)
    doubt = ctx.vehicle.live.doubts.get("position")
    said = f"{distance_text(away)} from {service.origin}"
    wrong = ""
    if away > AT_PLACE_M:
        wrong = f"{said}, at most {distance_text(AT_PLACE_M)} allowed: bring the drone to the pad"
    elif doubt is not None:
        wrong = f"the reported position {doubt}"
    elif ctx.observed.sample is not None and ctx.observed.sample.gps_ok == 0.0:
        wrong = "the GPS receiver has no reliable fix: wait, with a clear view of the sky"
    yield Check("position", "no" if wrong else "ok", wrong or said, waits=bool(wrong))
    try:
        home = ctx.vehicle.home()
    except LinkError as error:
        yield Check("home", "unknown", str(error), waits=True)
        return
    off = geodesy.distance_m(home.lat_deg, home.lon_deg, *place)
    moves = "is set here at arming" if off > HOME_M else f"{distance_text(off)} away"
    ground = station.elevation_m
    height = ctx.observed.sample.alt_msl_m if ctx.observed.sample is not None else math.nan
    if ground is not None and math.isfinite(height) and abs(height - ground) > HOME_HEIGHT_M:
        said = (
            f"the drone reports {height_text(height)} above sea level, but {service.origin} is at {height_text(ground)}: set the "
            "home height of the drone, or correct the elevation of the station"
        )
        yield Check("home", "no", said, waits=True)
    else:
        yield Check("home", "ok", moves)


def _wanted_soc(ctx: Context, service: DroneService) -> float:
    least, planned = ctx.delivery.least_soc, ctx.delivery.charge_to
    return least if least is not None else service.soc_depart if planned is None else planned


def _battery(ctx: Context, service: DroneService) -> Check:
    least, wanted = ctx.delivery.least_soc, _wanted_soc(ctx, service)
    if not math.isfinite(ctx.battery.soc) or (
        ctx.observed.sample is not None and not math.isfinite(ctx.observed.sample.soc)
    ):
        return Check(
            "battery", "unknown", "the drone does not report its state of charge: check its battery monitor", waits=True
        )
    reserve = percent(ctx.request.reserve_soc)
    what = (
        f"the flight to {service.destination}, the reserve of {reserve}, and a divert station in reach at every point"
        if least is not None
        else f"the flight to {service.destination}, as planned"
    )
    said = f"{percent(ctx.battery.soc)}, {percent(wanted)} needed: {what}"
    if wanted - SOC_SLACK <= ctx.battery.soc < wanted:
        said += f"; less by up to {100.0 * SOC_SLACK:g} points is enough: the charge is reported in whole percent"
    doubt = ctx.vehicle.live.doubts.get("soc")
    if doubt is not None and ("stuck" in doubt or "know" in doubt):
        return Check("battery", "unknown", f"the reported charge: {doubt}", waits=True)
    return Check("battery", "ok" if ctx.battery.soc >= wanted - SOC_SLACK else "no", said)


def _packs(ctx: Context, service: DroneService) -> Iterator[Check]:
    """Whether one of several batteries does not suffice while another is much fuller, or does not report its charge."""
    batteries, now_s = ctx.vehicle.batteries, ctx.vehicle.connection.clock.now_s()
    emptiest, wanted = batteries.lowest(now_s), _wanted_soc(ctx, service)
    if emptiest is not None and batteries.apart(now_s) and emptiest[1] < wanted - SOC_SLACK:
        said = f"battery {emptiest[0]} reports {percent(emptiest[1])}, {percent(wanted)} needed: charge or replace it"
        yield Check("batteries", "no", said, waits=True)
    if silent := batteries.unknown(now_s):
        which = " and ".join(f"battery {number}" for number in silent)
        said = f"{which} reports no state of charge: set up its battery monitor, or switch the monitor off if it does not drive the propellers"
        yield Check("batteries", "unknown", said, waits=True)


def _wind(ctx: Context, service: DroneService) -> Iterator[Check]:
    plan, drone = ctx.delivery.plan, ctx.job.scenario.drone(ctx.job.request.drone or "")
    if plan is None:
        return
    wind = ctx.wind.forecast(ctx.now_s, now=True)
    places = [plan.stations[name] for name in (service.origin, *service.via, service.destination)]
    way, slot = [(place.lat, place.lon) for place in places], wind.slot_at(ctx.now_s)
    highest = np.max([np.hypot(*wind.wind_at(*point, slot)) for point in way], axis=0)
    p_over = float(wind.probability @ (highest > drone.wind_limit_mps))
    expected = ctx.wind.on_way(way, ctx.now_s, service.distance_m / max(service.ground_speed_mps, 1.0))
    said = f"{expected} ({ctx.wind.origin}), above the limit of {drone.wind_limit_mps:g} m/s with probability {probability(p_over)}"
    yield Check("wind", "no" if p_over > 0.5 else "ok", said, waits=True)
    lands_s = ctx.now_s + service.distance_m / max(service.ground_speed_mps, 1.0)
    closed = [
        one
        for one in weather_closures(wind, drone, ctx.job.scenario.rules)
        if one.begin_s < lands_s and one.end_s > ctx.now_s
    ]
    if closed:
        until = f"closed until {iso(from_posix(max(one.end_s for one in closed)))}, because of {'; '.join(one.why for one in closed)}"
        yield Check("weather", "no", until, waits=True)


def _parameters(ctx: Context, leg: LegMission) -> Iterator[Check]:
    """Read the parameters that the leg needs; unsuitable values are proposed to be changed, if that is allowed."""
    proposed = []
    for check in ctx.vehicle.check_required(leg.parameters):
        name = check.wanted.name
        if check.absent:
            yield Check(f"parameter {check.wanted.meaning}", "no", check.problem)
        elif check.actual is None:
            yield Check(f"parameter {name}", "unknown", check.problem, waits=True)
        elif not check.ok and check.to_set is not None and ctx.job.set_parameters:
            proposed.append(ParameterChange(name, check.actual, check.to_set, check.wanted.why))
        elif not check.ok:
            yield Check(f"parameter {name}", "no", check.problem)
    ctx.parameters.propose(proposed)
    names = ", ".join(setting.name for setting in proposed)
    yield Check(
        "parameters", "ok", f"{len(leg.parameters)} read" + (f", {len(proposed)} to set: {names}" if names else "")
    )


def _lean(ctx: Context) -> Check:
    """Whether the autopilot's maximum lean angle permits the planned airspeed."""
    limits = ctx.vehicle.read_settings(ctx.vehicle.family.lean_limits)
    known = [limit for limit in limits.values() if limit > 0.0]
    drone = ctx.job.scenario.drone(ctx.job.request.drone or "")
    if not known:
        return Check("lean limit", "ok", "not reported by this firmware: it may limit the airspeed")
    ctx.lean.know_limits(min(known), drone.max_airspeed_mps)
    said = f"{min(known):.0f}°"
    if ctx.job.drag is None:
        return Check("lean limit", "ok", f"{said}; give --drag to compute the airspeed that it allows")
    planned = ctx.job.request.airspeed_mps or drone.cruise_airspeed_mps
    most = airspeed_at_lean(ctx.job.drag, min(known))
    said += f" allows an airspeed of {speed_text(most)}, {speed_text(planned)} are planned"
    if most >= LEAN_SLACK * planned:
        return Check("lean limit", "ok", said)
    return Check("lean limit", "no", f"{said}: plan with --airspeed {math.floor(most)}, or raise the lean limit")


def _failsafe(ctx: Context) -> Check:
    """State the failsafe actions of the vehicle, with the parameters that are to be set."""
    family = ctx.vehicle.family
    proposed = family.settings.in_our_units({setting.name: setting.after for setting in ctx.parameters.proposed})
    ctx.failsafes.read(ctx.vehicle, proposed)
    alone = family.failsafes.finishes_alone(ctx.failsafes.values)
    said = family.failsafes.when_left(ctx.failsafes.values)
    if alone is None:
        return Check("link loss", "unknown", said, waits=True)
    return Check("link loss", "ok" if alone else "no", said)


def _mission(ctx: Context, leg: LegMission) -> Check:
    """Check the mission, its fence and its rally points as ``skyway check`` does."""
    from skyway.missions.checks.report import check

    scenario = ctx.job.scenario
    report = check(leg.document, dialect=ctx.vehicle.family, zones=scenario.network.zones, depart_s=ctx.now_s)
    errors = [finding for finding in report.findings if finding.severity == "error"]
    if errors:
        first = errors[0]
        closed = all(finding.code == "no-fly-zone" for finding in errors)  # a zone may end
        return Check("mission", "no", f"item {first.item}: {first.message}", waits=closed)
    fence, rally = len(leg.document.fence.areas), len(leg.document.rally)
    parts = ((len(leg.document.mission), "item"), (fence, "fence area"), (rally, "rally point"))
    return Check("mission", "ok", ", ".join(counted(number, noun) for number, noun in parts))


def _diverts(ctx: Context, service: DroneService) -> Check:
    if ctx.job.work is not None and not ctx.delivery.diverts:
        return Check(
            "diverts", "ok", f"none but {service.destination} itself: the drone leaves the work for a pad if necessary"
        )
    if not ctx.delivery.diverts and ctx.delivery.onward is not None and ctx.job.replanning:
        # the gate has found a divert station for every point of the leg; without another one, the destination is it
        return Check("diverts", "ok", f"none nearer than {service.destination} itself")
    if not ctx.delivery.diverts:
        return Check("diverts", "no", f"no divert station is in reach on the way to {service.destination}")
    return Check("diverts", "ok", ", ".join(ctx.delivery.diverts))


def _pads(ctx: Context, service: DroneService) -> Check:
    """The pads at the end of the leg must be known; a station that will most probably be full on arrival is no destination."""
    scenario, node = ctx.job.scenario, ctx.job.scenario.network.index.get(service.destination)
    if node is None or scenario.network.pads[node] == 0:
        return Check("pads", "ok", f"{service.destination} has no pads")
    try:
        status = ctx.pads.status(service.destination)
    except (LinkError, InputError) as error:
        return Check("pads", "unknown", f"{service.destination}: {error}", waits=True)
    said = f"{service.destination}: {status.busy} of {status.pads} pads busy, {status.holding_free} holding spots free"
    now_s, flight_s = ctx.now_s, (service.arrive - service.depart).total_seconds()
    spare = max(service.soc_arrive - ctx.request.reserve_soc, 0.0) / max(service.soc_depart - service.soc_arrive, 1e-6)
    present = status.present
    chance = no_place_probability(scenario, node, present, now_s, now_s + flight_s, spare * flight_s)
    full = chance > ctx.job.parameters.online.p_begin
    said += f"; no free place to land with probability {probability(chance, 1)}" if chance > SAID else ""
    return Check("pads", "no" if full else "ok", said, waits=True)


def _traffic(ctx: Context) -> Check:
    """Other aircraft nearby: reported, and waited for if the drone gives way."""
    near = ctx.vehicle.traffic.near(ctx.vehicle.connection.clock.now_s())
    bars = ctx.give_way.bars(ctx)
    said = "; ".join(map(str, near[:3])) or "no aircraft near, as far as the drone's receiver hears"
    return Check("traffic", "ok" if bars is None else "no", said, waits=True)


def _remote_id(ctx: Context) -> Check:
    """Status of the Remote ID module; without it there is no take-off if an identity must be broadcast."""
    status, who = ctx.remote_id.status(ctx), ctx.job.remote_id
    if not who.given:
        return Check("remote id", "ok", f"{status}; no operator to broadcast: give --operator-id")
    identity = ", ".join(one for one in (who.operator_id, who.self_id) if one) or "the place of the operator"
    verdict: Verdict = "ok" if status.ready else "unknown" if status.heard and status.ready is None else "no"
    return Check("remote id", verdict, f"{status}; sent: {identity}", waits=True)
