"""A small fleet flown end to end by real processes; a worker is killed while its drone is in the air."""

import os
import signal

import pytest
from fleet_runs import FleetRun, flying, nothing_is_forgotten, order_line


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced_and_its_flight_goes_on(tmp_path):
    orders = [order_line("one", "bellevue", "nyu-brooklyn"), order_line("two", "nyu-brooklyn", "bellevue", ready_min=5)]
    run = FleetRun(tmp_path, orders, ["d1,m200,bellevue,100\n", "d2,m200,nyu-brooklyn,100\n"])
    try:
        run.start()
        (name, *_) = run.look(flying)
        (worker,) = run.workers()
        os.kill(worker, signal.SIGKILL)
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    assert {state for state, _ in status.orders.values()} == {"delivered"}, run.said()
    journal = next(one for one in (tmp_path / "flights").glob("*.jsonl") if one.stem in name)
    assert '"event":"resume"' in journal.read_text()
    assert "worker 1 has died" in run.said()


@pytest.mark.slow
def test_a_service_that_ends_at_its_time_closes_the_orders_that_it_has_not_begun(tmp_path):
    orders = [order_line(name, "bellevue", "nyu-brooklyn", due_min=300) for name in ("one", "two")]
    run = FleetRun(tmp_path, orders, ["d1,m200,bellevue,100\n"], "--hours", "0.1")
    try:
        run.start()
        run.wait()
    finally:
        run.stop()
    status = nothing_is_forgotten(run)
    ends = {state: one.reason for state, one in status.orders.values()}
    assert ends == {"delivered": "", "refused": "the service ended before its flight"}
