"""Planning time of a fleet over its size, and time of one change: an additional order in an existing plan."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks.fleet.bench_city import START, city
from skyway.planner.dispatch.dispatch import dispatch

if TYPE_CHECKING:
    from skyway.models.orders.fitting import Work

HOURS, ORDERS = 9.0, 1.5
"""Hours over which orders arrive, and orders for each drone."""
CHANGE_S = 0.7
"""Limit of time for a change; the plan is then still written out."""


def spread(work: Work, hours: float) -> Work:
    """Spread orders of an hour over some hours."""
    orders = []
    for one in work.orders:
        later = (one.ready - START) * (hours - 1.0)
        orders.append(replace(one, ready=one.ready + later, due=one.due + later))
    return replace(work, orders=tuple(orders))


def main() -> None:
    """Print the curve."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drones", type=int, nargs="+", default=[500, 1000, 2000, 5000, 10_000])
    parser.add_argument("--utilisation", type=float, default=0.3, help="of the pads, by strangers")
    parser.add_argument("--seconds", type=float, default=15.0, help="for first routes and their betterment")
    options = parser.parse_args()
    dispatch(city(2, 3, 3, options.utilisation), START, iterations=1, time_limit_s=1.0)  # compiles the kernels
    for drones in options.drones:
        work = spread(city(1, drones, round(ORDERS * drones) + 1, options.utilisation), HOURS)
        forecast = work.scenario.forecast(START, 48)
        before = replace(work, orders=work.orders[:-1])
        begun, used = time.perf_counter(), time.process_time()
        plan = dispatch(before, START, forecast=forecast, time_limit_s=options.seconds)
        whole_s, whole_used_s = time.perf_counter() - begun, time.process_time() - used
        kept = {route.drone: route.steps for route in plan.routes}
        promised = {one.order: one.delivered for one in plan.answers if one.delivered is not None}
        begun, used = time.perf_counter(), time.process_time()
        after = dispatch(
            work, START, forecast=forecast, time_limit_s=CHANGE_S, iterations=0, kept=kept, promised=promised, bounded=False,
        )  # fmt: skip
        change_s, change_used_s = time.perf_counter() - begun, time.process_time() - used
        print(
            f"{drones:>6} drones, {len(before.orders):>6} orders: planned in {whole_s:.1f} s ({whole_used_s:.1f} s of a processor), {plan.served} served, {plan.iterations} iterations; "
            f"one order more {change_s:.2f} s ({change_used_s:.2f} s), {after.served} served",
            flush=True,
        )


if __name__ == "__main__":
    main()
