"""Label setting for one deadline: from stay to stay, guided by what a relaxation says is needed.

Labels are stays (`planner.stays`): at one station, the charge the drone can leave with as a function of time. One that
another label of the same station covers (its charge is nowhere higher at any time) is dropped: whatever the drone does
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

from skyway.planner.flight_functions import flights_from
from skyway.planner.flight_table import table_slot
from skyway.planner.profile_kernels import covers, upper_profile
from skyway.planner.relaxation import run_backward
from skyway.planner.relaxation_kernels import slack
from skyway.planner.stay_kernels import stays_after
from skyway.planner.stays import Stay, come_by_s, only_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.relaxation import Forward, Guide
    from skyway.planner.stays import Stays

GAIN_S = 1e-6
"""Compositions that are not better by this much are not looked for."""


@dataclass(frozen=True, eq=False)
class Label:
    """A stay, where it comes from, and what it has to spare in the eyes of a guide."""

    stay: Stay
    parent: Label | None
    guide: Guide
    slack_s: float

    def chain(self) -> list[Stay]:
        """Stays from the origin to here."""
        label: Label | None = self
        stays: list[Stay] = []
        while label is not None:
            stays.append(label.stay)
            label = label.parent
        return stays[::-1]


@dataclass(frozen=True, eq=False)
class _Envelope:
    """The best of all settled stays of a station, at each time."""

    z: NDArray[np.float64]
    h: NDArray[np.float64]
    g: NDArray[np.float64]

    def covers_parts(self, stay: Stay) -> bool:
        """Tell whether neither the potential nor the landed charge of a stay is anywhere higher."""
        if len(stay.z) and (not len(self.z) or not covers(self.z[:, :2], stay.z[:, :2], 0.0)):
            return False
        return bool(covers(self.h[:, :2], stay.h[:, :2], 0.0))


def _upper(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper envelope of two profiles either of which may be empty."""
    if not len(a) or not len(b):
        return b if len(b) else a
    return upper_profile(a, b)


class Round:
    """The search for the best composition that arrives by a deadline.

    Parameters
    ----------
    stays : Stays
        Its `best_s` is the deadline.
    guide, forward
        Of the relaxation, for this deadline.
    needed : ndarray
        See `planner.escape.needed_at_destination`.
    stop_at : float
        Of `time.perf_counter`: with an answer, the search ends then.
    answered : bool
        There is an answer already.
    most : float
        Labels after which it ends all the same.
    least_s : float
        Nothing arrives earlier: what arrives then is the best.
    end_at : float
        Of `time.perf_counter`: the search ends then, with or without an answer.

    Attributes
    ----------
    best : (list of Stay, float) or None
        Stays and last take-off of the best composition found, which arrives at ``stays.best_s``.
    looked_at : int
        Labels continued.
    complete : bool
        Whether the search came to its end.
    """

    def __init__(
        self,
        stays: Stays,
        guide: Guide,
        forward: Forward,
        needed: NDArray[np.float64],
        stop_at: float = math.inf,
        *,
        answered: bool = False,
        most: float = math.inf,
        least_s: float = -math.inf,
        end_at: float = math.inf,
    ) -> None:
        self.stays = stays
        self.guide = guide
        self.forward = forward
        self.needed = needed
        self.stop_at = stop_at
        self.answered = answered
        self.most = most
        self.least_s = least_s
        self.end_at = end_at
        self.complete = True
        self.looked_at = 0
        self.best: tuple[list[Stay], float] | None = None
        self._settled: dict[int, _Envelope] = {}
        self._flights: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._heap: list[tuple[float, int, Label]] = []
        self._count = 0

    def run(self) -> None:
        """Search to the end."""
        origin = self.stays.origin()
        label: Label | None = self._judged(Label(origin, None, self.guide, 0.0))
        while label is not None:
            after = self._expand(label)
            if self.best is not None and self.stays.best_s <= self.least_s + GAIN_S:
                return
            if self.looked_at >= self.most or self._late():
                self.complete = False
                return
            # Until there is an answer the best continuation is followed at once.
            label = after if self.best is None and after is not None else self._next()

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
        stay, guide = label.stay, self.guide
        terrain = self.stays.terrain
        first, last = guide.window[stay.node].tolist()
        spare = float(
            slack(stay.g, stay.node, guide.cells, terrain.table.climb_s, (first, last), guide.leave, *stay.curve)
        )
        return Label(stay, label.parent, guide, spare) if spare >= 0.0 else None

    def _settle(self, stay: Stay) -> bool:
        """Add a stay to what is known of its station; false where that covers it already."""
        known = self._settled.get(stay.node)
        if known is None:
            self._settled[stay.node] = _Envelope(stay.z, stay.h, stay.g)
            return True
        # Potential and landed charge are cheap to compare and settle most; the charge to leave with decides.
        if known.covers_parts(stay) or covers(known.g, stay.g, 0.0):
            return False
        self._settled[stay.node] = _Envelope(
            _upper(known.z, stay.z), upper_profile(known.h, stay.h), upper_profile(known.g, stay.g)
        )
        return True

    def _flights_from(self, node: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Arrival functions from a station over all slots in which it is left on time."""
        if node not in self._flights:
            guide, table = self.guide, self.stays.table
            off = guide.cells.over_s - table.climb_s + guide.cells.step_s * (guide.window[node] + np.array([0, 1]))
            last = min(float(off[1]), self.stays.terrain.horizon_s)
            slots = int(table_slot(table, float(off[0]))), int(table_slot(table, last))
            useful = guide.used
            self._flights[node] = flights_from(table, node, slots, self.stays.longest_s, useful)
        return self._flights[node]

    def _expand(self, label: Label) -> Label | None:
        """Continue a label; returns the best of what follows, still to be looked at."""
        stay, stays = label.stay, self.stays
        if not self._settle(stay):
            return None
        self.looked_at += 1
        terrain, guide = stays.terrain, self.guide
        offset, pieces = self._flights_from(stay.node)
        if stays.leaves_at_once(stay):
            offset, pieces = _at_once(offset, pieces, stay.begin_s)
        d = terrain.destination
        arrive, leave = stays.arrive(stay, pieces[offset[d] : offset[d + 1]])
        if arrive < stays.best_s - GAIN_S:
            self._keep(label.chain(), arrive, leave)
            guide = self.guide
        wanted = terrain.has_pads & (guide.window[:, 1] >= guide.window[:, 0])
        wanted[[d, stay.node]] = False
        found = stays_after(
            stay.g,
            np.flatnonzero(wanted),
            offset,
            pieces,
            terrain.grounds,
            stays.costs,
            stays.best_s,
            guide.cells,
            terrain.table.climb_s,
            guide.window,
            guide.leave,
        )
        best: Label | None = None
        for node, spare, z, h, g in found:
            after = Stay(node, z, h, stays.curve(node))
            after.__dict__["g"] = g
            following = Label(after, label, guide, spare)
            if self.best is None and (best is None or spare > best.slack_s):
                best, following = following, best
            if following is not None:
                self._count += 1
                heapq.heappush(self._heap, (-following.slack_s, self._count, following))
        return best

    def _keep(self, chain: list[Stay], arrive_s: float, leave_s: float) -> None:
        stays = self.stays
        self.best = (chain, leave_s)
        gained = stays.best_s - arrive_s
        stays.best_s = arrive_s
        if gained > self.guide.cells.step_s:
            self.guide = run_backward(
                stays.terrain,
                stays.costs,
                self.forward,
                self.needed,
                come_by_s(stays.problem, stays.queues, arrive_s),
            )


def _at_once(
    offset: NDArray[np.int64], pieces: NDArray[np.float64], take_off_s: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Narrow the arrival functions to all nodes to one take-off."""
    found = [only_at(pieces[low:high], take_off_s) for low, high in pairwise(offset.tolist())]
    new = np.zeros(len(offset), dtype=np.int64)
    np.cumsum([len(block) for block in found], out=new[1:])
    return new, np.concatenate(found)
