"""Promises of a plan: the worlds in which it is flown, against the execution of studies and against what is drawn."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.missions.examples import NEW_YORK
from skyway.models.ledger.ledger import Hold
from skyway.models.ledger.window import Window
from skyway.models.orders.fitting import fit
from skyway.models.orders.order import Order, Vehicle
from skyway.models.queues.load import PadLoad
from skyway.models.queues.seen_pads import PadsSeen
from skyway.models.queues.waiting_times import forecast_waits
from skyway.models.scenario.file import read_scenario
from skyway.planner.capacity.execution import carry_out
from skyway.planner.dispatch.departure_margin import DepartureMargin
from skyway.planner.dispatch.dispatch import dispatch
from skyway.planner.dispatch.flights import lay_out_problem
from skyway.planner.parameters.planner import USUAL
from skyway.planner.promises.flown_kernels import World, flown
from skyway.planner.promises.promises import fly_plan, outlook, promised, steps_of
from skyway.planner.promises.worlds import (
    asked_of,
    checked_ratio,
    checks_of,
    members_of,
    others_of,
    ratios_of,
    times_of,
    winds_of,
)

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
RESERVE = 0.2


@pytest.fixture(scope="module")
def work():
    """Ten drones and fourteen orders between few stations of New York, whose pads others keep half busy."""
    scenario = read_scenario(NEW_YORK)
    pads = np.maximum(scenario.network.pads, 1)
    charging = np.full((len(scenario.network), 168), 2400.0)
    rates = np.where(scenario.network.pads[:, None] > 0, 0.5 * pads[:, None] / charging, 0.0)
    scenario = replace(scenario, load=PadLoad(rates, charging, scenario.timezone))
    rng = np.random.default_rng(4)
    stations = [one.id for one in scenario.network.stations if one.pads][:9]
    fleet = [Vehicle(id=f"d{one}", type="m200", home=home, place=home, soc=float(rng.uniform(0.4, 0.9))) for one, home in enumerate(rng.choice(stations, 10))]  # fmt: skip
    orders = []
    for one in range(14):
        begin, end = rng.choice(stations, 2, replace=False)
        ready = START + timedelta(minutes=float(rng.uniform(0.0, 40.0)))
        orders.append(Order(id=f"o{one}", origin=begin, destination=end, mass_kg=0.5, ready=ready, due=ready + timedelta(minutes=130)))  # fmt: skip
    return fit(scenario, orders, fleet)


@pytest.fixture(scope="module")
def forecast(work):
    return work.scenario.forecast(START, 48)


@pytest.fixture(scope="module")
def plan(work, forecast):
    made = dispatch(work, START, forecast=forecast, iterations=20, time_limit_s=60.0)
    assert made.served > 8
    return made


MARGIN = DepartureMargin(1.1, 1.2, 1.1, 1.25, (-0.02, 0.0, 0.03))


class SameWorld:
    """A world as the execution of studies asks for it."""

    def __init__(self, work, laid, steps, world, routes):
        self.flights, self.steps, self.world = laid.problem.flights, steps, world
        self.place = {work.scenario.network.stations[node].id: number for number, node in enumerate(laid.places)}
        number = {one.id: place for place, one in enumerate(work.vehicles)}
        self.at = {id(one): int(steps.first[number[route.drone]]) + place for route in routes for place, one in enumerate(route.steps)}  # fmt: skip

    def _key(self, step, begin_s):
        slot = min(max(int((begin_s - self.flights.start_s) / self.flights.slot_s), 0), self.world.time_s.shape[1] - 1)
        return int(self.steps.mode[self.at[id(step)]]), slot, self.place[step.origin], self.place[step.destination]

    def flight(self, _, step, begin_s):
        key = self._key(step, begin_s)
        at = self.at[id(step)]
        takes_s = self.world.more_s[at] + self.world.pace[at] * self.world.time_s[key]
        return float(takes_s), float(self.world.ratio[at] * self.steps.mass[at] * self.world.need[key])

    def wanted(self, _, step, begin_s):
        key, at = self._key(step, begin_s), self.at[id(step)]
        along_s = self.world.time_s[key] - self.steps.fixed_s
        ratio = MARGIN.share + MARGIN.pace_mps * along_s / self.steps.far_m[at]
        ratio = np.clip(ratio, MARGIN.least, MARGIN.most) + self.world.asked[at]
        return float(ratio * self.steps.mass[at] * self.world.need[key])

    def charging_s(self, _, place, soc, up_to):
        curve = self.flights.curve_of[0, self.place[place]]
        return float(np.diff(np.interp([soc, up_to], self.flights.curve_soc[curve], self.flights.curve_s[curve]))[0])


def test_a_world_is_flown_as_the_execution_of_studies_flies_it(work, plan, forecast):
    laid = lay_out_problem(work, START, forecast, USUAL, margins=False)
    stations = work.scenario.network.stations
    pads = np.array([stations[node].pads for node in laid.places])
    flights = laid.problem.flights._replace(pads=pads, first_pad=np.cumsum(pads) - pads)
    winds = winds_of(work, laid, START, forecast, USUAL, 5)
    random = np.random.default_rng(1)
    steps = steps_of(work, laid, plan.routes, winds, checked=checks_of(work, 0.1, {"m200": MARGIN}))
    owner = np.repeat(np.arange(10), np.diff(steps.first))
    times, asked = times_of(owner, 8, random, USUAL), asked_of(work, owner, 8, random, {"m200": MARGIN})
    times.charging[:] = 1.0  # the execution has no such factor
    ratio, others = ratios_of(work, owner, 8, random), others_of(work, laid, START, 8, random)
    others.come_s[:] += 1e-6 * np.arange(
        len(others.come_s)
    )  # nobody at the same instant: the execution would let the shorter one go first
    ready = {one.id: one.ready.timestamp() for one in work.orders}
    delivered = 0
    for number in range(8):
        member = number % 5
        world = World(winds.time_s[member], winds.need[member], ratio[number], times.pace[number], times.more_s[number], times.charging[number], asked[number], others.come_s, others.lasts_s, others.begin[number])  # fmt: skip
        at_s, lowest = np.full(len(work.orders), np.inf), np.full(len(steps.kind), np.nan)
        flown(flights, steps, world, at_s, lowest)
        drawn = {}
        for place, node in enumerate(laid.places):
            span = slice(others.begin[number, place], others.begin[number, place + 1])
            drawn[stations[node].id] = list(zip(others.come_s[span].tolist(), others.lasts_s[span].tolist(), strict=True))  # fmt: skip
        truth = SameWorld(work, laid, steps, world, plan.routes)
        done = carry_out(plan.routes, ready, {one.id: one.pads for one in stations if one.pads}, drawn, START.timestamp(), truth, RESERVE)  # fmt: skip
        expected = [done.delivered_s.get(one.id, np.inf) for one in work.orders]
        assert at_s - START.timestamp() == pytest.approx(np.array(expected) - START.timestamp())
        assert np.sort(lowest[np.isfinite(lowest)]) == pytest.approx(np.sort(done.lowest))
        delivered += len(done.delivered_s)
    assert delivered > 50


def test_promises_have_a_probability_and_the_reserve_is_kept(work, plan, forecast):
    found = promised(work, plan, forecast, USUAL)
    served = [one for one in found.answers if one.status == "served"]
    assert all(one.outlook is not None and 0.0 <= one.outlook.chance <= 1.0 for one in served)
    assert all(one.outlook.p50 <= one.outlook.p95 for one in served if one.outlook.p95 is not None)
    assert found.below_reserve is not None
    assert found.below_reserve <= 0.002
    assert promised(work, plan, forecast, USUAL) == found, "the same seed, the same worlds"
    later = {one.id: one.due + timedelta(hours=2) for one in work.orders}
    more = promised(work, plan, forecast, USUAL, by=later)
    assert all(b.outlook.chance >= a.outlook.chance for a, b in zip(found.answers, more.answers, strict=True) if a.outlook)  # fmt: skip


def test_pads_that_are_seen_full_or_held_by_others_make_orders_late(work, plan, forecast):
    free = PadsSeen({one.id: 0 for one in work.scenario.network.stations if one.pads}, {})
    full = PadsSeen({one.id: 3 * one.pads for one in work.scenario.network.stations if one.pads}, {})
    window = [Hold("x", 1, 1, Window(station=one.id, pad=pad + 1, start=START, end=START + timedelta(hours=3)), "firm", "other", 1) for one in work.scenario.network.stations for pad in range(one.pads)]  # fmt: skip

    def in_time(**known):
        return np.mean([one.outlook.chance for one in promised(work, plan, forecast, USUAL, **known).answers if one.outlook])  # fmt: skip

    assert in_time(seen=free) > in_time() > in_time(seen=full)
    assert in_time(seen=free) > in_time(seen=free, holds=window)


def test_a_fleet_is_planned_from_the_pads_that_are_seen(work, forecast):
    stations = [one for one in work.scenario.network.stations if one.pads]
    costs = []
    for present in (0, 1, 4):
        seen = PadsSeen({one.id: present * one.pads for one in stations}, {})
        costs.append(dispatch(work, START, forecast=forecast, iterations=0, time_limit_s=60.0, bounded=False, seen=seen).cost_s)  # fmt: skip
    assert costs[0] < costs[1] < costs[2]
    usual = dispatch(work, START, forecast=forecast, iterations=0, time_limit_s=60.0, bounded=False)
    assert costs[0] < usual.cost_s < costs[2]


def test_strangers_wait_as_the_queue_model_says_from_what_was_seen_on(work, forecast):
    """Mean wait of an arrival after an hour, by the drawn strangers and by the transient queue (`models.queues.waiting_times`)."""
    laid = lay_out_problem(work, START, forecast, USUAL, margins=False)
    node = laid.places[0]
    station = work.scenario.network.stations[node]
    few = replace(laid, places=laid.places[:1])
    for busy in (0, station.pads + 2):
        others = others_of(work, few, START, 4000, np.random.default_rng(2), seen=PadsSeen({station.id: busy}, {}))
        waits = []
        for number in range(4000):
            free = np.full(station.pads, -np.inf)
            span = slice(others.begin[number, 0], others.begin[number, 1])
            for come, lasts in zip(others.come_s[span], others.lasts_s[span], strict=True):
                if come <= START.timestamp() + 3600.0:
                    pad = int(free.argmin())
                    free[pad] = max(free[pad], come) + lasts
            waits.append(max(free.min() - START.timestamp() - 3600.0, 0.0))
        expected = forecast_waits(work.scenario.load, work.scenario.network.pads, [node], START.timestamp(), 2, {node: busy})  # fmt: skip
        assert np.mean(waits) == pytest.approx(expected[node].wait_s[6], abs=4.0 * np.std(waits) / np.sqrt(4000) + 2.0)


@settings(max_examples=60)
@given(st.lists(st.one_of(st.floats(0.0, 1e5), st.just(np.inf)), min_size=1, max_size=40), st.floats(0.0, 1e5))
def test_whatever_the_worlds_the_chance_and_the_quantiles_fit_together(times, by_s):
    found = outlook(np.array(times), by_s)
    assert found.chance == pytest.approx(np.mean([one <= by_s + 1e-6 for one in times]))
    if found.p95 is not None and found.p95.timestamp() < by_s - 1.0:
        assert found.chance >= 0.95 - 1e-9
    if found.p50 is None:
        assert sum(np.isinf(times)) >= len(times) / 2


@settings(max_examples=60)
@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=30), st.integers(1, 300), st.integers(0, 99))
def test_members_come_as_often_as_they_are_probable(weights, worlds, seed):
    probability = np.array(weights) / np.sum(weights)
    count = np.bincount(members_of(probability, worlds, np.random.default_rng(seed)), minlength=len(weights))
    assert count.sum() == worlds
    assert np.abs(np.cumsum(count) - worlds * np.cumsum(probability)).max() <= 1.0 + 1e-6


def test_the_check_is_that_of_all_but_epsilon(work):
    belief = work.scenario.drone("m200").energy_belief
    ratio = ratios_of(work, np.zeros(50, dtype=np.int64), 20_000, np.random.default_rng(3))
    assert (ratio > checked_ratio(belief, 0.0, 0.01)).mean() == pytest.approx(0.01, abs=0.002)
    assert checked_ratio(belief, 0.0, 0.5) == pytest.approx(belief.mean_ratio)
    assert checked_ratio(belief, 0.12, 0.001) > checked_ratio(belief, 0.0, 0.001)


def test_without_worlds_a_plan_has_no_probabilities(work, plan, forecast):
    none = replace(USUAL, dispatch=replace(USUAL.dispatch, worlds=0))
    assert promised(work, plan, forecast, none) is plan
    assert fly_plan(work, plan.routes, START, forecast, USUAL).delivered_s.shape == (200, 14)


def test_the_landing_of_a_drone_in_the_air_is_not_certain(work, plan, forecast):
    (first, *_) = [route for route in plan.routes if route.steps]
    alone = [route for route in plan.routes if route.drone == first.drone]
    exact = replace(USUAL, dispatch=replace(USUAL.dispatch, worlds=400))
    far_s = 3600.0
    vehicles = tuple(replace(one, available_from=START + timedelta(seconds=far_s)) if one.id == first.drone else one for one in work.vehicles)  # fmt: skip
    later = replace(work, vehicles=vehicles)
    number = [one.id for one in work.orders].index(first.orders[0])
    known = fly_plan(later, alone, START, forecast, exact).delivered_s[:, number]
    drawn = fly_plan(later, alone, START, forecast, exact, in_air_s={first.drone: far_s}).delivered_s[:, number]
    both = np.isfinite(known) & np.isfinite(drawn)
    assert both.mean() > 0.9
    moved_s = drawn[both] - known[both]
    assert np.std(moved_s) > 0.01 * far_s
    assert abs(np.median(moved_s)) < 0.02 * far_s


def test_with_windows_no_part_of_a_route_begins_before_its_time(work, plan, forecast):
    late = timedelta(hours=1)
    routes = [replace(route, steps=tuple(replace(one, begin=one.begin + late, end=one.end + late) for one in route.steps)) for route in plan.routes]  # fmt: skip
    free = fly_plan(work, routes, START, forecast, USUAL).delivered_s
    kept = fly_plan(work, routes, START, forecast, USUAL, windows=True).delivered_s
    first = {route.orders[0]: route.steps[0].begin.timestamp() for route in routes if route.orders}
    columns = [number for number, one in enumerate(work.orders) if one.id in first]
    begins = np.array([first[work.orders[one].id] for one in columns])
    assert (kept[:, columns] > begins).all()
    assert (free[:, columns] < begins + 600.0).any()
    assert np.isfinite(kept).mean() > 0.5
