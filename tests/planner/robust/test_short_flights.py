"""Routes of short flights, where the wind would keep longer ones on the ground for hours."""

from dataclasses import replace

import numpy as np
import pytest

from skyway.models.composition.composition import State
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.ensemble import evenly
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from tests.planner.worlds import DEPART, make_wind

MEMBERS, STORMY_H = 30, 30
LEG_DEG = 0.148  # 10 km


def world():
    """Two flights of 10 km, or both at once."""
    placed = [Station(name, name, 52.5, 13.0 + number * LEG_DEG, 40.0, 4, 4) for number, name in enumerate("amb")]
    network = build_network(placed, ConnectionRule("max-length", 12_000.0))
    nobody = PadLoad(np.zeros((3, 168)), np.full((3, 168), 3600.0), "UTC")
    return Scenario("line", network, (M200_V2,), FlightRules(), nobody)


def wind_with_storms(stormy):
    """Nearly calm, but for some members in which it blows against the way for thirty hours."""
    wind = make_wind(np.random.default_rng(1), members=MEMBERS, mean_mps=0.5)
    east = wind.east.copy()
    east[stormy, :STORMY_H] = -9.0
    return replace(wind, east=east)


@pytest.mark.parametrize("large_network", [200, 2])
def test_storms_that_routes_are_not_compared_in_first_are_met_by_short_flights(large_network):
    screened = evenly(MEMBERS, 12)
    stormy = [number for number in range(MEMBERS) if number not in screened][:4]
    request = Request(state=State(DEPART, "a"), destination="b", payload_kg=0.8)
    parameters = replace(USUAL, robust=replace(USUAL.robust, large_network=large_network, screen_members=12))
    found = plan(world(), request, forecast=wind_with_storms(stormy), parameters=parameters)
    assert [leg.destination for leg in found.composition.services] == ["m", "b"]
    assert found.outcome.mean_s - found.problem.depart_s < 2 * 3600.0  # else four hours


def test_without_storms_no_other_route_is_tried():
    """Composed for long flights alone, a calm delivery stays with them."""
    request = Request(state=State(DEPART, "a"), destination="b", payload_kg=0.8)
    parameters = replace(USUAL, robust=replace(USUAL.robust, margins=(0.12, 0.06)))
    calm = plan(world(), request, forecast=wind_with_storms([]), parameters=parameters)
    assert [leg.destination for leg in calm.composition.services] == ["b"]


def test_a_drone_lands_on_the_way_where_a_full_battery_hardly_does_for_the_flight_past_it():
    """A flight of 20 km waits up to two hours for a wind that is not from ahead, two of 10 km leave at once: 18 minutes on average instead of 22."""
    request = Request(state=State(DEPART, "a"), destination="b", payload_kg=0.8)
    calm = plan(world(), request, forecast=wind_with_storms([]))
    assert [leg.destination for leg in calm.composition.services] == ["m", "b"]
    direct = plan(
        world(), request, forecast=wind_with_storms([]),
        parameters=replace(USUAL, robust=replace(USUAL.robust, margins=(0.12, 0.06))),
    )  # fmt: skip
    assert calm.outcome.mean_s < direct.outcome.mean_s - 120.0
