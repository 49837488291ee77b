"""The service: started, or resumed from its desk, with its workers and, in a simulation, its world."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.calibration_flight import drag_of
from skyway.dispatch.dispatcher.dispatcher import Dispatcher
from skyway.dispatch.leases import KeptLeases
from skyway.dispatch.records import ACTIVE, OPEN, Board, DroneRecord, End, FlightRecord, ServiceRecord, read, written
from skyway.dispatch.region import Region
from skyway.dispatch.requests import Arrivals, refuse_ended
from skyway.dispatch.simulation import ADDRESS, claim_folder
from skyway.dispatch.status import status_of
from skyway.dispatch.worker import worker_name
from skyway.flights.starting import start
from skyway.models.base.errors import InputError, LinkLostError, SkywayError
from skyway.models.ledger.address import without_password
from skyway.models.ledger.desk import Desk, Entry
from skyway.models.ledger.ledger import FencedError, LedgerError, TakenError, VersionError
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.fitting import fit
from skyway.sim_stub.transports.lockstep_client import LockstepClient, LockstepPads

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable, Sequence

    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.drone import Drone
    from skyway.models.ledger.ledger import Lease
    from skyway.models.orders.order import Order, Vehicle

EVERY_S = 10.0
"""Interval of the dispatcher's steps, s of the service's time."""
GRACE_S = 120.0
"""Time for which the simulated world continues after the dispatcher was killed, before it waits for the next one, s."""
WORLD_WALL_S = 60.0
"""Longest wait until a simulated world answers, s of wall time."""
TAKE_OVER_WALL_S = 120.0
"""Longest wait of a dispatcher for the lease of one that has died, s of wall time."""


@dataclass(frozen=True)
class Options:
    """Options of a service, started or resumed."""

    ledger: str
    dispatcher: str
    folder: Path
    begin_s: float
    orders: Sequence[Order] = ()
    fleet: Sequence[Vehicle] = ()
    scenario: str | None = None
    wind: str | None = None
    actual_wind: str | None = None
    reserve: float = 0.2
    workers: int = 1
    ttl_s: float = 10.0
    plan_s: float = 2.0
    iterations: int = 10**9
    lasts_s: float | None = None
    """Duration, s of the service's time; None: until all orders are closed, and all drones stand."""
    seed: int = 1
    strangers: bool = True
    settings: tuple[str, ...] = ()
    notice_s: float | None = None
    """Time between the arrival of orders and their earliest pick-up, s; None: all arrive at the beginning."""
    say: Callable[[str], None] = field(default=print)


class Service:
    """A service that runs until its orders are closed, or its duration is over."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self._leases = KeptLeases(options.ledger, f"{socket.gethostname()} {os.getpid()}", options.ttl_s)
        self._desk = Desk(open_ledger(options.ledger), options.dispatcher)
        self._workers: dict[int, subprocess.Popen[bytes]] = {}
        self._world: LockstepClient | None = None
        self._region: Region | None = None
        self._ended = False
        try:
            self._take_lease()
            self.record = self._begun() or self._begin()
        except BaseException:
            self._leases.close()  # the next attempt need not wait for its end
            raise
        self._arrivals = Arrivals(options.orders, options.notice_s)
        self._arrivals.put_down(self._desk, self.record.begin_s)
        self.dispatcher = self._dispatcher()

    def _take_lease(self) -> None:
        """Take the lease of the dispatcher; that of a killed one must first expire."""
        end, told = time.monotonic() + TAKE_OVER_WALL_S, False
        while True:
            try:
                self._token = self._leases.take(self.options.dispatcher).token
            except (FencedError, LedgerError) as error:  # still leased, or database unavailable
                if time.monotonic() >= end:
                    raise
                if not told:
                    led = "another process leads this service, or was killed and its lease runs on"
                    self._say(
                        f"{led if isinstance(error, FencedError) else error}; waiting up to {TAKE_OVER_WALL_S:g} s"
                    )
                told = True
                time.sleep(0.1)
            else:
                return

    def _take_again(self, lost: FencedError) -> None:
        """Take a lease again that expired while this process could not renew it; end if another process has had it since."""
        lease = self._leases.take(self.options.dispatcher)
        if lease.token != self._token + 1:
            self._leases.give_back([self.options.dispatcher])
            raise lost
        self._token = lease.token
        self._say(f"{lost}: nobody else has taken it, so this service takes it again")
        self.dispatcher = self._dispatcher()

    def _dispatcher(self) -> Dispatcher:
        o = self.options
        if self._region is None:  # a reopened ledger does not change it
            self._region = Region(self.record)
        return Dispatcher(
            self._region,
            self._desk,
            self._leases,
            workers=self.record.workers,
            plan_s=o.plan_s,
            iterations=o.iterations,
            say=self._say,
            service=None if self._world is None else LockstepPads(self._world),
        )

    def _say(self, line: str) -> None:
        self.options.say(line)

    def _begun(self) -> ServiceRecord | None:
        """Return the existing service of the desk, which is continued; None if there is none."""
        found = self._desk.get("service", "service")
        if found is None:
            return None
        record = read(found, ServiceRecord)
        self._ended = found.state == "ended"
        if self._ended:
            if not self._unfinished():
                refuse_ended(found)
            self._say(f"the service of {self.options.dispatcher} has ended: closing its flights, orders and bookings")
            return record
        if not record.world:
            record = self._with_world(found, record)
        self._say(f"resuming the service of {self.options.dispatcher}: nothing is lost")
        return record

    def _unfinished(self) -> bool:
        """Say whether a service that has ended has anything left to close: its dispatcher was killed meanwhile."""
        desk = self._desk
        left = desk.count("order", OPEN) or desk.count("flight", (*ACTIVE, "ended"))
        return bool(left) or any(one.holder == desk.dispatcher for one in desk.ledger.holds())

    def _begin(self) -> ServiceRecord:
        o = self.options
        if not o.fleet:
            raise InputError("a service without drones", field="--fleet", remedy="give a file of drones")
        record = ServiceRecord(
            begin_s=o.begin_s, folder=str(o.folder.resolve()), ledger=without_password(o.ledger), scenario=o.scenario, wind=o.wind, actual_wind=o.actual_wind,
            reserve=o.reserve, workers=o.workers, ttl_s=o.ttl_s, settings=list(o.settings), seed=o.seed, strangers=o.strangers,
        )  # fmt: skip
        region = self._region = Region(record)
        vehicles = fit(region.base, (), o.fleet).vehicles
        drones = [
            DroneRecord(vehicle=one, system=number, place=one.place, soc=one.soc, measured_s=o.begin_s)
            for number, one in enumerate(vehicles, 1)
        ]
        record.drags = {name: self._drag(region.base.drone(name)) for name in sorted({one.type for one in vehicles})}
        entries = [Entry("drone", one.vehicle.id, 0, "standing", o.dispatcher, written(one)) for one in drones]
        service = Entry("service", "service", 0, "begun", o.dispatcher, written(record))
        claim_folder(o.folder)
        written_ = self._desk.put(self._lease, [*entries, service])
        return self._with_world(written_[-1], record)

    def _drag(self, drone: Drone) -> DragModel:
        """Determine the drag of a type of drone from a simulated flight with half of its greatest package: without it the tilt gives no wind."""
        found = drag_of(drone, 0.5 * drone.max_payload_kg).another_flight()
        self._say(f"drag of {drone.id} found in a calibration flight: its tilt measures the wind")
        return found

    @property
    def _lease(self) -> Lease:
        """Return its lease; taken again if it expired during the start, which takes long on a busy machine, unless another process has written since."""
        lease = self._leases.kept(self.options.dispatcher)
        if lease is None:
            self._take_lease()
            lease = self._leases.kept(self.options.dispatcher)
        if lease is None:
            raise FencedError("the lease of the dispatcher is lost")
        return lease

    def _with_world(self, entry: Entry, record: ServiceRecord) -> ServiceRecord:
        """Start the simulated world, and record its address."""
        folder = Path(record.folder)
        address = folder / ADDRESS
        address.unlink(missing_ok=True)
        words = ["dispatch", "world", "--ledger", self.options.ledger, "--holder", self.options.dispatcher]
        process = start(words, folder / "world.out")
        end = time.monotonic() + WORLD_WALL_S
        while not address.exists():
            if process.poll() is not None or time.monotonic() >= end:
                raise LinkLostError(f"the simulated world did not start: see {folder / 'world.out'}")
            time.sleep(0.02)
        record.world = address.read_text(encoding="ascii").strip()
        self._desk.put(
            self._lease,
            [Entry("service", "service", entry.version, "running", self.options.dispatcher, written(record))],
        )
        return record

    # Running

    def run(self) -> None:
        """Run to the end of the service; of one that has ended, close what is left."""
        if self._ended:
            self._finish()
            return
        self._world = world = self._join_world()
        self.dispatcher = self._dispatcher()
        try:
            self._tend_workers()
            for number in self._workers:
                world.order("await", name=worker_name(self.options.dispatcher, number))
            while True:
                now_s = world.posix_s()
                self._step(now_s)
                self._tend_workers()
                if self._over(now_s):
                    break
                world.sleep_until(world.now_s() + EVERY_S)
            self._end(world)
        finally:
            world.close()
            self._leases.close()

    def _finish(self) -> None:
        """Wait for the flights of a service that has ended, and close its orders; drones that still flew when their world ended are gone."""
        try:
            world = self._world = LockstepClient(self.record.world, self.options.dispatcher, grace_s=GRACE_S)
        except LinkLostError:
            now_s, board = status_of(self._desk).now_s, Board(self._desk)
            for name, (_, flight) in board.read("flight", FlightRecord, ACTIVE).items():
                flight.end = End(
                    at_s=now_s,
                    state="not supervised",
                    reason="the simulated world has ended",
                    station=None,
                    soc=None,
                    arrived=False,
                )
                board.change("flight", name, "ended", flight)
            board.write(self._lease)
            self.dispatcher.close_orders(now_s)
            self._leases.close()
            return
        self.dispatcher = self._dispatcher()
        try:
            self._end(world)
        finally:
            world.close()
            self._leases.close()

    def _join_world(self) -> LockstepClient:
        try:
            return LockstepClient(self.record.world, self.options.dispatcher, grace_s=GRACE_S)
        except LinkLostError as error:
            self._leases.close()
            remedy = "its drones are gone with it: start a new service, with another --ledger and --folder"
            raise LinkLostError(f"{error}; {remedy}") from error

    def _step(self, now_s: float) -> None:
        """Do the due work; wait for an unavailable database, and reconnect."""
        while True:
            try:
                self._arrivals.put_down(self._desk, now_s)
                self.dispatcher.step(now_s)
            except (TakenError, VersionError) as error:
                self._say(f"replanned: {error}")
                return
            except LedgerError as error:
                self._say(f"{error}; waiting for it")
                self._reopen()
            except FencedError as error:
                try:
                    self._take_again(error)
                except LedgerError as gone:
                    self._say(f"{gone}; waiting for it")
                    self._reopen()
            else:
                return

    def _reopen(self) -> None:
        while True:
            time.sleep(0.5)
            try:
                fresh = open_ledger(self.options.ledger, create=False)
            except SkywayError:
                continue
            with suppress(SkywayError):
                self._desk.ledger.close()
            self._desk = Desk(fresh, self.options.dispatcher)
            with suppress(LedgerError):  # such as a full disk, or a server that only reads
                self._take_lease()
                self.dispatcher = self._dispatcher()
                return

    def _over(self, now_s: float) -> bool:
        lasts_s = self.options.lasts_s
        if lasts_s is not None and now_s >= self.record.begin_s + lasts_s:
            return True
        if lasts_s is not None or self._arrivals.coming or self.dispatcher.busy:
            return False
        try:
            return not self._desk.count("order", OPEN)
        except LedgerError:  # the next step waits for the database
            return False

    def _tend_workers(self) -> None:
        """Start workers that do not run: at the beginning, and those that have died."""
        for number in range(1, self.record.workers + 1):
            process = self._workers.get(number)
            if process is not None and process.poll() is None:
                continue
            if process is not None:
                self._say(f"worker {number} has died (exit code {process.returncode}): starting another one")
            words = [
                "dispatch",
                "worker",
                "--ledger",
                self.options.ledger,
                "--holder",
                self.options.dispatcher,
                "--number",
                str(number),
            ]
            self._workers[number] = start(words, Path(self.record.folder) / f"worker-{number}.out")

    def _end(self, world: LockstepClient) -> None:
        """End the service: workers finish their flights and end, open orders are closed, and then the world ends."""
        found = self._desk.get("service", "service")
        if self._leases.kept(self.options.dispatcher) is None:
            self._take_again(FencedError("the lease of the dispatcher is lost"))
        self.dispatcher.end_idle_charges(world.posix_s())
        if found is not None and found.state != "ended":
            self._desk.put(
                self._lease, [Entry("service", "service", found.version, "ended", found.keeper, found.document)]
            )
        while self._flying():
            world.sleep_until(world.now_s() + EVERY_S)
        self.dispatcher.close_orders(world.posix_s())
        world.order("end")

    def _flying(self) -> bool:
        """Say whether a flight of the service that has ended is under way; workers that have died are replaced."""
        try:
            if self._desk.count("flight", ACTIVE):
                self._tend_workers()
        except LedgerError as error:
            self._say(f"{error}; waiting for it")
            self._reopen()
            return True
        return any(one.poll() is None for one in self._workers.values())
