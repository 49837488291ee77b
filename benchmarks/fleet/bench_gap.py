"""Gap of the dispatcher's plans to the proved optimum, on small problems in whole steps."""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.fleet.referee import judge
from benchmarks.fleet.small_worlds import LEVELS, STEP_S, small_world
from skyway.planner.dispatch.bound import lower_bound
from skyway.planner.dispatch.improve import solve
from skyway.planner.parameters.dispatch import DispatchParameters

SIZES = (
    {"drones": 2, "orders": 4, "stations": 4, "pads": 1},
    {"drones": 3, "orders": 5, "stations": 4, "pads": 1},
    {"drones": 2, "orders": 4, "stations": 4, "pads": 2},
    {"drones": 3, "orders": 5, "stations": 4, "pads": 2},
    {"drones": 4, "orders": 6, "stations": 4, "pads": 2},
    {"drones": 6, "orders": 9, "stations": 4, "pads": 2},
    {"drones": 8, "orders": 12, "stations": 4, "pads": 2},
)


def main() -> None:
    """Print the gaps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=20, help="problems of each size")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first problem")
    parser.add_argument("--seconds", type=float, default=3.0, help="time of the dispatcher for each")
    parser.add_argument("--iterations", type=int, default=10**9, help="maximum number of iterations")
    parser.add_argument("--sizes", type=int, default=len(SIZES), help="number of sizes, the smallest first")
    parser.add_argument("--limit", type=float, default=60.0, help="time of the referee for each")
    options = parser.parse_args()
    every: list[float] = []
    for size in SIZES[: options.sizes]:
        gaps, bounds, unproved = [], [], 0
        for seed in range(options.each):
            problem = small_world(options.first + seed, horizon=24, **size)
            search = solve(problem, DispatchParameters(), time_limit_s=options.seconds, iterations=options.iterations)
            verdict = judge(problem, STEP_S, LEVELS, time_limit_s=options.limit)
            if not verdict.proved:
                unproved += 1
                continue
            gaps.append(search.cost / verdict.cost - 1.0)
            bounds.append(lower_bound(problem) / verdict.cost)
        every += gaps
        shown = ", ".join(f"{value} {name}" for name, value in size.items())
        print(
            f"{shown}: {len(gaps)} proved, {unproved} not in {options.limit:g} s; gap mean {100 * np.mean(gaps):.2f} %, median "
            f"{100 * np.median(gaps):.2f} %, worst {100 * np.max(gaps):.1f} %, {sum(one < 1e-6 for one in gaps)} optimal; bound "
            f"{100 * np.mean(bounds):.0f} % of the optimum",
            flush=True,
        )
    print(
        f"all: {len(every)} problems, mean gap {100 * np.mean(every):.2f} % (wanted 3 %), least {100 * np.min(every):.4f} %"
    )


if __name__ == "__main__":
    main()
