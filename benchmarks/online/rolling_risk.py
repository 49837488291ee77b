"""Probability of landing below the reserve with replanning at every stop: each flight is repeated in many gusts.

Such deliveries are rarer than one in a thousand, so that counting them takes tens of thousands. Instead each flight of a few
deliveries is repeated from its initial charge in other gusts; the sum of the shares over a
delivery is its mean number of landings below the reserve, an upper bound of the probability of one or more.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.instances import LONG_FILE, read_instance
from benchmarks.planners.trials import case_of
from benchmarks.tables.figure import Figure
from skyway.planner.evaluation.evaluate import fly_policy
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.problem.problem import Problem

if TYPE_CHECKING:
    from benchmarks.cases.instances import Instance
    from skyway.planner.evaluation.decisions import Again

OF = 20_000
"""Number of deliveries for which the figure is stated."""
ALLOWED = 12.0
FIRST = 40
"""Number of gusts in the first trial of a flight; one that lands `FAR` standard deviations above the reserve in
these is not tried in more."""
FAR = 6.5
SEED = 11


@dataclass
class Watch:
    """Repeats each flight, and adds up the shares that land below the reserve."""

    reserve: float
    gusts: int
    rng: np.random.Generator
    broken: float = 0.0
    flights: int = 0

    def __call__(self, flight: Again) -> None:
        """Process one flight."""
        keys = self.rng.integers(0, 2**63, self.gusts)
        spare = [flight.charge_left(int(key)) - self.reserve for key in keys[:FIRST]]
        if np.mean(spare) < FAR * np.std(spare):
            spare += [flight.charge_left(int(key)) - self.reserve for key in keys[FIRST:]]
        self.broken += float(np.mean(np.array(spare) < -1e-9))
        self.flights += 1


def measure(instance: Instance, gusts: int, runs: int = 1) -> list[Figure]:
    """Fly a number of runs of each delivery."""
    scenario = instance.scenario()
    broken, flights, days = [], 0, []
    for number, delivery in enumerate(instance.deliveries):
        case = case_of(scenario, instance, number, instance.runs)
        start = Problem(scenario, case.realizations.request, scenario.drone(instance.drone), case.forecast)
        watch = Watch(start.reserve, gusts, np.random.default_rng((SEED, number)))
        policy = RollingRobust(start, case.realizations.errors)
        fly_policy(case.realizations, instance.drone, policy, np.arange(runs), watch=watch)
        broken.append(watch.broken / runs)
        flights += watch.flights
        days.append(int(delivery.truth.replace("-", "")))
    rate = DayBootstrap(np.array(days)).ratio(np.array(broken), np.ones(len(broken))).scaled(OF)
    note = f"95 %: {rate.low:.1f} to {rate.high:.1f}, {flights} flights of {runs * len(broken)} deliveries in {gusts} gusts each"
    return [Figure(f"landings below the reserve in {OF:,} deliveries", rate.value, "", ALLOWED, note)]


def main() -> int:
    """Measure from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instance", type=Path, default=LONG_FILE)
    parser.add_argument("--deliveries", type=int, default=10**6, help="number of deliveries, from the first on")
    parser.add_argument("--runs", type=int, default=1, help="of each delivery")
    parser.add_argument("--gusts", type=int, default=600, help="that each flight is flown in")
    options = parser.parse_args()
    instance = read_instance(options.instance)
    for figure in measure(instance.cut(options.deliveries, instance.runs), options.gusts, options.runs):
        print(figure.line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
