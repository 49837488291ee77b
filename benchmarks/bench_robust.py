"""How fast `robust` plans, with 30 members of the forecast; how that grows with members; and how much it promises.

Times are processor time of the one thread that searches; compilation, the laying of the wind over the segments and the
forecasts of all stations' waits are set-up, stated apart.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.bench_exact import DEPART, NEAR_M, World
from benchmarks.figure import Figure
from models.errors import NoRouteError
from models.services import State
from planner.plan import candidates
from planner.problem import Problem
from planner.request import Request
from planner.robust import MEMBERS, RobustSearch

if TYPE_CHECKING:
    from planner.robust import RobustAnswer

TARGET_MS = {1_000: (500.0, 250.0), 10_000: (3000.0, 1000.0)}
"""Must and aim for the p99, by stations."""
GROWTH = (5, 10, 20, 30, 45, 61)


class Timed:
    """One search: seconds of set-up and of the search, and the answer."""

    def __init__(self, world: World, request: Request, members: int) -> None:
        started = time.thread_time()
        drone = candidates(world.scenario, request, {})[0]
        problem = Problem(world.scenario, request, drone, world.ensemble.thinned(members))
        problem.waits.need(np.arange(len(problem.network)))
        begun = time.thread_time()
        self.problem = problem
        self.set_up_s = begun - started
        self.answer: RobustAnswer = RobustSearch(problem, members=members).solve()
        self.search_s = time.thread_time() - begun


def _trials(world: World, requests: list[Request], members: int = MEMBERS) -> list[Timed]:
    found = []
    for request in [requests[0], *requests]:
        try:
            found.append(Timed(world, request, members))
        except NoRouteError:
            continue
    return found[1:]


def _quantile_ms(trials: list[Timed], share: float) -> float:
    return 1000.0 * float(np.quantile([one.search_s for one in trials], share))


def _in_flight(world: World, trials: list[Timed]) -> list[Timed]:
    """The same half-way along the first segment of each answer, with the charge that is left there."""
    found = []
    for trial in trials:
        network, hop = trial.problem.network, trial.answer.policy.itinerary[0]
        a, b = (network.stations[int(end[hop.segments[0]])] for end in (network.tail, network.head))
        state = State(DEPART, None, (0.5 * (a.lat + b.lat), 0.5 * (a.lon + b.lon)), 0.8)
        request = Request(state=state, destination=trial.problem.request.destination, payload_kg=0.8)
        try:
            found.append(Timed(world, request, MEMBERS))
        except NoRouteError:
            continue
    return found


def measure(*, count: int = 40) -> list[Figure]:
    """Return figures at 100, 1,000 and 10,000 stations."""
    figures = []
    for stations in (100, 1_000, 10_000):
        world, label = World(stations), f"robust, {stations:,} stations"
        trials = _trials(world, world.requests(count if stations < 10_000 else count // 4, NEAR_M))
        must, aim = TARGET_MS.get(stations, (None, None))
        note = f"of {len(trials)} searches" + ("" if aim is None else f"; aim {aim:g} ms")
        figures.append(Figure(f"{label}: median", _quantile_ms(trials, 0.5), "ms"))
        figures.append(Figure(f"{label}: p99", _quantile_ms(trials, 0.99), "ms", must, note))
        set_up = 1000.0 * float(np.median([one.set_up_s for one in trials]))
        figures.append(
            Figure(f"{label}: set-up, median", set_up, "ms", note="wind, waits of all stations; not counted above")
        )
        flying = _in_flight(world, trials[: max(count // 4, 1)])
        figures.append(
            Figure(f"{label}, in flight: p99", _quantile_ms(flying, 0.99), "ms", must, f"of {len(flying)} searches")
        )
    return figures


def draw(folder: Path, *, count: int = 12) -> Path:
    """Draw how planning time grows with the members of the forecast; returns the file."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "robust-members.svg"
    with mpl.rc_context({"svg.hashsalt": "skyway", "svg.fonttype": "none"}):
        canvas = Canvas(figsize=(7.0, 4.2), layout="constrained")
        axes: Any = canvas.subplots()
        for stations in (100, 1_000):
            world = World(stations)
            requests = world.requests(count, NEAR_M)
            times = [_quantile_ms(_trials(world, requests, members), 0.5) for members in GROWTH]
            axes.plot(GROWTH, times, marker="o", markersize=4, label=f"{stations:,} stations, median")
        axes.set_xlabel("members of the forecast")
        axes.set_ylabel("planning time of robust, ms")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        canvas.savefig(path, metadata={"Date": None})
    return path


def main() -> int:
    """Draw the curve from a command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draw", type=Path, default=Path("out/bench"), help="folder for the curve")
    print(draw(parser.parse_args().draw))
    return 0


if __name__ == "__main__":
    sys.exit(main())
