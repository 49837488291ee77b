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

from skyway.models.base.errors import NoRouteError
from skyway.planner.exact.escape import needed_to_land
from skyway.planner.exact.guided_search import GuidedSearch
from skyway.planner.exact.label_search import GAIN_S
from skyway.planner.exact.relaxation import cells_for, guided, longest_cell_s, run_forward
from skyway.planner.exact.stop_labels import landing_s
from skyway.planner.exact.subnetwork import queued, subnetwork
from skyway.planner.lookahead.lookahead import Lookahead
from skyway.planner.schedule.no_route import no_route

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.exact.relaxation import Forward, Guide
    from skyway.planner.exact.subnetwork import Subnetwork
    from skyway.planner.schedule.itinerary import Itinerary


class ExactSearch(GuidedSearch):
    """One search; see `GuidedSearch` for what it is given."""

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

    def _search_near(self, until_s: float, least_s: float) -> None:
        """In a dense network, look for an answer near the straight way, then prove it the best, or better it.

        Until some time first; before `least_s` there is no room.
        """
        near: Subnetwork | None = None
        stations, tries = self.parameters.near_stations, 0
        while self._answer is None and not self._given_up:
            until_s = min(until_s, self._latest_s)
            near = self._near(until_s, stations)
            if near is None and not (self._dense and self._time_limit_s == math.inf):
                return
            if until_s > least_s:
                self._search_until(until_s, near or self._layout(self._extent.usable(until_s), until_s))
                tries += 1
            if until_s >= self._latest_s:
                break
            until_s = self._longer(until_s)
            # Perhaps no way leads over so few. A search for the best answer is done sooner with these: its proof looks everywhere.
            if self._time_limit_s < math.inf and tries >= self.parameters.near_tries:
                stations *= 2
                self._near_bound_s = self.problem.depart_s
        if self._answer is not None and near is not None and self._most_labels == math.inf and self._time_is_left:
            self._prove()

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
            until_s = min(max(self.lower_bound_s, forward.arrive_s) + beyond * forward.cells.step_s, self._better_s)
            needed = needed_to_land(self.problem, self._speeds, self.queues, self._margin, until_s)
            part, guide, _ = guided(whole, self._costs, forward, needed, self._come_by_s(until_s))
            self._refine(queued(part, self.problem, self.queues), guide, needed, until_s)

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
            if hurry and whole.whole and self._is_searched(after):
                continue
            forward = run_forward(whole, costs, start, cells, needed, come_by, after=after)
            if math.isinf(forward.arrive_s):
                break
            self._nothing_before(whole, landing_s(self.problem, self.queues, forward.arrive_s))
            end = forward.cells.over_s + forward.cells.length * forward.cells.step_s + whole.table.descent_s
            landed = landing_s(self.problem, self.queues, end)
            deadline = min(until_s, end if landed <= end else landed + 2.0 * GAIN_S)
            part, guide, forward = guided(whole, costs, forward, needed, self._come_by_s(deadline))
            if not hurry:
                self._refine(part, guide, needed, deadline)
            elif self._hurried(part, guide, forward, needed, deadline, last=deadline >= until_s >= self._latest_s):
                if self._most_labels < math.inf or self._answer is None:
                    return
                if not whole.whole and self._time_limit_s > 0.0:  # however soon it ends, it ends with a bound
                    self._bounded = self._bound()
                if self._time_is_left:
                    self._refine(part, guide, needed, min(deadline, self._better_s), at_once=True)
            if whole.whole:
                self._searched_s = deadline
            if self._answer is not None or deadline >= until_s or self._given_up:
                return
        self._nothing_before(whole, until_s)

    def _is_searched(self, after: float) -> bool:
        """Whether a deadline that is a share after the lower bound was searched in vain, for arrivals until an earlier time."""
        depart_s = self.problem.depart_s
        return depart_s + (1.0 + after) * (self.lower_bound_s - depart_s) <= self._searched_s

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
        most = math.inf if last or (part.whole and self._time_limit_s > 0.0) else self.parameters.first_labels
        one = self._run(part, guide, forward, needed, deadline_s, 0.0, most)
        return one.has_ended and (last or self._answer is not None)
