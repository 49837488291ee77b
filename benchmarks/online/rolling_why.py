"""Loss of replanning at every stop against perfect information, and the part due to each unknown.

The same deliveries are flown again by the same rules with perfect information about the wind, the queues, or both; and in
realizations without gusts and errors of the vehicle's energy, which the clairvoyant `exact` does not consider either. A further result is
a bound for policies that complete each flight: the time of `exact` with perfect information about wind and queues, which lands with the least charge
that must be reserved for unpredictable gusts.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.instances import LONG_FILE, read_instance
from benchmarks.planners.trials import Case, case_of
from benchmarks.tables.figure import Figure
from benchmarks.tables.lines import Row, append, missing, read
from skyway.planner.evaluation.evaluate import NO_ERRORS, fly_policy
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.online.turn_back import USUAL_FLIGHT_S
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.charge_policy import known_at
from skyway.planner.robust.uncertain_wind_kernels import careful_speeds, gust_mean
from skyway.planner.schedule.gust_kernels import LATERAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from benchmarks.cases.instances import Instance
    from skyway.models.queues.paths import QueuePath
    from skyway.planner.online.information import Information
    from skyway.planner.robust.information_kernels import Known

NOTHING, QUEUES, WIND, BOTH = "nothing", "queues", "wind", "both"
REVEALED = (NOTHING, QUEUES, WIND, BOTH)
BOUND = "exact, least reserve for gusts"
"""Name of the bound in the file of results."""
DEVIATIONS = (1.0, 2.0, 3.1)
"""Deviations of the mean gust of a flight that `exact` must also bear; the last is exceeded once in a thousand."""


class InformedProblem(Problem):
    """A problem whose queues are the true ones, except for the queue in which the drone stands."""

    revealed: dict[int, QueuePath]

    def queue_sets(
        self,
        nodes: Iterable[int],
        samples: Sequence[int],
        seed: int | None = None,
        until_s: float = math.inf,
        among: Sequence[int] = (),
    ) -> list[dict[int, QueuePath]]:
        """Return the true queues."""
        mine = None if self.in_flight else self.origin
        return [
            {node: path if node == mine else self.revealed.get(node, path) for node, path in sampled.items()}
            for sampled in super().queue_sets(nodes, samples, seed, until_s, among)
        ]


class InformedPolicy(OnlinePolicy):
    """The online policy with perfect information about the queues."""

    queues: dict[int, QueuePath]

    def problem(self, info: Information) -> Problem:
        """The rest of the delivery, with the true queues."""
        plain = super().problem(info)
        now = InformedProblem(plain.scenario, plain.request, plain.drone, info.forecast)
        now.revealed = self.queues
        return now


@dataclass(frozen=True)
class InformedRolling(RollingRobust):
    """`RollingRobust` with perfect information about the queues."""

    queues: dict[int, QueuePath] = field(default_factory=dict)

    @cached_property
    def policy(self) -> InformedPolicy:
        """The policy that is flown."""
        found = InformedPolicy(self.start.scenario, self.start.request, self.start.parameters, errors=self.errors)
        found.queues = self.queues
        return found


def fly_informed(case: Case, revealed: str) -> float:
    """Delivery time of the first run, s, of the rolling horizon with perfect information about something; NaN if not delivered."""
    realizations, drone = case.realizations, case.instance.drone
    forecast = realizations.wind.member(int(realizations.day[0])) if revealed in (WIND, BOTH) else case.forecast
    start = Problem(case.scenario, realizations.request, case.scenario.drone(drone), forecast)
    policy = RollingRobust(start, realizations.errors)
    if revealed in (QUEUES, BOTH):
        problem = realizations.problem(drone)
        nodes = np.flatnonzero(problem.network.pads > 0).tolist()
        policy = InformedRolling(
            start, realizations.errors, queues=realizations.queues(problem, nodes, int(realizations.queue[0]))
        )
    return float(fly_policy(realizations, drone, policy, np.array([0]))[0].delivery_s[0])


def _all_revealed(case: Case) -> tuple[Problem, dict[int, QueuePath], Known]:
    """The first run of a delivery with perfect information: its wind, its queues, and its gusts."""
    request, wind = case.realizations.perfect_information(0)
    p = Problem(case.scenario, request, case.scenario.drone(case.instance.drone), wind)
    known = known_at(p, case.realizations.errors, measured=True, epsilon=p.epsilon)
    return p, p.queue_paths(range(len(p.network)), 0), known


def clairvoyant_and_bound(case: Case) -> tuple[float, float]:
    """Delivery times, s: of `exact` with perfect information about wind and queues, and of the same with the least reserve for gusts.

    A flight that begins with the information available, and does not turn back, must land with the reserve in all but epsilon of its
    gusts. To first order a gust of the mean g slows a flight by at least `LATERAL` times g, whatever its course; the mean varies least over the longest flight
    that the battery allows, and as a share of the ground speed it is least with a tail wind. With the least wind of any site
    in any slot up to some time that is a bound for all that arrive by then; later arrivals are above it anyway.
    """
    p, queues, known = _all_revealed(case)
    share = NormalDist().inv_cdf(1.0 - p.epsilon) * LATERAL * float(gust_mean(known, p.longest_flight_s))
    calmest = np.hypot(p.air.north[0], p.air.east[0]).min(axis=1)

    def arrival_s(margin_soc_per_s: float) -> float:
        search = ExactSearch(p, queues, margin_soc_per_s=margin_soc_per_s)
        return search.best_s if search.find() is not None else math.inf

    def with_reserve_s(until_s: float) -> float:
        slots = 1 + int(min((until_s - p.air.start_s) / p.air.slot_s, len(calmest)))
        wind_mps = float(calmest[:slots].min())
        return arrival_s(p.soc_per_s * share * wind_mps / (p.air.airspeed_mps + wind_mps))

    best = arrival_s(0.0)
    if best == math.inf:
        return math.nan, math.nan
    until = with_reserve_s(best)
    return best - p.depart_s, min(with_reserve_s(until), until) - p.depart_s


def bearing_gusts(case: Case) -> Row:
    """Delivery times, s, of `exact` with perfect information about wind and queues, in ground speeds with a mean gust of some deviations against each flight."""
    p, queues, known = _all_revealed(case)
    gust = float(gust_mean(known, USUAL_FLIGHT_S))
    slots, segments = np.arange(p.air.north.shape[1]), np.arange(len(p.air.distance_m))
    found: Row = {}
    for deviations in DEVIATIONS:
        search = ExactSearch(p, queues, speeds=careful_speeds(p.air, 0, slots, segments, deviations * gust))
        arrival = search.best_s if search.find() is not None else math.inf
        found[f"exact, gusts of {deviations:g} deviations"] = arrival - p.depart_s
    return found


def run(instance: Instance, path: Path, part: tuple[int, int] = (0, 1)) -> None:
    """Fly the deliveries that are not yet in a file of results: one line per delivery."""
    scenario = instance.scenario()
    for number in missing(path, len(instance.deliveries), part):
        gusty = case_of(scenario, instance, number, instance.runs)
        still = case_of(scenario, replace(instance, errors=NO_ERRORS), number, instance.runs)
        best, bound = clairvoyant_and_bound(gusty)
        row: Row = {"number": number, "day": instance.deliveries[number].truth, "exact": best, BOUND: bound}
        row |= bearing_gusts(gusty)
        realizations = {"gusts": gusty, "no gusts": still}
        row |= {
            f"told {revealed}, {name}": fly_informed(case, revealed)
            for name, case in realizations.items()
            for revealed in REVEALED
        }
        plain = {key: None if isinstance(one, float) and not math.isfinite(one) else one for key, one in row.items()}
        append(path, plain)


def figures_of(rows: Sequence[Row]) -> list[Figure]:
    """Mean excess of each over the planner with perfect information, percent, over deliveries that arrive in all."""
    names = [name for name in rows[0] if name not in ("number", "day", "exact")]
    whole = [row for row in rows if all(row[name] is not None for name in (*names, "exact"))]
    day = np.array([int(row["day"].replace("-", "")) for row in whole])
    best = np.array([row["exact"] for row in whole])
    found = []
    for name in names:
        times = np.array([row[name] for row in whole])
        ratio = DayBootstrap(day).ratio(times, best).scaled(100.0)
        each = 100.0 * (np.median(times / best) - 1.0)
        note = f"95 %: {ratio.low - 100.0:.1f} to {ratio.high - 100.0:.1f}, median {each:.1f}, {len(whole)} deliveries"
        found.append(Figure(f"{name}: above exact", ratio.value - 100.0, "%", None, note))
    return found


def main() -> int:
    """Measure from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instance", type=Path, default=LONG_FILE)
    parser.add_argument("--out", type=Path, default=Path("out/bench/rolling-why.jsonl"), help="what is in it is kept")
    parser.add_argument("--part", default="0/1", help="k/n: every n-th delivery from the k-th on, for n processes")
    parser.add_argument("--deliveries", type=int, default=10**6, help="number of deliveries, from the first on")
    options = parser.parse_args()
    instance = read_instance(options.instance)
    instance = instance.cut(options.deliveries, instance.runs)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    first, _, parts = options.part.partition("/")
    run(instance, options.out, (int(first), int(parts)))
    for figure in figures_of(read(options.out)):
        print(figure.line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
