"""Exact composition for one known wind and queue: label setting on charge profiles, guided by a relaxation.

Labels are stops (`planner.exact.stop_labels`): at one station, the charge the drone can leave with as a function of time. One that
another label of the same station covers (its charge is nowhere higher at any time) is dropped: whatever the drone does
from it, from the other one it can do at the same time with no less charge, and arriving earlier or with more charge is
never worse, for flights and queues are first in, first out and the drone may always stay.

The relaxation (`planner.exact.relaxation`) gives a lower bound of the arrival and, for a deadline, the least charge with which
each station must be left in each cell of time. A label that nowhere has it is dropped. Deadlines begin just above the
lower bound: a search that ends with a composition has proved it the best, one that ends without has proved that no
arrival is earlier, and the next deadline is later. Literature: Baum et al. 2019 (charging function propagation), Froger
et al. 2019, and for bounds on a grid of states, dynamic programming with state-space relaxation (Christofides et al. 1981).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError, NoRouteError
from skyway.planner.exact.escape import needed_to_land
from skyway.planner.exact.label_search import GAIN_S, Round
from skyway.planner.exact.relaxation import Start, cells_for, longest_cell_s, only_nodes, run_backward, run_forward
from skyway.planner.exact.stop_labels import StopLabels, come_by_s, costs_of, landing_s
from skyway.planner.exact.subnetwork import narrowed, places, subnetwork
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.problem.kernel_inputs import check_shape, check_speeds
from skyway.planner.problem.speeds import GivenSpeeds, TrueSpeeds
from skyway.planner.schedule.no_route import no_route

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.models.queues.sampling import QueuePath
    from skyway.planner.exact.relaxation import Forward, Guide
    from skyway.planner.exact.subnetwork import Subnetwork
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.speeds import Speeds
    from skyway.planner.schedule.itinerary import Itinerary


class ExactSearch:
    """One search.

    Parameters
    ----------
    problem : Problem
        Flights are in the wind of the first member of its ensemble, the truth.
    queues : mapping of int to QueuePath
        The true queue at each station with pads.
    speeds : Speeds or ndarray, shape (slots, segments), optional
        Ground speeds to fly with instead, m/s, 0 where a segment is closed.
    margin_soc_per_s : float
        A landing after T seconds in the air keeps the reserve and this much times T; so does the flight on from a
        destination without pads.
    stops : ndarray of bool, shape (nodes,), optional
        Where the drone may land on its way; all stations with pads by default.
    most_labels : float
        After so many labels it ends with the best answer so far; where that is none, `find` says nothing of whether there is a way.
    time_limit_s : float
        As soon as there is an answer after this time, it is given, with `lower_bound_s`; `complete` is False then unless
        it is proved the best.
    cut_off_s : float
        It ends after this time all the same, without an answer where there is none yet; `complete` is False then.
    """

    def __init__(
        self,
        problem: Problem,
        queues: Mapping[int, QueuePath],
        *,
        speeds: Speeds | NDArray[np.float64] | None = None,
        margin_soc_per_s: float = 0.0,
        stops: NDArray[np.bool_] | None = None,
        time_limit_s: float = math.inf,
        most_labels: float = math.inf,
        cut_off_s: float = math.inf,
    ) -> None:
        self.problem, self.parameters = problem, problem.parameters.exact
        self.queues = queues
        self.labels_expanded = 0
        """Labels continued so far."""
        self.complete = True
        """Whether the search ended with a proof: that the answer is the best, or that there is none."""
        self.best_s = math.inf
        """Arrival of the best composition found, POSIX seconds."""
        self.lower_bound_s = problem.depart_s
        """No composition arrives earlier, POSIX seconds."""
        self._speeds: Speeds
        if speeds is None:
            self._speeds = TrueSpeeds(problem.air)
        else:
            if isinstance(speeds, np.ndarray):
                check_speeds(speeds, len(problem.network.head))
            self._speeds = GivenSpeeds(speeds) if isinstance(speeds, np.ndarray) else speeds
        if not 0.0 <= margin_soc_per_s < math.inf:
            raise InputError(Fault("must be finite and 0 or more", field="margin_soc_per_s", value=margin_soc_per_s))
        self._margin = margin_soc_per_s
        self._stops = problem.network.pads > 0
        if stops is not None:
            check_shape("stops", stops, (len(problem.network),))
            self._stops &= stops
        self._costs = costs_of(problem, margin_soc_per_s)
        self._time_limit_s = time_limit_s
        self._most_labels = most_labels
        self._stop_at = math.inf
        self._cut_off_s = cut_off_s
        self._end_at = math.inf
        self._answer: Itinerary | None = None

    @property
    def gap(self) -> float:
        """How much longer the best composition found takes than the lower bound, as a share of the latter."""
        least = self.lower_bound_s - self.problem.depart_s
        return max(self.best_s - self.lower_bound_s, 0.0) / least if least > 0.0 else math.inf

    def solve(self) -> Itinerary:
        """Search; a `NoRouteError` says that there is none or, with `complete` False, that none was found in time."""
        found = self.find()
        if found is None and not self.complete:
            message = f"no route was found in {self._cut_off_s:g} s: there may be one: raise --time-limit, or try planner robust"
            raise NoRouteError(message, constraint="time-limit")
        if found is None:
            room = landing_s(self.problem, self.queues, self.problem.depart_s) < self._latest_s
            raise no_route(self.problem, Lookahead(self.problem), room=room)
        return found

    def find(self) -> Itinerary | None:
        """Search without a word on why there is no route: that takes longer than some searches."""
        p = self.problem
        started = time.perf_counter()
        self._stop_at, self._end_at = started + self._time_limit_s, started + self._cut_off_s
        self._place_m = places(p.network)
        straight = self._straight_s()
        until = p.depart_s + self.parameters.first_deadline * (straight - p.depart_s) + 600.0
        least = landing_s(p, self.queues, straight)
        while self._answer is None:
            until = min(until, self._latest_s)
            if until > least:  # before that there is no room
                self._search_until(until)
            if self._answer is None and self._given_up:
                self.complete = False
                return None
            if self._answer is None and until >= self._latest_s:
                return None
            until = p.depart_s + 1.6 * (until - p.depart_s)
        return self._answer

    @property
    def _given_up(self) -> bool:
        return self.labels_expanded >= self._most_labels or time.perf_counter() >= self._end_at

    def _come_by_s(self, land_by_s: float) -> float:
        return come_by_s(self.problem, self.queues, land_by_s)

    @property
    def _latest_s(self) -> float:
        """No flight that takes off within the horizon lands after this."""
        p = self.problem
        longest = (max(1.0, p.soc) - p.reserve - p.soc_fixed) / p.soc_per_s
        return p.air.start_s + self._speeds.slots * p.air.slot_s + longest

    def _straight_s(self) -> float:
        """Arrival that nothing beats: straight at the greatest speed, charged as fast as can be."""
        p, costs = self.problem, self._costs
        way = float(np.linalg.norm(self._place_m[p.origin] - self._place_m[p.destination])) * 0.995
        flight = way / self._speeds.fastest_mps(0, min(12, self._speeds.slots) - 1) + costs.landing_s
        charge = flight * costs.soc_per_s + min(costs.soc_fixed, 0.0)
        charged = (costs.reserve + charge - p.soc) / costs.rate_per_s
        return p.depart_s + flight + max(charged, 0.0)

    def _layout(self, until_s: float) -> Subnetwork:
        """Lay out all nodes that can lie on a route that arrives by a time."""
        p, air, costs = self.problem, self.problem.air, self._costs
        first, last = (
            min(max(int((t + 1e-6 - air.start_s) // air.slot_s), 0), self._speeds.slots - 1)
            for t in (p.depart_s, until_s)
        )
        last = min(last + 1, self._speeds.slots - 1)
        place = self._place_m
        way = sum(np.sqrt(((place - place[end]) ** 2).sum(axis=1)) for end in (p.origin, p.destination))
        flight = way * 0.995 / self._speeds.fastest_mps(first, last) + costs.landing_s
        span = until_s - p.depart_s
        charged = (costs.reserve + flight * costs.soc_per_s + min(costs.soc_fixed, 0.0) - p.soc) / costs.rate_per_s
        keep = (flight <= span) & (flight + charged <= span)
        keep[[p.origin, p.destination]] = True
        laid = subnetwork(p, self.queues, self._speeds, place, np.flatnonzero(keep), (first, last))
        return replace(laid, has_pads=self._stops[laid.nodes])

    def _start(self) -> Start:
        p = self.problem
        on_pad = p.has_pads(p.origin) and not p.in_flight
        pad = float(self.queues[p.origin].pad_time(p.depart_s)) if on_pad else math.inf
        return Start(p.depart_s, p.soc, pad, p.in_flight)

    def _search_until(self, until_s: float) -> None:
        """Search for arrivals until some time; without one there is none.

        Relaxations tell of coming to the destination, deadlines of landing there, which may have to wait for room.
        """
        whole, costs, start = self._layout(until_s), self._costs, self._start()
        needed = needed_to_land(self.problem, self._speeds, self.queues, self._margin, until_s)
        come_by = self._come_by_s(until_s)
        span = until_s - start.time_s
        step = min(max(span / self.parameters.coarse_cells, 10.0), longest_cell_s(whole, costs))
        cells = cells_for(whole, start, step, come_by)
        for after in self.parameters.deadlines:
            forward = run_forward(whole, costs, start, cells, needed, come_by, after=after)
            if math.isinf(forward.arrive_s):
                break
            self.lower_bound_s = max(self.lower_bound_s, landing_s(self.problem, self.queues, forward.arrive_s))
            end = forward.cells.over_s + forward.cells.length * forward.cells.step_s + whole.table.descent_s
            landed = landing_s(self.problem, self.queues, end)
            deadline = min(until_s, end if landed <= end else landed + 2.0 * GAIN_S)
            guide = run_backward(whole, costs, forward, needed, self._come_by_s(deadline))
            keep = guide.used.copy()
            keep[[whole.origin, whole.destination]] = True
            part = narrowed(whole, keep)
            guide, forward = only_nodes(guide, forward, keep)
            if math.isinf(self._time_limit_s):
                self._refine(part, guide, needed, deadline)
            elif self._run(part, guide, forward, needed, deadline, 0.0) and time.perf_counter() < self._stop_at:
                self._refine(part, guide, needed, min(deadline, self.best_s))
            if self._answer is not None or deadline >= until_s or self._given_up:
                return
        self.lower_bound_s = max(self.lower_bound_s, until_s)

    def _refine(self, part: Subnetwork, guide: Guide, needed: NDArray[np.float64], deadline_s: float) -> None:
        """Search where a guide leaves anything to be found, with finer cells and earlier deadlines first."""
        start, coarse = self._start(), guide.cells
        span = deadline_s - start.time_s
        fine_s = max(
            min(self.parameters.fine_s, span / self.parameters.min_fine_cells),
            span / min(self.parameters.max_fine_cells, max(self.parameters.max_states / len(part.nodes), 1.0)),
            2.0,
        )
        ratio = max(int(coarse.step_s / fine_s), 1)
        cells = coarse._replace(step_s=coarse.step_s / ratio, length=coarse.length * ratio)
        mask = guide.over.copy()
        mask[0, part.origin] = True
        forward = run_forward(
            part,
            self._costs,
            start,
            cells,
            needed,
            self._come_by_s(deadline_s),
            after=math.inf,
            allowed=(mask, ratio),
        )
        least = min(landing_s(self.problem, self.queues, forward.arrive_s), deadline_s)
        self.lower_bound_s = max(self.lower_bound_s, least)
        for share in (
            self.parameters.refinements if math.isinf(self._time_limit_s) else self.parameters.refinements[-1:]
        ):
            until = min(least + share * (least - start.time_s) + 2.0 * cells.step_s, deadline_s)
            narrow = run_backward(part, self._costs, forward, needed, self._come_by_s(until))
            if self._run(part, narrow, forward, needed, until, self._stop_at) or until >= deadline_s:
                return

    def _run(
        self,
        part: Subnetwork,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        until_s: float,
        stop_at: float,
    ) -> bool:
        """Search labels for arrivals until some time; tells whether that is the end, by an answer, the clock or the count."""
        stop_labels = StopLabels(self.problem, self.queues, part, needed, margin_soc_per_s=self._margin)
        stop_labels.best_s = until_s
        one = Round(
            stop_labels,
            guide,
            forward,
            needed,
            stop_at,
            answered=self._answer is not None,
            most=self._most_labels - self.labels_expanded,
            least_s=self.lower_bound_s,
            end_at=self._end_at,
        )
        one.run()
        self.labels_expanded += one.labels_expanded
        if one.best is not None:
            self.best_s = stop_labels.best_s
            self._answer = stop_labels.trace(*one.best)
        if one.complete:
            self.lower_bound_s = max(self.lower_bound_s, stop_labels.best_s)
        self.complete = self._answer is None or self.lower_bound_s >= self.best_s - GAIN_S
        return one.best is not None or not one.complete
