"""Label setting for one deadline, guided by the lower bounds of a relaxation.

Labels are stops (`planner.exact.stop_labels`): at one station, the charge the drone can leave with as a function of time. One that
another label of the same station dominates (covers: its charge is nowhere higher at any time) is dropped: whatever the drone does
from it, from the other one it can do at the same time with no less charge, and arriving earlier or with more charge is
never worse, for flights and queues are first in, first out and the drone may always stay. One that nowhere has the charge
that the guide asks for is dropped, too: nothing that follows it is on time.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.flight_search import Asked, flights_from
from skyway.planner.exact.relaxation import run_backward
from skyway.planner.exact.relaxation_grid_kernels import slack
from skyway.planner.exact.stop_label_kernels import Offered, stop_labels_after
from skyway.planner.exact.stop_labels import StopLabel, come_by_s, only_at
from skyway.planner.problem.flight_table import table_slot
from skyway.planner.schedule.profile_kernels import covers, upper_profile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.exact.relaxation import Forward, Guide
    from skyway.planner.exact.stop_labels import StopLabels

MOST_BYTES = 50_000_000
"""Arrival functions that are kept for stations that are left again."""
GAIN_S = 1e-6
"""Compositions that are not better by this much are not looked for."""


@dataclass(frozen=True, eq=False)
class Label:
    """A stop label, where it comes from, and what it has to spare in the eyes of a guide; None where none has looked at it."""

    stop_label: StopLabel
    parent: Label | None
    guide: Guide | None
    slack_s: float

    def chain(self) -> list[StopLabel]:
        """Stays from the origin to here."""
        label: Label | None = self
        stop_labels: list[StopLabel] = []
        while label is not None:
            stop_labels.append(label.stop_label)
            label = label.parent
        return stop_labels[::-1]


class Settled:
    """The best charge that settled labels offer to leave each of so many nodes with, at each time."""

    def __init__(self, nodes: int) -> None:
        self._points = np.empty((1024, 2))
        self._size = 0
        self._at = np.zeros((nodes, 2), dtype=np.int64)

    @property
    def offered(self) -> Offered:
        """Charge that settled labels offer to leave each node with, as kernels read it."""
        return Offered(self._points, self._at)

    def add(self, stop_label: StopLabel) -> bool:
        """Add a stop label to what is known of its station; false where that covers it already."""
        node = stop_label.node
        begin, size = self._at[node].tolist()
        envelope = stop_label.g
        if size:
            known = self._points[begin : begin + size]
            if covers(known, envelope, 0.0):
                return False
            envelope = upper_profile(known, envelope)
        end = self._size + len(envelope)
        if end > len(self._points):
            self._points = np.concatenate((self._points[: self._size], np.empty((end, 2))))
        self._points[self._size : end] = envelope
        self._at[node] = self._size, len(envelope)
        self._size = end
        return True


class Round:
    """The search for the best composition that arrives by a deadline, the `best_s` of `stop_labels`.

    `guide` and `forward` are the relaxation's for this deadline; `needed` is that of
    `planner.exact.escape.needed_at_destination`. The search ends after `most` labels, or `enough` with an answer; at the time `end_at` of
    `time.perf_counter`; when it has `made` so many labels; at `stop_at` once there is an answer, or where it is `answered` already; and with an answer
    that arrives at `least_s`, before which nothing arrives. `landed_by` is that of `run_backward`. A first
    answer is looked for `onward`, by nearness to the destination.
    """

    def __init__(
        self,
        stop_labels: StopLabels,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        stop_at: float = math.inf,
        *,
        answered: bool = False,
        most: float = math.inf,
        enough: float = math.inf,
        least_s: float = -math.inf,
        end_at: float = math.inf,
        landed_by: int = -1,
        made: float = math.inf,
        onward: bool = False,
    ) -> None:
        self.stop_labels = stop_labels
        self.guide = guide
        self.forward = forward
        self.needed = needed
        self.stop_at = stop_at
        self.answered = answered
        self.most = most
        self.enough = enough
        self.least_s = least_s
        self.end_at = end_at
        self.landed_by = landed_by
        self.made = made
        self.complete = True
        """Whether the search came to its end."""
        self.labels_expanded = 0
        """Labels continued."""
        self.labels_made = 0
        """Labels that were to be continued."""
        self.best: tuple[list[StopLabel], float] | None = None
        """Stays and last take-off of the best composition found, which arrives at ``stop_labels.best_s``."""
        nodes = len(stop_labels.subnetwork.nodes)
        self._settled = Settled(nodes)
        self._flights: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._heap: list[tuple[float, int, Label]] = []
        self._onward = onward and not answered
        self._flights_bytes = 0

    @property
    def is_hard(self) -> bool:
        """Whether it ended because it `made` so many labels."""
        return not self.complete and self.labels_made >= self.made

    @property
    def has_ended(self) -> bool:
        """Whether it ended before all labels were continued, or with an answer."""
        return self.best is not None or not self.complete

    def run(self, roots: Sequence[StopLabel] | None = None) -> None:
        """Search to the end, from the origin or from other stop labels."""
        for root in (self.stop_labels.origin(),) if roots is None else roots:
            label = self._judged(Label(root, None, None, 0.0))
            if label is not None:
                self._push(label)
        label = self._next()
        while label is not None:
            after = self._expand(label)
            if self._is_best:
                return
            self._in_order()
            most = self.most if self.best is None else min(self.most, self.enough)
            if self.labels_expanded >= most or self.labels_made >= self.made or self._late():
                self.complete = False
                return
            # Until there is an answer the best continuation is followed at once.
            label = after if self.best is None and after is not None else self._next()

    @property
    def _is_best(self) -> bool:
        """Whether an answer was found before which nothing arrives."""
        return self.best is not None and self.stop_labels.best_s <= self.least_s + GAIN_S

    def _in_order(self) -> None:
        """Once there is an answer, or none in so many labels, continue what has the most to spare: a proof is shortest so."""
        most = self.stop_labels.problem.parameters.exact.nearness_labels
        if self._onward and (self.best is not None or self.labels_expanded >= most):
            self._onward = False
            self._heap = [(-self._rank(label), number, label) for _, number, label in self._heap]
            heapq.heapify(self._heap)

    def _late(self) -> bool:
        answered = self.answered or self.best is not None
        return time.perf_counter() > (min(self.stop_at, self.end_at) if answered else self.end_at)

    def _next(self) -> Label | None:
        while self._heap:
            label = self._judged(heapq.heappop(self._heap)[2])
            if label is not None:
                return label
        return None

    def _judged(self, label: Label) -> Label | None:
        """The label as the latest guide sees it; None where it cannot be on time."""
        stop_label, guide = label.stop_label, self.guide
        if label.guide is guide:
            return label
        subnetwork = self.stop_labels.subnetwork
        first, last = guide.window[stop_label.node].tolist()
        spare = float(
            slack(
                stop_label.g,
                stop_label.node,
                guide.cells,
                subnetwork.table.climb_s,
                (first, last),
                guide.leave,
                *stop_label.curve,
            )
        )
        return Label(stop_label, label.parent, guide, spare) if spare >= 0.0 else None

    def _flights_from(self, node: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Arrival functions from a station over all slots in which it is left on time."""
        if node not in self._flights:
            guide, table = self.guide, self.stop_labels.table
            off = guide.cells.over_s - table.climb_s + guide.cells.step_s * (guide.window[node] + np.array([0, 1]))
            last = min(float(off[1]), self.stop_labels.subnetwork.horizon_s)
            slots = int(table_slot(table, float(off[0]))), int(table_slot(table, last))
            costs = self.stop_labels.costs
            leave = np.maximum.accumulate(self.forward.leave[:, node])
            window_s = float(off[0]) - guide.cells.step_s, float(off[1]) + guide.cells.step_s  # rounding is much less
            asked = Asked(guide.cells, leave, guide.need, costs.soc_per_s, costs.soc_fixed, *window_s)
            longest_s = self.stop_labels.longest_s
            if self._flights_bytes > MOST_BYTES:
                self._flights.clear()
                self._flights_bytes = 0
            self._flights[node] = flights_from(table, node, slots, longest_s, guide.used, asked)
            self._flights_bytes += self._flights[node][1].nbytes
        return self._flights[node]

    def _expand(self, label: Label) -> Label | None:
        """Expand a label; returns the best successor that is still to be expanded."""
        stop_label, stop_labels = label.stop_label, self.stop_labels
        if not self._settled.add(stop_label):
            return None
        self.labels_expanded += 1
        subnetwork, guide = stop_labels.subnetwork, self.guide
        offset, pieces = self._flights_from(stop_label.node)
        if stop_labels.leaves_at_once(stop_label):
            offset, pieces = _at_once(offset, pieces, stop_label.begin_s)
        d = subnetwork.destination
        arrive, leave = stop_labels.arrive(stop_label, pieces[offset[d] : offset[d + 1]])
        if arrive < stop_labels.best_s - GAIN_S:
            self._keep(label.chain(), arrive, leave)
            if self._is_best:
                return None
            guide = self.guide
        wanted = subnetwork.has_pads & (guide.window[:, 1] >= guide.window[:, 0])
        wanted[[d, stop_label.node]] = False
        found = stop_labels_after(
            stop_label.g,
            np.flatnonzero(wanted),
            offset,
            pieces,
            subnetwork.grounds,
            stop_labels.costs,
            stop_labels.best_s,
            guide.cells,
            subnetwork.table.climb_s,
            guide.window,
            guide.leave,
            self._settled.offered,
            # Before there is an answer a covered label with the most to spare ends the way that is followed.
            not self.answered and self.best is None,
        )
        best: Label | None = None
        for node, spare, z, h, g in found:
            after = StopLabel(node, z, h, stop_labels.curve(node))
            after.__dict__["g"] = g
            following = Label(after, label, guide, spare)
            if self.best is None and (best is None or self._rank(following) > self._rank(best)):
                best, following = following, best
            if following is not None:
                self._push(following)
        return best

    def _push(self, label: Label) -> None:
        self.labels_made += 1
        heapq.heappush(self._heap, (-self._rank(label), self.labels_made, label))

    def _rank(self, label: Label) -> float:
        """How soon a label is to be continued, s: by what it has to spare and, for a first answer, by how near it is to the destination."""
        if not self._onward:
            return label.slack_s
        nearness = self.stop_labels.problem.parameters.exact.nearness
        return label.slack_s - nearness * float(self.forward.least_s[label.stop_label.node])

    def _keep(self, chain: list[StopLabel], arrive_s: float, leave_s: float) -> None:
        stop_labels = self.stop_labels
        self.best = (chain, leave_s)
        gained = stop_labels.best_s - arrive_s
        stop_labels.best_s = arrive_s
        if gained > self.guide.cells.step_s and not self._is_best and not self._late():
            self.guide = run_backward(
                stop_labels.subnetwork,
                stop_labels.costs,
                self.forward,
                self.needed,
                come_by_s(stop_labels.problem, stop_labels.queues, arrive_s - GAIN_S),
                landed_by=self.landed_by,
            )


def _at_once(
    offset: NDArray[np.int64], pieces: NDArray[np.float64], take_off_s: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Narrow the arrival functions to all nodes to one take-off."""
    found = [only_at(pieces[low:high], take_off_s) for low, high in pairwise(offset.tolist())]
    new = np.zeros(len(offset), dtype=np.int64)
    np.cumsum([len(block) for block in found], out=new[1:])
    return new, np.concatenate(found)
