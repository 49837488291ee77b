"""Possible futures of a delivery: winds of the forecast, each with a sample of the queues and an error of the energy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import S_PER_H
from skyway.models.flight.kernels import NEVER
from skyway.planner.online.turn_back import USUAL_FLIGHT_S
from skyway.planner.problem.flight_table import FlightTable, ground_speeds, table_land, table_slot, table_slot_end
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.problem.speeds import TrueSpeeds
from skyway.planner.robust.uncertain_wind_kernels import careful_speeds, gust_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.flight.rules import SegmentWind
    from skyway.planner.problem.problem import Problem
    from skyway.planner.robust.information_kernels import Known


MAX_TABLE = 200_000
"""Speeds of one future that are computed at once, at most."""


class CarefulSpeeds:
    """Ground speeds in one member with a gust against every flight, in the first slots; see `planner.problem.speeds.Speeds`.

    Of a small network all are computed once, of a large one those that a search asks for.
    """

    def __init__(self, air: SegmentWind, member: int, slots: int, against: float) -> None:
        self._air, self._member, self._against = air, member, against
        self.slots = slots
        self._closed: list[tuple[int, int]] = []

    @cached_property
    def _table(self) -> NDArray[np.float64] | None:
        count = len(self._air.distance_m)
        return self._worked_out(0, self.slots - 1, np.arange(count)) if self.slots * count <= MAX_TABLE else None

    def _worked_out(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        return careful_speeds(self._air, self._member, np.arange(first, last + 1), segments, self._against)

    def over(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """See `Speeds`."""
        table = self._table
        found = self._worked_out(first, last, segments) if table is None else table[first : last + 1][:, segments]
        for segment, end in self._closed:
            found[: max(end - first, 0), segments == segment] = 0.0
        return found

    def fastest_mps(self, first: int, last: int) -> float:
        """See `Speeds`."""
        return TrueSpeeds(self._air, self._member).fastest_mps(first, last)

    def close(self, segment: int, until_s: float) -> None:
        """No flight leads over a segment in slots that begin before a time, POSIX seconds."""
        end = math.ceil((until_s - self._air.start_s) / self._air.slot_s) if until_s < math.inf else self.slots
        self._closed.append((segment, min(max(end, 0), self.slots)))


@dataclass(frozen=True, eq=False)
class Future:
    """One course that wind, queues and the vehicle may take."""

    air: SegmentWind
    """The forecast."""
    member: int
    """Which of its winds this is."""
    careful: CarefulSpeeds
    """Ground speeds that later flights count on: in a mean gust of `careful_sigmas` against them."""
    queues: SampledQueues
    """By node."""
    energy: float
    """What the next flight takes as a multiple of what is expected."""
    gust: float
    """Mean gust of the next flight, standard deviations against it."""
    careful_sigmas: float
    _flights: dict[tuple[int, ...], FlightTable] = field(default_factory=dict, repr=False)

    def flight(self, segments: tuple[int, ...]) -> FlightTable:
        """Ground speeds in its wind over the segments of one flight, in their order."""
        if segments not in self._flights:
            way, air = np.asarray(segments, dtype=np.int64), self.air
            speeds = ground_speeds(air, self.member, np.arange(self.careful.slots), way)
            alone = np.zeros(1, dtype=np.int64)
            self._flights[segments] = FlightTable(
                air.start_s, air.slot_s, air.climb_s, air.descent_s, alone, alone, air.distance_m[way], speeds
            )
        return self._flights[segments]

    def lands_s(self, segments: tuple[int, ...], off_s: float) -> float:
        """Touch-down of a flight that takes off at a time, POSIX seconds; never where it cannot be flown."""
        return float(table_land(self.flight(segments), np.arange(len(segments)), off_s))

    def slowed(self, segments: tuple[int, ...], off_s: float) -> float:
        """Relative lengthening by its gust of the cruise of a flight that takes off at a time."""
        table = self.flight(segments)
        slot = int(table_slot(table, off_s))
        usual = table.speed_mps[slot]
        careful = self.careful.over(slot, slot, np.asarray(segments, dtype=np.int64))[0]
        if not np.all(careful > 0.0):
            return 0.0
        distance = table.distance_m
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
    slots = min(int(air.north.shape[1]), 1 + int(ahead_s // air.slot_s))
    against = sigmas * gust_mean(known, USUAL_FLIGHT_S)
    drawn = zip(members.tolist(), energy.tolist(), gusts.tolist(), strict=True)
    every = range(len(members))
    return [
        Future(
            air, member, CarefulSpeeds(air, member, slots, against), SampledQueues(p, sample, every), multiple, gust,
            sigmas,
        )
        for sample, (member, multiple, gust) in enumerate(drawn)
    ]  # fmt: skip


def flight_in(future: Future, segments: tuple[int, ...], off_s: float, slots: int) -> tuple[float, float]:
    """Take-off and touch-down of a flight that may be delayed by some slots of wind."""
    table = future.flight(segments)
    for _ in range(slots + 1):
        down = future.lands_s(segments, off_s)
        if down < NEVER:
            return off_s, down
        off_s = float(table_slot_end(table, int(table_slot(table, off_s))))
        if off_s == NEVER:
            break
    return off_s, math.inf
