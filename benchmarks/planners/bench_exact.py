"""How fast `exact` plans: 100 to 10,000 stations, from the ground and in flight, to the end and at any time.

Times are processor time of the one thread that searches, so that other work on the machine does not count; compilation and
the making of the problem (wind over the segments, queues of all stations) are stated apart. Each request has another wind, a
day of the record.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cases.networks import geometric, random_pairs
from benchmarks.tables.figure import Figure
from skyway.models.base.errors import NoRouteError
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import State
from skyway.planner.drone_choice import candidates
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, SOC_TAKE_OFF, TAKE_OFF, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.models.queues.paths import QueuePath
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.schedule.itinerary import Itinerary

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)
SEED = 3
NEAR_M, FAR_M = (20_000.0, 60_000.0), (100_000.0, 200_000.0)
"""Straight distances of requests: those of one delivery, and of one that takes most of a day."""
TARGET_MS = {1_000: (100.0, 50.0), 10_000: (2000.0, 500.0)}
"""Must and aim for the p99, by stations."""
ANYTIME_S = 0.05
PADS = (1, 2, 5, 10, 20)


@dataclass(frozen=True)
class Trial:
    """One request: seconds to make the problem and to search, and what was found."""

    set_up_s: float
    search_s: float
    flights: int
    gap: float
    problem: Problem
    itinerary: Itinerary


class World:
    """A network with queues; what is sampled once serves all requests."""

    def __init__(self, stations: int, *, pads: int = 5, utilisation: float = 0.5) -> None:
        self.scenario: Scenario = geometric(stations, SEED, pads=pads, utilisation=utilisation)
        self.ensemble = self.scenario.forecast(DEPART, HORIZON_H)
        self.queues: dict[int, QueuePath] = {}
        self.queues_s = 0.0

    def requests(self, count: int, apart_m: tuple[float, float]) -> list[Request]:
        """Requests between random pairs of stations that far apart."""
        pairs = random_pairs(self.scenario.network, count, SEED, least_m=apart_m[0], most_m=apart_m[1])
        return [Request(state=State(DEPART, a), destination=b, payload_kg=0.8) for a, b in pairs]

    def solve(self, request: Request, day: int, *, time_limit_s: float = math.inf) -> Trial | None:
        """Time one search in the wind of one day of the record; None where there is no route."""
        started = time.thread_time()
        drone = candidates(self.scenario, request, {})[0]
        problem = Problem(self.scenario, request, drone, self.ensemble.member(day % len(self.ensemble.probability)))
        _ = problem.curves, problem.curve_of
        ready = time.thread_time()
        if not self.queues:
            self.queues = problem.queue_paths(range(len(problem.network)), 0)
            self.queues_s = time.thread_time() - ready
        begun = time.thread_time()
        search = ExactSearch(problem, self.queues, time_limit_s=time_limit_s)
        try:
            itinerary = search.solve()
        except NoRouteError:
            return None
        return Trial(ready - started, time.thread_time() - begun, len(itinerary), search.gap, problem, itinerary)

    def trials(self, count: int, apart_m: tuple[float, float], **how: float) -> list[Trial]:
        """Time searches, after one that compiles."""
        requests = self.requests(count, apart_m)
        self.solve(requests[0], 0, **how)
        return [trial for day, one in enumerate(requests) if (trial := self.solve(one, day, **how)) is not None]

    def replans(self, trials: list[Trial]) -> Iterator[Trial]:
        """Time replanning half-way along the first segment of each answer."""
        for day, trial in enumerate(trials):
            again = self.solve(replace(trial.problem.request, state=self._half_way(trial)), day)
            if again is not None:
                yield again

    def _half_way(self, trial: Trial) -> State:
        problem, leg = trial.problem, trial.itinerary[0]
        schedule = fly_true(problem, trial.itinerary, self.queues)[0][0]
        network = problem.network
        part = 0.5 * network.distance_m[leg.segments[0]] / network.distance_m[list(leg.segments)].sum()
        a, b = (
            network.stations[int(network.tail[leg.segments[0]])],
            network.stations[int(network.head[leg.segments[0]])],
        )
        when = schedule[TAKE_OFF] + part * (schedule[TOUCH_DOWN] - schedule[TAKE_OFF])
        soc = schedule[SOC_TAKE_OFF] + part * (schedule[SOC_LANDING] - schedule[SOC_TAKE_OFF])
        return State(from_posix(float(when)), None, (0.5 * (a.lat + b.lat), 0.5 * (a.lon + b.lon)), float(soc))


def _ms(trials: list[Trial], share: float) -> float:
    return 1000.0 * float(np.quantile([trial.search_s for trial in trials], share)) if trials else math.nan


def _summary(label: str, trials: list[Trial], targets: tuple[float, float] | None = None) -> list[Figure]:
    flights = [trial.flights for trial in trials]
    note = f"of {len(trials)} searches, {np.median(flights):.0f} flights in the median, {max(flights)} at most"
    must = None if targets is None else targets[0]
    aim = "" if targets is None else f"; aim {targets[1]:g} ms"
    return [
        Figure(f"exact, {label}: median", _ms(trials, 0.5), "ms", note=note),
        Figure(f"exact, {label}: p99", _ms(trials, 0.99), "ms", must, f"longest {_ms(trials, 1.0):.0f} ms{aim}"),
    ]


def _size(stations: int, count: int, far: int) -> list[Figure]:
    """Figures of one network."""
    world, label = World(stations), f"{stations:,} stations"
    begun = time.perf_counter()
    world.solve(world.requests(1, NEAR_M)[0], 0)
    first_s = time.perf_counter() - begun
    trials = world.trials(count, NEAR_M)
    figures = _summary(label, trials, TARGET_MS.get(stations))
    set_up = 1000.0 * float(np.median([trial.set_up_s for trial in trials]))
    figures.append(Figure(f"exact, {label}: set-up, median", set_up, "ms", note="segments, wind; not counted above"))
    sampling = "once for all requests; not counted above"
    figures.append(Figure(f"exact, {label}: sampling all queues", 1000.0 * world.queues_s, "ms", note=sampling))
    opening = "wall time with set-up and queues; compiles where nothing is cached"
    figures.append(Figure(f"exact, {label}: first call of this process", first_s, "s", note=opening))
    figures += _summary(f"{label}, in flight", list(world.replans(trials)), TARGET_MS.get(stations))
    if stations >= max(TARGET_MS):
        quick = world.trials(count, NEAR_M, time_limit_s=ANYTIME_S)
        gaps = 100.0 * np.array([trial.gap for trial in quick])
        name = f"exact, {label}, stopped after {1000 * ANYTIME_S:.0f} ms"
        figures.append(Figure(f"{name}: p99 of the time", _ms(quick, 0.99), "ms", 1000.0 * ANYTIME_S))
        note = f"{np.mean(gaps <= 0.0):.0%} proved best; mean {gaps.mean():.2g} %"
        figures.append(Figure(f"{name}: largest gap to its bound", float(gaps.max()), "%", note=note))
    if far:
        figures += _summary(f"{label}, 100 to 200 km", world.trials(far, FAR_M))
    return figures


def measure(*, count: int = 100, far: int = 0) -> list[Figure]:
    """Return figures at 100, 1,000 and 10,000 stations."""
    figures = []
    for stations in (100, 1_000, 10_000):
        figures += _size(stations, count, far if stations == max(TARGET_MS) else 0)
    return figures


def draw(folder: Path, *, count: int = 40) -> list[Path]:
    """Draw how planning time grows with stations and with pads; returns the files."""
    sizes = (50, 100, 300, 1_000, 3_000, 10_000)
    by_size = [World(size).trials(count, NEAR_M) for size in sizes]
    by_pads = [World(1_000, pads=pads, utilisation=0.7).trials(count, NEAR_M) for pads in PADS]
    folder.mkdir(parents=True, exist_ok=True)
    return [
        _curve(folder / "exact-stations.svg", sizes, by_size, "stations", "20 to 60 km, 5 pads, utilisation 0.5"),
        _curve(folder / "exact-pads.svg", PADS, by_pads, "pads of each station", "1,000 stations, utilisation 0.7"),
    ]


def _curve(path: Path, x: tuple[int, ...], trials: list[list[Trial]], what: str, title: str) -> Path:
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        canvas = Canvas(figsize=(7.0, 4.2), layout="constrained")
        axes: Any = canvas.subplots()
        for share, name in ((0.5, "median"), (0.9, "p90"), (1.0, "longest")):
            axes.plot(x, [_ms(some, share) for some in trials], marker="o", markersize=4, label=name)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(x, [f"{value:,}" for value in x])
        axes.minorticks_off()
        axes.set_xlabel(what)
        axes.set_ylabel("planning time of exact, ms")
        axes.set_title(title)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        canvas.savefig(path, format="svg", metadata={"Date": None})
    return path


def main(arguments: list[str] | None = None) -> int:
    """Print the figures, and draw the curves where a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="requests of each kind")
    parser.add_argument("--far", type=int, default=0, help="requests over 100 to 200 km besides")
    parser.add_argument("--out", type=Path, help="draw the curves into this folder")
    options = parser.parse_args(arguments)
    for figure in measure(count=options.count, far=options.far):
        print(figure.line(), flush=True)
    if options.out is not None:
        for path in draw(options.out):
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
