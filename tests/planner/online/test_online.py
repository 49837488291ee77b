"""What to do now: kept plans, charges that fit, diverts, and no turning to and fro in noise."""

import math
import random
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from skyway.missions.examples import NEW_YORK
from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.base.parameters import with_values
from skyway.models.composition.composition import State
from skyway.models.drones.drag import DragModel
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.felt_gust import FeltGust
from skyway.models.wind.forecast import constant_wind
from skyway.planner.online.departure_gate import DepartureGate
from skyway.planner.online.evaluated import RollingRobust
from skyway.planner.online.following import Step
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.online.options import Floors, Option
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.online.told_plan import best_charges, itinerary_of, needed_charges, segments_of
from skyway.planner.parameters.online import OnlineParameters
from skyway.planner.parameters.planner import PlannerParameters
from skyway.planner.plan import plan
from skyway.planner.problem.error_model import USUAL_ERRORS
from skyway.planner.problem.problem import HORIZON_H, Problem
from skyway.planner.problem.request import Request
from skyway.planner.reach.diverts import divert_cover
from skyway.planner.reach.reach import Reach

DEPART = datetime.fromisoformat("2013-07-10T14:00-04:00")
QUICK = "pfs-charge-aware"
SURE = EnergyBelief(1.0, 0.02)


def wind(speed=3.0, from_deg=230.0):
    return constant_wind(speed, from_deg, DEPART, HORIZON_H, 40.8, -73.9, 60.0)


@pytest.fixture(scope="module")
def request_():
    state = State(DEPART, "bellevue")
    return Request(state=state, destination="jacobi", payload_kg=0.8, drone="m200")


@pytest.fixture(scope="module")
def policy(newyork, request_):
    return OnlinePolicy(newyork, request_)


@pytest.fixture(scope="module")
def composition(newyork, request_):
    return plan(newyork, request_, planner=QUICK, forecast=newyork.forecast(DEPART, HORIZON_H)).composition


def standing(air, belief=SURE, station="bellevue", soc=1.0, **more):
    time_s, seen = DEPART.timestamp(), frozenset({station})
    free = dict.fromkeys((one.id for one in NETWORK().stations if one.pads), 0)
    given = {"busy_pads": free, "visited": seen} | more
    return Information(time_s=time_s, soc=soc, forecast=air, belief=belief, station=station, **given)


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


def calming(hours, speed=14.0):
    """Wind above the limit that falls after some hours."""
    air = wind(speed=speed)
    share = np.where(np.arange(air.slots) * air.slot_s < hours * 3600.0, 1.0, 0.3)[None, :, None]
    return replace(air, north=air.north * share, east=air.east * share)


def test_a_drone_held_by_the_wind_charges_meanwhile(policy, composition):
    decision = policy.on_ground(standing(calming(2), soc=0.6, plan=composition))
    assert decision.charge_to is not None
    decision = policy.on_ground(standing(calming(2), soc=0.9, plan=composition))
    assert decision.action == "wait"
    assert decision.charge_to > 0.91


def test_a_drone_waits_for_wind_that_falls_in_nine_hours(policy, composition):
    decision = policy.on_ground(standing(calming(9), soc=1.0, plan=composition))
    assert decision.action == "wait"


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


@pytest.mark.parametrize(("speed", "from_deg"), [(3.0, 230.0), (6.0, 20.0), (8.0, 290.0)])
def test_what_a_leg_over_a_station_must_keep_is_what_decides_above_that_station(policy, speed, from_deg):
    air, belief = wind(speed, from_deg), EnergyBelief(1.0, 0.05, 0.02)
    known = standing(air, belief)
    problem = policy.problem(known)
    over = segments_of(problem.network, ["bellevue", "belvedere", "yankee-stadium"])
    kept = DepartureGate(policy, known, problem).kept_soc(Step(over, 1.0, 1, 1))
    reach = policy.reach(air, belief.next_flight())
    took = float(
        reach.expected(reach.to_the_end(reach.way("bellevue", (), "belvedere"), known.time_s, climbs=True).soc)
    )
    then = belief.next_flight().in_flight(took, took)
    network = problem.network
    here = tuple(float(values[network.index["belvedere"]]) for values in (network.lat, network.lon))
    above = known_at(1.0, 1.0, air, then, diverts=("bellevue", "belvedere"))
    looks = [
        policy.in_air(replace(above, here=here, soc=soc, flight=FlightMemory())) for soc in np.arange(0.3, 0.8, 0.004)
    ]
    sure = next(one.figures for one in looks if one.figures["p_below_reserve"] <= policy.epsilon)
    assert sure["soc_land"] == pytest.approx(0.2 + kept, abs=0.012)
    assert kept > 0.01


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


def test_every_point_of_a_leg_has_a_divert_station_that_can_be_flown_to(newyork, request_):
    reach = Reach(newyork, wind(), newyork.drone("m200"), 0.8, SURE)
    way = reach.way("bellevue", (), "belvedere")
    full = divert_cover(reach, way, DEPART.timestamp(), 1.0, floor_soc=0.1, epsilon=0.01, destination="belvedere")
    assert full.gap_m is None
    assert full.stations
    assert "belvedere" not in full.stations
    low = divert_cover(reach, way, DEPART.timestamp(), 0.13, floor_soc=0.1, epsilon=0.01, destination="belvedere")
    assert low.gap_m is not None
    index = newyork.network.index
    for station in full.stations:
        assert newyork.network.stations[index[station]].pads > 0


def test_a_plan_names_the_divert_stations_that_the_policy_would_find(newyork, request_):
    """One answer from one code: looked for as finely, the first ones of a plan's leg are those of the gate before it is begun."""
    fine = with_values(PlannerParameters(), {"schedule.max_diverts": 16, "schedule.divert_every_m": 500.0})
    drone = newyork.drone("m200")
    for speed in (0.0, 4.0, 7.0):
        composition = plan(newyork, request_, planner=QUICK, forecast=wind(speed), parameters=fine).composition
        reach = Reach(newyork, wind(speed), drone, 0.8, drone.energy_belief.next_flight(), watched=True)
        for leg in composition.services:
            found = divert_cover(
                reach, reach.way(leg.origin, leg.via, leg.destination), leg.depart.timestamp(), leg.soc_depart,
                floor_soc=0.2 * fine.online.divert_share, epsilon=request_.epsilon, destination=leg.destination, reserve_soc=0.2,
            )  # fmt: skip
            assert leg.diverts == found.stations
            assert leg.destination not in leg.diverts


def test_straight_flights_take_longer_against_the_wind(newyork):
    drone = newyork.drone("m200")
    nodes = np.array([newyork.network.index["jacobi"]])
    here = (float(newyork.network.lat[newyork.network.index["bellevue"]]), -73.97)

    def time_s(direction):
        reach = Reach(newyork, wind(8.0, direction), drone, 0.8, SURE)
        return float(reach.to_stations(here, DEPART.timestamp(), nodes).time_s[0, 0])

    assert time_s(20.0) > 1.4 * time_s(200.0)


def test_a_gust_that_was_felt_slows_the_flights_that_begin_now(newyork):
    """In the mean wind of the flight: what is left of the gust, on average, is a wind more."""
    drone, now_s = newyork.drone("m200"), DEPART.timestamp()
    nodes = np.array([newyork.network.index["jacobi"]])
    here = (float(newyork.network.lat[newyork.network.index["bellevue"]]), -73.97)
    calm = wind(9.0, 20.0)
    felt = FeltGust(now_s, *here, -5.0, -2.0)

    def flown(gust, begin_s=now_s, more=(0.0, 0.0)):
        moved = replace(calm, north=calm.north + more[0], east=calm.east + more[1], gust=gust)
        reach = Reach(newyork, moved, drone, 0.8, SURE)
        found = reach.to_stations(here, begin_s, nodes)
        return float(found.time_s[0, 0]), float(found.soc[0, 0]), reach

    without, _, reach = flown(None)
    length = geodesy.inverse(*here, newyork.network.lat[nodes], newyork.network.lon[nodes])[0]
    start = tuple(np.array([one]) for one in here)
    share = float(felt.share_of(start, length, np.array([now_s]), np.array([without - reach.descent_s]))[0])
    assert flown(felt)[:2] == pytest.approx(flown(None, more=(-5.0 * share, -2.0 * share))[:2], rel=1e-3)
    assert flown(felt)[0] > 1.03 * without
    assert flown(felt, now_s + 3600.0)[0] == pytest.approx(flown(None, now_s + 3600.0)[0], rel=1e-6)


def test_the_risk_of_a_flight_includes_the_error_of_a_wind_across_near_the_airspeed(newyork, policy, monkeypatch):
    nodes = np.array([newyork.network.index["jacobi"]])
    here = (float(newyork.network.lat[newyork.network.index["bellevue"]]), -73.97)

    def doubt(from_deg):
        found = policy.reach(wind(14.0, from_deg), SURE).to_stations(here, DEPART.timestamp(), nodes)
        return float(found.doubt[0, 0])

    across, against = doubt(110.0), doubt(20.0)
    monkeypatch.setattr("skyway.planner.reach.reach.drifted_s", lambda *given: 0.0 * given[4])
    assert across > 1.2 * doubt(110.0)
    assert against < 1.1 * doubt(20.0)


def test_flights_from_all_points_of_a_leg_are_those_from_each(newyork):
    reach = Reach(newyork, wind(6.0, 200.0), newyork.drone("m200"), 0.8, SURE, watched=True)
    nodes = reach.pads[:7]
    places, times_s = (
        [(40.70, -73.97), (40.75, -73.95), (40.80, -73.93)],
        DEPART.timestamp() + np.array([0.0, 3000.0, 9000.0]),
    )
    together = reach.all_to_stations(places, times_s, nodes)
    for row, (place, time_s) in enumerate(zip(places, times_s.tolist(), strict=True)):
        alone = reach.to_stations(place, time_s, nodes)
        for one, other in zip(together, alone, strict=True):
            assert one[:, 7 * row : 7 * row + 7] == pytest.approx(other, rel=1e-9)
    assert len({round(float(one), 3) for one in together.time_s[0]}) > 7


class Flight:
    """A leg from Bellevue to Yankee Stadium, flown point by point with whatever noise."""

    def __init__(self, policy, soc, drain):
        network = policy.scenario.network
        a, b = (network.index[name] for name in ("bellevue", "yankee-stadium"))
        self.start = (float(network.lat[a]), float(network.lon[a]))
        self.end = (float(network.lat[b]), float(network.lon[b]))
        self.memory = FlightMemory()
        self.length = geodesy.distance_m(*self.start, *self.end)
        self.soc, self.drain, self.flown, self.commanded = soc, drain, 0.0, 15.0

    def steps(self):
        while self.flown < self.length - 400.0:
            share = self.flown / self.length
            here = tuple(s + share * (e - s) for s, e in zip(self.start, self.end, strict=True))
            yield here, DEPART.timestamp() + self.flown / 18.0
            self.flown += 180.0
            self.soc -= self.drain


def fly(policy, flight, rng, *, noise):
    acts = []
    diverted = None
    for here, time_s in flight.steps():
        belief = EnergyBelief(1.0 + noise * rng.gauss(0.0, 0.03), 0.04)
        air = wind(max(3.0 + noise * rng.gauss(0.0, 0.8), 0.0), 230.0 + noise * rng.gauss(0.0, 10.0))
        known = Information(
            here=here,
            time_s=time_s,
            soc=flight.soc + noise * rng.gauss(0.0, 0.006),
            forecast=air,
            belief=belief,
            destination="yankee-stadium",
            commanded_mps=flight.commanded,
            diverts=("bellevue", "belvedere", "columbia"),
            flight=flight.memory,
        )
        decision = policy.in_air(known)
        acts.append(decision.action)
        if decision.action == "speed":
            flight.commanded = decision.speed_mps
        if decision.action in ("divert", "station", "land"):
            diverted = decision
            break
    return acts, diverted


def test_a_flight_that_is_well_is_flown_on_at_the_speed_the_wind_asks_for(policy):
    flight = Flight(policy, 0.9, 0.004)
    acts, diverted = fly(policy, flight, random.Random(1), noise=0.0)
    assert diverted is None
    assert set(acts) <= {"continue", "speed"}
    assert acts.count("speed") <= 2
    assert flight.commanded == pytest.approx(20.0, abs=0.1)


def test_one_member_that_is_calmer_by_a_hair_does_not_decide_for_those_at_the_limit_of_the_wind(newyork, policy):
    limit = newyork.drone("m200").wind_limit_mps
    shape = (
        20,
        2,
        1,
    )  # all blow with the flight, and a storm against it follows in the one that is just below the limit
    north = np.full(shape, limit + 0.1)
    north[7] = np.array([[limit - 0.1], [-30.0]])
    at = DEPART.timestamp()
    air = WindEnsemble(
        np.array([40.8]), np.array([-73.9]), at - 3500.0, 3600.0, north, np.zeros(shape), np.full(20, 0.05),
        tuple(map(str, range(20))), newyork.rules.cruise_height_m,
    )  # fmt: skip
    flight = Flight(policy, 0.9, 0.0)
    for _ in range(3):
        known = Information(
            here=flight.start, time_s=at, soc=0.9, forecast=air, belief=SURE, destination="yankee-stadium",
            commanded_mps=20.0, diverts=("bellevue",), flight=flight.memory,
        )  # fmt: skip
        decision = policy.in_air(known)
        assert decision.action in ("continue", "speed")
    assert 0.0 < decision.figures["p_below_reserve"] <= 0.06


def test_a_flight_that_cannot_keep_the_reserve_is_diverted_with_the_reason_in_figures(policy):
    acts, diverted = fly(policy, Flight(policy, 0.38, 0.010), random.Random(2), noise=0.0)
    assert diverted is not None
    assert diverted.action == "divert"
    assert "below the reserve with probability" in diverted.reason
    assert diverted.figures["divert_soc"] > diverted.figures["soc_land"]
    assert acts[-1] == "divert"


def test_where_nothing_can_be_reached_it_lands_here(policy):
    _, diverted = fly(policy, Flight(policy, 0.05, 0.004), random.Random(3), noise=0.0)
    assert diverted is not None
    assert diverted.action == "land"
    assert "no station is in reach" in diverted.reason


def known_at(share, soc, air, belief=SURE, **more):
    """On the way from Bellevue to Yankee Stadium."""
    network, (a, b) = NETWORK(), ("bellevue", "yankee-stadium")
    places = [(float(network.lat[network.index[name]]), float(network.lon[network.index[name]])) for name in (a, b)]
    here = tuple(s + share * (e - s) for s, e in zip(*places, strict=True))
    given = {
        "via": (),
        "destination": b,
        "commanded_mps": 20.0,
        "diverts": ("bellevue", "belvedere", "columbia"),
    } | more
    return Information(here=here, time_s=DEPART.timestamp(), soc=soc, forecast=air, belief=belief, **given)


def NETWORK():  # noqa: N802  read once
    return read_scenario(NEW_YORK).network


def test_what_keeps_the_reserve_and_delivers_first_is_taken(policy):
    sure = EnergyBelief(1.0, 0.02, 0.02)
    head = wind(8.0, 20.0)
    decision = policy.in_air(known_at(0.35, 0.40, head, sure, sudden=True))
    assert decision.action == "divert", decision
    options = decision.figures["options"]
    assert len(options) > 1
    assert all(one["p_below_reserve"] <= 0.05 for one in options)
    arrivals = [one["arrival_s"] for one in options]
    assert arrivals == sorted(arrivals)
    assert decision.station == options[0]["station"]
    assert decision.figures["p_below_reserve"] > 0.05
    assert "the delivery comes in" in decision.reason


def test_the_rougher_the_air_the_more_charge_a_flight_needs_in_the_air_and_before_it(policy, composition):
    head, belief = wind(8.0, 20.0), EnergyBelief(1.0, 0.02, 0.02)
    risk = [
        policy.in_air(known_at(0.35, 0.75, head, belief, roughness=rough)).figures["p_below_reserve"]
        for rough in (0.1, 1.0, 7.0)
    ]
    assert risk[0] < 0.2 * risk[1] < 0.2 * risk[2]
    step = policy.hindsight(standing(wind(6.0, 20.0), plan=composition)).choose()
    least = [
        DepartureGate(policy, known, policy.problem(known)).check(step).soc
        for rough in (0.1, 1.0, 7.0)
        for known in [standing(wind(6.0, 20.0), plan=composition, roughness=rough)]
    ]
    assert least[0] < least[1]
    assert least[2] is None  # even a full battery is too little


def test_the_older_a_measured_wind_is_the_more_charge_a_flight_needs(policy, composition):
    step = policy.hindsight(standing(wind(6.0, 20.0), plan=composition)).choose()
    least = []
    for age_s in (math.nan, 0.0, 1800.0, 3600.0, 7200.0):
        known = standing(wind(6.0, 20.0), plan=composition, wind_measured_s=DEPART.timestamp() - age_s)
        least.append(DepartureGate(policy, known, policy.problem(known)).check(step).soc)
    assert least[0] == least[1] < least[2] < least[3] < least[4]


def test_a_station_where_all_places_are_taken_is_not_turned_to(policy):
    head, sure = wind(8.0, 20.0), EnergyBelief(1.0, 0.02, 0.02)
    free = policy.in_air(known_at(0.35, 0.40, head, sure, sudden=True))
    assert free.action == "divert"
    full = policy.in_air(known_at(0.35, 0.40, head, sure, sudden=True, busy_pads={free.station: 60}))
    assert full.station != free.station
    risk = {one["station"]: one["p_below_reserve"] for one in full.figures["options"]}
    assert free.station not in risk


def test_a_flight_to_a_station_that_filled_up_meanwhile_goes_elsewhere(policy):
    known = {"belief": EnergyBelief(1.0, 0.02, 0.02), "sudden": True}
    assert policy.in_air(known_at(0.4, 0.6, wind(), busy_pads={"yankee-stadium": 1}, **known)).action != "divert"
    turned = policy.in_air(known_at(0.4, 0.6, wind(), busy_pads={"yankee-stadium": 60}, **known))
    assert turned.action == "divert", turned
    assert turned.figures["p_below_reserve"] > 0.99


def test_a_small_risk_ahead_is_not_left_for_a_landing_below_the_reserve_elsewhere():
    """A drone turned back to land at 17 % because its own station was full with a chance of one in a hundred."""
    floors = Floors(0.2, 0.1)
    ahead = Option("ahead", 15.0, 0.0, 0.30, 0.0, 0.0, 0.0, 3000.0).with_room(lambda *_: 0.013, 6e-4, floors)
    back = Option("back", 15.0, 0.0, 0.17, 1.0, 0.0, 0.0, 9000.0)
    assert ahead.p_below == pytest.approx(0.013)
    assert ahead.risk < 0.5 * back.risk
    empty = replace(ahead, p_half=0.3, p_empty=0.05)
    assert back.risk < 0.5 * empty.risk  # what saves the drone costs the reserve


def test_one_look_is_not_enough_unless_charge_was_lost_at_once(policy):
    memory, head = FlightMemory(), wind(8.0, 20.0)
    looks = [policy.in_air(known_at(0.35, 0.40, head, commanded_mps=12.0, flight=memory)).action for _ in range(3)]
    assert looks == ["continue", "continue", "divert"]


def test_a_divert_under_way_is_turned_only_where_the_battery_would_be_empty(policy):
    to = {"destination": "columbia", "diverts": ("belvedere", "bellevue", "yankee-stadium")}
    turned = {"flight": FlightMemory(turned=True)} | to
    assert policy.in_air(known_at(0.3, 0.2, wind(), **turned)).action in ("continue", "speed")
    nearly = policy.in_air(known_at(0.45, 0.035, wind(8.0, 20.0), sudden=True, **turned))
    assert nearly.action in ("divert", "land")


def test_where_its_cost_is_known_another_airspeed_saves_what_is_lacking(newyork, request_):
    loaded = OnlinePolicy(newyork, request_, drag=DragModel(linear_per_s=0.037, quadratic_per_m=0.005))
    head, sure = wind(9.0, 20.0), EnergyBelief(1.0, 0.01, 0.01)
    alone = known_at(0.3, 1.0, head, sure, sudden=True, diverts=())
    reach = loaded.reach(head, sure)
    way = reach.way(alone.here, (), "yankee-stadium")
    slow, fast = (float(reach.at_airspeed(v).to_the_end(way, alone.time_s).soc[0]) for v in (20.0, 22.0))
    assert fast < slow - 0.01  # against the wind the faster drone is sooner there than it takes more
    unsure = np.hypot(sure.sd_between, loaded.parameters.wind_spread)
    decision = loaded.in_air(replace(alone, soc=0.2 + (1.0 + 2.4 * unsure) * fast))  # 2.33 is 1 %
    assert decision.action == "speed", decision
    assert decision.figures["airspeed_mps"] == pytest.approx(22.0)
    assert decision.speed_mps > 11.5
    assert "through the air" in decision.reason
    without = OnlinePolicy(newyork, request_)
    assert without.in_air(replace(alone, soc=0.2 + fast + 0.034, flight=FlightMemory())).action != "land"


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


def _without_flip_flop(policy, flights):
    turned = speeds = 0
    for seed in range(flights):
        rng = random.Random(f"noise/{seed}")
        flight = Flight(policy, rng.uniform(0.40, 0.95), rng.uniform(0.0050, 0.0062))
        acts, diverted = fly(policy, flight, rng, noise=1.0)
        # a flight is turned at most once, since nothing is decided any more after it; and never for noise alone
        landing = flight.soc - flight.drain * (flight.length - flight.flown) / 180.0
        if diverted is not None:
            turned += 1
            assert landing < 0.26, (seed, diverted.reason)
        speeds += acts.count("speed")
        assert acts.count("speed") <= len(acts) / 3 + 1
    return turned, speeds


def test_noise_does_not_turn_flights_to_and_fro(policy):
    _without_flip_flop(policy, 8)


@pytest.mark.slow
def test_noise_does_not_turn_a_thousand_flights_to_and_fro(policy):
    turned, speeds = _without_flip_flop(policy, 1000)
    assert turned < 400
    assert speeds < 10_000


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


def test_a_flight_in_doubt_flies_on_while_another_station_stays_in_reach_and_turns_when_that_ends(policy):
    memory, head = FlightMemory(), wind(8.0, 20.0)
    unsure = EnergyBelief(1.0, 0.12, 0.02)
    reach = policy.reach(head, unsure)
    begin = known_at(0.1, 1.0, head, unsure)
    way = reach.way(begin.here, (), "yankee-stadium")
    needed = float(reach.expected(reach.to_the_end(way, begin.time_s).soc))
    early = known_at(0.1, 0.2 + 1.12 * needed, head, unsure, flight=memory, commanded_mps=11.8)
    looks = [policy.in_air(early).action for _ in range(4)]
    assert policy.in_air(early).figures["p_below_reserve"] > 0.05
    assert "divert" not in looks
    alone = replace(early, diverts=(), flight=FlightMemory())
    assert [policy.in_air(alone).action for _ in range(3)]  # nothing else to do: it flies on
    hopeless = known_at(0.1, 0.2 + 0.9 * needed, head, unsure, flight=FlightMemory(), commanded_mps=11.8)
    assert "divert" in [policy.in_air(hopeless).action for _ in range(4)]


def test_a_flight_whose_end_is_too_far_flies_on_to_a_station_on_its_way_while_it_can_still_turn_back(policy):
    """The leg was begun for the sake of that station; what is known soon decides where it lands."""
    memory, head = FlightMemory(), wind(9.0, 20.0)
    unsure = EnergyBelief(1.0, 0.1, 0.02)
    before = known_at(0.1, 1.0, head, unsure, via=("belvedere",))
    reach = policy.reach(head, unsure)
    there = float(
        reach.expected(reach.to_stations(before.here, before.time_s, np.array([NETWORK().index["belvedere"]])).soc)[0]
    )
    known = replace(before, soc=0.2 + 1.2 * there, commanded_mps=11.0, flight=memory)
    looks = [policy.in_air(known) for _ in range(4)]
    assert looks[-1].figures["p_below_reserve"] > policy.parameters.p_hopeless
    assert "divert" not in [one.action for one in looks]
    for other in (
        replace(known, via=(), flight=FlightMemory()),  # it does not lead over a station: its end is all there is
        replace(known, soc=0.2 + 0.95 * there, flight=FlightMemory()),  # that station most probably is too far, too
    ):
        assert "divert" in [policy.in_air(other).action for _ in range(4)]


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


def test_a_watched_flight_counts_its_manoeuvres_and_a_wind_that_is_not_known_so_well(policy):
    calm = wind(0.5)
    real, ideal = (policy.reach(calm, SURE, watched=watched) for watched in (True, False))
    way = real.way("bellevue", (), "yankee-stadium")
    flown, cost = (one.to_the_end(way, DEPART.timestamp(), climbs=True) for one in (real, ideal))
    extra_s = policy.parameters.manoeuvres_s
    assert flown.time_s == pytest.approx(cost.time_s + extra_s)
    assert flown.soc == pytest.approx(cost.soc + extra_s * ideal.soc_per_s)
    needed = float(cost.soc[0]) + 0.2 + 0.04
    assert real.p_below(needed, cost.soc[:, None], 0.2)[0] > ideal.p_below(needed, cost.soc[:, None], 0.2)[0]


def test_a_leg_whose_end_is_not_sure_needs_a_station_that_keeps_the_reserve_from_each_point(policy):
    reach = policy.reach(wind(0.5), SURE)
    way, at_s = reach.way("bellevue", (), "jacobi"), DEPART.timestamp()
    needed = 0.2 + float(reach.expected(reach.to_the_end(way, at_s, climbs=True).soc))
    given = {"floor_soc": 0.1, "epsilon": 0.01, "destination": "jacobi", "reserve_soc": 0.2}
    for soc in (needed - 0.03, needed + 0.1):
        cover = divert_cover(reach, way, at_s, soc, **given)
        sure = float(reach.p_below(soc, reach.to_the_end(way, at_s, climbs=True).soc[:, None], 0.2)[0]) <= 0.01
        floor = 0.1 if sure else 0.2
        assert cover == divert_cover(reach, way, at_s, soc, **{**given, "floor_soc": floor, "reserve_soc": 0.0})
    assert sure


def test_who_waits_for_the_wind_does_not_fly_to_and_fro_meanwhile(policy, newyork):
    """A flight that does not end at the destination must arrive earlier than staying."""
    strong = wind(speed=11.5, from_deg=30.0)
    seen = policy.hindsight(standing(strong, soc=0.6))
    chosen = seen.choose()
    if chosen.segments:
        end = int(seen.problem.network.head[chosen.segments[-1]])
        staying = np.mean([seen._stay(future) for future in seen.futures])
        assert end == seen.problem.destination or chosen.arrival_s < staying - policy.parameters.min_gain_s


def test_a_wind_in_which_it_could_not_have_come_here_turns_no_flight(policy):
    calm, storm = wind(4.0, 20.0), wind(25.0, 20.0)
    both = replace(
        calm,
        north=np.concatenate([np.repeat(calm.north, 19, axis=0), storm.north]),
        east=np.concatenate([np.repeat(calm.east, 19, axis=0), storm.east]),
        probability=np.full(20, 0.05),
        labels=tuple(map(str, range(20))),
    )
    figures = policy.in_air(known_at(0.1, 0.95, both, SURE)).figures
    assert figures["p_below_reserve"] < 0.001


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
