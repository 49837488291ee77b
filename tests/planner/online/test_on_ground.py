"""Before a take-off: kept plans, charges that fit, waits for wind and room."""

import math
import random
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from bellevue_flights import DEPART, NETWORK, QUICK, SURE, calming, standing, wind

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration
from skyway.models.base.units import from_posix
from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.online.departure_gate import DepartureGate
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.following import Step
from skyway.planner.online.information import Information
from skyway.planner.online.options import Floors, Option
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.online.told_plan import best_charges, itinerary_of, needed_charges, segments_of
from skyway.planner.parameters.online import OnlineParameters
from skyway.planner.parameters.planner import PlannerParameters
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.objective import Objective
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request


def test_a_plan_that_still_fits_is_kept_and_its_figures_are_told(policy, composition):
    known = standing(wind(), plan=composition)
    decision = policy.on_ground(known, tell=True)
    assert decision.action == "continue"
    assert decision.station == composition.services[0].destination
    assert decision.charge_to is None
    assert decision.diverts
    assert "min to the delivery" in decision.reason
    assert decision.figures["needed_soc"] < 1.0
    assert decision.least_soc == decision.figures["needed_soc"], "who has stood a while may still leave with that"
    assert decision.composition.services[0].destination == decision.station
    assert decision.composition.services[-1].destination == "jacobi"


def test_a_low_battery_is_charged_for_the_next_leg_and_no_more_than_that(policy, composition):
    known = standing(wind(), soc=0.3, plan=composition)
    decision = policy.on_ground(known, tell=True)
    assert decision.charge_to is not None
    assert 0.3 < decision.charge_to < 1.0
    service = decision.composition.services[0]
    reach = policy.reach(wind(), SURE.next_flight())
    way = reach.way(service.origin, (), (*service.via, service.destination)[0])  # there it may land
    cost = reach.to_the_end(way, DEPART.timestamp(), climbs=True).soc
    assert float(reach.p_below(decision.charge_to, cost[:, None], 0.2)[0]) <= 0.011


def test_more_energy_needed_means_more_charge(policy, composition):
    little, much = (
        policy.on_ground(standing(wind(), EnergyBelief(factor, 0.02), soc=0.3, plan=composition))
        for factor in (0.9, 1.3)
    )
    assert much.charge_to > little.charge_to + 0.05


def test_room_at_a_full_destination_is_waited_for_while_it_charges_and_its_flight_is_begun_before_a_pad_is_free(policy):
    """A few minutes from a destination with one station full: neither given up nor flown to in vain."""
    station = NETWORK().stations[NETWORK().index["jacobi"]]
    room = station.pads + station.holding_spots
    known = standing(wind(), station="montefiore", soc=0.9)
    least = []
    for others in range(room + 1):
        decision = policy.on_ground(replace(known, busy_pads=known.busy_pads | {"jacobi": others}))
        if "too little free capacity" in decision.reason:
            assert decision.action == "wait"
            assert f", {station.pads} pad" in decision.reason
            assert decision.until_s > known.time_s
            assert decision.charge_to is None or decision.charge_to > 0.9
            least.append(others)
    assert room in least
    assert 0 not in least


def test_wind_above_the_limit_is_waited_for_on_the_ground(policy, composition):
    decision = policy.on_ground(standing(wind(speed=13.5), plan=composition))
    assert decision.action in ("wait", "stop")
    if decision.action == "wait":
        assert "above 12.0 m/s" in decision.reason
        assert decision.until_s > DEPART.timestamp()


def test_a_drone_held_by_the_wind_charges_meanwhile(policy, composition):
    decision = policy.on_ground(standing(calming(2), soc=0.6, plan=composition))
    assert decision.charge_to is not None
    decision = policy.on_ground(standing(calming(2), soc=0.9, plan=composition))
    assert decision.action == "wait"
    assert decision.charge_to > 0.91


def test_a_drone_waits_for_wind_that_falls_in_nine_hours(policy, composition):
    decision = policy.on_ground(standing(calming(9), soc=1.0, plan=composition))
    assert decision.action == "wait"


def test_the_longer_a_storm_the_later_the_arrival_that_is_expected(policy):
    """Also beyond the hours that are looked at: else a drone would rather be stuck than wait."""
    start_s = DEPART.timestamp()
    hours = (2, 10, 20, HORIZON_H)
    arrivals = [policy.hindsight(standing(calming(lasts))).arrival_s("montefiore", start_s, 1.0) for lasts in hours]
    assert arrivals == sorted(set(arrivals))
    for lasts, arrival_s in zip(hours[:-1], arrivals, strict=False):
        assert 0.0 <= arrival_s - (start_s + lasts * 3600.0) < 2.5 * 3600.0


@pytest.mark.parametrize("share", [0.4, 0.55, 0.8, 0.95])
def test_a_leg_that_no_hour_of_the_forecast_opens_for_sure_may_open_where_that_is_more_probable_than_not(policy, share):
    """The wind of that hour tells then: a drone that stopped for good would be left to a person for nothing."""
    strong, weak = wind(10.5, 20.0), wind(2.0, 20.0)
    both = replace(
        strong,
        north=np.concatenate([strong.north, weak.north]),
        east=np.concatenate([strong.east, weak.east]),
        probability=np.array([share, 1.0 - share]),
        labels=("strong", "weak"),
    )
    known = standing(both, soc=0.75, busy_pads={})
    gate = DepartureGate(policy, known, policy.problem(known))
    network = NETWORK()
    over = itinerary_of(policy.problem(known), policy.on_ground(standing(wind()), tell=True).composition)[0].segments
    assert int(network.head[over[-1]]) == network.index["jacobi"]
    step = Step(over, 0.75)
    p_below, later = gate.check(step).p_below, gate.later(step)
    assert later.wait_s is None
    assert policy.parameters.p_begin < p_below < share
    assert later.may_open == (p_below <= policy.parameters.p_hopeless) == (share < 0.6)


def test_a_leg_that_is_closed_is_counted_on_from_when_it_can_be_begun(policy):
    seen = policy.hindsight(standing(wind()))
    segment, careful = seen.choose().segments[0], seen.futures[0].careful
    segments, air = np.array([segment]), seen.problem.air
    before = careful.over(0, 5, segments)
    assert np.all(before > 0.0)
    opens_s = air.start_s + 2.5 * air.slot_s
    seen.close(segment, opens_s)
    assert np.all(careful.over(0, 2, segments) == 0.0)
    assert careful.over(3, 5, segments).tolist() == before[3:].tolist()
    assert careful.over(1, 4, segments)[:, 0].tolist() == [0.0, 0.0, *before[3:5, 0]]
    assert segment not in seen.choose().segments
    seen.close(segment)
    assert np.all(careful.over(0, 5, segments) == 0.0)


def test_the_more_charge_a_leg_begins_with_the_less_probably_it_is_turned(policy, composition):
    known = standing(wind(6.0, 20.0), EnergyBelief(1.0, 0.05, 0.03), soc=0.6, plan=composition)
    seen = policy.hindsight(known)
    gate, step = DepartureGate(policy, known, seen.problem), seen.choose()
    chances = [gate.p_turned(replace(step, charge=0.4 + 0.02 * k)) for k in range(31)]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] > 0.9
    assert chances[-1] < 0.05
    wanted = OnlineParameters().turned_shares
    charges = gate.charges(step)
    assert charges == sorted(charges)
    for share, charge in zip(wanted, charges, strict=False):
        assert gate.p_turned(replace(step, charge=charge)) <= share + 0.01
        assert gate.p_turned(replace(step, charge=charge - 0.01)) > share - 0.01


def test_a_leg_that_may_be_turned_is_not_begun_where_there_is_no_room_to_come_back_to(policy, composition):
    head = wind(8.0, 20.0)
    known = standing(head, EnergyBelief(1.0, 0.06, 0.04), plan=composition)
    decision = policy.on_ground(known)
    assert decision.station is not None
    full = {name: 60 for name in known.busy_pads if name != decision.station}
    crowded = policy.on_ground(replace(known, busy_pads=known.busy_pads | full))
    assert crowded.station != decision.station or crowded.figures["needed_soc"] >= decision.figures["needed_soc"]


def test_charges_of_a_kept_plan_are_what_each_flight_needs(newyork, request_):
    composition = plan(newyork, request_, planner=QUICK, forecast=wind()).composition
    problem = Problem(newyork, request_, newyork.drone("m200"), wind())
    itinerary = itinerary_of(problem, composition)
    assert itinerary is not None
    needed = needed_charges(problem, itinerary, 0.01)
    for need, service in zip(needed, composition.services, strict=True):
        spent = service.soc_depart - service.soc_arrive
        assert need == pytest.approx(0.2 + spent, abs=0.02)
    found = best_charges(problem, itinerary, 0.01)
    assert found.outcome.p_success > 0.99


def test_the_older_a_measured_wind_is_the_more_charge_a_flight_needs(policy, composition):
    step = policy.hindsight(standing(wind(6.0, 20.0), plan=composition)).choose()
    least = []
    for age_s in (math.nan, 0.0, 1800.0, 3600.0, 7200.0):
        known = standing(wind(6.0, 20.0), plan=composition, wind_measured_s=DEPART.timestamp() - age_s)
        least.append(DepartureGate(policy, known, policy.problem(known)).check(step).soc)
    assert least[0] == least[1] < least[2] < least[3] < least[4]


def test_a_small_risk_ahead_is_not_left_for_a_landing_below_the_reserve_elsewhere():
    """A drone turned back to land at 17 % because its own station was full with a chance of one in a hundred."""
    floors = Floors(0.2, 0.1)
    ahead = Option("ahead", 15.0, 0.0, 0.30, 0.0, 0.0, 0.0, 3000.0).with_room(lambda *_: 0.013, 6e-4, floors)
    back = Option("back", 15.0, 0.0, 0.17, 1.0, 0.0, 0.0, 9000.0)
    assert ahead.p_below == pytest.approx(0.013)
    assert ahead.risk < 0.5 * back.risk
    empty = replace(ahead, p_half=0.3, p_empty=0.05)
    assert back.risk < 0.5 * empty.risk  # what saves the drone costs the reserve


def test_a_first_flight_that_cannot_be_begun_is_planned_around(policy, composition):
    heavy = EnergyBelief(1.9, 0.05, 0.05)
    known = standing(wind(6.0, 30.0), heavy, plan=composition)
    decision = policy.on_ground(known, tell=True)
    if decision.action in ("wait", "stop"):
        assert decision.reason
        return
    service = decision.composition.services[0]
    reach = policy.reach(wind(6.0, 30.0), heavy.next_flight())
    way = reach.way(service.origin, service.via, service.destination)
    cost = reach.to_the_end(way, DEPART.timestamp(), climbs=True)
    assert float(reach.p_below(1.0, cost.soc[:, None], 0.2)[0]) <= 0.5
    first = reach.to_the_end(
        reach.way(service.origin, (), (*service.via, service.destination)[0]), DEPART.timestamp(), climbs=True
    )
    assert float(reach.p_below(1.0, first.soc[:, None], 0.2)[0]) <= 0.01


def test_on_the_ground_noise_does_not_change_the_next_station(policy, composition):
    """Decisions follow each other at one stop; the plan in force is that of the last one."""
    changes = 0
    for seed in range(2):
        rng = random.Random(seed)
        current, station = composition, None
        for _ in range(3):
            air = wind(max(3.0 + rng.gauss(0.0, 0.8), 0.0), 230.0 + rng.gauss(0.0, 10.0))
            known = standing(air, EnergyBelief(1.0 + rng.gauss(0.0, 0.02), 0.03), soc=0.9, plan=current)
            decision = policy.on_ground(known, tell=True)
            changes += station is not None and decision.station != station
            current, station = decision.composition or current, decision.station
    assert changes == 0


def test_what_a_flight_took_is_learnt_and_the_next_one_is_not_quite_sure():
    belief = EnergyBelief()
    after = belief.learnt(0.36, 0.30)
    assert belief.mean_ratio < after.mean_ratio < 1.2
    assert after.sd_between < belief.sd_between
    assert after.next_flight().sd_between > after.sd_between
    within = belief.in_flight(0.36, 0.30)
    assert abs(within.mean_ratio - 1.2) < abs(after.mean_ratio - 1.2)
    assert belief.learnt(0.1, 0.0) == belief


def test_a_delivery_that_is_late_is_decided_as_one_without_a_deadline(newyork, request_, policy):
    known = standing(wind(9.0, 30.0))
    now = from_posix(known.time_s)
    on_time = replace(
        request_, state=replace(request_.state, time=now - timedelta(hours=1)), objective=Objective("on-time", now)
    )
    late, usual = (one.on_ground(known) for one in (OnlinePolicy(newyork, on_time), policy))
    assert (late.action, late.reason) == (usual.action, usual.reason)


def test_parameters_say_when_a_plan_is_left(newyork, request_, composition):
    known = standing(wind(9.0, 30.0), plan=composition)
    eager = OnlinePolicy(
        newyork, request_, PlannerParameters(online=OnlineParameters(margin_s=0.0, margin_share=0.0))
    ).on_ground(known)
    calm = OnlinePolicy(newyork, request_, PlannerParameters(online=OnlineParameters(margin_s=1e6))).on_ground(known)
    assert calm.station == composition.services[0].destination
    assert eager.figures["arrival_mean_s"] <= calm.figures["arrival_mean_s"] + 1.0


@pytest.mark.parametrize("wrong", [{"p_begin": 1.5}, {"futures": 0}, {"margin_s": math.nan}])
def test_parameters_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        OnlineParameters(**wrong)


def test_what_is_benchmarked_is_what_the_supervisor_consults(newyork, request_):
    """One object, one information state: the evaluation's adapter and a supervisor say the same of the same."""
    start = Problem(newyork, request_, newyork.drone("m200"), wind())
    evaluated = RollingRobust(start)
    assert type(evaluated.policy) is OnlinePolicy
    assert evaluated.policy.parameters == OnlineParameters()
    info = replace(standing(wind(), newyork.drone("m200").energy_belief), measured=True, watched=False)
    ours = OnlinePolicy(newyork, request_).on_ground(info)
    theirs = evaluated.policy.on_ground(info)
    assert (ours.station, ours.charge_to, ours.departure.segments) == (
        theirs.station, theirs.charge_to, theirs.departure.segments,
    )  # fmt: skip


def test_a_leg_over_which_decisions_follow_is_begun_with_less_than_one_over_which_none_do(newyork, request_):
    policy = OnlinePolicy(newyork, request_)
    info = standing(wind(7.0, 30.0), EnergyBelief(1.0, 0.03, 0.0), soc=0.3)
    network = newyork.network
    begin = network.index["bellevue"]
    ways = range(network.first[begin], network.first[begin + 1])
    required = {}
    for watched in (True, False):
        seen = policy.hindsight(replace(info, watched=watched))
        required[watched] = max(seen.need((one,), info.time_s) for one in ways)
    assert 0.2 < required[True] < required[False] - 0.005


def test_who_waits_for_the_wind_does_not_fly_to_and_fro_meanwhile(policy, newyork):
    """A flight that does not end at the destination must arrive earlier than staying."""
    strong = wind(speed=11.5, from_deg=30.0)
    seen = policy.hindsight(standing(strong, soc=0.6))
    chosen = seen.choose()
    if chosen.segments:
        end = int(seen.problem.network.head[chosen.segments[-1]])
        staying = np.mean([seen._stay(future) for future in seen.futures])
        assert end == seen.problem.destination or chosen.arrival_s < staying - policy.parameters.min_gain_s


def test_a_leg_begins_with_more_charge_where_the_wind_is_not_measured_on_the_way(newyork):
    """What is unknown at the take-off stays unknown: it must be kept from the start, where a drone that measures may turn."""
    start = State(DEPART, "bellevue")
    request = Request(state=start, destination="columbia", payload_kg=0.8, drone="m200")
    forecast = plan(newyork, request, planner="robust").problem.ensemble
    policy = OnlinePolicy(newyork, request)
    known = Information(
        time_s=start.time.timestamp(), soc=0.3, forecast=forecast, belief=USUAL_ERRORS.energy_of(newyork.drone("m200")),
        station="bellevue",
    )  # fmt: skip
    blind = replace(known, measures_wind=False)
    assert policy.epsilon_of(known) == request.epsilon < policy.epsilon_of(blind)
    measured, unmeasured = policy.on_ground(known), policy.on_ground(blind)
    assert measured.station == unmeasured.station == "columbia"
    assert unmeasured.charge_to > measured.charge_to + 0.03


def test_a_leg_is_charged_for_the_age_of_the_measured_wind_when_it_is_begun(newyork):
    """Checked with the wind of a take-off with less charge, a leg wanted more each time it was checked again: 83, 88, 93, 95 %."""
    request = Request(state=State(DEPART, "lawrence"), destination="white-plains", payload_kg=0.8, drone="m200")
    policy = OnlinePolicy(newyork, request)
    known = standing(wind(10.0, 220.0), SURE, "lawrence", 0.3, wind_measured_s=DEPART.timestamp())
    p = policy.problem(known)
    gate, step = DepartureGate(policy, known, p), Step(segments_of(p.network, ["lawrence", "white-plains"]), 0.3)
    at_once, charged = gate.check(step).soc, gate.charged(step).soc
    assert charged > at_once + 0.05
    assert gate.check(replace(step, charge=charged)).soc <= charged + 0.01


def test_the_told_arrival_is_the_one_of_the_reason_and_has_a_spread(policy, composition):
    known = standing(wind(), EnergyBelief(1.0, 0.05, 0.05), soc=0.3, plan=composition)
    decision = policy.on_ground(known, tell=True)
    arrival = decision.composition.arrival
    assert f"{duration(arrival.mean.timestamp() - known.time_s)} to the delivery" in decision.reason
    assert (arrival.p95 - arrival.p50).total_seconds() > 60.0
    typical = decision.composition.services[-1].arrive
    assert arrival.p50 >= typical - timedelta(minutes=5)


def test_the_told_plan_counts_the_charge_that_the_gate_wants_before_its_later_legs(newyork):
    """Told 51 min, a drone stood another hour at its last stop for a charge that nothing had said."""
    request = Request(state=State(DEPART, "montefiore"), destination="white-plains", payload_kg=0.8, drone="m200")
    policy = OnlinePolicy(newyork, request)
    tail = wind(10.0, 220.0)
    known = standing(tail, EnergyBelief(1.06, 0.02, 0.04), "montefiore", 0.48, wind_measured_s=DEPART.timestamp())
    told = policy.on_ground(known, tell=True).composition
    assert len(told.services) > 1
    stop, leg = told.stop_before(told.services[-1]), told.services[-1]
    landed_s = told.services[-2].arrive.timestamp()
    there = replace(known, station=leg.origin, time_s=landed_s, soc=stop.soc_from, wind_measured_s=landed_s)
    p = policy.problem(there)
    segments = segments_of(p.network, [leg.origin, *leg.via, leg.destination])
    assert stop.soc_to >= DepartureGate(policy, there, p).charged(Step(segments, stop.soc_from)).soc - 0.03


def test_a_charge_beyond_what_the_flight_needs_is_explained(newyork):
    request = Request(state=State(DEPART, "lawrence"), destination="white-plains", payload_kg=0.8, drone="m200")
    known = standing(wind(10.0, 220.0), EnergyBelief(1.06, 0.02, 0.04), "lawrence", 0.26)
    decision = OnlinePolicy(newyork, request).on_ground(replace(known, wind_measured_s=DEPART.timestamp()))
    assert decision.charge_to is not None
    assert "no divert station in reach" in decision.reason, decision.reason
