"""Parameters of planners reach the planners, and stay with their answers."""

import json
from dataclasses import replace

import numpy as np
import pytest
from worlds import make_request, make_wind, make_world

from skyway.models.base.errors import InputError
from skyway.models.base.parameters import with_settings
from skyway.models.composition.file import from_json, to_json
from skyway.planner.parameters.exact import ExactParameters
from skyway.planner.parameters.planner import PlannerParameters
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem


@pytest.fixture
def asked():
    rng = np.random.default_rng(4)
    scenario = make_world(rng)
    return scenario, make_request(scenario, rng), make_wind(rng, members=6)


def parameters(*settings):
    return with_settings(PlannerParameters(), settings)


def test_what_was_set_is_kept_with_the_plan_and_read_back_from_its_file(asked):
    scenario, request, wind = asked
    chosen = parameters("robust.members=4", "robust.final_runs=60", "robust.margins=0.2,0.3")
    result = plan(scenario, request, forecast=wind, parameters=chosen)
    assert len(result.problem.probability) == 4
    assert result.composition.arrival.runs == 60
    kept = {
        "planner.robust.members": "4", "planner.robust.margins": "0.2,0.3", "planner.robust.final_runs": "60",
    }  # fmt: skip
    document = to_json(result.composition)
    assert document["parameters"] == kept
    assert dict(from_json(json.dumps(document)).parameters) == kept
    del document["parameters"]  # a file of before
    assert dict(from_json(json.dumps(document)).parameters) == {}


def test_a_plan_with_defaults_names_none(asked):
    scenario, request, wind = asked
    assert to_json(plan(scenario, request, forecast=wind, planner="pfs").composition)["parameters"] == {}


@pytest.mark.parametrize("settings", [("exact.coarse_cells=60", "exact.fine_s=60"), ("exact.refinements=inf",)])
def test_the_exact_answer_does_not_depend_on_its_cells(asked, settings):
    scenario, request, wind = asked
    truth = wind.member(0)
    usual = plan(scenario, request, planner="exact", forecast=truth)
    other = plan(scenario, request, planner="exact", forecast=truth, parameters=parameters(*settings))
    assert other.itinerary == usual.itinerary
    assert other.outcome.mean_s == pytest.approx(usual.outcome.mean_s, abs=1e-3)


def test_problems_made_of_a_problem_keep_its_parameters(asked):
    scenario, request, wind = asked
    chosen = parameters("robust.members=3")
    problem = Problem(scenario, request, scenario.drones[0], wind, parameters=chosen)
    others = (
        problem.thinned(3), problem.for_drone(scenario.drones[0]),
        problem.standing_at(0, problem.depart_s, 0.5),
    )  # fmt: skip
    assert all(other.parameters is chosen for other in others)


def test_deadlines_of_the_exact_search_must_end_open():
    with pytest.raises(InputError, match="must end with inf"):
        replace(ExactParameters(), deadlines=(0.1, 0.2))
