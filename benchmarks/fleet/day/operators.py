"""One operator of a simulated day: its processes, and their observation from outside."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.dispatch.demonstration import FLEET, NOTICE_MIN, ORDERS, FleetDemo, draw
from skyway.dispatch.simulation import ADDRESS, EVENTS
from skyway.models.base.errors import LinkLostError
from skyway.models.base.files import write_atomically
from skyway.sim_stub.transports.lockstep_client import LockstepClient

if TYPE_CHECKING:
    from datetime import datetime

AWAY = 3
"""Exit code of a service whose database cannot be reached when it starts."""
_EVENT = re.compile(r"\s*([\d.]+) s\s+vehicle (\d+)\s+(in the air|landed|crashed)")


@dataclass
class Operator:
    """One operator: a service with its workers and its simulated world."""

    name: str
    folder: Path
    ledger: str
    """Address for its processes, possibly through a network that can be interrupted."""
    outside: str
    """Direct address."""
    begin: datetime
    seed: int
    workers: int
    words: tuple[str, ...] = ()
    """Additional arguments of its command line."""
    process: subprocess.Popen[bytes] | None = None
    starts: int = 0
    cpu_s: dict[tuple[str, int], float] = field(default_factory=dict)
    """Processor time of each of its processes, including those that have ended."""

    @property
    def begin_s(self) -> float:
        """Beginning of its day, POSIX seconds."""
        return self.begin.timestamp()

    def draw(self, drones: int, rate_per_h: float, hours: float) -> int:
        """Write its files of drones and of orders, those of the demonstration; return the number of orders."""
        demo = FleetDemo(folder=self.folder, drones=drones, rate_per_h=rate_per_h, hours=hours, seed=self.seed, begin=self.begin)  # fmt: skip
        fleet, orders = draw(demo)
        self.folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self.folder / FLEET, fleet)
        write_atomically(self.folder / ORDERS, orders)
        return orders.count("\n") - 1

    def start(self, environment: dict[str, str]) -> None:
        """Start or restart its service."""
        words = [
            "dispatch", "run", "--simulate", "--ledger", self.ledger, "--holder", self.name, "--folder", str(self.folder / "flights"),
            "--orders", str(self.folder / ORDERS), "--fleet", str(self.folder / FLEET), "--depart", self.begin.isoformat(),
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
        """Whether its day is over. A service that was killed, or whose database was away when it started, is restarted, as by a service manager.

        Raises a `RuntimeError` if it ended with another fault.
        """
        if self.process is None:
            return True
        code = self.process.poll()
        if code is None:
            return False
        if code in (-signal.SIGKILL, AWAY):
            self.start(environment)
            return False
        if code:
            raise RuntimeError(f"the service of {self.name} ended with code {code}: see {self.folder / 'run.out'}")
        return True

    def pids(self, what: str) -> list[int]:
        """Return the processes of one kind, by their command lines, and record the processor time of all of them."""
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

    def address(self) -> str:
        """Where its world can be reached; an `OSError` before there is one."""
        return (self.folder / "flights" / ADDRESS).read_text(encoding="ascii").strip()

    def order(self, do: str, **what: Any) -> tuple[float, dict[str, Any]]:
        """Send a command to its world; return the time there, seconds after the beginning, and the answer."""
        with contextlib.closing(LockstepClient(self.address(), "bench")) as world:
            answer = world.order(do, **what)
            return world.now_s(), answer

    def look(self) -> tuple[float, dict[str, Any]] | None:
        """Return the time in its world, and the true positions of its drones; None if there is no world."""
        try:
            return self.order("look")
        except (OSError, LinkLostError):
            return None

    def air_h(self) -> float:
        """Return the flight hours of its drones, from the log of its world."""
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
