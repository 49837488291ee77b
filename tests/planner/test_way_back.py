"""The way back: planned with the way out, so that the drone never stands in the street without the charge to leave."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
from worlds import DEPART, make_wind, make_world

from skyway.models.base.errors import InputError, NoRouteError
from skyway.models.composition.composition import State
from skyway.models.composition.file import from_json, to_json
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

DEGREE_M = 111_200.0
AIRSPEED_MPS = min(M200_V2.max_airspeed_mps, M200_V2.max_ground_speed_mps)


def line(*kilometres, pads=(), target=None, reach_km=12.0):
    """Stations a, b, c… along a meridian; the target, named by its letter, has no pads."""
    placed = []
    for number, away in enumerate(kilometres):
        name = chr(ord("a") + number)
        own = 0 if name == target else (dict(pads).get(name, 2))
        placed.append(Station(name, name.upper(), 50.0 + 1000.0 * away / DEGREE_M, 8.0, 30.0, own, own))
    network = build_network(placed, ConnectionRule("max-length", 1000.0 * reach_km))
    load = PadLoad(np.zeros((len(placed), 168)), np.full((len(placed), 168), 3600.0), "UTC")
    return Scenario("line", network, (M200_V2,), FlightRules(), load)


def calm(scenario, speed=0.0, from_deg=0.0):
    station = scenario.network.stations[0]
    return constant_wind(speed, from_deg, DEPART, 48, station.lat, station.lon, 60.0)


def ask(destination, start="a", **changes):
    values = {"state": State(DEPART, start), "destination": destination, "payload_kg": 1.0, "drone": M200_V2.id}
    return Request(**(values | changes))


@pytest.mark.parametrize("planner", ["exact", "robust", "pfs-charge-aware"])
def test_from_a_target_without_pads_the_drone_goes_on_to_the_nearest_pad(planner):
    scenario = line(0.0, 9.0, 15.0, target="b")
    c = plan(scenario, ask("b", dwell_s=300.0), planner=planner, forecast=calm(scenario)).composition
    back = c.way_back
    assert (back.station, back.asked) == ("c", "nearest-pad")
    assert back.plan.payload_kg == 0.0
    assert back.plan.services[0].depart == c.arrive + timedelta(seconds=300.0)
    assert back.plan.services[0].soc_depart == pytest.approx(c.services[-1].soc_arrive)
    assert back.plan.min_soc >= 0.2
    # The flight that was begun with the package takes more energy a metre than the one without it.
    out, on = c.services[-1], back.plan.services[0]
    assert on.energy_j / on.distance_m < out.energy_j / out.distance_m
    of_way_out = [note for note in c.notes if "of the way out alone" in note]
    assert bool(of_way_out) is (planner == "pfs-charge-aware")


@pytest.mark.parametrize("target", ["b", ""])
@pytest.mark.parametrize("planner", ["exact", "robust"])
def test_where_the_package_is_released_in_the_air_the_drone_flies_on_with_charge_for_the_hover_and_the_package(
    planner, target
):
    scenario = line(0.0, 9.0, 15.0, target=target)
    forecast = calm(scenario)
    landed = plan(scenario, ask("b", undelivered_to="back"), planner=planner, forecast=forecast).composition
    c = plan(scenario, ask("b", release="winch"), planner=planner, forecast=forecast).composition
    back = c.way_back
    assert (back.release, back.dwell_s, back.station) == ("winch", 52.0, "c")
    out, on = c.services[-1], back.plan.services[0]
    assert on.depart == c.arrive + timedelta(seconds=52.0)
    hover_soc = out.soc_arrive - on.soc_depart
    assert hover_soc == pytest.approx(52.0 * (out.soc_depart - out.soc_arrive) / out.flight_time_s, rel=0.15)
    assert landed.way_back.release == "gripper"
    assert from_json(json.dumps(to_json(c))).way_back.release == "winch"
    with pytest.raises(InputError, match="does not land"):
        ask("b", release="winch", dwell_s=60.0)
    with pytest.raises(InputError, match="does not land"):
        plan(scenario, ask("b", release="place", return_to="none"), planner=planner, forecast=forecast)


def test_a_hover_counts_where_no_battery_is_enough():
    forecast = calm(line(0.0, 9.0, target="b", reach_km=17.0))
    farthest = {}
    for release in ("gripper", "winch"):
        near, far = 6.0, 17.0
        while far - near > 0.1:
            middle = 0.5 * (near + far)
            near, far = (middle, far) if _there(middle, release, forecast) else (near, middle)
        farthest[release] = near
    assert 6.5 < farthest["winch"] < farthest["gripper"] - 0.3


def _there(away_km, release, forecast):
    scenario = line(0.0, away_km, target="b", reach_km=17.0)
    try:
        plan(scenario, ask("b", release=release), planner="exact", forecast=forecast)
    except NoRouteError:
        return False
    return True


@pytest.mark.parametrize("planner", ["exact", "robust"])
def test_a_target_with_pads_keeps_its_plan_and_the_drone_stays(planner):
    scenario = line(0.0, 9.0, 17.0)
    c = plan(scenario, ask("c"), planner=planner, forecast=calm(scenario)).composition
    assert c.way_back.plan is None
    assert c.way_back.station == "c"
    home = plan(scenario, ask("c", return_to="home"), planner=planner, forecast=calm(scenario)).composition
    assert home.services == c.services
    assert home.way_back.plan.services[-1].destination == "a"
    assert home.way_back.plan.payload_kg == 0.0
    assert home.way_back.plan.services[0].depart >= home.arrive


@pytest.mark.parametrize("planner", ["exact", "robust"])
def test_the_charge_for_the_way_back_is_taken_on_before_the_last_leg(planner):
    scenario = line(0.0, 10.0, 20.0, target="c", reach_km=10.5)
    forecast = calm(scenario)
    bare = plan(scenario, ask("c", escape=False), planner=planner, forecast=forecast).composition
    back = plan(scenario, ask("c"), planner=planner, forecast=forecast).composition
    assert [one.destination for one in back.services] == ["b", "c"]
    assert back.services[-1].soc_arrive > bare.services[-1].soc_arrive + 0.05
    assert back.way_back.station == "b"
    assert back.way_back.plan.services[-1].soc_arrive >= 0.2
    home = plan(scenario, ask("c", return_to="home"), planner=planner, forecast=forecast).composition
    assert [one.destination for one in home.way_back.plan.services] == ["b", "a"]


def test_the_way_back_with_the_package_needs_more():
    scenario = line(0.0, 10.0, 20.0, target="c", reach_km=10.5)
    forecast = calm(scenario)
    empty = plan(scenario, ask("c"), planner="exact", forecast=forecast).composition
    kept = plan(scenario, ask("c", undelivered_to="back"), planner="exact", forecast=forecast).composition
    assert kept.services[-1].soc_arrive > empty.services[-1].soc_arrive + 0.02
    carried = kept.way_back.undelivered
    assert carried.payload_kg == 1.0
    assert [one.destination for one in carried.services] == ["b", "a"]
    assert carried.min_soc >= 0.2 - 1e-9


def test_a_pad_that_leads_nowhere_is_not_the_nearest_useful_one():
    # d is 3 km beyond the target, but from there nothing is in reach of a battery; a is 12 km back
    scenario = line(0.0, 12.0, 15.0, target="b", reach_km=16.0)
    network = scenario.network
    keep = ~((network.tail == 2) | ((network.tail == 0) & (network.head == 2)))
    cut = replace(
        network, tail=network.tail[keep], head=network.head[keep], distance_m=network.distance_m[keep],
        bearing_deg=network.bearing_deg[keep], restricted=network.restricted[:0],
    )  # fmt: skip
    scenario = replace(scenario, network=cut)
    forecast = calm(scenario)
    found = plan(scenario, ask("b", payload_kg=0.2), planner="exact", forecast=forecast).composition
    assert found.way_back.station == "a"


@pytest.mark.parametrize("planner", ["exact", "robust", "pfs-charge-aware"])
def test_a_target_from_which_nothing_is_in_reach_is_refused_with_by_how_much(planner):
    scenario = line(0.0, 16.0, target="b", reach_km=17.0)
    forecast = calm(scenario)
    with pytest.raises(NoRouteError, match=r"b.*no pads.*% missing") as caught:
        plan(scenario, ask("b"), planner=planner, forecast=forecast)
    assert caught.value.constraint == "energy"
    plan(scenario, ask("b", escape=False), planner=planner, forecast=forecast)  # there alone it would get


def test_a_refusal_says_in_which_wind_the_flight_there_and_the_flight_on_were_reckoned():
    scenario = line(0.0, 12.0, target="b", reach_km=17.0)
    told = r"takes \d+ % of the battery of m200-v2 in the best forecast wind.*the flight on from b.*more in an unfavourable wind"
    with pytest.raises(NoRouteError, match=told):
        plan(scenario, ask("b"), planner="robust", forecast=calm(scenario))


def test_what_cannot_be_asked_for_is_refused():
    scenario = line(0.0, 9.0, 15.0, target="b")
    wrong = {
        "has no pads": {"return_to": "none"},
        "is the target, which has no pads": {"return_to": "b"},
        "no such station": {"return_to": "z"},
        "dwell_s": {"dwell_s": -1.0},
        "undelivered_to": {"undelivered_to": "nowhere"},
    }
    for words, changes in wrong.items():
        with pytest.raises(InputError, match=words):
            plan(scenario, ask("b", **changes), planner="exact", forecast=calm(scenario))


@pytest.mark.parametrize("asked", [{"return_to": "home"}, {"undelivered_to": "back"}])
def test_a_drone_in_the_air_does_not_tell_where_it_began(asked):
    scenario = line(0.0, 9.0, 15.0, target="b")
    a = scenario.network.stations[0]
    request = replace(ask("b", **asked), state=State(ask("b").state.time, None, (a.lat, a.lon + 0.01), 0.9))
    with pytest.raises(InputError, match=f"{next(iter(asked))}: is unknown: the drone is in the air") as caught:
        plan(scenario, request, planner="exact", forecast=calm(scenario))
    assert "name of a station" in str(caught.value)


def test_a_plan_with_a_way_back_survives_its_file():
    scenario = line(0.0, 9.0, 15.0, target="b")
    c = plan(scenario, ask("b", undelivered_to="c"), planner="exact", forecast=calm(scenario)).composition
    document = to_json(c)
    assert to_json(from_json(json.dumps(document))) == document
    assert document["return"]["to"] == "c"
    for damage, words in (
        ({"to": "a"}, "is not where the way back ends"),
        ({"plan": document["return"]["undelivered"] | {"from": "a"}}, "does not start where the delivery ends"),
    ):
        broken = document | {"return": document["return"] | damage}
        with pytest.raises(InputError, match=words):
            from_json(json.dumps(broken))


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(one, marks=pytest.mark.slow) for one in range(10, 40))])
def test_simulated_in_steps_of_our_own_the_way_back_keeps_the_reserve(seed):
    """The way back of an exact plan, flown second by second by the published endurances, lands where and as it says."""
    rng = np.random.default_rng((seed, 93))
    scenario = make_world(rng, 6, utilisation=0.0, target=True)
    wind = make_wind(rng, mean_mps=6.0)
    request = Request(
        state=State(DEPART, "s0", None, 1.0), destination=scenario.network.stations[-1].id, payload_kg=1.0, drone=M200_V2.id,
        dwell_s=float(rng.choice([0.0, 900.0])), return_to=str(rng.choice(["home", "nearest-pad"])),
    )  # fmt: skip
    try:
        c = plan(scenario, request, planner="exact", forecast=wind).composition
    except NoRouteError:
        return
    first = c.way_back.plan.services[0]
    assert first.depart >= c.arrive + timedelta(seconds=request.dwell_s)
    landed_s, soc = stepped(scenario, wind, first, c.services[-1].soc_arrive)
    assert landed_s == pytest.approx(first.arrive.timestamp(), abs=1.0)
    assert soc == pytest.approx(first.soc_arrive, abs=1e-3)
    assert soc >= 0.2 - 1e-3
    assert c.way_back.plan.min_soc >= 0.2 - 1e-9


def stepped(scenario, wind, service, soc, step_s=0.25):
    """Landing and charge of a planned flight without a package in the wind of each moment."""
    names = [service.origin, *service.via, service.destination]
    return steps(scenario, wind, 0, names, service.depart.timestamp(), soc, step_s)


def steps(scenario, wind, member, names, off_s, soc, step_s):
    """The same of a flight over stations in one member."""
    network, rules = scenario.network, scenario.rules
    climb_s, descent_s = rules.cruise_height_m / rules.climb_rate_mps, rules.cruise_height_m / rules.descent_rate_mps
    now = off_s + climb_s
    for a, b in pairwise(names):
        segment = next(
            k for k in range(network.first[network.index[a]], network.first[network.index[a] + 1])
            if network.head[k] == network.index[b]
        )  # fmt: skip
        left, course = network.distance_m[segment], np.radians(network.bearing_deg[segment])
        while left > 0.0:
            slot = min(int((now - wind.start_s) // wind.slot_s), wind.north.shape[1] - 1)
            factor = (rules.cruise_height_m / wind.height_m) ** rules.wind_profile_exponent
            north, east = factor * wind.north[member, slot, 0], factor * wind.east[member, slot, 0]
            along = north * np.cos(course) + east * np.sin(course)
            across = -north * np.sin(course) + east * np.cos(course)
            speed = min(along + np.sqrt(AIRSPEED_MPS**2 - across**2), M200_V2.max_ground_speed_mps)
            part = min(step_s, left / speed)
            now, left = now + part, left - speed * part
    now += descent_s
    return now, soc - (now - off_s) / M200_V2.endurance_empty_s


def test_the_robust_promise_counts_the_way_on():
    """In changeable winds the promise is of both: the landings of the delivery and that of the flight on."""
    rng = np.random.default_rng(5)
    scenario = line(0.0, 10.0, 20.0, target="c", reach_km=10.5)
    wind = make_wind(rng, members=12, mean_mps=2.5)
    result = plan(scenario, ask("c"), planner="robust", forecast=wind)
    assert result.outcome.p_onward is not None
    assert result.outcome.p_onward >= 0.99
    assert result.outcome.p_success <= result.outcome.p_onward + 1e-12
    landing = result.robust.policy.landing
    assert landing[-1] > landing[0] + 0.1
    # Flown on from each simulated delivery in steps of our own, by a vehicle that uses what the model says.
    runs = result.robust.out_of_sample
    flown = np.flatnonzero(np.isfinite(runs.schedule[:, -1, TOUCH_DOWN]))[::25].tolist()
    thinned, kept = result.problem.ensemble, 0
    for run in flown:
        down = float(runs.schedule[run, -1, TOUCH_DOWN])
        soc = float(runs.schedule[run, -1, SOC_LANDING])
        left = steps(scenario, thinned, int(runs.member[run]), ["c", "b"], down, soc, 1.0)[1]
        assert left == pytest.approx(
            runs.onward_soc[run], abs=0.12
        )  # gusts, the vehicle's own use, and the slot in which it leaves
        kept += left >= 0.2
    assert kept == len(flown) > 20


def test_when_it_was_planned_is_the_hour_of_the_way_back():
    """With a storm on the way back only, the drone waits at the target, and the plan says so."""
    scenario = line(0.0, 9.0, 15.0, target="b")
    still = calm(scenario)
    north = still.north.copy()
    north[:, 1, :] = -20.0  # the second hour
    wind = replace(still, north=north)
    begin = datetime.fromtimestamp(still.start_s, UTC)
    request = ask("b", dwell_s=1800.0)
    c = plan(scenario, request, planner="exact", forecast=wind).composition
    off = c.way_back.plan.services[0].depart
    assert off >= begin + timedelta(hours=2) - timedelta(seconds=1) or off < begin + timedelta(hours=1)
