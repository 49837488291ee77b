"""The next step of a delivery, chosen by what it would lead to in futures drawn from what is known now.

Futures are winds of the forecast, each with a sample of the queues that may grow out of those seen now, and an error of
the vehicle's energy. In each, the exact planner finds the best way on; what it does first is a step worth a thought.
Every such step is then taken in every future and followed by the best that can follow it there. The step with the least
expected arrival is taken, and everything is thought over again at the next station and at stations on the way
(hindsight optimisation: E. Chong, R. Givan, H. Chang, "A framework for simulation-based network control via hindsight
optimization", CDC 2000).

A flight that leads over stations with pads and room need not be sure of its end when it begins: it must be sure of the
next such station, where it lands if the rest has become too much, or of the way back (`planner.online.turn_back`).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.flight.kernels import NEVER, slot_end, slot_of
from skyway.models.queues.sampling import no_queue
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.turn_back import USUAL_FLIGHT_S, TurnBacks
from skyway.planner.problem.flight_table import FlightTable, ground_speeds, table_land, table_slot, table_slot_end
from skyway.planner.robust.charge_policy import known_at
from skyway.planner.robust.free_capacity import blocking_probability_after, likely_free
from skyway.planner.robust.required_soc_kernels import careful_speeds, flight_energy, gust_mean

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from skyway.models.queues.sampling import QueuePath
    from skyway.planner.online.turn_back_kernels import TurnBack
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Leg

FUTURES = 10
"""Drawn for each decision."""
HOURS = 12.0
"""How far ahead the wind of a future is looked at; its last hour holds on."""
STEPS = 5
"""Flights that are compared, at most; those that are best in the most futures."""
LATER_MARGIN = 0.02
"""Of the energy of later flights, which will not be begun without one."""
CAREFUL = 1.0
"""Later flights count on the wind with a mean gust against them of so many standard deviations: they will be charged for it."""
COMMITMENTS = 4.0
"""A delivery shares epsilon out among about so many landings that must find room."""
ENERGY_SHARES = 4.0
"""And among so many flights that may need more than they were charged for: not many are begun with what they need and no more. How
often a landing is below the reserve `benchmarks.rolling_risk` measures."""
LEARNED = 0.005
"""What is left of the error of a vehicle's energy once a flight has shown it."""
STUCK_S = 6 * 3600.0
"""What a future counts for in which a step ends where no way leads on."""
FAR_S = 1200.0
"""Who is seen at a station that is further away says little about who will be there."""
MIN_GAIN_S = 120.0
"""To land or to stay must gain so much: in a future everything is known that is not known yet when it has landed."""
STOP_S = 60.0
"""The same for a stop more."""
PHASE_S = 600.0
"""What is needed depends on how soon the wind changes, looked at in steps of this."""
HOLD_SLOTS = 12
"""Slots of wind for which a flight may be held up, as it is followed in a future."""
ALIKE = 0.01
"""Charges closer than this are one."""


@dataclass(frozen=True)
class Step:
    """A flight and how to begin it.

    Attributes
    ----------
    segments : tuple of int
        Flown without a landing between, if all goes well; empty: land here.
    charge : float
        Take-off with at least this charge.
    sure : int
        Segments up to the first station at which it can land if need be: its charge must be enough for these.
    last : int
        Segments up to the last such station before the end.
    arrival_s : float
        Expected arrival of the delivery, POSIX seconds.
    turning : Turning or None
        How it may turn back on the first segment, for which its charge need not be enough then.
    """

    segments: tuple[int, ...]
    charge: float
    sure: int = 0
    last: int = 0
    arrival_s: float = math.inf
    turn_back: TurnBack | None = None


@dataclass(frozen=True, eq=False)
class Future:
    """One course that wind, queues and the vehicle may take.

    Attributes
    ----------
    table : FlightTable
        Its wind.
    careful : ndarray, shape (slots, segments)
        Ground speeds that later flights count on, m/s.
    queues : dict of int to QueuePath
        By node.
    energy : float
        What the next flight takes as a multiple of what is expected.
    """

    careful: NDArray[np.float64]
    table: FlightTable
    queues: dict[int, QueuePath]
    energy: float


class Hindsight:
    """Compares next steps from one state.

    Parameters
    ----------
    problem : Problem
        From that state on, with the forecast of that moment. In flight, the origin is the node that the drone is over.
    errors : Errors
        What the truth has beyond the forecast.
    energy : float
        Energy that the vehicle's flights have taken as a multiple of the model's; NaN: none has shown it yet.
    behind : int
        Others that came to where the drone stands after it.
    futures : int
        How many are drawn.

    Attributes
    ----------
    roomy_way : bool
        Some way leads to a station with room, as far as was looked.
    """

    def __init__(
        self, problem: Problem, errors: Errors, *, energy: float = math.nan, behind: int = 0, futures: int = FUTURES
    ) -> None:
        self.unsure = errors.energy if math.isnan(energy) else LEARNED
        self.problem = problem if math.isnan(energy) else _heavier(problem, energy)
        self.roomy_way = True
        self._margins: dict[tuple[tuple[int, ...], int], float] = {}
        self._count = futures
        self._behind = behind
        # The forecast of the moment is shifted and weighted by what was measured already.
        known = known_at(problem, errors, measured=True, epsilon=problem.epsilon / ENERGY_SHARES)
        self._known = known._replace(measured=False)
        self.turns = TurnBacks(self.problem, self._known, self.unsure)

    @cached_property
    def futures(self) -> list[Future]:
        """Drawn evenly by probability."""
        p = self.problem
        air = p.air
        share = np.cumsum(p.probability) / p.probability.sum()
        members = np.searchsorted(share, (np.arange(self._count) + 0.5) / self._count)
        rng = np.random.default_rng((p.request.seed, len(members)))
        energy = 1.0 + self.unsure * rng.permutation((2.0 * np.arange(len(members)) + 1.0) / len(members) - 1.0)
        ahead_s = max(p.depart_s - air.start_s, 0.0) + HOURS * 3600.0
        slots = np.arange(min(air.north.shape[1], 1 + int(ahead_s // air.slot_s)))
        segments = np.arange(len(air.distance_m))
        against = CAREFUL * gust_mean(self._known, USUAL_FLIGHT_S)
        found = []
        for sample, (member, multiple) in enumerate(zip(members.tolist(), energy.tolist(), strict=True)):
            speeds = ground_speeds(air, member, slots, segments)
            careful = careful_speeds(air, member, slots, segments, against)
            table = FlightTable(
                air.start_s,
                air.slot_s,
                air.climb_s,
                air.descent_s,
                p.network.first,
                p.network.head,
                air.distance_m,
                speeds,
            )
            queues = p.queue_paths(range(len(p.network)), sample)
            found.append(Future(careful, table, queues, multiple))
        return found

    def need(self, segments: Iterable[int], time_s: float) -> float:
        """Charge with which a flight that takes off at a time keeps the reserve in all but a share of what may come."""
        p = self.problem
        cost = float(p.soc_per_s), float(p.soc_fixed)
        still = np.zeros(p.air.north.shape[2])
        energy, _ = flight_energy(self._known, 0, np.asarray(segments, dtype=np.int64), time_s, still, still, cost)
        return p.reserve + (1.0 + self.unsure) * energy

    def sure_of(self, segments: tuple[int, ...]) -> int:
        """How many segments it is to the first station on the way with pads and likely room; 0: there is none."""
        head = self.problem.network.head
        return next((count for count, one in enumerate(segments, start=1) if self.likely_free_at[head[one]]), 0)

    @cached_property
    def likely_free_at(self) -> NDArray[np.bool_]:
        """Where a drone can count on a place to land and a pad to wait for, shape (nodes,)."""
        return likely_free(self.problem, self.problem.epsilon / COMMITMENTS, self._away_s)

    @cached_property
    def _away_s(self) -> NDArray[np.float64]:
        """How long a flight to each node takes at least, about, shape (nodes,)."""
        p = self.problem
        distance, _ = geodesy.inverse(p.network.lat[p.origin], p.network.lon[p.origin], p.network.lat, p.network.lon)
        return np.asarray(p.air.climb_s + p.air.descent_s + distance / p.air.airspeed_mps)

    def choose(self) -> Step:
        """The step with the least expected arrival; without segments it is to land here or, on the ground, to stay."""
        p = self.problem
        steps = self._candidates()
        if not p.in_flight or p.has_pads(p.origin):
            steps.append(Step((), p.soc))
        best: Step | None = None
        for step in steps:
            arrival = float(np.mean([self._follow(step, future) for future in self.futures]))
            if best is None or arrival < best.arrival_s - (0.0 if step.segments else MIN_GAIN_S):
                best = replace(step, arrival_s=arrival)
        return best if best is not None else Step((), p.soc)

    def _candidates(self) -> list[Step]:
        """What the exact planner does first in each future, with charges that are enough for what must be sure."""
        p = self.problem
        charges: dict[tuple[int, ...], list[float]] = {}
        for future in self.futures:
            leg = self._first(future)
            if leg is not None:
                charges.setdefault(leg.segments, []).append(leg.charge_to or p.soc)
        self.roomy_way = bool(charges)
        steps = []
        for segments in sorted(charges, key=lambda way: -len(charges[way]))[:STEPS]:
            sure = self.sure_of(segments)
            least = self.need(segments[:sure], p.depart_s)
            full = float(p.curve(p.origin)[1][-1]) if p.has_pads(p.origin) and not p.in_flight else p.soc
            steps += self._tries(segments, least, full)
            if least > full:
                continue
            quantiles = np.quantile(charges[segments], (0.0, 0.25, 0.5, 0.75, 1.0)).tolist()
            levels = np.clip(sorted([*quantiles, self.need(segments, p.depart_s)]), max(least, p.soc), full)
            last = self._last_sure(segments)
            before = -1.0
            for level in levels.tolist():
                if level - before > ALIKE:
                    steps.append(Step(segments, level, sure, last))
                    before = level
        return steps

    def _tries(self, segments: tuple[int, ...], least: float, full: float) -> list[Step]:
        """The same with charges below the least that is sure, where it can turn back."""
        p = self.problem
        may = p.soc < least and self.sure_of(segments) == 1 and p.has_pads(p.origin) and not p.in_flight
        how = self.turns.over(segments[0]) if may else None
        if how is None:
            return []
        flights = [_flight(future.table, segments[:1], p.depart_s, 0)[1] - p.depart_s for future in self.futures]
        last = self._last_sure(segments)
        charges = self.turns.charges(self._taken(float(np.median(flights))), least)
        levels = sorted({max(one, p.soc) for one in charges if one <= full})
        return [Step(segments, one, 1, last, turn_back=how) for one in levels if self._room_back(one)]

    def _room_back(self, charge: float) -> bool:
        """Whether it finds room where it stands if it turns back, after charging so far."""
        p = self.problem
        away_s = p.charge_time_s(p.origin, p.soc, charge) + (charge - p.reserve) / p.soc_per_s
        return blocking_probability_after(p, away_s, behind=self._behind) <= p.epsilon / COMMITMENTS

    def _last_sure(self, segments: tuple[int, ...]) -> int:
        """How many segments it is to the last station with room before the end; 0: there is none."""
        head = self.problem.network.head
        return max(
            (count for count in range(1, len(segments)) if self.likely_free_at[head[segments[count - 1]]]), default=0
        )

    def _margin(self, rest: tuple[int, ...], time_s: float) -> float:
        """Charge beyond what a flight takes, as a share, with which it will be begun at a time.

        As if the wind of that hour were known as that of this one is now.
        """
        air = self.problem.air
        now = slot_of(air, self.problem.depart_s)
        into = (time_s - air.start_s) % air.slot_s // PHASE_S
        key = rest, int(into)
        if key not in self._margins:
            at = air.start_s + now * air.slot_s + into * PHASE_S
            need = self.need(rest, at) - self.problem.reserve
            flights = [_flight(future.table, rest, at, 0) for future in self.futures]
            taken = [self._taken(down - off) for off, down in flights if down < NEVER]
            known = taken and need < NEVER
            self._margins[key] = max(need / float(np.mean(taken)) - 1.0, 0.0) if known else math.inf
        return self._margins[key]

    def _taken(self, flight_s: float) -> float:
        return float(self.problem.soc_fixed + self.problem.soc_per_s * flight_s)

    def _first(self, future: Future) -> Leg | None:
        """First flight of the best way in a future that leads to or over a station with room."""
        for stops in (None, self._near):
            found = self._search(self.problem, future, stops).find()
            if found and self.sure_of(found[0].segments):
                return found[0]
        return None

    def _search(self, problem: Problem, future: Future, stops: NDArray[np.bool_] | None = None) -> ExactSearch:
        margin = LATER_MARGIN * problem.soc_per_s
        return ExactSearch(problem, future.queues, speeds=future.careful, margin_soc_per_s=margin, stops=stops)

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Stations with room, and those so far that it will be seen in time whether there is room."""
        stops = self.likely_free_at | (self._away_s > FAR_S)
        stops[[self.problem.origin, self.problem.destination]] = True
        return stops

    def _follow(self, step: Step, future: Future) -> float:
        """Arrival in a future after a step, POSIX seconds."""
        p = self.problem
        if not step.segments:
            return self._stay(future)
        off = p.depart_s
        if step.charge > p.soc + 1e-9 and not p.in_flight:
            off = self._charged_s(future, step.charge)
            if off >= self._new_wind_s:
                return self._stay(future)  # by then it will have thought again
        if step.turn_back is None:
            return self._through(step, future, off)
        trial = self.turns.trial(step.segments[0], step.turn_back, step.charge, off)
        if trial is None:
            return math.inf
        through = self._through(step, future, off)
        if trial.there == 1.0:
            return through
        back = self._arrival(future, p.origin, off + trial.back_s, trial.soc) + STOP_S
        return trial.there * through + (1.0 - trial.there) * back

    def _through(self, step: Step, future: Future, off: float) -> float:
        """Arrival in a future after a flight that gets as far as it can, taking off at a time."""
        p = self.problem
        head = p.network.head
        for count in range(len(step.segments), 0, -1):
            node = int(head[step.segments[count - 1]])
            if count < len(step.segments) and not self.likely_free_at[node]:
                continue
            begun, down = _flight(future.table, step.segments[:count], off, 0 if p.in_flight else HOLD_SLOTS)
            if down >= NEVER:
                continue
            off = begun
            soc = step.charge - future.energy * self._taken(down - off)
            if count == len(step.segments) and step.last and not self._goes_on(step, future, off, soc, down):
                continue
            if soc >= p.reserve or (step.turn_back is not None and count == 1):
                soc = max(soc, p.reserve)
                if node == p.destination:
                    return float(future.queues[node].land_time(down))
                return self._arrival(future, node, down, soc) + STOP_S
        return p.depart_s + STUCK_S

    def _goes_on(self, step: Step, future: Future, off_s: float, soc: float, down_s: float) -> bool:
        """Whether it will fly on over the last station on its way, if that would end at a time with a charge."""
        p = self.problem
        way, rest = step.segments[: step.last], step.segments[step.last :]
        as_off = (
            float(table_land(future.table, np.asarray(way, dtype=np.int64), off_s)) - p.air.climb_s - p.air.descent_s
        )
        return soc >= p.reserve + self._margin(rest, as_off) * future.energy * self._taken(down_s - as_off)

    @cached_property
    def _new_wind_s(self) -> float:
        """When the wind is measured again."""
        return float(slot_end(self.problem.air, slot_of(self.problem.air, self.problem.depart_s)))

    def _charged_s(self, future: Future, charge: float) -> float:
        """When it has a charge at the station where it stands."""
        p = self.problem
        time, level = p.curve(p.origin)
        pad = float(future.queues[p.origin].pad_time(p.depart_s))
        return pad + float(np.interp(charge, level, time) - np.interp(p.soc, level, time))

    def _stay(self, future: Future) -> float:
        """Arrival if it lands here, or stays where it stands until the next wind."""
        p = self.problem
        if p.in_flight:
            landing = p.air.climb_s + p.air.descent_s
            soc = p.soc - future.energy * self._taken(landing)
            return self._arrival(future, p.origin, p.depart_s + landing, soc)
        until = self._new_wind_s
        if until == NEVER:
            return p.depart_s + STUCK_S
        queue = future.queues[p.origin]
        pad = float(queue.pad_time(p.depart_s)) if p.has_pads(p.origin) else math.inf
        soc = p.soc
        if until > pad:
            time, level = p.curve(p.origin)
            soc = float(np.interp(np.interp(soc, level, time) + until - pad, time, level))
            queue = no_queue()
        after = p.standing_at(p.origin, until, soc)
        search = self._search(after, replace(future, queues={**future.queues, p.origin: queue}))
        return search.best_s if search.find() else p.depart_s + STUCK_S

    def _arrival(self, future: Future, node: int, time_s: float, soc: float) -> float:
        """Best arrival in a future of a drone that lands at a station."""
        p = self.problem
        landed = float(future.queues[node].land_time(time_s))
        after = p.standing_at(node, landed, soc)
        search = self._search(after, future)
        return search.best_s if search.find() else p.depart_s + STUCK_S


def _flight(table: FlightTable, segments: tuple[int, ...], off_s: float, slots: int) -> tuple[float, float]:
    """When a flight takes off and lands that may be held for some slots of wind: (take-off, touch-down)."""
    way = np.asarray(segments, dtype=np.int64)
    for _ in range(slots + 1):
        down = float(table_land(table, way, off_s))
        if down < NEVER:
            return off_s, down
        off_s = float(table_slot_end(table, int(table_slot(table, off_s))))
        if off_s == NEVER:
            break
    return off_s, math.inf


def _heavier(problem: Problem, energy: float) -> Problem:
    """Return the same problem for a vehicle whose flights take a multiple of the energy."""
    moved = copy(problem)
    moved.soc_per_s, moved.soc_fixed = energy * problem.soc_per_s, energy * problem.soc_fixed
    return moved
