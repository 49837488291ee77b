"""A delivery that is simulated as it is supervised: in the wind that plans count on it is what a plan says, in another one it is turned."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from skyway.models.composition.composition import State
from skyway.models.flight.kernels import land
from skyway.models.wind.forecast import constant_wind
from skyway.planner.evaluation.flights import DELIVERED
from skyway.planner.evaluation.realizations import Realizations
from skyway.planner.evaluation.watched import WatchedDelivery
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import Errors
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


def delivery(newyork, truth_mps, told_mps):
    """One delivery in a steady wind from the west, without gusts, of a drone that is told another one."""
    request = Request(state=State(DEPART, "bellevue"), destination="columbia", payload_kg=0.8, drone="m200")
    truth, told = (
        constant_wind(speed, 270.0, DEPART, HORIZON_H, 40.7, -74.0, newyork.rules.cruise_height_m)
        for speed in (truth_mps, told_mps)
    )
    both = replace(
        told, north=np.repeat(told.north, 2, axis=0), east=np.repeat(told.east, 2, axis=0), probability=np.full(2, 0.5),
        labels=("a", "b"),
    )  # fmt: skip
    result = plan(newyork, request, planner="robust", forecast=both)
    problem = result.problem
    one = np.zeros(1, dtype=np.int64)
    realizations = Realizations(
        scenario=newyork, request=request, days=(DEPART.date(),), wind=truth, day=one, queue=one, queue_seed=3,
        vehicle_key=np.ones(1, dtype=np.uint64), gust_key=np.ones(1, dtype=np.uint64),
        errors=Errors(gust_sd=0.0), ratios=np.ones((1, 12)),
    )  # fmt: skip
    return result, WatchedDelivery(realizations, problem, np.random.default_rng(0), result.composition).fly()


def test_in_the_wind_that_was_told_a_flight_takes_what_the_plan_says(newyork):
    result, flown = delivery(newyork, 4.0, 4.0)
    problem = result.problem
    assert flown.ending[0] == DELIVERED
    assert not flown.below_reserve[0]
    network = problem.network
    pairs = zip(network.tail.tolist(), network.head.tolist(), strict=True)
    direct = list(pairs).index((network.index["bellevue"], network.index["columbia"]))
    takes_s = land(problem.air, 0, np.array([direct]), problem.depart_s) - problem.depart_s
    assert flown.flight_s[0] == pytest.approx(takes_s, rel=1e-3)
    used = problem.soc_fixed + problem.soc_per_s * takes_s
    assert flown.lowest_soc[0] == pytest.approx(problem.soc - used, abs=1e-3)


def test_in_a_wind_that_nobody_told_it_still_keeps_the_reserve(newyork):
    _, flown = delivery(newyork, 11.0, 2.0)
    assert flown.ending[0] == DELIVERED
    assert not flown.below_reserve[0]


def test_the_plan_is_in_force_until_it_is_flown(newyork, monkeypatch):
    asked = []
    on_ground = OnlinePolicy.on_ground

    def noted(self, info, **how):
        asked.append((info.station, info.plan, how))
        return on_ground(self, info, **how)

    monkeypatch.setattr(OnlinePolicy, "on_ground", noted)
    result, flown = delivery(newyork, 4.0, 4.0)
    assert flown.ending[0] == DELIVERED
    station, in_force, how = asked[0]
    assert (station, in_force, how) == ("bellevue", result.composition, {"tell": True})
