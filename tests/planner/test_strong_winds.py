"""Winds in which some drones hardly get on: an answer with finite figures, or an error that names what binds."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest
from worlds import on_level_ground

from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.models.flight.kernels import slot_of
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import compare, plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.schedule.profile_kernels import interpolate
from skyway.planner.schedule.schedule_kernels import flight_parts

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


def blowing(speed_mps, from_deg):
    return constant_wind(speed_mps, from_deg, DEPART, HORIZON_H, 40.75, -73.97, 60.0)


def ask(start, destination, payload_kg, **changes):
    return Request(state=State(DEPART, start), destination=destination, payload_kg=payload_kg, **changes)


def figures_of(result):
    """Every number that an answer is told by."""
    outcome = result.outcome
    for service in result.composition.services:
        yield from (service.ground_speed_mps, service.tailwind_mps, service.crosswind_mps, service.energy_j)
        yield from (service.soc_depart, service.soc_arrive, service.wind.speed_mps, service.wind.from_deg)
    yield from (outcome.mean_s, outcome.quantile_s(0.5), outcome.quantile_s(0.95), outcome.p_success)


def test_a_drone_that_never_leaves_in_a_head_wind_is_told_with_the_energy_it_lacks(newyork):
    request = ask("bellevue", "jacobi", 0.8, drone="m300")
    with pytest.raises(NoRouteError, match=r"leg bellevue > \S+ .* % of the battery of m300") as refused:
        plan(newyork, request, forecast=blowing(14.0, 23.0))
    assert refused.value.constraint == "energy"


def test_a_drone_whose_first_route_never_leaves_is_chosen_when_another_of_its_routes_is_the_fastest(newyork):
    level = on_level_ground(newyork)
    chosen = plan(level, ask("bellevue", "jacobi", 0.8), forecast=blowing(11.0, 23.0))
    alone = plan(level, ask("bellevue", "jacobi", 0.8, drone="m200"), forecast=blowing(11.0, 23.0))
    assert chosen.composition.drone == "m300"
    assert chosen.outcome.mean_s < alone.outcome.mean_s - 600.0
    assert "nan" not in " ".join(chosen.rejected.values())
    assert "inf" not in " ".join(chosen.rejected.values())


@pytest.mark.parametrize(
    ("start", "destination", "payload_kg", "wind"),
    [("siuh-north", "white-plains", 0.8, (11.0, 30.0)), ("edison", "nyu-brooklyn", 1.4, (10.0, 70.0))],
)
def test_every_figure_of_a_plan_in_a_strong_wind_is_finite(newyork, start, destination, payload_kg, wind):
    result = plan(newyork, ask(start, destination, payload_kg), forecast=blowing(*wind))
    assert all(math.isfinite(value) for value in figures_of(result))


@pytest.mark.parametrize("planner", ["shortest", "pfs", "pfs-charge-aware", "pfs-strict", "exact", "ies", "robust"])
@pytest.mark.parametrize("speed_mps", [14.0, 18.0, 25.0])
def test_every_planner_answers_or_says_what_binds_in_a_wind_from_ahead(newyork, planner, speed_mps):
    request = ask("bellevue", "jacobi", 0.8, drone="m200")
    [answer] = compare(newyork, request, [planner], forecast=blowing(speed_mps, 23.0))
    if answer.result is None:
        assert answer.error.constraint in {"energy", "wind", "room", "step-limit"}
    else:
        assert all(math.isfinite(value) for value in figures_of(answer.result))


@pytest.mark.parametrize("never", [math.inf, -math.inf, math.nan])
def test_a_flight_that_never_departs_has_no_parts(newyork, never):
    request = ask("bellevue", "jacobi", 0.8)
    air = Problem(newyork, request, newyork.drone("m300"), blowing(14.0, 23.0)).air
    assert flight_parts(air, 0, np.array([0, 1]), never).shape == (0, 4)


def test_a_time_that_is_no_number_belongs_to_the_last_slot_and_one_far_off_to_the_nearest(newyork):
    request = ask("bellevue", "jacobi", 0.8)
    air = Problem(newyork, request, newyork.drone("m300"), blowing(14.0, 23.0)).air
    last = air.north.shape[1] - 1
    assert [slot_of(air, t) for t in (-math.inf, -1e300, 1e300, math.inf, math.nan)] == [0, 0, last, last, last]


def test_what_is_read_between_points_of_a_curve_at_no_number_is_no_number():
    curve = np.array([0.0, 1.0, 2.0])
    assert math.isnan(interpolate(math.nan, curve, curve))
