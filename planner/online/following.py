"""The result of a step in a future: how it is flown there, where it lands if the rest is too much, and the best that can follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import NEVER, slot_end, slot_of
from skyway.models.queues.paths import no_queue
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.futures import draw_futures, flight_in
from skyway.planner.online.turn_back import TurnBacks
from skyway.planner.robust.charge_policy import known_at
from skyway.planner.robust.free_capacity import likely_free
from skyway.planner.robust.required_soc_kernels import flight_energy

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.planner.online.futures import Future
    from skyway.planner.online.later_charges import LaterCharges
    from skyway.planner.online.turn_back_kernels import TurnBack
    from skyway.planner.problem.error_model import Errors
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


@dataclass(frozen=True)
class Step:
    """A flight and how to begin it."""

    segments: tuple[int, ...]
    """Flown without a landing between, if all goes well; empty: land here."""
    charge: float
    """Take-off with at least this charge."""
    sure: int = 0
    """Segments up to the first station at which it can land if need be: its charge must be enough for these."""
    last: int = 0
    """Segments up to the last such station before the end."""
    kept_soc: float = 0.0
    """Charge above the reserve that a watched flight must be expected to end with, to be flown on over that station."""
    arrival_s: float = math.inf
    """Expected arrival of the delivery, POSIX seconds."""
    turn_back: TurnBack | None = None
    """How it may turn back on the first segment, for which its charge need not be enough then."""


class Following:
    """Follows steps from one state in futures drawn from the information there.

    The problem begins in that state, with the forecast of that moment; in flight, its origin is the node that the drone
    is over. Errors are gusts that no forecast tells, the belief is about the next flight. Where the wind is `measured`
    at every change, it thinks again then. A flight that is `watched` and would not keep the reserve is turned elsewhere
    while it can be: it is worth a try with what most probably is enough.
    `quick` takes lower bounds for arrivals on large networks, of whose ways nothing else is wanted then. Legs after it leave with what `later` tells,
    except on large networks.
    """

    def __init__(
        self,
        problem: Problem,
        errors: Errors,
        belief: EnergyBelief,
        futures: int,
        *,
        measured: bool = True,
        watched: bool = False,
        quick: bool = False,
        later: LaterCharges | None = None,
    ) -> None:
        self._large = problem.parameters.robust.is_large(len(problem.network))
        self._quick = quick and self._large
        self._later = None if self._large else later
        self.parameters = online = problem.parameters.online
        sd = math.hypot(belief.sd_between / belief.mean_ratio, online.wind_spread if watched else 0.0)
        self._relative = replace(belief, mean_ratio=1.0, sd_between=sd, sd_within=0.0)
        self._measured, self._watched = measured, watched
        sigmas = belief.sigmas(1.0 - problem.epsilon)
        self._doubt = sigmas * belief.sd_within / belief.mean_ratio if watched else 0.0
        self.arrives = False
        """A way on was found in some future."""
        self.problem = problem if belief.mean_ratio == 1.0 else problem.with_energy(belief.mean_ratio)
        self._later_margin = online.later_margin + online.later_sigmas * belief.sd_within / belief.mean_ratio
        self._margins: dict[tuple[tuple[int, ...], int], float] = {}
        self._arrivals: dict[tuple[Future, int, float, float], float] = {}
        self._stays: dict[Future, float] = {}
        self._count = futures
        # The forecast of the moment is shifted and weighted by what was measured already. Where the hour was not measured, the next one is
        # no less sure than it.
        known = known_at(
            problem,
            errors,
            measured=measured,
            epsilon=online.p_begin if watched else problem.epsilon / online.energy_shares,
        )
        self._known = known._replace(measured=False)
        self.turns = TurnBacks(self.problem, self._known, self._relative)

    @cached_property
    def futures(self) -> list[Future]:
        """Drawn evenly by probability."""
        return draw_futures(self.problem, self._known, self._relative, self._count)

    def need(self, segments: Iterable[int], time_s: float) -> float:
        """Charge with which a flight that takes off at a time keeps the reserve: most probably if watched, else in all but a share."""
        p = self.problem
        cost = float(p.soc_per_s), float(p.soc_fixed)
        still = np.zeros(p.air.north.shape[2])
        way, deviation = np.asarray(segments, dtype=np.int64), 0.0 if self._watched else self._relative.sd_between
        energy, _ = flight_energy(self._known, 0, way, time_s, still, still, cost, deviation)
        return p.reserve + energy

    def sure_of(self, segments: tuple[int, ...]) -> int:
        """Number of segments to the first station on the way with pads and likely room; 0 if there is none."""
        head = self.problem.network.head
        return next((count for count, one in enumerate(segments, start=1) if self.likely_free_at[head[one]]), 0)

    def last_sure_of(self, segments: tuple[int, ...]) -> int:
        """Number of segments to the last such station before the end; 0 if there is none."""
        head = self.problem.network.head
        return max(
            (count for count in range(1, len(segments)) if self.likely_free_at[head[segments[count - 1]]]), default=0
        )

    @cached_property
    def likely_free_at(self) -> NDArray[np.bool_]:
        """Times from which a drone can expect room to land and a pad to wait for, shape (nodes,)."""
        return likely_free(self.problem, self.problem.epsilon / self.parameters.commitments, self._away_s)

    @cached_property
    def _away_s(self) -> NDArray[np.float64]:
        """How long a flight to each node takes at least, about, shape (nodes,)."""
        p = self.problem
        distance, _ = geodesy.inverse(p.network.lat[p.origin], p.network.lon[p.origin], p.network.lat, p.network.lon)
        return np.asarray(p.air.climb_s + p.air.descent_s + distance / p.air.airspeed_mps)

    def _margin(self, rest: tuple[int, ...], time_s: float) -> float:
        """Charge beyond what a flight takes, as a share, with which it will start at a time.

        As if the wind of that hour were known as that of this one is now.
        """
        air = self.problem.air
        now = slot_of(air, self.problem.depart_s)
        into = (time_s - air.start_s) % air.slot_s // self.parameters.phase_s
        key = rest, int(into)
        if key not in self._margins:
            at = air.start_s + now * air.slot_s + into * self.parameters.phase_s
            need = self.need(rest, at) - self.problem.reserve
            flights = [flight_in(future, rest, at, 0) for future in self.futures]
            taken = [self._taken(down - off) for off, down in flights if down < NEVER]
            known = taken and need < NEVER
            self._margins[key] = max(need / float(np.mean(taken)) - 1.0, 0.0) if known else math.inf
        return self._margins[key]

    def _taken(self, flight_s: float) -> float:
        return float(self.problem.soc_fixed + self.problem.soc_per_s * flight_s)

    def _used(self, future: Future, segments: tuple[int, ...], off_s: float, down_s: float) -> float:
        """Charge that a flight takes in a future; where it is watched gusts count too, for nothing else covers them."""
        flight_s = down_s - off_s
        if self._watched:
            flight_s = (1.0 + future.slowed(segments, off_s)) * flight_s + self.parameters.manoeuvres_s
        return future.energy * self._taken(flight_s)

    def _search(self, problem: Problem, future: Future, stops: NDArray[np.bool_] | None = None) -> ExactSearch:
        margin = self._later_margin * problem.soc_per_s
        return ExactSearch(
            problem, future.queues, speeds=future.careful, margin_soc_per_s=margin, stops=stops,
            most_labels=self.parameters.large_labels if self._large else math.inf,
        )  # fmt: skip

    def _follow(self, step: Step, future: Future, turned: float = 0.0) -> float:
        """Arrival in a future after a step, POSIX seconds; a watched flight is `turned` there with a probability, beside where it must be."""
        p = self.problem
        if not step.segments:
            return self._stay(future)
        off = p.depart_s
        if step.charge > p.soc + 1e-9 and not p.in_flight:
            off = self._charged_s(future, step.charge)
            if self._measured and off >= self.new_wind_s:
                return self._stay(future)  # by then it will have thought again
        if step.turn_back is None:
            through = self._through(step, future, off) if turned < 1.0 else 0.0
            return through if turned == 0.0 else (1.0 - turned) * through + turned * self._back(step, future, off)
        trial = self.turns.trial(step.segments[0], step.turn_back, step.charge, off)
        if trial is None:
            return math.inf
        through = self._through(step, future, off)
        if trial.there == 1.0:
            return through
        back = self._arrival(future, p.origin, off + trial.back_s, trial.soc) + self.parameters.stop_s
        return trial.there * through + (1.0 - trial.there) * back

    def _through(self, step: Step, future: Future, off: float) -> float:
        """Arrival in a future after a flight that gets as far as it can, taking off at a time."""
        there_s = self._there(step, future, off)
        if there_s is not None:
            return there_s
        return self._back(step, future, off) if self._watched else self._stuck_s

    def _there(self, step: Step, future: Future, off: float) -> float | None:
        """Arrival in a future after a flight that lands at its end or a station on its way; None where it can do neither."""
        p = self.problem
        head = p.network.head
        for count in range(len(step.segments), 0, -1):
            node = int(head[step.segments[count - 1]])
            if count < len(step.segments) and not self.likely_free_at[node]:
                continue
            begun, down = flight_in(
                future, step.segments[:count], off, 0 if p.in_flight else self.parameters.hold_slots
            )
            if down >= NEVER:
                continue
            off = begun
            used = self._used(future, step.segments[:count], off, down)
            soc = step.charge - used
            if count == len(step.segments) and step.last and not self._goes_on(step, future, off, soc, down):
                continue
            kept = max(self._doubt * used, step.kept_soc if count == len(step.segments) else 0.0)
            if soc >= p.reserve + kept or (step.turn_back is not None and count == 1):
                soc = max(soc, p.reserve)
                if node == p.destination:
                    self.arrives = True
                    return float(future.queues[node].land_time(down))
                return self._arrival(future, node, down, soc) + self.parameters.stop_s
        return None

    def turned_soc(self, charge: float) -> float:
        """Charge that a flight which is turned has used when it is back, of that with which it began."""
        return self.parameters.turned_share * max(charge - self.problem.reserve, 0.0)

    def _back(self, step: Step, future: Future, off: float) -> float:
        """Arrival in a future after a flight that is turned to where it began."""
        p = self.problem
        off, down = flight_in(future, step.segments[: step.sure or 1], off, self.parameters.hold_slots)
        if p.in_flight:
            return p.depart_s + self.parameters.stuck_s
        if down >= NEVER:
            return self._stuck_s
        spent = self.turned_soc(step.charge)
        back_s = off + spent / (future.energy * p.soc_per_s)
        return self._arrival(future, p.origin, back_s, step.charge - spent) + self.parameters.stop_s

    def _goes_on(self, step: Step, future: Future, off_s: float, soc: float, down_s: float) -> bool:
        """Whether it will fly on over the last station on its way, if that would end at a time with a charge."""
        p = self.problem
        way, rest = step.segments[: step.last], step.segments[step.last :]
        as_off = future.lands_s(way, off_s) - p.air.climb_s - p.air.descent_s
        return soc >= p.reserve + self._margin(rest, as_off) * future.energy * self._taken(down_s - as_off)

    @property
    def _stuck_s(self) -> float:
        """What counts as the arrival in a future without a way on: later than any with one, which end soon after its last change of the wind."""
        return self.problem.depart_s + self.parameters.hours * S_PER_H + self.parameters.stuck_s

    @cached_property
    def new_wind_s(self) -> float:
        """Time of the next wind measurement."""
        return float(slot_end(self.problem.air, slot_of(self.problem.air, self.problem.depart_s)))

    def _charged_s(self, future: Future, charge: float) -> float:
        """When it has a charge at the station where it stands."""
        p = self.problem
        pad = float(future.queues[p.origin].pad_time(p.depart_s))
        return p.charged_at(p.origin, pad, p.charge_time_s(p.origin, p.soc, charge))

    def _stay(self, future: Future) -> float:
        """Arrival if it lands here, or stays where it stands until the next wind."""
        p = self.problem
        if p.in_flight:
            landing = p.air.climb_s + p.air.descent_s
            soc = p.soc - future.energy * self._taken(landing)
            return self._arrival(future, p.origin, p.depart_s + landing, soc)
        until = self.new_wind_s
        if until == NEVER:
            return self._stuck_s
        if future not in self._stays:
            queue = future.queues[p.origin]
            pad = float(queue.pad_time(p.depart_s)) if p.has_pads(p.origin) else math.inf
            soc = p.soc
            if until > pad:
                soc = p.soc_after(p.origin, soc, p.charging_s(p.origin, pad, until))
                queue = no_queue()
            after = p.standing_at(p.origin, until, soc)
            waiting = replace(future, queues=future.queues.with_path(p.origin, queue))
            self._stays[future] = self._best_s(after, waiting)
        return self._stays[future]

    def _arrival(self, future: Future, node: int, time_s: float, soc: float) -> float:
        """Best arrival in a future of a drone that lands at a station."""
        landed = float(future.queues[node].land_time(time_s))
        return self._kept_s(future, node, landed, soc)

    def _kept_s(self, future: Future, node: int, time_s: float, soc: float) -> float:
        """Best arrival from a station, worked out once: steps that charge for long are all weighed by staying."""
        state = future, node, time_s, soc
        if state not in self._arrivals:
            self._arrivals[state] = self._best_s(self.problem.standing_at(node, time_s, soc), future)
        return self._arrivals[state]

    def _best_s(self, after: Problem, future: Future) -> float:
        """Best arrival in a future from a later state."""
        search = self._search(after, future)
        way = None if self._quick else search.find()
        found_s = search.bound_s(self.parameters.near_stations) if self._quick else search.best_s if way else math.inf
        if math.isinf(found_s):
            return self._stuck_s
        self.arrives = True
        if way is None or self._later is None:
            return found_s
        as_found = self._flown_s(after, future, way, None)
        checked = self._flown_s(after, future, way, self._later)
        return min(found_s + max(checked - as_found, 0.0), self._stuck_s) if as_found < math.inf else found_s

    def _flown_s(self, after: Problem, future: Future, way: Itinerary, later: LaterCharges | None) -> float:
        """Arrival of a way on, with the charges found, or what `later` tells where that is more; POSIX seconds, infinite where it is not flown."""
        p, time_s, soc = self.problem, after.depart_s, after.soc
        for leg in way:
            node = int(p.network.tail[leg.segments[0]])
            off = time_s
            if p.has_pads(node):
                charge = max(leg.charge_to or soc, soc)
                if later is not None:
                    step = Step(leg.segments, charge, self.sure_of(leg.segments))
                    charge = max(charge, self._required(step, future, time_s, later.share(step, time_s, soc)))
                if charge > soc + 1e-9:
                    pad = float(future.queues[node].pad_time(time_s))
                    off = p.charged_at(node, pad, p.charge_time_s(node, soc, charge))
                    soc = min(charge, float(p.curve(node)[1][-1]))
            off, down = flight_in(future, leg.segments, max(off, leg.not_before_s), self.parameters.hold_slots)
            if down >= NEVER:
                return math.inf
            soc -= future.energy * self._taken(down - off)
            time_s = float(future.queues[int(p.network.head[leg.segments[-1]])].land_time(down))
        return time_s

    def _required(self, step: Step, future: Future, time_s: float, share: float) -> float:
        """Charge that a leg leaves with, which requires a multiple of what it takes in a future as far as it must be sure of it."""
        sure = step.segments[: step.sure or len(step.segments)]
        off, down = flight_in(future, sure, time_s, self.parameters.hold_slots)
        return min(self.problem.reserve + share * future.energy * self._taken(down - off), 1.0) if down < NEVER else 0.0
