"""The typical schedule: the simulated delivery whose times are nearest to the medians.

A schedule that is shown must be a possible one. It is chosen among simulated deliveries, each in one wind
and one set of queues: those nearest to the median delivery, and to the median landings on the way, are flown again
without gusts and with the vehicle of the model, and the nearest of these is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.statistics import weighted_quantile
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.planner.parameters.simulation import ScheduleParameters


@dataclass(frozen=True, eq=False)
class Runs:
    """Simulated deliveries by one route."""

    schedule: NDArray[np.float64]
    """Shape (runs, legs, 7). See `planner.schedule.schedule_kernels`."""
    weight: NDArray[np.float64]
    """Shape (runs,). Probability of each."""
    member: NDArray[np.int64]
    queue: NDArray[np.int64]
    """Shape (runs,) each. Member of the forecast and set of queues of each."""

    @property
    def sets(self) -> int:
        """Number of sets of queues."""
        return int(self.queue.max()) + 1


class Typical(NamedTuple):
    """The typical schedule."""

    member: int
    """Of the forecast."""
    queue: int | None
    """Set of queues; None: no schedule without gusts arrives, and it is one with gusts."""
    schedule: NDArray[np.float64]
    """Shape (legs, 7). See `planner.schedule.schedule_kernels`."""


def typical_schedule(
    runs: Runs,
    reserve: float,
    fly: Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float64]],
    parameters: ScheduleParameters,
) -> Typical:
    """Choose the typical schedule of simulated deliveries, at least one of which arrives.

    Those with a landing below the reserve (SoC) are only reported if there are no others, and those that run empty only
    if there are no others either. `fly` flies members and sets of queues without gusts: (members, queues) to schedules,
    shape (pairs, legs, 7).
    """
    landings = runs.schedule[:, :, TOUCH_DOWN]
    arrived = np.flatnonzero(np.isfinite(landings[:, -1]))
    weight = runs.weight[arrived]
    median = np.array([weighted_quantile(times, weight, 0.5) for times in landings[arrived].T])
    low = _shortfall(runs.schedule[arrived], reserve)
    nearest = arrived[
        np.lexsort((_distance(landings[arrived], median, parameters.landings_weight), low))[
            : parameters.typical_candidates
        ]
    ]
    member, queue = runs.member[nearest], runs.queue[nearest]
    calm = fly(member, queue)
    low = _shortfall(calm, reserve)
    away = _distance(calm[:, :, TOUCH_DOWN], median, parameters.landings_weight)
    best = int(np.lexsort((away, low, ~np.isfinite(away)))[0])
    if not np.isfinite(away[best]):
        return Typical(int(member[0]), None, runs.schedule[nearest[0]])
    return Typical(int(member[best]), int(queue[best]), calm[best])


def _shortfall(schedules: NDArray[np.float64], reserve: float) -> NDArray[np.int64]:
    """Whether each run, shape (runs, legs, 7), keeps the reserve (0), uses some of it (1) or runs empty (2)."""
    least = schedules[:, :, SOC_LANDING].min(axis=1)
    return np.asarray((least < reserve - 1e-9).astype(np.int64) + (least < 0.0), dtype=np.int64)


def _distance(landings: NDArray[np.float64], median: NDArray[np.float64], on_the_way: float) -> NDArray[np.float64]:
    """Deviation of the landings of each run, shape (runs, legs), from the median ones, s; infinite if it does not arrive."""
    off = np.abs(np.where(np.isfinite(landings), landings, np.inf) - median)
    found: NDArray[np.float64] = off[:, -1] + on_the_way * off[:, :-1].sum(axis=1) / max(off.shape[1] - 1, 1)
    return found
