"""Deliveries flown through sampled truths decision by decision, by a policy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.flight_kernels import next_opening
from skyway.models.units import S_PER_H
from skyway.planner.course_kernels import COLUMNS, PAD, ROOM, SOC_DOWN, SOC_OFF, TOUCH_DOWN
from skyway.planner.evaluation_flights import DELIVERED, GAVE_UP, Flown, courses, pooled, tally
from skyway.planner.evaluation_kernels import gusty_land
from skyway.planner.evaluation_policies import Adaptive, Departure, Policy, Standing
from skyway.planner.itinerary import Hop
from skyway.planner.problem import HORIZON_H, check_apart
from skyway.planner.turning_kernels import out_or_back

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.planner.evaluation_truths import Truths
    from skyway.planner.itinerary import Itinerary
    from skyway.planner.problem import Problem

MOST_STOPS = 60
"""A policy that stops more often has given up."""
MOST_WAIT_S = HORIZON_H * S_PER_H
"""A policy that stays longer at a stop has given up: no forecast that it had there reaches further."""
PATIENCE = 1.0 / 24.0
"""Who has waited long decides again after this share of the wait, not sooner: a wait has some 100 decisions, not one each 5 minutes."""
_AGAIN_S = 30.0  # a drone that cannot leave yet looks at the clock again


def fly_policy(
    truths: Truths,
    drone: str,
    policy: Policy | Adaptive,
    runs: NDArray[np.int64] | None = None,
    *,
    watch: Callable[[Again], None] | None = None,
) -> tuple[Flown, list[Itinerary]]:
    """Fly a policy in some truths (all by default), run by run; also returns what it did in each.

    `watch` is told of each flight of an adaptive policy how to fly it again in other gusts.

    Raises
    ------
    InputError
        Start and destination are the same.
    """
    problem = truths.problem(drone)
    check_apart(problem)
    chosen = np.arange(len(truths)) if runs is None else runs
    parts, done = [], []
    for run in chosen.tolist():
        flown, itinerary = _fly_decisions(truths, problem, policy, run, watch)
        parts.append(flown)
        done.append(itinerary)
    return pooled(parts), done


def _fly_decisions(
    truths: Truths, problem: Problem, policy: Policy | Adaptive, run: int, watch: Callable[[Again], None] | None
) -> tuple[Flown, Itinerary]:
    """Fly decision by decision. Each time the whole way is flown again: that it is a pure function keeps one set of rules."""
    network = problem.network
    one = np.array([run])
    block = truths.block[one]
    hops: Itinerary = ()
    node, time_s, soc = problem.origin, problem.depart_s, problem.soc
    visited: tuple[str, ...] = ()
    flown: Flown | None = None
    course: NDArray[np.float64] | None = None
    while len(hops) < MOST_STOPS:
        station = network.stations[node].id
        stay = _Stay(run, node, station, time_s, soc, visited)
        if isinstance(policy, Adaptive):
            found = _fly_adaptive(truths, problem, policy, stay, watch)
            if found is None:
                break
            hop, flight = found
            hops = (*hops, hop)
            _land(truths, problem, run, int(network.head[hop.segments[-1]]), flight)
            course = flight if course is None else np.concatenate((course, flight), axis=1)
        else:
            decided = policy.decide(_standing(truths, problem, stay, time_s, soc))
            if decided is None:
                break
            hops = (*hops, decided)
            course = courses(truths, problem, hops, one)
        visited = (*visited, station)
        flown = tally(problem, hops, block, course)
        node = int(network.head[hops[-1].segments[-1]])
        if node == problem.destination or flown.ending[0] != DELIVERED:
            return flown, hops
        time_s, soc = float(course[0, -1, TOUCH_DOWN]), float(course[0, -1, SOC_DOWN])
    return _given_up(flown, block, problem.soc), hops


def _land(truths: Truths, problem: Problem, run: int, node: int, flight: NDArray[np.float64]) -> None:
    """Have a flight, shape (1, 1, 6), hover until there is a place to land."""
    came = float(flight[0, 0, TOUCH_DOWN])
    if not np.isfinite(came):
        return
    queue = truths.queues(problem, [node], int(truths.queue[run]))[node]
    flight[0, 0, TOUCH_DOWN] = float(queue.land_time(came))
    flight[0, 0, SOC_DOWN] -= truths.energy[run] * problem.soc_per_s * (flight[0, 0, TOUCH_DOWN] - came)


@dataclass(frozen=True)
class _Stay:
    """Where a drone has landed in a run, when, and with which charge."""

    run: int
    node: int
    station: str
    landed_s: float
    soc: float
    visited: tuple[str, ...]


@dataclass(frozen=True)
class Again:
    """A flight of an adaptive policy, to be flown again by the same policy in other gusts."""

    _truths: Truths
    _problem: Problem
    _policy: Adaptive
    _stay: _Stay
    _way: Departure
    _begun: tuple[float, float, float]

    def charge_left(self, gust_key: int) -> float:
        """Charge on touch-down in the gusts of a key."""
        keys = self._truths.gust_key.copy()
        keys[self._stay.run] = gust_key
        other = replace(self._truths, gust_key=keys)
        return float(_flight(other, self._problem, self._policy, self._stay, self._way, self._begun)[1][0, 0, SOC_DOWN])


def _standing(truths: Truths, problem: Problem, stay: _Stay, time_s: float, soc: float) -> Standing:
    """What is known at a stay at a time."""
    day, slot = truths.day[stay.run], truths.wind.slot_at(time_s)
    wind = truths.wind.north[day, slot], truths.wind.east[day, slot]
    nodes = np.flatnonzero(problem.network.pads > 0).tolist()
    paths = truths.queues(problem, nodes, int(truths.queue[stay.run]))
    busy = {problem.network.stations[node].id: paths[node].present_at(time_s) for node in nodes}
    behind = 0
    if stay.station in busy and time_s > stay.landed_s:  # who came after it does not stand before it in the line
        path = paths[stay.node]
        left = np.searchsorted(path.left_s, time_s, side="right") - np.searchsorted(
            path.left_s, stay.landed_s, side="right"
        )
        before = max(path.present_at(stay.landed_s) - int(left), 0)
        behind = max(busy[stay.station] - before, 0)
        busy[stay.station] = before
    energy = float(truths.energy[stay.run]) if stay.visited else math.nan
    return Standing(stay.node, stay.station, time_s, soc, stay.visited, wind, busy, energy, behind)


def _fly_adaptive(
    truths: Truths, problem: Problem, policy: Adaptive, stay: _Stay, watch: Callable[[Again], None] | None
) -> tuple[Hop, NDArray[np.float64]] | None:
    """Take off as the policy says, decided anew whenever the wind is: (hop, its course, shape (1, 1, 7))."""
    now, soc = stay.landed_s, stay.soc
    queue = truths.queues(problem, [stay.node], int(truths.queue[stay.run]))[stay.node]
    pad_s = float(queue.pad_time(stay.landed_s)) if problem.has_pads(stay.node) else math.inf
    curve_s, curve_soc = problem.curve(stay.node)
    charged_s = float(np.interp(stay.soc, curve_soc, curve_s))

    def charge_at(time_s: float) -> float:
        return float(np.interp(charged_s + time_s - pad_s, curve_s, curve_soc)) if time_s > pad_s else stay.soc

    wind = truths.wind
    end_s = min(wind.start_s + wind.slots * wind.slot_s, stay.landed_s + MOST_WAIT_S)
    while now < end_s:
        way = policy.leave(_standing(truths, problem, stay, now, soc))
        if way is None:
            return None
        until = min(wind.start_s + (wind.slot_at(now) + 1) * wind.slot_s, max(way.look_s, now + _AGAIN_S))
        until = max(until, now + PATIENCE * (now - stay.landed_s))
        segments = np.array(way.segments, dtype=np.int64)
        at = now
        while at < until:
            wanted = max(way.charge, way.need(at))
            if charge_at(at) >= wanted - 1e-9:
                opening = next_opening(problem.air, int(truths.day[stay.run]), segments, at)
                if opening <= at + 1e-6:
                    begun = pad_s, at, charge_at(at)
                    if watch is not None:
                        watch(Again(truths, problem, policy, stay, way, begun))
                    return _flight(truths, problem, policy, stay, way, begun)
                at = opening
            elif wanted <= curve_soc[-1] and pad_s < math.inf:
                reached = pad_s + float(np.interp(wanted, curve_soc, curve_s)) - charged_s
                at = max(reached, at + _AGAIN_S)
            else:
                break
        now, soc = until, charge_at(until)
    return None


def _flight(
    truths: Truths,
    problem: Problem,
    policy: Adaptive,
    stay: _Stay,
    way: Departure,
    begun: tuple[float, float, float],
) -> tuple[Hop, NDArray[np.float64]]:
    """Fly, asking the policy over each station with pads; `begun` is (pad, take-off, charge)."""
    pad_s, off, charge = begun
    sky = truths.sky()
    run, day, air = stay.run, int(truths.day[stay.run]), problem.air
    flown: tuple[int, ...] = ()
    rest = way.segments
    if way.turning is not None:
        energy = float(sky.energy[run]) * problem.soc_per_s / way.turning.soc_per_s
        down, turned = out_or_back(air, day, rest[0], off, charge, energy, sky.gust_key[run], way.turning)
        if turned:
            flown, rest = (rest[0], way.turning.back), ()
    while rest:
        flown, rest = (*flown, rest[0]), rest[1:]
        node = int(problem.network.head[flown[-1]])
        down = gusty_land(air, day, np.array(flown), off, sky.gust_key[run], sky.gust_sd, sky.gust_time_s)
        if rest and problem.has_pads(node):
            as_off = down - air.descent_s - air.climb_s
            soc = charge - float(sky.energy[run]) * problem.soc_per_s * (as_off - off)
            over = _Stay(run, node, problem.network.stations[node].id, as_off, soc, (*stay.visited, stay.station))
            rest = policy.over(_standing(truths, problem, over, as_off, soc), rest)
    soc = charge - float(sky.energy[run]) * (problem.soc_fixed + problem.soc_per_s * (down - off))
    course = np.full((1, 1, COLUMNS), off)
    course[0, 0, [PAD, TOUCH_DOWN, SOC_OFF, SOC_DOWN, ROOM]] = min(pad_s, off), down, charge, soc, 0.0
    return Hop(flown, charge if charge > stay.soc else None), course


def _given_up(flown: Flown | None, block: NDArray[np.int64], soc: float) -> Flown:
    none = np.full(1, np.nan)
    ending = np.full(1, GAVE_UP)
    if flown is None:
        return Flown(block, ending, np.zeros(1, dtype=bool), np.full(1, soc), none, none, none, none)
    return replace(flown, ending=ending, delivery_s=none, flight_s=none, wait_s=none, recharge_s=none)
