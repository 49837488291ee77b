"""Monte Carlo evaluation of plans and planners in held-out realizations."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InfeasibleError, InputError
from skyway.models.base.units import S_PER_MIN
from skyway.models.base.views import counted
from skyway.planner.evaluation.decisions import fly_policy
from skyway.planner.evaluation.flights import (
    DELIVERED,
    GAVE_UP,
    STRANDED,
    UNFLYABLE,
    Flown,
    fly_charging,
    fly_itinerary,
    pooled,
)
from skyway.planner.evaluation.parts import fly_parts
from skyway.planner.evaluation.policies import OpenLoop, Policy, Rolling, Standing
from skyway.planner.evaluation.realizations import (
    Realizations,
    check_held_out,
    check_same_request,
    held_out_forecast,
    sample_realizations,
    season_days,
)
from skyway.planner.evaluation.statistics import USUAL, DayBootstrap, Estimate
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import NO_ERRORS, Errors
from skyway.planner.problem.kernel_inputs import check_shape
from skyway.planner.registry import CLAIRVOYANT_PLANNERS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from skyway.planner.result import PlanResult

__all__ = [
    "NO_ERRORS",
    "Errors",
    "Estimate",
    "Evaluation",
    "Flown",
    "OpenLoop",
    "Policy",
    "Realizations",
    "Rolling",
    "Standing",
    "clairvoyant_times",
    "evaluate",
    "fly_charging",
    "fly_itinerary",
    "fly_policy",
    "held_out_forecast",
    "pooled",
    "sample_realizations",
    "season_days",
    "summarise",
]

SCHEMA = "skyway.evaluation/1"
_ENDINGS = {"stranded": STRANDED, "unflyable": UNFLYABLE, "gave_up": GAVE_UP}


@dataclass(frozen=True)
class Evaluation:
    """Figures of simulated deliveries with 95 % intervals over days."""

    planner: str
    """Name of the planner."""
    runs: int
    days: int
    """Simulated deliveries, and the days of the record they were flown on."""
    mean_s: Estimate
    p50_s: Estimate
    p95_s: Estimate
    """Delivery time of delivered runs."""
    flight_s: Estimate
    wait_s: Estimate
    recharge_s: Estimate
    """Its mean parts."""
    stranded: Estimate
    unflyable: Estimate
    gave_up: Estimate
    """Share of runs that ended so; see `planner.evaluation.flights`."""
    below_reserve: Estimate
    """Share of runs with a landing below the reserve (stranded runs among them)."""
    counts: dict[str, int]
    """Runs: ``delivered``, ``stranded``, ``unflyable``, ``gave_up``, ``below_reserve``."""
    calibration: tuple[tuple[float, Estimate], ...]
    """Probability promised on average of a deadline, and how often it was kept; empty without promises. Deadlines are
    the quantiles `planner.evaluation.flights.LEVELS` of what each plan promises."""
    calibration_error: Estimate
    """Mean absolute difference between both, 0 to 1."""
    regret: Estimate
    """Delivery time above that of the clairvoyant planner, as a share of it, over runs where both are known."""
    clairvoyant_runs: int
    """The number of those runs."""
    planning_s: tuple[float, ...]
    """Planning times of the plans behind the runs."""

    def summary(self) -> str:
        """Figures for people, a line each; times in minutes, intervals in brackets."""
        delivered = self.counts["delivered"]
        times_of = "" if delivered == self.runs else f", times of the {delivered:,} that arrived"
        lines = [f"{self.planner}: {self.runs:,} simulated deliveries on {counted(self.days, 'day')}{times_of}"]
        minutes = {
            "delivery mean": self.mean_s,
            "delivery p50": self.p50_s,
            "delivery p95": self.p95_s,
            "flight": self.flight_s,
            "waiting": self.wait_s,
            "recharge": self.recharge_s,
        }
        lines += [f"  {name:<16} {value.scaled(1.0 / S_PER_MIN).text('z.1f')} min" for name, value in minutes.items()]
        for name in ("stranded", "below_reserve", "unflyable", "gave_up"):
            rate: Estimate = getattr(self, name)
            label = name.replace("_", " ")
            lines.append(f"  {label:<16} {self.counts[name]} of {self.runs:,} ({rate.scaled(100.0).text('.2f')} %)")
        if self.calibration:
            error = self.calibration_error.scaled(100.0).text()
            lines.append(
                f"  {'promise off by':<16} {error} points on average (promised probability of a time, against the share delivered by then)"
            )
        if self.clairvoyant_runs:
            regret = self.regret.scaled(100.0).text()
            lines.append(f"  {'above clairvoyant':<17}{regret} % ({self.clairvoyant_runs} runs)")
        if self.planning_s:
            middle, most = 1000.0 * float(np.median(self.planning_s)), 1000.0 * max(self.planning_s)
            lines.append(f"  {'planning':<16} {middle:.1f} ms median, {most:.1f} ms at most")
        return "\n".join(lines)

    def document(self) -> dict[str, object]:
        """All figures for a JSON file, schema `SCHEMA`; times in seconds, unknown is None."""
        estimates = {name: value.document() for name, value in vars(self).items() if isinstance(value, Estimate)}
        return {
            "schema": SCHEMA,
            "planner": self.planner,
            "runs": self.runs,
            "days": self.days,
            "counts": self.counts,
            **estimates,
            "calibration": [{"promised": promised, **found.document()} for promised, found in self.calibration],
            "clairvoyant_runs": self.clairvoyant_runs,
            "planning_s": list(self.planning_s),
        }

    def to_json(self) -> str:
        """The document as text."""
        return json.dumps(self.document(), indent=1, allow_nan=False)


def evaluate(
    result: PlanResult,
    realizations: Realizations,
    *,
    clairvoyant_s: NDArray[np.float64] | None = None,
    seed: int = 0,
    workers: int = 1,
    cluster: str | None = None,
    told: Callable[[int, int, float], None] | None = None,
) -> Evaluation:
    """Fly a plan in realizations: unchanged, or, for ``robust``, with the charge decided at each stop.

    Parameters
    ----------
    result : PlanResult
        Of a planner that did not know the realizations.
    realizations : Realizations
        Of the same request.
    clairvoyant_s : ndarray, shape (runs,), optional
        See `clairvoyant_times`.
    seed : int
        Of the bootstrap.
    workers, cluster, told
        See `planner.evaluation.parts.fly_parts`: the figures do not depend on them.

    Raises
    ------
    InputError
        The plan's forecast contains a day of the realizations, they are of another request, or `clairvoyant_s` is of
        other runs.
    """
    check_same_request(realizations, result.problem.request)
    check_held_out(realizations, result.problem.ensemble)
    drone = result.composition.drone
    flying = result.itinerary if result.robust is None else result.robust.policy
    flown = fly_parts(realizations, drone, flying, workers=workers, cluster=cluster, told=told)
    flown = flown.judged(result.outcome, result.problem.depart_s)
    if clairvoyant_s is not None:
        check_shape("clairvoyant_s", clairvoyant_s, (len(realizations),))
        flown = replace(flown, clairvoyant_s=clairvoyant_s)
    replicates = result.problem.parameters.evaluation.replicates
    return summarise(result.composition.planner, flown, (result.planning_time_s,), seed=seed, replicates=replicates)


def summarise(
    planner: str, flown: Flown, planning_s: Sequence[float] = (), *, seed: int = 0, replicates: int = USUAL.replicates
) -> Evaluation:
    """Turn simulated deliveries into figures with intervals."""
    days = DayBootstrap(flown.block, seed=seed, replicates=replicates)
    counts = {"delivered": int((flown.ending == DELIVERED).sum())}
    counts |= {name: int((flown.ending == code).sum()) for name, code in _ENDINGS.items()}
    counts["below_reserve"] = int(flown.below_reserve.sum())
    regret, compared = Estimate(math.nan), 0
    if len(flown.clairvoyant_s):
        compared = int((np.isfinite(flown.clairvoyant_s) & flown.delivered).sum())
        found = days.ratio(flown.delivery_s, flown.clairvoyant_s)
        regret = Estimate(found.value - 1.0, found.low - 1.0, found.high - 1.0)
    calibration: tuple[tuple[float, Estimate], ...] = ()
    if len(flown.kept):
        promised = np.ascontiguousarray(flown.promised).mean(axis=0).tolist()  # summed alike, however it lies in memory
        calibration = tuple((level, days.rate(flown.kept[:, k])) for k, level in enumerate(promised))
    return Evaluation(
        planner=planner,
        runs=len(flown),
        days=len(days.days),
        mean_s=days.mean(flown.delivery_s),
        p50_s=days.quantile(flown.delivery_s, 0.5),
        p95_s=days.quantile(flown.delivery_s, 0.95),
        flight_s=days.mean(flown.flight_s),
        wait_s=days.mean(flown.wait_s),
        recharge_s=days.mean(flown.recharge_s),
        stranded=days.rate(flown.ending == STRANDED),
        unflyable=days.rate(flown.ending == UNFLYABLE),
        gave_up=days.rate(flown.ending == GAVE_UP),
        below_reserve=days.rate(flown.below_reserve),
        counts=counts,
        calibration=calibration,
        calibration_error=days.mean_error(flown.kept, flown.promised),
        regret=regret,
        clairvoyant_runs=compared,
        planning_s=tuple(planning_s),
    )


def clairvoyant_times(
    realizations: Realizations, drone: str, planner: str, runs: Sequence[int], *, time_limit_s: float = math.inf
) -> tuple[NDArray[np.float64], float, int]:
    """Delivery times of a planner that has perfect information of some runs: hourly wind and queues, not gusts.

    The planner is one of `planner.registry.CLAIRVOYANT_PLANNERS` (others are an `InputError`, and so is a run that is not
    there). Each plan is cut off after `time_limit_s`; it is no bound then and counts as unknown. Returns the delivery times, s, shape (runs of the realizations,), NaN where
    unknown or without a route; the planning time, s, all together; and how many plans were cut off.
    """
    if planner not in CLAIRVOYANT_PLANNERS:
        remedy = f"one of {', '.join(CLAIRVOYANT_PLANNERS)}"
        raise InputError(Fault("has no perfect information", field="planner", value=planner, remedy=remedy))
    absent = next((run for run in runs if not 0 <= run < len(realizations)), None)
    if absent is not None:
        raise InputError(Fault("no such run", field="runs", value=absent, remedy=f"0 to {len(realizations) - 1}"))
    found = np.full(len(realizations), np.nan)
    cut_off = 0
    started = time.perf_counter()
    for run in runs:
        request, wind = realizations.perfect_information(run)
        request = replace(request, drone=drone)
        try:
            result = plan(
                realizations.scenario, request, planner=planner, truth=wind, forecast=wind, time_limit_s=time_limit_s
            )
        except InfeasibleError:
            continue
        if result.complete:
            found[run] = result.outcome.mean_s - result.problem.depart_s
        else:
            cut_off += 1
    return found, time.perf_counter() - started, cut_off
