"""Deliveries that are not to arrive early: the drone waits on the ground."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.composition.composition import State
from skyway.models.composition.file import load, save
from skyway.planner.plan import plan
from skyway.planner.problem.problem import Problem
from skyway.planner.robust.robust import RobustSearch
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TAKE_OFF, TOUCH_DOWN
from tests.planner.worlds import DEPART, make_request, make_wind, make_world

EARLIEST = DEPART + timedelta(hours=6)


def world(number=3, *, target=True):
    rng = np.random.default_rng((0x40, number))
    scenario = make_world(rng, 5, utilisation=0.3, target=target)
    wind = make_wind(rng, members=4, mean_mps=2.0)
    request = make_request(scenario, rng, payload_kg=0.5, escape=False, state=State(DEPART, "s0", None, 0.9))
    return scenario, request, wind


@pytest.mark.parametrize("target", [True, False])
def test_no_simulated_delivery_is_early_and_none_hovers(target):
    """It leaves its last stop as late as the fastest flight asks, and lands when the flight is over."""
    scenario, request, wind = world(target=target)
    free = plan(scenario, request, forecast=wind)
    held = plan(scenario, replace(request, not_before=EARLIEST), forecast=wind)
    runs, p = held.robust.out_of_sample.schedule, held.problem
    arrival = runs[:, -1, TOUCH_DOWN]
    assert free.outcome.quantile_s(0.9) < EARLIEST.timestamp()
    assert np.isfinite(arrival).mean() > 0.95
    assert arrival.min() >= EARLIEST.timestamp() - 1e-6
    assert held.outcome.quantile_s(0.5) - EARLIEST.timestamp() < 1800.0
    arrives = np.isfinite(arrival)
    flight_s = arrival[arrives] - runs[arrives, -1, TAKE_OFF]
    fastest_s = p.fastest_s(held.itinerary[-1].segments)
    assert flight_s.min() >= fastest_s - 1e-6
    early = runs[:, -1, TAKE_OFF] < EARLIEST.timestamp() - fastest_s - 1e-6
    assert not early.any(), "hovers"
    assert (runs[np.isfinite(arrival), -1, SOC_LANDING] >= 0.0).all()
    assert any("does not arrive before" in note for note in held.composition.notes)
    assert held.outcome.p_hold_room[-1] < 0.5, "waiting for the time is not waiting for capacity"


def test_a_past_time_changes_nothing():
    """Earlier than any arrival it is no wish at all."""
    scenario, request, wind = world()
    free = plan(scenario, request, forecast=wind)
    held = plan(scenario, replace(request, not_before=DEPART), forecast=wind)
    assert held.outcome.mean_s == free.outcome.mean_s
    assert [leg.segments for leg in held.itinerary] == [leg.segments for leg in free.itinerary]


def test_it_may_wait_at_the_origin():
    """Routes are tried with the wait at their origin, too, and such a plan keeps the time as well."""
    scenario, request, wind = world()
    request = replace(request, not_before=EARLIEST + timedelta(hours=3))
    search = RobustSearch(Problem(scenario, request, scenario.drones[0], wind))
    answer = search.solve()
    moved = [one for one in answer.candidates if one.policy.first_s > DEPART.timestamp()]
    assert moved
    for one in moved:
        runs = one.out_of_sample.schedule
        assert runs[:, 0, TAKE_OFF].min() >= one.policy.first_s - 1e-6
        assert runs[:, -1, TOUCH_DOWN].min() >= request.not_before.timestamp() - 1e-6
    assert answer.candidates[0].order() == min(one.order() for one in answer.candidates)


@pytest.mark.parametrize("planner", ["pfs", "shortest"])
def test_others_wait_before_their_last_flight(planner):
    """Planners with a fixed itinerary."""
    scenario, request, wind = world()
    found = plan(scenario, replace(request, not_before=EARLIEST), planner=planner, forecast=wind)
    assert found.outcome.arrival_s.min() >= EARLIEST.timestamp() - 1e-6


def test_what_is_refused():
    """No offset, too late, after the deadline, with perfect information."""
    scenario, request, wind = world()
    for wrong in (datetime(2026, 6, 1, 12), DEPART + timedelta(days=3)):  # noqa: DTZ001
        with pytest.raises(InputError, match="not_before"):
            replace(request, not_before=wrong)
    with pytest.raises(InputError, match="deadline"):
        replace(
            request,
            not_before=EARLIEST,
            objective=f"on-time {DEPART.astimezone(UTC) + timedelta(hours=1):%Y-%m-%dT%H:%M+00:00}",
        )
    one = replace(wind, north=wind.north[:1], east=wind.east[:1], probability=np.ones(1), labels=wind.labels[:1])
    with pytest.raises(InputError, match="cannot wait"):
        plan(scenario, replace(request, not_before=EARLIEST), planner="exact", forecast=wind, truth=one)


def test_a_plan_file_keeps_the_time_and_a_flight_waits_for_it(tmp_path):
    """Written, read, and asked again on the ground: the last leg is not begun."""
    scenario, request, wind = world(target=False)
    held = plan(scenario, replace(request, not_before=EARLIEST), forecast=wind)
    save(held.composition, tmp_path / "plan.json")
    assert load(tmp_path / "plan.json").not_before == EARLIEST
    p = held.problem
    node = p.network.index[p.request.destination]
    barred = p.no_landing(node)
    assert barred is not None
    assert float(barred.put_off(np.array(DEPART.timestamp()), np.array(DEPART.timestamp()))) == EARLIEST.timestamp()
