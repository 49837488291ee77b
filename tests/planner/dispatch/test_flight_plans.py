"""Parts of a route as they are given to workers, and the time of flights that plans and simulated worlds share."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from skyway.missions.checks.manoeuvres import LIFT_OFF_S, TOUCH_DOWN_S, turn_s
from skyway.missions.examples import NEW_YORK
from skyway.models.orders.fitting import fit
from skyway.models.orders.order import Order, Vehicle
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.forecast import constant_wind
from skyway.planner.dispatch.flight_plans import composed, flights_of
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.dispatch.result import Route, Step
from skyway.planner.parameters.planner import USUAL

START = datetime(2013, 7, 10, 18, tzinfo=UTC)


def step(kind, phase, origin, destination, begin_min, end_min, soc=(0.8, 0.5)):
    begin, end = (START + timedelta(minutes=one) for one in (begin_min, end_min))
    return Step(kind=kind, order="one", phase=phase, origin=origin, destination=destination, begin=begin, end=end, soc_begin=soc[0], soc_end=soc[1])  # fmt: skip


@pytest.fixture(scope="module")
def new_york():
    return read_scenario(NEW_YORK)


@pytest.fixture(scope="module")
def calm(new_york):
    return constant_wind(0.0, 270.0, START, 48, 40.7, -73.9, new_york.rules.cruise_height_m)


def test_a_charge_after_the_landing_at_the_package_is_made_by_the_part_with_the_package():
    fetch = step("fly", "to the package", "bellevue", "jacobi", 0, 12)
    charge = step("charge", "to the package", "jacobi", "jacobi", 12, 40, (0.5, 0.8))
    bring = step("fly", "with the package", "jacobi", "bellevue", 40, 52)
    first, second = flights_of(Route(drone="d", type="m200", orders=("one",), steps=(fetch, charge, bring)))
    assert (first.phase, first.steps, first.destination) == ("to the package", (fetch,), "jacobi")
    assert (second.phase, second.steps, second.begin) == ("with the package", (charge, bring), charge.begin)


def test_a_stop_is_left_with_the_planned_charge_though_the_drone_came_early_and_with_more(new_york, calm):
    fetch = step("fly", "with the package", "bellevue", "jacobi", 0, 12, (0.9, 0.3))
    charge = step("charge", "with the package", "jacobi", "jacobi", 12, 90, (0.3, 0.75))
    bring = step("fly", "with the package", "jacobi", "bellevue", 90, 102)
    route = Route(drone="d", type="m200", orders=("one",), steps=(fetch, charge, bring))
    (part,) = flights_of(route)
    found = composed(new_york, calm, "m200", 0.5, part, USUAL, reserve=0.2)
    (stop,) = found.stops
    assert stop.soc_from > 0.4
    assert stop.soc_to == pytest.approx(0.75)
    assert found.services[-1].depart < bring.begin


def test_the_time_of_a_flight_has_the_ground_and_the_manoeuvres_and_only_these_take_charge(new_york, calm):
    vehicle = Vehicle(id="d", type="m200", home="bellevue", place="bellevue")
    order = Order(
        id="one", origin="bellevue", destination="jacobi", mass_kg=0.5, ready=START, due=START + timedelta(hours=2)
    )
    work = fit(new_york, [order], [vehicle])

    def flights(ground_s=0.0, manoeuvres_s=0.0):
        parameters = replace(USUAL, dispatch=replace(USUAL.dispatch, ground_s=ground_s), online=replace(USUAL.online, manoeuvres_s=manoeuvres_s))  # fmt: skip
        laid = lay_out_problem(work, START, calm, parameters, margins=False)
        network = new_york.network
        nodes = [laid.places.index(network.index[one]) for one in ("bellevue", "jacobi")]
        at = 0, 0, nodes[0], nodes[1]
        return laid.problem.flights.time_s[at], laid.problem.flights.need[at]

    (still_s, needs), (ground_s, same), (slow_s, more) = flights(), flights(ground_s=40.0), flights(manoeuvres_s=30.0)
    assert ground_s - still_s == pytest.approx(40.0)
    assert same == needs
    assert slow_s - still_s == pytest.approx(30.0)
    assert more - needs == pytest.approx(30.0 / new_york.drone("m200").endurance_empty_s, rel=0.01)


def test_manoeuvres_are_those_of_a_straight_way_by_their_physics(new_york):
    drone = new_york.drone("m200")
    straight_s = LIFT_OFF_S + TOUCH_DOWN_S + 2.0 * turn_s(drone.cruise_airspeed_mps)
    assert USUAL.online.manoeuvres_s == pytest.approx(straight_s, abs=3.0)
