"""Spread of the state of charge over the simulated deliveries of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.statistics import weighted_quantile
from skyway.planner.schedule.itinerary import fly_sampled
from skyway.planner.schedule.schedule_kernels import PAD, READY, SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.result import PlanResult

TIMES = 160
LOW, HIGH = 0.1, 0.9
MIN_SHARE = 0.05
"""Where fewer of the deliveries are still under way, the band ends."""


@dataclass(frozen=True)
class ChargeBand:
    """Charge that 8 of 10 of the deliveries still under way have, over time."""

    time_s: NDArray[np.float64]
    """POSIX seconds."""
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    """Quantiles 0.1 and 0.9 of the state of charge, 0-1."""


def charge_band(result: PlanResult) -> ChargeBand | None:
    """Return the spread of the charge over the simulated deliveries of a plan; None where none arrives."""
    schedule, weight = _arriving(result)
    if not len(weight):
        return None
    return band_of(schedule, weight, float(result.problem.depart_s), float(result.problem.soc))


def charge_by_leg(result: PlanResult, levels: Sequence[float]) -> NDArray[np.float64] | None:
    """Return quantiles of the charge at the take-offs and landings of a plan, shape (legs, 2, levels); None where no run arrives."""
    schedule, weight = _arriving(result)
    if not len(weight):
        return None
    return np.array(
        [
            [[weighted_quantile(leg[:, column], weight, level) for level in levels] for column in (SOC_TAKE_OFF, SOC_LANDING)]
            for leg in schedule.transpose(1, 0, 2)
        ]
    )  # fmt: skip


def _arriving(result: PlanResult) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulated deliveries that arrive: schedules, shape (runs, legs, columns), and their probabilities."""
    robust = result.robust
    if robust is not None:
        schedule, weight = robust.out_of_sample.schedule, robust.out_of_sample.weight
    else:
        schedule, weight = fly_sampled(result.problem, result.itinerary)
    arrives = np.isfinite(schedule).all(axis=(1, 2))
    return schedule[arrives], weight[arrives]


def band_of(schedule: NDArray[np.float64], weight: NDArray[np.float64], depart_s: float, soc: float) -> ChargeBand:
    """Return the band of some runs, which all begin at `depart_s` with a charge.

    Their schedules have the shape (runs, legs, columns of `planner.schedule.schedule_kernels`), their probabilities
    (runs,).
    """
    end_s = schedule[:, -1, TOUCH_DOWN]
    grid = np.linspace(depart_s, float(end_s.max()), TIMES)
    charge = np.array([_over_time(run, grid, depart_s, soc) for run in schedule])
    low, high, kept = [], [], []
    for at, time_s in enumerate(grid.tolist()):
        aloft = end_s >= time_s
        if weight[aloft].sum() < MIN_SHARE * weight.sum():
            break
        kept.append(time_s)
        low.append(weighted_quantile(charge[aloft, at], weight[aloft], LOW))
        high.append(weighted_quantile(charge[aloft, at], weight[aloft], HIGH))
    return ChargeBand(np.array(kept), np.array(low), np.array(high))


def _over_time(run: NDArray[np.float64], grid: NDArray[np.float64], depart_s: float, soc: float) -> NDArray[np.float64]:
    """Charge of one run at some times: kept while it waits, rising from the pad until it is ready, falling in flight."""
    times, charges = [depart_s], [soc]
    for leg in run:
        ready = max(leg[PAD], min(leg[READY], leg[TAKE_OFF]))
        times += [leg[PAD], ready, leg[TAKE_OFF], leg[TOUCH_DOWN]]
        charges += [charges[-1], leg[SOC_TAKE_OFF], leg[SOC_TAKE_OFF], leg[SOC_LANDING]]
    return np.interp(grid, np.maximum.accumulate(times), charges)
