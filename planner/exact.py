"""Exact composition for one wind and one queue: label setting on whole charge profiles.

Labels are stays (`planner.stays`): at one station, the charge the drone can leave with as a function of time. Labels
are continued in the order of their bounds, as in A*; one that another label of the same station covers (its charge is
nowhere higher at any time) is dropped: whatever the drone does from it, from the other one it can do at the same time
with no less charge, and arriving earlier or with more charge is never worse, for flights and queues are first in,
first out and the drone may always stay. The search ends when no bound is below the best arrival found. Without an
answer by then there is none. Literature: Baum et al. 2019 (charging function propagation), Froger et al. 2019.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.errors import NoRouteError
from planner.no_route import no_route
from planner.outlook import Outlook
from planner.pfs import ForwardSearch
from planner.profile_kernels import covers, upper_profile
from planner.stays import Stay, Stays

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.queue_paths import QueuePath
    from planner.itinerary import Itinerary
    from planner.problem import Problem

GAIN_S = 1e-6
"""Compositions that are not better by this much are not looked for."""
FIRST_HORIZON = 2.0
"""Without a first answer, arrivals up to this multiple of the least delivery time are looked for first."""


@dataclass(frozen=True, eq=False)
class _Label:
    stay: Stay
    parent: _Label | None

    def chain(self) -> list[Stay]:
        """Stays from the origin to here."""
        label: _Label | None = self
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


class ExactSearch:
    """One search.

    Parameters
    ----------
    problem : Problem
        Flights are in the wind of the first member of its ensemble, the truth.
    queues : mapping of int to QueuePath
        The true queue at each station with pads.
    speeds, margin_soc_per_s
        See `Stays`.
    stops : ndarray of bool, shape (nodes,), optional
        Stations that may be landed at on the way; all with pads by default.

    Attributes
    ----------
    looked_at : int
        Labels continued so far.
    complete : bool
        Always true: the search ends with a proof.
    """

    def __init__(
        self,
        problem: Problem,
        queues: dict[int, QueuePath],
        *,
        speeds: NDArray[np.float64] | None = None,
        margin_soc_per_s: float = 0.0,
        stops: NDArray[np.bool_] | None = None,
    ) -> None:
        self.problem = problem
        self._stops = problem.network.pads > 0
        if stops is not None:
            self._stops &= stops
        self.looked_at = 0
        self.complete = True
        self._stays = Stays(problem, queues, speeds=speeds, margin_soc_per_s=margin_soc_per_s)
        self._best: tuple[list[Stay], float] | None = None
        self._settled: dict[int, _Envelope] = {}

    @property
    def best_s(self) -> float:
        """Arrival of the best composition found, POSIX seconds."""
        return self._stays.best_s

    def solve(self) -> Itinerary:
        """Search.

        Raises
        ------
        NoRouteError
            There is none.
        """
        origin = self._stays.origin()
        least = self._stays.bound_s(origin) - self.problem.depart_s
        if math.isfinite(least):
            self._first_answer(origin)
            self._widening_search(origin, least)
        if self._best is None:
            raise no_route(self.problem, Outlook(self.problem))
        return self._stays.trace(*self._best)

    def _first_answer(self, origin: Stay) -> None:
        """Charge optimally along the route that the forward search takes: a first bound."""
        p = self.problem
        try:
            itinerary = ForwardSearch(p.with_free_pads(), charge_aware=True).solve()
        except NoRouteError:
            return
        stay, chain = origin, [origin]
        for hop in itinerary:
            node = int(p.network.head[hop.segments[-1]])
            useful = np.zeros(len(p.network), dtype=np.bool_)
            useful[[int(p.network.head[segment]) for segment in hop.segments]] = True
            horizon = stay.begin_s + 4.0 * p.drone.recharge_full_s
            pieces_of = self._stays.pieces_from(stay, useful, until_s=horizon)
            if node == p.destination:
                self._keep(chain, *self._stays.arrive(stay, pieces_of(node)))
                return
            if not self._stops[node]:
                return
            landed = self._stays.land(stay, np.array([node]), pieces_of)
            if not landed:
                return
            stay = landed[0][1]
            chain.append(stay)

    def _keep(self, chain: list[Stay], arrive_s: float, leave_s: float) -> None:
        if arrive_s < self._stays.best_s - GAIN_S:
            self._stays.best_s = arrive_s
            self._best = (chain, leave_s)

    def _widening_search(self, origin: Stay, least_s: float) -> None:
        """Search up to the best arrival known; without one, up to ever later arrivals until the horizon."""
        p = self.problem
        horizon_s = p.air.start_s + p.air.slot_s * p.air.north.shape[1]
        until = p.depart_s + FIRST_HORIZON * least_s
        while self._best is None and until < horizon_s:
            self._stays.best_s = until
            self._search(origin)
            until = p.depart_s + 2.0 * (until - p.depart_s)
        if self._best is None:
            self._stays.best_s = math.inf
        self._search(origin)

    def _settle(self, node: int, stay: Stay) -> bool:
        """Add a stay to what is known of its station; false where that covers it already."""
        known = self._settled.get(node)
        if known is None:
            self._settled[node] = _Envelope(stay.z, stay.h, stay.g)
            return True
        # Potential and landed charge are cheap to compare and settle most; the charge to leave with decides.
        if known.covers_parts(stay) or covers(known.g, stay.g, 0.0):
            return False
        self._settled[node] = _Envelope(
            _upper(known.z, stay.z), upper_profile(known.h, stay.h), upper_profile(known.g, stay.g)
        )
        return True

    def _search(self, origin: Stay) -> None:
        stays = self._stays
        self._settled = {}
        heap = [(stays.bound_s(origin), 0, _Label(origin, None))]
        count = 0
        while heap:
            bound, _, label = heapq.heappop(heap)
            if bound >= stays.best_s - GAIN_S:
                return
            node = label.stay.node
            if not self._settle(node, label.stay):
                continue
            self.looked_at += 1
            useful = stays.useful_from(label.stay)
            pieces_of = stays.pieces_from(label.stay, useful)
            destination = self.problem.destination
            if useful[destination]:
                self._keep(label.chain(), *stays.arrive(label.stay, pieces_of(destination)))
            useful[[destination, node]] = False
            for bound, after in stays.land(label.stay, np.flatnonzero(useful & self._stops), pieces_of):
                if bound < stays.best_s - GAIN_S:
                    count += 1
                    heapq.heappush(heap, (bound, count, _Label(after, label)))
