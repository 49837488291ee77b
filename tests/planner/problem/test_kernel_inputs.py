"""Kernels say what they take; whoever calls them from Python refuses the rest with a clear error, never with a wrong index."""

import importlib
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import make_request, make_wind, make_world

sys.path.append(str(Path(__file__).resolve().parents[3]))

import build_kernels
from skyway.models.base.errors import InputError
from skyway.models.flight.kernels import NEVER, next_opening, slot_end, slot_of
from skyway.models.jit import library as kernel_library
from skyway.models.queues.paths import pack
from skyway.planner.evaluation.evaluate import Realizations
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.plan import plan
from skyway.planner.problem.flight_table import FlightTable, table_slot
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.free_capacity_kernels import chance_full, chances
from skyway.planner.schedule.gust_kernels import no_disturbance
from skyway.planner.schedule.itinerary import Leg, fly_as_it_stands, fly_sampled, legs_of, place_nodes
from skyway.planner.schedule.profile_kernels import covers, profile_at, upper_profile
from skyway.planner.schedule.schedule_kernels import SOC_TAKE_OFF, Waits, fly_under, no_queues

HOSTILE = st.one_of(st.sampled_from([math.nan, math.inf, -math.inf, -1.0, 0.0, 1e300]), st.floats())
INDICES = st.lists(st.integers(-3, 40), max_size=6)


def test_every_kernel_that_python_calls_says_what_it_takes():
    silent = []
    for name in sorted({*kernel_library.listed(), *build_kernels.entries()}):
        module, _, function = name.rpartition(".")
        kernel = getattr(importlib.import_module(module), function)
        if "Takes " not in (kernel.py_func.__doc__ or ""):
            silent.append(name)
    assert silent == []


@pytest.fixture(scope="module")
def policy():
    """A small plan of `robust`, with its policy."""
    rng = np.random.default_rng(4)
    world = make_world(rng, 6, length_m=9_000.0, utilisation=0.4)
    for _ in range(30):
        try:
            return plan(world, make_request(world, rng), forecast=make_wind(rng, members=3)).robust.policy
        except Exception:  # noqa: BLE001  some requests have no route
            continue
    raise AssertionError


def paths_of(policy, sets):
    nodes = place_nodes(policy.problem, policy.itinerary)
    return policy.problem.many_queues(nodes, 0, sets)


def test_a_policy_is_flown_with_one_path_for_each_place_and_set(policy):
    paths = paths_of(policy, 2)
    members = np.zeros(4, dtype=np.int64)
    disturbance = no_disturbance(4)._replace(queue=np.array([0, 1, 0, 1]))
    schedule, _ = policy.fly(policy.problem, disturbance, members, paths)
    assert len(schedule) == 4
    each = [paths[number] for number in range(len(paths))]
    for wrong in map(pack, (each[:-1], each[: len(policy) + 1], [*each, each[0]], [])):
        with pytest.raises(InputError, match=r"paths|sky\.queue"):
            policy.fly(policy.problem, disturbance, members, wrong)


@settings(max_examples=40)
@given(members=INDICES, queue=INDICES, energy=st.lists(HOSTILE, max_size=6), gusts=st.tuples(HOSTILE, HOSTILE))
def test_hostile_runs_are_refused_or_flown(policy, members, queue, energy, gusts):
    per_leg = np.repeat(np.array(energy, dtype=np.float64)[:, None], len(policy) + 1, axis=1)
    disturbance = no_disturbance(len(queue))._replace(
        queue=np.array(queue, dtype=np.int64), energy=per_leg, gust_sd=gusts[0], gust_time_s=gusts[1]
    )
    fits = len(members) == len(queue) == len(energy) and all(0 <= one < 3 for one in members)
    fits &= all(0 <= one < 2 for one in queue) and all(0.0 <= one < math.inf for one in energy)
    fits &= 0.0 <= gusts[0] < math.inf and 0.0 < gusts[1] < math.inf
    given_members = np.array(members, dtype=np.int64)
    for fly in (
        lambda: policy.fly(policy.problem, disturbance, given_members, paths_of(policy, 2))[0],
        lambda: fly_as_it_stands(policy.problem, policy.itinerary, given_members, disturbance, paths_of(policy, 2)),
    ):
        if fits:
            assert len(fly()) == len(members)
        else:
            with pytest.raises(InputError):
                fly()


@settings(max_examples=60)
@given(
    legs=st.lists(
        st.tuples(st.lists(st.integers(-2, 60), max_size=3), st.one_of(st.none(), HOSTILE), HOSTILE), max_size=3
    )
)
def test_hostile_itineraries_are_refused_or_flown(policy, legs):
    itinerary = tuple(Leg(tuple(segments), charge, wait) for segments, charge, wait in legs)
    try:
        schedule, weight = fly_sampled(policy.problem, itinerary, 1)
    except InputError:
        return
    assert len(schedule) == len(weight) == 3


def test_nobody_charges_where_there_are_no_pads(policy):
    """An itinerary says "charge to 90 %" at a stop whose pads are gone: it leaves with what it has."""
    p = policy.problem
    legs = legs_of(p, (Leg(policy.itinerary[0].segments, 0.9),))
    low = (p.depart_s, 0.5)
    given = (p.air, np.zeros(1, dtype=np.int64))
    cost = (p.soc_per_s, p.soc_fixed)
    with_pads, without = (
        fly_under(
            no_disturbance(1),
            *given,
            legs._replace(has_pads=np.array([pads])),
            no_queues(),
            Waits(0.0, 1.0, np.zeros((1, 1))),
            low,
            cost,
        )
        for pads in (True, False)
    )
    assert with_pads[0, 0, SOC_TAKE_OFF] == pytest.approx(0.9)
    assert without[0, 0, SOC_TAKE_OFF] == 0.5


@pytest.mark.parametrize(
    "change", [lambda t: t[:, :-1], lambda t: t[:0], lambda t: np.where(t > 0, math.nan, t), lambda t: -t - 1.0]
)
def test_a_search_refuses_speeds_that_are_no_table_of_the_network(policy, change):
    p = policy.problem
    table = np.full((4, len(p.network.head)), 10.0)
    with pytest.raises(InputError, match="speeds"):
        ExactSearch(p, {}, speeds=change(table))
    with pytest.raises(InputError, match="stops"):
        ExactSearch(p, {}, stops=np.ones(2, dtype=bool))
    with pytest.raises(InputError, match="margin"):
        ExactSearch(p, {}, margin_soc_per_s=math.nan)


@pytest.mark.parametrize("field", ["max_airspeed_mps", "wind_limit_mps", "max_ground_speed_mps", "battery_j"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -5.0])
def test_a_drone_that_cannot_be_is_refused_before_a_kernel_sees_it(policy, field, value):
    p = policy.problem
    with pytest.raises(InputError):
        Problem(p.scenario, p.request, replace(p.drone, **{field: value}), p.ensemble)


@pytest.mark.parametrize("change", [{"slot_s": 0.0}, {"slot_s": math.nan}, {"start_s": math.inf}, {"height_m": -1.0}])
def test_an_ensemble_has_slots_of_some_length(policy, change):
    with pytest.raises(InputError):
        replace(policy.problem.ensemble, **change)


def test_realizations_name_days_and_queues_that_are_there(policy):
    p = policy.problem
    runs = {
        "day": np.array([0, 2]),
        "queue": np.array([0, 1]),
        "vehicle_key": np.zeros(2, dtype=np.uint64),
        "gust_key": np.zeros(2, dtype=np.uint64),
    }
    days = (1, 2, 3)
    fixed = {
        "scenario": p.scenario,
        "request": p.request,
        "days": days,
        "wind": p.ensemble,
        "queue_seed": 0,
        "errors": None,
    }
    assert len(Realizations(**fixed, **runs)) == 2
    for wrong in (
        {"day": np.array([0, 3])},
        {"queue": np.array([0, -1])},
        {"vehicle_key": np.zeros(3, dtype=np.uint64)},
        {"day": np.array([-1, 0])},
    ):
        with pytest.raises(InputError):
            Realizations(**fixed, **(runs | wrong))


@settings(max_examples=80)
@given(time_s=HOSTILE, slot=st.integers(-5, 10**9), most=st.integers(0, 9))
def test_kernels_that_take_any_time_take_any_time(policy, time_s, slot, most):
    air = policy.problem.air
    assert 0 <= slot_of(air, time_s) < air.north.shape[1]
    assert slot_end(air, slot) > air.start_s or slot < 0
    opening = next_opening(air, 0, np.zeros(1, dtype=np.int64), time_s)
    assert opening >= time_s or math.isnan(time_s) or opening == NEVER
    profile = np.arange(3.0 * most).reshape(most, 3)
    found, _ = profile_at(profile, time_s)
    assert not math.isfinite(found) or most
    assert len(upper_profile(profile, profile[:0])) == most
    assert covers(profile, profile[:0], 0.0)


@settings(max_examples=80)
@given(
    pads=st.integers(0, 9),
    spots=st.integers(0, 9),
    load=st.tuples(st.floats(0.0, 1e4), st.floats(0.0, 1e4)),
    seen=st.integers(0, 2000),
)
def test_a_chance_is_a_chance_whatever_stands_there(pads, spots, load, seen):
    chance = chance_full(pads, spots, *load, seen)
    assert 0.0 <= chance <= 1.0 + 1e-9
    assert chance == pytest.approx(1.0) or pads * load[1] > 0.0 or seen < pads + spots
    several = chances(*(np.array([one]) for one in (pads, spots, *load, seen)))
    assert several[0] == chance


def test_a_table_has_a_slot_for_any_time(policy):
    p = policy.problem
    air, net = p.air, p.network
    speeds = np.full((4, len(net.head)), 10.0)
    table = FlightTable(
        air.start_s, air.slot_s, air.climb_s, air.descent_s, net.first, net.head, air.distance_m, speeds
    )
    assert all(
        0 <= table_slot(table, one) < len(table.speed_mps) for one in (math.inf, -math.inf, math.nan, 0.0, 1e300)
    )
