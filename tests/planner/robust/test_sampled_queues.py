"""Queues are sampled for as long as a delivery takes: no figure depends on how far."""

import math
from dataclasses import replace
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from skyway.models.composition.composition import State
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.robust.out_of_sample import PROMISING
from skyway.planner.schedule.itinerary import place_nodes

DEPART = datetime(2013, 3, 8, 9, tzinfo=ZoneInfo("America/New_York"))


@pytest.fixture(scope="module")
def policy(newyork):
    """In a windy season, when some deliveries wait for a day."""
    forecast = newyork.forecast(DEPART, HORIZON_H)
    request = Request(state=State(DEPART, "siuh-north"), destination="white-plains", payload_kg=0.5)
    return plan(newyork, request, forecast=forecast).robust.policy


def afresh(policy):
    """The same policy of a problem that has sampled no queues yet."""
    p = policy.problem
    return replace(policy, problem=Problem(p.scenario, p.request, p.drone, p.ensemble))


@pytest.mark.parametrize("runs", [400, 1500])
def test_a_simulation_is_the_same_with_queues_sampled_to_the_horizon(policy, runs):
    errors = policy.problem.usual_errors
    before = policy.simulate(errors, 300)
    short, whole = afresh(policy), afresh(policy)
    one = short.simulate(errors, runs, before=before, sample_set=PROMISING)
    other = whole.simulate(errors, runs, sample_set=PROMISING)
    assert sampled_entries(short, one.sets) < 0.8 * sampled_entries(whole, one.sets)
    for name in ("schedule", "weight", "energy_ratio", "control"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name


def sampled_entries(policy, sets):
    nodes = place_nodes(policy.problem, policy.itinerary)
    return len(policy.problem.many_queues(nodes, PROMISING, sets, -math.inf).pad_s)


def test_queues_sampled_in_parts_are_those_sampled_at_once(policy):
    one, other = (afresh(policy).problem for _ in range(2))
    nodes, rng = place_nodes(one, policy.itinerary), np.random.default_rng(1)
    whole = one.many_queues(nodes, 7, 50)
    assert np.isinf(one.queue_samples.sampled_until(one, nodes, 7, 50)).all()
    assert np.isneginf(other.queue_samples.sampled_until(other, nodes, 7, 50)).all()
    for _ in range(4):
        until_s = other.depart_s + 3600.0 * rng.uniform(0.0, 30.0, 50)
        found = other.many_queues(nodes, 7, 50, until_s)
        known_s = other.queue_samples.sampled_until(other, nodes, 7, 50)
        assert (known_s >= until_s).all()
        for number in range(0, len(found), 7):
            end_s = known_s[number % 50]
            times = np.arange(other.depart_s, end_s, 240.0)
            assert np.array_equal(found[number].pad_time(times), whole[number].pad_time(times))
            left, all_left = found[number].left_s, whole[number].left_s
            assert np.array_equal(left[left <= end_s], all_left[all_left <= end_s])
