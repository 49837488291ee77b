"""Tours of a fleet against what they must keep: what is aboard, charge, time and pads of every step, by the tables of flights alone."""

from datetime import UTC, datetime, timedelta
from itertools import pairwise, permutations

import numpy as np
import pytest

from benchmarks.fleet.evrp import evrptw
from benchmarks.fleet.evrp.random_instance import random_instance
from skyway.missions.examples import NEW_YORK
from skyway.models.ledger.ledger import Hold
from skyway.models.ledger.window import Window
from skyway.models.orders.fitting import fit
from skyway.models.orders.order import Order, Vehicle
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.forecast import constant_wind
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.parameters.planner import USUAL
from skyway.planner.parameters.tours import ToursParameters
from skyway.planner.tours.charger_kernels import BEGIN, KIND, SERVE
from skyway.planner.tours.earlier import deliver_earlier
from skyway.planner.tours.plan import plan_tours
from skyway.planner.tours.problem import Arcs, Charging, Visits, alike, lay_out
from skyway.planner.tours.solve import solve

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
RESERVE = 0.2


def order(name, to, mass_kg=0.3, *, ready_min=0, due_min=180, origin="bellevue", priority=0):
    return Order(
        id=name, origin=origin, destination=to, mass_kg=mass_kg, priority=priority,
        ready=START + timedelta(minutes=ready_min), due=START + timedelta(minutes=due_min),
    )  # fmt: skip


def drone(name, soc=0.9, home="bellevue"):
    return Vehicle(id=name, type="m200", home=home, place=home, soc=soc)


@pytest.fixture(scope="module")
def forecast():
    scenario = read_scenario(NEW_YORK)
    return scenario, constant_wind(4.0, 270.0, START, 48, 40.7, -73.9, scenario.rules.cruise_height_m)


def planned(forecast, orders, drones, *, holds=(), iterations=300, fewest_drones=False):
    scenario, wind = forecast
    work = fit(scenario, orders, drones)
    made = plan_tours(
        work, START, forecast=wind, holds=holds, time_limit_s=600.0, iterations=iterations, fewest_drones=fewest_drones
    )
    check(work, wind, made)
    return work, made


def check(work, wind, made):
    """Judge every step by the tables of flights, without the tours' own code."""
    payload = work.scenario.drone("m200").max_payload_kg
    laid = lay_out_problem(work, START, wind, USUAL, loads_kg=[payload])
    flights, network = laid.problem.flights, work.scenario.network
    number = {network.stations[node].id: place for place, node in enumerate(laid.places)}
    orders, held = {one.id: one for one in work.orders}, {}
    for route in made.routes:
        start = next(one for one in work.vehicles if one.id == route.drone)
        at, time, soc = start.place, START, start.soc
        aboard = sum(orders[one].mass_kg for one in route.orders)
        assert aboard <= payload + 1e-9
        delivered = {one.order: one.delivered for one in made.answers}
        left = next(one.begin for one in route.steps if one.kind == "fly")
        assert all(left >= orders[one].ready for one in route.orders)
        for step in route.steps:
            assert step.origin == at
            assert step.begin >= time
            assert step.soc_begin == pytest.approx(soc, abs=1e-6)
            if step.kind == "charge":
                held.setdefault((step.origin, step.pad), []).append((step.begin, step.end))
                assert step.soc_end <= USUAL.tours.level + 1e-9
                curve = flights.curve_of[0, number[at]]
                level, at_s = flights.curve_soc[curve], flights.curve_s[curve]
                least_s = _at(step.soc_end, level, at_s) - _at(step.soc_begin, level, at_s)
                assert (step.end - step.begin).total_seconds() >= least_s - 1e-3
            else:
                load = sum(orders[one].mass_kg for one in route.orders if delivered[one] >= step.end)
                mode = min((mass, place) for place, (_, mass) in enumerate(laid.modes) if mass >= load - 1e-9)[1]
                slot = int((step.begin.timestamp() - flights.start_s) // flights.slot_s)
                leg = slot, number[step.origin], number[step.destination]
                empty = flights.need[(0, *leg)]
                assert (step.end - step.begin).total_seconds() >= flights.time_s[(0, *leg)] - 1e-3
                slowest_s = flights.time_s[:, :, number[step.origin], number[step.destination]]
                assert (step.end - step.begin).total_seconds() <= slowest_s[np.isfinite(slowest_s)].max() + 1e-3
                assert empty - 1e-6 <= step.soc_begin - step.soc_end
                if mode == 0 or load == pytest.approx(laid.modes[mode][1]):
                    assert step.soc_begin - step.soc_end >= flights.need[(mode, *leg)] - 1e-6
                assert step.soc_end >= RESERVE - 1e-6
            at, time, soc = step.destination, step.end, step.soc_end
        assert at == start.home
        for one in route.orders:
            assert delivered[one] <= orders[one].due
    for windows in held.values():
        windows.sort()
        assert all(before[1] <= after[0] + timedelta(seconds=1e-3) for before, after in pairwise(windows))


def _at(value, x, y):
    return float(np.interp(value, x, y))


def test_one_drone_takes_several_packages(forecast):
    _, made = planned(
        forecast, [order("a", "jacobi"), order("b", "yankee-stadium"), order("c", "jacobi")], [drone("d1")]
    )
    assert made.served == 3
    assert sorted(made.routes[0].orders) == ["a", "b", "c"]


def test_packages_that_are_too_heavy_together_are_shared_out(forecast):
    heavy = [order("a", "jacobi", 0.8), order("b", "jacobi", 0.8), order("c", "jacobi", 0.8)]
    _, made = planned(forecast, heavy, [drone("d1"), drone("d2", 0.8)])
    assert made.served == 2
    assert {len(route.orders) for route in made.routes} == {1}
    assert [one.reason for one in made.answers if one.status == "refused"] == [
        "the drones and pads serve orders of greater weight"
    ]


def test_a_tour_waits_for_the_last_of_its_packages(forecast):
    _, made = planned(forecast, [order("a", "jacobi"), order("b", "jacobi", ready_min=40)], [drone("d1")])
    assert made.served == 2
    assert made.routes[0].steps[-1].end > START + timedelta(minutes=40)


def test_an_order_of_higher_priority_is_served_first(forecast):
    orders = [order("a", "jacobi", 0.8), order("b", "jacobi", 0.8, priority=1), order("c", "jacobi", 0.8)]
    _, made = planned(forecast, orders, [drone("d1")])
    assert [one.order for one in made.answers if one.status == "served"] == ["b"]


def test_what_no_drone_can_do_is_refused_with_its_reason(forecast):
    _, made = planned(
        forecast, [order("far", "edison", due_min=10), order("else", "bellevue", origin="jacobi")], [drone("d1")]
    )
    reasons = {one.order: one.reason for one in made.answers}
    assert "even without other orders" in reasons["far"]
    assert "stands at its station" in reasons["else"]
    assert made.routes == ()


def test_an_order_that_only_the_larger_drone_could_have_served_is_not_called_hopeless(forecast):
    heavy = [order("a", "yankee-stadium", 4.0), order("b", "yankee-stadium", 4.0)]
    drones = [Vehicle(id="big", type="m600", home="bellevue", place="bellevue", soc=0.9), drone("small")]
    scenario, wind = forecast
    made = plan_tours(fit(scenario, heavy, drones), START, forecast=wind, time_limit_s=600.0, iterations=200)
    refused = next(one for one in made.answers if one.status == "refused")
    assert refused.reason == "the drones and pads serve orders of greater weight"
    assert not refused.hopeless


def test_pads_that_others_have_are_left_to_them(forecast):
    work, free = planned(forecast, [order("a", "jacobi", due_min=240)], [drone("d1")])
    window = next(one.windows[0] for one in free.answers if one.windows)
    pads = next(one.pads for one in work.scenario.network.stations if one.id == window.station)
    holds = [
        Hold("other", 1, pad, Window(station=window.station, pad=pad, start=START, end=START + timedelta(minutes=90)), "firm", "other", 1)
        for pad in range(1, pads + 1)
    ]  # fmt: skip
    _, made = planned(forecast, [order("a", "jacobi", due_min=240)], [drone("d1")], holds=holds)
    for route in made.routes:
        for step in route.steps:
            if step.kind == "charge" and step.origin == window.station:
                assert step.begin >= START + timedelta(minutes=90) or step.pad is None


def test_fewest_drones_saves_a_drone_where_two_would_take_less_time(forecast):
    orders = [order("north", "jacobi", due_min=300), order("south", "coney-island", due_min=300)]
    drones = [drone("d1"), drone("d2")]
    _, quick = planned(forecast, orders, drones)
    _, few = planned(forecast, orders, drones, fewest_drones=True)
    assert quick.served == few.served == 2
    assert len(few.routes) == 1
    assert len(quick.routes) == 2
    assert quick.cost_s <= few.cost_s


@pytest.mark.parametrize(
    ("orders", "drones", "soc", "places", "least"),
    [(60, 12, 0.4, ("yankee-stadium",), 35), (60, 10, 0.3, ("elmhurst", "jacobi"), 30)],
)
def test_where_pads_are_too_few_for_all_orders_many_are_served_and_none_is_late(
    forecast, orders, drones, soc, places, least
):
    wanted = [order(f"o{one}", places[one % len(places)], 0.28, due_min=150) for one in range(orders)]
    _, made = planned(forecast, wanted, [drone(f"d{one}", soc) for one in range(drones)])
    assert made.served >= least


@pytest.mark.parametrize("seed", range(4))
def test_ways_that_are_found_once_for_all_customers_of_a_place_are_those_of_each(seed):
    random = np.random.default_rng(seed)
    where = np.array([0, 1, 1, 2, 1, 3, 4])  # the depot, customers, of which three are at one place, and two stations
    spot = random.uniform(0.0, 40.0, (5, 2))[where]
    far = np.hypot(*(spot[:, None] - spot[None]).T).T
    arcs = Arcs(*(table[None] for table in (far, 2.0 * far, 1.5 * far, 0.1 * far)))
    due = np.array([400.0, *random.uniform(20.0, 300.0, 4), 400.0, 400.0])
    zero = np.zeros(7)
    problem = arcs, Visits(zero, due, zero, zero, zero, zero), np.array([5, 6]), alike(2, 0.0, 400.0, 60.0, 1.0)
    each, once = (lay_out(*problem, Charging(0.5, 48.0, 60.0), alike=one)[0] for one in (None, where))
    assert len(each.ways.cost) > 20
    for parts in (
        (each.ways, once.ways),
        ((each.first, each.fastest, each.near), (once.first, once.fastest, once.near)),
    ):
        assert all(np.array_equal(one, other) for one, other in zip(*parts, strict=True))


def test_packages_for_one_place_are_delivered_together_and_on_its_first_passage(forecast):
    orders = [order("blood", "jacobi", 0.5, priority=1), order("plasma", "jacobi"), order("kit", "yankee-stadium")]
    _, made = planned(forecast, orders, [drone("d1")], iterations=500)
    at = {one.order: one.delivered for one in made.answers}
    first = next(step.end for step in made.routes[0].steps if step.destination == "yankee-stadium")
    assert at["blood"] == at["plasma"]
    assert at["kit"] <= first < at["blood"]


@pytest.mark.parametrize("seed", range(4))
def test_no_order_of_equal_cost_delivers_earlier(seed):
    """A tour of four customers against all of its orders, over the cheapest ways, without limits of time, charge or pads."""
    instance = random_instance(seed, customers=4, stations=2)
    tours, _, _ = evrptw.tours_of(instance)
    everywhere = np.full(len(tours.due), 1e9)
    tours = tours._replace(
        due=everywhere, ready=0 * everywhere, demand=0 * everywhere, vehicles=alike(1, 0.0, 1e9, 1e9, 1.0), battery=1e9
    )
    search = solve(tours, ToursParameters(pool=200), time_limit_s=600.0, iterations=200)
    before = search.cost
    deliver_earlier(search)
    assert search.cost == pytest.approx(before)
    rows = search.timetables()[0]
    times = rows[rows[:, KIND] == SERVE, BEGIN].sum()
    ways = {
        (a, b): int(tours.first[a, b]) for a in range(5) for b in range(5) if tours.first[a, b] < tours.first[a, b + 1]
    }
    for path in permutations(range(1, 5)):
        pairs = list(pairwise((0, *path, 0)))
        if all(pair in ways for pair in pairs) and sum(tours.ways.cost[ways[pair]] for pair in pairs) <= before + 1e-7:
            legs_s = [tours.ways.time[ways[pair]].sum() + tours.service[pair[0]] for pair in pairs]
            assert times <= np.cumsum(legs_s)[:-1].sum() + 1e-6
