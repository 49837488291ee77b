"""Exact composition equals the exhaustive search, faster, and never claims what does not fly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from referee_grid import Grid
from worlds import DEPART, best_time, make_request, make_wind, make_world

from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.models.queues.paths import QueuePath, expected_paths
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.problem.flight_table import ground_speeds
from skyway.planner.problem.problem import Problem
from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TAKE_OFF, TOUCH_DOWN

RELATIVE = 1e-6


def instance(seed, *, in_flight=False):
    """Up to 10 stations; calm to strong and turning wind, short to long queues, easy to impossible reserves."""
    rng = np.random.default_rng(seed)
    stations = int(rng.integers(4, 11))
    scenario = make_world(
        rng,
        stations,
        length_m=9_000.0 * stations,
        utilisation=float(rng.choice([0.0, 0.5, 0.9, 1.2])),
        target=seed % 4 == 3,
    )
    wind = make_wind(rng, mean_mps=float(rng.choice([1.0, 4.0, 7.0])), turn_back=float(rng.choice([10.0, 60.0])))
    reserve = float(rng.choice([0.1, 0.2, 0.3, 0.5]))
    request = make_request(scenario, rng, reserve_soc=reserve, payload_kg=float(rng.uniform(0.0, 1.0)))
    if in_flight:
        first, second = scenario.network.stations[:2]
        here = 0.5 * (first.lat + second.lat) + 0.01, 0.5 * (first.lon + second.lon)
        request = replace(request, state=State(DEPART, None, here, float(rng.uniform(0.3, 0.9))))
    problem = Problem(scenario, request, scenario.drones[0], wind)
    return problem, problem.queue_paths(range(len(problem.network)), 0)


def compare(seeds, **state):
    """Relative differences to the exhaustive search; every answer is flown in the truth."""
    differences, infeasible = [], 0
    for seed in seeds:
        problem, queues = instance(seed, **state)
        _, referee = best_time(ExhaustiveSearch(problem, queues))
        itinerary, exact = best_time(ExactSearch(problem, queues))
        if itinerary is None:
            assert math.isinf(referee), seed
            infeasible += 1
            continue
        schedule = fly_true(problem, itinerary, queues)[0]
        assert schedule[-1, TOUCH_DOWN] - problem.depart_s == pytest.approx(exact, abs=0.02), seed
        assert np.all(schedule[:, SOC_LANDING] >= problem.reserve - 1e-6), seed
        differences.append((exact - referee) / referee)
    return np.array(differences), infeasible


def test_it_equals_the_exhaustive_search():
    differences, infeasible = compare(range(150))
    assert np.max(np.abs(differences)) <= RELATIVE
    assert len(differences) >= 50
    assert infeasible >= 10


def test_it_equals_the_exhaustive_search_from_a_drone_in_flight():
    differences, infeasible = compare(range(100), in_flight=True)
    assert np.max(np.abs(differences)) <= RELATIVE
    assert len(differences) >= 20
    assert infeasible >= 5


def test_what_it_finds_first_is_no_better_than_the_best_and_its_bound_no_worse():
    unproved = 0
    for seed in range(30):
        problem, queues = instance(seed)
        at_once = ExactSearch(problem, queues, time_limit_s=0.0)
        itinerary, first = best_time(at_once)
        _, best = best_time(ExactSearch(problem, queues))
        if itinerary is None:
            assert math.isinf(best), seed
            continue
        bound = at_once.lower_bound_s - problem.depart_s
        assert bound - 1e-3 <= best <= first + 1e-6, seed
        assert at_once.gap == pytest.approx((first - bound) / bound, abs=1e-9)
        assert at_once.gap == 0.0 or not at_once.complete
        unproved += not at_once.complete
        schedule = fly_true(problem, itinerary, queues)[0]
        assert schedule[-1, TOUCH_DOWN] - problem.depart_s == pytest.approx(first, abs=0.02), seed
    assert unproved >= 3


def test_stops_can_be_forbidden():
    for seed in range(8):
        problem, queues = instance(seed)
        itinerary, time = best_time(ExactSearch(problem, queues))
        if itinerary is None or len(itinerary) < 2:
            continue
        stop = int(problem.network.tail[itinerary[1].segments[0]])
        stops = np.ones(len(problem.network), dtype=bool)
        stops[stop] = False
        other, later = best_time(ExactSearch(problem, queues, stops=stops))
        assert later >= time - 1e-6
        if other is not None:
            assert stop not in [int(problem.network.tail[leg.segments[0]]) for leg in other[1:]]


@pytest.mark.slow
def test_it_is_never_above_the_exhaustive_search_on_larger_worlds():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        scenario = make_world(rng, 40, length_m=120_000.0, width_m=40_000.0, utilisation=0.7)
        request = make_request(scenario, rng, payload_kg=0.5)
        problem = Problem(scenario, request, scenario.drones[0], make_wind(rng, mean_mps=4.0))
        queues = problem.queue_paths(range(40), 0)
        referee = ExhaustiveSearch(problem, queues, time_limit_s=3.0)
        _, found = best_time(referee)
        _, exact = best_time(ExactSearch(problem, queues))
        assert exact <= found + 1e-3, seed
        if referee.complete:
            assert exact == pytest.approx(found, rel=RELATIVE), seed


@pytest.mark.slow
def test_it_equals_the_exhaustive_search_a_thousand_times():
    differences, infeasible = compare(range(1000, 2600))
    assert np.max(differences) <= RELATIVE, "never above it"
    assert np.mean(np.abs(differences)) <= 1e-4
    assert np.max(np.abs(differences)) <= 1e-3
    assert len(differences) + infeasible >= 1000
    print(f"{len(differences)} solved, {infeasible} infeasible, largest difference {np.max(np.abs(differences)):.2e}")


def small(seed, **world):
    """Five stations, so that the search on a grid of times can follow; the wind is the same everywhere."""
    rng = np.random.default_rng(seed)
    scenario = make_world(rng, 5, **({"utilisation": 0.0, "target": seed % 3 == 0} | world))
    winds = [make_wind(rng, mean_mps=float(rng.choice([2.0, 5.0]))) for _ in range(2)]
    reserve = float(rng.choice([0.1, 0.2]))
    request = make_request(scenario, rng, reserve_soc=reserve, payload_kg=0.5)
    problems = [Problem(scenario, request, scenario.drones[0], wind) for wind in winds]
    return problems, problems[0].queue_paths(range(5), 0)


def close_to_the_grid(time_s, problem, queues, **changes):
    """Compare with an independent search on a grid of times, an upper bound; true where both find nothing."""
    grid = Grid(problem, queues, **changes).delivery_time_s()
    if math.isinf(time_s):
        return math.isinf(grid)
    return (math.isinf(grid) and time_s > 6.5 * 3600.0) or -1e-3 <= grid - time_s <= 60.0 + 0.01 * time_s


SEEDS = pytest.mark.parametrize("seeds", [range(1, 3), pytest.param(range(3, 15), marks=pytest.mark.slow)])


def test_a_table_of_ground_speeds_takes_the_place_of_the_wind():
    solved = 0
    for seed in range(4):
        (here, there), queues = small(seed)
        slots, segments = there.air.north.shape[1], len(there.network.head)
        table = ground_speeds(there.air, 0, np.arange(slots), np.arange(segments))
        _, time = best_time(ExactSearch(here, queues, speeds=table))
        _, expected = best_time(ExactSearch(there, queues))
        assert time == pytest.approx(expected, rel=1e-9), seed
        solved += math.isfinite(time)
    assert solved >= 2


@SEEDS
def test_any_table_is_flown_as_it_stands_closed_segments_and_all(seeds):
    found = []
    for seed in seeds:
        (problem, _), queues = small(seed, target=False)
        rng = np.random.default_rng(seed)
        table = rng.uniform(8.0, 20.0, (48, len(problem.network.head)))
        table[rng.random(table.shape) < 0.15] = 0.0
        _, time = best_time(ExactSearch(problem, queues, speeds=table))
        assert close_to_the_grid(time, problem, queues, speeds=table), seed
        found.append(time)
    assert np.sum(np.isfinite(found)) >= len(seeds) // 2


@SEEDS
def test_a_margin_per_second_of_flight_is_kept_on_every_landing(seeds):
    changed = 0
    for seed in seeds:
        (problem, _), queues = small(seed, utilisation=0.5)
        margin = 0.15 * problem.soc_per_s
        itinerary, time = best_time(ExactSearch(problem, queues, margin_soc_per_s=margin))
        assert close_to_the_grid(time, problem, queues, margin_soc_per_s=margin), seed
        _, without = best_time(ExactSearch(problem, queues))
        assert without <= time
        changed += without < time - 1.0
        if itinerary is not None:
            schedule = fly_true(problem, itinerary, queues)[0]
            spare = (
                schedule[:, SOC_LANDING] - problem.reserve - margin * (schedule[:, TOUCH_DOWN] - schedule[:, TAKE_OFF])
            )
            assert np.all(spare >= -1e-6), seed
    assert changed >= len(seeds) // 3


@SEEDS
def test_expected_waits_delay_the_pad(seeds):
    waited = 0
    for seed in seeds:
        (problem, _), free = small(seed)
        rng = np.random.default_rng(seed)
        waits = np.maximum(0.0, 900.0 + np.cumsum(rng.normal(0.0, 300.0, 289)))
        queues = dict.fromkeys(free, expected_paths(problem.depart_s, 600.0, np.array([waits], dtype=float))[0])
        itinerary, time = best_time(ExactSearch(problem, queues))
        assert close_to_the_grid(time, problem, queues), seed
        waited += math.isfinite(time) and time > best_time(ExactSearch(problem, free))[1] + 60.0
        if itinerary is not None:
            schedule = fly_true(problem, itinerary, queues)[0]
            assert schedule[-1, TOUCH_DOWN] - problem.depart_s == pytest.approx(time, abs=0.02), seed
            assert np.all(schedule[:, SOC_LANDING] >= problem.reserve - 1e-6), seed
    assert waited >= len(seeds) // 4


def test_with_a_destination_that_opens_late_it_equals_the_exhaustive_search():
    compared = 0
    for seed in range(40):
        problem, queues = instance(seed)
        if not problem.has_pads(problem.destination):
            continue
        rng = np.random.default_rng(seed)
        opens = problem.depart_s + np.cumsum(rng.uniform(0.0, 9_000.0, 3))
        came = problem.depart_s + np.cumsum(rng.uniform(0.0, 9_000.0, 2))
        queues = queues | {problem.destination: QueuePath(came, opens, opens)}
        referee, search = ExhaustiveSearch(problem, queues, time_limit_s=0.5), ExactSearch(problem, queues)
        itinerary, exact = best_time(search)
        _, best = best_time(referee)
        assert exact <= best + 1e-3, seed
        if referee.complete:
            assert exact == pytest.approx(best, rel=RELATIVE), seed
        if itinerary is not None:
            schedule = fly_true(problem, itinerary, queues)[0]
            assert schedule[-1, TOUCH_DOWN] == pytest.approx(search.best_s, abs=1e-3), seed
            assert search.lower_bound_s <= search.best_s + 1e-5
            compared += referee.complete
    assert compared >= 8


def test_a_search_that_is_cut_off_says_so_and_bounds_what_it_has():
    """However short its time: an answer that flies, with a bound below the best there is, or an error with a remedy."""
    for seed in range(30):
        problem, queues = instance(seed)
        whole = ExactSearch(problem, queues)
        if whole.find() is not None and whole.labels_expanded > 5:
            break
    cut, answered = 0, 0
    for limit_s in (0.0, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0):
        search = ExactSearch(problem, queues, cut_off_s=limit_s)
        if search.find() is None:
            assert not search.complete
            cut += 1
        else:
            answered += 1
            assert search.best_s >= whole.best_s - 1e-6
            assert search.lower_bound_s <= whole.best_s + 1e-5
            assert search.complete == (search.best_s <= search.lower_bound_s + 1e-5)
    with pytest.raises(NoRouteError, match="raise --time-limit") as refused:
        ExactSearch(problem, queues, cut_off_s=1e-9).solve()
    assert refused.value.constraint == "time-limit"
    assert cut >= 1
    assert answered >= 1
