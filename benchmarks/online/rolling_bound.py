"""What every policy loses because it does not know the wind and the queues: a lower bound for the rolling horizon in truths without gusts.

``python -m benchmarks.online.rolling_bound``. A planner is told everything, but late: the queues when it has flown its first segment, the
winds of all hours when it has flown the second one or landed between (information relaxation: D. Brown, J. Smith, P. Sun, "Information
relaxations and duality in stochastic dynamic programs", Operations Research 58 (2010)). In these truths the wind of a site
changes with the hour, and that of this hour is measured at all sites at the departure: so within the hour nothing that a policy sees
tells it more about the wind, and as long as both segments are flown in it no policy does better. A take-off is tried every ten minutes of
the hour (then all is told after the first segment), and at the end of the hour with everything known. What the planner expects is the
forecast as the rolling horizon has it there: its members, with their weights after the measurement, and queues that may follow from the
pads that are busy now. The best that follows is that of `exact`.

It is a bound as far as the forecast tells the truth: for policies that take off at one of these times, and do nothing after which one of the
futures has no way that keeps the reserve (a future weighs a hundredth, and one flight in a thousand may break it). The minimum over noisy means is below the
minimum of the means, so the noise of the futures makes it lower.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.cases.instances import LONG_FILE, read_instance
from benchmarks.planners.trials import case_of
from benchmarks.tables.figure import Figure
from benchmarks.tables.lines import Row, append, missing, read
from skyway.planner.evaluation.evaluate import NO_ERRORS, fly_policy
from skyway.planner.evaluation.statistics import DayBootstrap
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.problem.flight_table import FlightTable, ground_speeds, table_land
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.sampled_queues import SampledQueues
from skyway.planner.problem.speeds import TrueSpeeds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from benchmarks.cases.instances import Instance
    from benchmarks.planners.trials import Case
    from skyway.planner.evaluation.policies import Standing
    from skyway.planner.online.information import Departure, Information

WINDS, QUEUES = 16, 6
"""Members, drawn evenly by weight, and sets of queues, each with each."""
DELAY_S = 600.0


class Aloft(NamedTuple):
    """A drone over a node, as if it had taken off there: time and charge set back by a climb."""

    node: int
    off_s: float
    soc: float


class _AskedError(Exception):
    """The first decision has been asked for."""


class _Asking(RollingRobust):
    """A rolling horizon that only tells what it knows at the departure."""

    def leave(self, standing: Standing) -> Departure | None:
        """Raise with what is known."""
        raise _AskedError(self.information(standing))


def first_problem(case: Case) -> Problem:
    """The delivery as the rolling horizon knows it at its departure, after the measurement, in the first run."""
    start = Problem(case.scenario, case.realizations.request, case.scenario.drone(case.instance.drone), case.forecast)
    policy = _Asking(start, case.realizations.errors)
    try:
        fly_policy(case.realizations, case.instance.drone, policy, np.array([0]))
    except _AskedError as told:
        info: Information = told.args[0]
        return policy.policy.problem(info)
    raise AssertionError("the policy was not asked")


@dataclass(frozen=True)
class Relaxed:
    """A delivery whose wind and queues are told late."""

    problem: Problem

    @cached_property
    def members(self) -> list[int]:
        """Members of the forecast."""
        share = np.cumsum(self.problem.probability) / self.problem.probability.sum()
        return [int(one) for one in np.searchsorted(share, (np.arange(WINDS) + 0.5) / WINDS)]

    @cached_property
    def queues(self) -> list[SampledQueues]:
        """Sets of queues."""
        every = range(QUEUES)
        return [SampledQueues(self.problem, number, every) for number in every]

    @cached_property
    def hour_s(self) -> float:
        """End of the hour, POSIX seconds."""
        air, depart_s = self.problem.air, self.problem.depart_s
        return float(air.start_s + air.slot_s * (math.floor((depart_s - air.start_s) / air.slot_s + 1e-9) + 1))

    def arrivals(self, start: Problem) -> NDArray[np.float64]:
        """Arrival of the best delivery from a state with all known, POSIX seconds, shape (winds, queues)."""
        return np.array([[self._arrival(start, member, one) for one in self.queues] for member in self.members])

    def _arrival(self, start: Problem, member: int, queues: SampledQueues) -> float:
        search = ExactSearch(start, queues, speeds=TrueSpeeds(start.air, member))
        return search.best_s if search.find() is not None else math.inf

    @cached_property
    def best(self) -> NDArray[np.float64]:
        """The same from the departure."""
        return self.arrivals(self.problem)

    def flown(self, begin: Aloft, segment: int, member: int) -> Aloft | None:
        """The drone after a segment; none where it cannot be flown."""
        p = self.problem
        table = self._table(segment, member)
        down = float(table_land(table, np.zeros(1, dtype=np.int64), begin.off_s))
        if not down < 1e17:  # `models.flight.kernels.NEVER`
            return None
        cruise_s = down - begin.off_s - p.air.climb_s - p.air.descent_s
        return Aloft(int(p.network.head[segment]), begin.off_s + cruise_s, begin.soc - p.soc_per_s * cruise_s)

    def _table(self, segment: int, member: int) -> FlightTable:
        air, way, alone = self.problem.air, np.array([segment]), np.zeros(1, dtype=np.int64)
        speeds = ground_speeds(air, member, np.arange(air.north.shape[1]), way)
        return FlightTable(
            air.start_s, air.slot_s, air.climb_s, air.descent_s, alone, alone, air.distance_m[way], speeds
        )

    def landed(self, over: Aloft, queues: SampledQueues) -> tuple[float, float]:
        """Time and charge of a landing where it is; with less than the reserve it does not land."""
        p = self.problem
        down = over.off_s + p.air.climb_s + p.air.descent_s
        if over.node != p.destination:
            down = float(queues[over.node].land_time(down))
        soc = over.soc - p.soc_fixed - p.soc_per_s * (down - over.off_s)
        return (down, soc) if soc >= p.reserve else (math.inf, soc)

    def after(self, over: Aloft | None, wind: int, queue: int) -> float:
        """Arrival of a drone that is over a node and knows all; infinite where no way keeps the reserve."""
        p, queues, known = self.problem, self.queues[queue], float(self.best[wind, queue])
        if over is None:
            return math.inf
        if over.node == p.destination:
            found = self.landed(over, queues)[0]
        else:
            found = self._arrival(p.standing_at(*over, in_flight=True), self.members[wind], queues)
        return max(found, known)

    def after_landing(self, over: Aloft, wind: int, queue: int) -> float:
        """The same of a drone that lands where it is."""
        p, queues, known = self.problem, self.queues[queue], float(self.best[wind, queue])
        down, soc = self.landed(over, queues)
        if over.node != p.destination and math.isfinite(down):
            down = self._arrival(p.standing_at(over.node, down, soc), self.members[wind], queues)
        return max(down, known)

    def out_of(self, node: int) -> list[int]:
        """Segments that lead away from a node."""
        return [int(one) for one in np.flatnonzero(self.problem.network.tail == node)]

    def told_after_one(self, segment: int, off_s: float) -> float:
        """Mean arrival if all is told over the end of the first segment, POSIX seconds."""
        p = self.problem
        over = [self.flown(Aloft(p.origin, off_s, p.soc), segment, member) for member in self.members]
        return float(
            np.mean([[self.after(one, wind, queue) for queue in range(QUEUES)] for wind, one in enumerate(over)])
        )

    def told_after_two(self, segment: int) -> float:
        """Mean arrival if there only the queues are told, and the winds after a second segment or a landing."""
        p = self.problem
        over = [self.flown(Aloft(p.origin, p.depart_s, p.soc), segment, member) for member in self.members]
        node = int(p.network.head[segment])
        return float(np.mean([min(self._next(over, node, queue)) for queue in range(QUEUES)]))

    def _next(self, over: Sequence[Aloft | None], node: int, queue: int) -> Iterator[float]:
        """Mean arrival over the winds for each thing that can be done over a node."""
        p = self.problem
        may_land = node == p.destination or p.has_pads(node)
        for way in [*([None] if may_land else []), *(self.out_of(node) if node != p.destination else [])]:
            times = []
            for wind, one in enumerate(over):
                if one is None or one.off_s + p.air.climb_s >= self.hour_s:
                    times.append(self.after(one, wind, queue))
                elif way is None:
                    times.append(self.after_landing(one, wind, queue))
                else:
                    times.append(self.after(self.flown(one, way, self.members[wind]), wind, queue))
            yield float(np.mean(times))

    def bound_s(self) -> float:
        """No policy expects a shorter delivery than this, s."""
        p = self.problem
        best = float(np.maximum(self.arrivals(p.standing_at(p.origin, self.hour_s, p.soc)), self.best).mean())
        first = {segment: self.told_after_one(segment, p.depart_s) for segment in self.out_of(p.origin)}
        for segment in sorted(first, key=first.__getitem__):
            if first[segment] < best:  # all that begins with it is above it
                best = min(best, self.told_after_two(segment))
        off_s = p.depart_s + DELAY_S
        while off_s < self.hour_s and off_s - p.depart_s + float(self.best.mean()) < best:
            best = min(best, *(self.told_after_one(segment, off_s) for segment in first))
            off_s += DELAY_S
        return best - p.depart_s


def run(instance: Instance, path: Path, part: tuple[int, int] = (0, 1)) -> None:
    """Bound the deliveries that are not yet in a file of results: one line per delivery."""
    scenario = instance.scenario()
    for number in missing(path, len(instance.deliveries), part):
        case = case_of(scenario, instance, number, 1)
        relaxed = Relaxed(first_problem(case))
        if not np.isfinite(relaxed.best).all():
            continue
        row: Row = {"number": number, "day": instance.deliveries[number].truth}
        row |= {"best": float(relaxed.best.mean()) - relaxed.problem.depart_s, "bound": relaxed.bound_s()}
        append(path, row)


def figures_of(rows: Sequence[Row]) -> list[Figure]:
    """How far the bound lies above perfect information, percent."""
    day = np.array([int(row["day"].replace("-", "")) for row in rows])
    best, bound = (np.array([row[name] for row in rows]) for name in ("best", "bound"))
    ratio = DayBootstrap(day).ratio(bound, best).scaled(100.0)
    note = f"95 %: {ratio.low - 100.0:.1f} to {ratio.high - 100.0:.1f}, median {100.0 * (np.median(bound / best) - 1.0):.1f}, {len(rows)} deliveries"
    return [Figure("every policy loses at least, against exact", ratio.value - 100.0, "%", None, note)]


def main() -> int:
    """Measure from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instance", type=Path, default=LONG_FILE)
    parser.add_argument("--out", type=Path, default=Path("out/bench/rolling-bound.jsonl"), help="what is in it is kept")
    parser.add_argument("--part", default="0/1", help="k/n: every n-th delivery from the k-th on, for n processes")
    parser.add_argument("--deliveries", type=int, default=10**6, help="number of deliveries, from the first on")
    options = parser.parse_args()
    instance = replace(read_instance(options.instance), errors=NO_ERRORS).cut(options.deliveries, 1)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    first, _, parts = options.part.partition("/")
    run(instance, options.out, (int(first), int(parts)))
    for figure in figures_of(read(options.out)):
        print(figure.line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
