"""Tours against published solutions of electric vehicle routing problems, checked by code that shares none with the solver."""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.fleet.evrp import checker, evrptw, optimum, overnight
from skyway.planner.parameters.tours import ToursParameters
from skyway.planner.tours.solve import solve

TUNED_ON = ("r105_21", "r201_21", "r208_21", "rc105_21", "rc201_21")
"""Instances used to tune the parameters of `planner.parameters.tours`."""
NARROW, WIDE = 500_000, 250_000
"""Iterations for instances with narrow and wide windows: about half a minute of one processor."""


def judge_evrptw(name: str, *, share: float, seed: int) -> float:
    """Solve an instance and print a line; return the gap to the best known distance, infinite with more vehicles or a fault."""
    instance, known = evrptw.read(name), evrptw.best_known()[name]
    tours, nodes, stations = evrptw.tours_of(instance)
    iterations = int(share * (WIDE if "2" in name.split("_", maxsplit=1)[0][:-2] else NARROW))
    solve(tours, ToursParameters(), iterations=1)  # compiles the kernels
    started = time.process_time()
    search = solve(tours, ToursParameters(), seed=seed, time_limit_s=1e6, iterations=iterations, fewest_vehicles=True)
    took_s = time.process_time() - started
    routes = evrptw.routes_of(search, nodes, stations)
    distance = checker.distance_of(instance, routes)
    faults = checker.faults(instance, routes)
    gap = distance / known.distance - 1.0
    print(
        f"{name:<9} {len(routes):>2} vehicles ({known.vehicles}), {distance:8.2f} ({known.distance:8.2f}), gap {100 * gap:5.2f} %, {took_s:5.0f} s of processor"
        f"{', tuned on' if name in TUNED_ON else ''}{''.join(f', FAULT {one}' for one in faults)}",
        flush=True,
    )
    return np.inf if faults or len(routes) > known.vehicles else gap


def judge_small(name: str) -> float:
    """Solve a small instance and prove its optimum; print a line, return the gap."""
    instance = evrptw.read(name)
    tours, nodes, stations = evrptw.tours_of(instance)
    search = solve(tours, ToursParameters(), time_limit_s=1e6, iterations=20_000, fewest_vehicles=True)
    routes = evrptw.routes_of(search, nodes, stations)
    proof = optimum.prove(instance)
    gap = checker.distance_of(instance, routes) / proof.distance - 1.0
    faults = checker.faults(instance, routes)
    print(
        f"{name:<9} {len(routes)} vehicles (proved {proof.vehicles}), proved distance {proof.distance:.2f}, gap {100 * gap:.2f} %{''.join(f', FAULT {one}' for one in faults)}",
        flush=True,
    )
    return np.inf if faults or len(routes) > proof.vehicles else gap


def judge_overnight(name: str, *, share: float, seed: int) -> float:
    """Solve an instance with few chargers at the depot; print a line, return the gap to the authors' cost, infinite with a fault."""
    instance, known = overnight.read(name), overnight.published(name)
    tours, number = overnight.tours_of(instance)
    solve(tours, ToursParameters(), iterations=1)
    started = time.process_time()
    search = solve(tours, ToursParameters(), seed=seed, time_limit_s=1e6, iterations=int(share * NARROW / 2))
    took_s = time.process_time() - started
    solution = overnight.solution_of(search, number)
    faults = checker.overnight_faults(instance, solution)
    gap = solution.cost / known.cost - 1.0
    print(
        f"{name:<8} {len(solution.routes):>2} vehicles ({len(known.routes)}), {solution.cost:7.1f} ({known.cost:7.1f}), gap {100 * gap:5.2f} %, {took_s:4.0f} s of processor"
        f"{''.join(f', FAULT {one}' for one in faults)}",
        flush=True,
    )
    return np.inf if faults else gap


def main() -> None:
    """Print a line for each instance, and a summary of the gaps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="share of the usual iterations")
    parser.add_argument("--seed", type=int, default=1, help="of the search")
    parser.add_argument("names", nargs="*", help="instances; without any all, and the small ones")
    options = parser.parse_args()
    big = [one for one in evrptw.BIG if one in options.names or not options.names]
    depot = [one for one in overnight.NAMES if one in options.names or not options.names]
    if not options.names:
        small = [judge_small(name) for name in evrptw.SMALL]
        print(f"small: {len(small)} instances, {sum(one < 1e-6 for one in small)} at the proved optimum\n")
    gaps = [judge_overnight(name, share=options.share, seed=options.seed) for name in depot]
    if gaps:
        print(f"few chargers: mean gap {100 * np.mean(gaps):.2f} %, worst {100 * np.max(gaps):.2f} % (wanted: 2 %)\n")
    gaps = [judge_evrptw(name, share=options.share, seed=options.seed) for name in big]
    if gaps:
        print(f"partial recharge: mean gap {100 * np.mean(gaps):.2f} %, worst {100 * np.max(gaps):.2f} % (wanted: 2 %)")


if __name__ == "__main__":
    main()
