"""What is asked of a planner is checked against units, drone and network; the likely meaning is asked for."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from skyway.models.base.errors import InputError
from skyway.models.composition.composition import State
from skyway.planner.plan import plan
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.request import Request

DEPART = datetime(2013, 7, 10, 18, 0, tzinfo=UTC)


def ask(**more):
    state = State(more.pop("time", DEPART), "bellevue", None, more.pop("soc", 1.0), more.pop("busy_pads", {}))
    return Request(**({"state": state, "destination": "jacobi", "payload_kg": 0.8} | more))


ABSURD = {
    "reserve in percent": ({"reserve_soc": 20}, "reserve_soc", "did you mean 0.2?"),
    "reserve of a fifth of a percent": ({"reserve_soc": 0.002}, "reserve_soc", "did you mean 0.2?"),
    "reserve below nothing": ({"reserve_soc": -0.2}, "reserve_soc", "fraction"),
    "reserve unknown": ({"reserve_soc": math.nan}, "reserve_soc", "fraction"),
    "charge in percent": ({"soc": 90}, "state.soc", "did you mean 0.9?"),
    "charge without end": ({"soc": math.inf}, "state.soc", "fraction"),
    "charge as a word": ({"soc": "full"}, "state.soc", "is not a number"),
    "mode in capitals": ({"recharge": "FULL"}, "recharge", "did you mean full?"),
    "mode unknown": ({"recharge": "half"}, "recharge", "full or enough"),
    "risk in percent": ({"epsilon": 5}, "epsilon", "did you mean 0.05?"),
    "risk unknown": ({"epsilon": math.nan}, "epsilon", "probability"),
    "airspeed backwards": ({"airspeed_mps": -5.0}, "airspeed_mps", "metres per second"),
    "airspeed unknown": ({"airspeed_mps": math.nan}, "airspeed_mps", "metres per second"),
    "package in grams": ({"payload_kg": 1500.0}, "payload_kg", "did you mean 1.5?"),
    "package below nothing": ({"payload_kg": -1.0}, "payload_kg", "kilograms"),
    "seed of a half": ({"seed": 0.5}, "seed", "whole number"),
    "seed below nothing": ({"seed": -1}, "seed", "whole number"),
    "seed of truth": ({"seed": True}, "seed", "whole number"),
    "half a drone": ({"busy_pads": {"bellevue": 0.5}}, "busy_pads", "whole number"),
    "less than no drone": ({"busy_pads": {"bellevue": -1}}, "busy_pads", "whole number"),
    "no time zone": ({"time": datetime(2013, 7, 10, 18)}, "state.time", "UTC"),  # noqa: DTZ001
    "no such century": ({"time": datetime(3013, 7, 10, tzinfo=UTC)}, "state.time", "a year from"),
    "deadline before": ({"objective": Objective("on-time", DEPART - timedelta(hours=1))}, "objective", "departure"),
    "deadline next year": ({"objective": Objective("on-time", DEPART + timedelta(days=365))}, "objective", "departure"),
    "objective as a word": ({"objective": "fast"}, "objective", "mean, p95, energy, cost"),
    "objective of another kind": ({"objective": 95}, "objective", "Objective("),
}


@pytest.mark.parametrize(("wrong", "field", "remedy"), ABSURD.values(), ids=ABSURD.keys())
def test_an_absurd_request_is_refused_with_what_it_may_mean(wrong, field, remedy):
    with pytest.raises(InputError) as error:
        ask(**wrong)
    assert len(error.value.faults) == 1
    assert field in str(error.value)
    assert remedy in str(error.value)


def test_the_rest_of_a_delivery_has_its_deadline_until_that_has_passed():
    asked = ask(objective=Objective("on-time", DEPART + timedelta(hours=1)))
    before, after = (replace(asked.state, time=DEPART + timedelta(minutes=minute)) for minute in (59, 60))
    assert asked.onward(before) == replace(asked, state=before)
    assert asked.onward(after) == replace(asked, state=after, objective=Objective())


UNFIT = {
    "too fast": ({"airspeed_mps": 60.0}, "m300 flies", "did you mean 16.7 m/s (60 km/h)?"),
    "much too fast": ({"airspeed_mps": 140.0}, "m300 flies", "up to"),
    "no such station": ({"busy_pads": {"bellevu": 4}}, "busy_pads", "did you mean 'bellevue'?"),
    "nothing like a station": ({"busy_pads": {"zzz": 4}}, "busy_pads", "by their id"),
}


@pytest.mark.parametrize(("wrong", "problem", "remedy"), UNFIT.values(), ids=UNFIT.keys())
@pytest.mark.parametrize("planner", ["robust", "pfs"])
def test_a_request_that_does_not_fit_drone_or_network_is_refused(newyork, wrong, problem, remedy, planner):
    with pytest.raises(InputError) as error:
        plan(newyork, ask(drone="m300", **wrong), planner=planner)
    assert problem in str(error.value)
    assert remedy in str(error.value)


def test_a_fleet_flies_an_airspeed_with_those_that_can(newyork):
    fastest = max(newyork.drones, key=lambda drone: drone.max_airspeed_mps)
    slow = [drone.id for drone in newyork.drones if drone.max_airspeed_mps < fastest.max_airspeed_mps]
    found = plan(newyork, ask(airspeed_mps=fastest.max_airspeed_mps), planner="pfs")
    assert found.composition.drone not in slow
    assert all("m/s at most" in found.rejected[drone] for drone in slow)
