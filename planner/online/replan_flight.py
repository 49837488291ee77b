"""Replanning in the air: fly on, at which speed, or land elsewhere.

Whenever the landing breaks the reserve with more than epsilon, what can be done is weighed by when the delivery then arrives: of what
keeps the reserve the earliest is taken, be that another airspeed, a station on the way, another next station or the way back.
Where nothing keeps it, the least risk is taken, an empty battery in the air before anything else. A flight that is well is only
left for one that is better by a margin, and once a flight; one that was turned is turned again only where its battery would
most probably be empty before: so noise in wind, charge and energy cannot turn a drone to and fro.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.units import S_PER_MIN
from skyway.planner.online.onward import DEPART_SIGMAS, PLAN_SIGMAS, Onward
from skyway.planner.online.replan import Decision
from skyway.planner.online.replan_options import (
    Floors,
    Option,
    arriving,
    earliest_s,
    going_on,
    other_airspeeds,
    other_stations,
)

if TYPE_CHECKING:
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.diverts import Place, Reach
    from skyway.planner.online.energy_belief import EnergyBelief
    from skyway.planner.online.replan import GroundReplanner

COMMITTED_S = 60.0
"""A flight with less than this to go is flown to its end unless the battery says otherwise."""
CLEARLY = 0.5
"""A risk is clearly smaller below this share of another."""
MAX_PROBABLE = 0.5
WEIGHED_AGAIN_S, WEIGHED_AGAIN = 60.0, 1.5
"""Where flying on was the best that could be done, it is thought of again after so long, or where the risk has grown by this."""


@dataclass(frozen=True, slots=True)
class Airborne:
    """A drone in flight on a leg.

    Attributes
    ----------
    here : (lat, lon)
        Where it is, at cruise height.
    time_s, soc : float
        Now, POSIX seconds, and its charge.
    via : tuple of str
        Stations still to be overflown.
    destination : str
        Where it lands.
    commanded_mps : float
        Ground speed it was last told.
    diverts : tuple of str
        Stations that it may go to instead: inside its fence.
    behind : frozenset of str
        Stations that it has stood at and left: gone back to for the reserve alone, never because that seems better.
    sudden : bool
        Charge was lost at once: there is no time to look twice.
    airspeed_limit_mps : float
        It is seen not to fly faster through the air than this, though it is told to.
    """

    here: Place
    time_s: float
    soc: float
    via: tuple[str, ...]
    destination: str
    commanded_mps: float
    diverts: tuple[str, ...]
    behind: frozenset[str] = frozenset()
    sudden: bool = False
    airspeed_limit_mps: float = math.inf


@dataclass(slots=True)
class FlightReplanner:
    """Decides in the air; one for each flight.

    Parameters
    ----------
    ground : GroundReplanner
        Scenario, request, planner and settings.
    turned : bool
        It was turned already.
    """

    ground: GroundReplanner
    turned: bool = False
    _doubtful: int = 0
    _speed_s: float = -math.inf
    _better_s: float = -math.inf
    _weighed: tuple[float, float] = (-math.inf, 0.0)
    _airspeed_mps: float | None = None
    _onward: Onward | None = None

    def decide(self, airborne: Airborne, forecast: WindEnsemble, belief: EnergyBelief) -> Decision:
        """Return what to do now; asked about every ten seconds."""
        reach = self._reach(forecast, belief, airborne.airspeed_limit_mps)
        now, figures = self._outlook(airborne, reach)
        settings = self.ground.settings
        bad = now.p_empty > MAX_PROBABLE if self.turned else now.p_reserve > settings.epsilon_flight
        self._doubtful = self._doubtful + 1 if bad else 0
        if bad and (self._doubtful >= settings.confirm or airborne.sudden) and self._due(airborne, now):
            self._weighed = airborne.time_s, now.p_reserve
            decision = self._turn(airborne, reach, now, figures)
            if decision is not None:
                return decision
        speed = self._speed(airborne, figures)
        if speed is not None:
            return speed
        better = None if bad else self._better(airborne, reach, now, figures)
        if better is not None:
            return better
        reason = (
            f"{figures['left_s'] / S_PER_MIN:.1f} min to {airborne.destination}, landing with {100 * now.soc:.0f} %, "
            f"below the reserve with probability {now.p_reserve:.3f}"
        )
        return Decision("continue", reason, figures)

    def watch(self, airborne: Airborne, forecast: WindEnsemble, belief: EnergyBelief) -> Decision:
        """Return whether a divert under way must end elsewhere; only an empty battery turns it again."""
        self.turned = True
        reach = self._reach(forecast, belief, airborne.airspeed_limit_mps)
        now, figures = self._outlook(airborne, reach)
        bad = now.p_empty > MAX_PROBABLE
        self._doubtful = self._doubtful + 1 if bad else 0
        if bad and (self._doubtful >= self.ground.settings.confirm or airborne.sudden):
            decision = self._turn(airborne, reach, now, figures)
            if decision is not None:
                return decision
        speed = self._speed(airborne, figures)
        return speed or Decision("continue", f"on the way to {airborne.destination}", figures)

    def _reach(self, forecast: WindEnsemble, belief: EnergyBelief, limit_mps: float = math.inf) -> Reach:
        reach = self.ground.reach(forecast, belief)
        wanted = reach.airspeed_mps if self._airspeed_mps is None else self._airspeed_mps
        return (
            reach if wanted == reach.airspeed_mps <= limit_mps else reach.at_airspeed(max(min(wanted, limit_mps), 1.0))
        )

    def _due(self, airborne: Airborne, now: Option) -> bool:
        """Whether to weigh again: some time after the last time, or as soon as the risk has grown."""
        at_s, risk = self._weighed
        return airborne.sudden or airborne.time_s >= at_s + WEIGHED_AGAIN_S or now.p_reserve > WEIGHED_AGAIN * risk

    @property
    def _floors(self) -> Floors:
        reserve = self.ground.request.reserve_soc
        return Floors(reserve, reserve * self.ground.settings.divert_share)

    def _outlook(self, airborne: Airborne, reach: Reach) -> tuple[Option, dict[str, Any]]:
        """Work out time, charge at landing and wanted ground speed under the newest forecast."""
        way = reach.way(airborne.here, airborne.via, airborne.destination)
        now, _ = going_on(reach, way, airborne.destination, airborne.time_s, airborne.soc, self._floors)
        length, bearing = geodesy.inverse(*way[0], *way[1])
        piece_s = reach.along(way[:2], airborne.time_s).time_s[:, 0]
        wanted = float(reach.expected(np.asarray(length) / np.maximum(piece_s, 1e-3)))
        north, east = reach.winds(np.array([way[0][0]]), np.array([way[0][1]]), np.array([airborne.time_s]))
        figures = {
            "destination": airborne.destination,
            "soc": airborne.soc,
            "left_s": now.lands_s - airborne.time_s,
            "left_m": now.distance_m,
            "soc_land": now.soc,
            "p_below_reserve": now.p_reserve,
            "p_below_half": now.p_half,
            "p_empty": now.p_empty,
            "wanted_mps": min(max(wanted, 1.0), reach.drone.max_ground_speed_mps),
            "wind_north_mps": float(reach.expected(north)[0]),
            "wind_east_mps": float(reach.expected(east)[0]),
            "wind_mean_mps": float(reach.expected(np.hypot(north, east))[0]),
            "bearing_deg": float(bearing),
            "energy_factor": reach.belief.factor,
            "energy_sigma": reach.belief.sigma,
        }
        return now, figures

    def _speed(self, airborne: Airborne, figures: dict[str, Any]) -> Decision | None:
        """Send the planned ground speed again where the wind estimate has moved it."""
        if math.isfinite(airborne.airspeed_limit_mps):
            return None  # it does not reach what it was told last; to be told less would end the lean that shows why
        settings, wanted = self.ground.settings, figures["wanted_mps"]
        due = airborne.time_s >= self._speed_s + settings.speed_every_s
        if not due or abs(wanted - airborne.commanded_mps) < settings.speed_step_mps:
            return None
        self._speed_s = airborne.time_s
        reason = (
            f"ground speed {airborne.commanded_mps:.1f} to {wanted:.1f} m/s: that is the planned airspeed in a wind now "
            f"put at {figures['wind_mean_mps']:.1f} m/s"
        )
        return Decision("speed", reason, figures, speed_mps=round(wanted, 1))

    # Weighing

    def _others(self, airborne: Airborne, reach: Reach) -> list[Option]:
        """Stations inside the fence, those ahead and those behind."""
        index = reach.network.index
        names = [s for s in dict.fromkeys(airborne.diverts) if s in index and s != airborne.destination]
        return other_stations(reach, airborne.here, names, airborne.time_s, airborne.soc, self._floors)

    def _looked_on(self, airborne: Airborne, reach: Reach) -> Onward:
        """Look at what follows landings under the newest forecast; energy as for the next flights."""
        ground = self.ground
        if self._onward is None:
            self._onward = Onward(ground.scenario, ground.request, ground.drone)
        later = reach.belief.next_flight()
        way = reach.way(airborne.here, (), ground.request.destination)
        load = reach.mean_load(way, airborne.time_s)
        factors = tuple(load * later.cautious(sigmas) for sigmas in (DEPART_SIGMAS, PLAN_SIGMAS))
        self._onward.look(airborne.time_s, reach.wind, factors)
        return self._onward

    def _turn(self, airborne: Airborne, reach: Reach, now: Option, figures: dict[str, Any]) -> Decision | None:
        """Find what keeps the reserve and delivers earliest, else the least risk; None where that is flying on."""
        epsilon = self.ground.settings.epsilon_flight
        way = reach.way(airborne.here, airborne.via, airborne.destination)
        given = (reach, way, airborne.destination, airborne.time_s, airborne.soc, self._floors)
        options = [*other_airspeeds(*given), *self._others(airborne, reach)]
        safe = [one for one in options if one.p_reserve <= min(epsilon, CLEARLY * now.p_reserve)]
        if safe:
            onward = self._looked_on(airborne, reach)
            weighed = [replace(one, arrival_s=arriving(one, onward)) for one in safe]
            best = min(weighed, key=lambda one: one.arrival_s)
            figures |= {"options": [one.as_data() for one in sorted(weighed, key=lambda one: one.arrival_s)[:6]]}
            return self._answer(airborne, now, best, figures)
        best = min([now, *options], key=lambda one: one.risk)
        if best.p_empty > MAX_PROBABLE:
            return _land(airborne, figures, best.p_empty)
        pairs = ((best.p_empty, now.p_empty), (best.p_half, now.p_half), (best.p_reserve, now.p_reserve))
        if best is now or not any(there < CLEARLY * here and here > epsilon for there, here in pairs):
            return None
        return self._answer(airborne, now, best, figures)

    def _answer(self, airborne: Airborne, now: Option, best: Option, figures: dict[str, Any]) -> Decision:
        """Tell the option that was chosen."""
        why = (
            f"landing at {now.station} would be below the reserve with probability {now.p_reserve:.2f} (about "
            f"{100 * now.soc:.0f} %)"
        )
        there = f"about {100 * best.soc:.0f} % (below the reserve with probability {best.p_reserve:.2f})"
        if math.isfinite(best.arrival_s):
            there += f", and the delivery comes in {(best.arrival_s - airborne.time_s) / S_PER_MIN:.0f} min"
        if best.station == airborne.destination:
            self._airspeed_mps, self._speed_s = best.airspeed_mps, airborne.time_s
            speed = best.distance_m / max(best.lands_s - airborne.time_s, 1.0)
            reason = f"{why}; at {best.airspeed_mps:.1f} m/s through the air it is reached with {there}"
            return Decision("speed", reason, figures | {"airspeed_mps": best.airspeed_mps}, speed_mps=round(speed, 1))
        more = {
            "divert": best.station, "divert_m": best.distance_m, "divert_soc": best.soc,
            "p_divert_below_reserve": best.p_reserve,
        }  # fmt: skip
        self.turned = True
        reason = f"{why}; {best.station}, {best.distance_m / 1000:.1f} km away, is reached with {there}"
        return Decision("divert", reason, figures | more, station=best.station)

    def _better(self, airborne: Airborne, reach: Reach, now: Option, figures: dict[str, Any]) -> Decision | None:
        """Look from time to time for a station by which the delivery comes earlier by the margin; turned once, it stays."""
        settings = self.ground.settings
        late = figures["left_s"] < COMMITTED_S or airborne.destination == self.ground.request.destination
        if self.turned or late or airborne.time_s < self._better_s + settings.better_every_s:
            return None
        self._better_s = airborne.time_s
        ahead = [one for one in self._others(airborne, reach) if one.station not in airborne.behind]
        safe = [one for one in ahead if one.p_reserve <= settings.epsilon_flight]
        if not safe:
            return None
        onward = self._looked_on(airborne, reach)
        kept_s = arriving(now, onward)
        margin_s = max(settings.margin_s, settings.margin_share * (kept_s - airborne.time_s))
        goal = self.ground.request.destination
        chance = [one for one in safe if earliest_s(reach, one, goal) < kept_s - margin_s]
        found = [replace(one, arrival_s=arriving(one, onward)) for one in chance]
        best = min(found, key=lambda one: one.arrival_s, default=None)
        if best is None or not best.arrival_s < kept_s - margin_s:
            return None
        self.turned = True
        gain_s = kept_s - best.arrival_s
        reason = (
            f"by way of {best.station} the delivery comes {gain_s / S_PER_MIN:.1f} min earlier than by "
            f"{airborne.destination} (margin {margin_s / S_PER_MIN:.1f} min)"
        )
        more = {"gain_s": gain_s, "margin_s": margin_s, "options": [one.as_data() for one in found]}
        return Decision("station", reason, figures | more, station=best.station)


def _land(airborne: Airborne, figures: dict[str, Any], p_empty: float) -> Decision:
    reason = (
        f"no station can be reached any more: with {100 * airborne.soc:.0f} % the battery would be empty before any "
        f"with probability {p_empty:.2f} or more; landing here"
    )
    return Decision("land", reason, figures | {"p_empty": p_empty})
