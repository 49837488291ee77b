"""The paper's Algorithm 1 as printed, with a limit on its steps.

It judges each segment by the marginal distribution of the wind in the slot of the departure (binned by speed and
sector), recharges to full at each station, never backtracks and may visit a station again: it can cycle forever or
strand beside a feasible route. Its failures are counted separately.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import NoRouteError
from skyway.models.flight.kernels import slot_of
from skyway.models.wind.marginal import marginal
from skyway.models.wind.triangle import along_across, ground_speed
from skyway.planner.schedule.itinerary import Leg

if TYPE_CHECKING:
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


class StrictForwardSearch:
    """Algorithm 1, line by line."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.labels_expanded = 0
        self._cruise_wind = problem.ensemble.at_height(
            problem.rules.cruise_height_m, problem.rules.wind_profile_exponent
        )
        self._memory: dict[tuple[int, int], tuple[float, float]] = {}

    def solve(self) -> Itinerary:
        """Go to the station of least expected time until the destination is within range.

        Raises a `NoRouteError` if no station is in reach, or if the step limit is passed.
        """
        p = self.problem
        here, now, soc = p.origin, p.depart_s, p.soc
        legs: list[Leg] = []
        for _ in range(p.parameters.pfs.strict_steps * len(p.network)):
            leave, charge_to = now, None
            if legs:
                wait, _ = p.waits.at(here, now)
                leave, charge_to = now + wait + p.charge_time_s(here, soc, 1.0), 1.0
            ready = soc if charge_to is None else 1.0
            reach = self._reachable(here, leave, ready)
            if not reach:
                name = p.network.stations[here].id
                message = f"Algorithm 1 as printed is stuck at {name}: no station in reach; try planner pfs"
                raise NoRouteError(message, constraint="energy")
            if p.destination in (int(p.network.head[segment]) for segment in reach):
                last = next(s for s in reach if int(p.network.head[s]) == p.destination)
                return (*legs, Leg((last,), charge_to))
            segment = min(reach, key=lambda s: self._station_time(s, leave))
            legs.append(Leg((segment,), charge_to))
            flight, _ = self._segment(segment, leave)
            here, now = int(p.network.head[segment]), leave + flight
            soc = max(ready - p.soc_fixed - p.soc_per_s * flight, 0.0)
        message = f"Algorithm 1 as printed cycles: no end after {p.parameters.pfs.strict_steps * len(p.network)} steps; try planner pfs"
        raise NoRouteError(message, constraint="step-limit")

    def _segment(self, segment: int, time_s: float) -> tuple[float, float]:
        """Mean flight time over the slot's marginal, and the time exceeded with probability epsilon."""
        air = self.problem.air
        slot = int(slot_of(air, time_s))
        key = (segment, slot)
        if key not in self._memory:
            self.labels_expanded += 1
            if air.shut[slot, air.shut_of[segment]]:
                return self._memory.setdefault(key, (math.inf, math.inf))
            lat, lon = (float(values[segment]) for values in self.problem.network.midpoints)
            self._memory[key] = self._over_marginal(
                slot,
                lat,
                lon,
                float(air.distance_m[segment]),
                float(air.cos_bearing[segment]),
                float(air.sin_bearing[segment]),
            )
        return self._memory[key]

    def _over_marginal(
        self, slot: int, lat: float, lon: float, distance_m: float, cos: float, sin: float
    ) -> tuple[float, float]:
        air = self.problem.air
        bins = marginal(self._cruise_wind, slot, lat, lon)
        tail, cross = along_across(bins.north, bins.east, cos, sin)
        speed = ground_speed(air.airspeed_mps, tail, cross, air.wind_limit_mps, air.max_ground_speed_mps)
        flown = speed > 0.0
        if not flown.any():
            return math.inf, math.inf
        time = air.climb_s + air.descent_s + distance_m / speed[flown]
        share = bins.probability[flown] / bins.probability[flown].sum()
        order = np.argsort(time)
        worst = int(np.searchsorted(np.cumsum(share[order]), 1.0 - self.problem.epsilon - 1e-12))
        return float(share @ time), float(time[order][min(worst, len(order) - 1)])

    def _reachable(self, node: int, time_s: float, soc: float) -> list[int]:
        p, found = self.problem, []
        for segment in range(int(p.network.first[node]), int(p.network.first[node + 1])):
            other = int(p.network.head[segment])
            if other != p.destination and not p.has_pads(other):
                continue
            _, longest = self._segment(segment, time_s)
            if p.soc_fixed + p.soc_per_s * longest <= soc - p.reserve:
                found.append(segment)
        return found

    def _station_time(self, segment: int, leave_s: float) -> float:
        """Time of line 12: to the station, its wait and recharge, and the best next-to-adjacent station beyond."""
        p, network = self.problem, self.problem.network
        node = int(network.head[segment])
        flight, _ = self._segment(segment, leave_s)
        arrive = leave_s + flight
        wait, _ = p.waits.at(node, arrive)
        recharge = p.charge_time_s(node, max(1.0 - p.soc_fixed - p.soc_per_s * flight, 0.0), 1.0)
        ahead = math.inf
        for onward in range(int(network.first[node]), int(network.first[node + 1])):
            other = int(network.head[onward])
            there, _ = self._segment(onward, arrive)
            if other == p.destination:
                ahead = min(ahead, there)
                continue
            direct = p.direct_air
            rest, _ = self._over_marginal(
                int(slot_of(p.air, arrive)),
                network.stations[other].lat,
                network.stations[other].lon,
                float(direct.distance_m[other]),
                float(direct.cos_bearing[other]),
                float(direct.sin_bearing[other]),
            )
            ahead = min(ahead, there + p.waits.at(other, arrive + there)[0] + rest)
        return flight + wait + recharge + ahead
