"""The next step by hindsight: what it must be sure of, and when it lands on the way."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from worlds import on_level_ground

from benchmarks.cases.loads import scaled_to
from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.wind.forecast import constant_wind
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.online.hindsight import Hindsight
from skyway.planner.problem.error_model import NO_ERRORS, USUAL_ERRORS
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request

KNOWN = EnergyBelief(1.0, 0.6 * 0.005, 0.0)
DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


@pytest.fixture(scope="module")
def nobody(newyork):
    """New York without other drones, with room everywhere."""
    return replace(newyork, load=scaled_to(newyork.load, 1e-6, newyork.network.pads))


def problem_of(world, soc=1.0, wind_mps=5.0):
    request = Request(
        state=State(DEPART, "siuh-north", None, soc), destination="white-plains", payload_kg=0.8, drone="m200"
    )
    wind = constant_wind(wind_mps, 40.0, DEPART, HORIZON_H, 40.7, -74.0, world.rules.cruise_height_m)
    return Problem(world, request, world.drone("m200"), wind)


def test_with_nothing_unsure_the_step_is_that_of_the_exact_planner(nobody):
    problem = problem_of(nobody)
    step = Hindsight(problem, NO_ERRORS).choose()
    found = ExactSearch(problem, problem.queue_paths(range(len(problem.network)), 0))
    first = found.solve()[0]
    assert step.segments == first.segments
    assert step.arrival_s >= found.best_s - 1e-6  # no step leads to more than the best there is


def test_a_flight_over_stations_need_only_be_sure_of_the_next(nobody):
    problem = problem_of(nobody)
    seen = Hindsight(problem, USUAL_ERRORS)
    long = max(
        (
            seen.choose().segments,
            ExactSearch(problem, problem.queue_paths(range(len(problem.network)), 0)).solve()[0].segments,
        ),
        key=len,
    )
    assert len(long) > 1
    assert seen.sure_of(long) == 1
    assert seen.need(long[:1], problem.depart_s) < seen.need(long, problem.depart_s)


def test_a_vehicle_that_has_shown_what_it_takes_needs_that_and_little_more(nobody):
    problem = problem_of(nobody)
    way = problem.network.first[problem.origin], problem.network.first[problem.origin] + 1
    segments = tuple(range(*way))
    known = {
        energy: Hindsight(problem, USUAL_ERRORS, belief=EnergyBelief(energy, 0.003 * energy, 0.0)).need(
            segments, problem.depart_s
        )
        for energy in (0.96, 1.04)
    }
    unsure = Hindsight(problem, USUAL_ERRORS).need(segments, problem.depart_s)
    taken = [value - problem.reserve for value in (known[0.96], known[1.04])]
    assert taken[1] / taken[0] == pytest.approx(1.04 / 0.96, rel=1e-6)
    assert known[1.04] < unsure + 1e-3


def test_over_a_station_it_lands_where_the_rest_is_too_far(nobody):
    problem = problem_of(nobody)
    first = ExactSearch(problem, problem.queue_paths(range(len(problem.network)), 0)).solve()[0].segments
    over = int(problem.network.head[first[0]])
    for soc, lands in ((0.9, False), (problem.reserve + problem.soc_fixed + 90.0 * problem.soc_per_s, True)):
        above = problem.standing_at(over, problem.depart_s + 300.0, soc, in_flight=True)
        step = Hindsight(above, USUAL_ERRORS, belief=KNOWN).choose()
        assert (step.segments == ()) is lands
        assert math.isfinite(step.arrival_s)


def test_what_is_begun_keeps_the_need_of_its_sure_stretch(nobody):
    problem = problem_of(nobody, soc=0.35, wind_mps=9.0)
    seen = Hindsight(problem, USUAL_ERRORS, belief=KNOWN)
    step = seen.choose()
    assert step.charge >= seen.need(step.segments[: step.sure], problem.depart_s) - 1e-9 or not step.segments


def against_the_wind(world, **state):
    """One flight of 9.9 km in a head wind of 9 m/s, for which a battery is not sure to be enough."""
    world = on_level_ground(world)
    network = world.network
    ways = zip(network.tail.tolist(), network.head.tolist(), network.bearing_deg.tolist(), strict=True)
    bellevue, queens = network.index["bellevue"], network.index["nyp-queens"]
    from_deg = next(bearing for tail, head, bearing in ways if (tail, head) == (bellevue, queens)) % 360.0
    wind = constant_wind(9.0, from_deg, DEPART, HORIZON_H, 40.7, -74.0, world.rules.cruise_height_m)
    here = State(DEPART, "bellevue", None, 1.0, **state)
    return Problem(
        world, Request(state=here, destination="nyp-queens", payload_kg=0.8, drone="m200"), world.drone("m200"), wind
    )


def test_a_flight_for_which_the_battery_may_not_do_is_begun_where_it_can_turn_back(nobody):
    problem = against_the_wind(nobody)
    step = Hindsight(problem, USUAL_ERRORS, belief=KNOWN).choose()
    assert Hindsight(problem, USUAL_ERRORS, belief=KNOWN).need(step.segments, problem.depart_s) > 1.0
    assert step.turn_back is not None
    network = problem.network
    assert int(network.head[step.turn_back.back]) == problem.origin
    assert int(network.head[step.segments[0]]) == problem.destination


def test_it_is_not_begun_where_others_have_taken_the_room_to_come_back(nobody):
    problem = against_the_wind(nobody)
    station = nobody.network.stations[problem.origin]
    full = station.pads + station.holding_spots
    for there, behind in ((full, 0), (full - 1, 1)):
        problem = against_the_wind(nobody, busy_pads={"bellevue": there})
        assert Hindsight(problem, USUAL_ERRORS, belief=KNOWN, behind=behind).choose().turn_back is None
