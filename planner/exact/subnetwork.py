"""The part of a network that a search needs: which nodes straight ways leave, and these as arrays for kernels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.jit.compiled import compiled
from skyway.models.queues.paths import no_queue, pack
from skyway.planner.exact.relaxation_grid_kernels import Waits, queue_cells
from skyway.planner.exact.stop_label_kernels import Grounds
from skyway.planner.problem.flight_table import FlightTable
from skyway.planner.problem.sampled_queues import AskedQueues
from skyway.planner.problem.speeds import TrueSpeeds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.models.queues.paths import QueuePath
    from skyway.planner.exact.relaxation_grid_kernels import Cells
    from skyway.planner.exact.stop_label_kernels import Costs
    from skyway.planner.problem.problem import Problem
    from skyway.planner.problem.speeds import Speeds

_SAME_S = 1e-6
"""Grids whose cells begin at the same times but for rounding."""


@dataclass(frozen=True, eq=False)
class Subnetwork:
    """Some nodes of a network with the segments between them, renumbered, over some slots."""

    nodes: NDArray[np.int64]
    segments: NDArray[np.int64]
    """Their numbers in the network of the problem."""
    table: FlightTable
    """Segments and ground speeds."""
    grounds: Grounds
    """Queues and charging curves."""
    has_pads: NDArray[np.bool_]
    """Shape (nodes,). Where a drone can land on its way."""
    place_m: NDArray[np.float64]
    """Shape (nodes, 3). Where the nodes are, for `places`."""
    origin: int
    destination: int
    """Of the delivery, in the numbers of this subnetwork."""
    horizon_s: float
    """No drone takes off after this."""
    whole: bool = True
    """It holds all nodes that a delivery may use up to the deadline that it is laid out for: what it lacks proves something."""

    @cached_property
    def _waits(self) -> dict[Cells, Waits]:
        return {}

    def waits(self, cells: Cells) -> Waits:
        """Return what arrivals in each cell wait for (`planner.exact.relaxation_grid_kernels.queue_cells`)."""
        for known, waits in self._waits.items():
            first = round((cells.over_s - known.over_s) / cells.step_s)
            same = cells.step_s == known.step_s and abs(known.over_s + first * cells.step_s - cells.over_s) < _SAME_S
            if same and first >= 0 and first + cells.length <= known.length:
                return waits if known == cells else _part(waits, first, cells.length)
        self._waits.clear()  # passes over one grid follow one another
        table = self.table
        self._waits[cells] = queue_cells(self.grounds, cells, table.climb_s, table.descent_s, len(self.nodes))
        return self._waits[cells]


def _part(waits: Waits, first: int, length: int) -> Waits:
    """Return the same of some cells, counted from the first of them."""
    part = slice(first, first + length)
    pad_cell, spot_cell = (np.clip(cell[part], first, first + length) - np.int32(first) for cell in waits[2:])
    return Waits(waits.pad_s[part], waits.spot_s[part], pad_cell, spot_cell)


def places(network: Network) -> NDArray[np.float64]:
    """Return nodes in space, metres from the Earth's centre, shape (nodes, 3): no way is shorter than a straight line."""
    return geodesy.earth_xyz(np.column_stack((network.lat, network.lon)))


@compiled
def _cut(
    first: NDArray[np.int64], head: NDArray[np.int64], nodes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """First, head and old number of the segments between some nodes.

    Segments that leave node i are ``first[i] : first[i + 1]`` and lead to ``head`` (compressed sparse rows); the nodes
    are renumbered in the order of `nodes`. O(nodes + segments that leave them).

    Takes nodes in ascending order, each once.
    """
    # New number of each node, -1 outside, and room for all segments that leave them.
    local = np.full(len(first) - 1, -1, dtype=np.int64)
    most = 0
    for number in range(len(nodes)):
        local[nodes[number]] = number
        most += first[nodes[number] + 1] - first[nodes[number]]
    # Keep those that lead to one of them.
    new_first = np.zeros(len(nodes) + 1, dtype=np.int64)
    new_head = np.empty(most, dtype=np.int64)
    old = np.empty(most, dtype=np.int64)
    count = 0
    for number in range(len(nodes)):
        for segment in range(first[nodes[number]], first[nodes[number] + 1]):
            other = local[head[segment]]
            if other >= 0:
                new_head[count], old[count] = other, segment
                count += 1
        new_first[number + 1] = count
    return new_first, new_head[:count].copy(), old[:count].copy()


def subnetwork(
    problem: Problem,
    queues: Mapping[int, QueuePath],
    speeds: Speeds,
    place_m: NDArray[np.float64],
    nodes: NDArray[np.int64],
    slots: tuple[int, int],
    *,
    with_queues: bool = True,
) -> Subnetwork:
    """Lay out some nodes over slots from the first to the last given.

    Parameters
    ----------
    problem, queues
        The delivery; `queues` by node.
    speeds : Speeds
        Ground speeds.
    place_m : ndarray, shape (all nodes, 3)
        Of `places`.
    nodes : ndarray of int
        Ascending, with origin and destination.
    slots : (first, last)
        Times outside use the nearest one.
    with_queues : bool
        Without them a pad is free at all times, and nothing is forecast or sampled: for bounds.
    """
    air, network = problem.air, problem.network
    first, head, segments = _cut(network.first, network.head, nodes)
    table = FlightTable(
        air.start_s + slots[0] * air.slot_s,
        air.slot_s,
        air.climb_s,
        air.descent_s,
        first,
        head,
        air.distance_m[segments],
        np.ascontiguousarray(speeds.over(*slots, segments), dtype=np.float64),
    )
    return Subnetwork(
        nodes,
        segments,
        table,
        _grounds(problem, queues if with_queues else {}, nodes, air.start_s + air.slot_s * (slots[1] + 1)),
        network.pads[nodes] > 0,
        place_m[nodes],
        int(np.searchsorted(nodes, problem.origin)),
        int(np.searchsorted(nodes, problem.destination)),
        air.start_s + air.slot_s * speeds.slots - 1.0,
    )


def whole_subnetwork(problem: Problem, queues: Mapping[int, QueuePath]) -> Subnetwork:
    """Lay out all nodes and slots of the true wind."""
    network, speeds = problem.network, TrueSpeeds(problem.air)
    return subnetwork(problem, queues, speeds, places(network), np.arange(len(network)), (0, speeds.slots - 1))


def narrowed(all_of_it: Subnetwork, keep: NDArray[np.bool_]) -> Subnetwork:
    """Cut a subnetwork down to some of its nodes, origin and destination among them."""
    nodes = np.flatnonzero(keep)
    old = all_of_it.table
    first, head, segments = _cut(old.first, old.head, nodes)
    table = old._replace(
        first=first,
        head=head,
        distance_m=old.distance_m[segments],
        speed_mps=np.ascontiguousarray(old.speed_mps[:, segments]),
    )
    return replace(
        all_of_it,
        nodes=all_of_it.nodes[nodes],
        segments=all_of_it.segments[segments],
        table=table,
        grounds=_narrowed_grounds(all_of_it.grounds, nodes),
        has_pads=all_of_it.has_pads[nodes],
        place_m=all_of_it.place_m[nodes],
        origin=int(np.searchsorted(nodes, all_of_it.origin)),
        destination=int(np.searchsorted(nodes, all_of_it.destination)),
    )


def queued(part: Subnetwork, problem: Problem, queues: Mapping[int, QueuePath]) -> Subnetwork:
    """Return the same with the queues of its nodes."""
    slots = len(part.table.speed_mps)
    return replace(part, grounds=_grounds(problem, queues, part.nodes, part.table.start_s + part.table.slot_s * slots))


def _narrowed_grounds(grounds: Grounds, nodes: NDArray[np.int64]) -> Grounds:
    begin, end = grounds.queue_offset[nodes], grounds.queue_offset[nodes + 1]
    offset = np.zeros(len(nodes) + 1, dtype=np.int64)
    np.cumsum(end - begin, out=offset[1:])
    entries = np.repeat(begin - offset[:-1], end - begin) + np.arange(offset[-1])
    return grounds._replace(
        queue_offset=offset,
        arrival_s=grounds.arrival_s[entries],
        pad_s=grounds.pad_s[entries],
        land_s=grounds.land_s[entries],
        delay_s=grounds.delay_s[entries],
        curve_of=grounds.curve_of[nodes],
    )


def _grounds(problem: Problem, queues: Mapping[int, QueuePath], nodes: NDArray[np.int64], until_s: float) -> Grounds:
    wanted = nodes.tolist()
    if isinstance(queues, AskedQueues):
        paths = queues.at(wanted, until_s)
    else:
        paths = [queues.get(node) or no_queue() for node in wanted]
    packed = pack(paths)
    curve_s, curve_soc = problem.padded_curves
    return Grounds(
        packed.offset,
        packed.arrival_s,
        packed.pad_s,
        packed.land_s,
        packed.delay_s,
        curve_of=problem.curve_of[nodes],
        curve_s=curve_s,
        curve_soc=curve_soc,
        curve_points=np.array([len(time) for time, _ in problem.curves], dtype=np.int64),
    )


@dataclass(frozen=True)
class Extent:
    """Bounds by straight ways: when nothing arrives yet, and which nodes a delivery can use until a time.

    Of one delivery, at some speeds and costs (`planner.exact.stop_labels.costs_of`).
    """

    problem: Problem
    speeds: Speeds
    costs: Costs

    @cached_property
    def place_m(self) -> NDArray[np.float64]:
        """Where the nodes are, see `planner.exact.subnetwork.places`."""
        return places(self.problem.network)

    @cached_property
    def way_m(self) -> NDArray[np.float64]:
        """Straight way over each node, shape (nodes,)."""
        place = self.place_m
        ends = place[[self.problem.origin, self.problem.destination]]
        return np.asarray(np.linalg.norm(place[:, None] - ends, axis=2).sum(axis=1))

    def straight_s(self, slots: int) -> float:
        """Arrival that nothing beats within some slots: straight at the greatest speed, charged as fast as can be."""
        p, costs = self.problem, self.costs
        way = float(np.linalg.norm(self.place_m[p.origin] - self.place_m[p.destination])) * 0.995
        flight = way / self.speeds.fastest_mps(0, min(slots, self.speeds.slots) - 1) + costs.landing_s
        charge = flight * costs.soc_per_s + min(costs.soc_fixed, 0.0)
        charged = (costs.reserve + charge - p.soc) / costs.rate_per_s
        return p.depart_s + flight + max(charged, 0.0)

    def slots(self, until_s: float) -> tuple[int, int]:
        """First and last slot that matter until a time."""
        p, air = self.problem, self.problem.air
        first, last = (
            min(max(int((t + 1e-6 - air.start_s) // air.slot_s), 0), self.speeds.slots - 1)
            for t in (p.depart_s, until_s)
        )
        return first, min(last + 1, self.speeds.slots - 1)

    def usable(self, until_s: float) -> NDArray[np.bool_]:
        """Which nodes can lie on a route that arrives by a time, shape (nodes,)."""
        p, costs = self.problem, self.costs
        flight = self.way_m * 0.995 / self.speeds.fastest_mps(*self.slots(until_s)) + costs.landing_s
        span = until_s - p.depart_s
        charged = (costs.reserve + flight * costs.soc_per_s + min(costs.soc_fixed, 0.0) - p.soc) / costs.rate_per_s
        keep: NDArray[np.bool_] = (flight <= span) & (flight + charged <= span)
        keep[[p.origin, p.destination]] = True
        return keep
