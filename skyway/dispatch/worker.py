"""A worker: a process that supervises up to `MOST` flights, each in a thread, under leases that it renews.

It takes the flights given to it by the dispatcher, and those of another worker whose lease has expired: they are resumed from their journals.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.dispatch.fleet_winds import FleetWinds
from skyway.dispatch.flight import Flight
from skyway.dispatch.leases import KeptLeases
from skyway.dispatch.records import ACTIVE, FlightRecord, ServiceRecord, read, written
from skyway.dispatch.region import Region
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.ledger import FencedError, VersionError
from skyway.models.ledger.opening import open_ledger
from skyway.sim_stub.transports.lockstep_client import LockstepClient

if TYPE_CHECKING:
    from skyway.models.ledger.desk import Entry

MOST = 50
"""Flights of one worker at a time."""
HEAR_S = 60.0
"""Interval at which it reads the winds measured by drones of other workers, s of the service's time."""
LOOK_S = 5.0
"""Interval at which it looks for new flights, s of the service's time."""
TRY_WALL_S = 0.5
"""Interval of attempts to take over leases of other workers, s of wall time."""
GRACE_S = 60.0
"""Time for which the simulated world continues after a worker was killed, before it waits for a worker that takes
its flights over, s."""
AGAIN_WALL_S = 1.0
ALONE_WALL_S = 60.0
"""Time without a dispatcher after which a worker without flights ends, s of wall time."""


def worker_name(dispatcher: str, number: int) -> str:
    """Return the holder whose lease a worker takes first."""
    return f"{dispatcher}/worker {number}"


class Worker:
    """One worker process."""

    def __init__(self, ledger: str, dispatcher: str, number: int) -> None:
        self.name = worker_name(dispatcher, number)
        self._dispatcher, self._ledger_name = dispatcher, ledger
        self._lock = threading.RLock()
        self._desk = Desk(open_ledger(ledger, create=False), dispatcher)
        found = self._desk.get("service", "service")
        if found is None:
            raise InputError(
                "the ledger has no service of this dispatcher", ledger, remedy="start one: skyway dispatch run"
            )
        self.service = read(found, ServiceRecord)
        self.region = Region(self.service)
        self.leases = KeptLeases(ledger, f"{socket.gethostname()} {os.getpid()}", self.service.ttl_s)
        self.winds = FleetWinds()
        self.cancelled: frozenset[str] = frozenset()
        """Cancelled orders."""
        self._flights: dict[str, Flight] = {}
        self._tried_wall_s = 0.0
        self._heard_s = -HEAR_S
        self._looked_wall_s = self._led_wall_s = time.monotonic()

    def run(self) -> None:
        """Work until the service has ended and all flights are over."""
        world = LockstepClient(self.service.world, self.name, grace_s=GRACE_S)
        try:
            while not self._over():
                self._look()
                self._hear(world.now_s())
                world.sleep_until(world.now_s() + LOOK_S)
        finally:
            world.close()
            self.leases.close()

    def _over(self) -> bool:
        if self._flights:
            return False
        found = self._entry("service", "service")
        if found is not None and found.state == "ended":
            return not self._under_way()
        return self._left_alone()

    def _under_way(self) -> bool:
        """Whether a flight is under way, perhaps of a worker that has died."""
        with self._lock:
            try:
                return bool(self._desk.count("flight", ACTIVE))
            except SkywayError:
                return True  # the database is unavailable

    def _left_alone(self) -> bool:
        """Whether there has been no dispatcher for long: the next one starts new workers."""
        if time.monotonic() < self._looked_wall_s + TRY_WALL_S:
            return False
        self._looked_wall_s = time.monotonic()
        with self._lock:
            try:
                led = self._desk.ledger.led(self._dispatcher)
            except SkywayError:
                return False  # the database is unavailable, not the dispatcher
        if led:
            self._led_wall_s = self._looked_wall_s
        return self._looked_wall_s > self._led_wall_s + ALONE_WALL_S

    def _entry(self, kind: str, id: str) -> Entry | None:  # noqa: A002
        with self._lock:
            try:
                return self._desk.get(kind, id)  # type: ignore[arg-type]
            except SkywayError:
                self._reopen()
                return None

    def _reopen(self) -> None:
        """Reopen the ledger after a loss of its database; flights continue meanwhile until their lease expires."""
        time.sleep(AGAIN_WALL_S)
        try:
            fresh = open_ledger(self._ledger_name, create=False)
        except SkywayError:
            return
        self._desk.ledger.close()
        self._desk = Desk(fresh, self._dispatcher)

    def _hear(self, now_s: float) -> None:
        """Read the winds measured by drones of other workers."""
        if not self._flights or now_s < self._heard_s + HEAR_S:
            return
        self._heard_s = now_s
        with self._lock:
            try:
                entries = self._desk.entries("flight", ACTIVE)
            except SkywayError:
                return  # the database is unavailable: next time
        mine = set(self.leases.holders)
        self.winds.hear(read(one, FlightRecord) for one in entries if one.keeper not in mine)

    def _look(self) -> None:
        """Begin new flights, and take over those without a worker."""
        self._flights = {name: one for name, one in self._flights.items() if one.alive}
        try:
            if self.leases.kept(self.name) is None and not self._flights:
                self._take(self.name)
        except (FencedError, SkywayError):
            pass  # another process has it: wait for its end
        with self._lock:
            try:
                keepers = self._desk.keepers("flight", ACTIVE)
            except SkywayError:
                self._reopen()
                return
        self._hear_cancellations()
        mine = set(self.leases.holders)
        self._take_over(set(keepers.values()) - mine)
        mine = set(self.leases.holders)
        self.leases.give_back(mine - {self.name, *keepers.values()})  # of another worker, with nothing left to do
        for name, keeper in keepers.items():
            if keeper not in mine or name in self._flights or len(self._flights) >= MOST:
                continue
            entry = self._entry("flight", name)
            if entry is not None and entry.keeper == keeper and entry.state in ACTIVE:
                self._flights[name] = Flight(self, entry, read(entry, FlightRecord))
                self._flights[name].start()

    def _hear_cancellations(self) -> None:
        """Read which orders were cancelled, if a drone flies to a package."""
        if any(one.fetches is not None for one in self._flights.values()):
            with self._lock, suppress(SkywayError):  # the database is unavailable: next time
                self.cancelled = frozenset(self._desk.keepers("cancel", ("done",)))

    def _take_over(self, keepers: set[str]) -> None:
        """Take expired leases of other workers, while there is capacity."""
        if not keepers or time.monotonic() < self._tried_wall_s + TRY_WALL_S:
            return
        self._tried_wall_s = time.monotonic()
        for keeper in sorted(keepers):
            if len(self._flights) >= MOST:
                return
            with suppress(FencedError, SkywayError):
                self._take(keeper)

    def _take(self, holder: str) -> None:
        """Take a lease, and the place of its former owner in the simulated world, which need not wait for it any more.

        That owner may not know yet that the lease is lost, and send to the same vehicles: the world is stopped until it does.
        """
        if self.leases.take(holder).token > 1:
            time.sleep(self.leases.noticed_s)
        LockstepClient(self.service.world, holder).close()

    def change(self, entry: Entry, state: str, record: FlightRecord) -> Entry:
        """Write the state of a flight, under the lease of its keeper; a `FencedError`: the lease now belongs to another process."""
        while True:
            lease = self.leases.kept(entry.keeper)
            if lease is None:
                raise FencedError(f"the lease of {entry.keeper} is lost")
            with self._lock:
                try:
                    (after,) = self._desk.put(lease, [replace(entry, state=state, document=written(record))])
                except (FencedError, VersionError):
                    raise
                except SkywayError:
                    self._reopen()
                    continue
            return after

    def folder(self) -> Path:
        """Return the folder of journals."""
        return Path(self.service.folder)


def work(ledger: str, dispatcher: str, number: int) -> None:
    """Run a worker to its end."""
    Worker(ledger, dispatcher, number).run()
