"""Comparison of plans of the same orders and drones with one package per flight and as tours: orders served in time, energy, flight time, drones."""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from benchmarks.fleet.bench_city import city
from benchmarks.tables.arguments import real, whole
from skyway.models.orders.fitting import Work, fit
from skyway.models.orders.order import Order, Vehicle
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.tours.plan import plan_tours

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.dispatch.result import DispatchPlan

START = datetime(2013, 7, 10, 14, tzinfo=UTC)
HOME = "bellevue"
NAMES = ("served in time", "energy for each, Wh", "flying for each, min", "drones that leave")


def one_station(seed: int, drones: int, orders: int, utilisation: float) -> Work:
    """Return orders of an hour that all begin at one station of New York, where all drones stand, to any of the 15 nearest stations."""
    scenario = city(seed, 1, 1, utilisation, START).scenario
    network, rng = scenario.network, np.random.default_rng(seed)
    home = next(one for one in network.stations if one.id == HOME)
    near = sorted(network.stations, key=lambda one: np.hypot(one.lat - home.lat, (one.lon - home.lon) * np.cos(np.radians(home.lat))))[1:16]  # fmt: skip
    vehicles = [
        Vehicle(id=f"d{one}", type="m200", home=HOME, place=HOME, soc=float(rng.uniform(0.6, 1.0)))
        for one in range(drones)
    ]
    made = []
    for one in range(orders):
        ready = START + timedelta(minutes=float(rng.uniform(0.0, 60.0)))
        due = ready + timedelta(minutes=float(rng.choice([120.0, 150.0, 180.0])))
        end = near[int(rng.integers(len(near)))].id
        made.append(
            Order(
                id=f"o{one}",
                origin=HOME,
                destination=end,
                mass_kg=float(rng.choice([0.2, 0.3, 0.5])),
                ready=ready,
                due=due,
            )
        )
    return fit(scenario, made, vehicles)


def figures_of(plan: DispatchPlan) -> NDArray[np.float64]:
    """Return the values of `NAMES`."""
    flown_s = sum((one.end - one.begin).total_seconds() for route in plan.routes for one in route.steps if one.kind == "fly")  # fmt: skip
    served = plan.served
    in_time = served - plan.late
    return np.array([in_time, plan.energy_j / 3600.0 / max(served, 1), flown_s / 60.0 / max(served, 1), len(plan.routes)])  # fmt: skip


def main() -> None:
    """Print a line for each figure: both means, and the mean difference with its 95 % interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drones", type=whole(1), default=6)
    parser.add_argument("--orders", type=whole(1), default=24)
    parser.add_argument("--utilisation", type=real(0.0, 0.99), default=0.3, help="of the pads, by strangers")
    parser.add_argument("--iterations", type=whole(0), default=300)
    parser.add_argument("--draws", type=whole(2), default=6)
    options = parser.parse_args()
    found, spent_s = [], np.zeros(2)
    for seed in range(options.draws):
        work = one_station(seed, options.drones, options.orders, options.utilisation)
        forecast = work.scenario.forecast(START, 48)
        begun = time.process_time()
        single = dispatch(work, START, forecast=forecast, time_limit_s=1e4, iterations=options.iterations)
        between = time.process_time()
        several = plan_tours(work, START, forecast=forecast, time_limit_s=1e4, iterations=options.iterations)
        spent_s += between - begun, time.process_time() - between
        found.append([figures_of(single), figures_of(several)])
    table = np.array(found)
    print(
        f"{options.draws} draws of {options.drones} drones and {options.orders} orders at {HOME}, strangers at {options.utilisation:g}"
    )
    for number, name in enumerate(NAMES):
        alone, together = table[:, 0, number], table[:, 1, number]
        apart = together - alone
        error = student.ppf(0.975, len(apart) - 1) * apart.std(ddof=1) / np.sqrt(len(apart))
        print(
            f"{name:<22} one package a flight {alone.mean():6.2f}, tours {together.mean():6.2f}, difference {apart.mean():+.2f} ± {error:.2f}"
        )
    print(f"processor for each plan: {spent_s[0] / options.draws:.1f} s and {spent_s[1] / options.draws:.1f} s")


if __name__ == "__main__":
    main()
