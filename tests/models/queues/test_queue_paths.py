"""One realisation of the other drones: a brute-force simulation with our drone in it gives the same times."""

import heapq
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.cases.loads import scaled_to
from skyway.models.queues.load import PadLoad
from skyway.models.queues.paths import QueuePath, expected_paths, joined, no_queue, pack, spliced
from skyway.models.queues.sampling import sample_many, sample_sets, sampled_waits
from skyway.models.queues.sampling_kernels import lived_sets
from skyway.models.queues.waiting_times import STEP_S, forecast_waits, present_at
from tests.plain_deviates import plain_exponentials
from tests.sampled_paths import sample_path

NEW_YORK = "America/New_York"
HOUR = 3600.0
FIVE, FOUR = np.full(5, 5), np.full(5, 4)
START = 1_373_464_800.0 + 1234.0


def expected_path(start_s, step_s, wait_s):
    return expected_paths(start_s, step_s, np.array([wait_s], dtype=float))[0]


def steady_load(utilisation: float, stations: int = 1) -> PadLoad:
    return scaled_to(PadLoad.none(stations, NEW_YORK), utilisation, 5)


def sampled(pads=3, spots=2, seed=1, utilisation=0.9, busy=0, start_h=8.0, hours=10.0) -> QueuePath:
    rates = np.full(20, utilisation * pads / HOUR), np.full(20, 1.0 / HOUR)
    times = 0.0, start_h * HOUR, (start_h + hours) * HOUR
    return sample_path(np.random.default_rng(seed), pads, spots, rates, times, busy)


def brute_force(pads: int, spots: int, others: list[tuple[float, float]], ours_s: float) -> tuple[float, float]:
    """(landing, pad) times of our drone among others with (arrival, charging time): event by event.

    In the line the first `spots` drones stand, the others hover; a drone lands when it is among the first.
    """
    events = [(a, 0, number, charging) for number, (a, charging) in enumerate(others)]
    events.append((ours_s, 1, -1, 0.0))
    heapq.heapify(events)
    line: deque = deque()
    busy, landed = 0, math.inf
    while events:
        now, kind, number, charging = heapq.heappop(events)
        if kind == 2:
            busy -= 1
        else:
            line.append((number, charging))
        while line and busy < pads:
            number, charging = line.popleft()
            if number == -1:
                return min(landed, now), now
            busy += 1
            heapq.heappush(events, (now + charging, 2, number, 0.0))
        if -1 in [n for n, _ in list(line)[:spots]]:
            landed = min(landed, now)
    raise AssertionError


def replayed(path_seed: int, pads: int, utilisation: float, hours: float) -> list[tuple[float, float]]:
    """(arrival, charging time) of the others, from the same stream of random numbers at constant rates."""
    deviates = plain_exponentials(int(np.random.default_rng(path_seed).integers(0, 2**64, dtype=np.uint64)))
    now, others = 0.0, []
    while True:
        now += next(deviates) * HOUR / (utilisation * pads)
        if now > (8 + hours) * HOUR:
            return others
        others.append((now, next(deviates) * HOUR))


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(0, 3), st.floats(0.2, 1.6), st.floats(0.0, 10.0))
def test_our_drone_gets_what_an_event_simulation_with_it_gives(seed, pads, spots, utilisation, after_h):
    path = sampled(pads, spots, seed, utilisation, start_h=0.0, hours=18.0)
    ours_s = (8 + after_h) * HOUR
    landing, pad = brute_force(pads, spots, replayed(seed, pads, utilisation, 10.0), ours_s)
    assert float(path.pad_time(ours_s)) == pytest.approx(pad, abs=1e-6)
    assert float(path.land_time(ours_s)) == pytest.approx(landing, abs=1e-6)


@settings(max_examples=60)
@given(
    st.integers(0, 10**6), st.integers(1, 4), st.integers(0, 3), st.floats(0.0, 2.0), st.integers(0, 12)
)  # fmt: skip
def test_who_arrives_later_never_lands_or_starts_earlier(seed, pads, spots, utilisation, busy):
    path = sampled(pads, spots, seed, utilisation, busy)
    arrival = np.sort(np.concatenate((np.linspace(7 * HOUR, 20 * HOUR, 400), path.arrival_s)))
    pad, land = path.pad_time(arrival), path.land_time(arrival)
    assert (np.diff(pad) >= 0.0).all()
    assert (np.diff(land) >= 0.0).all()
    assert (arrival <= land).all()
    assert (land <= pad).all()
    assert (path.land_s <= path.pad_s).all()
    assert (path.pad_s[1:] >= path.pad_s[:-1]).all()
    assert (path.land_s[1:] >= path.land_s[:-1]).all()
    assert (np.diff(path.arrival_s) >= 0.0).all()
    assert len(path.pad_s) == len(path.land_s) == len(path.arrival_s) + 1
    if len(path.arrival_s):
        assert path.arrival_s[0] > 8 * HOUR
        assert path.arrival_s[-1] <= 18 * HOUR


def test_an_arrival_at_the_same_time_as_another_stands_behind_it():
    path = QueuePath(np.array([10.0]), np.array([5.0, 40.0]), np.array([5.0, 20.0]))
    assert path.pad_time([9.9, 10.0, 50.0]).tolist() == [9.9, 40.0, 50.0]
    assert path.land_time([9.9, 10.0, 50.0]).tolist() == [9.9, 20.0, 50.0]


def test_drones_in_the_line_go_before_us():
    start = 8 * HOUR
    path = sampled(1, 1, utilisation=0.0, busy=3)
    first, second, third = path.left_s
    assert (path.land_time(start), path.pad_time(start)) == (
        second,
        third,
    )  # the spot holds the second in the line until then
    assert sampled(1, 2, utilisation=0.0, busy=3).land_time(start) == first
    assert sampled(1, 3, utilisation=0.0, busy=3).land_time(start) == start


def test_the_same_seed_gives_the_same_path_and_another_seed_another():
    first, again, other = sampled(seed=3), sampled(seed=3), sampled(seed=4)
    assert np.array_equal(first.pad_s, again.pad_s)
    assert not np.array_equal(first.pad_s[:5], other.pad_s[:5])


def test_a_station_gets_the_same_path_whatever_other_stations_are_asked_for():
    load = steady_load(0.8, 5)
    all_of_them = sample_sets(load, FIVE, FOUR, range(5), START, 12, [7], {})[0]
    alone = sample_sets(load, FIVE, FOUR, [3], START, 12, [7], {})[0]
    assert np.array_equal(all_of_them[3].pad_s, alone[3].pad_s)
    assert not np.array_equal(all_of_them[2].arrival_s, all_of_them[3].arrival_s)
    member = sample_sets(load, FIVE, FOUR, [3], START, 12, [(7, 1)], {})[0]
    assert not np.array_equal(member[3].arrival_s, alone[3].arrival_s)


def test_stations_and_seeds_are_independent_and_begin_as_the_forecast_says():
    load, pads = steady_load(0.9, 40), np.full(40, 5)
    sets = sample_sets(load, pads, np.full(40, 4), range(40), START, 4, [(3, number) for number in range(250)], {})
    present = np.array([[paths[station].present for station in range(40)] for paths in sets])
    (share,) = present_at(load, [0], [5], START)
    expected = np.diff(share, prepend=0.0)
    for drones in range(8):
        error = math.sqrt(expected[drones] * (1.0 - expected[drones]) / present.size)
        assert (present == drones).mean() == pytest.approx(expected[drones], abs=4.5 * error)
    waits = np.array([[float(paths[station].pad_time(START)) for station in range(40)] for paths in sets]) - START
    for table in (present, waits):
        between = np.corrcoef(table)[np.triu_indices(250, 1)], np.corrcoef(table.T)[np.triu_indices(40, 1)]
        assert abs(between[0].mean()) < 0.01
        assert abs(between[1].mean()) < 0.02


@pytest.mark.parametrize("busy", [{}, {0: 8}])
def test_many_paths_have_the_waits_of_the_forecast(busy):
    hours = np.arange(168)
    arrivals = (2.0 + 1.5 * np.sin(hours / 24 * 2 * np.pi))[None, :] / HOUR
    load = PadLoad(arrivals, (1.0 + 0.5 * np.cos(hours / 5.0))[None, :] * HOUR, NEW_YORK)
    pads = np.array([3])
    forecast = forecast_waits(load, pads, [0], START, 8, busy)[0]
    sets = sample_sets(load, pads, FOUR, [0], START, 8, [(1, i) for i in range(6000)], busy)
    paths = [one[0] for one in sets]
    grid = START + STEP_S * np.arange(len(forecast.wait_s))
    for t in (START, START + 0.4 * HOUR, START + 7.3 * HOUR):
        waits = np.array([float(path.pad_time(t)) - t for path in paths])
        error = 4.0 * waits.std() / math.sqrt(len(waits))
        assert np.interp(t, grid, forecast.wait_s) == pytest.approx(waits.mean(), abs=error + 1.0)
        assert np.interp(t, grid, forecast.p_free) == pytest.approx(
            (waits == 0.0).mean(), abs=4 * 0.5 / math.sqrt(6000)
        )


@pytest.mark.parametrize("busy", [None, 8])
def test_paths_sampled_at_once_have_the_waits_of_the_forecast(busy):
    load = steady_load(0.8)
    paths = sample_many(load, 5, 4, 0, START, 12.0, (1, 2), 2000, busy)
    assert len(paths) == 2000
    times = START + 600.0 * np.arange(0, 70, 10)
    waits = np.array([paths[number].pad_time(times) - times for number in range(2000)])
    grid = START + STEP_S * np.arange(73)
    expected = forecast_waits(load, FIVE, [0], START, 12.0, {} if busy is None else {0: busy})[0].wait_s
    error = waits.std(axis=0) / 2000**0.5
    assert (np.abs(waits.mean(axis=0) - np.interp(times, grid, expected)) < 4.0 * error + 1.0).all()


@pytest.mark.parametrize("hours", [5.0, np.arange(40) / 4.0])
def test_paths_that_are_sampled_for_a_while_are_the_beginnings_of_long_ones(hours):
    load, until_s = steady_load(0.9), START + HOUR * hours
    whole, begun = (sample_many(load, 3, 2, 0, START, 24.0, (7,), 40, None, (), end) for end in (math.inf, until_s))
    assert len(begun.pad_s) < len(whole.pad_s) / 3
    for number, until in enumerate(np.broadcast_to(until_s, 40)):
        times, one, other = np.arange(START, until, 300.0), begun[number], whole[number]
        assert np.array_equal(one.pad_time(times), other.pad_time(times))
        assert [one.land_time(t) for t in times] == [other.land_time(t) for t in times]
        assert np.array_equal(one.left_s[one.left_s <= until], other.left_s[other.left_s <= until])


def test_spliced_paths_are_those_that_were_chosen():
    load, rng = steady_load(0.9), np.random.default_rng(4)
    some, others = (sample_many(load, 3, 2, 0, START, 20.0, (seed,), 30, None) for seed in (1, 2))
    chosen = rng.random(30) < 0.4
    found = spliced(some, others, chosen)
    assert len(found) == 30
    for number in range(30):
        one, expected = found[number], (others if chosen[number] else some)[number]
        for name in ("arrival_s", "pad_s", "land_s", "delay_s", "left_s", "present"):
            assert np.array_equal(getattr(one, name), getattr(expected, name))


def served_one_by_one(key, present, pads=3, spots=2, hourly=3.0, known=(), start_s=8 * HOUR, end_s=18 * HOUR):
    """Some arrivals an hour, an hour on a pad on average: who came, when a pad and a place would be free for ours, who was there, who left."""
    deviates = plain_exponentials(key)
    free = [-math.inf] * pads
    for pad in range(min(present, pads)):
        lasts = HOUR * next(deviates)
        free[pad] = known[pad] if pad < len(known) else start_s + lasts
    later = [one for one in free if one > start_s]
    waiting, there, now = max(present - pads, 0), len(later), start_s
    came, began, ready = [], [], []
    while True:
        pad = min(range(pads), key=free.__getitem__)
        ready.append(free[pad])
        if len(came) >= waiting:
            now += HOUR / hourly * next(deviates)
            if now > end_s:
                break
        elif len(came) < waiting:
            there += 1
        came.append(now)
        began.append(max(now, free[pad]))
        free[pad] = began[-1] + HOUR * next(deviates)
        later.append(free[pad])
    pad_s = ready[waiting:]
    ahead = [waiting + k - spots for k in range(len(pad_s))]
    land_s = (
        [min(at, began[k]) if k >= 0 else -math.inf for at, k in zip(pad_s, ahead, strict=True)] if spots else pad_s
    )
    return came[waiting:], pad_s, land_s, there, sorted(later)


def test_paths_sampled_at_once_are_the_same_again_and_each_is_that_of_its_deviates():
    load = steady_load(0.9)
    one, again, other = (sample_many(load, 5, 4, 0, START, 12.0, seed, 20, None) for seed in ((1,), (1,), (2,)))
    for name in ("offset", "arrival_s", "pad_s", "land_s", "delay_s", "present", "left_offset", "left_s"):
        assert np.array_equal(getattr(one, name), getattr(again, name))
    assert not np.array_equal(one.arrival_s, other.arrival_s)


def test_paths_of_several_stations_are_those_of_their_deviates():
    pads, spots, hourly = [3, 1, 5], [2, 0, 4], [3.0, 0.9, 6.0]
    known = [[], [9.5 * HOUR], [8.2 * HOUR, 9 * HOUR]]
    keys = np.random.default_rng(3).integers(0, 2**64, 18, dtype=np.uint64)
    present = np.array([0, 2, 3, 9, 300, 0] * 3)
    ends = HOUR * np.array([18.0, 18.0, 18.0, 9.0, 30.0, 200.0] * 3)
    rates = np.repeat(np.array(hourly)[:, None] / HOUR, 20, axis=1), np.full((3, 20), 1.0 / HOUR)
    told = np.array([[0.0, 0.0], [9.5 * HOUR, 0.0], [8.2 * HOUR, 9 * HOUR]]), np.array([0, 1, 2])
    offset, arrival, pad, land, there, left_offset, left = lived_sets(
        keys, (np.array(pads), np.array(spots)), rates, (0.0, 8 * HOUR), ends, present, told
    )
    for number in range(18):
        station = number // 6
        came, pad_s, land_s, begin, later = served_one_by_one(
            int(keys[number]),
            int(present[number]),
            pads[station],
            spots[station],
            hourly[station],
            known[station],
            end_s=float(ends[number]),
        )
        part = slice(offset[number], offset[number + 1])
        assert arrival[part][0] == -math.inf
        assert arrival[part][1:] == pytest.approx(came, rel=1e-12)
        assert pad[part] == pytest.approx(pad_s, rel=1e-12)
        assert land[part] == pytest.approx(land_s, rel=1e-12)
        assert there[number] == begin
        assert left[left_offset[number] : left_offset[number + 1]] == pytest.approx(later, rel=1e-12)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.floats(-1.0, 13.0), st.lists(st.floats(0.0, 13.0), min_size=1, max_size=20))
def test_paths_sampled_until_some_time_are_those_of_the_whole_horizon_up_to_then(seed, until_h, asked_h):
    load = steady_load(0.9, 5)
    seeds, until_s = [(seed, 0), (seed, 1)], START + until_h * HOUR
    whole = sample_sets(load, FIVE, FOUR, range(5), START, 12, seeds, {2: 7})
    part = sample_sets(load, FIVE, FOUR, range(5), START, 12, seeds, {2: 7}, until_s=until_s)
    arrival = START + HOUR * np.array(asked_h)
    arrival = arrival[arrival <= until_s]
    for one, other in zip(whole, part, strict=True):
        for station in range(5):
            assert np.array_equal(one[station].pad_time(arrival), other[station].pad_time(arrival))
            assert np.array_equal(one[station].land_time(arrival), other[station].land_time(arrival))
            assert (other[station].arrival_s <= max(until_s, START)).all()


def test_others_arrive_at_the_rate_of_each_hour():
    rates = np.array([6.0, 0.0, 30.0, 1.0])
    counts = np.zeros(4)
    for seed in range(300):
        path = sample_path(
            np.random.default_rng(seed), 5, 4, (rates / HOUR, np.full(4, 1 / 600.0)), (0.0, 0.0, 4 * HOUR), 0
        )
        counts += np.histogram(path.arrival_s, bins=np.arange(5) * HOUR)[0]
    assert (np.abs(counts - 300 * rates) <= 4.0 * np.sqrt(300 * rates)).all()


def test_the_local_clock_rules_in_the_week_it_changes():
    arrivals = np.zeros((1, 168))
    arrivals[0, 6 * 24 + 1] = 60 / HOUR  # Sundays from 1 to 2: twice on 2013-11-03
    load = PadLoad(arrivals, np.full((1, 168), HOUR), NEW_YORK)
    midnight = 1_383_451_200.0  # 2013-11-03 00:00 EDT
    path = sample_sets(load, FIVE, FOUR, [0], midnight, 6, [1], {})[0][0]
    assert path.arrival_s.min() > midnight + HOUR
    assert midnight + 2.5 * HOUR < path.arrival_s.max() < midnight + 3 * HOUR


def test_nobody_is_in_the_way_without_load_and_at_a_delivery_target():
    target = sample_sets(steady_load(0.5), np.zeros(1, dtype=np.int64), FOUR, [0], START, 4, [1], {})[0][0]
    for path in (no_queue(), target, sampled(utilisation=0.0)):
        assert path.pad_time([1.0, 9 * HOUR]).tolist() == [1.0, 9 * HOUR]
        assert path.land_time([1.0, 9 * HOUR]).tolist() == [1.0, 9 * HOUR]


def test_packed_paths_answer_as_the_paths_do():
    paths = [
        sampled(seed=1),
        no_queue(),
        sampled(seed=2, utilisation=0.1),
        expected_path(8 * HOUR, 600.0, 900.0 + 600.0 * np.sin(np.arange(60))),
    ]
    packed = pack(paths)
    offset, arrival, pad, land, delay = packed.offset, packed.arrival_s, packed.pad_s, packed.land_s, packed.delay_s
    assert offset.tolist() == np.cumsum([0, *(len(path.pad_s) for path in paths)]).tolist()
    for i, path in enumerate(paths):
        part = slice(offset[i], offset[i + 1])
        for t in np.linspace(8 * HOUR, 20 * HOUR, 50):
            entry = np.searchsorted(arrival[part], t, side="right") - 1
            assert max(t + delay[part][entry], pad[part][entry]) == path.pad_time(t)
            assert max(t, land[part][entry]) == path.land_time(t)
    assert pack([]).offset.tolist() == [0]
    twice = joined([packed, pack([]), packed])
    assert len(twice) == 2 * len(paths)
    for number, path in enumerate(paths + paths):
        for name in ("arrival_s", "pad_s", "land_s", "delay_s", "left_s", "present"):
            assert np.array_equal(getattr(twice[number], name), getattr(path, name))


@settings(max_examples=60)
@given(st.lists(st.floats(0.0, 5_000.0), min_size=1, max_size=30), st.floats(60.0, 1_800.0))
def test_expected_waits_become_a_path_on_which_nobody_overtakes(waits, step):
    path = expected_path(START, step, waits)
    arrivals = np.sort(np.concatenate((START + np.linspace(-2 * step, (len(waits) + 2) * step, 700), path.arrival_s)))
    pads = path.pad_time(arrivals)
    assert np.all(np.diff(pads) >= 0.0)
    assert np.array_equal(path.land_time(arrivals), arrivals)
    # The least line that never decreases above the mean wait of each step.
    steps = np.floor((arrivals - START) / step + 1e-12).astype(int)
    ends = np.pad(np.array(waits), (1, 1), mode="edge")
    mean = 0.5 * (ends[np.clip(steps + 1, 0, len(waits) + 1)] + ends[np.clip(steps + 2, 0, len(waits) + 1)])
    on_grid = np.isin(arrivals, path.arrival_s)
    least = np.maximum.accumulate(arrivals + mean)
    assert np.all(pads[~on_grid] >= least[~on_grid] - 1e-6)
    assert np.all(
        pads <= least + max(np.abs(np.diff(ends)).max(initial=0.0), 1e-6) + (arrivals[1] - arrivals[0]) + 1e-6
    )


def test_expected_waits_that_change_slowly_are_kept_as_they_are():
    path = expected_path(START, 600.0, [0.0, 600.0, 600.0, 300.0])
    assert path.pad_time(START + np.array([-50.0, 10.0, 700.0, 1700.0])).tolist() == pytest.approx(
        (START + np.array([-50.0, 310.0, 1300.0, 2150.0])).tolist()
    )
    assert float(path.pad_time(START + 1210.0)) == pytest.approx(START + 1800.0), "behind the one before it"


def test_pads_whose_end_is_known_become_free_then():
    # All three pads busy, two drones in line: the first takes the pad that is free at 9:10, the second that of 9:30.
    rates = np.zeros(20), np.full(20, 1.0 / HOUR)
    times = 0.0, 9 * HOUR, 19 * HOUR
    known = 9 * HOUR + np.array([600.0, 1800.0, 7200.0])
    waits = []
    for seed in range(2000):
        path = sample_path(np.random.default_rng(seed), 3, 2, rates, times, 5, known)
        free = float(path.pad_time(9 * HOUR))
        assert free >= known[0]
        waits.append(free)
    # Behind the two: the first pad that is free after 9:30, of 9:10 + E, 9:30 + E, 11:00 with E exponential of 1 h.
    ends = np.array(known)[:2, None] + np.random.default_rng(0).exponential(HOUR, (2, 200_000))
    expected = np.minimum(np.minimum(ends[0], ends[1]), known[2])
    assert np.mean(waits) == pytest.approx(expected.mean(), abs=4 * expected.std() / math.sqrt(2000))
    one = sample_path(np.random.default_rng(1), 3, 2, rates, times, 3, known)
    assert float(one.pad_time(9 * HOUR)) == known[0]
    assert (one.present, one.left_s.tolist()) == (3, known.tolist())


def test_of_pads_whose_end_is_not_known_nothing_changes():
    rates = np.full(20, 2.7 / HOUR), np.full(20, 1.0 / HOUR)
    times = 0.0, 8 * HOUR, 18 * HOUR
    plain, told = (
        sample_path(np.random.default_rng(5), 3, 2, rates, times, 3, *more) for more in ((), (np.array([8.5 * HOUR]),))
    )
    assert plain.left_s[0] != told.left_s[0]
    past = sample_path(np.random.default_rng(5), 3, 2, rates, times, 3, np.array([7 * HOUR]))
    assert float(past.pad_time(8 * HOUR)) == 8 * HOUR  # its time is over: free at once


def test_waits_over_sampled_paths_are_those_of_the_chain_where_no_end_is_known():
    load, pads = steady_load(0.8), np.array([5])
    exact = forecast_waits(load, pads, [0], START, 6, {0: 9})[0]
    found = sampled_waits(load, pads, [0], START, 6, {0: 9}, {})[0]
    assert len(found.wait_s) == len(exact.wait_s)
    assert found.wait_s == pytest.approx(exact.wait_s, abs=4.0 * HOUR / math.sqrt(100))
    assert found.wait_s[0] == pytest.approx(exact.wait_s[0], rel=0.2)
    soon = sampled_waits(load, pads, [0], START, 6, {0: 5}, {0: (START + 60.0,)})[0]
    assert soon.wait_s[0] == 60.0 or soon.wait_s[0] < 60.0  # another may leave before
    assert (np.diff(START + STEP_S * np.arange(len(soon.wait_s)) + soon.wait_s) >= -1e-6).all()
