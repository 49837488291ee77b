"""The destination is a station like any other: a drone that comes there lands when there is a free pad or holding spot."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import make_request, make_wind, make_world

from skyway.models.base.errors import NoRouteError
from skyway.models.composition.composition import State
from skyway.models.queues.load import PadLoad
from skyway.models.queues.paths import QueuePath
from skyway.models.wind.forecast import constant_wind
from skyway.planner.baselines.ies import ExhaustiveSearch
from skyway.planner.exact.escape import needed_to_land
from skyway.planner.exact.exact import ExactSearch
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.problem.speeds import TrueSpeeds
from skyway.planner.schedule.itinerary import fly_sampled, fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

DEPART = datetime(2013, 7, 10, 18, tzinfo=UTC)
CALM = constant_wind(4.0, 200.0, DEPART, HORIZON_H, 40.75, -73.97, 60.0)


@pytest.fixture(scope="module")
def quiet(newyork):
    """New York where nobody else comes: who is on the pads now leaves, and that is all."""
    return replace(newyork, load=PadLoad.none(len(newyork.network), newyork.timezone))


@pytest.fixture(scope="module")
def small(quiet):
    return Problem(quiet, ask(), quiet.drone("m200"), CALM)


def ask(busy=None, **changes):
    state = State(DEPART, "bellevue", busy_pads={} if busy is None else {"jacobi": busy})
    return Request(state=state, destination="jacobi", payload_kg=0.8, drone="m200", **changes)


@pytest.mark.parametrize("planner", ["exact", "ies"])
def test_who_is_told_the_queues_arrives_when_there_is_a_place_to_land(quiet, planner):
    request = ask(busy=40)
    result = plan(quiet, request, planner=planner, forecast=CALM, time_limit_s=20.0)
    queue = result.problem.queue_paths([result.problem.destination], 0)[result.problem.destination]
    arrival = result.composition.arrive.timestamp()
    assert arrival >= float(queue.land_s[0]) - 1e-3  # nobody comes after us, so that is when 32 of the 40 are gone
    assert arrival == pytest.approx(
        float(queue.land_s[0]), abs=1.0
    )  # and no later: nothing keeps it once there is a place
    assert result.composition.min_soc >= request.reserve_soc - 1e-9
    assert result.outcome.p_success == 1.0


@pytest.mark.parametrize("busy", [0, 8, 9, 12, 25])
def test_exact_and_ies_claim_the_arrival_that_their_answer_is_flown_to(newyork, busy):
    problem = Problem(newyork, ask(busy=busy), newyork.drone("m200"), CALM)
    queues = problem.queue_paths(range(len(problem.network)), 3)
    exact = ExactSearch(problem, queues)
    itinerary = exact.solve()
    flown = fly_true(problem, itinerary, queues)[0]
    assert flown[-1, TOUCH_DOWN] == pytest.approx(exact.best_s, abs=1e-3)
    assert (flown[:, SOC_LANDING] >= problem.reserve - 1e-9).all()
    all_of_them = ExhaustiveSearch(problem, queues, time_limit_s=2.0)
    all_of_them.solve()
    assert all_of_them.best_s >= exact.best_s - 1e-3
    if all_of_them.complete:
        assert all_of_them.best_s == pytest.approx(exact.best_s, abs=1e-3)


def test_a_drone_hovers_at_the_destination_until_a_place_is_free_and_pays_for_it(quiet):
    problem = Problem(quiet, ask(busy=20), quiet.drone("m200"), CALM)
    free = Problem(quiet, ask(busy=0), quiet.drone("m200"), CALM)
    itinerary = plan(quiet, ask(), planner="pfs", forecast=CALM).itinerary
    hovering, _ = fly_sampled(problem, itinerary)
    landing, _ = fly_sampled(free, itinerary)
    later = hovering[:, -1, TOUCH_DOWN] - landing[:, -1, TOUCH_DOWN]
    less = landing[:, -1, SOC_LANDING] - hovering[:, -1, SOC_LANDING]
    assert later.max() > 60.0
    assert np.allclose(less, later * problem.soc_per_s)


def test_robust_waits_on_the_ground_for_a_destination_that_is_full(quiet):
    free = plan(quiet, ask(busy=0), forecast=CALM)
    full = plan(quiet, ask(busy=40), forecast=CALM)
    assert full.outcome.mean_s > free.outcome.mean_s + 3600.0
    assert full.outcome.p_success > 0.99  # it does not hover for hours: it takes off when there will be a place
    assert full.composition.arrive.timestamp() > free.composition.arrive.timestamp() + 3600.0


@pytest.mark.parametrize("planner", ["pfs", "pfs-charge-aware", "shortest"])
def test_planners_that_do_not_look_at_the_pads_fly_to_a_full_station_in_vain(quiet, planner):
    with pytest.raises(NoRouteError, match="runs out of charge, hovering"):
        plan(quiet, ask(busy=40), planner=planner, forecast=CALM)
    some = plan(quiet, ask(busy=14), planner=planner, forecast=CALM)
    free = plan(quiet, ask(busy=0), planner=planner, forecast=CALM)
    assert some.outcome.mean_s > free.outcome.mean_s + 10.0
    assert some.outcome.p_success <= free.outcome.p_success


def test_few_drones_at_the_destination_change_nothing(quiet):
    free, some = (plan(quiet, ask(busy=busy), planner="exact", forecast=CALM) for busy in (0, 3))
    assert some.composition.arrive == free.composition.arrive


@pytest.mark.parametrize("planner", ["robust", "pfs"])
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_no_planner_answers_with_a_course_that_runs_empty(planner, seed):
    """Where more drones come than the pads can serve, whoever flies there hovers until it is empty."""
    rng = np.random.default_rng(seed)
    world = make_world(rng, 3, length_m=12_000.0, utilisation=1.3)
    stations = tuple(replace(one, pads=1, holding_spots=0) for one in world.network.stations)
    crowded = replace(world, network=replace(world.network, stations=stations))
    request = make_request(crowded, rng, reserve_soc=0.0)
    with pytest.raises(NoRouteError, match="typically runs out of charge, hovering") as refused:
        plan(crowded, request, planner=planner, forecast=make_wind(rng, members=3))
    assert refused.value.constraint == "energy"


def room_from(problem, hours):
    """The queues of a problem, with a destination at which nobody lands in the first hours."""
    queues = problem.queue_paths(range(len(problem.network)), 0)
    opens = np.array([problem.depart_s + 3600.0 * hours])
    return queues | {problem.destination: QueuePath(np.empty(0), opens, opens)}


def test_a_search_does_not_look_at_hours_in_which_nothing_can_land(quiet):
    """Without room for longer than anybody can hover it has to wait on its way: no deadline before that is tried."""
    labels = {}
    for hours in (0, 9):
        problem = Problem(quiet, ask(), quiet.drone("m200"), CALM)
        search = ExactSearch(problem, room_from(problem, hours))
        itinerary = search.solve()
        labels[hours] = search.labels_expanded
        assert search.complete
        assert search.best_s >= problem.depart_s + 3600.0 * hours
        flown = fly_true(problem, itinerary, search.queues)[0]
        assert flown[-1, TOUCH_DOWN] == pytest.approx(search.best_s, abs=1e-3)
        assert (flown[:, SOC_LANDING] >= problem.reserve - 1e-9).all()
        if hours:
            assert search.best_s == pytest.approx(problem.depart_s + 3600.0 * hours, abs=1e-3)
    assert labels[9] <= 2 * labels[0] + 20


def test_a_destination_without_room_within_the_forecast_is_named_at_once(quiet):
    problem = Problem(quiet, ask(busy=40), quiet.drone("m200"), CALM)
    search = ExactSearch(problem, room_from(problem, 60))
    with pytest.raises(NoRouteError, match="neither a pad nor a holding spot free at jacobi") as refused:
        search.solve()
    assert refused.value.constraint == "room"
    assert search.labels_expanded == 0


@settings(max_examples=60)
@given(
    others=st.lists(st.tuples(st.floats(0.0, 5e4), st.floats(0.0, 3e4)), max_size=8),
    first=st.floats(0.0, 3e4),
    by=st.floats(-10.0, 1e5),
    arrival=st.floats(0.0, 1e5),
)
def test_the_latest_arrival_is_the_inverse_of_the_landing(others, first, by, arrival):
    came = np.sort([one for one, _ in others])
    lands = np.maximum.accumulate([first, *(one for _, one in others)])
    queue = QueuePath(came, lands, lands)
    latest = queue.latest_arrival(by)
    assert latest <= by
    if arrival < latest:
        assert float(queue.land_time(arrival)) <= by
    if arrival > latest:
        assert float(queue.land_time(arrival)) > by


@settings(max_examples=60)
@given(
    others=st.lists(st.tuples(st.floats(-1e4, 5e4), st.floats(0.0, 3e4)), max_size=8),
    first=st.floats(0.0, 3e4),
    after=st.floats(0.0, 6e4),
)
def test_the_charge_to_come_with_is_the_reserve_and_the_hovering(small, others, first, after):
    problem = small
    came = problem.depart_s + np.sort([one for one, _ in others])
    lands = problem.depart_s + np.maximum.accumulate([first, *(one for _, one in others)])
    queue = QueuePath(came, lands, lands)
    points = needed_to_land(problem, TrueSpeeds(problem.air), {problem.destination: queue}, 0.0, problem.depart_s + 8e4)
    at = problem.depart_s + after
    if np.abs(np.append(came, lands) - at).min() < 1.0:
        return  # a jump
    hover_s = float(queue.land_time(at)) - at
    needed = float(np.interp(at, points[:, 0], points[:, 1]))
    assert needed == pytest.approx(problem.reserve + problem.soc_per_s * hover_s, rel=1e-9, abs=1e-9)
