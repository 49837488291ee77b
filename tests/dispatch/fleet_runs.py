"""Fleets that are flown by real processes, which tests kill."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

from benchmarks.fleet.invariants import judge
from skyway.dispatch.records import CLOSED, Board, DroneRecord, FlightRecord, OrderRecord, ServiceRecord, read
from skyway.dispatch.status import status_of
from skyway.models.ledger.audit import audit
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.sim_stub.transports.lockstep_client import LockstepClient

START = datetime(2013, 7, 10, 18, tzinfo=UTC)
ROOT = Path(__file__).parents[2]
LONGEST_S = 600.0


def order_line(name, origin, to, ready_min=0, due_min=180, priority=0, mass=0.3):
    ready, due = (START + timedelta(minutes=one) for one in (ready_min, due_min))
    return f"{name},{origin},{to},{mass},{ready.isoformat()},{due.isoformat()},{priority}\n"


class FleetRun:
    """A service of its own in a folder."""

    def __init__(self, folder, orders, fleet, *more, ledger=None, holder="dispatch"):
        self.folder, self.ledger, self.holder = folder, ledger or str(folder / "ledger.db"), holder
        (folder / "orders.csv").write_text("id,from,to,mass_kg,ready,due,priority\n" + "".join(orders))
        (folder / "fleet.csv").write_text("id,type,home,charge_percent\n" + "".join(fleet))
        self.more = ("--wind", "3@270", "--iterations", "30", "--lease", "1.5", "--no-traffic", *more)
        self.process = None
        self.beside = []

    def start(self, *, orders=True):
        words = [
            "dispatch",
            "run",
            "--simulate",
            "--ledger",
            self.ledger,
            "--depart",
            START.isoformat(),
            "--folder",
            str(self.folder / "flights"),
        ]
        files = (
            ["--orders", str(self.folder / "orders.csv"), "--fleet", str(self.folder / "fleet.csv")] if orders else []
        )
        self.process = self._started([*words, *files, *self.more])

    def start_worker(self):
        """Start one more worker of the first one's name, as a dispatcher does that knows of none."""
        self.beside += [
            self._started(["dispatch", "worker", "--ledger", self.ledger, "--holder", self.holder, "--number", "1"])
        ]

    def _started(self, words):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        with (self.folder / "run.out").open("a") as out:
            return subprocess.Popen([sys.executable, "-m", "skyway", *words], stdout=out, stderr=out, env=environment)

    def look(self, condition, longest_s=LONGEST_S):
        """Wait until a condition of the desk holds; returns what it returned."""
        end = time.monotonic() + longest_s
        while time.monotonic() < end:
            with contextlib.suppress(Exception), open_ledger(self.ledger) as book:
                found = condition(Desk(book, self.holder))
                if found:
                    return found
            if self.process is not None and self.process.poll() not in (None, -signal.SIGKILL):
                raise AssertionError(self.said())
            time.sleep(0.05)
        raise AssertionError(f"not within {longest_s} s: {self.said()}")

    def said(self):
        outputs = [self.folder / "run.out", *sorted((self.folder / "flights").glob("*.out"))]
        return "\n".join(f"{one.name}: {one.read_text()[-3000:]}" for one in outputs if one.exists())

    def workers(self):
        """Process ids of the workers, by their command lines."""
        return self._pids("worker")

    def world(self):
        return self._pids("world")

    def _pids(self, what):
        found = []
        for folder in Path("/proc").iterdir():
            with contextlib.suppress(OSError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if b"dispatch" in words and what.encode() in words and self.ledger.encode() in words:
                    found.append(int(folder.name))
        return found

    def wait(self):
        assert self.process.wait(LONGEST_S) == 0, self.said()

    def stop(self):
        for pid in [
            *(() if self.process is None or self.process.poll() is not None else [self.process.pid]),
            *self.workers(),
            *self.world(),
        ]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for one in self.beside if self.process is None else [*self.beside, self.process]:
            one.wait(10.0)

    def truth(self):
        """Where the vehicles really are."""
        with open_ledger(self.ledger) as book:
            service = read(Desk(book, self.holder).get("service", "service"), ServiceRecord)
        client = LockstepClient(service.world, "test")
        try:
            return client.order("look")
        finally:
            client.close()

    def order_to_world(self, do, **what):
        with open_ledger(self.ledger) as book:
            service = read(Desk(book, self.holder).get("service", "service"), ServiceRecord)
        client = LockstepClient(service.world, "test")
        try:
            client.order(do, **what)
        finally:
            client.close()

    def status(self):
        with open_ledger(self.ledger) as book:
            return status_of(Desk(book, self.holder))

    def audit(self):
        with open_ledger(self.ledger) as book:
            return audit(book)


def flying(desk, phase="with the package", least=1):
    """Flights in the air with a package."""
    found = Board(desk).read("flight", FlightRecord, ("flying",))
    inside = [
        name
        for name, (_, one) in found.items()
        if one.phase == phase and one.progress is not None and one.progress.state == "flying"
    ]
    return inside if len(inside) >= least else []


def nothing_is_forgotten(run):
    """Every order is closed, every drone stands where it is thought to, nothing is booked twice or left booked."""
    status = run.status()
    assert all(state in CLOSED for state, _ in status.orders.values()), {
        name: state for name, (state, _) in status.orders.items()
    }
    assert all(one.reason for state, one in status.orders.values() if state != "delivered")
    assert run.audit() == []
    assert judge(run.ledger, run.holder).wrong == []
    assert status.holds == []
    assert not status.flights
    return status


__all__ = ["START", "DroneRecord", "FleetRun", "OrderRecord", "flying", "nothing_is_forgotten", "order_line"]
