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
from skyway.planner.exact.extent import Extent
from skyway.planner.exact.gates import last_gate
from skyway.planner.exact.label_search import GAIN_S, Round
from skyway.planner.exact.relaxation import Start, cells_for, longest_cell_s, only_nodes, run_backward, run_forward
from skyway.planner.exact.stop_labels import StopLabels, come_by_s, costs_of, landing_s, longest_s
from skyway.planner.exact.subnetwork import narrowed, queued, subnetwork
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.problem.kernel_inputs import check_shape, check_speeds
from skyway.planner.problem.speeds import GivenSpeeds, TrueSpeeds
from skyway.planner.schedule.no_route import no_route

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.exact.gates import Gate
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
        self._extent = Extent(problem, self._speeds, self._costs)
        self._time_limit_s = time_limit_s
        self._most_labels = most_labels
        self._stop_at = math.inf
        self._cut_off_s = cut_off_s
        self._end_at = math.inf
        self._answer: Itinerary | None = None
        self._bounded: tuple[Subnetwork, Forward] | None = None

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
        self.lower_bound_s = max(self.lower_bound_s, self._extent.straight_s(self._speeds.slots))
        straight = self._extent.straight_s(12)
        until = p.depart_s + self.parameters.first_deadline * (straight - p.depart_s) + 600.0
        least = landing_s(p, self.queues, straight)
        self._search_near(until, least)
        while self._answer is None and not self._given_up:
            until = min(until, self._latest_s)
            if until > least:  # before that there is no room
                self._search_until(until, self._layout(self._extent.usable(until), until))
            if self._answer is None and until >= self._latest_s and not self._given_up:
                return None
            until = self._longer(until)
        self.complete = self.complete and self._answer is not None
        return self._answer

    def bound_s(self, stations: int) -> float:
        """Return a lower bound of the arrival on a coarse grid, in a dense network over so many stations near the straight way; POSIX seconds.

        Infinite where no way is found. A fraction of what `find` takes: for comparisons.
        """
        p, start = self.problem, self._start()
        until = p.depart_s + self.parameters.first_deadline * (self._extent.straight_s(12) - p.depart_s) + 600.0
        while True:
            until = min(until, self._latest_s)
            part = self._near(until, stations) or self._layout(self._extent.usable(until), until)
            needed = needed_to_land(p, self._speeds, self.queues, self._margin, until)
            come_by = self._come_by_s(until)
            step = min(
                max((until - start.time_s) / self.parameters.coarse_cells, 10.0), longest_cell_s(part, self._costs)
            )
            cells = cells_for(part, start, step, come_by)
            forward = run_forward(part, self._costs, start, cells, needed, come_by, after=0.0)
            if math.isfinite(forward.arrive_s):
                return landing_s(p, self.queues, forward.arrive_s)
            if until >= self._latest_s:
                return math.inf
            until = self._longer(until)

    def _longer(self, until_s: float) -> float:
        """Return the next time until which to search."""
        return self.problem.depart_s + 1.6 * (until_s - self.problem.depart_s)

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

    def _layout(self, keep: NDArray[np.bool_], until_s: float, *, with_queues: bool = True) -> Subnetwork:
        """Lay out some nodes, for arrivals by a time."""
        nodes = np.flatnonzero(keep)
        how = self._extent.place_m, nodes, self._extent.slots(until_s)
        laid = subnetwork(self.problem, self.queues, self._speeds, *how, with_queues=with_queues)
        return replace(laid, has_pads=self._stops[nodes])

    def _near(self, until_s: float, most: int) -> Subnetwork | None:
        """Lay out the stations nearest to the straight way; None where all are near, or the network is not dense."""
        p, keep = self.problem, self._extent.usable(until_s)
        if np.diff(p.network.first)[keep].sum() <= self.parameters.dense_segments or np.count_nonzero(keep) <= most:
            return None
        keep[:] = False
        keep[np.argsort(self._extent.way_m, kind="stable")[:most]] = True
        keep[[p.origin, p.destination]] = True
        return replace(self._layout(keep, until_s), whole=False)

    def _start(self) -> Start:
        p = self.problem
        on_pad = p.has_pads(p.origin) and not p.in_flight
        pad = float(self.queues[p.origin].pad_time(p.depart_s)) if on_pad else math.inf
        return Start(p.depart_s, p.soc, pad, p.in_flight)

    def _search_near(self, until_s: float, least_s: float) -> None:
        """In a dense network, look for an answer near the straight way, then prove it the best, or better it.

        Until some time first; before `least_s` there is no room.
        """
        near: Subnetwork | None = None
        while self._answer is None and not self._given_up:
            until_s = min(until_s, self._latest_s)
            near = self._near(until_s, self.parameters.near_stations)
            if near is None and not (self._dense and self._time_limit_s == math.inf):
                return
            if until_s > least_s:
                self._search_until(until_s, near or self._layout(self._extent.usable(until_s), until_s))
            if until_s >= self._latest_s:
                break
            until_s = self._longer(until_s)
        if self._answer is not None and near is not None and self._most_labels == math.inf and self._time_is_left:
            self._prove()

    @property
    def _dense(self) -> bool:
        """Whether the network is dense as a whole."""
        return len(self.problem.network.head) > self.parameters.dense_segments

    @property
    def _time_is_left(self) -> bool:
        return time.perf_counter() < min(self._stop_at, self._end_at)

    def _bound(self) -> tuple[Subnetwork, Forward]:
        """Bound arrivals from below in the whole network, as if pads were always free.

        Once for an answer: what can be had by its arrival.
        """
        until_s, start = self.best_s, self._start()
        whole = self._layout(self._extent.usable(until_s), until_s, with_queues=False)
        needed = needed_to_land(self.problem, self._speeds, self.queues, self._margin, until_s)
        come_by = self._come_by_s(until_s)
        step = max((until_s - start.time_s) / self.parameters.coarse_cells, 10.0)
        cells = cells_for(whole, start, min(step, longest_cell_s(whole, self._costs)), come_by)
        forward = run_forward(whole, self._costs, start, cells, needed, come_by, after=math.inf)
        self._nothing_before(whole, min(landing_s(self.problem, self.queues, forward.arrive_s), until_s))
        return whole, forward

    def _prove(self) -> None:
        """Prove that the answer is the best in the whole network, or better it."""
        if self._bounded is None:
            self._bounded = self._bound()
        whole, forward = self._bounded
        for beyond in self.parameters.proof_cells:
            if self._proved() or not self._time_is_left:
                return
            until_s = min(max(self.lower_bound_s, forward.arrive_s) + beyond * forward.cells.step_s, self.best_s)
            needed = needed_to_land(self.problem, self._speeds, self.queues, self._margin, until_s)
            guide = run_backward(whole, self._costs, forward, needed, self._come_by_s(until_s))
            keep = guide.used.copy()
            keep[[whole.origin, whole.destination]] = True
            part = queued(narrowed(whole, keep), self.problem, self.queues)
            guide, _ = only_nodes(guide, forward, keep)
            self._refine(part, guide, needed, until_s)

    def _proved(self) -> bool:
        """Whether there is an answer, and nothing arrives before it."""
        proved = self._answer is not None and self.lower_bound_s >= self.best_s - GAIN_S
        self.complete = self.complete or proved
        return proved

    def _nothing_before(self, part: Subnetwork, time_s: float) -> None:
        """Take note that no delivery over a part of the network arrives before a time."""
        if part.whole:
            self.lower_bound_s = max(self.lower_bound_s, time_s)

    def _search_until(self, until_s: float, whole: Subnetwork) -> None:
        """Search for arrivals until some time; without one there is none.

        Relaxations tell of coming to the destination, deadlines of landing there, which may have to wait for room.
        """
        costs, start = self._costs, self._start()
        needed = needed_to_land(self.problem, self._speeds, self.queues, self._margin, until_s)
        come_by = self._come_by_s(until_s)
        span = until_s - start.time_s
        step = min(max(span / self.parameters.coarse_cells, 10.0), longest_cell_s(whole, costs))
        cells = cells_for(whole, start, step, come_by)
        hurry = self._time_limit_s < math.inf or (self._most_labels < math.inf and not whole.whole)
        for after in self.parameters.deadlines if whole.whole else self.parameters.near_deadlines:
            forward = run_forward(whole, costs, start, cells, needed, come_by, after=after)
            if math.isinf(forward.arrive_s):
                break
            self._nothing_before(whole, landing_s(self.problem, self.queues, forward.arrive_s))
            end = forward.cells.over_s + forward.cells.length * forward.cells.step_s + whole.table.descent_s
            landed = landing_s(self.problem, self.queues, end)
            deadline = min(until_s, end if landed <= end else landed + 2.0 * GAIN_S)
            guide = run_backward(whole, costs, forward, needed, self._come_by_s(deadline))
            keep = guide.used.copy()
            keep[[whole.origin, whole.destination]] = True
            part = narrowed(whole, keep)
            guide, forward = only_nodes(guide, forward, keep)
            if not hurry:
                self._refine(part, guide, needed, deadline)
            elif self._hurried(part, guide, forward, needed, deadline, last=deadline >= until_s):
                if self._most_labels < math.inf or self._answer is None:
                    return
                if not whole.whole and self._time_limit_s > 0.0:  # however soon it ends, it ends with a bound
                    self._bounded = self._bound()
                if self._time_is_left:
                    self._refine(part, guide, needed, min(deadline, self.best_s), at_once=True)
            if self._answer is not None or deadline >= until_s or self._given_up:
                return
        self._nothing_before(whole, until_s)

    def _hurried(
        self,
        part: Subnetwork,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        deadline_s: float,
        *,
        last: bool,
    ) -> bool:
        """Look for a first answer, near the straight way in a few labels unless the deadline is the last.

        Tells whether there is one, or none.
        """
        most = math.inf if last or part.whole else self.parameters.first_labels
        return self._run(part, guide, forward, needed, deadline_s, 0.0, most) and (last or self._answer is not None)

    def _refine(
        self,
        part: Subnetwork,
        guide: Guide,
        needed: NDArray[np.float64],
        deadline_s: float,
        *,
        at_once: bool = False,
    ) -> None:
        """Search where a guide leaves anything to be found, with finer cells and earlier deadlines first, or `at_once` up to the last.

        They are beyond the lower bound by shares of it, in dense networks by so many cells.
        """
        start, coarse = self._start(), guide.cells
        near = self._bounded is not None or not part.whole
        steps = self.parameters.near_cells if near else self.parameters.refinements
        most = self.parameters.near_states if near else self.parameters.max_states
        span = deadline_s - start.time_s
        fine_s = max(
            min(self.parameters.fine_s, span / self.parameters.min_fine_cells),
            span / min(self.parameters.max_fine_cells, max(most / len(part.nodes), 1.0)),
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
        self._nothing_before(part, least)
        if self._proved():
            return
        if part.whole:
            least = max(least, self.lower_bound_s)
        gate = last_gate(part, forward, least, longest_s(self.problem))
        for beyond in steps[-1:] if at_once else steps:
            until = min(
                least + (beyond * cells.step_s if near else beyond * (least - start.time_s) + 2.0 * cells.step_s),
                deadline_s,
            )
            if gate is not None:
                least = self._bound_after(gate, part, forward, needed, until)
                if self._proved() or (not part.whole and self._answer is not None and self.best_s <= least + GAIN_S):
                    return
            if least < until:
                narrow = run_backward(part, self._costs, forward, needed, self._come_by_s(until))
                if self._run(part, narrow, forward, needed, until, self._stop_at, least_s=least):
                    return
            if until >= deadline_s or self._given_up:
                return
            least = until

    def _bound_after(
        self, gate: Gate, part: Subnetwork, forward: Forward, needed: NDArray[np.float64], until_s: float
    ) -> float:
        """Return a time before which nothing arrives, up to `until_s`: what a search from a gate on finds.

        Where there is a way to the station where its best delivery begins, with all that can be had there, that is the answer.
        """
        guide = run_backward(part, self._costs, gate.forward, needed, self._come_by_s(until_s))
        one = self._round(part, guide, gate.forward, needed, until_s, self._stop_at)
        one.run(gate.roots(one.stop_labels, guide))
        self.labels_expanded += one.labels_expanded
        if not one.complete:
            return self.lower_bound_s
        least = one.stop_labels.best_s
        self._nothing_before(part, least)
        if one.best is None or self._proved():
            return least
        walks = [np.array(leg.segments) for leg in one.stop_labels.trace(*one.best)]
        network, segments = self.problem.network, np.concatenate(walks)
        over = np.searchsorted(part.nodes, np.unique((network.tail[segments], network.head[segments])))
        mask = gate.only_over(over, forward.over.shape)
        guide = run_backward(part, self._costs, forward, needed, self._come_by_s(until_s), within=mask)
        self._run(
            part, guide, forward, needed, until_s, self._stop_at, self.parameters.gate_labels, least, proves=False
        )
        return least

    def _round(
        self,
        part: Subnetwork,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        until_s: float,
        stop_at: float,
        most_labels: float = math.inf,
        least_s: float = -math.inf,
    ) -> Round:
        """Return a search of labels for arrivals until some time, before which nothing arrives until `least_s`."""
        stop_labels = StopLabels(self.problem, self.queues, part, needed, margin_soc_per_s=self._margin)
        stop_labels.best_s = until_s
        return Round(
            stop_labels,
            guide,
            forward,
            needed,
            stop_at,
            answered=self._answer is not None,
            most=min(self._most_labels - self.labels_expanded, most_labels),
            enough=math.inf if part.whole else self.parameters.near_labels,
            least_s=max(self.lower_bound_s, least_s),
            end_at=self._end_at,
        )

    def _run(
        self,
        part: Subnetwork,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        until_s: float,
        stop_at: float,
        most_labels: float = math.inf,
        least_s: float = -math.inf,
        *,
        proves: bool = True,
    ) -> bool:
        """Search labels for arrivals until some time; tells whether that is the end, by an answer, the clock or the count.

        In this part of the network nothing arrives before `least_s`. A guide that leaves out more than it must `proves` nothing.
        """
        used = guide.used.copy()
        used[[part.origin, part.destination]] = True
        if 2 * np.count_nonzero(used) < len(used):
            part = narrowed(part, used)
            guide, forward = only_nodes(guide, forward, used)
        one = self._round(part, guide, forward, needed, until_s, stop_at, most_labels, least_s)
        one.run()
        self.labels_expanded += one.labels_expanded
        if one.best is not None and one.stop_labels.best_s < self.best_s:
            self.best_s = one.stop_labels.best_s
            self._answer = one.stop_labels.trace(*one.best)
        if one.complete and (proves or (one.best is not None and one.stop_labels.best_s <= least_s + GAIN_S)):
            self._nothing_before(part, one.stop_labels.best_s)
        self.complete = self._answer is None or self.lower_bound_s >= self.best_s - GAIN_S
        return one.best is not None or not one.complete
