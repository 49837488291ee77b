"""Replanning in the air: fly on, at which speed, or land elsewhere.

Whenever the landing breaks the reserve with more than epsilon, what can be done is weighed by when the delivery then arrives: of what
keeps the reserve the earliest is taken, be that another airspeed, a station on the way, another next station or the way back.
Where nothing keeps it, the least risk is taken, an empty battery in the air before anything else. A flight that is well is only
left for one that is better by a margin, and once a flight; one that was turned is turned again only where its battery would
most probably be empty before: so noise in wind, charge and energy cannot turn a drone to and fro.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, duration, percent, probability, speed_text
from skyway.planner.online.information import Decision
from skyway.planner.online.options import (
    Floors,
    Option,
    along_way,
    arriving,
    clearly_safer,
    earliest_s,
    going_on,
    other_airspeeds,
    other_stations,
)
from skyway.planner.online.told_plan import segments_of
from skyway.planner.robust.free_capacity import no_place_probability

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.planner.online.hindsight import Hindsight
    from skyway.planner.online.information import Information
    from skyway.planner.online.policy import OnlinePolicy
    from skyway.planner.reach.reach import Place, Reach


class FlightDecision:
    """One decision in the air."""

    def __init__(self, policy: OnlinePolicy, info: Information) -> None:
        self._policy, self._parameters, self._info, self._memory = policy, policy.parameters, info, info.flight

    def decide(self) -> Decision:
        """Return what to do now."""
        if self._info.here is None:
            return self._over()
        info, here, memory = self._info, self._info.here, self._memory
        reach = self._reach()
        now, figures = self._outlook(here, reach)
        bad = now.p_empty > self._parameters.max_probable if memory.turned else not self._keeps_reserve(now)
        bad = bad and not self._may_turn_later(here, reach, now)
        memory.doubtful = memory.doubtful + 1 if bad else 0
        if bad and (memory.doubtful >= self._parameters.confirm or info.sudden) and self._due(now):
            memory.weighed = info.time_s, now.p_below
            decision = self._turn(here, reach, now, figures)
            if decision is not None:
                return decision
        speed = self._speed(figures)
        if speed is not None:
            return speed
        better = None if bad else self._better(here, reach, now, figures)
        if better is not None:
            return better
        reason = (
            f"{duration(figures['left_s'])} to {info.destination}, landing with {percent(now.soc)}, "
            f"below the reserve with probability {probability(now.p_below, 1)}"
        )
        return Decision("continue", reason, figures)

    def _keeps_reserve(self, option: Option) -> bool:
        return self._policy.keeps_reserve(option, self._policy.epsilon_of(self._info))

    def _over(self) -> Decision:
        """Over a station: on to the end while that is safe; else what is best from here."""
        info = self._info
        seen = self._policy.hindsight(info)
        p = seen.problem
        rest = segments_of(p.network, [info.station or "", *info.via, info.destination])
        if rest and seen.likely_free_at[p.network.head[rest[-1]]] and seen.need(rest, p.depart_s) <= p.soc + 1e-9:
            return Decision("continue", f"on to {info.destination}", segments=rest)
        step = seen.choose()
        if not step.segments:
            return Decision("station", f"land at {info.station}", station=info.station)
        end = p.network.stations[int(p.network.head[step.segments[-1]])].id
        return Decision("station", f"on to {end}", station=end, segments=step.segments)

    def _may_turn_later(self, here: Place, reach: Reach, now: Option) -> bool:
        """Whether it can fly on for now: a landing at the end or on the way may well do yet, and from a point ahead another station keeps the reserve.

        Wind and energy are known the better the further it has flown.
        """
        info, parameters = self._info, self._parameters
        if self._memory.turned or info.sudden:
            return False
        if now.p_below > parameters.p_hopeless and not any(
            one.p_below <= parameters.p_begin for one in self._on_the_way(here, reach)
        ):
            return False
        way = reach.way(here, info.via, info.destination)
        mean_s = float(reach.expected(reach.along(way, info.time_s).time_s[:, -1]))
        share = parameters.ahead_s / max(mean_s, 1.0)
        if share >= 1.0:
            return False
        cost = (info.soc - now.soc) * parameters.ahead_s / max(now.lands_s - info.time_s, 1.0)
        there = along_way(way, share * now.distance_m)
        others = self._others(there, reach, info.time_s + parameters.ahead_s, info.soc - cost)
        return any(self._keeps_reserve(one) for one in others)

    def _reach(self) -> Reach:
        info, chosen = self._info, self._memory.airspeed_mps
        reach = self._policy.reach(info.forecast, info.belief, cleared_m=info.cleared_m, roughness=info.roughness)
        if info.here is not None:
            reach = reach.where_flown([info.here], info.time_s)
        wanted, limit_mps = reach.airspeed_mps if chosen is None else chosen, info.airspeed_limit_mps
        if wanted == reach.airspeed_mps <= limit_mps:
            return reach
        return reach.at_airspeed(max(min(wanted, limit_mps), 1.0))

    def _due(self, now: Option) -> bool:
        """Whether to weigh again: some time after the last time, or as soon as the risk has grown."""
        at_s, risk = self._memory.weighed
        return (
            self._info.sudden
            or self._info.time_s >= at_s + self._parameters.weigh_again_s
            or now.p_below > self._parameters.weigh_again * risk
        )

    @property
    def _floors(self) -> Floors:
        reserve = self._policy.request.reserve_soc
        return Floors(reserve, reserve * self._parameters.divert_share)

    def _floors_at(self, station: str) -> Floors:
        """Those of a landing where the drone must be able to leave again without charging."""
        floors = self._floors
        return replace(floors, reserve=floors.reserve + self._policy.way_on_soc(self._info, station))

    def _outlook(self, here: Place, reach: Reach) -> tuple[Option, dict[str, Any]]:
        """Compute time, charge at landing and wanted ground speed under the newest forecast."""
        airborne = self._info
        way = reach.way(here, airborne.via, airborne.destination)
        floors = self._floors_at(airborne.destination)
        now, _ = going_on(reach, way, airborne.destination, airborne.time_s, airborne.soc, floors)
        now = self._with_room(now, reach)
        length, bearing = geodesy.inverse(*way[0], *way[1])
        piece_s = reach.pieces(way[:2], airborne.time_s)[0].time_s[:, 0]
        wanted = float(reach.expected(np.asarray(length) / np.maximum(piece_s, 1e-3)))
        north, east = reach.winds(np.array([way[0][0]]), np.array([way[0][1]]), np.array([airborne.time_s]))
        north, east = reach.factor_at(here) * north, reach.factor_at(here) * east
        figures = {
            "destination": airborne.destination,
            "soc": airborne.soc,
            "left_s": now.lands_s - airborne.time_s,
            "left_m": now.distance_m,
            "soc_land": now.soc,
            "p_below_reserve": now.p_below,
            "p_below_half": now.p_half,
            "p_empty": now.p_empty,
            "wanted_mps": min(max(wanted, 1.0), reach.drone.max_ground_speed_mps),
            "wind_north_mps": float(reach.expected(north)[0]),
            "wind_east_mps": float(reach.expected(east)[0]),
            "wind_mean_mps": float(reach.expected(np.hypot(north, east))[0]),
            "bearing_deg": float(bearing),
            "energy_factor": reach.belief.mean_ratio,
            "energy_sigma": reach.belief.sd_between,
        }
        return now, figures

    def _speed(self, figures: dict[str, Any]) -> Decision | None:
        """Send the planned ground speed again where the wind estimate has moved it."""
        airborne = self._info
        if math.isfinite(airborne.airspeed_limit_mps):
            return None  # it does not reach the last command; a lower one would end the lean that shows why
        settings, wanted = self._parameters, figures["wanted_mps"]
        due = airborne.time_s >= self._memory.speed_s + settings.speed_every_s
        if not due or abs(wanted - airborne.commanded_mps) < settings.speed_step_mps:
            return None
        self._memory.speed_s = airborne.time_s
        reason = (
            f"ground speed {speed_text(airborne.commanded_mps)} to {speed_text(wanted)}, to keep the planned airspeed in the "
            f"{'estimated' if airborne.measures_wind else 'forecast'} wind of {speed_text(figures['wind_mean_mps'])}"
        )
        return Decision("speed", reason, figures, speed_mps=round(wanted, 1))

    # Weighing

    def refuges(self) -> list[Option]:
        """Return where else it could land now: stations inside its fence, none of them behind a closed zone."""
        info = self._info
        return [] if info.here is None else self._others(info.here, self._reach(), info.time_s, info.soc)

    def _others(self, here: Place, reach: Reach, time_s: float, soc: float) -> list[Option]:
        """Stations inside the fence, those ahead and those behind; nobody lands at places where a way bends."""
        airborne = self._info
        index, stations = reach.network.index, reach.network.stations
        names = [
            s
            for s in dict.fromkeys(airborne.diverts)
            if s in index and s != airborne.destination and not stations[index[s]].flyover
        ]
        options = other_stations(reach, here, names, time_s, soc, self._floors)
        return [self._with_room(one, reach) for one in options]

    def _on_the_way(self, here: Place, reach: Reach) -> list[Option]:
        """Divert stations that the leg still leads over: there it can land and charge, where its end is too far."""
        info = self._info
        return [one for one in self._others(here, reach, info.time_s, info.soc) if one.station in info.via]

    def _with_room(self, option: Option, reach: Reach) -> Option:
        """Return the same with the risk of finding no place until the charge is gone, by the drones at its station now."""
        info, scenario = self._info, self._policy.scenario
        node = scenario.network.index[option.station]
        present = info.busy_pads.get(option.station) if scenario.network.pads[node] else None
        if present is None:
            return option

        def no_place(lands_s: float, hover_s: float) -> float:
            return no_place_probability(scenario, node, present, info.time_s, lands_s, hover_s)

        return option.with_room(no_place, reach.soc_per_s, self._floors)

    def _onward(self, reach: Reach) -> Hindsight:
        """What follows landings, in futures of the newest forecast; energy as for the next flights."""
        info = self._info
        later = replace(
            info, station=self._policy.request.destination, belief=info.belief.next_flight(), here=None, destination="",
            forecast=reach.wind, plan=None,
        )  # fmt: skip
        return self._policy.hindsight(later, self._parameters.flight_futures, start=info.here, quick=True)

    def _turn(self, here: Place, reach: Reach, now: Option, figures: dict[str, Any]) -> Decision | None:
        """Find what keeps the reserve and delivers earliest, else the least risk; None where that is flying on."""
        airborne = self._info
        way = reach.way(here, airborne.via, airborne.destination)
        given = (reach, way, airborne.destination, airborne.time_s, airborne.soc, self._floors_at(airborne.destination))
        speeds = [self._with_room(one, reach) for one in other_airspeeds(*given)]
        options = [*speeds, *self._others(here, reach, airborne.time_s, airborne.soc)]
        clearly = self._parameters.clearly * now.p_below
        safe = [one for one in options if one.p_below <= clearly and self._keeps_reserve(one)]
        if safe:
            weighed = self._weighed(safe, reach, self._onward(reach))
            figures |= {"options": [one.as_data() for one in weighed[:6]]}
            return self._answer(now, weighed[0], figures)
        best = min([now, *options], key=lambda one: one.risk)
        if best.p_empty > self._parameters.max_probable:
            return _land(airborne, figures, best.p_empty)
        if not clearly_safer(best, now, self._parameters.clearly):
            return None
        return self._answer(now, best, figures)

    def _weighed(
        self, options: Sequence[Option], reach: Reach, onward: Hindsight, before_s: float = math.inf
    ) -> list[Option]:
        """Options with their expected arrivals, the earliest first; without those that cannot arrive before a time, or before the best.

        On large networks without those that are not among the first that could arrive.
        """
        goal, found = self._policy.request.destination, list[Option]()
        large = self._policy.all_parameters.robust.is_large(len(reach.network))
        bounds = sorted((earliest_s(reach, one, goal), number) for number, one in enumerate(options))
        for bound_s, number in bounds[: self._parameters.weighed_options] if large else bounds:
            if bound_s >= before_s:
                break
            found.append(replace(options[number], arrival_s=arriving(options[number], onward)))
            before_s = min(before_s, found[-1].arrival_s)
        return sorted(found, key=lambda one: one.arrival_s)

    def _answer(self, now: Option, best: Option, figures: dict[str, Any]) -> Decision:
        """Tell the option that was chosen."""
        airborne = self._info
        why = (
            f"landing at {now.station} would be below the reserve with probability {probability(now.p_below)} (about "
            f"{percent(now.soc)})"
        )
        there = f"about {percent(best.soc)} (below the reserve with probability {probability(best.p_below)})"
        if math.isfinite(best.arrival_s):
            there += f", and the delivery comes in {duration(best.arrival_s - airborne.time_s)}"
        if best.station == airborne.destination:
            self._memory.airspeed_mps, self._memory.speed_s = best.airspeed_mps, airborne.time_s
            speed = best.distance_m / max(best.lands_s - airborne.time_s, 1.0)
            reason = f"{why}; at {speed_text(best.airspeed_mps)} through the air it is reached with {there}"
            return Decision("speed", reason, figures | {"airspeed_mps": best.airspeed_mps}, speed_mps=round(speed, 1))
        more = {
            "divert": best.station, "divert_m": best.distance_m, "divert_soc": best.soc,
            "p_divert_below_reserve": best.p_below,
        }  # fmt: skip
        self._memory.turned = True
        reason = f"{why}; {best.station}, {distance_text(best.distance_m)} away, is reached with {there}"
        return Decision("divert", reason, figures | more, station=best.station)

    def _better(self, here: Place, reach: Reach, now: Option, figures: dict[str, Any]) -> Decision | None:
        """Look from time to time for a station by which the delivery comes earlier by the margin; turned once, it stays."""
        settings, airborne, memory = self._parameters, self._info, self._memory
        late = figures["left_s"] < settings.committed_s or airborne.destination == self._policy.request.destination
        if memory.turned or late or airborne.time_s < memory.better_s + settings.better_every_s:
            return None
        memory.better_s = airborne.time_s
        others = self._others(here, reach, airborne.time_s, airborne.soc)
        ahead = [one for one in others if one.station not in airborne.left]
        safe = [one for one in ahead if self._keeps_reserve(one)]
        if not safe:
            return None
        onward = self._onward(reach)
        kept_s = arriving(now, onward)
        margin_s = self._policy.clear_gain_s(kept_s - airborne.time_s)
        found = self._weighed(safe, reach, onward, kept_s - margin_s)
        if not found or not found[0].arrival_s < kept_s - margin_s:
            return None
        best = found[0]
        self._memory.turned = True
        gain_s = kept_s - best.arrival_s
        reason = (
            f"via {best.station} the delivery arrives {duration(gain_s)} earlier than via "
            f"{airborne.destination} (margin {duration(margin_s)})"
        )
        more = {"gain_s": gain_s, "margin_s": margin_s, "options": [one.as_data() for one in found]}
        return Decision("station", reason, figures | more, station=best.station)


def _land(airborne: Information, figures: dict[str, Any], p_empty: float) -> Decision:
    reason = (
        f"no station is in reach: with {percent(airborne.soc)} the battery would be empty before each of them "
        f"with probability {probability(p_empty)} or more; land here"
    )
    return Decision("land", reason, figures | {"p_empty": p_empty})
