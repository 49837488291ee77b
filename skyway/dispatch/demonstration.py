"""Demonstration of a fleet: random drones and orders, flown by a separate service and shown on the page."""

from __future__ import annotations

import csv
import io
import secrets
import shutil
import subprocess
import sys
import time
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import TYPE_CHECKING
from urllib.parse import urlencode
from zoneinfo import ZoneInfo

import numpy as np

from skyway.demo import DAY, DRONE, HOUR
from skyway.dispatch.leases import KeptLeases
from skyway.dispatch.simulation import ADDRESS
from skyway.dispatch.status import outcome
from skyway.models.base.errors import InputError, LinkLostError
from skyway.models.base.files import make_folder, write_atomically
from skyway.models.base.views import counted
from skyway.models.compute.worker_processes import lifeline
from skyway.models.ledger.ledger import FencedError
from skyway.models.ledger.opening import open_ledger
from skyway.planner.capacity.demand import Demand, drones_of, orders_of
from skyway.scenarios import load_scenario
from skyway.sim_stub.transports.lockstep_client import LockstepClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

LEDGER, ORDERS, FLEET, OUTPUT = "fleet.db", "orders.csv", "fleet.csv", "run.out"
JOURNALS = "flights"
MARK = "demonstration.lock"
"""File that marks a folder as that of a demonstration, and whose lease keeps others out while one runs there."""
DISPATCHER = "dispatch"
LEASE_S = 10.0
"""Lifetime of the leases of a demonstration and of its service, s of wall time."""
DUE_MIN = (90.0, 120.0, 150.0)
NOTICE_MIN = 10.0
"""Time between the arrival of an order and its earliest pick-up, min."""
URGENT = 0.2
"""Share of the orders that have priority 1."""


def _begin() -> datetime:
    return datetime.combine(DAY, HOUR, ZoneInfo(load_scenario(None).timezone))


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetDemo:
    """Options of the demonstration."""

    folder: Path
    drones: int = 50
    rate_per_h: float = 60.0
    hours: float = 1.0
    """Duration of the arrival of orders, h; and their rate."""
    workers: int = 2
    seed: int = 1
    begin: datetime = field(default_factory=_begin)
    """By default the hour of the demonstration of a single delivery."""


def draw(demo: FleetDemo) -> tuple[str, str]:
    """Draw files of drones and of orders, as CSV: orders from one station with pads to another nearby."""
    scenario = load_scenario(None)
    vehicles = drones_of(scenario, DRONE, demo.drones, demo.seed, 0)
    demand = Demand(most_per_h=demo.rate_per_h, hours=demo.hours)
    heaviest_kg = scenario.drone(DRONE).max_payload_kg
    ordered = orders_of(scenario, demand, demo.rate_per_h, 0.0, demo.begin, demo.seed, 0, heaviest_kg)
    if not ordered:
        raise InputError(
            f"no order is drawn in {demo.hours:g} h at {demo.rate_per_h:g} an hour: give a greater --rate or --hours, or another --seed"
        )
    random = np.random.default_rng(demo.seed)
    orders = []
    for one in ordered:
        due = one.ready + timedelta(minutes=float(random.choice(DUE_MIN)))
        urgent = int(random.random() < URGENT)
        orders.append(
            (one.id, one.origin, one.destination, one.mass_kg, one.ready.isoformat(), due.isoformat(), urgent)
        )
    return (
        _csv(
            ("id", "type", "home", "charge_percent"),
            [(one.id, one.type, one.home, round(100.0 * one.soc)) for one in vehicles],
        ),
        _csv(("id", "from", "to", "mass_kg", "ready", "due", "priority"), orders),
    )


def _csv(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return text.getvalue()


def run_demo(demo: FleetDemo, say: Callable[[str], None], *, show: Callable[[str], None] | None = None) -> None:
    """Fly the fleet: while `show`, which receives the path of its page, runs; or to its end without it.

    The files of the previous demonstration in its folder are replaced. All processes that it starts end with this program, also if
    that is killed.

    Raises
    ------
    InputError
        If no order is drawn, if another demonstration or a service runs in the folder, or if files there are not those of a
        demonstration; nothing is changed then.
    """
    drones, orders = draw(demo)
    with _claimed(demo.folder):
        _run(demo, drones, orders, say, show)


def _run(
    demo: FleetDemo, drones: str, orders: str, say: Callable[[str], None], show: Callable[[str], None] | None
) -> None:
    folder = demo.folder
    write_atomically(folder / FLEET, drones, force=True)
    write_atomically(folder / ORDERS, orders, force=True)
    words = [
        "dispatch", "run", "--simulate", "--ledger", LEDGER, "--orders", ORDERS, "--fleet", FLEET, "--depart", demo.begin.isoformat(),
        "--actual-wind", DAY.isoformat(), "--notice", f"{NOTICE_MIN:g}", "--workers", str(demo.workers), "--time-limit", "1",
        "--seed", str(demo.seed), "--folder", JOURNALS, "--holder", DISPATCHER, "--lease", f"{LEASE_S:g}",
    ]  # fmt: skip
    say(
        f"{counted(demo.drones, 'drone')}, {counted(orders.count(chr(10)) - 1, 'order')} in {demo.hours:g} h; in {folder}: skyway {' '.join(words)}"
    )
    with lifeline() as environment:
        with (folder / OUTPUT).open("wb") as output:
            shown = None if show is None else output
            service = subprocess.Popen(  # noqa: S603  our own command, its words as a list
                [sys.executable, "-m", "skyway", *words], cwd=folder, stdin=subprocess.DEVNULL, stdout=shown, stderr=shown,
                env=environment,
            )  # fmt: skip
        try:
            if show is None:
                if service.wait():
                    raise InputError("the service ended with a fault", str(folder / OUTPUT))
            else:
                show("/fleet?" + urlencode({"ledger": LEDGER}))
        finally:
            service.terminate()
            service.wait()
            _end_world(folder / JOURNALS / ADDRESS)
    if show is None:
        for line in outcome(str(folder / LEDGER), DISPATCHER):
            say(line)


def _end_world(address: Path) -> None:
    """End the simulated world, and with it the workers; it is already gone if the service has ended by itself."""
    with suppress(LinkLostError, OSError):
        world = LockstepClient(address.read_text(encoding="ascii").strip(), "demonstration")
        with closing(world):
            world.order("end")


@contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Hold a folder for one demonstration, without the files of the previous one."""
    make_folder(folder, "--output")
    names = [one for one in (LEDGER, ORDERS, FLEET, OUTPUT, JOURNALS) if (folder / one).exists()]
    if names and not (folder / MARK).exists():
        remedy = "name a new folder with --output, or move them away"
        problem = f"has files that no demonstration has written ({', '.join(names)})"
        raise InputError(problem, str(folder), field="--output", remedy=remedy)
    make_folder(folder / JOURNALS, "--output")
    leases = KeptLeases(str(folder / MARK), secrets.token_hex(8), LEASE_S)
    try:
        try:
            leases.take(DISPATCHER)
        except FencedError:
            raise _in_use(folder, "another demonstration") from None
        _wait_for_service(folder)
        _remove_last(folder)
        make_folder(folder / JOURNALS, "--output")
        yield
    finally:
        leases.close()


def _wait_for_service(folder: Path) -> None:
    """Wait until the lease of an ended service expires; an `InputError` if it is renewed: the service still runs."""
    if not (folder / LEDGER).exists():
        return
    with open_ledger(str(folder / LEDGER), create=False) as book:
        end = time.monotonic() + 1.5 * LEASE_S
        while book.led(DISPATCHER):
            if time.monotonic() >= end:
                raise _in_use(folder, "a service")
            time.sleep(0.1)


def _in_use(folder: Path, what: str) -> InputError:
    remedy = f"end it, or name another folder with --output; after a kill, wait {LEASE_S:g} s"
    return InputError(f"is in use: {what} runs there", str(folder), field="--output", remedy=remedy)


def _remove_last(folder: Path) -> None:
    """Remove the files of the previous demonstration; nothing else that may be in the folder."""
    for one in (LEDGER, f"{LEDGER}-wal", f"{LEDGER}-shm", ORDERS, FLEET, OUTPUT):
        (folder / one).unlink(missing_ok=True)
    shutil.rmtree(folder / JOURNALS, ignore_errors=True)
