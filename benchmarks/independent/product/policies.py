"""The product's decisions in terms of the world: what a drone sees is told to the product, and its answer is translated."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.information import Leave, Policy
from benchmarks.independent.product.supervised import Kept
from skyway.models.flight.kernels import NEVER, land
from skyway.models.wind.triangle import height_factor
from skyway.planner.evaluation.policies import Standing
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.robust.charge_policy import known_at
from skyway.planner.robust.free_capacity import room_at
from skyway.planner.robust.free_capacity_kernels import LOOK_S, is_room
from skyway.planner.robust.information_kernels import energy_belief_after
from skyway.planner.robust.required_soc_kernels import GRID_S, flight_energy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.independent.information import Aloft, Flown, Seen
    from benchmarks.independent.product.planning import Planned
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.information_kernels import Known

WAIT_S = 300.0


class Needs:
    """What flights need by the product's rule, kept: runs of one day are told the same."""

    def __init__(self, problem: Problem, known: Known) -> None:
        self.problem, self.known = problem, known
        self.cost = float(problem.soc_per_s), float(problem.soc_fixed)
        self._found: dict[tuple[object, ...], float] = {}

    def energy(
        self, segments: tuple[int, ...], time_s: float, wind: tuple[tuple[float, float], ...], deviation: float
    ) -> float:
        """Charge that a flight taking off about a time exceeds with the chance epsilon only; as `charge_kernels.energy_about`."""
        air = self.problem.air
        begin = air.start_s + GRID_S * math.floor((time_s - air.start_s) / GRID_S)
        slot_end = air.start_s + air.slot_s * (math.floor((begin - air.start_s) / air.slot_s) + 1)
        end = begin + GRID_S if begin + GRID_S < slot_end else slot_end - 1.0
        return max(self._at(segments, begin, wind, deviation), self._at(segments, end, wind, deviation))

    def _at(
        self, segments: tuple[int, ...], time_s: float, wind: tuple[tuple[float, float], ...], deviation: float
    ) -> float:
        key = (segments, time_s, wind, deviation)
        if key not in self._found:
            north, east = (np.array(part) for part in zip(*wind, strict=True))
            self._found[key] = flight_energy(
                self.known, 0, np.array(segments, dtype=np.int64), time_s, north, east, self.cost, deviation
            )[0]
        return self._found[key]

    def open(self, segments: tuple[int, ...], time_s: float, wind: tuple[tuple[float, float], ...]) -> bool:
        """Whether the flight keeps the limits if the wind of the reports stays, which is all that is known."""
        key = ("open", segments, wind)
        if key not in self._found:
            north, east = (np.array(part).reshape(1, 1, -1) for part in zip(*wind, strict=True))
            air = self.problem.air._replace(north=north, east=east)
            self._found[key] = land(air, 0, np.array(segments, dtype=np.int64), time_s)
        return self._found[key] < NEVER


def aloft(seen: Seen, problem: Problem) -> tuple[tuple[float, float], ...] | None:
    """The latest reports of the told sites at flight height, as the product takes them there; None before the first."""
    names = [site.id for site in problem.scenario.wind_sites]
    if any(name not in seen.reports for name in names):
        return None
    rules = problem.scenario.rules
    factor = height_factor(rules.cruise_height_m, problem.scenario.measured_at_m, rules.wind_profile_exponent)
    return tuple((factor * seen.reports[name][1], factor * seen.reports[name][2]) for name in names)


def energy_shown(flights: tuple[Flown, ...], cost: tuple[float, float]) -> tuple[float, ...]:
    """Energy that each flight took as a multiple of the model's."""
    return tuple((one.told_off - one.told_down) / (cost[1] + cost[0] * (one.down_s - one.off_s)) for one in flights)


class Robust(Policy):
    """The fixed route of `robust`, never turned, each flight charged for by the product's rule with the reports that are out."""

    def __init__(self, planned: Planned) -> None:
        answer = planned.result.robust
        assert answer is not None
        self.policy = answer.policy
        self.problem = self.policy.problem
        self.needs = Needs(self.problem, self.policy.known)
        head = self.problem.network.head
        self.ends = [int(head[leg.segments[-1]]) for leg in self.policy.itinerary]
        self.room = room_at(self.problem, self.ends, self.policy.most_full)

    def leave(self, seen: Seen) -> Leave | None:
        """By the rule of `planner.robust.charge_kernels`."""
        leg = len(seen.flights)
        if leg >= len(self.policy):
            return None
        wind = aloft(seen, self.problem)
        if wind is None:
            return Leave((), look_s=seen.time_s + WAIT_S)
        segments = self.policy.itinerary[leg].segments
        known = self.policy.known
        shown = energy_shown(seen.flights, self.needs.cost)
        ratio, deviation = energy_belief_after(known, float(np.mean(shown)) if shown else 0.0, len(shown))
        landing = float(self.policy.landing[leg])

        def required(time_s: float) -> float:
            base = self.needs.energy(segments, time_s, wind, deviation)
            return landing + ratio * (1.0 + known.margin) * base

        edge = GRID_S * (math.floor(seen.time_s / GRID_S) + 1)
        wanted = required(seen.time_s)
        if seen.told >= wanted - 1e-9:
            if not self.needs.open(segments, seen.time_s, wind):
                return Leave((), look_s=edge)
            if not self._roomy(leg, seen, self.needs.energy(segments, seen.time_s, wind, deviation)):
                return Leave((), look_s=seen.time_s + LOOK_S)
        return Leave(segments, 0.0, required, edge if wanted > 1.0 else math.inf)

    def _roomy(self, leg: int, seen: Seen, base: float) -> bool:
        if self.room.most >= 1.0 or self.problem.network.pads[self.ends[leg]] == 0:
            return True
        flight_s = max(base - self.needs.cost[1], 0.0) / self.needs.cost[0]
        return is_room(self.room, leg, seen.line(self.ends[leg]), seen.time_s, flight_s)


class TurningRobust(Robust):
    """The same route; a flight turns back where `fly` would turn it, and takes off again when `fly` lets it under a plan that is kept."""

    watches = True

    def __init__(self, planned: Planned) -> None:
        super().__init__(planned)
        self.kept = Kept(planned)

    def forget(self) -> None:
        """Drop what was noted of deliveries before."""
        self.kept.forget()

    def leave(self, seen: Seen) -> Leave | None:
        """By the plan until a flight is turned."""
        turned = any(flight.end != end for flight, end in zip(seen.flights, self.ends, strict=False))
        return self.kept.leave(seen) if turned else super().leave(seen)

    def aloft(self, seen: Aloft) -> int | None:
        """Back to where it took off."""
        return self.kept.in_air.turns(seen, (seen.origin,))


REPORTED = 0.05
"""Variance of a component of reported winds, as `Online` takes them, m2/s2."""


class Online(Policy):
    """The product's online policy as its own evaluation flies it (`planner.online.evaluated`): nothing is decided between stations."""

    def __init__(self, planned: Planned) -> None:
        self.start = planned.problem()
        self.policy = RollingRobust(self.start, wind_variance=REPORTED)
        known = known_at(self.start, USUAL_ERRORS, measured=True, epsilon=0.25 * self.start.epsilon)
        self.needs = Needs(self.start, known)

    def leave(self, seen: Seen) -> Leave | None:
        """Ask the product as it would be asked in its own evaluation."""
        wind = aloft(seen, self.start)
        if wind is None:
            return Leave((), look_s=seen.time_s + WAIT_S)
        answer = self.policy.leave(self._standing(seen))
        if answer is None:
            return None
        if answer.turn_back is None:
            return Leave(answer.segments, answer.charge, answer.required, answer.look_s)
        reserve = self.start.reserve
        mean, deviation = energy_belief_after(self.needs.known, 0.0, 0)

        def careful(time_s: float) -> float:
            return reserve + mean * self.needs.energy(answer.segments, time_s, wind, deviation)

        return Leave(answer.segments, answer.charge, careful, min(answer.look_s, seen.time_s + 2.0 * WAIT_S))

    def over(self, seen: Seen, rest: tuple[int, ...]) -> tuple[int, ...]:
        """Ask over a station; time and charge are set back by a climb, as the product wants it."""
        if aloft(seen, self.start) is None:
            return rest
        return tuple(self.policy.over(self._standing(seen, as_off=True), rest))

    def _standing(self, seen: Seen, *, as_off: bool = False) -> Standing:
        names = [site.id for site in self.start.scenario.wind_sites]
        wind: tuple[NDArray[np.float64], NDArray[np.float64]] = (
            np.array([seen.reports[name][1] for name in names]),
            np.array([seen.reports[name][2] for name in names]),
        )
        network = self.start.network
        busy = {one.id: seen.line(node) for node, one in enumerate(network.stations) if one.pads}
        visited = tuple(network.stations[flight.origin].id for flight in seen.flights)
        rules, cost = self.start.rules, self.needs.cost
        back_s = rules.climb_s + rules.descent_s if as_off else 0.0
        return Standing(
            seen.node, seen.station, seen.time_s - (rules.climb_s if as_off else 0.0),
            seen.told + cost[0] * (rules.climb_s if as_off else 0.0), visited, wind, busy,
            energy_shown(seen.flights, cost), seen.behind if not back_s else 0,
        )  # fmt: skip
