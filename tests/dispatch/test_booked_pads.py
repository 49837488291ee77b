"""Pads as a flight of a fleet has them: after its windows have begun, and how long a charge will take."""

import math

from skyway.dispatch.booked_pads import BookedPads
from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
from skyway.dispatch.records import PlanStep
from skyway.models.base.units import from_posix
from skyway.models.queues.pad_service import DroneOnPad
from skyway.models.wind.forecast import constant_wind


def charge(begin_s, end_s):
    return PlanStep(
        kind="charge", origin="a", destination="a", begin_s=begin_s, end_s=end_s, soc_begin=0.3, soc_end=0.8, pad=1
    )


def leg(origin, destination):
    return PlanStep(
        kind="fly", origin=origin, destination=destination, begin_s=0.0, end_s=60.0, soc_begin=0.8, soc_end=0.5
    )


class Pads:
    """A pad that charges until 900 s."""

    def charge(self, station, drone, to_soc):
        return DroneOnPad(drone=drone, state="charging", to_soc=to_soc, done_s=900.0)

    def release(self, station, drone):
        return DroneOnPad(drone=drone, state="done", to_soc=1.0)


def test_a_drone_waits_for_its_window_and_knows_when_its_charge_is_done():
    now = [100.0]
    pads = BookedPads(Pads(), (charge(300.0, 700.0),), lambda: now[0])
    assert pads.charged_s == -math.inf
    assert pads.charge("a", "d", 0.8).state == "waiting"
    now[0] = 301.0
    assert pads.charge("a", "d", 0.8).state == "charging"
    assert pads.charged_s == 900.0  # later than the window: the flight tells at once how late it will be
    pads.release("a", "d")
    assert pads.charged_s == -math.inf


def test_a_flight_that_ends_on_its_pad_leaves_it_once_and_no_other():
    left = []

    class Noted(Pads):
        def release(self, station, drone):
            left.append((station, drone))
            return super().release(station, drone)

    pads = BookedPads(Noted(), (charge(300.0, 700.0),), lambda: 301.0)
    pads.leave("a", "d")
    assert left == []
    pads.charge("a", "d", 0.8)
    pads.leave("b", "d")
    assert left == []
    pads.leave("a", "d")
    pads.leave("a", "d")
    assert left == [("a", "d")]


def test_a_leg_that_was_refused_is_closed_until_the_next_hour_of_the_forecast():
    begin_s = 1_373_479_200.0
    wind = constant_wind(4.0, 270.0, from_posix(begin_s), 12, 40.7, -73.9, 100.0)
    said = []
    legs = ClosedLegs(lambda _: wind, said.append)
    steps = (leg("a", "b"), charge(100.0, 200.0), leg("b", "c"))
    legs.close("m200", steps, "z", begin_s)
    assert legs.at(begin_s) == {}
    assert said == []
    legs.close("m200", steps, "b", begin_s + 60.0)
    next_s = begin_s + wind.slot_s
    assert legs.at(begin_s + 60.0) == {("m200", "b", "c"): next_s}
    assert said == ["m200: b to c is not planned for 59 min"]
    legs.close("m200", steps, "a", next_s - 60.0)  # not for a minute alone
    assert legs.at(next_s - 10.0) == {("m200", "b", "c"): next_s, ("m200", "a", "b"): next_s + wind.slot_s}
    assert list(legs.at(next_s)) == [("m200", "a", "b")]
