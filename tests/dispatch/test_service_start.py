"""How a service begins and ends: who leads it, and what it leaves."""

import sqlite3
import threading
from datetime import timedelta

import pytest
from fleet_runs import START

from skyway.dispatch.records import DroneRecord, ServiceRecord, written
from skyway.dispatch.requests import Arrivals
from skyway.dispatch.service import Options, Service
from skyway.dispatch.simulation import simulate
from skyway.models.base.errors import InputError
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.ledger import LedgerError
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.order import Order, Vehicle


def test_a_dispatcher_says_once_that_another_one_leads_and_leaves_no_lease_when_it_is_refused(tmp_path):
    name = str(tmp_path / "ledger.db")
    said = []
    with open_ledger(name) as book:
        lease = book.acquire("dispatch", "another process", 3600.0)

        def say(line):
            said.append(line)
            assert book.led("dispatch")
            book.give_back(lease)

        with pytest.raises(InputError, match="a service without drones"):
            Service(Options(ledger=name, dispatcher="dispatch", folder=tmp_path, begin_s=START.timestamp(), say=say))
        assert not book.led("dispatch")
    assert len(said) == 1
    assert said[0].startswith("another process leads this service")


def test_the_world_of_a_service_that_has_ended_ends_once_it_has_no_participants(tmp_path):
    """Its dispatcher was killed while it waited for the last flights, and ends it no more."""
    name = str(tmp_path / "ledger.db")
    service = ServiceRecord(begin_s=START.timestamp(), folder=str(tmp_path), ledger=name)
    vehicle = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue")
    with open_ledger(name) as book:
        desk = Desk(book, "dispatch")
        desk.put_down("service", "service", "ended", written(service))
        desk.put_down("drone", "d1", "standing", written(DroneRecord(vehicle=vehicle, system=1, place="bellevue", soc=1.0)))  # fmt: skip
    world = threading.Thread(target=simulate, args=(name, "dispatch"), daemon=True)
    world.start()
    world.join(60.0)
    assert not world.is_alive()


def test_an_order_that_arrives_while_the_ledger_is_away_is_on_the_desk_afterwards_and_once(tmp_path):
    name = str(tmp_path / "ledger.db")
    orders = [
        Order(id=f"o{n}", origin="a", destination="b", mass_kg=0.3, ready=START + timedelta(minutes=n), due=START + timedelta(hours=3))
        for n in (40, 20, 0)
    ]  # fmt: skip
    arrivals = Arrivals(orders, notice_s=600.0)
    begin_s = START.timestamp()
    with open_ledger(name, wait_s=0.05) as book:
        desk = Desk(book, "dispatch")
        arrivals.put_down(desk, begin_s)
        assert [one.id for one in desk.entries("order")] == ["o0"]
        other = sqlite3.connect(name, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(LedgerError):
            arrivals.put_down(desk, begin_s + 900.0)
        other.close()
        arrivals.put_down(desk, begin_s + 900.0)
        assert [one.id for one in desk.entries("order")] == ["o0", "o20"]
        assert [one.id for one in arrivals.coming] == ["o40"]
        again = Arrivals(orders, notice_s=None)
        again.put_down(desk, begin_s)
        assert [one.id for one in desk.entries("order")] == ["o0", "o20", "o40"]
        assert again.coming == []
