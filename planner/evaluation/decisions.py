"""Deliveries simulated decision by decision under a policy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import next_opening
from skyway.planner.evaluation.flights import DELIVERED, GAVE_UP, Flown, pooled, schedules, tally
from skyway.planner.evaluation.policies import Adaptive, Policy, Standing
from skyway.planner.online.turn_back_kernels import out_or_back
from skyway.planner.problem.problem import HORIZON_H, check_apart
from skyway.planner.schedule.gust_kernels import gusty_land
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.schedule_kernels import COLUMNS, PAD, ROOM, SOC_LANDING, SOC_TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

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

    `watch` is told of each flight of an adaptive policy how to fly it again in other gusts. An `InputError` says that
    start and destination are the same.
    """
    problem = realizations.problem(drone)
    check_apart(problem)
    chosen = np.arange(len(realizations)) if runs is None else runs
    parts, done = [], []
    for run in chosen.tolist():
        flown, itinerary = _fly_decisions(realizations, problem, policy, run, watch)
        parts.append(flown)
        done.append(itinerary)
    return pooled(parts), done


def _fly_decisions(
    realizations: Realizations,
    problem: Problem,
    policy: Policy | Adaptive,
    run: int,
    watch: Callable[[Again], None] | None,
) -> tuple[Flown, Itinerary]:
    """Fly decision by decision. Each time the whole way is flown again: that it is a pure function keeps one set of rules."""
    network = problem.network
    one = np.array([run])
    block = realizations.block[one]
    legs: Itinerary = ()
    node, time_s, soc = problem.origin, problem.depart_s, problem.soc
    visited: tuple[str, ...] = ()
    flown: Flown | None = None
    schedule: NDArray[np.float64] | None = None
    while len(legs) < problem.parameters.evaluation.max_stops:
        station = network.stations[node].id
        stop_label = _StopLabel(run, node, station, time_s, soc, visited, len(visited))
        if isinstance(policy, Adaptive):
            found = _fly_adaptive(realizations, problem, policy, stop_label, watch)
            if found is None:
                break
            leg, flight = found
            legs = (*legs, leg)
            ratio = realizations.energy_ratio(problem.drone, run, len(visited))
            _land(realizations, problem, run, int(network.head[leg.segments[-1]]), ratio, flight)
            schedule = flight if schedule is None else np.concatenate((schedule, flight), axis=1)
        else:
            decided = policy.decide(_standing(realizations, problem, stop_label, time_s, soc))
            if decided is None:
                break
            legs = (*legs, decided)
            schedule = schedules(realizations, problem, legs, one)
        visited = (*visited, station)
        flown = tally(problem, legs, block, schedule)
        node = int(network.head[legs[-1].segments[-1]])
        if node == problem.destination or flown.ending[0] != DELIVERED:
            return flown, legs
        time_s, soc = float(schedule[0, -1, TOUCH_DOWN]), float(schedule[0, -1, SOC_LANDING])
    return _given_up(flown, block, problem.soc), legs


def _land(
    realizations: Realizations, problem: Problem, run: int, node: int, ratio: float, flight: NDArray[np.float64]
) -> None:
    """Have a flight, shape (1, 1, 7), hover until there is a place to land; `ratio` is that of its energy to the model's."""
    came = float(flight[0, 0, TOUCH_DOWN])
    if not np.isfinite(came):
        return
    queue = realizations.queues(problem, [node], int(realizations.queue[run]))[node]
    flight[0, 0, TOUCH_DOWN] = float(queue.land_time(came))
    flight[0, 0, SOC_LANDING] -= ratio * problem.soc_per_s * (flight[0, 0, TOUCH_DOWN] - came)


@dataclass(frozen=True)
class _StopLabel:
    """Where a drone has landed in a run, when, and with which charge; or the station that it is over, on its leg number `legs`."""

    run: int
    node: int
    station: str
    landed_s: float
    soc: float
    visited: tuple[str, ...]
    legs: int


@dataclass(frozen=True)
class Again:
    """A flight of an adaptive policy, to be flown again by the same policy in other gusts."""

    _realizations: Realizations
    _problem: Problem
    _policy: Adaptive
    _stay: _StopLabel
    _way: Departure
    _begun: tuple[float, float, float]

    def charge_left(self, gust_key: int) -> float:
        """Charge on touch-down in the gusts of a key."""
        keys = self._realizations.gust_key.copy()
        keys[self._stay.run] = gust_key
        other = replace(self._realizations, gust_key=keys)
        return float(
            _flight(other, self._problem, self._policy, self._stay, self._way, self._begun)[1][0, 0, SOC_LANDING]
        )


def _standing(
    realizations: Realizations, problem: Problem, stop_label: _StopLabel, time_s: float, soc: float
) -> Standing:
    """What is known at a stay at a time."""
    day, slot = realizations.day[stop_label.run], realizations.wind.slot_at(time_s)
    wind = realizations.wind.north[day, slot], realizations.wind.east[day, slot]
    nodes = np.flatnonzero(problem.network.pads > 0).tolist()
    paths = realizations.queues(problem, nodes, int(realizations.queue[stop_label.run]))
    busy = {problem.network.stations[node].id: paths[node].present_at(time_s) for node in nodes}
    behind = 0
    if (
        stop_label.station in busy and time_s > stop_label.landed_s
    ):  # who came after it does not stand before it in the line
        path = paths[stop_label.node]
        left = np.searchsorted(path.left_s, time_s, side="right") - np.searchsorted(
            path.left_s, stop_label.landed_s, side="right"
        )
        before = max(path.present_at(stop_label.landed_s) - int(left), 0)
        behind = max(busy[stop_label.station] - before, 0)
        busy[stop_label.station] = before
    ratios = tuple(realizations.energy_ratio(problem.drone, stop_label.run, leg) for leg in range(stop_label.legs))
    under_way = None
    if stop_label.legs < len(stop_label.visited):
        under_way = realizations.energy_ratio(problem.drone, stop_label.run, stop_label.legs)
    return Standing(
        stop_label.node, stop_label.station, time_s, soc, stop_label.visited, wind, busy, ratios, under_way, behind
    )


def _fly_adaptive(
    realizations: Realizations,
    problem: Problem,
    policy: Adaptive,
    stop_label: _StopLabel,
    watch: Callable[[Again], None] | None,
) -> tuple[Leg, NDArray[np.float64]] | None:
    """Take off as the policy says, decided again whenever the wind is: (leg, its schedule, shape (1, 1, 7))."""
    now, soc = stop_label.landed_s, stop_label.soc
    queue = realizations.queues(problem, [stop_label.node], int(realizations.queue[stop_label.run]))[stop_label.node]
    pad_s = float(queue.pad_time(stop_label.landed_s)) if problem.has_pads(stop_label.node) else math.inf
    curve_s, curve_soc = problem.curve(stop_label.node)
    charged_s = float(np.interp(stop_label.soc, curve_soc, curve_s))

    def charge_at(time_s: float) -> float:
        return float(np.interp(charged_s + time_s - pad_s, curve_s, curve_soc)) if time_s > pad_s else stop_label.soc

    wind = realizations.wind
    end_s = min(wind.start_s + wind.slots * wind.slot_s, stop_label.landed_s + MAX_WAIT_S)
    while now < end_s:
        way = policy.leave(_standing(realizations, problem, stop_label, now, soc))
        if way is None:
            return None
        until = min(wind.start_s + (wind.slot_at(now) + 1) * wind.slot_s, max(way.look_s, now + _AGAIN_S))
        until = max(until, now + problem.parameters.evaluation.patience * (now - stop_label.landed_s))
        segments = np.array(way.segments, dtype=np.int64)
        at = now
        while at < until:
            wanted = max(way.charge, way.required(at))
            if charge_at(at) >= wanted - 1e-9:
                opening = next_opening(problem.air, int(realizations.day[stop_label.run]), segments, at)
                if opening <= at + 1e-6:
                    begun = pad_s, at, charge_at(at)
                    if watch is not None:
                        watch(Again(realizations, problem, policy, stop_label, way, begun))
                    return _flight(realizations, problem, policy, stop_label, way, begun)
                at = opening
            elif wanted <= curve_soc[-1] and pad_s < math.inf:
                reached = pad_s + float(np.interp(wanted, curve_soc, curve_s)) - charged_s
                at = max(reached, at + _AGAIN_S)
            else:
                break
        now, soc = until, charge_at(until)
    return None


def _flight(
    realizations: Realizations,
    problem: Problem,
    policy: Adaptive,
    stop_label: _StopLabel,
    way: Departure,
    begun: tuple[float, float, float],
) -> tuple[Leg, NDArray[np.float64]]:
    """Fly, asking the policy over each station with pads; `begun` is (pad, take-off, charge)."""
    pad_s, off, charge = begun
    disturbance = realizations.disturbance(problem.drone)
    run, day, air = stop_label.run, int(realizations.day[stop_label.run]), problem.air
    ratio = realizations.energy_ratio(problem.drone, run, stop_label.legs)
    flown: tuple[int, ...] = ()
    rest = way.segments
    if way.turn_back is not None:
        energy = ratio * problem.soc_per_s / way.turn_back.soc_per_s
        down, turned = out_or_back(air, day, rest[0], off, charge, energy, disturbance.gust_key[run], way.turn_back)
        if turned:
            flown, rest = (rest[0], way.turn_back.back), ()
    while rest:
        flown, rest = (*flown, rest[0]), rest[1:]
        node = int(problem.network.head[flown[-1]])
        down = gusty_land(
            air, day, np.array(flown), off, disturbance.gust_key[run], disturbance.gust_sd, disturbance.gust_time_s
        )
        if rest and problem.has_pads(node):
            as_off = down - air.descent_s - air.climb_s
            soc = charge - ratio * problem.soc_per_s * (as_off - off)
            over = _StopLabel(
                run, node, problem.network.stations[node].id, as_off, soc, (*stop_label.visited, stop_label.station),
                stop_label.legs,
            )  # fmt: skip
            rest = policy.over(_standing(realizations, problem, over, as_off, soc), rest)
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
