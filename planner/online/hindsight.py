"""The next step of a delivery, chosen by its results in futures drawn from the current information.

Futures are winds of the forecast, each with a sample of the queues that may grow out of those seen now, and an error of
the vehicle's energy. In each, the exact planner finds the best way on; what it does first is a step worth a thought.
Every such step is then taken in every future and followed by the best that can follow it there. The step with the least
expected arrival is taken, and the decision is repeated at the next station and at stations on the way
(hindsight optimisation: E. Chong, R. Givan, H. Chang, "A framework for simulation-based network control via hindsight
optimization", CDC 2000).

A flight that leads over stations with pads and room need not be sure of its end when it begins: it must be sure of the
next such station, where it lands if the rest has become too much, or of the way back (`planner.online.turn_back`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.planner.online.following import Following, Step
from skyway.planner.online.futures import flight_in
from skyway.planner.robust.free_capacity import blocking_probability_after

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.planner.online.futures import Future
    from skyway.planner.online.later_charges import LaterCharges
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary, Leg

ALIKE = 0.01
"""Charges closer than this are one."""
ROUNDING = 1e-4
"""Charge that is just enough for a flight must be so to the last digit, in winds that differ by as much."""
MIN_SOC = 0.01
"""Whoever lands counts with this charge at least."""


class Turning(Protocol):
    """How probably watched legs are turned (`planner.online.departure_gate`)."""

    def p_turned(self, step: Step) -> float:
        """Probability that a leg flown as a step prescribes turns back before the first station where it can land."""

    def charges(self, step: Step) -> list[float]:
        """Charges worth considering, because flights with them rarely turn back."""

    def kept_soc(self, step: Step) -> float:
        """Charge above the reserve that a leg must be expected to end with, to be flown on over the last station on its way where it can land; 0 where there is none."""


class Hindsight(Following):
    """Compares next steps from one state, as `Following` takes it.

    The belief about the next flight is by default what the errors say of a vehicle. `behind` others came to where the
    drone stands after it. A plan in force whose next leg has the segments `kept` is left only for a clear gain:
    `margin`, s, by how long the delivery then still takes. Where the wind is `measured` at every change, to wait for it
    tells more; else it stays only where no step leads on. To a station that it has stood at and `left` it goes back
    only for a clear gain.
    """

    def __init__(
        self,
        problem: Problem,
        errors: Errors,
        belief: EnergyBelief | None = None,
        *,
        behind: int = 0,
        futures: int | None = None,
        kept: tuple[int, ...] = (),
        margin: Callable[[float], float] = lambda _: 0.0,
        measured: bool = True,
        watched: bool = False,
        left: frozenset[str] = frozenset(),
        quick: bool = False,
        later: LaterCharges | None = None,
    ) -> None:
        known = belief if belief is not None else errors.energy_of(problem.drone).next_flight()
        super().__init__(
            problem, errors, known, futures or problem.parameters.online.futures, measured=measured, watched=watched,
            quick=quick, later=later,
        )  # fmt: skip
        self.roomy_way = True
        """Some way leads to a station with room, as far as was looked."""
        self._kept, self._clear = kept, margin
        self._behind = behind
        self._left = frozenset(problem.network.index[name] for name in left)
        self._closed: set[int] = set()

    def choose(self, turning: Turning | None = None) -> Step:
        """The step with the earliest expected arrival; without segments it lands here or, on the ground, stays.

        `turning` tells how probably a watched flight is turned before it can land; by default it is where it breaks the reserve.
        """
        p = self.problem
        steps = self._candidates(turning)
        stays = self._measured or not steps
        if p.has_pads(p.origin) if p.in_flight else stays:
            steps.append(Step((), p.soc))
        best: Step | None = None
        kept: Step | None = None
        for step in steps:
            arrival = self._expected(step, turning)
            if step.segments and int(p.network.head[step.segments[-1]]) in self._left:
                arrival += max(self._clear(arrival - p.depart_s), self.parameters.return_share * (arrival - p.depart_s))
            if best is None or arrival < best.arrival_s - (0.0 if step.segments else self.parameters.min_gain_s):
                best = replace(step, arrival_s=arrival)
            if step.segments and step.segments == self._kept and (kept is None or arrival < kept.arrival_s):
                kept = replace(step, arrival_s=arrival)
        if best is None:
            return Step((), p.soc)
        on_the_way = bool(best.segments) and int(p.network.head[best.segments[-1]]) != p.destination
        if not stays and not p.in_flight and (on_the_way or not math.isfinite(best.arrival_s)):
            staying = Step((), p.soc)
            arrival = self._expected(staying)
            if not best.arrival_s < arrival - self.parameters.min_gain_s:
                return replace(staying, arrival_s=arrival)
        if kept is not None and kept.arrival_s < best.arrival_s + self._clear(best.arrival_s - p.depart_s):
            return kept
        return best

    def _expected(self, step: Step, turning: Turning | None = None) -> float:
        """Mean arrival over the futures after a step, POSIX seconds."""
        turned = np.zeros(len(self.futures))
        if turning is not None and step.segments:
            order = np.argsort([-self._cost(step, future) for future in self.futures], kind="stable")
            turned[order] = np.clip(turning.p_turned(step) * len(order) - np.arange(len(order)), 0.0, 1.0)
        follows = zip(self.futures, turned.tolist(), strict=True)
        return float(np.mean([self._follow(step, future, share) for future, share in follows]))

    def _cost(self, step: Step, future: Future) -> float:
        """Charge that a flight takes in a future to where it must get: where it takes most it is turned first."""
        sure = step.segments[: step.sure or len(step.segments)]
        off, down = flight_in(future, sure, self.problem.depart_s, self.parameters.hold_slots)
        return self._used(future, sure, off, down) if down < NEVER else 0.0

    def close(self, segment: int, until_s: float = math.inf) -> None:
        """Begin no flight over a segment now, nor count on one before a time, POSIX seconds."""
        for future in self.futures:
            future.careful.close(segment, until_s)
        self._closed.add(segment)
        self._arrivals.clear()
        self._stays.clear()

    def arrival_s(self, station: str, time_s: float, soc: float) -> float:
        """Expected arrival of the delivery by way of a landing at a station at a time with a charge, POSIX seconds."""
        p = self.problem
        node = p.network.index[station]
        if node == p.destination:
            return time_s
        return float(np.mean([self._arrival(future, node, time_s, max(soc, MIN_SOC)) for future in self.futures]))

    def onward(self, step: Step) -> Itinerary:
        """Flights that follow a step in the future whose arrival is the median one."""
        p = self.problem
        arrivals = [self._follow(step, future) for future in self.futures]
        future = self.futures[int(np.argsort(arrivals, kind="stable")[len(arrivals) // 2])]
        node = int(p.network.head[step.segments[-1]])
        if node == p.destination:
            return ()
        off = p.depart_s if step.charge <= p.soc + 1e-9 else self._charged_s(future, step.charge)
        off, down = flight_in(future, step.segments, off, self.parameters.hold_slots)
        if down >= NEVER:
            return ()
        soc = max(step.charge - future.energy * self._taken(down - off), p.reserve)
        after = p.standing_at(node, float(future.queues[node].land_time(down)), soc)
        return self._search(after, future).find() or ()

    def _candidates(self, turning: Turning | None) -> list[Step]:
        """What the exact planner does first in each future, with charges that are enough for what must be sure."""
        p = self.problem
        charges: dict[tuple[int, ...], list[float]] = {}
        for future in self.futures:
            leg = self._first(future)
            if leg is not None:
                charges.setdefault(leg.segments, []).append(leg.charge_to or p.soc)
        self.roomy_way = bool(charges)
        if self._kept and not self._closed & set(self._kept) and self.sure_of(self._kept):
            charges.setdefault(self._kept, []).append(p.soc)
        steps = []
        for segments in sorted(charges, key=lambda way: -len(charges[way]))[: self.parameters.steps]:
            sure = self.sure_of(segments)
            least = self.need(segments[:sure], p.depart_s)
            full = float(p.curve(p.origin)[1][-1]) if p.has_pads(p.origin) and not p.in_flight else p.soc
            steps += self._tries(segments, least, full)
            if least > full:
                continue
            wanted = np.quantile(charges[segments], self.parameters.charge_quantiles).tolist()
            last, kept = self.last_sure_of(segments), 0.0
            if turning is not None:
                whole = Step(segments, p.soc, sure, last)
                kept = turning.kept_soc(whole)
                wanted += turning.charges(whole)
            wanted += self._takes(segments, kept) if self._watched else [self.need(segments, p.depart_s)]
            levels = np.clip(np.sort(wanted) + ROUNDING, max(least, p.soc), full)
            before = -1.0
            for level in levels.tolist():
                if level - before > ALIKE:
                    steps.append(Step(segments, level, sure, last, kept))
                    before = level
        return steps

    def _takes(self, segments: tuple[int, ...], kept_soc: float) -> list[float]:
        """Charges that keep the reserve, and some more, in half of the futures, and in more."""
        p = self.problem
        flights = [(one, *flight_in(one, segments, p.depart_s, self.parameters.hold_slots)) for one in self.futures]
        used = [self._used(one, segments, off, down) for one, off, down in flights if down < NEVER]
        takes = [p.reserve + one + max(self._doubt * one, kept_soc) + self.parameters.told_soc for one in used]
        return np.quantile(takes, self.parameters.sure_quantiles, method="higher").tolist() if takes else []

    def _tries(self, segments: tuple[int, ...], least: float, full: float) -> list[Step]:
        """The same with charges below the least that is sure, where it can turn back."""
        p = self.problem
        may = (
            not self._watched
            and p.soc < least
            and self.sure_of(segments) == 1
            and p.has_pads(p.origin)
            and not p.in_flight
        )
        how = self.turns.over(segments[0]) if may else None
        if how is None:
            return []
        flights = [flight_in(future, segments[:1], p.depart_s, 0)[1] - p.depart_s for future in self.futures]
        last = self.last_sure_of(segments)
        charges = self.turns.charges(self._taken(float(np.median(flights))), least)
        levels = sorted({max(one, p.soc) for one in charges if one <= full})
        return [Step(segments, one, 1, last, turn_back=how) for one in levels if self._room_back(one)]

    def _room_back(self, charge: float) -> bool:
        """Whether it finds room where it stands if it turns back, after charging so far."""
        p = self.problem
        away_s = p.charge_time_s(p.origin, p.soc, charge) + (charge - p.reserve) / p.soc_per_s
        return blocking_probability_after(p, away_s, behind=self._behind) <= p.epsilon / self.parameters.commitments

    def _first(self, future: Future) -> Leg | None:
        """First flight of the best way in a future that leads to or over a station with room."""
        for stops in (None, self._near):
            found = self._search(self.problem, future, stops).find()
            if found and self.sure_of(found[0].segments) and not self._closed & set(found[0].segments):
                return found[0]
        return None

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Stations with room, and those so far that it will be seen in time whether there is room."""
        stops = self.likely_free_at | (self._away_s > self.parameters.far_s)
        stops[[self.problem.origin, self.problem.destination]] = True
        return stops
