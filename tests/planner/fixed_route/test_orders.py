"""Orders of independent units: against every order there is, and the bound against all of them."""

import itertools
import math
from dataclasses import replace

import pytest
from free_orders import free_order
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.planner.fixed_route import order_search
from skyway.planner.fixed_route.charging_stops import charging_stops
from skyway.planner.fixed_route.order_bound import bound_of_orders
from skyway.planner.fixed_route.order_search import best_order
from skyway.planner.fixed_route.sharing import APART_S, shared


def every_order(work):
    """All tours: permutations that keep the groups, each unit either way round where it may be."""
    for order in itertools.permutations(range(work.units)):
        groups = [work.groups[unit] for unit in order]
        if groups != sorted(groups):
            continue
        ways = [[2 * u] if work.turns[2 * u + 1] is None else [2 * u, 2 * u + 1] for u in order]
        yield from itertools.product(*ways)


def end_of(work, tour):
    plan = charging_stops(work.route(tour))
    return math.inf if plan is None else plan.end_s


CASES = [{"units": 2}, {"units": 2, "slots": 3}, {"units": 3, "two_groups": True}, {"units": 3}]


@settings(max_examples=6)
@given(st.integers(0, 10**6), st.sampled_from(CASES))
def test_the_bound_is_no_later_than_the_best_of_all_orders(seed, case):
    work = free_order(seed, **case)
    best = min(end_of(work, tour) for tour in every_order(work))
    assert bound_of_orders(work) <= best + 1e-6


@settings(max_examples=3)
@given(st.integers(0, 10**6), st.sampled_from(CASES), st.booleans())
def test_the_search_tells_an_order_that_keeps_its_promise_and_no_order_ends_before_the_best(seed, case, walks):
    work = free_order(seed, **case)
    begin = [2 * unit for unit in range(work.units)]
    few = 0 if walks else order_search.FEW_ORDERS
    found = best_order(work, [begin], iterations=40, seed=1, few=few)
    ends = {tour: end_of(work, tour) for tour in every_order(work)}
    best = min(ends.values())
    if not walks:
        assert found.end_s == best or abs(found.end_s - best) <= 1e-6
    if math.isinf(found.end_s):
        assert all(math.isinf(end_of(work.coarse, tour)) for tour in [tuple(begin)])
        return
    assert found.tours[0] in ends
    assert found.end_s >= best - 1e-6
    assert ends[found.tours[0]] <= found.end_s + 1e-6
    assert found.end_s <= end_of(work.coarse, begin) + 1e-6
    assert best_order(work, [begin], iterations=40, seed=1, few=few) == found


def shared_orders(work):
    """What two drones fly: every order, cut in two at every place."""
    for tour in every_order(work):
        for cut in range(len(tour) + 1):
            yield tour[:cut], tour[cut:]


def assert_shared_as_well_as_can_be(seed, units, slots):
    """Where each drone finds a pad free, the search is as good as all ways to share; and nothing beats the bound."""
    work = replace(free_order(seed, units=units, slots=slots), counts=(2, 2), drones=2)
    ends = {tour: end_of(work, tour) if tour else 0.0 for tours in shared_orders(work) for tour in tours}
    best = min(max(ends[tour] for tour in tours) for tours in shared_orders(work))
    found = best_order(work, [[2 * unit for unit in range(units)], []], iterations=40)
    assert found.end_s == best or abs(found.end_s - best) <= 1e-6
    assert bound_of_orders(work) <= best + 1e-6
    crowded = best_order(replace(work, counts=(1, 1)), [[2 * unit for unit in range(units)], []], iterations=40)
    assert crowded.end_s >= best - 1e-6


@settings(max_examples=2)
@given(st.integers(0, 10**6))
def test_two_drones_share_the_work_as_well_as_it_can_be(seed):
    assert_shared_as_well_as_can_be(seed, 2, 1)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([1, 2]))
def test_two_drones_share_more_work_as_well_as_it_can_be(seed, slots):
    assert_shared_as_well_as_can_be(seed, 3, slots)


@settings(max_examples=3)
@given(st.integers(0, 10**6))
def test_two_drones_are_never_on_one_pad(seed):
    work = replace(free_order(seed, units=2, pads=1), counts=(1,), drones=2)
    routes = [work.route([0]), work.route([2])]
    plans = shared(routes, work.counts)
    if plans is None:
        return
    stays = sorted((stop.arrive_s, stop.leave_s) for plan in plans for stop in plan.stops)
    assert all(after[0] - before[1] >= APART_S - 1e-6 for before, after in itertools.pairwise(stays))
