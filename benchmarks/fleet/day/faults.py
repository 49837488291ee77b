"""Faults of a day of a fleet: the time of each, and its injection into the processes and the world of an operator."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.dispatch.records import Board, FlightRecord, PadRecord, written
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from benchmarks.fleet.day.cut_network import CutNetwork
    from benchmarks.fleet.day.operators import Operator
    from skyway.models.scenario.scenario import Scenario

KINDS = ("drone lost", "pad dead", "worker killed", "dispatcher killed", "database restarted", "network cut")
FIRST_S = 900.0
"""Time of the first fault after the beginning, s of simulated time: drones fly by then."""
DEAD_S = 7200.0
CUT_WALL_S = 25.0
"""Duration of a network interruption, s of wall time: longer than a lease."""


@dataclass(frozen=True, slots=True)
class Due:
    """One scheduled fault."""

    at_s: float
    """Simulated seconds after the beginning."""
    kind: str


def schedule(seed: int, hours: float, every_s: float) -> list[Due]:
    """Return the faults of one operator: all kinds in turn, each round in another order, with exponential times between them."""
    luck = random.Random(f"faults/{seed}")
    found: list[Due] = []
    at_s = FIRST_S
    while True:
        for kind in luck.sample(KINDS, len(KINDS)):
            if at_s > 3600.0 * hours:
                return found
            found.append(Due(at_s, kind))
            at_s += luck.expovariate(1.0 / every_s)


class Faults:
    """Injects the faults of one operator, and writes each into a file."""

    def __init__(
        self,
        operator: Operator,
        due: list[Due],
        scenario: Scenario,
        log: Path,
        *,
        restart_database: Callable[[], None],
        network: CutNetwork | None,
    ) -> None:
        self.operator, self.due, self.scenario, self.log = operator, due, scenario, log
        self._restart_database, self._network = restart_database, network
        self._luck = random.Random(f"which/{operator.name}")
        self.done: dict[str, int] = dict.fromkeys(KINDS, 0)

    def look(self, now_s: float) -> None:
        """Inject the faults due at a simulated instant, seconds after the beginning."""
        if not self.due or now_s < self.due[0].at_s:
            return
        one = self.due.pop(0)
        what = self._do(one.kind, now_s)
        if what is None:  # no drone flies that could be lost: later
            self.due.insert(0, Due(now_s + 120.0, one.kind))
            return
        self.done[one.kind] += 1
        with self.log.open("a", encoding="utf-8") as file:
            record = {"operator": self.operator.name, "at_s": round(now_s, 1), "kind": one.kind, "what": what}
            file.write(json.dumps(record) + "\n")

    def _do(self, kind: str, now_s: float) -> str | None:
        if kind == "drone lost":
            return self._lose_drone()
        if kind == "pad dead":
            return self._kill_pad(now_s)
        if kind == "worker killed":
            return self._kill_worker()
        if kind == "dispatcher killed":
            self.operator.kill()
            self.operator.order("await", name=self.operator.name)
            return "its service"
        if kind == "network cut":
            return self._cut()
        self._restart_database()
        return "all its processes, with SIGKILL"

    def _lose_drone(self) -> str | None:
        """Restart the autopilot of a drone in the air: it falls."""
        with open_ledger(self.operator.outside) as book:
            desk = Desk(book, self.operator.name)
            flights = Board(desk).read("flight", FlightRecord, ("flying",))
        up = sorted(
            (one.drone, one.system)
            for _, one in flights.values()
            if one.progress is not None and one.progress.state == "flying"
        )
        if not up:
            return None
        drone, system = self._luck.choice(up)
        self.operator.order("inject", fault=f"reboot#{system}")
        return drone

    def _kill_pad(self, now_s: float) -> str | None:
        """Occupy all pads of a station without a report, or report one pad as out of order: nobody charges there in either case."""
        stations = [one for one in self.scenario.network.stations if one.pads and not one.flyover]
        found = self._luck.choice(stations)
        if self._luck.random() < 0.5:
            self.operator.order("inject", fault=f"pads-taken={found.id}+{DEAD_S:g}s")
            return f"all of {found.id}, untold"
        begin_s = self.operator.begin_s + now_s
        record = PadRecord(station=found.id, pad=1, from_s=begin_s, until_s=begin_s + DEAD_S, reason="no power")
        with open_ledger(self.operator.outside) as book:
            Desk(book, self.operator.name).put_down(
                "pad", f"{found.id} 1 {begin_s + DEAD_S:.0f}", "out", written(record)
            )
        return f"pad 1 of {found.id}, told"

    def _kill_worker(self) -> str | None:
        pids = self.operator.pids("worker")
        if not pids:
            return None
        pid = self._luck.choice(sorted(pids))
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        return f"process {pid}"

    def _cut(self) -> str | None:
        if self._network is None:
            return "not behind the network that can be cut: nothing"
        network = self._network

        def mend() -> None:
            time.sleep(CUT_WALL_S)
            network.mend()

        network.cut()
        threading.Thread(target=mend, daemon=True).start()
        return f"for {CUT_WALL_S:g} s"
