"""Flights under way, as the promises of a new plan are simulated from them."""

from datetime import UTC, datetime, timedelta

import pytest

from skyway.dispatch.dispatcher.fleet_planner import under_way
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.records import DroneRecord, FlightRecord, OrderRecord, PlanStep, Progress
from skyway.models.orders.order import Order, Vehicle

NOON = datetime(2026, 7, 10, 12, tzinfo=UTC)
NOON_S = NOON.timestamp()


def step(kind, origin, destination, begin_min, end_min):
    return PlanStep(kind=kind, origin=origin, destination=destination, begin_s=NOON_S + 60.0 * begin_min, end_s=NOON_S + 60.0 * end_min, soc_begin=0.9, soc_end=0.2)  # fmt: skip


STEPS = (step("fly", "a", "b", 0, 10), step("charge", "b", "b", 10, 30), step("fly", "b", "c", 30, 40))
LEGS = [{"soc_depart": 0.9, "soc_arrive": 0.6, "flight_time_s": 600.0}, {"soc_depart": 0.7, "soc_arrive": 0.5, "flight_time_s": 600.0}]  # fmt: skip


def situation(progress, state="flying"):
    order = Order(id="one", origin="z", destination="c", mass_kg=0.3, ready=NOON, due=NOON + timedelta(hours=2))
    vehicle = Vehicle(id="d", type="m200", home="a", place="a", soc=0.9)
    flight = FlightRecord(
        drone="d", type="m200", system=1, order="one", phase="with the package", mass_kg=0.3, composition={"legs": LEGS}, steps=STEPS,
        not_before_s=0.0, journal="", progress=progress,
    )  # fmt: skip
    drone = DroneRecord(vehicle=vehicle, system=1, place="a", soc=0.88, flight="1 d")
    found = Situation(None)  # as if read from a desk
    found.flights, found.drones = {"1 d": ("flying", flight)}, {"d": (state, drone)}
    found.orders = {"one": ("under way", OrderRecord(order=order, place="z"))}
    return found


def seconds(one):
    return one.vehicle.available_from.timestamp() - NOON_S


def test_in_the_air_the_rest_begins_at_the_landing_with_the_charge_that_is_expected_then():
    progress = Progress(at_s=NOON_S + 360.0, state="flying", flights=1, soc=0.72, late_s=60.0)
    (one,) = under_way(situation(progress), NOON_S + 400.0)
    assert (one.vehicle.place, seconds(one), one.steps[0].kind, len(one.steps)) == ("b", 660.0, "charge", 2)
    assert one.in_air_s == pytest.approx(260.0)
    assert one.vehicle.soc == pytest.approx(0.72 - 0.0005 * 300.0), "not the planned charge, which has margins"
    assert (one.order.id, one.order.origin, one.itinerary) == ("one", "a", "one")


def test_at_a_stop_and_before_the_first_take_off_it_begins_now_and_a_lost_drone_does_not_count():
    charging = Progress(at_s=NOON_S + 900.0, state="charging", flights=1, station="b", soc=0.65)
    (one,) = under_way(situation(charging), NOON_S + 960.0)
    assert (one.vehicle.place, one.vehicle.soc, seconds(one), one.in_air_s) == ("b", 0.65, 960.0, 0.0)
    assert [each.kind for each in one.steps] == ["charge", "fly"]
    (early,) = under_way(situation(None), NOON_S + 5.0)
    assert (early.vehicle.place, early.vehicle.soc, len(early.steps)) == ("a", 0.88, 3)
    assert under_way(situation(charging, "lost"), NOON_S + 960.0) == []
