"""The paper's experiment: PFS against IES on networks of 5 to 40 nodes, execution time and delivery time.

As printed: as many runs as half the nodes, random pairs, DJI M200 V2 at 81 km/h, 5 pads at each station, the exhaustive
search with perfect information. The paper says neither how its networks are joined nor how busy they are, nor the wind, nor any
figure of its results: we strew the nodes over a square that grows with their number, join those within 12 km, take the
wind of New York 2013 and a pad utilisation of 0.7, and compare shapes. All planners are flown through the same truth.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from datetime import UTC, date, datetime, timedelta
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.loads import scaled_to
from benchmarks.cases.networks import CENTRE, new_york, random_pairs
from skyway.models.base.errors import InfeasibleError, InputError
from skyway.models.composition.composition import State
from skyway.models.compute.spreading import spread
from skyway.models.drones.drone import M200_V2
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.result import PlanResult

NODES = (5, 10, 15, 20, 25, 30, 35, 40)
PLANNERS = ("pfs-strict", "pfs", "pfs-charge-aware", "ies")
SEGMENT_M, NEIGHBOURS = 12_000.0, 6.0
AIRSPEED_MPS = 22.5
PAYLOAD_KG = 0.8
UTILISATION = 0.7
DRONE = replace(M200_V2, max_ground_speed_mps=1e3)
"""The paper's drone: no limit to its ground speed is printed."""
SOLVED, CUT_OFF, NO_ROUTE = "solved", "cut-off", "no-route"


@dataclass(frozen=True)
class PaperRun:
    """One planner on one request of the experiment.

    Attributes
    ----------
    nodes, run : int
        Size of the network, number of the run.
    origin, destination, day : str
        The request, and the local date whose wind is the truth.
    planner, status : str
        ``solved``, ``cut-off`` (by the time limit: what stands here is the best found, perhaps not the best) or
        ``no-route``.
    execution_s : float
        Wall time of the search.
    delivery_s : float or None
        Delivery time in the truth; None without an answer.
    below_reserve : bool
        A landing in the truth was below the reserve.
    """

    nodes: int
    run: int
    origin: str
    destination: str
    day: str
    planner: str
    status: str
    execution_s: float
    delivery_s: float | None
    below_reserve: bool

    def document(self) -> dict[str, object]:
        """The run for a JSON file."""
        return asdict(self)


def paper_network(nodes: int, seed: int) -> Scenario:
    """One network of the experiment."""
    rng = np.random.default_rng((seed, nodes, 1))
    side_m = math.sqrt(nodes * math.pi * SEGMENT_M**2 / NEIGHBOURS)
    north, east = rng.uniform(-0.5, 0.5, (2, nodes)) * side_m
    placed = [
        Station(
            f"n{k}",
            f"Node {k}",
            CENTRE[0] + float(north[k]) / 111_045.0,
            CENTRE[1] + float(east[k]) / 84_400.0,
            0.0,
        )
        for k in range(nodes)
    ]
    network = build_network(placed, ConnectionRule("max-length", SEGMENT_M))
    base = new_york()
    row = rng.integers(0, len(base.load), nodes)
    load = PadLoad(base.load.arrivals_per_s[row], base.load.mean_charging_s[row], base.load.timezone)
    load = scaled_to(load, UTILISATION, network.pads)
    return replace(
        base, name=f"paper-{nodes}", network=network, drones=(DRONE,), load=load, path=None, sha256=None, warnings=()
    )


def run_experiment(
    nodes: Sequence[int],
    *,
    seed: int = 0,
    time_limit_s: float = 5.0,
    runs: Callable[[int], int] = lambda nodes: nodes // 2,
    planners: Sequence[str] = PLANNERS,
    progress: Callable[[str], None] = lambda _: None,
    parameters: PlannerParameters = USUAL,
    workers: int = 1,
    cluster: str | None = None,
) -> list[PaperRun]:
    """Run all sizes.

    Parameters
    ----------
    nodes : sequence of int
        Sizes.
    seed : int
        Of networks, pairs, days and queues.
    time_limit_s : float
        Of each exhaustive search.
    runs : callable
        Number of runs by size; half the nodes by default.
    planners : sequence of str
        Names of planners.
    progress : callable
        Told in words how far it is.
    workers, cluster
        See `skyway.models.compute.spreading.spread`.
    """
    done: list[PaperRun] = []
    for size in nodes:
        scenario = _network(size, seed)
        rng = np.random.default_rng((seed, size, 2))
        pairs = random_pairs(scenario.network, runs(size), seed)
        asked = [Asked(number, pair, _day(scenario, rng)) for number, pair in enumerate(pairs)]
        started = time.perf_counter()
        common = (size, seed, tuple(planners), time_limit_s, parameters)
        found = spread(run_one, asked, common=common, workers=workers, cluster=cluster)
        done += [run for several in found for run in several]
        progress(f"paper's experiment, {size} nodes: {len(pairs)} runs in {time.perf_counter() - started:.0f} s")
    return done


@dataclass(frozen=True)
class Asked:
    """One request of the experiment: its number, its ends, and the day of its truth."""

    number: int
    pair: tuple[str, str]
    day: date


def run_one(common: tuple[int, int, tuple[str, ...], float, PlannerParameters], asked: Asked) -> list[PaperRun]:
    """Run all planners on one request; `common` is size, seed, planners, time limit and parameters."""
    size, seed, planners, time_limit_s, parameters = common
    if not _ready:
        _ready.append(True)
        first = _request(_network(4, seed), ("n0", "n1"), date(2013, 7, 10), 0)
        _run(4, 0, first, planners, 1.0, parameters)  # compiles
    what = _request(_network(size, seed), asked.pair, asked.day, seed + asked.number)
    return _run(size, asked.number, what, planners, time_limit_s, parameters)


_ready: list[bool] = []
_network = lru_cache(maxsize=2)(paper_network)


def _day(scenario: Scenario, rng: np.random.Generator) -> date:
    """A day of the record without a gap."""
    while True:
        day = date(2013, 1, 2) + timedelta(days=int(rng.integers(0, 360)))
        try:
            scenario.truth(day, _depart(day), HORIZON_H)
        except InputError:
            continue
        return day


def _depart(day: date) -> datetime:
    return datetime(day.year, day.month, day.day, 15, tzinfo=UTC)


def _request(scenario: Scenario, pair: tuple[str, str], day: date, seed: int) -> tuple[Scenario, Request, date]:
    request = Request(
        state=State(_depart(day), pair[0]),
        destination=pair[1],
        payload_kg=PAYLOAD_KG,
        airspeed_mps=AIRSPEED_MPS,
        recharge="full",
        seed=seed,
    )
    return scenario, request, day


def _run(
    size: int,
    number: int,
    what: tuple[Scenario, Request, date],
    planners: Sequence[str],
    time_limit_s: float,
    parameters: PlannerParameters,
) -> list[PaperRun]:
    scenario, request, day = what
    forecast = scenario.forecast(request.state.time, HORIZON_H, truth=day)
    truth = scenario.truth(day, request.state.time, HORIZON_H)
    runs = []
    for name in planners:
        begun = time.perf_counter()
        status, delivery_s, below = SOLVED, None, False
        try:
            result = plan(
                scenario, request, planner=name, forecast=forecast, truth=truth, time_limit_s=time_limit_s,
                parameters=parameters,
            )  # fmt: skip
        except InfeasibleError as error:
            spent = time.perf_counter() - begun
            status = CUT_OFF if name == "ies" and spent >= time_limit_s else NO_ROUTE
            status = CUT_OFF if error.constraint == "time-limit" else status
        else:
            spent = result.planning_time_s
            status = SOLVED if result.complete else CUT_OFF
            truly = Problem(result.problem.scenario, result.problem.request, result.problem.drone, truth)
            delivery_s, below = _flown(truly, result)
        ends = (request.state.station or "", request.destination, day.isoformat())
        runs.append(PaperRun(size, number, *ends, name, status, spent, delivery_s, below))
    return runs


def _flown(truly: Problem, result: PlanResult) -> tuple[float | None, bool]:
    """Delivery time of an itinerary in the truth, and whether a landing was below the reserve."""
    queues = truly.queue_paths(range(len(truly.network)), 0)
    schedule = fly_true(truly, result.itinerary, queues)[0]
    landed = schedule[:, TOUCH_DOWN]
    below = bool((schedule[np.isfinite(landed), SOC_LANDING] < truly.reserve - 1e-9).any())
    return (float(landed[-1] - truly.depart_s) if math.isfinite(landed[-1]) else None), below


@dataclass(frozen=True)
class PaperRow:
    """One planner at one size: means, and what they leave out.

    Attributes
    ----------
    nodes, planner, runs
        Which, and of how many runs.
    solved, cut_off, no_route : int
        Runs by status.
    execution_s : float
        Mean over all runs; with runs cut off it is a lower bound (they would have taken longer).
    delivery_s : float or None
        Mean over the requests that every planner solved and no search was cut off on.
    compared : int
        The number of those requests.
    """

    nodes: int
    planner: str
    runs: int
    solved: int
    cut_off: int
    no_route: int
    execution_s: float
    delivery_s: float | None
    compared: int


def rows(runs: Sequence[PaperRun]) -> list[PaperRow]:
    """Means by size and planner; delivery times over requests that all planners solved."""
    found = []
    for size in sorted({run.nodes for run in runs}):
        here = [run for run in runs if run.nodes == size]
        names = list(dict.fromkeys(run.planner for run in here))
        judged = [name for name in names if name != "pfs-strict"]
        common = set.intersection(*({r.run for r in here if r.planner == name and _whole(r)} for name in judged))
        for name in names:
            mine = [run for run in here if run.planner == name]
            times = [run.delivery_s for run in mine if run.run in common and _whole(run)]
            known = [value for value in times if value is not None]
            count = {status: sum(run.status == status for run in mine) for status in (SOLVED, CUT_OFF, NO_ROUTE)}
            spent = float(np.mean([run.execution_s for run in mine]))
            mean = float(np.mean(known)) if known else None
            solved, cut_off, no_route = (count[status] for status in (SOLVED, CUT_OFF, NO_ROUTE))
            found.append(PaperRow(size, name, len(mine), solved, cut_off, no_route, spent, mean, len(known)))
    return found


def _whole(run: PaperRun) -> bool:
    return run.status == SOLVED and run.delivery_s is not None
