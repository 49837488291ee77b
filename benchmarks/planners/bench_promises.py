"""How far `robust` can be believed: promises of arrival and kept reserves on days that its forecast did not contain.

Many random requests in the built-in scenario, several held-out days each, few runs a day: what is unsure is the day, so
days count and not runs. A promise is the probability that a plan gives a deadline; deadlines are the quantiles of its own
arrival at `planner.evaluation.flights.LEVELS`. Intervals by block bootstrap over days of the record.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.loads import scaled_to
from benchmarks.cases.networks import new_york
from benchmarks.planners.bench_gap import DRONE, requests
from benchmarks.tables.arguments import real, whole
from benchmarks.tables.figure import Figure
from skyway.models.base.errors import InfeasibleError
from skyway.planner.evaluation.evaluate import (
    Flown,
    fly_charging,
    held_out_forecast,
    pooled,
    sample_realizations,
    season_days,
    summarise,
)
from skyway.planner.evaluation.flights import LEVELS
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.plan import plan
from skyway.planner.registry import ROBUST

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.request import Request

ERROR_TARGET = 3.0
"""Mean absolute error of promises that is allowed, points."""
BROKEN_TARGET, BROKEN_OF = 12.0, 20_000
"""Deliveries with a landing below the reserve that are allowed, of so many."""


@dataclass(frozen=True, eq=False)
class Kept:
    """What became of one request.

    Attributes
    ----------
    request : Request
        The request.
    flown : Flown
        Deliveries, judged by what was promised.
    promised_mean_s : float
        Delivery time promised on average.
    p_reserve : float
        Probability promised that every landing keeps the reserve.
    """

    request: Request
    flown: Flown
    promised_mean_s: float
    p_reserve: float

    def document(self) -> dict[str, object]:
        """One line of a file of results: counts by day, times in seconds."""
        state, flown = self.request.state, self.flown
        days = np.unique(flown.block)
        return {
            "origin": state.station,
            "destination": self.request.destination,
            "depart": state.time.isoformat(),
            "payload_kg": self.request.payload_kg,
            "promised_mean_s": self.promised_mean_s,
            "p_reserve": self.p_reserve,
            "promised": flown.promised[0].tolist(),
            "days": [
                {
                    "day": int(day),
                    "runs": int((flown.block == day).sum()),
                    "kept": flown.kept[flown.block == day].sum(axis=0).tolist(),
                    "below_reserve": int(flown.below_reserve[flown.block == day].sum()),
                }
                for day in days.tolist()
            ],
        }


def measured(world: Scenario, count: int, *, days: int, runs: int, seed: int) -> Iterator[Kept]:
    """Plan and fly so many random requests; those without a route are left out.

    Parameters
    ----------
    world : Scenario
        With a wind record.
    count, days, runs : int
        Requests, held-out days of each, deliveries a day.
    seed : int
        Of requests, days and truths.
    """
    for number, request in enumerate(requests(world, count, seed)):
        away = season_days(world, request, days, seed=seed + number)
        try:
            result = plan(world, request, planner=ROBUST, forecast=held_out_forecast(world, request, away))
        except InfeasibleError:
            continue
        assert result.robust is not None
        realizations = sample_realizations(world, request, away, runs=runs * len(away), seed=seed + number)
        flown = fly_charging(realizations, DRONE, result.robust.policy).judged(result.outcome, result.problem.depart_s)
        yield Kept(request, flown, result.outcome.mean_s - result.problem.depart_s, result.outcome.p_success)


def figures_of(found: list[Kept], world: str) -> list[Figure]:
    """Calibration of promises, and landings below the reserve, beside what is wanted."""
    whole = pooled([one.flown for one in found])
    told = summarise(ROBUST, whole)
    days = len(np.unique(whole.block))
    note = f"{world}, {len(found)} requests, {len(whole):,} deliveries, {days} days"
    error = told.calibration_error.scaled(100.0)
    broken = told.below_reserve.scaled(float(BROKEN_OF))
    of = f"of {BROKEN_OF:,}"
    return [
        Figure(
            "on-time promises, mean absolute error",
            error.value,
            "points",
            ERROR_TARGET,
            f"{note}, 95 %: {error.low:.1f} to {error.high:.1f}",
        ),
        Figure(
            "deliveries below the reserve",
            broken.value,
            of,
            BROKEN_TARGET,
            f"{told.counts['below_reserve']} in all, 95 %: {broken.low:.1f} to {broken.high:.1f}",
        ),
    ]


def table(found: list[Kept]) -> str:
    """What was promised beside what was kept, with bands, by level; and how far off a level alone would be."""
    whole = pooled([one.flown for one in found])
    told = summarise(ROBUST, whole)
    lines = ["  quantile   promised %   kept % [95 % over days]"]
    for level, (promised, kept) in zip(LEVELS, told.calibration, strict=True):
        lines.append(f"  {level:>8.2f}   {100 * promised:>10.1f}   {kept.scaled(100.0).text()}")
    blunt = DayBootstrap(whole.block).mean_error(whole.kept, _levels(whole)).scaled(100.0)
    lines.append(f"  error against the level of the quantile instead of what is promised: {blunt.text('.2f')} points")
    return "\n".join(lines)


def _levels(flown: Flown) -> NDArray[np.float64]:
    return np.broadcast_to(np.array(LEVELS), flown.kept.shape)


def loaded(utilisation: float) -> Scenario:
    """The built-in scenario, with its own load or, above 0, another mean utilisation of pads."""
    world = new_york()
    if utilisation <= 0.0:
        return world
    return replace(world, load=scaled_to(world.load, utilisation, world.network.pads))


def measure(count: int = 60) -> list[Figure]:
    """Return the figures in the built-in scenario as it stands."""
    return figures_of(list(measured(new_york(), count, days=6, runs=200, seed=5000)), "New York")


def main() -> int:
    """Measure from a command line; results are written as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=whole(1), default=300)
    parser.add_argument("--days", type=whole(1), default=6, help="held-out days of each request")
    parser.add_argument("--runs", type=whole(1), default=200, help="deliveries a day")
    parser.add_argument("--seed", type=whole(0), default=5000)
    parser.add_argument(
        "--utilisation",
        type=real(0.0, 0.99),
        default=0.0,
        help="mean utilisation of pads; 0: the scenario's own",
    )
    parser.add_argument("--out", type=Path, help="write counts to this file, one JSON document a request")
    options = parser.parse_args()
    found = []
    started = time.perf_counter()
    world = loaded(options.utilisation)
    for one in measured(world, options.requests, days=options.days, runs=options.runs, seed=options.seed):
        found.append(one)
        if options.out is not None:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(one.document()) + "\n")
    if not found:
        parser.exit(1, "none of the requests has a route\n")
    name = "New York" + (f" at {options.utilisation:g}" if options.utilisation else "")
    for figure in figures_of(found, name):
        print(figure.line())
    print(table(found))
    print(f"  {time.perf_counter() - started:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
