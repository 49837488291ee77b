"""Giving way to other aircraft within the limits: report them, hold, or land at the nearest station, until no aircraft is near.

States: clear; holding (at its position); overruled (a person ordered `go`: no reaction until no aircraft is near). An aircraft counts from the limits
on, and is gone once all are beyond `CLEAR_MARGIN` times the limits, or not received, for `CLEAR_S`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import GaveWay
from skyway.link.supervisor.states import State
from skyway.link.telemetry.traffic import TrafficLimits
from skyway.models.base import geodesy
from skyway.models.base.errors import LinkError
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.link.supervisor.context import After, Context
    from skyway.link.telemetry.traffic import Aircraft

CLEAR_MARGIN, CLEAR_S = 1.2, 10.0
AGAIN_S = 5.0
"""Time after which an unacknowledged order is repeated, s."""


class OnTraffic(StrEnum):
    """Reaction to an aircraft that comes near."""

    TELL = "tell"
    HOLD = "hold"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class TrafficRule:
    """Distance limits, and the reaction."""

    action: OnTraffic = OnTraffic.TELL
    limits: TrafficLimits = field(default_factory=TrafficLimits)


@dataclass(slots=True)
class GiveWay:
    """Giving way in one delivery; written only by its own methods."""

    holds: bool = False
    """It holds in the air until no aircraft is near."""
    overruled: bool = False
    """It continues although an aircraft is near: a person ordered that, or it already flies to the nearest station."""
    _since_s: float = math.nan
    _clear_s: float = math.nan
    _tried_s: float = -math.inf

    def bars(self, ctx: Context) -> Aircraft | None:
        """Return the aircraft that prohibits a take-off; None if there is none, or traffic is only reported."""
        if ctx.job.traffic.action is OnTraffic.TELL:
            return None
        near = ctx.vehicle.traffic.near(ctx.vehicle.connection.clock.now_s())
        return near[0] if near else None

    def look(self, ctx: Context, stations: Iterable[str]) -> After | None:
        """Begin or end to give way, once per second of a flight; `stations` are the possible landing sites. None continues the flight."""
        rule, now_s = ctx.job.traffic, ctx.vehicle.connection.clock.now_s()
        if rule.action is OnTraffic.TELL:
            return None
        begun = self.holds or self.overruled
        near = ctx.vehicle.traffic.near(now_s, CLEAR_MARGIN if begun else 1.0)
        if near:
            self._clear_s = math.nan
        elif math.isnan(self._clear_s):
            self._clear_s = now_s
        if begun:
            if now_s >= self._clear_s + CLEAR_S:
                self._clear(ctx)
            return None
        if not near or ctx.state is not State.FLYING or now_s < self._tried_s + AGAIN_S:
            return None
        self._tried_s = now_s
        if rule.action is OnTraffic.LAND:
            return self._land(ctx, near[0], stations)
        self._hold(ctx, near[0])
        return None

    def _hold(self, ctx: Context, one: Aircraft) -> None:
        try:
            if not ctx.conversation.paused:
                ctx.vehicle.pause()
        except LinkError as error:
            ctx.say(_entry("failed", one), f"{one}; the drone did not accept the order to hold: {error}")
            return
        self.holds, self._since_s = True, ctx.now_s
        leg = ctx.delivery.leg
        if leg is not None:
            leg.learn_nothing()  # the energy of a hover is no measure for flights
        ctx.say(_entry("hold", one), f"{one}: the drone holds until the sky is clear")

    def _land(self, ctx: Context, one: Aircraft, stations: Iterable[str]) -> After | None:
        leg, place, network = ctx.delivery.leg, ctx.place, ctx.job.scenario.network
        if leg is None or place is None:
            return None

        def away_m(name: str) -> float:
            station = network.stations[network.index[name]]
            return float(geodesy.distance_m(*place, station.lat, station.lon))

        known = [name for name in (leg.destination, *stations) if name in network.index]
        nearest = min(known, key=away_m, default=leg.destination)
        entry = _entry("land", one, nearest)
        if nearest == leg.destination:
            self.overruled = True
            ctx.say(entry, f"{one}: {nearest} is the nearest station, and the drone flies on to it")
            return None
        leg.learn_nothing()
        ctx.say(entry, f"{one}: the drone lands at {nearest} until the sky is clear")
        ctx.divert.to(nearest)
        return State.DIVERTING, f"diverting to {nearest}: {one}"

    def _clear(self, ctx: Context) -> None:
        """Continue: no aircraft is near any more."""
        held, self.overruled = self.holds, False
        if not held:
            return
        now_s = ctx.vehicle.connection.clock.now_s()
        if now_s < self._tried_s + AGAIN_S:
            return
        self._tried_s = now_s
        waited_s = ctx.now_s - self._since_s
        try:
            if not ctx.conversation.paused:
                ctx.vehicle.resume()
        except LinkError as error:
            ctx.say(
                GaveWay(action="failed"), f"the sky is clear, but the drone did not accept the order to fly on: {error}"
            )
            return
        self.holds = False
        leg = ctx.delivery.leg
        if leg is not None:
            leg.command(leg.commanded_mps, ctx.now_s)
        stays = "; it stays paused, as ordered" if ctx.conversation.paused else ": the drone flies on"
        ctx.say(GaveWay(action="go", waited_s=waited_s), f"the sky is clear after {duration(waited_s)}{stays}")

    def overrule(self) -> None:
        """Record that a person orders it to continue in spite of traffic."""
        self.overruled, self.holds = self.overruled or self.holds, False

    def end(self) -> None:
        """Reset: the drone is sent elsewhere, or has landed."""
        self.holds = self.overruled = False


def _entry(action: str, one: Aircraft, station: str | None = None) -> GaveWay:
    above_m = None if math.isnan(one.above_m) else one.above_m
    return GaveWay(action=action, aircraft=one.name, away_m=one.away_m, above_m=above_m, station=station)
