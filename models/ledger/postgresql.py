"""The ledger in PostgreSQL 15 or newer: for several machines and operators."""

from __future__ import annotations

import os
import socket
import threading
import time
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError, one_line
from skyway.models.base.formatting import duration
from skyway.models.ledger.address import without_password
from skyway.models.ledger.ledger import Ledger, LedgerError, TakenError
from skyway.models.ledger.migrating import FOLDER, missing, refuse_none, scripts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

LEAST_VERSION = 150_000
MAX_CLOCK_OFFSET_S = 30.0
"""Difference of the database's clock from this computer's: drones fly by the latter, pads are booked by the former."""
CONNECT_S = 10
ANSWER_S = 15.0
"""A server that has not answered for this long is considered lost: on a broken network the wait would take minutes."""
LOCK_S = 10.0
"""Longest wait for a lock that another session has: less than `ANSWER_S`, so that the error says so."""
LOOK_S = 1.0
MIGRATING = 0x5C79_1ED6
"""Advisory lock of migrations."""


class PostgresqlLedger(Ledger):
    """A ledger in a database; missing tables are created."""

    NOW = "clock_timestamp()"
    LOCK = "FOR UPDATE"
    SHARE = "FOR SHARE"

    def __init__(self, address: str, *, migrations: Path = FOLDER, create: bool = True) -> None:
        import psycopg

        super().__init__()
        self._psycopg = psycopg
        self._name = without_password(address)
        try:
            self._connection = psycopg.connect(address, connect_timeout=CONNECT_S, autocommit=True)
        except psycopg.Error as error:
            raise LedgerError(one_line(f"the ledger {self._name} cannot be reached: {error}")) from error
        self._asked_s: float | None = None
        self._silent = False
        threading.Thread(target=self._watch, daemon=True, name="ledger").start()
        try:
            self._check_server()
            if not create:
                refuse_none(self.version, self._name)
            self._migrate(scripts("postgresql", migrations))
            self._connection.execute(f"SET lock_timeout = {round(1000 * LOCK_S)}")
        except psycopg.Error as error:
            self.close()
            raise InputError(f"cannot be used as a ledger: {_said(error)}", self._name) from error
        except BaseException:
            self.close()
            raise

    def _check_server(self) -> None:
        """Refuse a server that is too old, or whose clock is off."""
        if self._connection.info.server_version < LEAST_VERSION:
            found = self._connection.info.server_version // 10_000
            raise InputError(f"is PostgreSQL {found}", self._name, remedy="PostgreSQL 15 or newer")
        off_s = (self.now() - datetime.now(UTC)).total_seconds()
        if abs(off_s) > MAX_CLOCK_OFFSET_S:
            how = f"{duration(abs(off_s))} {'ahead of' if off_s > 0 else 'behind'}"
            problem = f"the clock of the database is {how} this computer's"
            raise InputError(problem, self._name, remedy="set the one that is wrong")

    def _migrate(self, known: list[str]) -> None:
        if self.version == len(known):
            return
        with self._connection.transaction():
            run = self._connection.execute
            run(f"SELECT pg_advisory_xact_lock({MIGRATING})")
            run("CREATE TABLE IF NOT EXISTS ledger_version (number integer PRIMARY KEY, at timestamptz DEFAULT now())")
            for number, sql in missing(self.version, known, self._name):
                run(sql)
                run("INSERT INTO ledger_version (number) VALUES (%s)", (number,))

    @property
    def version(self) -> int:
        """Version of its tables; 0 if there are none."""
        run = self._connection.execute
        if run("SELECT to_regclass('ledger_version')").fetchone() == (None,):
            return 0
        found = run("SELECT COALESCE(MAX(number), 0) FROM ledger_version").fetchone()
        return 0 if found is None else int(found[0])

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Run one statement and return its rows."""
        self._asked_s = time.monotonic()
        try:
            done = self._connection.execute(sql.replace("?", "%s"), tuple(values))
        finally:
            self._asked_s = None
        return done.fetchall() if done.description else []

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Run a block as one transaction."""
        errors = self._psycopg.errors
        pads = dict(self._pads)
        try:
            self._asked_s = time.monotonic()
            with self._connection.transaction():
                self._asked_s = None
                try:
                    yield
                finally:
                    self._asked_s = time.monotonic()
        except (errors.ExclusionViolation, errors.DeadlockDetected, errors.UniqueViolation):
            self._pads = pads
            raise TakenError from None
        except errors.LockNotAvailable as error:
            self._pads = pads
            problem = (
                f"is locked: another session has had a lock for {LOCK_S:g} s; try again, or end that session (pg_locks)"
            )
            raise LedgerError(f"the ledger {self._name} {problem}") from error
        except self._psycopg.OperationalError as error:
            self._pads = pads
            if self._silent:
                problem = (
                    f"has not answered for {ANSWER_S:g} s: its server is overloaded or stopped, or the network is cut"
                )
                raise LedgerError(f"the ledger {self._name} {problem}") from error
            raise LedgerError(f"the ledger {self._name} went away: {_said(error)}") from error
        except self._psycopg.Error as error:
            self._pads = pads
            raise LedgerError(f"the ledger {self._name} refuses: {_said(error)}") from error
        except BaseException:
            self._pads = pads
            raise
        finally:
            self._asked_s = None

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Run a block of reads as one transaction."""
        with self.transaction():
            yield

    def _watch(self) -> None:
        """Close the connection if a statement is not answered: the waiting caller then gets an error.

        The time that the caller takes for its rows, and between statements, does not count.
        """
        while not self._connection.closed:
            asked_s = self._asked_s
            if asked_s is not None and time.monotonic() > asked_s + ANSWER_S:
                with (
                    suppress(OSError, self._psycopg.Error),
                    socket.socket(fileno=os.dup(self._connection.fileno())) as same,
                ):
                    self._silent = True
                    same.shutdown(socket.SHUT_RDWR)
                return
            time.sleep(LOOK_S)

    def _to_db(self, instant: datetime) -> datetime:
        return instant

    def from_db(self, value: Any) -> datetime:
        """Return an instant that the database keeps."""
        found: datetime = value
        return found.astimezone(UTC)

    def _later(self) -> str:
        return f"{self.NOW} + ? * interval '1 second'"

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _said(error: Exception) -> str:
    return one_line((str(error).strip().splitlines() or [type(error).__name__])[0])
