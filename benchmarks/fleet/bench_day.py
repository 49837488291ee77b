"""A day of a fleet, flown in simulation with faults: no double booking, no lost order or package, no stranded drone.

Two operators share one PostgreSQL ledger, each with half of the drones, a dispatcher, workers and a simulated world of its own, whose times
differ by a minute at most; other drones use the pads as well. The wind is that of a day of the record that no forecast contains. Drones crash,
pads fail, workers and dispatchers are killed, the database is killed and restarted, and the network of one operator is interrupted. Results are
written during the run: a line per minute into
``progress.jsonl``, each fault into ``faults.jsonl``, and at the end each order into ``orders.csv``.

``python -m benchmarks.fleet.bench_day --drones 200 --hours 24 --seed 1``; with ``--minutes``, and on
Ctrl-C or SIGTERM, it ends earlier, and evaluates the results so far. All
processes that it has started end with it.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import os
import shutil
import signal
import sys
import time
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from benchmarks.fleet.day.cut_network import CutNetwork
from benchmarks.fleet.day.faults import KINDS, Faults, schedule
from benchmarks.fleet.day.operators import Operator
from benchmarks.fleet.day.pace import Pace
from benchmarks.fleet.invariants import judge
from benchmarks.fleet.ledger_load import postgresql_server
from skyway.dispatch.records import Board, DroneRecord
from skyway.dispatch.status import status_of
from skyway.models.base.errors import SkywayError
from skyway.models.compute.worker_processes import lifeline
from skyway.models.ledger.audit import audit
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Callable

DAY = "2013-04-18T06:00"
"""Beginning of the day, local time; its wind is in no forecast."""
NAMES = ("north", "south")
LOOK_WALL_S, TELL_WALL_S = 5.0, 60.0


class Day:
    """The day of both operators."""

    def __init__(self, given: argparse.Namespace, uri: str, restart_database: Callable[[], None]) -> None:
        self.given, self.folder = given, Path(given.output)
        scenario = load_scenario(None)
        begin = datetime.fromisoformat(given.day).replace(tzinfo=ZoneInfo(scenario.timezone))
        self.uri, self.network = uri, CutNetwork(uri)
        self.operators: list[Operator] = []
        self.faults: list[Faults] = []
        self.strayed: dict[str, set[str]] = {}
        """Of each operator, drones that were not at their station of the desk at the last check."""
        self.astray: list[str] = []
        self.ends_early = False
        for number, name in enumerate(NAMES):
            ledger = self.network.address if number == 0 else uri
            words = ("--time-limit", "1", "--iterations", str(given.iterations))
            one = Operator(
                name, self.folder / name, ledger, uri, begin, 100 * given.seed + number, given.workers, words
            )
            count = one.draw(given.drones // len(NAMES), given.rate / len(NAMES), given.hours)
            print(f"{name}: {given.drones // len(NAMES)} drones, {count} orders in {given.hours:g} h", flush=True)
            due = [
                each
                for each in schedule(one.seed, given.hours, 60.0 * given.fault_every)
                if number == 0 or each.kind not in ("network cut", "database restarted")
            ]
            self.operators.append(one)
            self.faults.append(
                Faults(
                    one, due, scenario, self.folder / "faults.jsonl", restart_database=restart_database,
                    network=self.network if number == 0 else None,
                )
            )  # fmt: skip

        self.pace = Pace({one.name: one.address for one in self.operators})

    def run(self) -> bool:
        """Fly the day; return whether both operators reached its end."""
        with lifeline() as environment:
            environment |= {"OPENBLAS_NUM_THREADS": "1"}
            for one in self.operators:
                one.start(environment)
            self.pace.start()
            end_s = time.monotonic() + 60.0 * self.given.minutes
            written_s = -TELL_WALL_S
            while time.monotonic() < end_s and not self.ends_early:
                over = [one.ended(environment) for one in self.operators]
                for one, faults in zip(self.operators, self.faults, strict=True):
                    one.pids("")
                    found = one.look()
                    if found is not None:
                        faults.look(found[0])
                if time.monotonic() >= written_s + TELL_WALL_S or all(over):
                    written_s = time.monotonic()
                    self.write_progress()
                if all(over):
                    return True
                time.sleep(LOOK_WALL_S)
            self.write_progress()
            self.stop()
        return False

    def end(self, *_: object) -> None:
        """End the day early; the results so far are evaluated."""
        self.ends_early = True

    def stop(self) -> None:
        """Stop all processes of an unfinished day, so that the ledger does not change during the evaluation."""
        self.pace.stop()
        for one in self.operators:
            one.kill()
            for kind in ("worker", "world"):
                for pid in one.pids(kind):
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)

    def write_progress(self) -> None:
        """Write the progress of the day."""
        for one, faults in zip(self.operators, self.faults, strict=True):
            found = one.look()
            line: dict[str, Any] = {"wall": time.strftime("%H:%M:%S"), "operator": one.name}
            try:
                with open_ledger(one.outside) as book:
                    status = status_of(Desk(book, one.name))
            except SkywayError as error:
                line["error"] = str(error)
            else:
                line |= {
                    "orders": dict(Counter(state for state, _ in status.orders.values())),
                    "drones": dict(Counter(state for state, _ in status.drones.values())),
                    "flights": len(status.flights), "changes": len(status.changes),
                }  # fmt: skip
                if found is not None:
                    self._look_for_astray(one, found[1])
            line |= {
                "at_h": None if found is None else round(found[0] / 3600.0, 3), "air_h": round(one.air_h(), 2),
                "cpu_s": {kind: round(sum(used for (name, _), used in one.cpu_s.items() if name == kind), 1) for kind in ("run", "worker", "world")},
                "faults": {kind: count for kind, count in faults.done.items() if count}, "starts": one.starts,
                "astray": len(self.astray),
            }  # fmt: skip
            with (self.folder / "progress.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            print(json.dumps(line), flush=True)

    def _look_for_astray(self, one: Operator, truth: dict[str, Any]) -> None:
        """Check that drones that stand, by the desk, stand there; one that does not, twice in a row, is astray."""
        with open_ledger(one.outside) as book:
            drones = Board(Desk(book, one.name)).read("drone", DroneRecord)
        now = {
            name
            for name, (state, drone) in drones.items()
            if state == "standing" and drone.flight is None and drone.place is not None
            and (truth[str(drone.system)]["active"] or truth[str(drone.system)]["at"] != drone.place)
        }  # fmt: skip
        before = self.strayed.get(one.name, set())
        self.astray += [
            f"{one.name} {name}" for name in sorted(now & before) if f"{one.name} {name}" not in self.astray
        ]
        self.strayed[one.name] = now

    def judged(self, *, over: bool) -> int:
        """Print the findings; return the number of violations."""
        wrong: list[str] = [f"drone {name} does not stand where its desk has it" for name in self.astray]
        with open_ledger(self.uri) as book:
            wrong += audit(book)
        with (self.folder / "orders.csv").open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("operator", "order", "state", "due", "delivered", "reason"))
            for one in self.operators:
                with open_ledger(self.uri) as book:
                    if Desk(book, one.name).get("service", "service") is None:
                        print(f"{one.name} had not begun")
                        continue
                    status = status_of(Desk(book, one.name))
                for name, (state, order) in sorted(status.orders.items()):
                    delivered = None if order.delivered_s is None else round(order.delivered_s)
                    rows.writerow((one.name, name, state, order.order.due.isoformat(), delivered, order.reason))
                late = [late_s for late_s in status.lateness_s if late_s > 0.0]
                found = judge(self.uri, one.name, running=not over)
                wrong += [f"{one.name}: {each}" for each in found.wrong]
                print(f"{one.name}: " + ", ".join(f"{name} {value:g}" for name, value in found.figures.items()))
                print(
                    f"  {len(late)} late, by {max(late, default=0.0) / 60.0:.0f} min at most; {len(status.changes)} promises changed"
                )
        print("\n".join(wrong) if wrong else "nothing is wrong" + ("" if over else " so far"))
        return len(wrong)


def main() -> None:
    """Fly a day and evaluate it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drones", type=int, default=200)
    parser.add_argument("--hours", type=float, default=24.0, help="orders come for so long")
    parser.add_argument("--rate", type=float, default=20.0, help="orders an hour, of both operators")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--day", default=DAY, help="when it begins, local time")
    parser.add_argument("--workers", type=int, default=1, help="of each operator")
    parser.add_argument("--iterations", type=int, default=100, help="changes that each plan tries at most")
    parser.add_argument(
        "--fault-every",
        type=float,
        default=15.0,
        help="minutes of the simulated day between two faults of one operator, on average",
    )
    parser.add_argument("--minutes", type=float, default=1e6, help="end after so long, of the wall's time")
    parser.add_argument("--output", default="out/day")
    given = parser.parse_args()
    folder = Path(given.output).resolve()
    given.output = str(folder)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with postgresql_server() as (uri, kill):
        day = Day(given, uri, kill)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, day.end)
        try:
            over = day.run()
            for one, faults in zip(day.operators, day.faults, strict=True):
                print(f"faults of {one.name}: " + ", ".join(f"{kind} {faults.done[kind]}" for kind in KINDS))
            wrong = day.judged(over=over)
        finally:
            day.stop()
            day.network.close()
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
