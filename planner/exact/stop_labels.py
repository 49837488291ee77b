"""Stop labels of one drone in one known wind and queue: the elements of exact searches.

A *stop label* is a stop with everything the drone can do there: its profiles of charge over time (`planner.schedule.profile_kernels`).
`StopLabels` makes the stop label at the origin, takes a stop label through a flight to the next one, bounds what can follow, and turns
a chain of stop labels back into decisions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.exact.flight_search import flights_from, nothing_asked
from skyway.planner.exact.relaxation_grid_kernels import least_times
from skyway.planner.exact.stop_label_kernels import Costs, land_at, land_everywhere
from skyway.planner.exact.walk_kernels import earliest_walk
from skyway.planner.problem.flight_table import table_slot
from skyway.planner.schedule.itinerary import Leg
from skyway.planner.schedule.leg_profile_kernels import fly_profile
from skyway.planner.schedule.profile_kernels import departure_profile, profile_at

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.exact.subnetwork import Subnetwork
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


@dataclass(frozen=True, eq=False)
class StopLabel:
    """A stop and its profiles; see `planner.schedule.profile_kernels`. Its node is that of the subnetwork."""

    node: int
    z: NDArray[np.float64]
    h: NDArray[np.float64]
    curve: tuple[NDArray[np.float64], NDArray[np.float64]]

    @cached_property
    def g(self) -> NDArray[np.float64]:
        """Charge the drone can leave with, by time, shape (points, 2)."""
        return departure_profile(self.z, self.h, *self.curve)

    @property
    def begin_s(self) -> float:
        """Earliest that the drone can leave, POSIX seconds."""
        return float(self.h[0, 0])


def costs_of(problem: Problem, margin_soc_per_s: float) -> Costs:
    """Gather what flights cost and how fast charging can be at best."""
    rate = max(float(np.max(np.diff(soc) / np.diff(t))) for t, soc in problem.curves)
    landing = problem.air.climb_s + problem.air.descent_s
    return Costs(
        float(problem.soc_per_s),
        float(problem.soc_fixed),
        float(margin_soc_per_s),
        float(problem.reserve),
        rate,
        float(landing),
    )


def longest_s(problem: Problem) -> float:
    """No flight takes longer, take-off to touch-down, its hover included."""
    return float((max(1.0, problem.soc) - problem.reserve - problem.soc_fixed) / problem.soc_per_s)


def landing_s(problem: Problem, queues: Mapping[int, QueuePath], arrive_s: float) -> float:
    """When a drone lands that comes to the destination at a time: at once, or when there is a pad or a holding spot."""
    if not problem.has_pads(problem.destination) or not math.isfinite(arrive_s):
        return arrive_s
    return float(queues[problem.destination].land_time(arrive_s))


def come_by_s(problem: Problem, queues: Mapping[int, QueuePath], land_by_s: float) -> float:
    """When a drone must come to the destination to land there by a time; see `landing_s`, of which it is the inverse."""
    if not problem.has_pads(problem.destination):
        return land_by_s
    return queues[problem.destination].latest_arrival(land_by_s)


class StopLabels:
    """Makes and continues stop labels.

    `queues` holds the true queue at each station with pads, `subnetwork` where and in which wind flights are looked at,
    `needed` what `planner.exact.escape.needed_at_destination` returns. A landing after T seconds in the air keeps the
    reserve and `margin_soc_per_s` times T.
    """

    def __init__(
        self,
        problem: Problem,
        queues: Mapping[int, QueuePath],
        subnetwork: Subnetwork,
        needed: NDArray[np.float64],
        *,
        margin_soc_per_s: float = 0.0,
    ) -> None:
        self.problem = problem
        self.queues = queues
        self.subnetwork = subnetwork
        self.table = subnetwork.table
        self.best_s = math.inf
        """Arrivals from this time on do not matter any more."""
        self.costs = costs_of(problem, margin_soc_per_s)
        self._needed = needed
        self._flights: dict[tuple[int, int], tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._least: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._useful: dict[tuple[int, int], NDArray[np.bool_]] = {}

    def least_s(self, time_s: float) -> NDArray[np.float64]:
        """Least cruise time from each node to the destination, shape (nodes,).

        Each segment is taken at its best wind of any slot from a time on until `best_s`.
        """
        table = self.table
        first = int(table_slot(table, time_s))
        last = int(table_slot(table, self.best_s)) if math.isfinite(self.best_s) else len(table.speed_mps) - 1
        key = (first, max(first, last))
        if key not in self._least:
            seen = table._replace(speed_mps=table.speed_mps[first : key[1] + 1])
            self._least[key] = least_times(seen, self.subnetwork.destination)
        return self._least[key]

    def _flight_pieces(
        self, origin: int, slot: int, useful: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Arrival functions from a station for one slot, to at least the useful stations."""
        key = (origin, slot)
        if key in self._flights and not np.any(useful & ~self._useful[key]):
            return self._flights[key]
        self._useful[key] = useful.copy()
        self._flights[key] = flights_from(self.table, origin, (slot, slot), self.longest_s, useful, nothing_asked())
        return self._flights[key]

    @property
    def longest_s(self) -> float:
        """No flight takes longer, take-off to touch-down."""
        return longest_s(self.problem)

    def curve(self, node: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Charging curve of a node of the subnetwork."""
        return self.problem.curve(int(self.subnetwork.nodes[node]))

    def origin(self) -> StopLabel:
        """Return the stop label that the delivery begins with."""
        p = self.problem
        h = np.array([[p.depart_s, p.soc, p.depart_s]])
        z = np.empty((0, 3))
        if p.has_pads(p.origin) and not p.in_flight:
            pad = float(self.queues[p.origin].pad_time(p.depart_s))
            curve_s, curve_soc = p.curve(p.origin)
            z = np.array([[pad, float(np.interp(p.soc, curve_soc, curve_s)) - pad, p.depart_s]])
        return StopLabel(self.subnetwork.origin, z, h, p.curve(p.origin))

    def _potential(self, stop_label: StopLabel) -> float:
        """Greatest charging potential of a stop label, for the constant rate that is nowhere exceeded."""
        landed = float(stop_label.h[-1, 1]) / self.costs.rate_per_s - stop_label.begin_s
        return max(float(stop_label.z[-1, 1]) if len(stop_label.z) else -math.inf, landed)

    def useful_from(self, stop_label: StopLabel) -> NDArray[np.bool_]:
        """Return which stations can lie on a better way from a stop label than the best known, shape (nodes,)."""
        p = self.problem
        least = self.least_s(stop_label.begin_s)
        if math.isinf(self.best_s):
            return np.isfinite(least)
        place = self.subnetwork.place_m
        straight = np.sqrt(((place - place[stop_label.node]) ** 2).sum(axis=1)) / self._fastest_mps
        flight = straight + least + p.air.climb_s + p.air.descent_s
        taken = flight * p.soc_per_s + min(p.soc_fixed, 0.0)
        by_charge = (
            p.reserve / self.costs.rate_per_s + flight + taken / self.costs.rate_per_s - self._potential(stop_label)
        )
        bound = np.maximum(stop_label.begin_s + flight, by_charge)
        return np.asarray(bound < self.best_s)

    @cached_property
    def _fastest_mps(self) -> float:
        """Ground speed that no flight exceeds."""
        return float(self.table.speed_mps.max())

    def pieces_from(self, stop_label: StopLabel, useful: NDArray[np.bool_]) -> Callable[[int], NDArray[np.float64]]:
        """Arrival functions from a stop to useful stations, over all slots that can matter."""
        table = self.table
        begin = stop_label.begin_s
        end = self.subnetwork.horizon_s
        if math.isfinite(self.best_s):
            end = min(self.best_s - float(self.least_s(begin)[stop_label.node]), end)
        at_once = self.leaves_at_once(stop_label)
        if at_once:
            end = begin
        slots = range(int(table_slot(table, begin)), int(table_slot(table, max(end, begin))) + 1)
        tables = [self._flight_pieces(stop_label.node, slot, useful) for slot in slots]

        def pieces(node: int) -> NDArray[np.float64]:
            joined = np.concatenate([found[offset[node] : offset[node + 1]] for offset, found in tables])
            return only_at(joined, begin) if at_once else joined

        return pieces

    def leaves_at_once(self, stop_label: StopLabel) -> bool:
        """Return whether a stop label is that of a drone in the air, which cannot stay."""
        return self.problem.in_flight and stop_label.node == self.subnetwork.origin

    def land(
        self, stop_label: StopLabel, targets: NDArray[np.int64], pieces_of: Callable[[int], NDArray[np.float64]]
    ) -> list[tuple[float, StopLabel]]:
        """Fly on to stations and land there: (bound, stop label) of each that the reserve allows and that is not too late."""
        blocks = [pieces_of(target) for target in targets.tolist()]
        if not blocks:
            return []
        offset = np.zeros(len(blocks) + 1, dtype=np.int64)
        np.cumsum([len(block) for block in blocks], out=offset[1:])
        found = land_everywhere(
            stop_label.g,
            targets,
            offset,
            np.concatenate(blocks),
            self.subnetwork.grounds,
            self.costs,
            self.least_s(stop_label.begin_s),
            self.best_s,
        )
        return [(bound, StopLabel(node, z, h, self.curve(node))) for node, bound, z, h in found]

    def arrive(self, stop_label: StopLabel, pieces: NDArray[np.float64]) -> tuple[float, float]:
        """Earliest arrival at the destination from a stop label and the take-off for it; infinite where there is none."""
        if not len(pieces):
            return math.inf, math.nan
        costs, goal = self.costs, self.subnetwork.destination
        if self.problem.has_pads(self.problem.destination):  # it lands where others do
            _, landed = land_at(stop_label.g, pieces, goal, self.subnetwork.grounds, costs, self.best_s)
            return (float(landed[0, 0]), float(landed[0, 2])) if len(landed) else (math.inf, math.nan)
        flown, count = fly_profile(
            stop_label.g, pieces, costs.soc_per_s, costs.soc_fixed, costs.margin_soc_per_s, self._needed, self.best_s
        )
        first = int(np.argmin(flown[:count, 0])) if count else 0
        return (float(flown[first, 0]), float(flown[first, 2])) if count else (math.inf, math.nan)

    def trace(self, path: Sequence[StopLabel], leave_s: float) -> Itinerary:
        """Turn a chain of stop labels and the last take-off back into decisions."""
        legs: list[Leg] = []
        target = self.subnetwork.destination
        for stop_label in reversed(path):
            _, walk = earliest_walk(self.table, stop_label.node, target, leave_s, self.longest_s)
            charge_to, arrived_by = self._charge(stop_label, leave_s)
            legs.append(Leg(tuple(self.subnetwork.segments[walk].tolist()), charge_to, leave_s))
            target, leave_s = stop_label.node, arrived_by
        return tuple(reversed(legs))

    def _charge(self, stop_label: StopLabel, leave_s: float) -> tuple[float | None, float]:
        """Charge with which the drone leaves a stop (None: it used no pad), and when it left the stop before."""
        leave_s = max(leave_s, stop_label.begin_s)  # but for rounding it never leaves before it landed
        potential, by_pad = profile_at(stop_label.z, leave_s)
        landed, by_spot = profile_at(stop_label.h, leave_s)
        curve_s, curve_soc = stop_label.curve
        charged = float(np.interp(leave_s + potential, curve_s, curve_soc)) if math.isfinite(potential) else -math.inf
        if charged > landed + 1e-9:
            return charged, float(by_pad)
        return None, float(by_spot)


def only_at(pieces: NDArray[np.float64], take_off_s: float) -> NDArray[np.float64]:
    """Narrow pieces of an arrival function, shape (pieces, 4), to one take-off."""
    chosen = pieces[(pieces[:, 0] <= take_off_s) & (pieces[:, 2] >= take_off_s)]
    if not len(chosen):
        return chosen
    arrive = min(
        a0 + (a1 - a0) * (take_off_s - t0) / (t1 - t0) if t1 > t0 else a0 for t0, a0, t1, a1 in chosen.tolist()
    )
    return np.array([[take_off_s, arrive, take_off_s, arrive]])
