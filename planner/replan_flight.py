"""Replanning in the air: fly on, at which speed, or elsewhere.

A flight that is most probably too long for its battery goes to the nearest station that is safe to reach; one that is well is
only left for a plan that is better by a margin, at most once a flight, and a divert is never taken back: so noise in wind,
charge and energy cannot turn a drone to and fro.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from models import geodesy
from models.errors import InfeasibleError, InputError
from models.services import State
from models.units import S_PER_MIN, from_posix
from planner.itinerary import fly_sampled, outcome
from planner.plan import plan
from planner.problem import IN_FLIGHT, Problem
from planner.replan import Decision, cautious_drone
from planner.replan_candidates import itinerary_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.services import Composition
    from models.wind_forecast import WindEnsemble
    from planner.diverts import Place, Reach
    from planner.energy_belief import EnergyBelief
    from planner.replan import GroundReplanner

EMPTY_SOC = 0.03
"""Below this nothing is sure to fly."""
COMMITTED_S = 60.0
"""A flight with less than this to go is flown to its end unless the battery says otherwise."""


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
    visited : frozenset of str
        Stations landed at before.
    rest : Composition or None
        The plan of which this flight is the first service.
    """

    here: Place
    time_s: float
    soc: float
    via: tuple[str, ...]
    destination: str
    commanded_mps: float
    diverts: tuple[str, ...]
    visited: frozenset[str] = frozenset()
    rest: Composition | None = None


@dataclass(slots=True)
class FlightReplanner:
    """Decides in the air; one for each flight.

    Parameters
    ----------
    ground : GroundReplanner
        Scenario, request, planner and settings.
    """

    ground: GroundReplanner
    _doubtful: int = 0
    _speed_s: float = -math.inf
    _better_s: float = -math.inf
    _turned: bool = False
    _last: dict[str, Any] = field(default_factory=dict)

    def decide(self, airborne: Airborne, forecast: WindEnsemble, belief: EnergyBelief) -> Decision:
        """Say what to do now; asked about every ten seconds."""
        reach = self.ground.reach(forecast, belief)
        figures = self._outlook(airborne, reach)
        p_below, settings = figures["p_below_reserve"], self.ground.settings
        grave = p_below > settings.divert_above or figures["p_below_half"] > settings.epsilon_depart
        self._doubtful = self._doubtful + 1 if p_below > settings.epsilon_flight and grave else 0
        if self._doubtful >= settings.confirm:
            decision = self._divert(airborne, reach, figures, p_below)
            if decision is not None:
                return decision
        speed = self._speed(airborne, figures)
        if speed is not None:
            return speed
        better = self._better(airborne, forecast, belief, figures)
        if better is not None:
            return better
        left_min = figures["left_s"] / S_PER_MIN
        reason = (
            f"{left_min:.1f} min to {airborne.destination}, landing with {100 * float(str(figures['soc_land'])):.0f} %, "
            f"below the reserve with probability {p_below:.3f}"
        )
        return Decision("continue", reason, figures)

    def _outlook(self, airborne: Airborne, reach: Reach) -> dict[str, Any]:
        """Work out time, charge at landing and wanted ground speed under the newest forecast."""
        way = reach.way(airborne.here, airborne.via, airborne.destination)
        ends = reach.along(way, airborne.time_s)
        flight = ends[:, -1] - airborne.time_s + reach.rules.descent_s
        cost = reach.energy(flight)
        p_below = float(reach.p_below(airborne.soc, cost[:, None], self.ground.request.reserve_soc)[0])
        half = self.ground.request.reserve_soc * self.ground.settings.divert_share
        length, bearing = geodesy.inverse(*way[0], *way[1])
        ends_of_piece = np.maximum(ends[:, 0] - airborne.time_s, 1e-3)
        wanted = float(reach.expected(np.asarray(length) / ends_of_piece))
        north, east = reach.winds(np.array([way[0][0]]), np.array([way[0][1]]), np.array([airborne.time_s]))
        return {
            "destination": airborne.destination,
            "soc": airborne.soc,
            "left_s": float(reach.expected(flight)),
            "left_m": sum(geodesy.distance_m(*a, *b) for a, b in pairwise(way)),
            "soc_land": airborne.soc - float(reach.expected(cost)) * reach.belief.factor,
            "p_below_reserve": p_below,
            "p_below_half": float(reach.p_below(airborne.soc, cost[:, None], half)[0]),
            "wanted_mps": min(max(wanted, 1.0), reach.drone.max_ground_speed_mps),
            "wind_north_mps": float(reach.expected(north)[0]),
            "wind_east_mps": float(reach.expected(east)[0]),
            "bearing_deg": float(bearing),
            "energy_factor": reach.belief.factor,
            "energy_sigma": reach.belief.sigma,
        }

    def _speed(self, airborne: Airborne, figures: dict[str, Any]) -> Decision | None:
        """Send the planned ground speed again where the wind estimate has moved it."""
        settings, wanted = self.ground.settings, figures["wanted_mps"]
        due = airborne.time_s >= self._speed_s + settings.speed_every_s
        if not due or abs(wanted - airborne.commanded_mps) < settings.speed_step_mps:
            return None
        self._speed_s = airborne.time_s
        wind = math.hypot(figures["wind_north_mps"], figures["wind_east_mps"])
        reason = (
            f"ground speed {airborne.commanded_mps:.1f} to {wanted:.1f} m/s: that is the planned airspeed in a wind now "
            f"put at {wind:.1f} m/s"
        )
        return Decision("speed", reason, figures, speed_mps=round(wanted, 1))

    def _divert(self, airborne: Airborne, reach: Reach, figures: dict[str, Any], p_below: float) -> Decision | None:
        """Find the nearest station that is safe to reach; None where flying on is as good as anything."""
        index, reserve = reach.network.index, self.ground.request.reserve_soc
        names = [s for s in airborne.diverts if s in index and s != airborne.destination]
        nodes = np.array([index[name] for name in names], dtype=np.int64)
        clear = reach.clear(airborne.here, nodes) if len(nodes) else np.zeros(0, dtype=bool)
        nodes = nodes[clear]
        p_on_empty = self._p_empty(airborne, reach)
        if len(nodes):
            cost = reach.energy(reach.to_stations(airborne.here, airborne.time_s, nodes))
            mean = reach.expected(cost) * reach.belief.factor
            p_reserve = reach.p_below(airborne.soc, cost, reserve)
            safe = np.flatnonzero((p_reserve <= self.ground.settings.epsilon_flight) & (p_reserve < 0.5 * p_below))
            if len(safe):
                best = int(safe[np.argmin(mean[safe])])
                return self._to(
                    airborne, reach, nodes, best, float(mean[best]), figures, p_below, float(p_reserve[best])
                )
            best = int(np.argmin(mean))
            p_empty = float(reach.p_below(airborne.soc, cost[:, best : best + 1], EMPTY_SOC)[0])
            lands_higher = airborne.soc - float(mean[best]) > figures["soc_land"] + 0.03
            if lands_higher and (p_below > 0.5 or p_empty < 0.5 * p_on_empty) and p_empty < 0.5:
                p = float(p_reserve[best])
                return self._to(airborne, reach, nodes, best, float(mean[best]), figures, p_below, p)
            if min(p_empty, p_on_empty) > 0.5:
                return self._land(airborne, figures, min(p_empty, p_on_empty))
        elif p_on_empty > 0.5:
            return self._land(airborne, figures, p_on_empty)
        return None

    def _p_empty(self, airborne: Airborne, reach: Reach) -> float:
        way = reach.way(airborne.here, airborne.via, airborne.destination)
        flight = reach.along(way, airborne.time_s)[:, -1] - airborne.time_s + reach.rules.descent_s
        return float(reach.p_below(airborne.soc, reach.energy(flight)[:, None], EMPTY_SOC)[0])

    def _to(
        self, airborne: Airborne, reach: Reach, nodes: NDArray[np.int64], best: int, cost: float,
        figures: dict[str, Any], p_below: float, p_there: float,
    ) -> Decision:  # fmt: skip
        station = reach.network.stations[int(nodes[best])].id
        lat, lon = reach.network.lat[nodes[best]], reach.network.lon[nodes[best]]
        distance = geodesy.distance_m(*airborne.here, float(lat), float(lon))
        lands = airborne.soc - cost
        reason = (
            f"landing at {airborne.destination} would be below the reserve with probability {p_below:.2f} (about "
            f"{100 * float(str(figures['soc_land'])):.0f} %); {station}, {distance / 1000:.1f} km away, is reached with "
            f"about {100 * lands:.0f} % (below the reserve with probability {p_there:.2f})"
        )
        more = {"divert": station, "divert_m": distance, "divert_soc": lands, "p_divert_below_reserve": p_there}
        self._turned = True
        return Decision("divert", reason, figures | more, station=station)

    def _land(self, airborne: Airborne, figures: dict[str, Any], p_empty: float) -> Decision:
        reason = (
            f"no station can be reached any more: with {100 * airborne.soc:.0f} % the battery would be empty before any "
            f"with probability {p_empty:.2f} or more; landing here"
        )
        return Decision("land", reason, figures | {"p_empty": p_empty})

    def _better(
        self, airborne: Airborne, forecast: WindEnsemble, belief: EnergyBelief, figures: dict[str, Any]
    ) -> Decision | None:
        """Look from time to time for a plan that is better by the margin; turned once, it stays."""
        settings = self.ground.settings
        late = figures["left_s"] < COMMITTED_S
        if self._turned or late or airborne.rest is None or airborne.time_s < self._better_s + settings.better_every_s:
            return None
        self._better_s = airborne.time_s
        ground = self.ground
        factor = belief.cautious(settings.plan_sigmas)
        drone = cautious_drone(ground.drone, factor)
        scenario = replace(
            ground.scenario, drones=tuple(drone if d.id == drone.id else d for d in ground.scenario.drones)
        )
        state = State(
            from_posix(airborne.time_s), None, airborne.here, min(max(airborne.soc, 0.0), 1.0), {}, airborne.visited
        )
        request = replace(ground.request, state=state)
        try:
            problem = Problem(scenario, request, drone, forecast)
            kept = itinerary_of(problem, airborne.rest)
            fresh = plan(scenario, request, planner=settings.flight_planner, forecast=forecast)
        except (InfeasibleError, InputError):
            return None
        first = fresh.composition.services[0]
        if kept is None or first.destination == airborne.destination or first.destination not in airborne.diverts:
            return None
        if first.via:
            return None  # a turn inside the fence is a straight one
        now = outcome(problem, *fly_sampled(problem, kept))
        gain_s = now.mean_s - fresh.outcome.mean_s
        margin_s = max(settings.margin_s, settings.margin_share * (now.mean_s - airborne.time_s))
        if not gain_s > margin_s or fresh.outcome.p_success < now.p_success - settings.epsilon_flight:
            return None
        self._turned = True
        reason = (
            f"by way of {first.destination} the delivery comes {gain_s / S_PER_MIN:.1f} min earlier than by "
            f"{airborne.destination} (margin {margin_s / S_PER_MIN:.1f} min)"
        )
        more = {"gain_s": gain_s, "margin_s": margin_s, "from": IN_FLIGHT}
        return Decision("station", reason, figures | more, fresh.composition, first.destination)
