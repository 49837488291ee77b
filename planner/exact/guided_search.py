"""Label setting within one part of a network, guided by a relaxation, up to deadlines that move: what all stages of the exact search share."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.planner.exact.gates import last_gates
from skyway.planner.exact.label_search import GAIN_S, Round
from skyway.planner.exact.relaxation import Start, guided, run_forward
from skyway.planner.exact.stop_labels import StopLabels, come_by_s, costs_of, landing_s, longest_s
from skyway.planner.exact.subnetwork import Extent
from skyway.planner.problem.kernel_inputs import check_shape, check_speeds
from skyway.planner.problem.speeds import GivenSpeeds, TrueSpeeds

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


_LEAST_CELL_S = 2.0
"""No cells are shorter."""


class GuidedSearch:
    """What is known of one delivery so far: the best composition, and a time before which nothing arrives.

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
        self._near_bound_s = problem.depart_s  # nothing arrives earlier over the stations near the straight way
        self._searched_s = -math.inf  # the last deadline up to which a first answer was looked for in the whole network
        self._answer: Itinerary | None = None
        self._bounded: tuple[Subnetwork, Forward] | None = None

    @property
    def gap(self) -> float:
        """How much longer the best composition found takes than the lower bound, as a share of the latter."""
        least = self.lower_bound_s - self.problem.depart_s
        return max(self.best_s - self.lower_bound_s, 0.0) / least if least > 0.0 else math.inf

    @property
    def _better_s(self) -> float:
        """When a delivery must have landed to be better than the best that was found, POSIX seconds.

        That is less than the arrival of the latter: at a busy destination all that come within minutes land at the same time.
        """
        return self.best_s - GAIN_S

    @property
    def _dense(self) -> bool:
        """Whether the network is dense as a whole."""
        return len(self.problem.network.head) > self.parameters.dense_segments

    @property
    def _given_up(self) -> bool:
        return self.labels_expanded >= self._most_labels or time.perf_counter() >= self._end_at

    @property
    def _time_is_left(self) -> bool:
        return time.perf_counter() < min(self._stop_at, self._end_at)

    def _come_by_s(self, land_by_s: float) -> float:
        return come_by_s(self.problem, self.queues, land_by_s)

    def _start(self) -> Start:
        p = self.problem
        on_pad = p.has_pads(p.origin) and not p.in_flight
        pad = float(self.queues[p.origin].pad_time(p.depart_s)) if on_pad else math.inf
        return Start(p.depart_s, p.soc, pad, p.in_flight)

    def _proved(self) -> bool:
        """Whether there is an answer, and nothing arrives before it."""
        proved = self._answer is not None and self.lower_bound_s >= self.best_s - GAIN_S
        self.complete = self.complete or proved
        return proved

    def _known_s(self, part: Subnetwork) -> float:
        """Return the latest time before which no delivery over a part of the network is known to arrive."""
        return self.lower_bound_s if part.whole else self._near_bound_s

    def _nothing_before(self, part: Subnetwork, time_s: float) -> None:
        """Take note that no delivery over a part of the network arrives before a time."""
        if part.whole:
            self.lower_bound_s = max(self.lower_bound_s, time_s)
        else:
            self._near_bound_s = max(self._near_bound_s, time_s)

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
        span = deadline_s - self._start().time_s
        fine_s = max(
            min(self.parameters.fine_s, span / self.parameters.min_fine_cells),
            span / min(self.parameters.max_fine_cells, max(self._most_states(part) / len(part.nodes), 1.0)),
            _LEAST_CELL_S,
        )
        self._search_finer(part, guide, needed, deadline_s, max(int(guide.cells.step_s / fine_s), 1), at_once=at_once)

    def _in_cells(self, part: Subnetwork) -> bool:
        """Whether deadlines in a part of the network are so many cells beyond the lower bound."""
        return self._bounded is not None or not part.whole

    def _most_states(self, part: Subnetwork) -> int:
        return self.parameters.near_states if self._in_cells(part) else self.parameters.max_states

    def _search_finer(
        self,
        part: Subnetwork,
        guide: Guide,
        needed: NDArray[np.float64],
        deadline_s: float,
        ratio: int,
        *,
        at_once: bool = False,
    ) -> None:
        """Search up to a deadline where a guide for it leaves anything to be found, with so many cells in each of its cells.

        In dense networks a search that makes many labels is given up, and done again with still finer cells: the bounds of a grid are loose by
        so many of its cells, and what is on time by these has to be searched.
        """
        start, coarse = self._start(), guide.cells
        cells = coarse._replace(step_s=coarse.step_s / ratio, length=coarse.length * ratio)
        mask = guide.over
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
        least = max(least, self._known_s(part))
        near, states = self._in_cells(part), len(part.nodes) * cells.length
        gated = near or (self._dense and self._most_labels == math.inf)
        gates = last_gates(part, forward, least, longest_s(self.problem), in_flight=start.at_once) if gated else []
        finest = not gated or states > self._most_states(part) or cells.step_s < 2.0 * _LEAST_CELL_S
        made = math.inf if finest else self.parameters.many_labels
        steps = self.parameters.near_cells if near else self.parameters.refinements
        for beyond in steps[-1:] if at_once else steps:
            until = min(
                least + (beyond * cells.step_s if near else beyond * (least - start.time_s) + 2.0 * cells.step_s),
                deadline_s,
            )
            least, hard = self._bound_by(gates, part, forward, needed, (least, until), made)
            if self._proved() or (not part.whole and self._answer is not None and self.best_s <= least + GAIN_S):
                return
            if least < min(until, self._better_s):
                until = min(until, self._better_s)
                narrow = guided(part, self._costs, forward, needed, self._come_by_s(until))
                if not hard:
                    one = self._run(*narrow, needed, until, self._stop_at, least_s=least, made=made)
                    hard = one.is_hard
                    if one.has_ended and not hard:
                        return
                    made -= one.labels_made
                if hard and self._ends_finer(narrow[0], narrow[1], needed, until):
                    return
            if until >= min(deadline_s, self._better_s) or self._given_up:
                return
            least = until

    def _ends_finer(self, part: Subnetwork, guide: Guide, needed: NDArray[np.float64], until_s: float) -> bool:
        """Search up to a deadline with still finer cells, where there is time; tells whether that is the end, by an answer or the clock."""
        if self._given_up or (self._answer is not None and not self._time_is_left):
            return True
        most = self._most_states(part) // (len(part.nodes) * guide.cells.length)
        ratio = min(max(most, 2), self.parameters.finer)
        self._search_finer(part, guide, needed, min(until_s, self._better_s), ratio)
        return self._answer is not None and (self.best_s <= until_s or not self._time_is_left)

    def _bound_by(
        self,
        gates: list[Gate],
        part: Subnetwork,
        forward: Forward,
        needed: NDArray[np.float64],
        between_s: tuple[float, float],
        made: float,
    ) -> tuple[float, bool]:
        """Return the latest time before which nothing arrives, of two: what searches from gates on find; and whether one made too many labels.

        A gate that bounds no further is removed. `forward` is what can be had from the origin on.
        """
        least, until = between_s
        for gate in tuple(gates):
            found, one = self._bound_after(gate, part, forward, needed, until, made)
            if one.is_hard:
                return least, True
            least = max(least, found)
            if self._proved() or least >= min(until, self._better_s):
                break
            gates.remove(gate)
        return least, False

    def _bound_after(
        self,
        gate: Gate,
        part: Subnetwork,
        forward: Forward,
        needed: NDArray[np.float64],
        until_s: float,
        made: float,
    ) -> tuple[float, Round]:
        """Return a time before which nothing arrives, up to `until_s`, and the search from a gate on that finds it.

        Where there is a way to the station where its best delivery begins, with all that can be had there, that is the answer. The search ends
        when it has `made` so many labels. `forward` is what can be had from the origin on.
        """
        come_by = self._come_by_s(until_s)
        small, guide, after = guided(part, self._costs, gate.forward, needed, come_by, landed_by=gate.landed_by)
        most = math.inf
        if not gate.shut:
            most = self.parameters.gate_labels if part.whole else self.parameters.near_labels
        one = self._round(
            small, guide, after, needed, until_s, self._stop_at, most, landed_by=gate.landed_by, made=made
        )
        one.run(replace(gate, forward=after).roots(one.stop_labels, guide))
        self.labels_expanded += one.labels_expanded
        if not one.complete:
            return self.lower_bound_s, one
        least = one.stop_labels.best_s
        known = self._known_s(part)
        self._nothing_before(part, least)
        if one.best is None or self._proved() or least <= known:
            return least, one
        walks = [np.array(leg.segments) for leg in one.stop_labels.trace(*one.best)]
        network, segments = self.problem.network, np.concatenate(walks)
        over = np.isin(part.nodes, (network.tail[segments], network.head[segments]))
        mask = gate.only_over(over, forward.over.shape)
        until_s = min(until_s, least + self.parameters.gate_late_s)
        narrow = guided(part, self._costs, forward, needed, self._come_by_s(until_s), within=mask)
        self._run(*narrow, needed, until_s, self._stop_at, self.parameters.gate_labels, least, proves=False)
        return least, one

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
        landed_by: int = -1,
        made: float = math.inf,
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
            landed_by=landed_by,
            made=made,
            onward=self._dense,
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
        made: float = math.inf,
        proves: bool = True,
    ) -> Round:
        """Search labels for arrivals until some time, and return the search.

        In this part of the network nothing arrives before `least_s`. A guide that leaves out more than it must `proves` nothing.
        """
        one = self._round(part, guide, forward, needed, until_s, stop_at, most_labels, least_s, made=made)
        one.run()
        self.labels_expanded += one.labels_expanded
        if one.best is not None and one.stop_labels.best_s < self.best_s:
            self.best_s = one.stop_labels.best_s
            self.lower_bound_s = min(self.lower_bound_s, self.best_s)  # above it by rounding alone
            self._answer = one.stop_labels.trace(*one.best)
        if one.complete and (proves or (one.best is not None and one.stop_labels.best_s <= least_s + GAIN_S)):
            self._nothing_before(part, one.stop_labels.best_s)
        self.complete = self._answer is None or self.lower_bound_s >= self.best_s - GAIN_S
        return one
