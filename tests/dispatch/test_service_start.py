"""How a service begins and ends: who leads it, and what it leaves."""

import sqlite3
import threading
from dataclasses import replace
from datetime import timedelta

import pytest
from fleet_runs import START

from skyway.cli.main import main
from skyway.dispatch.records import (
    WITH_PACKAGE,
    DroneRecord,
    FlightRecord,
    OrderRecord,
    PlanStep,
    ServiceRecord,
    read,
    written,
)
from skyway.dispatch.requests import Arrivals, put_order
from skyway.dispatch.service import Options, Service
from skyway.dispatch.simulation import simulate
from skyway.models.base.errors import InputError
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.ledger import LedgerError
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window
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


STEP = PlanStep(
    kind="fly", origin="bellevue", destination="jacobi", begin_s=START.timestamp(), end_s=START.timestamp() + 900.0, soc_begin=0.6, soc_end=0.4
)  # fmt: skip


def test_what_a_killed_dispatcher_left_of_a_service_that_has_ended_is_closed_once(tmp_path, capsys):
    """Without a world any more: one of its drones flew when it ended."""
    name = str(tmp_path / "ledger.db")
    service = ServiceRecord(
        begin_s=START.timestamp(), folder=str(tmp_path), ledger=name, wind="3@270", world="127.0.0.1:1"
    )
    vehicle = Vehicle(id="d1", type="m200", home="bellevue", place="bellevue")
    order = Order(
        id="o1", origin="bellevue", destination="jacobi", mass_kg=0.3, ready=START, due=START + timedelta(hours=3)
    )
    stay = Window(station="bellevue", pad=1, start=START + timedelta(hours=1), end=START + timedelta(hours=2))
    with open_ledger(name) as book:
        desk = Desk(book, "dispatch")
        desk.put_down("service", "service", "ended", written(service))
        desk.put_down("drone", "d1", "standing", written(DroneRecord(vehicle=vehicle, system=1, place="bellevue", soc=1.0)))  # fmt: skip
        put_order(desk, order)
        flown = FlightRecord(
            drone="d2", type="m200", system=2, order="o2", phase=WITH_PACKAGE, mass_kg=0.3, composition={}, steps=(STEP,), not_before_s=0.0,
            journal="1.jsonl",
        )  # fmt: skip
        two = DroneRecord(vehicle=replace(vehicle, id="d2"), system=2, place="bellevue", soc=1.0, flight="000001 d2")
        desk.put_down("drone", "d2", "flying", written(two))
        desk.put_down("flight", "000001 d2", "flying", written(flown))
        aboard = OrderRecord(order=replace(order, id="o2"), place="bellevue", drone="d2")
        desk.put_down("order", "o2", "under way", written(aboard))
        lease = book.acquire("dispatch", "the one that was killed")
        book.book(lease, "dispatch: o1", [stay])
        book.give_back(lease)
        assert main(["dispatch", "status", "--ledger", name]) == 0
        assert "the dispatcher died before it closed all orders" in capsys.readouterr().out
        options = Options(ledger=name, dispatcher="dispatch", folder=tmp_path, begin_s=START.timestamp())
        Service(options).run()
        assert [(one.state, read(one, OrderRecord).reason) for one in desk.entries("order")] == [
            ("refused", "the service ended before its flight"),
            ("handed to a person", "d2, not supervised: the simulated world has ended"),
        ]
        assert [one.state for one in desk.entries("drone")] == ["standing", "lost"]
        assert [one.state for one in desk.entries("flight")] == ["closed"]
        assert book.holds() == []
        assert not book.led("dispatch")
        assert main(["dispatch", "status", "--ledger", name]) == 0
        assert "died" not in capsys.readouterr().out
        with pytest.raises(InputError, match="has ended"):
            Service(options)
