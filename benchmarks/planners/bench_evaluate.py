"""How long 10,000 simulated deliveries of one plan take, New York."""

from __future__ import annotations

import time
from datetime import UTC, datetime

from benchmarks.cases.networks import new_york
from benchmarks.tables.figure import Figure
from skyway.models.composition.composition import State
from skyway.planner.evaluation.evaluate import evaluate, held_out_forecast, sample_realizations, season_days
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request

RUNS = 10_000
TARGET_S = 2.0


def measure(runs: int = RUNS) -> list[Figure]:
    """Return the figures of three plans, of many and of few stops and with charges decided on the way; compiled before."""
    scenario = new_york()
    state = State(datetime(2013, 7, 10, 18, tzinfo=UTC), "siuh-north")
    request = Request(state=state, destination="white-plains", payload_kg=0.8, drone="m200")
    days = season_days(scenario, request, 12)
    forecast = held_out_forecast(scenario, request, days)
    figures = []
    for name in ("pfs", "pfs-charge-aware", "robust"):
        result = plan(scenario, request, planner=name, forecast=forecast)
        evaluate(result, sample_realizations(scenario, request, days, runs=len(days)))
        started, begun = time.perf_counter(), time.process_time()
        evaluate(result, sample_realizations(scenario, request, days, runs=runs))
        spent, worked = time.perf_counter() - started, time.process_time() - begun
        note = f"{name}, {len(result.itinerary)} flights, {len(days)} days; {worked:.2f} s of processor"
        figures.append(Figure(f"{runs:,} simulated deliveries of a plan", spent, "s", TARGET_S, note))
    return figures
