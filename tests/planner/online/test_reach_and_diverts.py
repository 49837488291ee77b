"""What can be reached from where: divert stations, gusts, errors of the wind."""

from dataclasses import replace

import numpy as np
import pytest
from bellevue_flights import DEPART, QUICK, SURE, wind

from skyway.models.base import geodesy
from skyway.models.base.parameters import with_values
from skyway.models.wind.felt_gust import FeltGust
from skyway.planner.parameters.planner import PlannerParameters
from skyway.planner.plan import plan
from skyway.planner.reach.diverts import divert_cover
from skyway.planner.reach.reach import Reach


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
