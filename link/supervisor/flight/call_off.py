"""Calling off a delivery in the air: the target is blocked or nobody receives the package, which goes back or to the named station."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.flight.known import information
from skyway.link.supervisor.onward import package_goes_on
from skyway.link.supervisor.states import State
from skyway.models.base import geodesy
from skyway.models.base.formatting import percent
from skyway.planner.online.information import FlightMemory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.supervisor.context import After, Context
    from skyway.planner.online.options import Option

UNDELIVERED = "undelivered"
"""The command."""


def call_off(ctx: Context, stations: Sequence[str], by: str) -> After | None:
    """Divert the package from the air; `stations` are those inside the fence. None continues to the target.

    The drone turns to the destination of the package if that keeps the reserve; else to the station nearest to it that does, and continues from
    there. If none does it lands at the target, for which the energy of the way on is reserved, by a mission without a release.
    """
    leg, target = ctx.delivery.leg, ctx.job.request.destination
    if leg is None:
        return None
    goal = package_goes_on(ctx, f"{by}: the package cannot be handed over at {target}")
    leg.learn_nothing()
    if leg.destination != target and ctx.state is not State.FLYING:
        return None  # the drone is already diverting to another station
    option = _best(ctx, goal, tuple(dict.fromkeys((leg.destination, *stations))))
    station = target if option is None else option.station
    if station == leg.destination != target or (option is None and leg.destination != target):
        ctx.tell(f"the drone flies on to {leg.destination}, and from there to {goal}")
        return None
    ctx.divert.to(station)  # also to the target itself: the mission there releases the package
    onwards = "" if station == goal else f", on the way to {goal}"
    with_soc = "" if option is None else f", landing with about {percent(option.soc)}"
    return State.DIVERTING, f"diverting to {station}{onwards}{with_soc}"


def _best(ctx: Context, goal: str, stations: Sequence[str]) -> Option | None:
    """Return the station to turn to; None if none with pads keeps the reserve."""
    known = information(ctx, FlightMemory(turned=True), {})
    network = ctx.job.scenario.network
    target = ctx.job.request.destination
    with_pads = [one for one in stations if one != target and network.stations[network.index[one]].pads > 0]
    if known is None:
        return None
    found = ctx.policy().refuges(replace(known, destination=target, via=(), diverts=tuple(with_pads)))
    epsilon = ctx.policy().epsilon_of(known)
    safe = [one for one in found if ctx.policy().keeps_reserve(one, epsilon)]
    end = network.stations[network.index[goal]]

    def away_m(one: Option) -> float:
        here = network.stations[network.index[one.station]]
        return float(geodesy.distance_m(here.lat, here.lon, end.lat, end.lon))

    return min(safe, key=away_m, default=None)
