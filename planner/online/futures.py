"""Futures that a delivery may meet: winds of the forecast, each with a sample of the queues and an error of the energy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import NEVER
from skyway.models.queues.sampling import QueuePath
from skyway.planner.online.turn_back import USUAL_FLIGHT_S
from skyway.planner.problem.flight_table import FlightTable, ground_speeds, table_land, table_slot, table_slot_end
from skyway.planner.robust.uncertain_wind_kernels import careful_speeds, gust_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.information_kernels import Known


class SampledQueues(Mapping[int, QueuePath]):
    """One sampled realization of the queues of a problem; drawn for a station when it is first asked for."""

    def __init__(self, problem: Problem, sample: int) -> None:
        self._problem, self._sample = problem, sample
        self._found: dict[int, QueuePath] = {}

    def __getitem__(self, node: int) -> QueuePath:
        if node not in self._found:
            self._found |= self._problem.queue_paths([node], self._sample)
        return self._found[node]

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self)))

    def __len__(self) -> int:
        return len(self._problem.network)

    def with_path(self, node: int, path: QueuePath) -> SampledQueues:
        """Return the same with another queue at one station."""
        other = SampledQueues(self._problem, self._sample)
        other._found = {**self._found, node: path}
        return other


@dataclass(frozen=True, eq=False)
class Future:
    """One course that wind, queues and the vehicle may take."""

    careful: NDArray[np.float64]
    """Shape (slots, segments). Ground speeds that later flights count on, m/s: in a mean gust of `careful_sigmas`
    against them."""
    table: FlightTable
    """Its wind."""
    queues: SampledQueues
    """By node."""
    energy: float
    """What the next flight takes as a multiple of what is expected."""
    gust: float
    """Mean gust of the next flight, standard deviations against it."""
    careful_sigmas: float

    def slowed(self, segments: tuple[int, ...], off_s: float) -> float:
        """How much longer its gust makes the cruise of a flight that takes off at a time, as a share."""
        way, slot = list(segments), int(table_slot(self.table, off_s))
        usual, careful = self.table.speed_mps[slot, way], self.careful[slot, way]
        if not np.all(careful > 0.0):
            return 0.0
        distance = self.table.distance_m[way]
        return self.gust * float(np.sum(distance / careful) / np.sum(distance / usual) - 1.0) / self.careful_sigmas


def draw_futures(p: Problem, known: Known, belief: EnergyBelief, count: int) -> list[Future]:
    """Draw futures evenly by the probability of their winds; `belief` is about the energy of the next flight."""
    air, sigmas = p.air, p.parameters.online.careful_sigmas
    share = np.cumsum(p.probability) / p.probability.sum()
    members = np.searchsorted(share, (np.arange(count) + 0.5) / count)
    rng = np.random.default_rng((p.request.seed, len(members)))
    energy = rng.permutation([belief.quantile((k + 0.5) / len(members)) for k in range(len(members))])
    gusts = rng.permutation([NormalDist().inv_cdf((k + 0.5) / len(members)) for k in range(len(members))])
    ahead_s = max(p.depart_s - air.start_s, 0.0) + p.parameters.online.hours * S_PER_H
    slots = np.arange(min(air.north.shape[1], 1 + int(ahead_s // air.slot_s)))
    segments = np.arange(len(air.distance_m))
    against = sigmas * gust_mean(known, USUAL_FLIGHT_S)
    found = []
    drawn = zip(members.tolist(), energy.tolist(), gusts.tolist(), strict=True)
    for sample, (member, multiple, gust) in enumerate(drawn):
        speeds = ground_speeds(air, member, slots, segments)
        careful = careful_speeds(air, member, slots, segments, against)
        first, head = p.network.first, p.network.head
        table = FlightTable(air.start_s, air.slot_s, air.climb_s, air.descent_s, first, head, air.distance_m, speeds)
        found.append(Future(careful, table, SampledQueues(p, sample), multiple, gust, sigmas))
    return found


def flight_in(table: FlightTable, segments: tuple[int, ...], off_s: float, slots: int) -> tuple[float, float]:
    """When a flight takes off and lands that may be held for some slots of wind: (take-off, touch-down)."""
    way = np.asarray(segments, dtype=np.int64)
    for _ in range(slots + 1):
        down = float(table_land(table, way, off_s))
        if down < NEVER:
            return off_s, down
        off_s = float(table_slot_end(table, int(table_slot(table, off_s))))
        if off_s == NEVER:
            break
    return off_s, math.inf
