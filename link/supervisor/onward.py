"""Flights after the hand-over: the way back of the drone, or the way on of a package that could not be delivered.

It is flown as the delivery is, by the same policy, from the target to a destination of its own: without the package, or with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.journal.entries import WentOn
from skyway.link.supervisor.legs import leaving
from skyway.link.supervisor.proof.evidence import Verdict
from skyway.link.supervisor.states import State
from skyway.models.base import geodesy
from skyway.models.base.formatting import duration, percent
from skyway.models.composition.file import to_json
from skyway.models.flight.energy import FlightPower
from skyway.planner.problem.request import NEAREST_PAD, NO_RETURN

if TYPE_CHECKING:
    from skyway.link.supervisor.context import After, Context
    from skyway.link.supervisor.legs import Leg
    from skyway.link.supervisor.progress import DeliveryProgress
    from skyway.models.composition.composition import Composition
    from skyway.models.network.station import Station
    from skyway.planner.online.information import Information
    from skyway.planner.problem.request import Request

MORE = 1.5
"""Factor on the energy of a flight in still air for a station to be considered."""


@dataclass(frozen=True, slots=True)
class Onward:
    """Destination of the drone after the target."""

    destination: str
    """Station."""
    loaded: bool
    """The package is on board."""
    delivered: bool
    """The package was delivered."""
    leave_s: float
    """Earliest departure from the target, POSIX seconds."""

    def request(self, delivery: Request) -> Request:
        """Return the request from the target on."""
        payload_kg = delivery.payload_kg if self.loaded else 0.0
        return replace(
            delivery, destination=self.destination, payload_kg=payload_kg, return_to=NO_RETURN, dwell_s=0.0,
            undelivered_to=None, release="gripper", stop_at=(), escape=False,
        )  # fmt: skip


def after_hand_over(ctx: Context, done: str) -> After:
    """Continue with the way back; the delivery ends if there is none, or the operator wants the drone to stay."""
    stands = f"{done}; the drone stands disarmed with {percent(ctx.battery.soc)}"
    back = None if ctx.job.composition.way_back is None else ctx.job.composition.way_back.plan
    if back is None or ctx.conversation.stays:
        return State.DELIVERED, stands
    return _go_on(ctx, back, done, loaded=False, delivered=True)


def after_failure(ctx: Context, why: str, *, loaded: bool) -> After:
    """Continue after a package could not be delivered, or was lost: with it if that was requested, else without."""
    way = ctx.job.composition.way_back
    plan = None if way is None else way.undelivered if loaded else way.plan
    if plan is None or ctx.conversation.stays:
        return (
            State.STOPPED,
            f"{why}. Take the package off by hand" if loaded else f"{why}; look for it along the track",
        )
    return _go_on(ctx, plan, why, loaded=loaded, delivered=False)


def package_goes_on(ctx: Context, why: str) -> str:
    """Divert the package in the air: to its destination for undelivered packages, else back; return the destination."""
    way = ctx.job.composition.way_back
    goal = ctx.job.composition.origin if way is None or way.undelivered is None else way.undelivered.destination
    onward = Onward(goal, loaded=True, delivered=False, leave_s=ctx.now_s)
    ctx.delivery.call_off(onward)
    entry = WentOn(destination=goal, loaded=True, delivered=False, leave_s=onward.leave_s, plan=None)
    ctx.say(entry, f"{why}; it goes to {goal}")
    return goal


def flies_on(ctx: Context, leg: Leg, *, delivered: bool, why: str) -> None:
    """Continue from over the target, after a release in the air or without it: the mission leads back."""
    way = ctx.job.composition.way_back
    if way is None or way.plan is None:
        return
    # until the drone is weighed the package may be on board: the charge for it is reserved
    onward = Onward(way.plan.destination, loaded=True, delivered=delivered, leave_s=ctx.now_s)
    over_target(ctx.delivery, leg, onward, way.plan, way.dwell_s)
    entry = WentOn(
        destination=onward.destination, loaded=True, delivered=delivered, leave_s=onward.leave_s, plan=to_json(way.plan)
    )
    ctx.say(entry, f"{why}; on to {way.plan.services[0].destination}")


def over_target(delivery: DeliveryProgress, leg: Leg, onward: Onward, plan: Composition, hover_s: float) -> None:
    """Put the way back in force in the air, with the rest of the leg as its first flight."""
    hover_soc = leg.modelled.per_s * hover_s if leg.modelled is not None else 0.0
    delivery.go_on(onward)
    delivery.take_plan(plan)
    delivery.take_leg(leaving(leg, plan, onward.leave_s, hover_soc))


def _go_on(ctx: Context, plan: Composition, why: str, *, loaded: bool, delivered: bool) -> After:
    """Put the plan from the target in force, after the time there."""
    way = ctx.job.composition.way_back
    dwell_s = 0.0 if way is None else way.dwell_s
    return _begin(ctx, Onward(plan.destination, loaded, delivered, ctx.now_s + dwell_s), plan, why)


def _begin(ctx: Context, onward: Onward, plan: Composition | None, why: str) -> After:
    """Record the destination after the target, and make it the request; without a plan the policy makes one."""
    ctx.delivery.go_on(onward)
    ctx.delivery.take_plan(plan)
    stays_s = onward.leave_s - ctx.now_s
    stays = f" after {duration(stays_s)}" if stays_s >= 1.0 else ""
    reason = f"{why}; on to {onward.destination}{stays} {'with' if onward.loaded else 'without'} the package"
    entry = WentOn(
        destination=onward.destination, loaded=onward.loaded, delivered=onward.delivered, leave_s=onward.leave_s,
        plan=None if plan is None else to_json(plan),
    )  # fmt: skip
    ctx.say(entry, reason)
    return State.REPLANNING, reason


def arrived(ctx: Context, onward: Onward) -> After:
    """End the delivery at the drone's destination."""
    stands = f"the drone stands disarmed at {onward.destination} with {percent(ctx.battery.soc)}"
    target = ctx.job.request.destination
    verdict, why = ctx.proof.verdict
    if onward.delivered and verdict is Verdict.NOT_DELIVERED:
        way = ctx.job.composition.way_back
        goal = None if way is None else way.undelivered_to
        if goal is not None and goal != onward.destination and not ctx.conversation.stays:
            return _begin(
                ctx, Onward(goal, loaded=True, delivered=False, leave_s=ctx.now_s), None, f"not delivered: {why}"
            )
        return State.STOPPED, f"not delivered at {target}: {why}; {stands}"
    if onward.delivered:
        return State.DELIVERED, f"delivered at {target}; {stands}"
    if onward.loaded:
        return (
            State.STOPPED,
            f"the package could not be handed over at {target} and is at {onward.destination}; {stands}",
        )
    return State.STOPPED, f"not delivered: {why}; {stands}"


def another_pad(ctx: Context, known: Information) -> bool:
    """Switch to the nearest free pad if the planned one is occupied and any pad is permitted; return whether it did.

    Candidates are pads for which 1.5 times the energy in still air keeps the reserve; the policy decides whether it is flown.
    """
    onward, way = ctx.delivery.onward, ctx.job.composition.way_back
    target = ctx.job.request.destination
    if onward is None or way is None or way.asked != NEAREST_PAD or onward.loaded or ctx.delivery.station != target:
        return False
    network, request = ctx.job.scenario.network, ctx.request
    if _free(network.stations[network.index[onward.destination]], known):
        return False
    here, drone = network.index[target], ctx.job.scenario.drone(request.drone or "")
    away_m = geodesy.inverse(network.lat[here], network.lon[here], network.lat, network.lon)[0]
    per_m = FlightPower.of(drone, request.payload_kg).soc_per_s / drone.cruise_airspeed_mps
    reach_m = (known.soc - request.reserve_soc) / (MORE * per_m)
    near = (int(row) for row in np.argsort(away_m, kind="stable") if away_m[row] <= reach_m)
    other = next((network.stations[row].id for row in near if _free(network.stations[row], known)), None)
    if other is None:
        return False
    _begin(ctx, replace(onward, destination=other), None, f"{onward.destination} has no free pad")
    return True


def _free(station: Station, known: Information) -> bool:
    """Whether a pad at a station is free, as far as known; for stations without a report nothing is known."""
    seen = known.busy_pads.get(station.id)
    return seen is not None and seen < station.pads


def stay_until_due(ctx: Context) -> None:
    """Wait for the planned end of the time at the target."""
    onward = ctx.delivery.onward
    if onward is not None and ctx.delivery.station == ctx.job.request.destination and ctx.now_s < onward.leave_s:
        ctx.wait_until(onward.leave_s)
