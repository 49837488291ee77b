"""How planning grows with density: 250 to 2,000 stations on a square of 60 km, beside as many on a square that grows with them.

A request counts whole, as `skyway.plan` answers it: the problem, queues of the stations that the search meets, search,
simulations, audit. Each leaves at another hour of 2013, in the forecast of that hour, with queues and pads of its own; the
truth of the clairvoyant planners is a member of it. What is worked out once for a network and its wind sites is not counted.
Times are processor time of the one thread that plans, and so are time limits. networkx finds the shortest way by distance on the same network
(Dijkstra), without wind, battery, pads or queues: the peer that ratios are of.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING
from unittest import mock

import numpy as np

from benchmarks.cases.networks import dense, geometric, random_pairs
from benchmarks.tables.figure import Figure
from benchmarks.tables.memory import peak_memory_mb
from skyway.models.base.errors import InfeasibleError
from skyway.models.composition.composition import State
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.registry import CLAIRVOYANT_PLANNERS

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.scenario.scenario import Scenario

SEED = 29
NEAR_M = 20_000.0, 60_000.0
PAYLOADS_KG = 0.2, 0.8, 1.4
PLANNED = ("exact", "robust")
OTHERS = ("shortest", "pfs", "pfs-charge-aware")
TARGET_MS = {1_000: 500.0, 2_000: 1500.0}
"""For the p99, by stations on 60 km."""
ANYTIME_S, ANYTIME_MS = 0.1, 250.0
"""Time limit, and by when there must be an answer with its gap; what is on the way then still has to be flown and audited."""
MEMORY_MB = 500.0
RATIO = 10.0
"""Median of exact over that of networkx on the same network, at most."""
GROWTH = (250, 500, 1_000, 2_000)


@dataclass(frozen=True)
class Trial:
    """One request: processor time, the mean delivery time, how good that is at least, and whether it was cut off."""

    spent_s: float
    takes_s: float
    complete: bool
    notes: tuple[str, ...]


def requests(scenario: Scenario, count: int) -> list[Request]:
    """Requests between random pairs of stations, at random hours, with random payloads."""
    rng = np.random.default_rng((SEED, count))
    pairs = random_pairs(scenario.network, count, SEED, least_m=NEAR_M[0], most_m=NEAR_M[1])
    hours = rng.integers(0, 24 * 364, len(pairs)).tolist()
    return [
        Request(
            state=State(datetime(2013, 1, 1, tzinfo=UTC) + timedelta(hours=hour), a),
            destination=b,
            payload_kg=float(rng.choice(PAYLOADS_KG)),
            seed=number,
        )
        for number, ((a, b), hour) in enumerate(zip(pairs, hours, strict=True))
    ]


def trials(scenario: Scenario, planner: str, asked: list[Request], time_limit_s: float = math.inf) -> list[Trial]:
    """Time a planner on requests, after the first once, which loads the kernels; those without a route are left out."""
    found = []
    for number, request in enumerate([asked[0], *asked]):
        forecast = scenario.forecast(request.state.time, HORIZON_H)
        scenario.network.site_weights(forecast.site_lat, forecast.site_lon)
        truth = forecast.member(number % len(forecast.probability)) if planner in CLAIRVOYANT_PLANNERS else None
        begun = time.thread_time()
        try:
            with mock.patch("time.perf_counter", time.thread_time):  # as on a machine that has nothing else to do
                result = plan(
                    scenario, request, planner=planner, forecast=forecast, truth=truth, time_limit_s=time_limit_s
                )
        except InfeasibleError:
            continue
        spent = time.thread_time() - begun
        takes = result.outcome.mean_s - request.state.time.timestamp()
        if number:
            found.append(Trial(spent, takes, result.complete, result.composition.notes))
    return found


def networkx_s(scenario: Scenario, asked: list[Request]) -> float:
    """Median processor time of networkx for the shortest way by distance, s."""
    import networkx as nx

    graph, spent = scenario.network.graph, []
    for request in asked[:20]:
        begun = time.thread_time()
        nx.dijkstra_path(graph, request.state.station, request.destination, weight="distance_m")
        spent.append(time.thread_time() - begun)
    return float(np.median(spent))


def _ms(found: list[Trial], share: float) -> float:
    return 1000.0 * float(np.quantile([one.spent_s for one in found], share)) if found else math.nan


def _figures(label: str, found: list[Trial], asked: int, target_ms: float | None) -> list[Figure]:
    note = f"of {len(found)} requests ({asked - len(found)} without a route), longest {_ms(found, 1.0):.0f} ms"
    return [
        Figure(f"{label}: median", _ms(found, 0.5), "ms"),
        Figure(f"{label}: p99", _ms(found, 0.99), "ms", target_ms, note),
    ]


def peak_mb(planner: str, stations: int, count: int) -> float:
    """Peak memory of a process that plans requests, the making of the network included, MB."""
    done = subprocess.run(
        [sys.executable, "-m", __spec__.name, "--peak", planner, "--stations", str(stations), "--count", str(count)],
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout.split()[-1])


def measure(*, count: int = 200, memory: int = 20, sizes: tuple[int, ...] = (1_000, 2_000)) -> list[Figure]:
    """Return figures of dense networks."""
    figures = []
    for stations in sizes:
        scenario, label = dense(stations, SEED), f"{stations:,} stations on 60 km"
        asked = requests(scenario, count)
        medians = {}
        for planner in PLANNED:
            found = trials(scenario, planner, asked)
            medians[planner] = _ms(found, 0.5)
            figures += _figures(f"{planner}, {label}", found, count, TARGET_MS.get(stations))
        for planner in OTHERS:
            figures += _figures(f"{planner}, {label}", trials(scenario, planner, asked[:40]), min(count, 40), None)
        peer = 1000.0 * networkx_s(scenario, asked)
        figures.append(Figure(f"networkx, shortest by distance, {label}: median", peer, "ms"))
        figures.append(Figure(f"exact over networkx, {label}", medians["exact"] / peer, "", RATIO, "medians"))
        for planner in PLANNED:
            found = trials(scenario, planner, asked, ANYTIME_S)
            name = f"{planner}, {label}, limit {1000 * ANYTIME_S:.0f} ms"
            figures += _figures(name, found, count, ANYTIME_MS if stations == min(TARGET_MS) else None)
            share = 100.0 * float(np.mean([not one.complete for one in found])) if found else math.nan
            figures.append(Figure(f"{name}: cut off, told with their gap", share, "%"))
            figures.append(
                Figure(f"{planner}, {label}: peak memory", peak_mb(planner, stations, memory), "MB", MEMORY_MB)
            )
    return figures


def growth(*, count: int = 40) -> list[Figure]:
    """Return how planning grows with density, beside how it grows with area."""
    figures = []
    worlds: dict[str, Callable[[int, int], Scenario]] = {"on 60 km": dense, "at one density": geometric}
    for stations in GROWTH:
        for where, world in worlds.items():
            scenario = world(stations, SEED)
            asked = requests(scenario, count)
            for planner in PLANNED:
                label = f"{planner}, {stations:,} stations {where}, {len(scenario.network.head):,} segments"
                figures += _figures(label, trials(scenario, planner, asked), count, None)
    return figures


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="requests of each kind")
    parser.add_argument("--stations", type=int, nargs="*", default=[1_000, 2_000])
    parser.add_argument("--growth", action="store_true", help="growth with density and with area instead")
    parser.add_argument("--peak", metavar="PLANNER", help="print the peak memory of this planner instead, MB")
    options = parser.parse_args()
    if options.peak is not None:
        scenario = dense(options.stations[0], SEED)
        trials(scenario, options.peak, requests(scenario, options.count))
        print(peak_memory_mb())
        return 0
    found = (
        growth(count=options.count) if options.growth else measure(count=options.count, sizes=tuple(options.stations))
    )
    for figure in found:
        print(figure.line(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
