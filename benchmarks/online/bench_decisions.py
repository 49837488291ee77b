"""Computing time of decisions during a delivery in a dense city: 1,000 stations on a square of 60 km.

Each trial is the first leg of a plan of `robust`, at an hour, in a forecast, with its own queues. Decisions are made at its start, before take-off, and three times
on the way, with charges from the expected one down to insufficient ones: with too little charge every station inside the fence is evaluated. A decision is timed as a whole,
as in a flight: the forecast is updated with winds measured on the way (`update_forecast`), then the policy decides. Times are processor time
of the one thread that decides. The reference for ratios is networkx: the shortest path by distance on the same network (Dijkstra).
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.cases.networks import dense
from benchmarks.planners.bench_dense import networkx_s, requests
from benchmarks.tables.figure import Figure
from skyway.models.base.errors import InfeasibleError
from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.online.options import along_way
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.problem import HORIZON_H

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.forecast import WindEnsemble

SEED, STATIONS, TRIALS = 23, 1_000, 40
SHARES = 0.2, 0.5, 0.8
"""Shares of the leg flown at the decisions."""
SHORT_SOC = 0.0, 0.05, 0.15
"""Charge missing against the plan."""
MEASURED_S = 150.0
TARGET_MS = 250.0
"""Target for the 99th percentile of a decision in the air, ms."""


def measure(trials: int = TRIALS) -> list[Figure]:
    """Time decisions on the ground and in the air."""
    scenario = dense(STATIONS, SEED)
    rng = np.random.default_rng(SEED)
    given = requests(scenario, trials)
    ground: list[float] = []
    calm: list[float] = []
    danger: list[float] = []
    for number, request in enumerate([given[0], *given]):
        forecast = scenario.forecast(request.state.time, HORIZON_H)
        try:
            found = plan(scenario, request, planner="robust", forecast=forecast)
        except InfeasibleError:
            continue
        first, drone = found.composition.services[0], found.problem.drone
        policy = OnlinePolicy(scenario, replace(request, drone=drone.id))
        belief = USUAL_ERRORS.energy_of(drone)
        known = Information(
            time_s=request.state.time.timestamp(), soc=1.0, forecast=forecast, belief=belief, station=request.state.station,
            plan=found.composition,
        )  # fmt: skip
        begun = time.thread_time()
        decision = policy.on_ground(known, tell=True)
        spent = time.thread_time() - begun
        if number:
            ground.append(spent)
        names = (first.origin, *first.via, first.destination)
        way = [
            (float(scenario.network.stations[k].lat), float(scenario.network.stations[k].lon))
            for k in map(scenario.network.index.__getitem__, names)
        ]
        length_m = first.distance_m
        off_s = first.depart.timestamp()
        for share in SHARES:
            for short in SHORT_SOC:
                time_s = off_s + share * first.flight_time_s
                here = along_way(way, share * length_m)
                gone = [along_way(way, share * part * length_m) for part in (0.25, 0.5, 0.75, 1.0)]
                wind = _mean_wind(forecast) + rng.normal(0.0, 1.5, (len(gone), 2))
                seen = [
                    WindObservation(
                        time_s - MEASURED_S * (len(gone) - 1 - k),
                        gone[k][0],
                        gone[k][1],
                        float(wind[k, 0]),
                        float(wind[k, 1]),
                        1.0,
                        forecast.height_m,
                    )
                    for k in range(len(gone))
                ]
                soc = first.soc_depart - share * (first.soc_depart - first.soc_arrive) - short
                begun = time.thread_time()
                now = update_forecast(forecast, seen, slot_s=600.0, field=scenario.field_error, here=here)
                decided = policy.in_air(
                    Information(
                        time_s=time_s, soc=max(soc, 0.02), forecast=now, belief=belief, here=here, via=first.via, destination=first.destination,
                        diverts=decision.diverts, sudden=True, flight=FlightMemory(),
                    )
                )  # fmt: skip
                spent = time.thread_time() - begun
                if number:
                    (danger if decided.action in ("divert", "land") or "options" in decided.figures else calm).append(
                        spent
                    )
    peer_ms = 1000.0 * networkx_s(scenario, given)
    return [
        *_figures("on the ground", ground, peer_ms, None),
        *_figures("in the air", calm + danger, peer_ms, TARGET_MS),
        *_figures("in the air, where stations are compared", danger, peer_ms, None),
    ]


def _mean_wind(forecast: WindEnsemble) -> NDArray[np.float64]:
    return np.array([forecast.north[:, 0].mean(), forecast.east[:, 0].mean()])


def _figures(name: str, spent: list[float], peer_ms: float, target_ms: float | None) -> list[Figure]:
    ms = 1000.0 * np.array(spent)
    note = (
        f"of {len(ms)}, longest {ms.max():.0f} ms; median {np.median(ms) / peer_ms:.1f} times that of networkx"
        if len(ms)
        else "none"
    )
    return [
        Figure(f"{name}: median", float(np.median(ms)), "ms"),
        Figure(f"{name}: p99", float(np.quantile(ms, 0.99)), "ms", target_ms, note),
    ]
