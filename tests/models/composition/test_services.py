"""A composition adds up what its services and stops say."""

from dataclasses import FrozenInstanceError, replace
from datetime import UTC, datetime, timedelta

import pytest

from skyway.models.composition.composition import Composition, State
from skyway.models.composition.distributions import ArrivalDistribution
from skyway.models.composition.service import DroneService, Place, Stop
from skyway.models.wind.summary import Wind

START = datetime(2013, 7, 10, 18, tzinfo=UTC)


def flight(origin: str, destination: str, depart_s: float, length_s: float, via=(), soc=0.5) -> DroneService:
    depart = START + timedelta(seconds=depart_s)
    return DroneService(
        f"{origin}-{destination}", origin, destination, depart, depart + timedelta(seconds=length_s), 1000.0 * length_s, 0.0, 15.0,
        500.0 * length_s, 1.0, soc, Wind(3.0, 0.0), -3.0, 0.0, via=via,
    )  # fmt: skip


STOP = Stop("b", START + timedelta(seconds=300), wait_s=60.0, recharge_s=1200.0, hold_s=30.0, soc_from=0.4, soc_to=0.9)
DELIVERY = Composition(
    "x", "pfs", "m200", 0.8, 20.0, 20.0, 60.0, 5.0, 3.0, 0.2, START, "a", "d",
    {name: Place(40.0, -74.0) for name in "abcd"},
    (flight("a", "b", 0.0, 300.0, soc=0.4), flight("b", "d", 1590.0, 400.0, via=("c",), soc=0.3)),
    (STOP,), ArrivalDistribution(None, None, None), 0.0,
)  # fmt: skip


def test_a_drone_leaves_a_stop_when_it_has_waited_charged_and_held():
    assert STOP.leave == START + timedelta(seconds=300 + 60 + 1200 + 30)


def test_a_flight_lasts_from_take_off_to_touch_down():
    assert [service.flight_time_s for service in DELIVERY.services] == [300.0, 400.0]


def test_delivery_time_is_flight_waiting_and_recharge():
    assert DELIVERY.flight_time_s == 700.0
    assert DELIVERY.wait_time_s == 90.0
    assert DELIVERY.recharge_time_s == 1200.0
    assert DELIVERY.delivery_time_s == 1990.0 == (DELIVERY.arrive - DELIVERY.depart).total_seconds()


def test_distance_energy_and_lowest_charge_are_over_all_flights():
    assert (DELIVERY.distance_m, DELIVERY.energy_j, DELIVERY.min_soc) == (700_000.0, 350_000.0, 0.3)


def test_the_route_names_overflown_stations_too():
    assert DELIVERY.route == ("a", "b", "c", "d")
    assert str(DELIVERY) == "pfs: a > b > c > d in 33 min from 2013-07-10T18:00:00Z"


def test_a_composition_without_flights_is_there_already():
    empty = replace(DELIVERY, services=(), stops=())
    assert (empty.arrive, empty.delivery_time_s, empty.min_soc, empty.route) == (START, 0.0, 1.0, ("a",))


def test_what_was_planned_does_not_change():
    with pytest.raises(FrozenInstanceError):
        DELIVERY.payload_kg = 5.0


def test_a_state_knows_nothing_of_pads_unless_told():
    state = State(START, "a")
    assert (state.soc, dict(state.busy_pads), state.visited, state.position) == (1.0, {}, frozenset(), None)


def test_after_a_landing_what_is_left_begins_where_it_landed_and_elsewhere_nothing_is_left():
    rest = DELIVERY.after("b")
    assert (rest.origin, [service.id for service in rest.services]) == ("b", ["b-d"])
    assert DELIVERY.after("a") is DELIVERY  # turned back to where the leg begins
    assert rest.after("b") is rest
    assert DELIVERY.after("c") is None
    assert DELIVERY.after(None) is None
    assert rest.after("d") is None
    assert replace(DELIVERY, services=(), stops=()).after("a") is None
