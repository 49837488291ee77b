"""Drones without a task charge on pads that nobody needs."""

from datetime import timedelta

import pytest
from fleet_runs import START
from sim_station import LAT, LON, pads_stage

from skyway.dispatch.dispatcher.bookings import Bookings
from skyway.dispatch.dispatcher.idle_charging import AGAIN_S, CHARGED_SOC, LOOK_S, UNKNOWN_S, WINDOW_S, IdleCharging
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.dispatcher.windows import to_book
from skyway.dispatch.records import DroneRecord, PlannedPart, PlanStep
from skyway.models.ledger.audit import audit
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Vehicle
from skyway.models.queues.pad_service import PadServiceError
from skyway.sim_stub.config import VehicleConfig

NOW_S = START.timestamp()


class Yard:
    """A station with a simulated drone 1 at half charge, and the idle charges of its dispatcher."""

    def __init__(self, book, *, pads=1, soc=0.5):
        self.stage, self.pads = pads_stage(pads, 4, soc=soc)
        self.book, lease = book, book.acquire("dispatch", "process")
        self.situation = Situation(Desk(book, "dispatch"))
        self.bookings = Bookings(book, "dispatch", lambda: lease, {"here": pads})
        self.said = []
        self.idle = IdleCharging(self.situation, self.bookings, {"here": pads}, self, self.said.append)
        self.now_s, self.silent = NOW_S, False
        self.drone = self.add(1, soc)

    def add(self, system, soc):
        name = f"d{system}"
        vehicle = Vehicle(id=name, type="m200", home="here", place="here")
        drone = DroneRecord(vehicle=vehicle, system=system, place="here", soc=soc, measured_s=self.now_s)
        self.situation.drones[name] = ("standing", drone)
        if system > 1:
            self.stage.world.add(VehicleConfig(lat=LAT, lon=LON, ground_m=5.0, system=system, soc=soc, warm=True))
        return drone

    # The pad service

    def status(self, station):
        return self.pads.status(station)

    def charge(self, station, drone, to_soc):
        return self.pads.charge(station, drone, to_soc)

    def release(self, station, drone):
        if self.silent:
            raise PadServiceError("the pads are silent")
        return self.pads.release(station, drone)

    # Time

    def run(self, seconds):
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.idle.give_way(self.now_s)
            self.idle.charge(self.now_s)
            self.bookings.bring_up_to_date(to_book(self.situation, self.now_s), self.now_s)
            self.stage.lockstep.run_for(10.0)
            self.now_s += 10.0

    @property
    def on_pads(self):
        return {one.drone for one in self.pads.status("here").drones if one.state == "charging"}

    @property
    def booked(self):
        return {one.itinerary: one.window for one in self.book.holds() if one.state != "released"}


@pytest.fixture
def book(tmp_path):
    with open_ledger(str(tmp_path / "ledger.db")) as found:
        yield found


def _route(begin_s, *, pad=None):
    step = PlanStep(
        kind="fly" if pad is None else "charge", origin="here", destination="here", begin_s=begin_s, end_s=begin_s + 600.0,
        soc_begin=0.5, soc_end=0.6, pad=pad,
    )  # fmt: skip
    return (PlannedPart(order="o1", phase="with the package", steps=(step,)),)


def test_a_drone_without_a_task_charges_in_a_short_booked_window_until_it_has_enough(book):
    yard = Yard(book)
    yard.run(1200.0)
    assert yard.on_pads == {"1"}
    (window,) = yard.booked.values()
    assert window.end.timestamp() - yard.now_s <= WINDOW_S
    assert 0.5 < yard.drone.soc < CHARGED_SOC
    yard.run(7200.0)
    assert (yard.on_pads, yard.booked, yard.drone.idle) == (set(), {}, None)
    assert yard.drone.soc == pytest.approx(CHARGED_SOC, abs=0.01)
    assert audit(book) == []


def test_it_does_not_charge_with_enough_before_a_flight_or_where_all_pads_are_taken(book):
    yard = Yard(book, soc=0.75)
    yard.run(600.0)
    assert yard.on_pads == set()
    yard.drone.soc, yard.drone.route = 0.5, _route(yard.now_s + WINDOW_S - 60.0)
    yard.run(120.0)
    assert yard.on_pads == set()
    yard.drone.route = ()
    yard.add(2, 0.4)
    yard.pads.charge("here", "2", 1.0)
    yard.run(600.0)
    assert yard.on_pads == {"2"}


def test_the_emptiest_comes_first(book):
    yard = Yard(book)
    yard.add(2, 0.4)
    yard.run(120.0)
    assert yard.on_pads == {"2"}


def test_it_leaves_for_a_drone_that_waits_and_does_not_come_back_at_once(book):
    yard = Yard(book)
    yard.run(300.0)
    yard.add(2, 0.4)
    assert yard.pads.charge("here", "2", 0.42).state == "waiting"
    yard.run(LOOK_S + 20.0)
    assert yard.on_pads == {"2"}
    yard.pads.release("here", "2")
    yard.situation.drones.pop("d2")
    yard.run(AGAIN_S - 2.0 * LOOK_S)
    assert yard.on_pads == set()
    yard.run(4.0 * LOOK_S)
    assert yard.on_pads == {"1"}


def test_it_leaves_for_its_own_flight_and_for_a_flight_that_has_its_pad(book):
    yard = Yard(book, soc=0.3)
    yard.run(300.0)
    yard.drone.route = _route(yard.now_s + 1200.0)
    yard.run(300.0)
    assert yard.on_pads == {"1"}
    yard.run(1000.0)
    assert yard.on_pads == set()
    yard.drone.route = ()
    yard.run(AGAIN_S + LOOK_S)
    assert yard.on_pads == {"1"}
    other = yard.add(2, 0.9)
    other.route = _route(yard.now_s + 300.0, pad=1)
    yard.run(20.0)
    assert yard.on_pads == set()
    (window,) = yard.booked.values()
    assert window.start.timestamp() == pytest.approx(other.route[0].begin_s)
    assert audit(book) == []


def test_the_booked_pad_of_another_operator_is_left_to_him(book):
    yard = Yard(book, pads=2)
    yard.run(300.0)
    theirs = book.acquire("other", "process")
    (mine,) = yard.booked.values()
    for pad in (1, 2):
        begin = mine.end + timedelta(minutes=1)
        book.book(
            theirs, f"their {pad}", [type(mine)(station="here", pad=pad, start=begin, end=begin + timedelta(hours=1))]
        )
    yard.run(3600.0)
    assert yard.on_pads == set()
    assert audit(book) == []


def test_a_drone_whose_charge_has_not_been_measured_for_long_is_asked_on_a_pad(book):
    yard = Yard(book, soc=0.6)
    yard.drone.soc = 0.95  # as after a landing long ago
    yard.run(UNKNOWN_S - 60.0)
    assert yard.on_pads == set()
    yard.run(240.0)
    assert yard.on_pads == {"1"}
    assert yard.drone.soc < 0.65


def test_where_the_pads_do_not_answer_it_stays_on_its_pad_and_says_so(book):
    yard = Yard(book)
    yard.run(300.0)
    yard.silent, yard.drone.route = True, _route(yard.now_s)
    yard.run(30.0)
    assert yard.drone.idle is not None
    assert "the pads are silent" in yard.said[-1]
    yard.silent = False
    yard.run(20.0)
    assert yard.drone.idle is None
