"""What plans promise of a delivery: of their fixed route, or as flown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.information import LEVELS
from skyway.planner.evaluation.as_flown import as_flown

if TYPE_CHECKING:
    from benchmarks.independent.product.planning import Planned
    from skyway.planner.schedule.outcome import Outcome


@dataclass(frozen=True, eq=False)
class Promise:
    """What a plan says of a delivery: seconds after the departure.

    Attributes
    ----------
    mean_s : float
    quantile_s, promised : tuple of float
        At `LEVELS`, and the probability promised to arrive by then (the level, or more where many arrivals fall on one moment).
    reserve : float
        Probability that every landing keeps the reserve.
    """

    mean_s: float
    quantile_s: tuple[float, ...]
    promised: tuple[float, ...]
    reserve: float


def promise_of(outcome: Outcome) -> Promise:
    """Return what an outcome says of a delivery."""
    due = [outcome.quantile_s(level) for level in LEVELS]
    return Promise(
        outcome.mean_s - outcome.start_s,
        tuple(one - outcome.start_s for one in due),
        tuple(outcome.p_by(one) for one in due),
        outcome.p_success,
    )


def promised(plan: Planned, flown_runs: int) -> Promise:
    """What is promised: of the fixed route, or with `flown_runs` as that many deliveries simulated as `fly` decides them say (`plan --as-flown`)."""
    return promise_of(as_flown(plan.result, flown_runs).outcome) if flown_runs else plan.promise


def simulated(plan: Planned, days: int) -> dict[date, float]:
    """Simulate one delivery, decided as `fly` decides, on each of some days of the plan's forecast, evenly; how long it takes, s, infinite where it is not delivered."""
    outcome, forecast = as_flown(plan.result, days).outcome, plan.result.problem.forecast
    of_run = np.searchsorted(np.cumsum(forecast.probability), (np.arange(days) + 0.5) / days)
    time_s = np.full(days, math.inf)
    assert outcome.crossed is not None
    time_s[outcome.crossed.queue] = outcome.arrival_s - outcome.start_s
    assert np.array_equal(of_run[outcome.crossed.queue], outcome.crossed.day)
    return {date.fromisoformat(forecast.labels[k]): one for k, one in zip(of_run, time_s.tolist(), strict=True)}
