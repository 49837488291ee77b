"""Waiting for a pad: closed formulas, matrix exponentials and an event simulation agree with the kernels."""

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from benchmarks.cases.loads import scaled_to
from skyway.models.base.errors import InputError
from skyway.models.queues.load import PadLoad
from skyway.models.queues.settled_kernels import LOST_MASS, erlang_c, stationary
from skyway.models.queues.waiting_times import STEP_S, PadQueue, forecast_waits, present_at, settled, station_queue

NEW_YORK = "America/New_York"
HOUR = 3600.0
FIVE = np.full(4, 5)
START = 1_373_464_800.0 + 1234.0  # 2013-07-10 14:00 UTC and some minutes

profiles = st.integers(1, 6).flatmap(
    lambda hours: st.tuples(
        st.lists(st.floats(0.0, 20.0), min_size=hours, max_size=hours),
        st.lists(st.floats(0.1, 3.0), min_size=hours, max_size=hours),
    )
)


def steady(utilisation: float, pads: int, charging_s: float = HOUR, hours: int = 24) -> tuple:
    return np.full(hours, utilisation * pads / charging_s), np.full(hours, charging_s)


def steady_load(utilisation: float, pads: int = 5, stations: int = 1, charging_s: float = HOUR) -> PadLoad:
    load = PadLoad(np.zeros((stations, 168)), np.full((stations, 168), charging_s), NEW_YORK)
    return scaled_to(load, utilisation, pads)


def at(values, time_s, start_s=START):
    """Value of a forecast at a time: linear between its points."""
    return np.interp(time_s, start_s + STEP_S * np.arange(len(values)), values)


def transient(pads, arrivals, charging, initial, step_s=600.0):
    """Probabilities of the number of drones present, every `step_s`, from a number of drones or a distribution."""
    known = {"busy": initial} if isinstance(initial, int) else {"unseen": np.array(initial)}
    queue = PadQueue(pads, 0.0, 0.0, np.array(arrivals), np.array(charging), **known)
    points = math.ceil(len(arrivals) * HOUR / step_s - 1e-9) + 1
    times_s = np.arange(points) * step_s
    return times_s, queue.distribution(times_s)


def erlang_c_exactly(pads: int, load: Fraction) -> float:
    last = load**pads / math.factorial(pads) * pads / (pads - load)
    return float(last / (sum(load**n / math.factorial(n) for n in range(pads)) + last))


def generator(pads: int, arrival: float, service: float, states: int) -> np.ndarray:
    rates = np.zeros((states, states))
    for n in range(states):
        if n + 1 < states:
            rates[n, n + 1] = arrival
        if n:
            rates[n, n - 1] = min(n, pads) * service
        rates[n, n] = -rates[n].sum()
    return rates


def simulate_wait(rng: random.Random, pads: int, arrivals: list, charging: list, present: int, at_s: float) -> float:
    """Wait of one drone that arrives at `at_s`, from one event simulation that begins at 0."""
    now, ahead = 0.0, None
    while True:
        slot = min(int(now / HOUR), len(arrivals) - 1)
        until = (slot + 1) * HOUR if slot < len(arrivals) - 1 else math.inf
        until = min(until, at_s) if ahead is None else until
        arrival = arrivals[slot] if ahead is None else 0.0
        leaving = min(present if ahead is None else pads, pads) / charging[slot]
        gap = rng.expovariate(arrival + leaving) if arrival + leaving > 0.0 else math.inf
        if now + gap >= until:
            now = until
            if ahead is None and now >= at_s:
                if present < pads:
                    return 0.0
                ahead = present - pads + 1
            continue
        now += gap
        if ahead is not None:
            ahead -= 1
            if ahead == 0:
                return now - at_s
        elif rng.random() * (arrival + leaving) < arrival:
            present += 1
        else:
            present -= 1


def test_erlangs_formula_gives_the_known_values():
    assert erlang_c(1, 0.7) == pytest.approx(0.7)
    assert erlang_c(2, 1.0) == pytest.approx(1.0 / 3.0)
    assert erlang_c(5, 4.0) == pytest.approx(0.554113, abs=1e-6)
    assert erlang_c(5, 0.0) == 0.0
    assert erlang_c(5, 5.0) == 1.0
    assert erlang_c(5, 9.0) == 1.0


@given(st.integers(1, 40), st.fractions(0, Fraction(99, 100), max_denominator=100))
def test_erlangs_formula_equals_its_definition_in_exact_fractions(pads, utilisation):
    load = utilisation * pads
    assert erlang_c(pads, float(load)) == pytest.approx(erlang_c_exactly(pads, load), rel=1e-9)


def test_erlangs_formula_survives_a_thousand_pads():
    assert 0.0 < erlang_c(1000, 950.0) < 0.2


@given(st.integers(1, 8), st.floats(0.0, 0.9))
def test_the_long_run_balances_arrivals_and_departures(pads, utilisation):
    load = utilisation * pads
    p = stationary(pads, load, 600)
    assert p.sum() == pytest.approx(1.0)
    assert p[pads:].sum() == pytest.approx(erlang_c(pads, load), abs=1e-12)
    n = np.arange(1, 600)
    assert load * p[:-1] == pytest.approx(np.minimum(n, pads) * p[1:], abs=1e-12)


@pytest.mark.parametrize("utilisation", [0.0, 0.3, 0.8])
def test_after_weeks_of_the_same_load_the_start_is_forgotten(utilisation):
    arrivals, charging = steady(utilisation, 5, hours=400)
    for initial in (0, 12):
        _, found = transient(5, arrivals, charging, initial, step_s=400 * HOUR)
        states = found.shape[1]
        assert found[-1] == pytest.approx(stationary(5, 5 * utilisation, states), abs=2e-6)


@settings(max_examples=12)
@given(st.integers(1, 4), profiles, st.integers(0, 6), st.floats(600.0, 5000.0))
def test_the_transient_equals_matrix_exponentials_hour_by_hour(pads, profile, present, step_s):
    arrivals, charging = np.array(profile[0]) / HOUR, np.array(profile[1]) * HOUR
    run = transient(pads, arrivals, charging, present, step_s=step_s)
    states = 100
    p = np.zeros(states)
    p[present] = 1.0
    hours = [expm(HOUR * generator(pads, a, 1 / c, states)) for a, c in zip(arrivals, charging, strict=True)]
    for t, found in zip(*run, strict=True):
        expected = p
        whole = min(int(t / HOUR), len(arrivals) - 1)
        for hour in range(whole):
            expected = expected @ hours[hour]
        rest = expm((t - whole * HOUR) * generator(pads, arrivals[whole], 1 / charging[whole], states))
        expected = expected @ rest
        size = min(states, len(found))
        if expected[-20:].sum() < 1e-10:  # the oracle's own cut must not matter
            assert found[:size] == pytest.approx(expected[:size], abs=1e-8)


@settings(max_examples=25)
@given(st.integers(1, 12), profiles, st.integers(0, 30))
def test_no_more_mass_is_lost_than_stated(pads, profile, present):
    _, found = transient(pads, np.array(profile[0]) / HOUR, np.array(profile[1]) * HOUR, present)
    assert (found >= 0.0).all()
    assert 1.0 - found.sum(axis=1) == pytest.approx(0.0, abs=LOST_MASS)


@pytest.mark.parametrize("utilisation", [0.99, 1.0, 1.3, 3.0])
def test_days_of_overload_lose_no_mass_and_grow_the_line_by_what_is_not_served(utilisation):
    arrivals, charging = steady(utilisation, 5, hours=72)
    _, found = transient(5, arrivals, charging, 60, step_s=6 * HOUR)
    assert 1.0 - found[-1].sum() < LOST_MASS
    mean = found @ np.arange(found.shape[1])
    assert mean[4] - mean[0] == pytest.approx((utilisation - 1.0) * 5 * 24, abs=0.05)


def test_a_start_may_be_a_distribution():
    arrivals, charging = steady(0.7, 3, hours=5)
    _, mixed = transient(3, arrivals, charging, [0.25, 0.0, 0.75])
    empty, two = (transient(3, arrivals, charging, n)[1] for n in (0, 2))
    size = min(mixed.shape[1], empty.shape[1], two.shape[1])
    assert mixed[:, :size] == pytest.approx(0.25 * empty[:, :size] + 0.75 * two[:, :size], abs=1e-9)


@pytest.mark.parametrize("at_h", [0.5, 10 / 3])
def test_forecast_agrees_with_an_event_simulation(at_h):
    pads, busy = 3, 5
    arrivals, charging = [4 / HOUR, 2 / HOUR, 6 / HOUR, 3 / HOUR], [0.5 * HOUR, 1.5 * HOUR, 0.6 * HOUR, HOUR]
    queue = PadQueue(pads, 0.0, 0.0, np.array(arrivals), np.array(charging), busy)
    forecast = queue.forecast(6)
    rng = random.Random(7)
    waits = np.array([simulate_wait(rng, pads, arrivals, charging, busy, at_h * HOUR) for _ in range(20_000)])
    error = 4.0 * waits.std() / math.sqrt(len(waits))
    assert at(forecast.wait_s, at_h * HOUR, 0.0) == pytest.approx(waits.mean(), abs=error)
    assert at(forecast.p_free, at_h * HOUR, 0.0) == pytest.approx((waits == 0.0).mean(), abs=4 * 0.5 / 141)


def test_with_one_charging_time_the_wait_is_that_of_the_departures_ahead():
    arrivals, charging = steady(0.0, 4, hours=3)
    queue = PadQueue(4, 0.0, 0.0, arrivals, charging, 9)
    assert queue.forecast(1).wait_s[0] == pytest.approx(6 * HOUR / 4)


def test_in_the_long_run_the_forecast_is_erlangs():
    forecast = forecast_waits(steady_load(0.8, charging_s=1200.0), FIVE, [0], START, 48, {})[0]
    waits = erlang_c(5, 4.0)
    assert forecast.p_free == pytest.approx(np.full(289, 1.0 - waits), abs=1e-6)
    assert forecast.wait_s == pytest.approx(np.full(289, waits * 1200.0 / (5 * 0.2)), rel=1e-4)


@pytest.mark.parametrize("utilisation", [0.3, 0.7, 0.9])
def test_a_station_that_nobody_has_seen_is_as_a_load_that_repeats_for_weeks_leaves_it(utilisation):
    hours = np.arange(168)
    shape = 1.0 + 0.4 * np.sin(hours / 24 * 2 * np.pi) - 0.2 * (hours > 119)
    load = PadLoad(shape[None] / shape.mean() * utilisation * 5 / HOUR, np.full((1, 168), HOUR), "UTC")
    weeks = 10 * 168
    first_s = START // HOUR * HOUR - weeks * HOUR
    arrivals, charging = load.hourly(0, first_s, weeks + 73)
    long_ago = PadQueue(5, START, first_s, arrivals, charging).forecast(48)
    found = forecast_waits(load, FIVE, [0], START, 48, {})[0]
    assert found.wait_s == pytest.approx(long_ago.wait_s, rel=1e-3, abs=0.1)
    assert found.p_free == pytest.approx(long_ago.p_free, abs=1e-4)


def test_at_high_load_the_start_matters_for_days():
    load = steady_load(0.9)
    empty, full, unseen = (forecast_waits(load, FIVE, [0], START, 48, busy)[0] for busy in ({0: 0}, {0: 15}, {}))
    assert empty.wait_s[0] == 0.0
    assert full.wait_s[0] == pytest.approx(11 * HOUR / 5)
    for hours in (1, 6, 24):
        t = START + hours * HOUR
        assert at(empty.wait_s, t) + 300.0 < at(full.wait_s, t)
        assert at(empty.p_free, t) > at(full.p_free, t)
    assert unseen.wait_s[0] > empty.wait_s[0]


def test_busy_pads_seen_all_taken_mean_a_wait_with_nobody_in_the_line():
    forecast = forecast_waits(steady_load(0.5), FIVE, [0], START, 10, {0: 5})[0]
    assert forecast.p_free[0] == 0.0
    assert forecast.wait_s[0] == pytest.approx(HOUR / 5)


@settings(max_examples=20)
@given(st.integers(1, 5), profiles, st.integers(0, 20), st.floats(0.0, 3599.0))
def test_who_arrives_later_is_never_expected_to_start_earlier(pads, profile, busy, offset_s):
    queue = PadQueue(pads, offset_s, 0.0, np.array(profile[0]) / HOUR, np.array(profile[1]) * HOUR, busy)
    forecast = queue.forecast(8)
    t = np.linspace(offset_s - 1000.0, offset_s + 9 * HOUR, 700)
    start = t + at(forecast.wait_s, t, offset_s)
    assert (np.diff(start) >= -1e-6).all()
    assert ((forecast.p_free >= 0.0) & (forecast.p_free <= 1.0)).all()


@settings(max_examples=20)
@given(st.integers(1, 5), profiles, st.integers(0, 10), st.floats(1.0, 2.0))
def test_more_load_or_more_drones_never_shorten_the_wait(pads, profile, busy, factor):
    arrivals, charging = np.array(profile[0]) / HOUR, np.array(profile[1]) * HOUR
    base = PadQueue(pads, 0.0, 0.0, arrivals, charging, busy).forecast(6)
    loaded = PadQueue(pads, 0.0, 0.0, factor * arrivals, charging, busy).forecast(6)
    fuller = PadQueue(pads, 0.0, 0.0, arrivals, charging, busy + 1).forecast(6)
    more_pads = PadQueue(pads + 1, 0.0, 0.0, arrivals, charging, busy).forecast(6)
    for worse in (loaded, fuller):
        assert (worse.wait_s >= base.wait_s - 1e-3).all()
        assert (worse.p_free <= base.p_free + 1e-8).all()
    assert (more_pads.wait_s <= base.wait_s + 1e-3).all()


def test_stations_alike_share_one_forecast_and_others_do_not():
    load = steady_load(0.6, stations=4)
    waits = forecast_waits(load, np.array([5, 5, 6, 5]), [0, 1, 2, 3], START, 12, {3: 2})
    assert waits[0] is waits[1]
    assert waits[0] is not waits[2]
    assert waits[0] is not waits[3]


def test_nobody_waits_at_a_delivery_target():
    target = forecast_waits(steady_load(0.6), np.zeros(1, dtype=np.int64), [0], START, 12, {})[0]
    assert len(target.wait_s) == 12 * 6 + 1
    assert not target.wait_s.any()
    assert (target.p_free == 1.0).all()


def test_in_the_week_of_the_clock_change_the_local_profile_is_followed():
    arrivals = np.zeros((1, 168))
    arrivals[0, 6 * 24 + 1] = 30 / HOUR  # Sundays from 1 to 2: twice on 2013-11-03
    load = PadLoad(arrivals, np.full((1, 168), HOUR), NEW_YORK)
    midnight = 1_383_451_200.0  # 2013-11-03 00:00 EDT
    forecast = forecast_waits(load, FIVE, [0], midnight, 6, {0: 0})[0]
    assert forecast.p_free[6] == 1.0
    ordinary = forecast_waits(load, FIVE, [0], midnight + 7 * 24 * HOUR + HOUR, 6, {0: 0})[0]
    assert forecast.wait_s[-1] > ordinary.wait_s[-1] + 15.0 * HOUR / 5
    assert forecast.wait_s.max() > 2 * ordinary.wait_s.max() - 7000.0


def test_a_line_that_grows_without_end_is_refused():
    with pytest.raises(InputError, match="grows beyond"):
        transient(1, [1.0] * 24, [HOUR] * 24, 0)


def test_many_unseen_stations_are_settled_as_each_alone_lives_through_its_week():
    """Stations of different load, one of them too busy to settle, and of different pads; against the transient chain begun empty long before."""
    rng = np.random.default_rng(5)
    hours = 1.0 + 0.8 * np.sin(np.arange(168) * 2.0 * np.pi / 24.0)
    utilisation, pads = np.array([0.3, 0.6, 1.0, 0.8]), [5, 2, 3, 1]
    arrivals = (utilisation * pads)[:, None] / HOUR * hours * rng.uniform(0.9, 1.0, (4, 168))
    load = PadLoad(arrivals, np.full((4, 168), HOUR), NEW_YORK)
    found = present_at(load, [0, 1, 2, 3], pads, START)
    for station, (count, share) in enumerate(zip(pads, found, strict=True)):
        assert share[-1] == pytest.approx(1.0, abs=1e-6)
        (alone,) = present_at(load, [station], [count], START)
        assert np.array_equal(alone, share)
        first_s = START - START % HOUR
        begin_s = first_s - 168 * HOUR
        lived = PadQueue(count, begin_s, begin_s, *load.hourly(station, begin_s, 200)).distribution(
            np.array([first_s, START])
        )
        if station != 2:  # that one grows from week to week
            assert settled(load, station, count, first_s)[:count] == pytest.approx(lived[0, :count], abs=2e-3)
            assert share[:count] == pytest.approx(np.cumsum(lived[1])[:count], abs=4e-3)
        queue = station_queue(load, station, count, START, 1.0)
        assert share[:count] == pytest.approx(np.cumsum(queue.distribution(np.array([START]))[0])[:count], abs=1e-9)
