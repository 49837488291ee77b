"""Deliveries simulated in truths that their plan did not know."""

import json
import math
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.evaluation.evaluate import (
    NO_ERRORS,
    Errors,
    OpenLoop,
    Rolling,
    clairvoyant_times,
    evaluate,
    fly_itinerary,
    fly_policy,
    held_out_forecast,
    sample_realizations,
    season_days,
    summarise,
)
from skyway.planner.evaluation.flights import DELIVERED, GAVE_UP, STRANDED, Flown, schedules
from skyway.planner.evaluation.parts import fly_parts
from skyway.planner.evaluation.statistics import DayBootstrap, Estimate
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.information import Departure
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.schedule.gust_kernels import GUST_STEP_S, LATERAL, MAX_DEVIATION, gust_at
from skyway.planner.schedule.itinerary import Leg, fly_true
from skyway.planner.schedule.outcome import Outcome
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN
from tests.plain_deviates import plain_normals

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)


@pytest.fixture(scope="module")
def request_(newyork):
    return Request(state=State(DEPART, "siuh-north"), destination="white-plains", payload_kg=0.8, drone="m200")


@pytest.fixture(scope="module")
def days(newyork, request_):
    return season_days(newyork, request_, 6, seed=3)


@pytest.fixture(scope="module")
def planned(newyork, request_, days):
    return plan(newyork, request_, planner="pfs", forecast=held_out_forecast(newyork, request_, days))


@pytest.fixture(scope="module")
def realizations(newyork, request_, days):
    return sample_realizations(newyork, request_, days, runs=60, seed=5)


# -- a plain reimplementation: no kernel, Python floats and loops -------------------------------------------------------


def plain_gust(key, begin, step, phi):
    """Gust of a step in a flight whose cruise begins in the step `begin`."""
    first = begin - math.ceil(-3.0 / math.log(phi))
    along, across = plain_normals(key, first)
    for k in range(first + 1, step + 1):
        one, other = plain_normals(key, k)
        along = phi * along + math.sqrt(1.0 - phi**2) * one
        across = phi * across + math.sqrt(1.0 - phi**2) * other
    return along, across


def plain_speed(air, member, slot, segment, gust, sd):
    north = sum(w * v for w, v in zip(air.weight[segment], air.north[member, slot], strict=True))
    east = sum(w * v for w, v in zip(air.weight[segment], air.east[member, slot], strict=True))
    if gust is None:
        if math.hypot(north, east) > air.wind_limit_mps:
            return 0.0
    else:
        a, b = (max(-MAX_DEVIATION, min(MAX_DEVIATION, g)) for g in gust)
        north, east = (
            north * (1 + sd * a) - east * LATERAL * sd * b,
            east * (1 + sd * a) + north * LATERAL * sd * b,
        )
    tail = north * air.cos_bearing[segment] + east * air.sin_bearing[segment]
    cross = east * air.cos_bearing[segment] - north * air.sin_bearing[segment]
    square = air.airspeed_mps**2 - cross**2
    speed = tail + math.sqrt(max(square, 0.0))
    if gust is None and (square <= 0.0 or speed < 1.0):
        return 0.0
    return min(max(speed, 1.0), air.max_ground_speed_mps)


def plain_land(air, member, segments, off, key=None, sd=0.0, time_s=1.0):
    """Touch-down through gusts, or (without a key) through the hourly wind, infinite where that is over its limits."""
    now = off + air.climb_s
    begin = int(now // GUST_STEP_S)
    for segment in segments:
        left = air.distance_m[segment]
        while left > 1e-9:
            slot = min(int((now - air.start_s + 1e-6) // air.slot_s), air.north.shape[1] - 1)
            end = air.start_s + (slot + 1) * air.slot_s
            gust = None
            if key is not None:
                step = int((now + 1e-7) // GUST_STEP_S)
                end = min(end, (step + 1) * GUST_STEP_S)
                gust = plain_gust(key, begin, step, math.exp(-GUST_STEP_S / time_s))
            speed = plain_speed(air, member, slot, segment, gust, sd)
            if speed == 0.0:
                return math.inf
            spent = min(left / speed, end - now)
            left -= speed * spent
            now += spent
    now += air.descent_s
    if key is None:
        first, last = (int((t - air.start_s + 1e-6) // air.slot_s) for t in (off, now - 2e-6))
        slots = range(first, last + 1)
        if any(plain_speed(air, member, k, segment, None, 0.0) == 0.0 for k in slots for segment in segments):
            return math.inf
    return now


def plain_run(realizations, problem, itinerary, run):
    """(touch-down, charge) of each landing of one run."""
    air, member = problem.air, int(realizations.day[run])
    queues = realizations.queues(problem, range(len(problem.network)), int(realizations.queue[run]))
    now, soc, arrived = problem.depart_s, problem.soc, problem.depart_s
    landings = []
    for number, leg in enumerate(itinerary):
        node = int(problem.network.tail[leg.segments[0]])
        ratio = realizations.energy_ratio(problem.drone, run, max(number - 1, 0))
        if number:
            spot = float(queues[node].land_time(now))
            soc -= ratio * problem.soc_per_s * (spot - now)
            arrived, now = now, spot
            landings[-1] = (now, soc)
        pad = now
        charged = leg.charge_to is not None and leg.charge_to > soc
        if charged:
            pad = max(now, float(queues[node].pad_time(arrived)))
            now = pad + problem.charge_time_s(node, soc, leg.charge_to)
        off = max(now, leg.not_before_s)
        while plain_land(air, member, leg.segments, off) == math.inf:
            off = air.start_s + ((off - air.start_s + 1e-6) // air.slot_s + 1) * air.slot_s
        if charged:
            time, level = problem.curve(node)
            soc = float(np.interp(np.interp(soc, level, time) + off - pad, time, level))
        disturbance = realizations.disturbance(problem.drone)
        key = int(disturbance.gust_key[run])
        down = plain_land(air, member, leg.segments, off, key, disturbance.gust_sd, disturbance.gust_time_s)
        ratio = realizations.energy_ratio(problem.drone, run, number)
        soc -= ratio * (problem.soc_fixed + problem.soc_per_s * (down - off))
        now = down
        landings.append((now, soc))
    return landings


def test_runs_are_what_plain_python_makes_of_the_same_truth(realizations, planned):
    problem = realizations.problem("m200")
    schedule = schedules(realizations, problem, planned.itinerary, np.arange(len(realizations)))
    for run in range(0, 60, 7):
        expected = plain_run(realizations, problem, planned.itinerary, run)
        assert schedule[run, :, TOUCH_DOWN] == pytest.approx([t for t, _ in expected], abs=1e-3)
        assert schedule[run, :, SOC_LANDING] == pytest.approx([s for _, s in expected], abs=1e-7)


def test_without_gusts_and_errors_a_truth_is_the_hourly_wind_of_its_day(newyork, request_, days, planned):
    realizations = sample_realizations(newyork, request_, days[:1], runs=3, errors=NO_ERRORS)
    problem = realizations.problem("m200")
    schedule = schedules(realizations, problem, planned.itinerary, np.arange(3))
    for run in range(3):
        queues = realizations.queues(problem, range(len(problem.network)), int(realizations.queue[run]))
        alone = fly_true(problem, planned.itinerary, queues)
        assert np.array_equal(schedule[run], alone[0])


def test_gusts_have_the_spread_and_the_memory_that_were_asked_for():
    phi = math.exp(-GUST_STEP_S / 180.0)
    rng = np.random.default_rng(1)
    keys = rng.integers(0, 2**64, 4000, dtype=np.uint64)
    now, later = (np.array([gust_at(key, 1000 + k, phi) for key in keys]) for k in (0, 6))
    assert now.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.05)
    assert now.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.04)
    assert np.corrcoef(now[:, 0], later[:, 0])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.05)
    assert abs(np.corrcoef(now[:, 0], now[:, 1])[0, 1]) < 0.05


# -- what becomes of deliveries -----------------------------------------------------------------------------------------


def test_flight_waiting_and_recharge_add_up_to_the_delivery(realizations, planned):
    flown = fly_itinerary(realizations, "m200", planned.itinerary)
    kept = flown.delivered
    assert kept.any()
    total = flown.flight_s + flown.wait_s + flown.recharge_s
    assert total[kept] == pytest.approx(flown.delivery_s[kept])
    assert (flown.wait_s[kept] >= -1e-6).all()
    assert (flown.recharge_s[kept] >= 0.0).all()
    assert np.isnan(flown.delivery_s[~kept]).all()


def test_two_planners_meet_the_same_truths_and_a_seed_gives_them_again(newyork, request_, days, realizations):
    again = sample_realizations(newyork, replace(request_, recharge="full"), days, runs=60, seed=5)
    other = sample_realizations(newyork, request_, days, runs=60, seed=6)
    drone = newyork.drone("m200")
    assert np.array_equal(realizations.energy(drone), again.energy(drone))
    assert np.array_equal(realizations.gust_key, again.gust_key)
    assert realizations.queue_seed == again.queue_seed
    assert not np.array_equal(realizations.energy(drone), other.energy(drone))
    assert realizations.queue_seed != other.queue_seed
    problem = realizations.problem("m200")
    assert np.array_equal(
        realizations.queues(problem, [3], 4)[3].pad_s, again.queues(again.problem("m210"), [1, 3], 4)[3].pad_s
    )


def test_more_runs_begin_with_the_same_runs(newyork, request_, days, realizations):
    more = sample_realizations(newyork, request_, days, runs=120, seed=5)
    drone = newyork.drone("m200")
    assert np.array_equal(more.energy(drone)[:60], realizations.energy(drone))
    assert np.array_equal(more.gust_key[:60], realizations.gust_key)


def test_the_truths_queues_are_not_those_the_planner_samples(realizations):
    assert realizations.queue_seed != realizations.request.seed
    assert abs(realizations.queue_seed - realizations.request.seed) > 1_000_000


def test_the_energy_of_legs_is_drawn_from_what_is_believed_of_the_drone(newyork, request_, days):
    runs = sample_realizations(newyork, request_, days, runs=1200, seed=5)
    drone = newyork.drone("m200")
    belief = EnergyBelief(1.05, 0.06, 0.02)
    ratio = runs.energy(replace(drone, energy_belief=belief))
    spread = math.sqrt(15.0 / 13.0)  # of Student's t distribution
    assert ratio.mean() == pytest.approx(1.05, abs=0.006)
    assert ratio.mean(axis=1).std() == pytest.approx(0.06 * spread, rel=0.1)
    assert (ratio - ratio.mean(axis=1, keepdims=True)).std() == pytest.approx(0.02 * spread, rel=0.1)
    assert (sample_realizations(newyork, request_, days, runs=6, errors=NO_ERRORS).energy(drone) == 1.0).all()


def test_more_reserve_never_strands_more(newyork, request_, days):
    forecast = held_out_forecast(newyork, request_, days)
    realizations = sample_realizations(newyork, request_, days, runs=60)
    lowest = []
    for reserve in (0.1, 0.3):
        result = plan(newyork, replace(request_, reserve_soc=reserve), planner="shortest", forecast=forecast)
        flown = fly_itinerary(realizations, "m200", result.itinerary)
        lowest.append((int((flown.lowest_soc < 0.1).sum()), int((~flown.delivered).sum())))
    assert lowest[1] <= lowest[0]


def test_an_evaluation_is_the_same_again_and_can_be_read_as_json(realizations, planned):
    first, second = evaluate(planned, realizations), evaluate(planned, realizations)
    assert first.to_json() == second.to_json()
    document = json.loads(first.to_json())
    assert document["runs"] == 60
    assert document["days"] == 6
    assert document["regret"]["value"] is None
    assert sum(first.counts[name] for name in ("delivered", "stranded", "unflyable", "gave_up")) == 60
    assert "60 simulated deliveries on 6 days" in first.summary()


# -- days held out ------------------------------------------------------------------------------------------------------


def test_no_held_out_day_nor_its_neighbours_is_in_the_forecast(newyork, request_, days):
    labels = {date.fromisoformat(label) for label in held_out_forecast(newyork, request_, days).labels}
    for day in days:
        assert not labels & {day + timedelta(days=k) for k in range(-(HORIZON_H // 24) + 1, HORIZON_H // 24)}


def test_a_forecast_that_contains_the_truth_is_refused(newyork, request_, realizations):
    knowing = plan(newyork, request_, planner="pfs")
    with pytest.raises(InputError, match="the forecast contains the actual wind"):
        evaluate(knowing, realizations)


def test_errors_out_of_range_and_truths_without_days_are_refused(newyork, request_, days):
    with pytest.raises(InputError, match="gust_sd: out of range") as caught:
        Errors(gust_sd=2.0, gust_time_s=0.0)
    assert len(caught.value.faults) == 2
    with pytest.raises(InputError, match="sd_within: out of range"):
        EnergyBelief(sd_within=-1.0)
    with pytest.raises(InputError, match="days: no day"):
        sample_realizations(newyork, request_, (), runs=5)
    with pytest.raises(InputError, match="too few"):
        sample_realizations(newyork, request_, days, runs=len(days) - 1)


def test_an_itinerary_of_another_delivery_is_refused(realizations, planned):
    whole = planned.itinerary
    with pytest.raises(InputError, match="ends at another station than the request"):
        fly_itinerary(realizations, "m200", whole[:-1])
    with pytest.raises(InputError, match=r"begins at another station than the request .*; siuh-north"):
        fly_itinerary(realizations, "m200", whole[1:])
    with pytest.raises(InputError, match="has no flight"):
        fly_itinerary(realizations, "m200", ())


@pytest.mark.parametrize(
    ("change", "field"),
    [({"destination": "jacobi"}, "destination"), ({"payload_kg": 0.1}, "payload_kg"), ({"airspeed_mps": 12.0}, "airspeed_mps")],
)  # fmt: skip
def test_a_plan_is_not_judged_in_realizations_of_another_request(newyork, request_, days, planned, change, field):
    other = sample_realizations(newyork, replace(request_, **change), days, runs=12)
    with pytest.raises(InputError, match=f"{field}: differs between the plan and the realizations"):
        evaluate(planned, other)


def test_a_plan_that_keeps_a_larger_reserve_is_judged_against_the_realizations_own(newyork, request_, days):
    forecast = held_out_forecast(newyork, request_, days)
    careful = plan(newyork, replace(request_, reserve_soc=0.3, seed=4), planner="shortest", forecast=forecast)
    assert evaluate(careful, sample_realizations(newyork, request_, days, runs=12)).runs == 12


def test_seeds_days_and_runs_that_mean_nothing_are_one_clear_error(newyork, request_, days, realizations, planned):
    for seed in (-1, 1.5):
        with pytest.raises(InputError, match="seed: out of range"):
            sample_realizations(newyork, request_, days, runs=12, seed=seed)
        with pytest.raises(InputError, match="seed: out of range"):
            season_days(newyork, request_, 3, seed=seed)
    with pytest.raises(InputError, match="days: names a day twice"):
        sample_realizations(newyork, request_, [days[0], days[1], days[0]], runs=12)
    with pytest.raises(InputError, match=r"runs: too few \(got '3'\); at least 6: one on each day"):
        sample_realizations(newyork, request_, days, runs=3)
    with pytest.raises(InputError, match="planner: has no perfect information"):
        clairvoyant_times(realizations, "m200", "pfs", [0])
    with pytest.raises(InputError, match="runs: no such run"):
        clairvoyant_times(realizations, "m200", "exact", [60])
    with pytest.raises(InputError, match="clairvoyant_s: has the wrong shape"):
        evaluate(planned, realizations, clairvoyant_s=np.ones(3))


# -- policies -----------------------------------------------------------------------------------------------------------


def test_an_itinerary_flown_decision_by_decision_is_the_itinerary_flown_at_once(realizations, planned):
    runs = np.arange(0, 60, 9)
    at_once = fly_itinerary(realizations, "m200", planned.itinerary).chosen(runs)
    stepwise, done = fly_policy(realizations, "m200", OpenLoop(planned.itinerary), runs)
    assert np.array_equal(at_once.ending, stepwise.ending)
    assert at_once.delivery_s == pytest.approx(stepwise.delivery_s, nan_ok=True)
    assert at_once.lowest_soc == pytest.approx(stepwise.lowest_soc)
    delivered = np.flatnonzero(stepwise.delivered)
    assert all(done[k] == planned.itinerary for k in delivered)


def test_planning_anew_at_each_stop_delivers_in_the_same_truths(newyork, request_, days, realizations):
    forecast = held_out_forecast(newyork, request_, days)
    policy = Rolling(newyork, request_, "pfs-charge-aware", lambda _: forecast)
    flown, done = fly_policy(realizations, "m200", policy, np.arange(3))
    assert len(flown) == len(done) == 3
    problem = realizations.problem("m200")
    for number in np.flatnonzero(flown.delivered):
        assert int(problem.network.head[done[number][-1].segments[-1]]) == problem.destination
        assert flown.delivery_s[number] > 0.0


def test_a_policy_without_a_way_on_has_given_up(realizations):
    flown, done = fly_policy(realizations, "m200", OpenLoop(()), np.arange(2))
    assert flown.ending.tolist() == [GAVE_UP, GAVE_UP]
    assert done == [(), ()]
    assert summarise("none", flown).counts["gave_up"] == 2


class Waiting:
    """Stays where it is forever, and wants to look again every five minutes."""

    def __init__(self):
        self.looks_s = []

    def leave(self, standing):
        self.looks_s.append(standing.time_s)
        return Departure((), 1.0, lambda _: math.inf, standing.time_s + 300.0)

    def over(self, flying, rest):
        raise AssertionError("it never flies")


@pytest.mark.parametrize("slot_s", [300.0, 3600.0])
@pytest.mark.parametrize("known_days", [2, 9])
def test_a_wait_has_an_end_and_not_many_decisions(realizations, slot_s, known_days):
    """It gives up after the hours that a forecast reaches, however long the wind is known; the first two are as closely watched as ever."""
    slots = int(known_days * 86_400.0 / slot_s)
    north, east = (np.repeat(one[:, :1], slots, axis=1) for one in (realizations.wind.north, realizations.wind.east))
    wind = replace(realizations.wind, start_s=DEPART.timestamp(), slot_s=slot_s, north=north, east=east)
    policy = Waiting()
    flown, done = fly_policy(replace(realizations, wind=wind), "m200", policy, np.arange(1))
    assert flown.ending.tolist() == [GAVE_UP]
    assert done == [()]
    waited_s = np.array(policy.looks_s) - DEPART.timestamp()
    assert waited_s[:24] == pytest.approx(300.0 * np.arange(24))
    assert 0.9 * HORIZON_H * 3600.0 < waited_s[-1] < HORIZON_H * 3600.0
    assert len(waited_s) < 150
    assert np.all(np.diff(waited_s) <= np.maximum(300.0, waited_s[:-1] / 24.0) + 1e-6)


def test_a_delivery_that_ends_where_it_begins_is_refused(realizations):
    there = replace(realizations, request=replace(realizations.request, destination="siuh-north"))
    with pytest.raises(InputError, match="start and destination are the same"):
        fly_policy(there, "m200", Waiting(), np.arange(1))


def test_nobody_is_faster_than_who_knows_the_truth(newyork, request_, days, planned):
    realizations = sample_realizations(newyork, request_, days[:2], runs=4, errors=NO_ERRORS)
    best, spent_s, cut_off = clairvoyant_times(realizations, "m200", "ies", range(2))
    assert cut_off == 0
    assert spent_s > 0.0
    assert np.isnan(best[2:]).all()
    flown = fly_itinerary(realizations, "m200", planned.itinerary)
    both = np.isfinite(best) & (flown.ending == DELIVERED) & ~flown.below_reserve
    assert (flown.delivery_s[both] >= best[both] - 1e-3).all()
    found = evaluate(planned, realizations, clairvoyant_s=best)
    assert found.clairvoyant_runs <= 2


# -- intervals ----------------------------------------------------------------------------------------------------------


def test_intervals_over_days_hold_the_truth_about_as_often_as_they_say():
    covered = naive = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        block = np.repeat(np.arange(15), 20)
        values = rng.normal(0.0, 1.0, 15)[block] + rng.normal(0.0, 0.5, 300)
        found = DayBootstrap(block, replicates=300, seed=seed).mean(values)
        covered += found.low <= 0.0 <= found.high
        alone = DayBootstrap(np.arange(300), replicates=300, seed=seed).mean(values)
        naive += alone.low <= 0.0 <= alone.high
    assert 178 <= covered <= 200
    assert naive < 100


@pytest.mark.parametrize("days", [2, 3, 5])
def test_intervals_over_few_days_hold_the_truth_about_as_often_as_they_say(days):
    covered = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        block = np.repeat(np.arange(days), 20)
        values = 100.0 + rng.normal(0.0, 1.0, days)[block] + rng.normal(0.0, 0.5, len(block))
        found = DayBootstrap(block, replicates=300, seed=seed).mean(values)
        covered += found.low <= 100.0 <= found.high
    assert covered >= 180, "between the days alone it is a half of two, three quarters of three"
    waits = DayBootstrap(np.arange(2)).mean(np.array([0.0, 600.0]))
    assert (waits.value, waits.low) == (300.0, 0.0), "no mean wait is negative"
    off = DayBootstrap(np.arange(2)).mean_error(np.array([[True], [False]]), np.array([[0.1], [0.1]]))
    assert (off.value, off.high) == (pytest.approx(0.4), 1.0), "no share is wrong by more than all"


@pytest.mark.parametrize(("days", "q"), [(12, 0.95), (25, 0.95), (12, 0.5)])
def test_a_quantile_over_days_that_differ_is_within_its_interval_or_its_end_is_unknown(days, q):
    missed = unknown = 0
    truth = {0.5: 0.0, 0.95: 1.6449 * math.hypot(10.0, 3.0)}[q]
    for seed in range(200):
        rng = np.random.default_rng(seed)
        block = np.repeat(np.arange(days), 30)
        values = rng.normal(0.0, 10.0, days)[block] + rng.normal(0.0, 3.0, len(block))
        found = DayBootstrap(block, replicates=2).quantile(values, q)
        missed += truth < found.low or truth > found.high
        unknown += math.isnan(found.high)
    assert missed <= 24
    assert unknown >= 150 if q > 0.5 else unknown == 0


def test_the_latest_of_a_few_runs_is_not_the_end_of_what_can_come():
    few = DayBootstrap(np.arange(5)).quantile(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 0.95)
    assert (few.value, math.isnan(few.high)) == (5.0, True)
    assert few.text().endswith(", -]")
    many = DayBootstrap(np.arange(200)).quantile(np.arange(200.0), 0.95)
    assert many.low < many.value == 189.0 < many.high <= 199.0


def test_quantiles_and_rates_of_the_bootstrap_are_those_of_the_runs():
    rng = np.random.default_rng(2)
    block = np.repeat(np.arange(30), 10)
    values = rng.exponential(1.0, 300)
    days = DayBootstrap(block)
    p95 = days.quantile(values, 0.95)
    assert p95.value == np.sort(values)[284]
    assert p95.low < p95.value < p95.high
    never = days.rate(np.zeros(300, dtype=bool))
    assert (never.value, never.low) == (0.0, 0.0)
    assert never.high == pytest.approx(1.0 - 0.025 ** (1.0 / 30.0))
    assert math.isnan(DayBootstrap(np.zeros(5, dtype=int)).mean(np.ones(5)).low)


def test_an_estimate_tells_what_is_not_known():
    assert Estimate(math.nan).text() == "-"
    assert Estimate(1.0).text() == "1.0"
    assert Estimate(2.0, 1.0, 3.0).scaled(10.0).text(".0f") == "20 [10, 30]"
    assert Estimate(2.0, 1.0).document() == {"value": 2.0, "low": 1.0, "high": None}
    assert Estimate(math.nan).document() == {"value": None, "low": None, "high": None}


def flown_at(times_s):
    """Deliveries that took so long, one a day."""
    times = np.asarray(times_s, dtype=np.float64)
    none = np.zeros(len(times), dtype=bool)
    return Flown(np.arange(len(times)), np.full(len(times), DELIVERED), none, times, times, times, times, times)


def test_times_say_of_how_many_deliveries_they_are():
    all_of_them = flown_at([600.0, 660.0, -1e-7])
    assert "times of" not in summarise("p", all_of_them).summary()
    some = replace(all_of_them, ending=np.array([DELIVERED, STRANDED, DELIVERED]))
    assert (
        summarise("p", some).summary().startswith("p: 3 simulated deliveries on 3 days, times of the 2 that arrived\n")
    )
    least = replace(all_of_them, wait_s=np.full(3, -1e-7))
    assert "-0.0" not in summarise("p", least).summary()


@pytest.mark.slow
def test_a_planner_that_tells_the_truth_is_calibrated_even_where_many_arrive_at_one_moment():
    """Four in ten arrive at 100 s: nobody can promise that moment with 10 %, and the plan does not."""
    rng = np.random.default_rng(4)

    def draw(count):
        return np.where(rng.random(count) < 0.4, 100.0, 100.0 + rng.exponential(60.0, count))

    arrival = draw(20_000)
    even = np.full(len(arrival), 1.0 / len(arrival))
    promise = Outcome(0.0, arrival, even, np.ones(1), np.zeros(1), np.zeros(1), 1.0, 1.0, arrival > 0.0)
    honest = summarise("honest", flown_at(draw(10_000)).judged(promise, 0.0))
    assert honest.calibration[0][0] == pytest.approx(0.4, abs=0.02)
    assert honest.calibration_error.value < 0.01
    late = summarise("late", flown_at(draw(10_000) + 30.0).judged(promise, 0.0))
    assert late.calibration_error.value > 0.1
    assert late.calibration_error.low > 0.08


def test_parts_of_realizations_are_flown_as_the_whole(realizations, planned, monkeypatch):
    monkeypatch.setattr("skyway.planner.evaluation.parts.PART", 7)
    told = []
    drone = planned.composition.drone
    found = fly_parts(realizations, drone, planned.itinerary, told=lambda *one: told.append(one[:2]))
    whole = fly_itinerary(realizations, drone, planned.itinerary)
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(getattr(found, name), values)
    assert told[-1] == (60, 60)
    assert len(told) == 9


@pytest.mark.slow
def test_processes_and_a_cluster_evaluate_the_very_same_deliveries(newyork, request_, days, realizations, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask: pip install 'skyway-planner[cluster]'")
    monkeypatch.setattr("skyway.planner.evaluation.parts.PART", 9)
    result = plan(newyork, request_, planner="robust", forecast=held_out_forecast(newyork, request_, days))
    alone = evaluate(result, realizations).document()
    policy = RollingRobust(result.problem)
    few = realizations.part(0, 3)
    decided = summarise("online", fly_parts(few, "m200", policy)).document()
    assert evaluate(result, realizations, workers=2).document() == alone
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        assert evaluate(result, realizations, cluster=cluster.scheduler_address).document() == alone
        spread_out = fly_parts(few, "m200", policy, cluster=cluster.scheduler_address)
        assert summarise("online", spread_out).document() == decided


@pytest.mark.parametrize(
    ("decided", "told"),
    [
        (lambda _: "yankee-stadium", r"decide: is not a leg \(got 'str'\)"),
        (lambda network: Leg((int(network.first[0]),)), "decide: a leg begins elsewhere .* siuh-north, where the drone stands"),
        (lambda _: Leg(()), "has no segments"),
        (lambda network: Leg((len(network.tail),)), "is not a segment"),
    ],
)  # fmt: skip
def test_a_policy_that_decides_what_no_drone_can_do_is_refused(newyork, realizations, decided, told):
    assert newyork.network.stations[0].id != "siuh-north"

    class Wrong:
        def decide(self, _):
            return decided(newyork.network)

    with pytest.raises(InputError, match=told):
        fly_policy(realizations, "m200", Wrong(), np.array([0]))
