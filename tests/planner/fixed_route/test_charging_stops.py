"""Charging stops on a fixed order of work: against frvcpy, against all plans on a grid of times, and flown again in plain Python."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.planners.bench_recharge import fixed_route as as_fixed_route
from skyway.models.flight.kernels import Slots
from skyway.planner.fixed_route.charging_stops import FixedRoute, charging_stops
from skyway.planner.fixed_route.way_kernels import Hops

SLOT_S = 40.0


def random_route(seed, *, slots=1, waiting=False, positions=3, pads=2, windows=False):
    """Whole seconds everywhere, so that a grid of seconds holds many good plans."""
    rng = np.random.default_rng(seed)

    def times(*shape):
        found = rng.integers(3, 30, (slots, *shape)).astype(float)
        found[rng.random(found.shape) < 0.05] = math.inf
        return found

    work, to, back, between = (
        times(*shape) for shape in ((positions - 1,), (positions, pads), (positions, pads), (pads, pads))
    )
    per_s = rng.uniform(0.006, 0.014)

    def charge(seconds):
        return np.where(np.isfinite(seconds), seconds, 0.0) * per_s * rng.uniform(0.8, 1.2, seconds.shape)

    hops = Hops(work, charge(work), to, charge(to), back, charge(back), between, charge(between), np.arange(positions))
    curves = []
    for _ in range(pads):
        knee = rng.uniform(0.5, 0.9)
        fast = rng.uniform(20.0, 60.0)
        curves.append((np.array([0.0, fast, fast * rng.uniform(1.5, 3.0)]), np.array([0.0, knee, 1.0])))
    waits = []
    for _ in range(pads):
        at = np.arange(0.0, 400.0, 20.0)
        wait = rng.integers(0, 25, len(at)).astype(float) if waiting else np.zeros(len(at))
        waits.append(np.column_stack((at, np.maximum.accumulate(at + wait) - at)))
    return FixedRoute(
        hops,
        Slots(0.0, SLOT_S, slots),
        rng.random(positions) < 0.8,
        tuple(curves),
        tuple(waits),
        0.0,
        float(rng.uniform(0.4, 1.0)),
        0.1,
        float(rng.uniform(0.9, 1.1)),
        float(rng.uniform(1.1, 1.3)),
        random_windows(rng, pads) if windows else (),
    )


def random_windows(rng, pads):
    """Pads that are there for a while only, but for the last one, which may be there always."""
    begins = rng.integers(0, 90, pads).astype(float)
    found = [(begin, begin + float(rng.integers(15, 120))) for begin in begins.tolist()]
    if rng.random() < 0.5:
        found[-1] = (-math.inf, math.inf)
    return tuple(found)


def window_of(route, pad):
    return route.windows[pad] if route.windows else (-math.inf, math.inf)


def flight(route, left_at, pad, until, to_pad, now):
    """Arrival and charge of a way, hop by hop: what `way` does, written apart from it."""
    hops, charge = route.hops, 0.0

    def hop(seconds, soc):
        nonlocal now, charge
        slot = min(max(int((now - route.slots.start_s + 1e-6) // route.slots.slot_s), 0), route.slots.length - 1)
        if route.slots.length == 1:
            slot = 0
        charge += soc[slot]
        now += seconds[slot]

    if pad is not None and until == left_at:
        hop(hops.between_s[:, pad, to_pad], hops.between_soc[:, pad, to_pad])
        return now, charge
    first = 0
    if pad is not None:
        hop(hops.from_s[:, left_at, pad], hops.from_soc[:, left_at, pad])
        first = int(hops.resume[left_at])
    for position in range(first, until):
        if not math.isfinite(now):
            return now, charge
        hop(hops.work_s[:, position], hops.work_soc[:, position])
    if to_pad is not None and math.isfinite(now):
        hop(hops.to_s[:, until, to_pad], hops.to_soc[:, until, to_pad])
    return now, charge


def least_end_on_grid(route, last_s=250):
    """End of the best plan that takes off at whole seconds: every plan of that kind is tried, stop by stop."""
    positions, pads = len(route.can_leave), len(route.curves)
    best = math.inf
    # charge that one can leave with at each second, by (position, pad)
    at = {}

    def ways(left_at, pad, charge, second):
        nonlocal best
        targets = [(positions - 1, None)]
        for to_pad in range(pads):
            if pad is not None and to_pad != pad:
                targets.append((left_at, to_pad))
            targets += [
                (until, to_pad)
                for until in range(0 if left_at is None else left_at + 1, positions)
                if route.can_leave[until]
            ]
        for until, to_pad in targets:
            there, taken = flight(route, left_at, pad, until, to_pad, float(second))
            if not math.isfinite(there) or charge - route.sure_ratio * taken < route.reserve_soc - 1e-9:
                continue
            landed = charge - route.mean_ratio * taken
            if to_pad is None:
                best = min(best, there)
                continue
            first, last = window_of(route, to_pad)
            if not first - 1e-9 <= there <= last + 1e-9:
                continue
            wait = route.waits[to_pad]
            on_pad = there + float(np.interp(there, wait[:, 0], wait[:, 1]))
            curve_s, curve_soc = route.curves[to_pad]
            for leave in range(math.ceil(there - 1e-9), int(min(last_s, last + 1.0))):
                charged = landed
                if leave >= on_pad:
                    charged = np.interp(np.interp(landed, curve_soc, curve_s) + leave - on_pad, curve_s, curve_soc)
                row = at.setdefault((until, to_pad), {})
                if charged > row.get(leave, -1.0) + 1e-12:
                    row[leave] = charged

    done = {}
    for second in range(last_s):
        if second < best:
            ways(None, None, route.soc_start, second)
            for _ in range(2):  # nothing here takes no time
                for (left_at, pad), row in list(at.items()):
                    if second in row and done.get((left_at, pad, second)) != row[second]:
                        done[(left_at, pad, second)] = row[second]
                        ways(left_at, pad, row[second], second)
    return best


def assert_flies(route, plan):
    """Fly a plan again, stop by stop: its times and charges are right, and the reserve is kept for sure."""
    now, charge, left_at, pad = plan.depart_s, route.soc_start, None, None
    assert now >= route.start_s - 1e-9
    for stop in plan.stops:
        assert route.can_leave[stop.position]
        there, taken = flight(route, left_at, pad, stop.position, stop.pad, now)
        assert charge - route.sure_ratio * taken >= route.reserve_soc - 1e-7
        assert there == pytest.approx(stop.arrive_s, abs=1e-5)
        assert charge - route.mean_ratio * taken == pytest.approx(stop.soc_arrive, abs=1e-7)
        wait = route.waits[stop.pad]
        on_pad = there + float(np.interp(there, wait[:, 0], wait[:, 1]))
        charged = stop.soc_arrive
        if stop.leave_s > on_pad:
            curve_s, curve_soc = route.curves[stop.pad]
            charged = np.interp(np.interp(charged, curve_soc, curve_s) + stop.leave_s - on_pad, curve_s, curve_soc)
        assert stop.leave_s >= there - 1e-6
        first, last = window_of(route, stop.pad)
        assert first - 1e-6 <= there
        assert stop.leave_s <= last + 1e-6
        assert stop.soc_leave <= charged + 1e-6
        now, charge, left_at, pad = stop.leave_s, stop.soc_leave, stop.position, stop.pad
    there, taken = flight(route, left_at, pad, len(route.can_leave) - 1, None, now)
    assert charge - route.sure_ratio * taken >= route.reserve_soc - 1e-7
    assert there == pytest.approx(plan.end_s, abs=1e-5)


def compare_with_all_plans(seed, **kind):
    route = random_route(seed, **kind)
    plan, on_grid = charging_stops(route), least_end_on_grid(route)
    if plan is None:
        assert math.isinf(on_grid)
        return 0
    assert_flies(route, plan)
    assert plan.end_s <= on_grid + 1e-6
    return len(plan.stops)


@settings(max_examples=4)
@given(st.integers(0, 10**6))
def test_no_plan_on_a_grid_of_seconds_ends_earlier(seed):
    compare_with_all_plans(seed)


@settings(max_examples=3)
@given(st.integers(0, 10**6))
def test_nor_where_the_wind_changes_and_pads_are_taken(seed):
    compare_with_all_plans(seed, slots=5, waiting=True)


@settings(max_examples=3)
@given(st.integers(0, 10**6))
def test_nor_where_pads_are_there_for_a_while_only(seed):
    compare_with_all_plans(seed, slots=3, waiting=True, windows=True)


@pytest.mark.slow
def test_no_plan_ends_earlier_in_many_worlds_of_pads_that_come_and_go():
    stops = [
        compare_with_all_plans(seed, slots=1 + seed % 3, waiting=seed % 2 == 0, windows=True, positions=4)
        for seed in range(120)
    ]
    assert sum(count > 0 for count in stops) >= 15


@pytest.mark.slow
def test_no_plan_ends_earlier_in_many_worlds():
    stops = [
        compare_with_all_plans(seed, slots=1 + seed % 5, waiting=seed % 2 == 0, positions=4) for seed in range(120)
    ]
    assert sum(count > 0 for count in stops) >= 25
    assert sum(count > 1 for count in stops) >= 8


def test_the_published_instance_is_solved_as_frvcpy_solves_it(shared_data):
    solver = pytest.importorskip("frvcpy.solver", reason="frvcpy, of the extra dev, is not installed")
    instance = json.loads((shared_data / "evrp/frvcp/frvcpy-instance.json").read_text())
    routes = json.loads((shared_data / "evrp/frvcp/routes_even.json").read_text())
    for name, known in routes.items():
        theirs, _ = solver.Solver(instance, known["route"], instance["max_q"], multi_insert=True).solve()
        route = as_fixed_route(instance, known["route"])
        plan = charging_stops(route)
        assert plan.end_s == pytest.approx(theirs, abs=1e-9), name
        assert plan.end_s == pytest.approx(known["obj"], abs=1e-3), name


def made_up_instance(rng):
    """Places in a square, three kinds of chargers, as frvcpy wants them."""
    customers, stations = int(rng.integers(2, 8)), int(rng.integers(1, 6))
    size = 1 + customers + stations
    at = rng.uniform(0.0, 40.0, (size, 2))
    at[1 + customers] = at[0]
    length = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
    kinds = []
    for kind in range(3):
        knee, fast = rng.uniform(0.6, 0.9), rng.uniform(0.3, 2.0)
        kinds.append(
            {
                "cs_type": kind,
                "time": [0.0, fast, 1.4 * fast, 2.2 * fast],
                "charge": [0.0, 100.0 * knee, 100.0 * (knee + (1.0 - knee) * 0.6), 100.0],
            }
        )
    return {
        "max_q": 100.0,
        "t_max": 1e3,
        "css": [{"node_id": 1 + customers + number, "cs_type": int(rng.integers(3))} for number in range(stations)],
        "process_times": [0.0] + [0.1] * customers + [0.0] * stations,
        "breakpoints_by_type": kinds,
        "energy_matrix": (length * rng.uniform(1.0, 2.2)).tolist(),
        "time_matrix": (length / 40.0).tolist(),
    }, [0, *range(1, 1 + customers), 0]


def test_made_up_instances_are_solved_as_frvcpy_solves_them():
    solver = pytest.importorskip("frvcpy.solver", reason="frvcpy, of the extra dev, is not installed")
    with_stops = without = 0
    for seed in range(40):
        instance, order = made_up_instance(np.random.default_rng(seed))
        theirs, _ = solver.Solver(instance, order, instance["max_q"], multi_insert=True).solve()
        plan = charging_stops(as_fixed_route(instance, order))
        assert (theirs is None or math.isinf(theirs)) == (plan is None), seed
        if plan is None:
            without += 1
            continue
        assert plan.end_s == pytest.approx(theirs, abs=1e-9), seed
        with_stops += len(plan.stops) > 0
    assert with_stops >= 12
    assert without >= 2


def test_a_pad_that_is_taken_is_waited_for():
    one = np.ones((1, 1, 1))
    hops = Hops(
        np.full((1, 1), 50.0), np.full((1, 1), 0.5), 5.0 * np.ones((1, 2, 1)), 0.05 * np.ones((1, 2, 1)),
        5.0 * np.ones((1, 2, 1)), 0.05 * np.ones((1, 2, 1)), one, one, np.arange(2),
    )  # fmt: skip
    curve = (np.array([0.0, 100.0]), np.array([0.0, 1.0]))
    route = FixedRoute(
        hops, Slots(0.0, 1.0, 1), np.array([True, False]), (curve,), (np.array([[0.0, 30.0]]),), 0.0, 0.5, 0.1
    )
    plan = charging_stops(route)
    # lands with 0.45 at 5 s, waits 30 s, needs 0.05 + 0.5 + 0.1
    assert plan.stops[0].on_pad_s == pytest.approx(35.0)
    assert plan.stops[0].soc_leave == pytest.approx(0.65)
    assert plan.end_s == pytest.approx(35.0 + 20.0 + 5.0 + 50.0)
