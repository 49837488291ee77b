"""What a plan says can be checked by hand: legs, stops, charge and times fit together."""

import itertools
import math
import re
from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pytest
from one_leg import wind_triangle
from worlds import DEPART, make_request, make_wind, make_world, on_level_ground

from skyway.models.base.errors import InputError, NoRouteError, PayloadError
from skyway.models.composition.composition import State
from skyway.models.composition.file import from_json, to_json
from skyway.models.drones.drone import M200_V2
from skyway.models.wind.forecast import constant_wind
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import compare, plan
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.planner.registry import FORECAST_PLANNERS, PLANNERS, ROBUST
from skyway.planner.robust.robust import RobustSearch

AFTERNOON = datetime(2013, 7, 10, 18, tzinfo=UTC)


def ask(start, to, **changes):
    values = {"state": State(AFTERNOON, start), "destination": to, "payload_kg": 0.8, "drone": "m200"}
    return Request(**(values | changes))


@pytest.fixture(scope="module")
def steady(newyork):
    """8 m/s from the west over New York, at cruise height."""
    return constant_wind(8.0, 270.0, AFTERNOON, HORIZON_H, 40.75, -73.95, 60.0)


@pytest.mark.parametrize("planner", ["shortest", "pfs", "pfs-charge-aware", "ies"])
def test_legs_and_stops_follow_each_other_and_add_up(newyork, steady, planner):
    c = plan(newyork, ask("siuh-north", "white-plains"), planner=planner, forecast=steady, time_limit_s=20).composition
    stops = {stop.station: stop for stop in c.stops}
    assert c.services[0].origin == "siuh-north"
    assert c.services[-1].destination == "white-plains"
    for before, after in itertools.pairwise(c.services):
        assert before.destination == after.origin
        stop = stops[after.origin]
        assert stop.arrive == before.arrive
        assert stop.leave == after.depart
        assert stop.soc_from == pytest.approx(before.soc_arrive)
        assert stop.soc_to == pytest.approx(after.soc_depart)
    total = (c.arrive - c.depart).total_seconds()
    assert c.delivery_time_s == pytest.approx(total, abs=0.5)
    assert to_json(c)["delivery_time_s"] == pytest.approx(total, abs=0.5)


def test_each_leg_obeys_the_wind_triangle_and_the_battery(newyork, steady):
    c = plan(
        on_level_ground(newyork), ask("siuh-north", "white-plains", airspeed_mps=12.0), planner="pfs-charge-aware",
        forecast=steady,
    ).composition  # fmt: skip
    drone = newyork.drone("m200")
    power = (
        drone.battery_j / drone.endurance_empty_s * ((drone.mass_kg + 0.8) / drone.mass_kg) ** drone.energy_model.kappa
    )
    for leg in c.services:
        if leg.via:
            continue
        expected = wind_triangle(12.0, 8.0, 270.0, leg.bearing_deg, max_ground_speed_mps=20.0)
        assert leg.ground_speed_mps == pytest.approx(expected.ground_speed_mps, rel=1e-6)
        assert leg.tailwind_mps == pytest.approx(expected.tailwind_mps, abs=1e-6)
        assert leg.flight_time_s == pytest.approx(12.0 + leg.distance_m / leg.ground_speed_mps + 20.0, abs=0.01)
        assert leg.energy_j == pytest.approx(power * leg.flight_time_s, rel=1e-4)
        assert leg.soc_arrive == pytest.approx(leg.soc_depart - leg.energy_j / drone.battery_j, abs=1e-9)
        assert leg.soc_arrive >= 0.2 - 1e-6
        assert leg.p_reserve > 0.2  # charged for the wind given, without a margin for gusts and the vehicle
        assert leg.wind.speed_mps == pytest.approx(8.0)
        assert leg.wind.from_deg == pytest.approx(270.0)
    for stop in c.stops:
        curve = drone.charging_curve()
        assert stop.recharge_s == pytest.approx(float(curve.duration_s(stop.soc_from, stop.soc_to)), abs=3.0)


@pytest.mark.parametrize("planner", sorted({ROBUST, *FORECAST_PLANNERS} - {"pfs-strict"}))
def test_the_forecast_leaves_out_what_really_happened(newyork, planner):
    forecast = newyork.forecast(AFTERNOON, HORIZON_H, truth=date(2013, 7, 20))
    assert not {"2013-07-09", "2013-07-10", "2013-07-11", "2013-07-20", "2013-07-21"} & set(forecast.labels)
    result = plan(newyork, ask("siuh-north", "yonkers"), planner=planner, forecast=forecast)
    a = result.composition.arrival
    assert a.p50 <= a.p95
    assert result.composition.depart < a.mean


def test_clairvoyant_planning_is_never_slower_than_planning_by_forecast_flown_in_the_same_wind(newyork, steady):
    answers = compare(
        newyork, ask("siuh-north", "montefiore"), ["ies", "pfs-charge-aware", "shortest"], forecast=steady
    )
    by_name = {answer.planner: answer.result for answer in answers}
    # The true queue is one sample, the forecast planners see the mean wait: compare without any waiting.
    busy = [r.composition.delivery_time_s - r.composition.wait_time_s for r in by_name.values()]
    assert busy[0] <= min(busy[1:]) + 1.0


def test_a_plan_survives_its_file(newyork, steady):
    import json

    c = plan(newyork, ask("siuh-north", "white-plains"), planner="pfs-charge-aware", forecast=steady).composition
    assert from_json(json.dumps(to_json(c))) == c


def test_the_drone_that_arrives_first_is_chosen_and_the_others_say_why_not(newyork, steady):
    result = plan(newyork, ask("siuh-north", "white-plains", drone=None), planner="pfs-charge-aware", forecast=steady)
    assert set(result.rejected) | {result.composition.drone} == {d.id for d in newyork.drones}
    for drone in result.rejected:
        try:
            other = plan(
                newyork, ask("siuh-north", "white-plains", drone=drone), planner="pfs-charge-aware", forecast=steady
            )
        except NoRouteError:
            continue
        assert other.outcome.mean_s >= result.outcome.mean_s


@pytest.mark.parametrize(
    ("start", "to", "depart", "payload_kg"),
    [
        ("glen-cove", "kings-county", datetime(2013, 12, 4, 8, 8, tzinfo=UTC), 0.8),
        ("edison", "st-johns-episcopal", datetime(2013, 4, 15, 4, 23, tzinfo=UTC), 1.3),
        ("newark", "new-rochelle", datetime(2013, 2, 12, 22, 24, tzinfo=UTC), 1.4),
    ],
)
def test_no_drone_of_the_fleet_would_be_expected_clearly_earlier(newyork, start, to, depart, payload_kg):
    """Their first routes, before any comparison, suggest another drone: with it the delivery takes three times as long."""
    request = Request(state=State(depart, start), destination=to, payload_kg=payload_kg)
    wind = newyork.forecast(depart, HORIZON_H)
    chosen = plan(newyork, request, forecast=wind)
    for drone in newyork.drones:
        if drone.max_payload_kg < payload_kg:
            continue
        alone = plan(newyork, replace(request, drone=drone.id), forecast=wind)
        assert chosen.outcome.mean_s - depart.timestamp() <= 1.1 * (alone.outcome.mean_s - depart.timestamp())


@pytest.mark.parametrize("objective", ["mean", "p95"])
def test_a_drone_that_is_later_even_at_best_is_not_looked_at_and_says_so(newyork, objective, monkeypatch):
    looked_at = set()
    looks = RobustSearch.looks
    monkeypatch.setattr(RobustSearch, "looks", lambda one: iter_of(one, looks, looked_at))
    depart = datetime(2013, 7, 10, 18, tzinfo=UTC)
    request = Request(
        state=State(depart, "siuh-north"), destination="white-plains", payload_kg=0.8, objective=Objective(objective)
    )
    wind = newyork.forecast(depart, HORIZON_H)
    chosen = plan(newyork, request, forecast=wind)
    told = {
        drone: re.match("at least (?:([0-9]+) h )?(?:([0-9]+) min )?later", why)
        for drone, why in chosen.rejected.items()
    }
    hopeless = {
        drone: 3600.0 * int(found[1] or 0) + 60.0 * int(found[2] or 0)
        for drone, found in told.items()
        if found is not None
    }
    assert hopeless
    assert not looked_at & set(hopeless)
    for drone, later_s in hopeless.items():
        alone = plan(newyork, replace(request, drone=drone), forecast=wind)
        assert alone.outcome.mean_s >= chosen.outcome.mean_s + later_s - 30.0


def iter_of(search, looks, looked_at):
    """Look as a search does, and note its drone."""
    looked_at.add(search.problem.drone.id)
    yield from looks(search)


def test_a_delivery_can_start_in_the_air(newyork, steady):
    state = State(AFTERNOON, None, (40.70, -74.00), 0.6)
    request = Request(state=state, destination="montefiore", payload_kg=0.8, drone="m200")
    for planner in ("pfs-charge-aware", "ies"):
        c = plan(newyork, request, planner=planner, forecast=steady, time_limit_s=20).composition
        assert c.services[0].depart == AFTERNOON
        assert c.services[0].soc_depart == 0.6
        first = c.services[0]
        if not first.via:
            assert first.flight_time_s == pytest.approx(first.distance_m / first.ground_speed_mps + 20.0, abs=0.01)


def test_a_target_without_pads_leaves_charge_for_the_way_on(newyork, steady):
    scenario = newyork.with_target(40.99, -73.80)
    target = scenario.network.stations[-1].id
    request = ask("siuh-north", target)
    strict = plan(scenario, request, planner="ies", forecast=steady, time_limit_s=20).composition
    loose = plan(scenario, replace(request, escape=False), planner="ies", forecast=steady, time_limit_s=20).composition
    assert strict.services[-1].soc_arrive > 0.2 + 0.03
    assert loose.delivery_time_s <= strict.delivery_time_s + 1e-3


def test_no_route_names_the_constraint_that_binds(newyork, steady):
    far = newyork.with_target(41.30, -73.20)
    with pytest.raises(NoRouteError, match="no chain of segments joins them") as caught:
        plan(far, ask("siuh-north", far.network.stations[-1].id), planner="pfs", forecast=steady)
    assert caught.value.constraint == "disconnected"
    storm = constant_wind(25.0, 0.0, AFTERNOON, HORIZON_H, 40.75, -73.95, 60.0)
    with pytest.raises(NoRouteError, match="throughout the forecast the wind on") as caught:
        plan(newyork, ask("siuh-north", "montefiore"), planner="pfs", forecast=storm)
    assert caught.value.constraint == "wind"
    with pytest.raises(NoRouteError, match="% of the battery") as caught:
        plan(newyork, ask("siuh-north", "montefiore", reserve_soc=0.8), planner="pfs", forecast=steady)
    assert caught.value.constraint == "energy"
    with pytest.raises(PayloadError, match="no drone lifts 7 kg"):
        plan(newyork, ask("siuh-north", "montefiore", payload_kg=7.0, drone=None), planner="pfs", forecast=steady)


def test_wrong_questions_are_refused(newyork, steady):
    with pytest.raises(InputError, match="no such planner"):
        plan(newyork, ask("siuh-north", "montefiore"), planner="magic", forecast=steady)
    with pytest.raises(InputError, match="the same"):
        plan(newyork, ask("montefiore", "montefiore"), planner="pfs", forecast=steady)
    with pytest.raises(InputError, match="needs perfect information"):
        plan(newyork, ask("siuh-north", "montefiore"), planner="ies")
    for field, value in {"payload_kg": math.nan, "reserve_soc": 1.5, "epsilon": -0.1, "airspeed_mps": 0.0}.items():
        with pytest.raises(InputError, match=field):
            ask("siuh-north", "montefiore", **{field: value})


def test_the_same_seed_gives_the_same_plan_and_every_planner_has_a_name(newyork, steady):
    def times():
        c = plan(newyork, ask("siuh-north", "montefiore", seed=7), planner="pfs").composition
        return [(s.arrive, s.soc_arrive) for s in c.services], c.arrival

    assert times() == times()
    assert set(FORECAST_PLANNERS) < set(PLANNERS)


def test_a_likelier_hold_makes_the_mean_arrival_later():
    rng = np.random.default_rng(3)
    scenario = make_world(rng, 5)
    request = make_request(scenario, rng, state=State(DEPART, "s0"), payload_kg=0.3)
    calm = make_wind(np.random.default_rng(1), members=10, mean_mps=1.0)
    stormy = replace(calm, north=calm.north.copy())
    stormy.north[:5, :3] = -14.0  # half of the members are over the limit for three hours
    quick = plan(scenario, request, planner="pfs", forecast=calm)
    slow = plan(scenario, request, planner="pfs", forecast=stormy)
    assert slow.composition.services[0].p_hold == pytest.approx(0.5)
    assert slow.outcome.mean_s > quick.outcome.mean_s + 1800.0
    assert M200_V2.wind_limit_mps < 14.0


def test_simulations_that_take_longer_than_the_time_limit_are_told():
    rng = np.random.default_rng(7)
    world = make_world(rng, 2, length_m=5000.0)
    thorough = replace(USUAL, robust=replace(USUAL.robust, final_runs=100_000))
    found = plan(world, make_request(world, rng), forecast=make_wind(rng), time_limit_s=0.7, parameters=thorough)
    told = ("longer than the time limit of 0.7 s", "cut off after 0.7 s")
    assert any(words in note for note in found.composition.notes for words in told)
