"""Tours against what they must keep, proved optima, brute force over chargers, and the published solutions."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fleet.bench_evrp import judge_evrptw
from benchmarks.fleet.evrp import checker, evrptw, optimum, overnight
from benchmarks.fleet.evrp.random_instance import random_instance
from skyway.models.base.errors import InputError
from skyway.planner.parameters.tours import ToursParameters
from skyway.planner.tours.depot_kernels import Queue, schedule
from skyway.planner.tours.solve import solve

USUAL = ToursParameters(pool=2000)


def solved(instance, iterations=5000, seed=0):
    tours, nodes, stations = evrptw.tours_of(instance)
    search = solve(tours, USUAL, seed=seed, time_limit_s=600.0, iterations=iterations, fewest_vehicles=True)
    return search, evrptw.routes_of(search, nodes, stations)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_tours_of_small_problems_are_feasible_and_at_the_proved_optimum(seed):
    instance = random_instance(seed, customers=5, stations=3)
    _, routes = solved(instance)
    assert checker.faults(instance, routes) == []
    proof = optimum.prove(instance)
    assert len(routes) == proof.vehicles
    assert checker.distance_of(instance, routes) == pytest.approx(proof.distance)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_tours_of_larger_problems_are_feasible(seed):
    instance = random_instance(seed, customers=30, stations=6)
    search, routes = solved(instance, iterations=300)
    assert checker.faults(instance, routes) == []
    assert checker.distance_of(instance, routes) == pytest.approx(search.cost)


@pytest.mark.parametrize("seed", range(4))
def test_no_sequence_of_places_that_a_linear_program_allows_is_shorter_than_what_is_proved(seed):
    """The prover's labels against brute force: every order of three customers, with up to one station before, between and after them."""
    instance = random_instance(seed, customers=3, stations=2)
    customers, stations = instance.ids[3:], instance.ids[1:3]
    tours = optimum.shortest_tours(instance)
    for mask in range(1, 8):
        inside = [one for number, one in enumerate(customers) if mask >> number & 1]
        least = tours.get(mask, np.inf)
        for order in permutations(inside):
            for stops in product((None, *stations), repeat=len(order) + 1):
                route = [one for pair in zip(stops, (*order, None), strict=True) for one in pair if one is not None]
                if checker.distance_of(instance, [route]) < least - 1e-6:
                    load = sum(instance.demand[instance.ids.index(one)] for one in inside)
                    assert load > instance.capacity or not checker.can_be_driven(instance, route)


@settings(max_examples=60)
@given(
    chargers=st.integers(1, 3),
    jobs=st.lists(st.tuples(st.integers(1, 9), st.integers(1, 25)), min_size=1, max_size=6),
)
def test_jobs_at_the_depot_are_late_only_where_every_choice_of_chargers_is(chargers, jobs):
    jobs = sorted(jobs, key=lambda one: one[1])
    states = 64
    shapes = ((2, states, chargers), (2, states), (2, states), (len(jobs), states, 2))
    free, late, uneven, came = (np.zeros(shape, dtype=np.int64) for shape in shapes)
    table = np.array([(periods, by, number) for number, (periods, by) in enumerate(jobs)], dtype=np.int64)
    found, _ = schedule(Queue(table, free, late, uneven, came), len(jobs))
    least = min(_lateness(jobs, choice, chargers) for choice in product(range(chargers), repeat=len(jobs)))
    assert (found == 0) == (least == 0)
    assert found >= least


def _lateness(jobs, choice, chargers):
    free, late = [0] * chargers, 0
    for (periods, by), charger in zip(jobs, choice, strict=True):
        free[charger] += periods
        late += max(free[charger] - by, 0)
    return late


def test_the_same_seed_gives_the_same_tours():
    instance = random_instance(3, customers=12, stations=4)
    assert solved(instance, iterations=400, seed=5)[1] == solved(instance, iterations=400, seed=5)[1]


def test_a_time_limit_that_is_not_above_zero_is_refused():
    tours, _, _ = evrptw.tours_of(random_instance(1, customers=3, stations=2))
    with pytest.raises(InputError, match="must be above 0"):
        solve(tours, USUAL, time_limit_s=0.0)


def test_the_checkers_accept_every_published_solution_and_see_what_is_wrong(shared_data):
    for name, known in evrptw.best_known().items():
        instance = evrptw.read(name)
        assert checker.faults(instance, known.routes) == []
        assert checker.distance_of(instance, known.routes) == pytest.approx(known.distance, abs=1e-3)
    assert checker.faults(instance, known.routes[1:])[0] == "not every customer is visited once"
    flat = [tuple(one for one in route if one[0] == "C") for route in known.routes]
    assert any("battery" in fault for fault in checker.faults(instance, flat))
    for name in overnight.NAMES:
        assert checker.overnight_faults(overnight.read(name), overnight.published(name)) == []


def test_few_chargers_at_the_depot_are_shared_as_in_the_published_solution(shared_data):
    instance, known = overnight.read("C105-25"), overnight.published("C105-25")
    tours, number = overnight.tours_of(instance)
    search = solve(tours, USUAL, seed=1, time_limit_s=600.0, iterations=20_000)
    solution = overnight.solution_of(search, number)
    assert checker.overnight_faults(instance, solution) == []
    assert solution.cost == pytest.approx(known.cost)


@pytest.mark.slow
@pytest.mark.parametrize("name", evrptw.SMALL)
def test_small_published_instances_are_at_the_proved_optimum(name, shared_data):
    instance = evrptw.read(name)
    _, routes = solved(instance, iterations=20_000)
    assert checker.faults(instance, routes) == []
    proof = optimum.prove(instance)
    assert (len(routes), checker.distance_of(instance, routes)) == (proof.vehicles, pytest.approx(proof.distance))


@pytest.mark.slow
def test_wide_windows_and_few_vehicles_are_within_two_percent_of_the_best_known(shared_data):
    assert judge_evrptw("rc208_21", share=1.0, seed=1) <= 0.02
