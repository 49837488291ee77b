"""Opening ledgers: migrated, or refused in one clear line; and what guards the history from within."""

import re
import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from ledgers import opened, postgresql_name, server_address, window

from skyway.models.base.errors import InputError
from skyway.models.ledger import postgresql
from skyway.models.ledger import sqlite as sqlite_module
from skyway.models.ledger.audit import audit
from skyway.models.ledger.ledger import Event, LedgerError, TakenError
from skyway.models.ledger.migrating import scripts
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.postgresql import PostgresqlLedger
from skyway.models.ledger.sqlite import SqliteLedger
from skyway.models.ledger.window import p_both


@pytest.fixture
def one_more_version(tmp_path):
    """Migrations with one version more than skyway has, in a folder of their own."""
    folder = tmp_path / "migrations"
    folder.mkdir()
    for dialect in ("sqlite", "postgresql"):
        known = scripts(dialect)
        for number, sql in enumerate((*known, "CREATE TABLE note (text TEXT);\n"), 1):
            (folder / f"{dialect}-{number:04d}.sql").write_text(sql, encoding="utf-8")
    return folder


def of_newest_version(store, tmp_path, folder):
    """Make a ledger with a booking, then open it with one version more; returns how it is opened now."""
    name = str(tmp_path / "ledger.db") if store == "sqlite" else postgresql_name()
    with open_ledger(name) as ledger:
        ledger.book(ledger.acquire("operator", "process"), "one", [window()])
    if store == "sqlite":
        return name, SqliteLedger(tmp_path / "ledger.db", migrations=folder)
    return name, PostgresqlLedger(name, migrations=folder)


@pytest.mark.parametrize("store", ["sqlite", "postgresql"])
def test_an_older_ledger_is_migrated_and_a_newer_one_refused(store, tmp_path, one_more_version):
    name, ledger = of_newest_version(store, tmp_path, one_more_version)
    with ledger:
        newest = len(scripts(store))
        assert ledger.version == newest + 1
        assert [hold.itinerary for hold in ledger.holds()] == ["one"]
        assert audit(ledger) == []
    with pytest.raises(
        InputError, match=f"the ledger has version {newest + 1}, this skyway knows {newest}; update skyway"
    ):
        open_ledger(name)


@pytest.mark.parametrize("store", ["sqlite", "postgresql"])
def test_windows_of_an_older_ledger_are_found_after_its_migration(store, tmp_path):
    folder = tmp_path / "migrations"
    folder.mkdir()
    for number, sql in enumerate(scripts(store)[:3], 1):
        (folder / f"{store}-{number:04d}.sql").write_text(sql, encoding="utf-8")
    name = str(tmp_path / "ledger.db") if store == "sqlite" else postgresql_name()
    older = (
        SqliteLedger(Path(name), migrations=folder) if store == "sqlite" else PostgresqlLedger(name, migrations=folder)
    )
    one = window(length_min=5 * 24 * 60)
    times = "(timestamptz '2026-07-10 12:00+00', timestamptz '2026-07-15 12:00+00')"
    if store == "sqlite":
        times = str((int(one.start.timestamp()) * 10**6, int(one.end.timestamp()) * 10**6))
    with older, older.transaction():
        older.rows(
            "INSERT INTO lease (holder, token, owner, expires) SELECT 'operator', 1, 'process', column2 FROM (VALUES "
            + times
            + ") AS found"
        )
        older.rows("INSERT INTO pad (station, number) VALUES ('a', 1)")
        older.rows("INSERT INTO itinerary (id, version, holder) VALUES ('days', 1, 'operator')")
        older.rows(
            "INSERT INTO booking (itinerary, version, number, station, pad, pad_key, starts, ends, opens, closes, core_from, core_until, "
            "start_sd_s, end_sd_s, epsilon, state, holder, token) SELECT 'days', 1, 1, 'a', 1, (SELECT key FROM pad), column1, column2, "
            "column1, column2, column1, column2, 0, 0, 0, 'firm', 'operator', 1 FROM (VALUES " + times + ") AS found"
        )
    with open_ledger(name) as ledger:
        lease = ledger.acquire("another", "process")
        with pytest.raises(TakenError, match="days"):
            ledger.book(lease, "one", [window(begin_min=10)])
        assert [hold.window for hold in ledger.holds()] == [one]


def test_every_version_of_one_store_is_one_of_the_other():
    assert len(scripts("sqlite")) == len(scripts("postgresql")) > 0


def test_reading_a_ledger_that_does_not_exist_creates_none(tmp_path):
    missing = tmp_path / "ledgre.db"
    with pytest.raises(InputError, match=r"ledgre\.db: no such file"):
        open_ledger(str(missing), create=False)
    assert list(tmp_path.iterdir()) == []
    open_ledger(str(missing)).close()
    open_ledger(str(missing), create=False).close()


def test_what_is_no_ledger_is_refused(tmp_path):
    (tmp_path / "text.db").write_text("no database, but long enough to be looked at " * 10)
    with sqlite3.connect(tmp_path / "other.db") as other:
        other.execute("CREATE TABLE mine (x)")
    other.close()
    for name, said in {
        str(tmp_path / "text.db"): "cannot be used as a ledger: file is not a database",
        str(tmp_path / "other.db"): "is a database, but no ledger",
        str(tmp_path / "no" / "ledger.db"): "no such folder",
        str(tmp_path): "cannot be used as a ledger: .*; it is a folder: name a file in it",
        "mysql://host/base": "is not a ledger",
    }.items():
        with pytest.raises(InputError, match=said) as caught:
            open_ledger(name)
        assert "\n" not in str(caught.value)


def test_a_database_that_cannot_be_reached_or_used(tmp_path):
    with pytest.raises(LedgerError, match="cannot be reached") as caught:
        open_ledger(f"postgresql://me:secret@/ledger?host={tmp_path}")
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_database_without_rights(tmp_path):
    import psycopg

    name = postgresql_name()
    schema = re.search(r"(s[0-9a-f]{12})$", name)[1]
    role = f"r{schema}"
    with psycopg.connect(server_address(), autocommit=True) as connection:
        connection.execute(f"CREATE ROLE {role} LOGIN")
        connection.execute(f"GRANT USAGE ON SCHEMA {schema} TO {role}")
    with pytest.raises(InputError, match="cannot be used as a ledger: permission denied for schema") as caught:
        open_ledger(name.replace("postgres:@", f"{role}@"))
    assert "\n" not in str(caught.value)


def test_a_database_that_goes_away_books_nothing_by_halves():
    import psycopg

    name = postgresql_name()
    with open_ledger(name) as ledger, psycopg.connect(server_address(), autocommit=True) as other:
        lease = ledger.acquire("operator", "process")
        ledger.book(lease, "one", [window()])
        cut = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE backend_type = 'client backend' AND pid <> pg_backend_pid()"
        assert other.execute(cut).rowcount
        with pytest.raises(LedgerError, match="went away"):
            ledger.book(lease, "two", [window("b"), window("c")])
    with open_ledger(name) as ledger:
        assert {hold.itinerary for hold in ledger.holds()} == {"one"}
        assert audit(ledger) == []


@pytest.mark.parametrize("store", ["sqlite", "postgresql"])
@pytest.mark.parametrize("sql", ["DELETE FROM history", "UPDATE history SET state = 'firm'", "DELETE FROM booking", "UPDATE booking SET starts = ends"])  # fmt: skip
def test_the_database_itself_guards_the_history(store, tmp_path, sql):
    with opened(store, tmp_path) as ledger:
        ledger.book(ledger.acquire("operator", "process"), "one", [window()])
        with pytest.raises(LedgerError, match=r"only appended to|are released|changes its state alone"), ledger.transaction():  # fmt: skip
            ledger.rows(sql)
        assert audit(ledger) == []


@pytest.mark.parametrize("store", ["sqlite", "postgresql"])
def test_the_database_itself_refuses_an_overlap(store, tmp_path, monkeypatch):
    """Without our own rule, too: two programs may have different ones."""
    monkeypatch.setattr("skyway.models.ledger.ledger.in_the_way", lambda *_: [])
    with opened(store, tmp_path) as ledger:
        lease = ledger.acquire("operator", "process")
        ledger.book(lease, "one", [window()])
        with pytest.raises(Exception, match="nothing was booked: somebody else booked first"):
            ledger.book(lease, "two", [window(begin_min=29)])


class Forged:
    """A ledger that tells what it is given."""

    def __init__(self, events, holds):
        self.events, self.held = events, holds

    def history(self, *, after=0, limit=0):
        return [one for one in self.events if one.seq > after]

    def holds(self):
        return self.held


def test_the_audit_finds_what_must_not_be(tmp_path):
    with opened("sqlite", tmp_path) as ledger:
        lease = ledger.acquire("operator", "process")
        ledger.book(lease, "one", [window()])
        ledger.book(lease, "two", [window("b")])
        ledger.mark(lease, "two", "released")
        events, holds = ledger.history(), ledger.holds()
    assert audit(Forged(events, holds)) == []
    overlapping = replace(events[0].hold, itinerary="three")
    assert "overlaps another" in audit(Forged([*events, Event(9, events[0].at, overlapping)], holds))[0]
    assert "window 1: lost" in audit(Forged(events, []))[0]
    assert "not in the history" in audit(Forged(events[1:], holds))[0]
    back = Event(9, events[0].at, replace(events[-1].hold, state="firm"))
    assert "from released to firm" in audit(Forged([*events, back], holds))[0]
    second = Event(9, events[0].at, replace(events[0].hold, itinerary="half", number=2, window=window("c")))
    assert any("half version 1 is not whole" in one for one in audit(Forged([*events, second], [*holds, second.hold])))


def test_the_chance_that_both_want_a_pad_is_that_of_a_simulation():
    import numpy as np

    rng = np.random.default_rng(7)
    one = window("a", 1, 0, 30, start_sd_s=240.0, end_sd_s=420.0, epsilon=0.2)
    for begin in (10.0, 25.0, 33.0, 45.0):
        other = window("a", 1, begin, 20, start_sd_s=300.0, end_sd_s=60.0, epsilon=0.2)
        start = rng.normal(0.0, 240.0, 200_000), rng.normal(60.0 * begin, 300.0, 200_000)
        end = rng.normal(1800.0, 420.0, 200_000), rng.normal(60.0 * begin + 1200.0, 60.0, 200_000)
        both = float(np.mean((start[0] < end[1]) & (start[1] < end[0])))
        assert p_both(one, other) == pytest.approx(both, abs=0.005)


def test_the_audit_finds_what_touches_days_after_it_began(tmp_path):
    with opened("sqlite", tmp_path) as ledger:
        lease = ledger.acquire("operator", "process")
        ledger.book(lease, "long", [window(length_min=3 * 1440)])
        ledger.book(lease, "after", [window(begin_min=3 * 1440)])
        events, holds = ledger.history(), ledger.holds()
    assert audit(Forged(events, holds)) == []
    inside = replace(events[1].hold, itinerary="inside", window=window(begin_min=2 * 1440))
    found = audit(Forged([*events, Event(9, events[0].at, inside)], [*holds, inside]))
    assert len(found) == 1
    assert "inside version 1 window 1: overlaps another" in found[0]


def test_the_log_of_a_busy_ledger_does_not_grow_without_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(sqlite_module, "LOG_BYTES", 300_000)
    path, largest = tmp_path / "ledger.db", []
    open_ledger(str(path)).close()

    def work(thread):
        with open_ledger(str(path)) as mine:
            lease = mine.acquire(f"operator {thread}", "process")
            for number in range(60):
                mine.book(lease, f"{thread}-{number}", [window(pad=thread, begin_min=40.0 * number)])
                with suppress(FileNotFoundError):
                    largest.append(path.with_name("ledger.db-wal").stat().st_size)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(1, 5)))
    assert max(largest) < 2 * 300_000
    with open_ledger(str(path)) as ledger:
        assert len(ledger.holds()) == 240
        assert audit(ledger) == []


def test_a_client_that_takes_its_time_over_what_it_read_keeps_its_connection(monkeypatch):
    """The whole history is read in one transaction by a busy machine: only a statement without an answer means that the server is lost."""
    monkeypatch.setattr(postgresql, "ANSWER_S", 1.0)
    monkeypatch.setattr(postgresql, "LOOK_S", 0.02)
    with open_ledger(postgresql_name()) as ledger:
        with ledger.transaction():
            assert ledger.rows("SELECT 1") == [(1,)]
            end = time.monotonic() + 1.5
            while time.monotonic() < end:
                pass
        assert ledger.holds() == []


def test_a_locked_file_is_read_and_a_write_names_the_lock_in_time(tmp_path):
    name = str(tmp_path / "ledger.db")
    with open_ledger(name) as ledger:
        ledger.book(ledger.acquire("operator", "process"), "one", [window()])
    other = sqlite3.connect(name, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        with open_ledger(name, create=False, wait_s=0.05) as ledger:
            assert [hold.itinerary for hold in ledger.holds()] == ["one"]
            assert ledger.led("operator")
            assert audit(ledger) == []
            with pytest.raises(
                LedgerError, match=r"is locked: another process has been writing to it for 0\.05 s; try again"
            ):
                ledger.acquire("another", "process")
    finally:
        other.close()


def test_a_lock_of_another_session_is_named_and_the_connection_goes_on(monkeypatch):
    import psycopg

    monkeypatch.setattr(postgresql, "LOCK_S", 0.1)
    name = postgresql_name()
    with open_ledger(name) as ledger:
        with psycopg.connect(name) as other:
            other.execute("LOCK TABLE lease")
            with pytest.raises(LedgerError, match=r"is locked: another session has had a lock for 0\.1 s; try again"):
                ledger.acquire("operator", "process")
        assert ledger.acquire("operator", "process").token == 1


def test_a_read_sees_one_state_while_another_process_writes(tmp_path):
    with opened("sqlite", tmp_path) as ledger, opened("sqlite", tmp_path) as other:
        lease = other.acquire("operator", "process")
        with ledger.reading():
            before = ledger.rows("SELECT COUNT(*) FROM booking")
            other.book(lease, "one", [window()])
            assert ledger.rows("SELECT COUNT(*) FROM booking") == before == [(0,)]
        assert len(ledger.holds()) == 1


@pytest.mark.parametrize("store", ["sqlite", "postgresql"])
def test_reading_a_database_without_a_ledger_creates_none(store, tmp_path):
    name = str(tmp_path / "ledger.db") if store == "sqlite" else postgresql_name()
    (tmp_path / "ledger.db").touch()
    with pytest.raises(InputError, match="has no ledger; name the ledger of a running dispatcher"):
        open_ledger(name, create=False)
    assert (tmp_path / "ledger.db").read_bytes() == b""
    with pytest.raises(InputError, match="has no ledger"):
        open_ledger(name, create=False)


@pytest.mark.parametrize(
    "name",
    [
        "postgresql://me:sec@ret@host/ledger", "postgresql://me:sec/ret@host/ledger", "postgresql://me:sec#ret@host/ledger", "POSTGRESQL://me:secret@host/ledger",
        "postgresql://me@host.invalid/ledger?password=secret&connect_timeout=1",
    ],
)  # fmt: skip
def test_no_part_of_a_password_is_told(name):
    with pytest.raises((InputError, LedgerError)) as caught:
        open_ledger(name)
    assert "sec" not in str(caught.value)
    assert "ret" not in str(caught.value)
    assert "me@host" in str(caught.value)
