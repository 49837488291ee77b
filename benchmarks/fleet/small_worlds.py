"""Small dispatch problems in whole minutes: random places, legs, drones and orders, without a scenario."""

from __future__ import annotations

import numpy as np

from skyway.planner.dispatch.problem import DispatchProblem, Fleet, Flights, Orders, Weights, escapes, to_go

STEP_S = 600.0
LEVELS = 10


def small_world(
    seed: int, drones: int = 3, orders: int = 5, stations: int = 4, pads: int = 1, horizon: int = 40, due: int = 8
) -> DispatchProblem:
    """Return a problem in steps of 10 minutes and tenths of a battery; a step on a pad charges a tenth."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 3.0, (stations, 2))
    far = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    steps = np.maximum(np.round(far), 1).astype(int)  # a flight of one step takes 2 levels empty, 3 loaded
    time_s = np.where(np.eye(stations) > 0, np.inf, steps * STEP_S)
    time_s[steps > 3] = np.inf
    mode_time = np.stack([time_s, time_s])[:, None]
    need = np.stack([steps * 2, steps * 3]) / LEVELS
    need = np.where(np.isfinite(mode_time[:, 0]), need, np.inf)[:, None]
    stops = np.arange(stations)
    reserve = 0.0
    flights = Flights(
        time_s=mode_time, need=need,
        to_go_s=to_go(mode_time, need, stops, LEVELS * STEP_S, 1.0 - reserve),
        escape=escapes(need, stops), start_s=0.0, slot_s=1e9,
        pads=np.full(stations, pads), first_pad=np.arange(stations) * pads, stops=stops,
        curve_of=np.zeros((1, stations), dtype=np.int64),
        curve_s=np.array([[0.0, LEVELS * STEP_S]]), curve_soc=np.array([[0.0, 1.0]]), pace_s=np.array([LEVELS * STEP_S]),
        wait_s=np.zeros((stations, 1)), wait_step_s=1e9, reserve=reserve,
    )  # fmt: skip
    home = rng.integers(stations, size=drones)
    fleet = Fleet(
        type=np.zeros(drones, dtype=np.int64), empty_mode=np.zeros(drones, dtype=np.int64), place=home.copy(), home=home,
        soc=rng.integers(3, LEVELS + 1, drones) / LEVELS, from_s=np.zeros(drones), to_s=np.full(drones, np.inf), scale=np.ones(drones),
    )  # fmt: skip
    origin = rng.integers(stations, size=orders)
    ready = rng.integers(0, horizon // 2, orders)
    destination = (origin + rng.integers(1, stations, orders)) % stations
    due_s = ((ready + rng.integers(3, due + 1, orders)) * STEP_S).astype(np.float64)
    made = Orders(
        origin=origin, destination=destination,
        ready_s=(ready * STEP_S).astype(np.float64), due_s=due_s,
        refusal_s=(86_400.0 * 8.0 ** rng.integers(0, 2, orders)).astype(np.float64), mode=np.ones((1, orders), dtype=np.int64),
        latest_s=due_s + 3 * STEP_S,
    )  # fmt: skip
    return DispatchProblem(flights, fleet, made, Weights(10.0, 600.0, 0.0))
