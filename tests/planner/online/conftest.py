"""A delivery from Bellevue to Jacobi, planned and decided about."""

import pytest
from bellevue_flights import DEPART, QUICK

from skyway.models.composition.composition import State
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request


@pytest.fixture(scope="module")
def request_():
    state = State(DEPART, "bellevue")
    return Request(state=state, destination="jacobi", payload_kg=0.8, drone="m200")


@pytest.fixture(scope="module")
def policy(newyork, request_):
    return OnlinePolicy(newyork, request_)


@pytest.fixture(scope="module")
def composition(newyork, request_):
    return plan(newyork, request_, planner=QUICK, forecast=newyork.forecast(DEPART, HORIZON_H)).composition
