"""Stops with few packs and chargers: against every sequence of stops, flown by a program that keeps its packs otherwise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from free_orders import free_order
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skyway.planner.fixed_route.battery_packs import PackPool, swap_stops
from skyway.planner.fixed_route.charging_stops import charging_stops

SWAP_S = 4.0
FULL_AT_ONCE = (np.array([0.0, 1e-3]), np.array([0.0, 1.0]))


def case_of(seed, packs, chargers):
    """Two units in their order in a steady wind, two pads, and a pool."""
    rng = np.random.default_rng(seed)
    route = free_order(seed, units=2).route((0, 2))
    curve = (np.array([0.0, 40.0, 40.0 + float(rng.uniform(20.0, 120.0))]), np.array([0.0, 0.7, 1.0]))
    pool = PackPool(packs, chargers, SWAP_S, *curve)
    waits = tuple(wait + np.array([0.0, SWAP_S]) for wait in route.waits)
    return replace(route, curves=(FULL_AT_ONCE,) * len(waits), waits=waits), pool


class Crew:
    """Packs as things that each have a time at which they are full, and chargers with a queue."""

    def __init__(self, pool):
        self.pool, self.waiting = pool, [0.0] * (pool.packs - 1)
        self.chargers = [0.0] * pool.chargers

    def copy(self):
        other = Crew(self.pool)
        other.waiting, other.chargers = list(self.waiting), list(self.chargers)
        return other

    def change(self, at, soc):
        charger = self.chargers.index(min(self.chargers))
        missing = np.interp(1.0, self.pool.curve_soc, self.pool.curve_s) - np.interp(
            soc, self.pool.curve_soc, self.pool.curve_s
        )
        self.chargers[charger] = max(self.chargers[charger], at + SWAP_S) + missing
        self.waiting.append(self.chargers[charger])
        pack = min(self.waiting)
        self.waiting.remove(pack)
        return max(at, pack) + SWAP_S


def best_of_all(route, pool):
    """The first end of all sequences of stops, by trying each."""
    hops, last = route.hops, len(route.can_leave) - 1
    sure, mean, reserve = route.sure_ratio, route.mean_ratio, route.reserve_soc
    best = [math.inf]

    def left(soc, needs):
        return None if soc < reserve + sure * needs - 1e-12 else soc - mean * needs

    def go(position, pad, now, soc, crew, seen):
        if now + hops.work_s[0, position:].sum() >= best[0]:
            return
        seconds, needs, begin = 0.0, 0.0, 0
        if pad is not None:
            seconds, needs, begin = hops.from_s[0, position, pad], hops.from_soc[0, position, pad], position
            for other in {*range(len(route.waits))} - seen:
                to_s, to_soc = hops.between_s[0, pad, other], hops.between_soc[0, pad, other]
                stop(position, other, now + to_s, soc, to_soc, crew, seen)
        done = np.concatenate(([0.0], np.cumsum(hops.work_s[0, begin:])))
        used = np.concatenate(([0.0], np.cumsum(hops.work_soc[0, begin:])))
        if left(soc, needs + used[-1]) is not None:
            best[0] = min(best[0], now + seconds + done[-1])
        for until in range(last, begin - 1, -1):
            if route.can_leave[until] and not (pad is not None and until == position):
                for other in range(len(route.waits)):
                    to_s, to_soc = (
                        hops.to_s[0, until, other],
                        needs + used[until - begin] + hops.to_soc[0, until, other],
                    )
                    stop(until, other, now + seconds + done[until - begin] + to_s, soc, to_soc, crew, set())

    def stop(position, pad, arrive, soc, needs, crew, seen):
        landed = left(soc, needs)
        if landed is None or arrive >= best[0]:
            return
        other = crew.copy()
        wait = float(route.waits[pad][0, 1]) - SWAP_S
        go(position, pad, other.change(arrive + wait, landed), 1.0, other, seen | {pad})

    go(0, None, route.start_s, route.soc_start, Crew(pool), set())
    return best[0]


@settings(max_examples=5)
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 2))
def test_no_sequence_of_stops_ends_earlier(seed, packs, chargers):
    route, pool = case_of(seed, packs, chargers)
    plan, best = swap_stops(route, pool), best_of_all(route, pool)
    assert (math.inf if plan is None else plan.end_s) == pytest.approx(best, abs=1e-6)


@settings(max_examples=8)
@given(st.integers(0, 10**6))
@example(14383)
def test_fewer_packs_or_chargers_end_no_earlier_and_enough_of_both_as_without_number(seed):
    route, pool = case_of(seed, 12, 12)
    ends = []
    for packs, chargers in ((1, 1), (2, 1), (2, 2), (3, 2), (12, 12)):
        plan = swap_stops(route, replace(pool, packs=packs, chargers=chargers))
        ends.append(math.inf if plan is None else plan.end_s)
    assert ends == sorted(ends, reverse=True)
    plan = charging_stops(route)
    end_s = math.inf if plan is None else plan.end_s
    assert ends[-1] >= end_s - 0.1
    # where ways of the work are longer than by a pad, who charges lands there without charging; packs are changed at every landing
    if plan is None or all(stop.soc_leave > stop.soc_arrive + 1e-9 for stop in plan.stops):
        assert ends[-1] == pytest.approx(end_s, abs=0.1)


def test_a_wind_that_changes_is_told_in_the_same_clock():
    route = free_order(5, units=2, slots=3).route((0, 2))
    waits = tuple(wait + np.array([0.0, SWAP_S]) for wait in route.waits)
    route = replace(route, curves=(FULL_AT_ONCE,) * len(waits), waits=waits)
    pool = PackPool(2, 1, SWAP_S, np.array([0.0, 60.0]), np.array([0.0, 1.0]))
    plan = swap_stops(route, pool)
    assert plan is not None
    at = route.start_s
    for stop in plan.stops:
        assert at <= stop.arrive_s <= stop.on_pad_s <= stop.leave_s - SWAP_S + 1e-9
        at = stop.leave_s
    assert plan.end_s > at
