"""`exact` and `ies` before referees that share no code with them, over slots of the wind from 5 minutes to 3 hours.

Both searches share their flights, so that their agreement proves little. The referees: a grid of take-off times, which
gives an upper bound near the optimum; mixed-integer programs over all events, solved by HiGHS, which give the optimum; and
each answer is flown.
"""

import math

import numpy as np
import pytest
from referee_events import Events
from referee_flights import flown
from referee_grid import Grid
from referee_worlds import KINDS, SLOTS_MIN, instance

from skyway.models.base.errors import NoRouteError
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact.exact import ExactSearch

HOURS = 14.0
SEEDS = pytest.mark.parametrize("seeds", [range(3), pytest.param(range(100, 200), marks=pytest.mark.slow)])
FEW = pytest.mark.parametrize("seeds", [range(1), pytest.param(range(500, 512), marks=pytest.mark.slow)])


def answers(problem, queues):
    """Decisions and delivery time of both searches, infinite where there is no route."""
    found = []
    for search in (ExactSearch(problem, queues), ExhaustiveSearch(problem, queues)):
        try:
            found.append((search.solve(), search.best_s - problem.depart_s))
        except NoRouteError:
            found.append((None, math.inf))
    return found


@SEEDS
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("slot_min", SLOTS_MIN)
def test_answers_fly_and_nothing_on_a_grid_of_times_is_better(slot_min, kind, seeds):
    solved, furthest = 0, 0.0
    for seed in seeds:
        problem, queues = instance(seed, slot_min, kind)
        grid = Grid(problem, queues, HOURS, step_s=4.0).delivery_time_s()
        for itinerary, claimed in answers(problem, queues):
            if itinerary is None:
                assert math.isinf(grid), f"seed {seed}: called infeasible, the grid delivers in {grid:.1f} s"
                continue
            time, fault = flown(problem, queues, itinerary)
            assert not fault, f"seed {seed}: {fault}"
            assert time == pytest.approx(claimed, abs=0.01), seed
            assert claimed <= grid + 0.01, seed
            if claimed < (HOURS - 0.5) * 3600.0:
                if grid > claimed + 60.0:  # the wind may be open for less than a step
                    grid = Grid(problem, queues, HOURS, step_s=0.25).delivery_time_s()
                assert grid <= claimed + 60.0, seed
            if math.isfinite(grid):
                solved, furthest = solved + 1, max(furthest, grid - claimed)
    print(f"slots of {slot_min} min, {kind}: {solved} of {2 * len(seeds)} solved, grid {furthest:.1f} s later at most")


@FEW
@pytest.mark.parametrize("kind", ["short", "long", "wild"])
@pytest.mark.parametrize("slot_min", SLOTS_MIN)
def test_answers_are_the_optima_of_mixed_integer_programs(slot_min, kind, seeds):
    worst, solved = 0.0, 0
    for seed in seeds:
        problem, queues = instance(seed, slot_min, kind, stations=4 if len(seeds) > 1 else 3)
        (_, exact), (_, exhaustive) = answers(problem, queues)
        until_s = min(exact + 120.0, 3.0 * 3600.0)
        try:
            optimum = Events(problem, queues, until_s=until_s).delivery_time_s()
        except TimeoutError:
            continue
        for time in (exact, exhaustive):
            if math.isinf(optimum):
                assert time > until_s - 1.0, seed
            else:
                assert time == pytest.approx(optimum, abs=0.02), seed
                worst, solved = max(worst, abs(time - optimum)), solved + 1
    print(f"slots of {slot_min} min, {kind}: {solved} of {2 * len(seeds)} solved, {worst:.1e} s apart at most")


def test_a_stop_that_no_flight_leaves_ends_no_search():
    problem, queues = instance(233, 10, "long wild")
    with pytest.raises(NoRouteError):
        ExhaustiveSearch(problem, queues).solve()


def test_many_of_these_deliveries_recharge_and_many_have_no_route():
    flights = [
        itinerary and len(itinerary)
        for slot_min in SLOTS_MIN
        for kind in KINDS
        for seed in range(3)
        for itinerary, _ in answers(*instance(seed, slot_min, kind))
    ]
    with_stops = np.sum([count is not None and count > 1 for count in flights])
    assert with_stops >= 20
    assert np.sum([count is None for count in flights]) >= 20
