"""Informed exhaustive search: every sequence of stops without a repeat, with the best charging on each.

It is told the truth, one wind and one queue at each station, and is the referee of the other planners: a sequence is cut
off only by a proof that no continuation of it beats the best composition found so far. On each sequence the whole
trade-off between time and charge is carried along exactly (`planner.profile_kernels`), over flights that may overfly
stations (`planner.flight_functions`).

The proof: let L be the least flight time from here to the destination at the best wind of any slot, c the charge a
second of flight takes, r the greatest rate of charging, and z the greatest charging potential of the profile. No
arrival is earlier than (a) the profile's beginning plus L, nor than (b) (reserve / r) + L (1 + c / r) - z: potential
is lost by L c / r to energy and by L to time in flight, waiting never gains any, and to land with the reserve at time
T takes T + z at least reserve / r.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.flight_kernels import land, segment_speed, slot_of
from planner.flight_functions import arrival_functions
from planner.itinerary import Hop
from planner.no_route import no_route
from planner.outlook import Outlook
from planner.outlook_kernels import escape_cost
from planner.profile_kernels import departure_profile, fly_profile, profile_at, stop_profile

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.queue_paths import QueuePath
    from planner.itinerary import Itinerary
    from planner.problem import Problem

_GAIN_S = 1e-6


@dataclass(frozen=True)
class _Stay:
    """Profiles of one stop of a sequence; see `planner.profile_kernels`."""

    node: int
    z: NDArray[np.float64]
    h: NDArray[np.float64]
    g: NDArray[np.float64]


class ExhaustiveSearch:
    """One search.

    Parameters
    ----------
    problem : Problem
        Its ensemble must have one member, the truth.
    queues : mapping of int to QueuePath
        The true queue at each station with pads.
    time_limit_s : float
        The search stops after this time; `complete` is False then.
    progress : callable, optional
        Called about every second with (sequences looked at, best delivery time so far in seconds).
    single_segments : bool
        Land at the end of every segment, as the forward searches do, instead of overflying stations.
    """

    def __init__(
        self,
        problem: Problem,
        queues: dict[int, QueuePath],
        *,
        time_limit_s: float = math.inf,
        progress: Callable[[int, float], None] | None = None,
        single_segments: bool = False,
    ) -> None:
        self.problem = problem
        self.queues = queues
        self.time_limit_s = time_limit_s
        self.single_segments = single_segments
        self.progress = progress
        self.complete = True
        self.looked_at = 0
        self._flights: dict[tuple[int, int], tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._needed = self._landing_needs()
        self._least_s = self._least_flight_times()
        self._best_s = math.inf
        self._best: tuple[list[_Stay], float] | None = None
        self._deadline = math.inf
        self._last_progress = 0.0

    # -- what is known beforehand ------------------------------------------------------------------------------------

    def _least_flight_times(self) -> NDArray[np.float64]:
        """Least cruise time from each node to the destination at each segment's best wind, shape (nodes,)."""
        network, air = self.problem.network, self.problem.air
        slots = air.north.shape[1]
        best = np.full(len(network), math.inf)
        best[self.problem.destination] = 0.0
        entering: dict[int, list[int]] = {}
        for segment, head in enumerate(network.head.tolist()):
            entering.setdefault(head, []).append(segment)
        heap = [(0.0, self.problem.destination)]
        while heap:
            bound, node = heapq.heappop(heap)
            if bound > best[node]:
                continue
            for segment in entering.get(node, ()):
                speed = max(float(segment_speed(air, 0, slot, segment)) for slot in range(slots))
                tail = int(network.tail[segment])
                if speed > 0.0 and bound + air.distance_m[segment] / speed < best[tail]:
                    best[tail] = bound + air.distance_m[segment] / speed
                    heapq.heappush(heap, (best[tail], tail))
        return best

    def _landing_needs(self) -> NDArray[np.float64]:
        """Least charge on touch-down at the destination, by time: the reserve, and the way on where it has no pads."""
        p = self.problem
        if not p.needs_escape:
            return np.array([[p.depart_s, p.reserve]])
        need = Outlook(p).need
        step = 60.0
        slot_s = p.air.slot_s
        slots = p.air.north.shape[1]
        ends = p.air.start_s + slot_s * np.arange(1, slots + 1)
        times = np.unique(np.concatenate((np.arange(p.depart_s, ends[-1], step), ends, ends - 1e-3)))
        values = [p.reserve + min(float(escape_cost(p.air, 0, need, t)), 2.0) for t in times]
        return np.column_stack((times, values))

    def _flight_pieces(self, origin: int, slot: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        key = (origin, slot)
        if key not in self._flights:
            p = self.problem
            limit = (1.0 - p.reserve - p.soc_fixed) / p.soc_per_s
            self._flights[key] = arrival_functions(p.air, 0, p.network.first, p.network.head, origin, slot, limit)
        return self._flights[key]

    # -- the search --------------------------------------------------------------------------------------------------

    def solve(self) -> Itinerary:
        """Enumerate, best bound first at each stop.

        Raises
        ------
        NoRouteError
            There is none (or, with `complete` False, none was found in time).
        """
        p = self.problem
        started = time.monotonic()
        self._deadline = started + self.time_limit_s
        self._last_progress = started
        self._visit([self._origin()])
        if self._best is None:
            raise no_route(p, Outlook(p))
        return self._trace(*self._best)

    def _origin(self) -> _Stay:
        p = self.problem
        h = np.array([[p.depart_s, p.soc, p.depart_s]])
        z = np.empty((0, 3))
        if p.has_pads(p.origin) and not p.in_flight:
            pad = float(self.queues[p.origin].pad_time(p.depart_s))
            curve_s, curve_soc = p.curve(p.origin)
            z = np.array([[pad, float(np.interp(p.soc, curve_soc, curve_s)) - pad, p.depart_s]])
        return self._stay(p.origin, z, h)

    def _stay(self, node: int, z: NDArray[np.float64], h: NDArray[np.float64]) -> _Stay:
        curve_s, curve_soc = self.problem.curve(node)
        return _Stay(node, z, h, departure_profile(z, h, curve_s, curve_soc))

    def _bound_s(self, stay: _Stay) -> float:
        """Earliest arrival that any continuation can have (see the module's proof)."""
        p = self.problem
        least = float(self._least_s[stay.node]) + p.air.climb_s + p.air.descent_s
        begin = float(stay.h[0, 0]) if len(stay.h) else float(stay.z[0, 0])
        bound = begin + least
        if len(stay.z):
            rate = max(float(np.max(np.diff(soc) / np.diff(t))) for t, soc in p.curves)
            taken = least * p.soc_per_s + min(p.soc_fixed, 0.0)
            landed = float(stay.h[:, 1].max()) if len(stay.h) else 0.0
            potential = max(float(stay.z[:, 1].max()), landed / rate - begin)
            bound = max(bound, p.reserve / rate + least + taken / rate - potential)
        return bound

    def _visit(self, path: list[_Stay]) -> None:
        """Continue a sequence with every station it has not stopped at."""
        self.looked_at += 1
        now = time.monotonic()
        if now > self._deadline:
            self.complete = False
            return
        if self.progress is not None and now - self._last_progress > 1.0:
            self._last_progress = now
            self.progress(self.looked_at, self._best_s - self.problem.depart_s)
        stay = path[-1]
        visited = {earlier.node for earlier in path}
        following: list[tuple[float, _Stay]] = []
        pieces_of = self._pieces_from(stay)
        for node in range(len(self.problem.network)):
            if node == self.problem.destination:
                self._arrive(path, pieces_of(node))
            elif node not in visited and self.problem.has_pads(node):
                after = self._land(stay, node, pieces_of(node))
                if after is not None:
                    following.append((self._bound_s(after), after))
        for bound, after in sorted(following, key=lambda pair: pair[0]):
            if bound < self._best_s - _GAIN_S and self.complete:
                self._visit([*path, after])

    def _pieces_from(self, stay: _Stay) -> Callable[[int], NDArray[np.float64]]:
        """Arrival functions from a stop, over all slots that can matter."""
        p = self.problem
        begin = float(stay.g[0, 0])
        end = min(self._best_s, p.air.start_s + p.air.slot_s * p.air.north.shape[1] - 1.0)
        if p.in_flight and stay.node == p.origin:
            end = begin  # a drone in the air cannot stay
        slots = range(int(slot_of(p.air, begin)), int(slot_of(p.air, max(end, begin))) + 1)
        tables = [self._flight_pieces(stay.node, slot) for slot in slots]

        adjacent = set(p.network.head[p.network.first[stay.node] : p.network.first[stay.node + 1]].tolist())

        def pieces(node: int) -> NDArray[np.float64]:
            if self.single_segments and node not in adjacent:
                return np.empty((0, 4))
            blocks = [found[offset[node] : offset[node + 1]] for offset, found in tables]
            joined = np.concatenate(blocks) if blocks else np.empty((0, 4))
            if p.in_flight and stay.node == p.origin:
                return _only_at(joined, begin)
            return joined

        return pieces

    def _fly(
        self, stay: _Stay, pieces: NDArray[np.float64], needed: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], int]:
        p = self.problem
        if not len(pieces):
            return np.empty((0, 6)), 0
        return fly_profile(stay.g, pieces, p.soc_per_s, p.soc_fixed, needed, self._best_s)

    def _land(self, stay: _Stay, node: int, pieces: NDArray[np.float64]) -> _Stay | None:
        p = self.problem
        flown, count = self._fly(stay, pieces, np.array([[p.depart_s, p.reserve]]))
        if count == 0:
            return None
        queue = self.queues[node]
        curve_s, curve_soc = p.curve(node)
        z, h = stop_profile(
            flown, count, p.soc_per_s, p.reserve, queue.arrival_s, queue.pad_s, queue.land_s, curve_s, curve_soc
        )
        return self._stay(node, z, h) if len(h) else None

    def _arrive(self, path: list[_Stay], pieces: NDArray[np.float64]) -> None:
        """End a sequence at the destination and keep it if it is the best so far."""
        flown, count = self._fly(path[-1], pieces, self._needed)
        if count and flown[0, 0] < self._best_s - _GAIN_S:
            self._best_s = float(flown[0, 0])
            self._best = (path, float(flown[0, 2]))

    # -- from the best sequence back to decisions -------------------------------------------------------------------

    def _trace(self, path: list[_Stay], leave_s: float) -> Itinerary:
        p = self.problem
        hops: list[Hop] = []
        target = p.destination
        for stay in reversed(path):
            segments = self._walk(stay.node, target, leave_s)
            charge_to, arrived_by = self._charge(stay, leave_s)
            hops.append(Hop(segments, charge_to, leave_s))
            target, leave_s = stay.node, arrived_by
        return tuple(reversed(hops))

    def _charge(self, stay: _Stay, leave_s: float) -> tuple[float | None, float]:
        """Charge with which the drone leaves a stop (None: it used no pad), and when it left the stop before."""
        potential, by_pad = profile_at(stay.z, leave_s)
        landed, by_spot = profile_at(stay.h, leave_s)
        curve_s, curve_soc = self.problem.curve(stay.node)
        charged = float(np.interp(leave_s + potential, curve_s, curve_soc)) if math.isfinite(potential) else -math.inf
        if charged > landed + 1e-9:
            return charged, float(by_pad)
        return None, float(by_spot)

    def _walk(self, origin: int, target: int, leave_s: float) -> tuple[int, ...]:
        """Segments of the earliest flight between two stations at a take-off (time-dependent Dijkstra)."""
        p = self.problem
        network, air = p.network, p.air
        best_land = math.inf
        best_walk: tuple[int, ...] = ()
        first = int(slot_of(air, leave_s))
        last_possible = int(slot_of(air, leave_s + p.longest_flight_s))
        for last in range(first, last_possible + 1):
            heap: list[tuple[float, int, tuple[int, ...]]] = [(leave_s + air.climb_s, origin, ())]
            done: set[int] = set()
            while heap:
                _, node, walk = heapq.heappop(heap)
                if node in done:
                    continue
                done.add(node)
                if node == target:
                    down = float(land(air, 0, np.array(walk, dtype=np.int64), leave_s))
                    if down < best_land:
                        best_land, best_walk = down, walk
                    break
                for segment in range(int(network.first[node]), int(network.first[node + 1])):
                    other = int(network.head[segment])
                    closed = any(segment_speed(air, 0, slot, segment) <= 0.0 for slot in range(first, last + 1))
                    if other in done or closed:
                        continue
                    after = float(land(air, 0, np.array([*walk, segment], dtype=np.int64), leave_s))
                    over = after - air.descent_s if math.isfinite(after) else math.inf
                    if math.isfinite(over):
                        heapq.heappush(heap, (over, other, (*walk, segment)))
        return best_walk


def _only_at(pieces: NDArray[np.float64], take_off_s: float) -> NDArray[np.float64]:
    """Narrow pieces of an arrival function, shape (pieces, 4), to one take-off."""
    chosen = pieces[(pieces[:, 0] <= take_off_s) & (pieces[:, 2] >= take_off_s)][:1]
    if not len(chosen):
        return chosen
    t0, a0, t1, a1 = chosen[0]
    arrive = a0 + (a1 - a0) * (take_off_s - t0) / (t1 - t0) if t1 > t0 else a0
    return np.array([[take_off_s, arrive, take_off_s, arrive]])
