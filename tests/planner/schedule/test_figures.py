"""Figures of a plan: as sure as they say, from the same simulated deliveries, with a typical schedule among them."""

from copy import copy
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from scipy.stats import skellam

from skyway.models.composition.composition import State
from skyway.models.queues.load import PadLoad, hours_of_week
from skyway.models.wind.forecast import constant_wind
from skyway.models.wind.summary import Passage, summarise_wind
from skyway.planner.explain import robust_gain
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.schedule.outcome import Outcome, later
from skyway.planner.schedule.precision import Crossed

DEPART = datetime(2013, 7, 10, 18, 0, tzinfo=UTC)
FAR = "siuh-north", "white-plains"


def ask(origin, destination, **more):
    more = {"payload_kg": 0.8} | more
    busy = more.pop("busy_pads", {})
    return Request(state=State(DEPART, origin, busy_pads=busy), destination=destination, **more)


@pytest.fixture(scope="module")
def planned(newyork):
    """Plans that several tests look at, each made once."""

    return cache(lambda route, planner, seed: plan(newyork, ask(*route, seed=seed), planner=planner))


def crossed_runs(rng, days=30, queues=128, runs=1500):
    """Lognormal delivery times whose spread comes from days, queues, and runs themselves."""
    day, queue = np.repeat(np.arange(days), runs // days), np.arange(runs // days * days) % queues
    times = np.exp(
        0.3 * rng.normal(size=days)[day] + 0.3 * rng.normal(size=queues)[queue] + 0.1 * rng.normal(size=len(day))
    )
    return Crossed(np.full(len(day), 1.0 / len(day)), day, queue), times


def covered(truth, figure):
    return figure.low <= truth <= figure.high


def test_intervals_hold_the_figures_of_very_many_deliveries_about_as_often_as_said():
    rng = np.random.default_rng(5)
    variance = 0.3**2 + 0.3**2 + 0.1**2
    realizations = np.exp(variance / 2.0), 1.0, np.exp(1.6449 * variance**0.5)
    hits = np.zeros(3)
    trials = 300
    for _ in range(trials):
        runs, times = crossed_runs(rng)
        figures = runs.mean(times), runs.quantile(times, 0.5), runs.quantile(times, 0.95)
        hits += [covered(truth, figure) for truth, figure in zip(realizations, figures, strict=True)]
    mean, median, late = hits / trials
    assert 0.92 < mean < 0.98
    assert 0.92 < median < 0.99
    assert late > 0.9  # 30 days hold few of the latest deliveries


def test_what_another_seed_would_show_is_told_apart_from_what_other_days_would():
    rng = np.random.default_rng(6)
    days = 30
    day, queue = np.repeat(np.arange(days), 50), np.arange(1500) % 128
    by_day = 100.0 + 30.0 * rng.normal(size=days)[day]
    means = []
    for _ in range(200):
        times = by_day + 10.0 * rng.normal(size=128)[queue]
        means.append(Crossed(np.full(1500, 1 / 1500), day, queue).mean(times))
    spread = np.std([figure.value for figure in means])
    assert np.mean([figure.seed_error for figure in means]) == pytest.approx(spread, rel=0.15)
    assert np.mean([figure.error for figure in means]) == pytest.approx(
        np.hypot(np.std(by_day[::50]) / 30**0.5, spread), rel=0.15
    )


CALM = constant_wind(4.0, 200.0, DEPART, HORIZON_H, 40.8, -73.9, 60.0)


def test_one_wind_no_stop_and_nobody_else_leave_nothing_unsure_but_gusts(newyork):
    alone = replace(newyork, load=PadLoad.none(len(newyork.network), newyork.timezone))
    found = plan(alone, ask("bellevue", "jacobi", drone="m300"), forecast=CALM).composition.arrival
    assert found.delivery_mean.half_width < 2.0
    assert found.delivery_mean.value == pytest.approx((found.mean - DEPART).total_seconds(), abs=0.01)


def test_the_interval_of_a_mean_holds_what_very_many_other_seeds_say(newyork):
    """Rare queues: most sets of 64 hold none in which the destination is full, and said 16 min +- 17 s; others said 23 min."""
    answer = plan(newyork, ask("bellevue", "jacobi", drone="m300"), forecast=CALM).robust
    means = []
    for seed in range(1000, 1030):
        other = copy(answer.policy.problem)
        other.request = replace(other.request, seed=seed)
        again = replace(answer.policy, problem=other).simulate(
            USUAL_ERRORS, 1500, before=answer.out_of_sample, sample_set=1
        )
        means.append(again.outcome(other).delivery)
    truth = np.mean([one.value for one in means])
    assert sum(covered(truth, one) for one in means) >= 0.9 * len(means)
    assert sum(abs(one.value - truth) < 1.96 * one.seed_error for one in means) >= 0.9 * len(means)
    assert np.median([one.high - one.low for one in means]) < 0.25 * truth


@pytest.mark.parametrize("route", [FAR, ("bellevue", "jacobi"), ("edison", "nyu-brooklyn")])
@pytest.mark.parametrize("planner", ["robust", "pfs"])
def test_the_course_that_is_shown_is_a_typical_one(planned, route, planner):
    found = planned(route, planner, 0)
    median = found.composition.arrival.delivery_p50
    shown = found.composition.delivery_time_s
    assert median.low * 0.97 <= shown <= median.high * 1.03
    assert shown == pytest.approx(median.value, rel=0.03)


@pytest.mark.slow
def test_seeds_differ_by_no_more_than_their_figures_say(planned):
    """Issue 16: 80.9 to 105.5 min between seeds, printed to the second."""
    plans = [planned(FAR, "robust", seed) for seed in range(16)]
    found = [(one.composition.route, one.outcome.delivery) for one in plans]
    routes = {way: [one for other, one in found if other == way] for way, _ in found}
    means = [(np.mean([one.value for one in same]), same) for same in routes.values() if len(same) > 1]
    held = [covered(mean, one) for mean, same in means for one in same]
    assert len(held) >= 12
    assert sum(held) >= 0.9 * len(held)
    assert all(one.error < 0.2 * one.value for _, one in found)
    assert sum(one.seed_error < one.error for _, one in found) >= 0.9 * len(found)


def test_a_planner_is_compared_by_the_figures_that_its_plan_tells(planned):
    robust, pfs = (planned(FAR, name, 0) for name in ("robust", "pfs"))
    one = robust_gain(robust, pfs)
    assert one.sooner.value == pytest.approx(pfs.outcome.delivery.value - robust.outcome.delivery.value)
    assert one.other.outcome.success.value == pytest.approx(pfs.composition.success_probability)
    assert (pfs.outcome.crossed.day == robust.outcome.crossed.day).all()
    assert (pfs.outcome.crossed.queue == robust.outcome.crossed.queue).all()


def arrivals(crossed, times, runs):
    """Outcome of some of the runs: the others do not arrive."""
    some, nothing = crossed.of(runs), np.zeros(0)
    return Outcome(
        0.0, times[runs], some.weight, nothing, nothing, nothing, 1.0, len(runs) / len(times), np.ones(len(runs), dtype=bool), crossed=some
    )  # fmt: skip


def test_routes_are_compared_in_the_deliveries_that_arrive_on_both():
    crossed, times = crossed_runs(np.random.default_rng(2), queues=1500)
    most = np.flatnonzero(times < np.quantile(times, 0.9))  # in the worst weather it does not arrive
    other, one = arrivals(crossed, times, np.arange(len(times))), arrivals(crossed, times + 60.0, most[::-1])
    assert one.mean_s < other.mean_s + 60.0 - 0.1, "the worst deliveries are not in its mean"
    found = later(one, other)
    assert (found.value, found.low, found.high) == pytest.approx((60.0, 60.0, 60.0))
    back = later(other, one)
    assert back.value == pytest.approx(-60.0)
    few = later(arrivals(crossed, times, most[:100]), other)
    assert few.low < few.value < few.high, "compared by their means: hardly any delivery is in both"


def test_waiting_for_room_is_no_waiting_for_wind(newyork):
    """Issue 16: a hold of 26 % that was said to be for the wind was mostly for room at the next station."""
    calm = constant_wind(2.0, 200.0, DEPART, HORIZON_H, 40.8, -73.9, 60.0)
    busy = {station.id: station.pads + station.holding_spots for station in newyork.network.stations if station.pads}
    request = ask("siuh-north", "white-plains", drone="m300", busy_pads=busy)
    legs = plan(newyork, request, forecast=calm).composition.services
    assert all(leg.p_hold == 0.0 for leg in legs)
    assert any(leg.p_hold_room > 0.5 for leg in legs)
    stormy = constant_wind(25.0, 200.0, DEPART, HORIZON_H, 40.8, -73.9, 60.0)
    mixed = replace(
        calm,
        north=np.concatenate(
            [calm.north, np.where(np.arange(calm.north.shape[1])[None, :, None] < 2, stormy.north, calm.north)]
        ),
        east=np.concatenate(
            [calm.east, np.where(np.arange(calm.east.shape[1])[None, :, None] < 2, stormy.east, calm.east)]
        ),
        probability=np.full(2, 0.5),
        labels=("calm", "stormy at first"),
    )
    found = plan(newyork, ask("bellevue", "jacobi", drone="m300"), forecast=mixed)
    leg = found.composition.services[0]
    # In calm wind nobody waits for the wind; one that waited for room may then wait for a pad.
    assert 0.5 - 1e-9 <= leg.p_hold < 0.5 + 0.2 * leg.p_hold_room
    # The destination is nearly full in one of a hundred: as often as in queues that nobody planned in.
    leaves_s = (DEPART.timestamp(), DEPART.timestamp() + 2 * 3600.0)
    p = found.robust.policy.problem
    slow_s = (np.nanmin(found.robust.out_of_sample.tables[0, 0]) - p.soc_fixed) / p.soc_per_s  # it is charged for
    expected = np.mean([nearly_full(found.robust.policy, "jacobi", time_s, slow_s) for time_s in leaves_s])
    assert 0.0 < expected < 0.05
    assert leg.p_hold_room == pytest.approx(expected, abs=0.008)


def nearly_full(policy, station, take_off_s, flight_s, sets=3000):
    """How often so many others are at a station at a take-off that a flight finds all places taken more often than is allowed."""
    p = policy.problem
    node = p.network.index[station]
    place, hour = p.network.stations[node], hours_of_week(p.load.timezone, take_off_s, 1)[0]
    arrivals, leave = flight_s * p.load.arrivals_per_s[node, hour], flight_s / p.load.mean_charging_s[node, hour]
    paths = p.many_queues([node], 9, sets)
    count = 0
    for path in (paths[number] for number in range(sets)):
        came, left = (np.count_nonzero(one <= take_off_s) for one in (path.arrival_s[1:], path.left_s))
        others = path.present + came - left
        full = skellam.sf(place.pads + place.holding_spots - others - 1, arrivals, leave * min(place.pads, others))
        count += full > policy.most_full
    return count / sets


def test_the_wind_of_a_leg_is_that_of_the_forecast_where_and_when_it_is_flown(newyork, planned):
    composition = planned(FAR, "robust", 0).composition
    forecast = newyork.forecast(DEPART, HORIZON_H)
    for leg in composition.services:
        a, b = (composition.stations[key] for key in (leg.origin, leg.destination))
        when = leg.depart.timestamp(), leg.arrive.timestamp()
        expected = summarise_wind(forecast, [Passage((a.lat + b.lat) / 2, (a.lon + b.lon) / 2, *when)], 60.0, 0.2)
        assert leg.wind.speed_mps == pytest.approx(expected.mean_mps, abs=0.5)
        assert leg.wind.p10_mps < leg.wind.speed_mps < leg.wind.p90_mps
        assert [segment.head for segment in leg.segments] == [*leg.via, leg.destination]
        assert sum(segment.distance_m for segment in leg.segments) == pytest.approx(leg.distance_m)
    bent = next(leg for leg in composition.services if leg.via)
    schedules = {round(segment.bearing_deg) for segment in bent.segments}
    assert len(schedules) > 1
