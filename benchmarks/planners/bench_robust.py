"""How fast `robust` plans, with 30 members of the forecast, and how that grows with stations, members and pads.

A request counts whole: the problem made (wind over the segments, a drone in the air joined to the network), waits and queues
forecast for the stations that the search touches, routes, out-of-sample simulations, calibration, the typical schedule. Each station has a load of
its own, so that no forecast serves two of them. Set-up, once for a network, is stated apart: how the wind's sites weigh on each
segment. Kernels are compiled before. Times are processor time of the one thread that plans; wall time stands beside it.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.planners.bench_exact import DEPART, NEAR_M, PADS, SEED, World
from benchmarks.tables.figure import Figure
from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.planner.drone_choice import candidates
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import Problem
from skyway.planner.problem.request import Request
from skyway.planner.robust.robust import RobustSearch

if TYPE_CHECKING:
    from skyway.planner.robust.robust import RobustAnswer

TARGET_MS = {1_000: (500.0, 250.0), 10_000: (3000.0, 1000.0)}
"""Must and aim for the p99, by stations."""
STATIONS = (50, 100, 200, 300, 1_000, 3_000, 10_000)
GROWTH = (5, 10, 20, 30, 45, 61)
"""Members."""
SPREAD = 0.1
"""The load of each station is up to this share more or less than that of its profile."""


class Timed:
    """One request: seconds of processor and wall that it took, and the answer."""

    def __init__(self, world: World, request: Request, members: int) -> None:
        ensemble = world.ensemble.thinned(members)
        drone = candidates(world.scenario, request, {})[0]
        begun, wall = time.thread_time(), time.perf_counter()
        parameters = replace(USUAL, robust=replace(USUAL.robust, members=members))
        self.problem = Problem(world.scenario, request, drone, ensemble, parameters=parameters)
        self.answer: RobustAnswer = RobustSearch(self.problem).solve()
        self.spent_s, self.wall_s = time.thread_time() - begun, time.perf_counter() - wall


def world_of(stations: int, *, pads: int = 5, utilisation: float = 0.5) -> tuple[World, float]:
    """A network whose stations have loads of their own, set up; and the seconds of processor that took."""
    world = World(stations, pads=pads, utilisation=utilisation)
    load = world.scenario.load
    share = 1.0 + SPREAD * np.random.default_rng((SEED, stations)).uniform(-1.0, 1.0, (stations, 1))
    world.scenario = replace(world.scenario, load=replace(load, arrivals_per_s=load.arrivals_per_s * share))
    begun = time.thread_time()
    world.scenario.network.site_weights(world.ensemble.site_lat, world.ensemble.site_lon)
    return world, time.thread_time() - begun


def _trials(world: World, requests: list[Request], members: int = USUAL.robust.members) -> list[Timed]:
    """Time requests, after one that loads the kernels."""
    found = []
    for number, request in enumerate([requests[0], *requests]):
        try:
            timed = Timed(world, request, members)
        except NoRouteError:
            continue
        if number:
            found.append(timed)
    return found


def _quantile_ms(trials: list[Timed], share: float, *, wall: bool = False) -> float:
    return 1000.0 * float(np.quantile([one.wall_s if wall else one.spent_s for one in trials], share))


def _in_flight(trials: list[Timed]) -> list[Request]:
    """Requests from half-way along the first segment of each answer, with the charge that is left there."""
    found = []
    for trial in trials:
        network, leg = trial.problem.network, trial.answer.policy.itinerary[0]
        a, b = (network.stations[int(end[leg.segments[0]])] for end in (network.tail, network.head))
        state = State(DEPART, None, (0.5 * (a.lat + b.lat), 0.5 * (a.lon + b.lon)), 0.8)
        found.append(Request(state=state, destination=trial.problem.request.destination, payload_kg=0.8))
    return found


def _figures(label: str, trials: list[Timed], targets: tuple[float, float] | None) -> list[Figure]:
    must, aim = targets if targets is not None else (None, None)
    flights = [len(one.answer.policy.itinerary) for one in trials]
    note = f"of {len(trials)} requests, longest {_quantile_ms(trials, 1.0):.0f} ms, {np.mean(flights):.1f} flights in the mean"
    note += "" if aim is None else f"; aim {aim:g} ms"
    return [
        Figure(f"{label}: median", _quantile_ms(trials, 0.5), "ms"),
        Figure(f"{label}: p99", _quantile_ms(trials, 0.99), "ms", must, note),
        Figure(f"{label}: p99, wall", _quantile_ms(trials, 0.99, wall=True), "ms", note="whatever else ran"),
    ]


def measure(*, count: int = 100) -> list[Figure]:
    """Return figures at 100, 1,000 and 10,000 stations; a third of `count` requests at the largest."""
    figures = []
    for stations in (100, 1_000, 10_000):
        (world, set_up_s), label = world_of(stations), f"robust, {stations:,} stations"
        requests = world.requests(count if stations < 10_000 else max(count // 3, 1), NEAR_M)
        trials, targets = _trials(world, requests), TARGET_MS.get(stations)
        figures += _figures(label, trials, targets)
        figures += _figures(f"{label}, in flight", _trials(world, _in_flight(trials)), targets)
        note = "once for a network and its wind sites; not counted above"
        figures.append(Figure(f"{label}: set-up", 1000.0 * set_up_s, "ms", note=note))
    return figures


def draw(folder: Path, *, count: int = 40) -> Path:
    """Draw how planning time grows with stations, members of the forecast and pads; returns the file."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    by_stations, by_members, by_pads = [], [], []
    for stations in STATIONS:
        world, _ = world_of(stations)
        by_stations.append(_trials(world, world.requests(count, NEAR_M)))
        if stations == 1_000:
            by_members = [_trials(world, world.requests(count, NEAR_M), members) for members in GROWTH]
    for pads in PADS:
        world, _ = world_of(1_000, pads=pads, utilisation=0.7)
        by_pads.append(_trials(world, world.requests(count, NEAR_M)))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "robust-growth.svg"
    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        canvas = Canvas(figsize=(10.5, 3.8), layout="constrained")
        panels: Any = canvas.subplots(1, 3, sharey=True)
        _curve(panels[0], STATIONS, by_stations, "stations")
        _curve(panels[1], GROWTH, by_members, "members of the forecast (1,000 stations)")
        _curve(panels[2], PADS, by_pads, "pads of each station (1,000, utilisation 0.7)")
        panels[0].set_ylabel("planning time of robust, ms")
        panels[0].legend(fontsize=8)
        canvas.savefig(path, format="svg", metadata={"Date": None})
    return path


def _curve(axes: Any, x: tuple[int, ...], trials: list[list[Timed]], what: str) -> None:
    for share, name in ((0.5, "median"), (0.9, "p90"), (1.0, "longest")):
        axes.plot(x, [_quantile_ms(some, share) for some in trials], marker="o", markersize=4, label=name)
    axes.set_xscale("log")
    axes.set_xticks(x, [f"{value:,}" for value in x], fontsize=8)
    axes.minorticks_off()
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(what)
    axes.grid(alpha=0.3)


def main() -> int:
    """Print the figures, or draw the curves where a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="requests of each kind")
    parser.add_argument("--draw", type=Path, help="draw the curves into this folder instead")
    options = parser.parse_args()
    if options.draw is not None:
        print(draw(options.draw))
        return 0
    for figure in measure(count=options.count):
        print(figure.line(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
