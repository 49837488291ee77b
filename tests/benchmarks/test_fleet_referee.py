"""The referee of the dispatcher against all plans of tiny problems, tried one after another: no program of flows, no solver."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from benchmarks.fleet.referee import judge
from benchmarks.fleet.small_worlds import LEVELS, STEP_S, small_world

FREE = -1
"""Aboard: no package."""


def least_cost(problem):
    """Cost of the best plan, over all states that the drones can have together, step by step.

    A state is, for each drone, where it is or will land, when, with how many levels of charge and with which package; and which orders nobody took up yet.
    """
    flights, fleet, orders, weights = problem.flights, problem.fleet, problem.orders, problem.weights
    places, level_cost = range(len(flights.pads)), weights.energy_s / LEVELS
    last = int(max(orders.latest_s) / STEP_S + 1e-9)
    hop = {
        (mode, here, there): (round(time_s / STEP_S), round(flights.need[mode, 0, here, there] * LEVELS))
        for mode, here, there in product((0, 1), places, places)
        if np.isfinite(time_s := flights.time_s[mode, 0, here, there])
    }

    def chores(drone, waiting, step):
        """Yield each way to set down and take up without moving: (drone, orders not taken up, cost)."""
        place, free, level, aboard = drone
        yield drone, waiting, 0.0
        if aboard != FREE:
            if orders.destination[aboard] != place or step * STEP_S > orders.latest_s[aboard]:
                return
            late_s = max(step * STEP_S - orders.due_s[aboard], 0.0)
            cost = step * STEP_S - orders.ready_s[aboard] + weights.lateness * late_s
            yield from (
                (one, left, cost + more) for one, left, more in chores((place, free, level, FREE), waiting, step)
            )
            return
        for order in waiting:
            if orders.origin[order] == place and step * STEP_S >= orders.ready_s[order]:
                left = tuple(one for one in waiting if one != order)
                yield from chores((place, free, level, order), left, step)

    def moves(drone, step):
        """Yield what a drone may do next: (drone, place where it charges, cost)."""
        place, _, level, aboard = drone
        yield (place, step + 1, level, aboard), None, 0.0
        if level < LEVELS:
            yield (place, step + 1, level + 1, aboard), place, 0.0
        for there in places:
            takes_steps, takes = hop.get((0 if aboard == FREE else 1, place, there), (0, LEVELS + 1))
            if takes <= level:
                yield (there, step + takes_steps, level - takes, aboard), None, takes * level_cost

    def after(drones, waiting, step):
        """Yield all that the drones may do together: (drones, orders not taken up, cost)."""
        done = [((), waiting, 0.0)]
        for drone in drones:  # packages first, of one drone after the other
            done = [
                ((*before, one), left, cost + more)
                for before, rest, cost in done
                for one, left, more in (chores(drone, rest, step) if drone[1] == step else ((drone, rest, 0.0),))
            ]
        for ready, left, cost in done:
            options = [tuple(moves(one, step)) if one[1] == step else ((one, None, 0.0),) for one in ready]
            for chosen in product(*options):
                charging = [place for _, place, _ in chosen if place is not None]
                if all(charging.count(place) <= flights.pads[place] for place in charging):
                    yield tuple(one for one, _, _ in chosen), left, cost + sum(more for _, _, more in chosen)

    def end(drones):
        """Cost of the ways home, infinite with a package aboard."""
        found = 0.0
        for (place, _, _, aboard), home in zip(drones, fleet.home, strict=True):
            least = [0.0 if one == place else np.inf for one in places]
            for _ in places:
                least = [min(least[there], *(least[here] + hop[0, here, there][1] for here in places if (0, here, there) in hop)) for there in places]  # fmt: skip
            found += np.inf if aboard != FREE else level_cost * least[home]
        return found

    begun = tuple(
        (int(place), 0, int(soc * LEVELS + 1e-9), FREE) for place, soc in zip(fleet.place, fleet.soc, strict=True)
    )
    at_step = {(begun, tuple(range(len(orders.ready_s)))): 0.0}
    for step in range(last + 1):
        following = {}
        for (drones, waiting), cost in at_step.items():
            for then, left, more in after(drones, waiting, step):
                following[then, left] = min(following.get((then, left), np.inf), cost + more)
        at_step = following
    return min(
        cost + end(drones) + sum(orders.refusal_s[one] for one in left) for (drones, left), cost in at_step.items()
    )


def tiny(seed, orders, pads=1):
    """Two drones with little charge at three places: at most three tenths of a battery, and a flight takes two at least."""
    problem = small_world(seed, drones=2, orders=orders, stations=3, pads=pads, horizon=7, due=5)
    soc = np.random.default_rng(seed + 77).integers(0, 4, 2) / LEVELS
    return replace(problem, fleet=problem.fleet._replace(soc=soc))


@pytest.mark.parametrize(("seed", "orders"), [(3, 2), (4, 2), (5, 2), (8, 3), (9, 3)])
def test_the_referee_proves_what_is_the_least_of_all_plans(seed, orders):
    problem = tiny(seed, orders)
    verdict = judge(problem, STEP_S, LEVELS)
    assert verdict.proved
    assert verdict.cost == pytest.approx(least_cost(problem))


@pytest.mark.parametrize(("seed", "orders"), [(3, 2), (8, 3)])
def test_both_pay_for_a_second_pad_that_is_not_there(seed, orders):
    one, two = tiny(seed, orders), tiny(seed, orders, pads=2)
    assert least_cost(two) == pytest.approx(judge(two, STEP_S, LEVELS).cost)
    assert judge(two, STEP_S, LEVELS).cost < 0.6 * judge(one, STEP_S, LEVELS).cost
