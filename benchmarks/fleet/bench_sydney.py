"""The rebuilt Sydney set: our plans compared with the rules of the study, a greedy rule, and first come, first served."""

from __future__ import annotations

import argparse
import itertools
import time
from collections import defaultdict

import numpy as np

from benchmarks.fleet.sydney import (
    BATTERY_WH,
    FINALS,
    FLATS,
    HOVER_W,
    MIN_S,
    SOURCES,
    TAU_S,
    City,
    Flown,
    Request,
    alone,
    city,
    queued,
    requests,
)
from benchmarks.fleet.sydney_bound import most_quality
from skyway.planner.dispatch.flight_kernels import BEGIN, CHARGE, END, FROM, HOME, KIND, PAD, SOC, SOC_AFTER
from skyway.planner.dispatch.improve import Improver
from skyway.planner.dispatch.problem import DispatchProblem, Fleet, Flights, Orders, Weights, to_go
from skyway.planner.dispatch.search import Search
from skyway.planner.parameters.dispatch import DispatchParameters

EACH = 40
"""Requests of a provider in an hour."""
ENERGY_S = 7000.0
"""Approximate value of a battery's energy in the measure of quality, seconds of delivery."""
FULL_S = 86_400.0
"""Nobody waits for the last hundredth of a charge."""
RULES = {
    "the study's rule": lambda waits, charges: waits**1.2 + charges,
    "greedy": lambda _, charges: charges,
    "first come, first served": lambda waits, _: -waits,
}


def problem(town: City, given: list[Request]) -> DispatchProblem:
    """Return the set as a dispatch problem.

    An order ends at its destination, and its drone at any roof where it has its final charge: home is a virtual place for each final charge, reached from
    any roof in zero time with a required SoC of that charge, and the time until then counts like that of the delivery. Drones begin at places of their providers
    to which no drone returns, so that each has one order; those of a provider with one final charge are identical.
    """
    roofs, finals = SOURCES + FLATS, sorted(FINALS.values())
    kinds = len(finals)
    kind_of = {final: number for number, final in enumerate(finals)}
    begins = roofs + kinds
    places = begins + SOURCES
    time_s, need = np.full((2, places, places), np.inf), np.full((2, places, places), np.inf)
    time_s[:, :roofs, :roofs], need[:, :roofs, :roofs] = town.time_s, town.need
    diagonal = np.arange(roofs)
    time_s[:, diagonal, diagonal] = np.inf
    for final, number in kind_of.items():
        time_s[:, :roofs, roofs + number], need[:, :roofs, roofs + number] = 0.0, final
    time_s[1, begins:, :roofs], need[1, begins:, :roofs] = time_s[1, :SOURCES, :roofs], need[1, :SOURCES, :roofs]
    stops = np.arange(roofs)
    pads = np.concatenate((town.pads, np.zeros(kinds + SOURCES, dtype=np.int64)))
    levels = np.concatenate((np.linspace(0.0, 0.98, 50), [0.985, 0.99, 1.0]))
    at_s = np.concatenate((-TAU_S * np.log(1.0 - levels[:-1]), [FULL_S]))
    pace_s = float(at_s[1] / levels[1])
    flights = Flights(
        time_s=time_s[:, None], need=need[:, None],
        to_go_s=to_go(time_s[:, None], need[:, None], stops, pace_s, 1.0), escape=np.zeros((2, places)), start_s=0.0, slot_s=1e9,
        pads=pads, first_pad=np.cumsum(pads) - pads, stops=stops, curve_of=np.zeros((kinds, places), dtype=np.int64),
        curve_s=at_s[None], curve_soc=levels[None], pace_s=np.full(kinds, pace_s), wait_s=np.zeros((places, 1)), wait_step_s=1e9, reserve=0.0,
    )  # fmt: skip
    count = len(given)
    ready = np.array([one.ready_s for one in given])
    origin = np.array([begins + one.origin for one in given], dtype=np.int64)
    kind = np.array([kind_of[FINALS[one.threshold]] for one in given], dtype=np.int64)
    due = ready + np.array([alone(town, one)[0] for one in given])
    fleet = Fleet(
        type=kind, empty_mode=np.zeros(count, dtype=np.int64), place=origin, home=roofs + kind, soc=np.ones(count), from_s=np.zeros(count), to_s=np.full(count, np.inf), scale=np.ones(count),
    )  # fmt: skip
    orders = Orders(
        origin=origin, destination=np.array([one.destination for one in given], dtype=np.int64), ready_s=ready,
        due_s=due, refusal_s=np.full(count, 1e7), mode=np.where(kind == np.arange(kinds)[:, None], 1, -1),
        latest_s=np.full(count, np.inf),
    )  # fmt: skip
    return DispatchProblem(flights, fleet, orders, Weights(1.0, ENERGY_S, 1.0))


def searched(town: City, given: list[Request], time_limit_s: float, iterations: int = 10**9) -> Search:
    """Plan the set, each request by its own drone: the shortest charges are inserted first, each at its destination; the search may choose other stops."""
    made = problem(town, given)
    search = Search(made, DispatchParameters(vehicles_tried=2))
    search.warm_up()
    end_at = time.perf_counter() + time_limit_s
    search.routes.halts.place[:, HOME] = [one.destination for one in given]
    search.routes.halts.soc[:, HOME] = [FINALS[one.threshold] for one in given]
    on_pads_s = [alone(town, one)[0] - town.time_s[one.origin, one.destination] for one in given]
    for order in np.argsort(on_pads_s, kind="stable"):
        if not search.insert(int(order), int(order), 0):
            raise AssertionError(f"request {order} cannot be flown")
        search.settle(int(order), int(order), HOME)
    Improver(search).improve(end_at=end_at, iterations=iterations)
    return search


def planned(town: City, given: list[Request], search: Search) -> tuple[list[Flown], float]:
    """Return the outcome of each request in a plan, and check the plan: no pad used twice, no charge faster than possible.

    A drone that must wait for its first pad begins later by that wait; at any other it waits on a waiting pad, or hovers if those are occupied.
    """
    windows: dict[int, list[tuple[float, float]]] = defaultdict(list)
    waits: dict[int, list[tuple[float, float, int]]] = defaultdict(list)
    done_s, taken = np.full(len(given), np.inf), np.zeros(len(given))
    for drone in np.flatnonzero(search.routes.length):
        (order,) = search.route(int(drone))
        free_s, first = None, True
        for row in search.steps[drone]:
            if row[KIND] == CHARGE:
                windows[int(row[PAD])].append((row[BEGIN], row[END]))
                if row[SOC_AFTER] > 1.0 - (1.0 - row[SOC]) * np.exp(-(row[END] - row[BEGIN]) / TAU_S) + 1e-3:
                    raise AssertionError(f"request {order} charges quicker than it can")
                if free_s is not None and row[BEGIN] > free_s + 1.0 and not first:
                    waits[int(row[FROM])].append((free_s, row[BEGIN], order))
                first = False
            else:
                taken[order] += row[SOC] - row[SOC_AFTER] if row[END] > row[BEGIN] else 0.0
            free_s = row[END]
        done_s[order] = free_s
    for own in windows.values():
        own.sort()
        if any(then[0] < one[1] - 1e-6 for one, then in itertools.pairwise(own)):
            raise AssertionError("a pad is held twice")
    hovered, congested = np.zeros(len(given)), 0.0
    for roof, all_ in waits.items():
        at_s = sorted({time for begin, end, _ in all_ for time in (begin, end)})
        for begin, end in itertools.pairwise(at_s):
            here = sorted((one[0], one[2]) for one in all_ if one[0] <= begin and one[1] >= end)
            congested += (end - begin) * bool(here)
            for _, order in here[int(town.pads[roof]) :]:
                hovered[order] += HOVER_W * (end - begin) / 3600.0 / BATTERY_WH
    found = []
    for number, one in enumerate(given):
        expected_s, use = alone(town, one)
        late_s = max(done_s[number] - one.ready_s - expected_s, 0.0)
        found.append(Flown(expected_s, use, late_s, max(taken[number] + hovered[number] - use, 0.0), hovered[number]))
    return found, congested / MIN_S / len(town.pads)


def table_line(name: str, flown: list[Flown], congested_min: float) -> str:
    """Return one line of the table."""
    late = np.array([one.late_s for one in flown]) / MIN_S
    return (
        f"{name:<26} quality {np.mean([one.quality for one in flown]):.3f}; not served {100.0 * np.mean([not one.served for one in flown]):.1f} %; "
        f"congestion {congested_min:.0f} min a roof; late {late.mean():.1f} min on average, {np.percentile(late, 95):.0f} min at p95"
    )


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13])
    parser.add_argument("--growth", type=float, nargs="+", default=[0.0, 1.0])
    parser.add_argument("--seconds", type=float, default=60.0, help="time of the search for each")
    options = parser.parse_args()
    for growth in options.growth:
        for seed in options.seeds:
            town = city(seed)
            given = requests(seed, round(EACH * (1.0 + growth)))
            print(f"+{100 * growth:.0f} %, seed {seed}: {len(given)} requests, {int(town.pads.sum())} pads", flush=True)
            for name, rule in RULES.items():
                print("  " + table_line(name, *queued(town, given, rule)))
            search = searched(town, given, options.seconds)
            flown, congested_min = planned(town, given, search)
            print("  " + table_line("planned", flown, congested_min), flush=True)
            elsewhere = np.mean([one.extra > 1e-9 for one in flown])
            most = most_quality(town, given, float(np.mean([one.quality for one in flown])))
            print(
                f"  {100.0 * elsewhere:.1f} % charge on another roof; no plan has a quality above {most:.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
