"""Deliveries simulated decision by decision under a policy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import next_opening
from skyway.planner.evaluation.flights import DELIVERED, GAVE_UP, Flown, pooled, schedules, tally
from skyway.planner.evaluation.policies import Adaptive, Policy, Standing
from skyway.planner.online.turn_back_kernels import out_or_back
from skyway.planner.problem.kernel_inputs import check_itinerary
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request_checks import check_apart
from skyway.planner.schedule.gust_kernels import gusty_land
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.schedule_kernels import COLUMNS, PAD, ROOM, SOC_LANDING, SOC_TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.evaluation.realizations import Realizations
    from skyway.planner.online.information import Departure
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary

MAX_WAIT_S = HORIZON_H * S_PER_H
"""A policy that stays longer at a stop has given up: no forecast that it had there reaches further."""
_AGAIN_S = 30.0  # a drone that cannot leave yet looks at the clock again


def fly_policy(
    realizations: Realizations,
    drone: str,
    policy: Policy | Adaptive,
    runs: NDArray[np.int64] | None = None,
    *,
    watch: Callable[[Again], None] | None = None,
) -> tuple[Flown, list[Itinerary]]:
    """Fly a policy in some realizations (all by default), run by run; also returns what it did in each.

    `watch` gets for each flight of an adaptive policy the means to fly it again in other gusts. Raises an `InputError` if
    start and destination are the same, or if the policy decides what no drone can do that stands where it is asked.
    """
    problem = realizations.problem(drone)
    check_apart(problem)
    chosen = np.arange(len(realizations)) if runs is None else runs
    done = [_Run(realizations, problem, run).fly(policy, watch) for run in chosen.tolist()]
    return pooled([flown for flown, _ in done]), [itinerary for _, itinerary in done]


def _check_decided(problem: Problem, node: int, decided: object) -> None:
    """Refuse a decision that is no flight from a node."""
    if not isinstance(decided, Leg):
        remedy = "return a planner.schedule.itinerary.Leg, or None"
        raise InputError(Fault("is not a leg", field="decide", value=type(decided).__name__, remedy=remedy))
    check_itinerary(problem.network, (decided,))
    stations, begin = problem.network.stations, int(problem.network.tail[decided.segments[0]])
    if begin != node:
        remedy = f"{stations[node].id}, where the drone stands"
        raise InputError(Fault("a leg begins elsewhere", field="decide", value=stations[begin].id, remedy=remedy))


@dataclass(frozen=True)
class _StopLabel:
    """Where a drone has landed, when, and with which charge; or the station that it is over, on its leg number `legs`."""

    node: int
    station: str
    landed_s: float
    soc: float
    visited: tuple[str, ...]
    legs: int


@dataclass(frozen=True)
class Again:
    """A flight of an adaptive policy, to be flown again by the same policy in other gusts."""

    _run: _Run
    _policy: Adaptive
    _stay: _StopLabel
    _way: Departure
    _begun: tuple[float, float, float]

    def charge_left(self, gust_key: int) -> float:
        """Charge on touch-down in the gusts of a key."""
        realizations = self._run.realizations
        keys = realizations.gust_key.copy()
        keys[self._run.number] = gust_key
        other = replace(self._run, realizations=replace(realizations, gust_key=keys))
        return float(other.flight(self._policy, self._stay, self._way, self._begun)[1][0, 0, SOC_LANDING])


@dataclass(frozen=True)
class _Run:
    """One run of some realizations."""

    realizations: Realizations
    problem: Problem
    number: int

    def fly(self, policy: Policy | Adaptive, watch: Callable[[Again], None] | None) -> tuple[Flown, Itinerary]:
        """Fly decision by decision. Each time the whole way is flown again: that it is a pure function keeps one set of rules."""
        problem, network = self.problem, self.problem.network
        one = np.array([self.number])
        block = self.realizations.block[one]
        legs: Itinerary = ()
        node, time_s, soc = problem.origin, problem.depart_s, problem.soc
        visited: tuple[str, ...] = ()
        flown: Flown | None = None
        schedule: NDArray[np.float64] | None = None
        while len(legs) < problem.parameters.evaluation.max_stops:
            station = network.stations[node].id
            stop_label = _StopLabel(node, station, time_s, soc, visited, len(visited))
            if isinstance(policy, Adaptive):
                found = self._take_off(policy, stop_label, watch)
                if found is None:
                    break
                leg, flight = found
                legs = (*legs, leg)
                self._land(int(network.head[leg.segments[-1]]), self._energy_ratio(len(visited)), flight)
                schedule = flight if schedule is None else np.concatenate((schedule, flight), axis=1)
            else:
                decided = policy.decide(self._standing(stop_label, time_s, soc))
                if decided is None:
                    break
                _check_decided(problem, node, decided)
                legs = (*legs, decided)
                schedule = schedules(self.realizations, problem, legs, one)
            visited = (*visited, station)
            flown = tally(problem, legs, block, schedule)
            node = int(network.head[legs[-1].segments[-1]])
            if node == problem.destination or flown.ending[0] != DELIVERED:
                return flown, legs
            time_s, soc = float(schedule[0, -1, TOUCH_DOWN]), float(schedule[0, -1, SOC_LANDING])
        return _given_up(flown, block, problem.soc), legs

    def _energy_ratio(self, leg: int) -> float:
        return self.realizations.energy_ratio(self.problem.drone, self.number, leg)

    def _queues(self, nodes: list[int]) -> dict[int, QueuePath]:
        return self.realizations.queues(self.problem, nodes, int(self.realizations.queue[self.number]))

    def _land(self, node: int, ratio: float, flight: NDArray[np.float64]) -> None:
        """Have a flight, shape (1, 1, 7), hover until there is a place to land; `ratio` is that of its energy to the model's."""
        came = float(flight[0, 0, TOUCH_DOWN])
        if not np.isfinite(came):
            return
        flight[0, 0, TOUCH_DOWN] = float(self._queues([node])[node].land_time(came))
        flight[0, 0, SOC_LANDING] -= ratio * self.problem.soc_per_s * (flight[0, 0, TOUCH_DOWN] - came)

    def _standing(self, stop_label: _StopLabel, time_s: float, soc: float) -> Standing:
        """What is known at a stay at a time."""
        realizations, network = self.realizations, self.problem.network
        day, slot = realizations.day[self.number], realizations.wind.slot_at(time_s)
        north, east = realizations.wind.north[day], realizations.wind.east[day]
        first = realizations.wind.slot_at(self.problem.depart_s)
        hours = tuple((north[one], east[one]) for one in range(slot - 1, first - 1, -1))
        nodes = np.flatnonzero(network.pads > 0).tolist()
        paths = self._queues(nodes)
        busy = {network.stations[node].id: paths[node].present_at(time_s) for node in nodes}
        behind, landed_s = 0, stop_label.landed_s
        if stop_label.station in busy and time_s > landed_s:  # who came after it does not stand before it in the line
            path = paths[stop_label.node]
            left = int(np.diff(np.searchsorted(path.left_s, [landed_s, time_s], side="right"))[0])
            before = max(path.present_at(landed_s) - left, 0)
            behind = max(busy[stop_label.station] - before, 0)
            busy[stop_label.station] = before
        ratios = tuple(self._energy_ratio(leg) for leg in range(stop_label.legs))
        under_way = self._energy_ratio(stop_label.legs) if stop_label.legs < len(stop_label.visited) else None
        return Standing(
            stop_label.node,
            stop_label.station,
            time_s,
            soc,
            stop_label.visited,
            (north[slot], east[slot]),
            busy,
            ratios,
            under_way,
            behind,
            hours,
        )

    def _take_off(
        self, policy: Adaptive, stop_label: _StopLabel, watch: Callable[[Again], None] | None
    ) -> tuple[Leg, NDArray[np.float64]] | None:
        """Take off as the policy says, decided again whenever the wind is: (leg, its schedule, shape (1, 1, 7))."""
        problem, wind = self.problem, self.realizations.wind
        now, soc = stop_label.landed_s, stop_label.soc
        queue = self._queues([stop_label.node])[stop_label.node]
        pad_s = float(queue.pad_time(stop_label.landed_s)) if problem.has_pads(stop_label.node) else math.inf
        curve_s, curve_soc = problem.curve(stop_label.node)
        charged_s = float(np.interp(stop_label.soc, curve_soc, curve_s))

        def charge_at(time_s: float) -> float:
            if time_s <= pad_s:
                return stop_label.soc
            if stop_label.node in problem.closures:
                return problem.soc_after(
                    stop_label.node, stop_label.soc, problem.charging_s(stop_label.node, pad_s, time_s)
                )
            return float(np.interp(charged_s + time_s - pad_s, curve_s, curve_soc))

        end_s = min(wind.start_s + wind.slots * wind.slot_s, stop_label.landed_s + MAX_WAIT_S)
        while now < end_s:
            way = policy.leave(self._standing(stop_label, now, soc))
            if way is None:
                return None
            again_s = now + max(problem.parameters.evaluation.patience * (now - stop_label.landed_s), _AGAIN_S)
            new_wind = max(wind.slot_at(now) + 1, int((again_s - wind.start_s) // wind.slot_s))
            until = min(wind.start_s + new_wind * wind.slot_s, max(way.look_s, again_s))
            segments = np.array(way.segments, dtype=np.int64)
            at = now
            while at < until:
                wanted = max(way.charge, way.required(at))
                if charge_at(at) >= wanted - 1e-9:
                    opening = next_opening(problem.air, int(self.realizations.day[self.number]), segments, at)
                    if opening <= at + 1e-6:
                        begun = pad_s, at, charge_at(at)
                        if watch is not None:
                            watch(Again(self, policy, stop_label, way, begun))
                        return self.flight(policy, stop_label, way, begun)
                    at = opening
                elif wanted <= curve_soc[-1] and pad_s < math.inf:
                    reached = pad_s + float(np.interp(wanted, curve_soc, curve_s)) - charged_s
                    if stop_label.node in problem.closures:
                        reached = problem.charged_at(stop_label.node, pad_s, reached - pad_s)
                    at = max(reached, at + _AGAIN_S)
                else:
                    break
            now, soc = until, charge_at(until)
        return None

    def flight(
        self, policy: Adaptive, stop_label: _StopLabel, way: Departure, begun: tuple[float, float, float]
    ) -> tuple[Leg, NDArray[np.float64]]:
        """Fly, with a decision of the policy over each station with pads; `begun` is (pad, take-off, charge)."""
        problem, air = self.problem, self.problem.air
        pad_s, off, charge = begun
        disturbance = self.realizations.disturbance(problem.drone)
        day, gust_key = int(self.realizations.day[self.number]), disturbance.gust_key[self.number]
        ratio = self._energy_ratio(stop_label.legs)
        flown: tuple[int, ...] = ()
        rest = way.segments
        if way.turn_back is not None:
            energy = ratio * problem.soc_per_s / way.turn_back.soc_per_s
            down, turned = out_or_back(air, day, rest[0], off, charge, energy, gust_key, way.turn_back)
            if turned:
                flown, rest = (rest[0], way.turn_back.back), ()
        while rest:
            flown, rest = (*flown, rest[0]), rest[1:]
            node = int(problem.network.head[flown[-1]])
            down = gusty_land(air, day, np.array(flown), off, gust_key, disturbance.gust_sd, disturbance.gust_time_s)
            if rest and problem.has_pads(node):
                as_off = down - air.descent_s - air.climb_s
                soc = charge - ratio * problem.soc_per_s * (as_off - off)
                station, visited = problem.network.stations[node].id, (*stop_label.visited, stop_label.station)
                over = _StopLabel(node, station, as_off, soc, visited, stop_label.legs)
                rest = policy.over(self._standing(over, as_off, soc), rest)
        soc = charge - ratio * (problem.soc_fixed + problem.soc_per_s * (down - off))
        schedule = np.full((1, 1, COLUMNS), off)
        schedule[0, 0, [PAD, TOUCH_DOWN, SOC_TAKE_OFF, SOC_LANDING, ROOM]] = min(pad_s, off), down, charge, soc, 0.0
        return Leg(flown, charge if charge > stop_label.soc else None), schedule


def _given_up(flown: Flown | None, block: NDArray[np.int64], soc: float) -> Flown:
    none = np.full(1, np.nan)
    ending = np.full(1, GAVE_UP)
    if flown is None:
        return Flown(block, ending, np.zeros(1, dtype=bool), np.full(1, soc), none, none, none, none)
    return replace(flown, ending=ending, delivery_s=none, flight_s=none, wait_s=none, recharge_s=none)
