"""One operator of a day that is flown in simulation: its processes, and what is known of them from outside."""

from __future__ import annotations

import contextlib
import csv
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.demo import DRONE
from skyway.dispatch.simulation import ADDRESS, EVENTS
from skyway.models.base.errors import LinkLostError
from skyway.planner.capacity.demand import Demand, drones_of, orders_of
from skyway.sim_stub.transports.lockstep_client import LockstepClient

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.scenario.scenario import Scenario

DUE_MIN = (90.0, 120.0, 150.0)
URGENT = 0.2
NOTICE_MIN = 10.0
_EVENT = re.compile(r"\s*([\d.]+) s\s+vehicle (\d+)\s+(in the air|landed|crashed)")


@dataclass
class Operator:
    """One operator: a service with its workers and its simulated world."""

    name: str
    folder: Path
    ledger: str
    """As its processes reach it, perhaps through a network that is cut."""
    outside: str
    """The same as we do."""
    begin: datetime
    seed: int
    workers: int
    words: tuple[str, ...] = ()
    """More of its command line."""
    process: subprocess.Popen[bytes] | None = None
    starts: int = 0
    cpu_s: dict[tuple[str, int], float] = field(default_factory=dict)
    """Time on a processor of each of its processes, also of those that have ended."""

    @property
    def begin_s(self) -> float:
        """When its day begins, POSIX seconds."""
        return self.begin.timestamp()

    def draw(self, scenario: Scenario, drones: int, rate_per_h: float, hours: float) -> int:
        """Write its files of drones and of orders; returns the number of orders."""
        self.folder.mkdir(parents=True, exist_ok=True)
        vehicles = drones_of(scenario, DRONE, drones, self.seed, 0)
        demand = Demand(most_per_h=rate_per_h, hours=hours)
        heaviest_kg = scenario.drone(DRONE).max_payload_kg
        ordered = orders_of(scenario, demand, rate_per_h, 0.0, self.begin, self.seed, 0, heaviest_kg)
        luck = np.random.default_rng(self.seed)
        with (self.folder / "fleet.csv").open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("id", "type", "home", "charge_percent"))
            rows.writerows((one.id, one.type, one.home, round(100.0 * one.soc)) for one in vehicles)
        with (self.folder / "orders.csv").open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("id", "from", "to", "mass_kg", "ready", "due", "priority"))
            for one in ordered:
                due = one.ready + timedelta(minutes=float(luck.choice(DUE_MIN)))
                urgent = int(luck.random() < URGENT)
                rows.writerow(
                    (one.id, one.origin, one.destination, one.mass_kg, one.ready.isoformat(), due.isoformat(), urgent)
                )
        return len(ordered)

    def start(self, environment: dict[str, str]) -> None:
        """Start its service, or start it again."""
        words = [
            "dispatch", "run", "--simulate", "--ledger", self.ledger, "--holder", self.name, "--folder", str(self.folder / "flights"),
            "--orders", str(self.folder / "orders.csv"), "--fleet", str(self.folder / "fleet.csv"), "--depart", self.begin.isoformat(),
            "--actual-wind", self.begin.date().isoformat(), "--notice", f"{NOTICE_MIN:g}", "--workers", str(self.workers),
            "--seed", str(self.seed), *self.words,
        ]  # fmt: skip
        with (self.folder / "run.out").open("ab") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "skyway", *words],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                env=environment,
            )
        self.starts += 1

    def kill(self) -> None:
        """Kill its service."""
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()

    def ended(self, environment: dict[str, str]) -> bool:
        """Whether its day is over; a service that was killed is started again. Raises a `RuntimeError` where it ended with a fault."""
        if self.process is None:
            return True
        code = self.process.poll()
        if code is None:
            return False
        if code == -signal.SIGKILL:
            self.start(environment)
            return False
        if code:
            raise RuntimeError(f"the service of {self.name} ended with code {code}: see {self.folder / 'run.out'}")
        return True

    def pids(self, what: str) -> list[int]:
        """Return the processes of one kind, by their command lines, and note what all of them have used."""
        found = []
        for folder in Path("/proc").iterdir():
            with contextlib.suppress(OSError, ValueError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if b"dispatch" not in words or self.name.encode() not in words or self.ledger.encode() not in words:
                    continue
                kind = words[words.index(b"dispatch") + 1].decode()
                numbers = (folder / "stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
                ticks = int(numbers[11]) + int(numbers[12])
                self.cpu_s[kind, int(folder.name)] = ticks / os.sysconf("SC_CLK_TCK")
                if kind == what:
                    found.append(int(folder.name))
        return found

    def order(self, do: str, **what: Any) -> tuple[float, dict[str, Any]]:
        """Have something done to its world; returns the time there, seconds after the beginning, and the answer."""
        address = (self.folder / "flights" / ADDRESS).read_text(encoding="ascii").strip()
        with contextlib.closing(LockstepClient(address, "bench")) as world:
            answer = world.order(do, **what)
            return world.now_s(), answer

    def look(self) -> tuple[float, dict[str, Any]] | None:
        """Return the time in its world, and where its drones really are; None where there is no world."""
        try:
            return self.order("look")
        except (OSError, LinkLostError):
            return None

    def air_h(self) -> float:
        """Hours that its drones have flown, by the log of its world."""
        since: dict[str, float] = {}
        total_s = last_s = 0.0
        with contextlib.suppress(OSError), (self.folder / "flights" / EVENTS).open(encoding="utf-8") as log:
            for line in log:
                event = _EVENT.match(line)
                if event is None:
                    continue
                last_s = float(event[1])
                if event[3] == "in the air":
                    since[event[2]] = last_s
                else:
                    total_s += last_s - since.pop(event[2], last_s)
        return (total_s + sum(last_s - at_s for at_s in since.values())) / 3600.0
