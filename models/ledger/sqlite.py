"""The ledger in a file: SQLite with a write-ahead log, for the processes of one machine."""

from __future__ import annotations

import random
import sqlite3
import time
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError
from skyway.models.ledger.ledger import WAIT_S, Ledger, LedgerError, TakenError
from skyway.models.ledger.migrating import FOLDER, missing, refuse_none, scripts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

APPLICATION = 0x5C79_1ED6
"""Mark of our files, as SQLite's ``application_id``."""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)
LOG_BYTES = 40_000_000
"""Size of the log at which it is copied into the file, which waits for the disk."""
LOG_WAIT_S = 1.0
"""How long the copy waits for a time without transactions."""
RETRY_S, RETRY_GROWTH, MAX_RETRY_S = 0.004, 1.2, 0.016
"""Longest time between the first two attempts to begin one, its growth factor, and its limit: frequent attempts take processor time from the
process that is waited for, if processors are few."""


class SqliteLedger(Ledger):
    """A ledger in a file; a missing file is created."""

    NOW = "CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000"
    LOCK = SHARE = ""  # a writer has exclusive access

    def __init__(self, path: Path, *, migrations: Path = FOLDER, create: bool = True, wait_s: float = WAIT_S) -> None:
        super().__init__()
        self._name, self._wait_s = str(path), wait_s
        self._log, self._log_limit = Path(f"{path}-wal"), LOG_BYTES
        if not path.parent.is_dir():
            raise InputError("no such folder", str(path.parent), remedy="create it first")
        try:
            self._connection = sqlite3.connect(path, timeout=wait_s, isolation_level=None, check_same_thread=False)
            self._open(scripts("sqlite", migrations), create=create)
        except sqlite3.Error as error:
            with suppress(AttributeError):
                self._connection.close()
            if "locked" in str(error):
                raise self._refused(error) from error
            raise InputError(f"cannot be used as a ledger: {error}", self._name, remedy=_remedy(path, error)) from error
        except BaseException:
            self._connection.close()
            raise

    def _open(self, known: list[str], *, create: bool) -> None:
        run = self._connection.execute
        mark, version = run("PRAGMA application_id").fetchone()[0], run("PRAGMA user_version").fetchone()[0]
        if mark not in (0, APPLICATION) or (
            mark == 0 and run("SELECT COUNT(*) FROM sqlite_master").fetchone()[0] and not version
        ):
            raise InputError("is a database, but no ledger", self._name, remedy="name another file")
        if not create:
            refuse_none(version, self._name)
        run("PRAGMA journal_mode = WAL")
        run("PRAGMA synchronous = NORMAL")  # a killed process loses nothing; a power failure may lose the latest data
        run("PRAGMA wal_autocheckpoint = 0")  # `_put_log_away` does it
        run("PRAGMA foreign_keys = ON")
        run("PRAGMA busy_timeout = 0")  # `_begin` waits
        if version < len(known) or version > len(known):
            with self.transaction():
                version = run("PRAGMA user_version").fetchone()[0]
                for number, sql in missing(version, known, self._name):
                    for statement in _statements(sql):
                        run(statement)
                    run(f"PRAGMA user_version = {number}")
                run(f"PRAGMA application_id = {APPLICATION}")

    @property
    def version(self) -> int:
        """Version of its tables."""
        return int(self._connection.execute("PRAGMA user_version").fetchone()[0])

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Run one statement and return its rows."""
        return self._connection.execute(sql, tuple(values)).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Run a block as one transaction."""
        with self._block("BEGIN IMMEDIATE"):
            yield
        self._put_log_away()

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Run a block of reads on one state: the last that was committed, so it need not wait for a writer."""
        with self._block("BEGIN", "SELECT COUNT(*) FROM sqlite_master"):
            yield

    @contextmanager
    def _block(self, *begin: str) -> Iterator[None]:
        pads = dict(self._pads)
        try:
            self._begin(begin)
            yield
            self._connection.execute("COMMIT")
        except BaseException as error:
            self._pads = pads
            with suppress(sqlite3.Error):
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
            if isinstance(error, sqlite3.IntegrityError) and ("taken" in str(error) or "pad_key" in str(error)):
                raise TakenError from None
            if isinstance(error, sqlite3.Error):
                raise self._refused(error) from error
            raise

    def _refused(self, error: sqlite3.Error) -> LedgerError:
        if "locked" not in str(error):
            return LedgerError(f"the ledger {self._name} refuses: {error}")
        remedy = "try again, or end the process that has the file open for writing"
        return LedgerError(
            f"the ledger {self._name} is locked: another process has been writing to it for {self._wait_s:g} s; {remedy}"
        )

    def _begin(self, statements: Sequence[str]) -> None:
        """Begin a transaction as soon as no other process prevents it.

        SQLite's own waiting sleeps up to 0.1 s at a time, enough for hundreds of other bookings.
        """
        end, longest_s = time.monotonic() + self._wait_s, RETRY_S
        while True:
            try:
                for one in statements:
                    self._connection.execute(one)
            except sqlite3.OperationalError as error:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                if "locked" not in str(error) or time.monotonic() >= end:
                    raise
                time.sleep(longest_s * random.random())  # noqa: S311  no secret
                longest_s = min(RETRY_GROWTH * longest_s, MAX_RETRY_S)
            else:
                return

    def _put_log_away(self) -> None:
        """Copy a log that has grown into the file, and truncate it.

        SQLite's own checkpoints do not wait for other processes. Under constant writes none of them reaches the end of the log: it grows without bound, each
        commit beyond the limit tries again and waits for the disk, and each read searches the whole of it. So while one process copies, the others that
        find the log too long wait with their next transaction.
        """
        size, end = self._log_size(), time.monotonic() + LOG_WAIT_S
        if size < self._log_limit:
            return
        self._log_limit = LOG_BYTES
        while not self._copied():
            if time.monotonic() >= end:
                self._log_limit += size
                return
            time.sleep(RETRY_S)
            size = self._log_size()
            if size < LOG_BYTES:  # another process has truncated it
                return

    def _log_size(self) -> int:
        try:
            return self._log.stat().st_size
        except FileNotFoundError:
            return 0

    def _copied(self) -> bool:
        """Whether the log could be copied to its end and truncated; if another process does it, the answer is immediate."""
        run = self._connection.execute
        run(f"PRAGMA busy_timeout = {round(1000 * LOG_WAIT_S)}")
        try:
            return not run("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
        except sqlite3.OperationalError:
            return False
        finally:
            run("PRAGMA busy_timeout = 0")

    def _to_db(self, instant: datetime) -> int:
        return (instant - EPOCH) // MICROSECOND

    def from_db(self, value: Any) -> datetime:
        """Return an instant that the database keeps."""
        return EPOCH + int(value) * MICROSECOND

    def _later(self) -> str:
        return f"{self.NOW} + CAST(? * 1000000.0 AS INTEGER)"

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _remedy(path: Path, error: sqlite3.Error) -> str:
    """Return what to do about a file that cannot be opened: SQLite does not say why."""
    if path.is_dir():
        return "it is a folder: name a file in it"
    if "unable to open" in str(error) or "readonly" in str(error):
        return "file and folder must be writable, also to read it: copy it to a folder that is"
    return ""


def _statements(sql: str) -> Iterator[str]:
    """Yield the statements of a script one by one, since running it whole would end the transaction."""
    text = ""
    for line in sql.splitlines():
        text += line + "\n"
        if sqlite3.complete_statement(text):
            yield text
            text = ""
