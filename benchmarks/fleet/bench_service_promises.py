"""Promised times of the fleet service: how many orders arrive by their 50 % and 95 % times, flown by simulated vehicles, and where time is lost.

Each service is `skyway dispatch run --simulate` as a user runs it, with its own processes, in the wind of a random day of the record that is in no forecast.
The vehicles (`sim_stub`) share no code with the planner. What counts is the first promise to each order; an order that had one and was not
delivered has missed both times. The causes are read from the desk and the journals of the flights.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
from scipy.stats import beta

from skyway.dispatch.demonstration import FLEET, JOURNALS, LEDGER, NOTICE_MIN, ORDERS, FleetDemo, draw
from skyway.dispatch.records import Board, FlightRecord, OrderRecord
from skyway.models.base.errors import InputError
from skyway.models.compute.worker_processes import lifeline
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.planner.problem.problem import HORIZON_H
from skyway.scenarios import load_scenario

FIRST_DAY, DAYS = date(2013, 1, 15), 330
FIRST_HOUR, LAST_HOUR = 7, 18
DRONES, RATE_PER_H, HOURS = (4, 9), (6.0, 10.0), 0.75
LONGEST_S = 1800.0
"""Wall time after which a service is given up."""
IN_AIR = ("flying", "diverting", "holding", "lost-link")


@dataclass
class Told:
    """A first promise and its outcome: delivery minus the 50 % and the 95 % time, s; infinite if it was not delivered, NaN without such a time."""

    service: int
    order: str
    p50_s: float
    p95_s: float


@dataclass
class Found:
    """Results of services; `causes` has seconds a flight."""

    told: list[Told] = field(default_factory=list)
    causes: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))


def scenario_of(seed: int, number: int) -> FleetDemo:
    """Draw a small service; its folder is set later. The hour is local time of the scenario."""
    random = np.random.default_rng((seed, number))
    base = load_scenario(None)
    while True:
        day = FIRST_DAY + timedelta(days=int(random.integers(DAYS)))
        begin = datetime.combine(day, datetime.min.time(), ZoneInfo(base.timezone)) + timedelta(
            hours=int(random.integers(FIRST_HOUR, LAST_HOUR))
        )
        try:
            base.truth(day, begin, HORIZON_H)
        except InputError:
            continue  # the record has a gap
        return FleetDemo(
            folder=Path(), drones=int(random.integers(*DRONES)), rate_per_h=float(random.uniform(*RATE_PER_H)), hours=HOURS,
            workers=1, seed=int(random.integers(2**31)), begin=begin,
        )  # fmt: skip


def run(demo: FleetDemo, folder: Path) -> bool:
    """Run a service to its end in a folder; whether it ended by itself."""
    folder.mkdir(parents=True)
    drones, orders = draw(demo)
    (folder / FLEET).write_text(drones)
    (folder / ORDERS).write_text(orders)
    words = [
        "dispatch", "run", "--simulate", "--ledger", LEDGER, "--orders", ORDERS, "--fleet", FLEET, "--depart", demo.begin.isoformat(),
        "--actual-wind", demo.begin.date().isoformat(), "--notice", f"{NOTICE_MIN:g}", "--workers", "1", "--iterations", "100", "--time-limit", "5",
        "--seed", str(demo.seed), "--folder", JOURNALS,
    ]  # fmt: skip
    with lifeline() as environment, (folder / "run.out").open("wb") as output:
        command = [sys.executable, "-m", "skyway", *words]
        service = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=environment)  # fmt: skip
        try:
            return service.wait(LONGEST_S) == 0
        except subprocess.TimeoutExpired:
            return False
        finally:
            service.terminate()
            service.wait()


def read(folder: Path, number: int, found: Found) -> None:
    """Add the promises and flights of a service."""
    with open_ledger(str(folder / LEDGER), create=False) as book:
        board = Board(Desk(book, "dispatch"))
        orders = board.read("order", OrderRecord)
        flights = board.read("flight", FlightRecord)
    for name, (_, one) in orders.items():
        if one.first is None:
            continue
        at_s = np.inf if one.delivered_s is None else one.delivered_s
        late = [np.nan if by_s is None else at_s - by_s for by_s in (one.first.p50_s, one.first.p95_s)]
        found.told.append(Told(number, name, *late))
    for _, flight in flights.values():
        path = folder / JOURNALS / flight.journal
        if flight.end is not None and flight.end.arrived and path.exists():
            split(flight, path, found.causes)


def split(flight: FlightRecord, path: Path, causes: dict[str, list[float]]) -> None:
    """Divide the time of a flight beyond its plan by cause, in s, from its journal."""
    spent: dict[str, float] = defaultdict(float)
    state, since_s, begun_s, end_s = "", 0.0, np.nan, np.nan
    for line in path.read_text().splitlines():
        row = json.loads(line)
        if row["event"] not in ("start", "state", "end"):
            continue
        at_s = datetime.fromisoformat(row["time"]).timestamp()
        begun_s = at_s if row["event"] == "start" else begun_s
        spent[state] += at_s - since_s if state else 0.0
        state = row["data"]["after"] if row["event"] == "state" else state or row["state"]
        since_s = end_s = at_s
    planned = {kind: sum(one.end_s - one.begin_s for one in flight.steps if one.kind == kind) for kind in ("fly", "charge")}  # fmt: skip
    hops = sum(one.kind == "fly" for one in flight.steps)
    air_s = sum(spent.pop(one, 0.0) for one in IN_AIR)
    charged_s, waited_s, decided_s = (spent.pop(one, 0.0) for one in ("charging", "waiting-for-pad", "replanning"))
    ready_s = max(flight.not_before_s, flight.begin_s)
    causes["handed to a worker after its planned begin"].append(begun_s - flight.begin_s)
    causes["on the ground, per flight"].append(sum(spent.values()) / hops)
    causes["on the ground and in the air, beyond the plan, per flight"].append(
        (sum(spent.values()) + air_s - planned["fly"]) / hops
    )
    causes["charging beyond the plan"].append(charged_s - planned["charge"])
    gaps_s = flight.end_s - ready_s - planned["fly"] - planned["charge"]
    causes["waiting for a pad, a package or wind, beyond the plan"].append(waited_s + decided_s - max(gaps_s, 0.0))
    causes["landed after the plan"].append(end_s - flight.end_s)


def show(found: Found) -> None:
    """Print shares of kept promises and the causes."""
    service = np.array([one.service for one in found.told])
    for name, late in (("50 %", [one.p50_s for one in found.told]), ("95 %", [one.p95_s for one in found.told])):
        late_s = np.array(late)
        known = np.isfinite(late_s) | np.isinf(late_s)
        kept = late_s[known] <= 0.0
        low, high = (beta.ppf(share, kept.sum() + shift, (~kept).sum() + 1 - shift) for share, shift in ((0.025, 0), (0.975, 1)))  # fmt: skip
        low, high = np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=1.0)
        by = [kept[service[known] == one].sum() - kept.mean() * (service[known] == one).sum() for one in np.unique(service[known])]  # fmt: skip
        error = np.sqrt(np.square(by).sum() * len(by) / max(len(by) - 1, 1)) / len(kept)
        print(
            f"by the {name} time: {kept.sum()} of {len(kept)} ({100 * kept.mean():.0f} %, 95 % interval {100 * low:.0f} to {100 * high:.0f} % with "
            f"independent orders; standard error {100 * error:.0f} points by services); median {np.median(late_s[known]):+.0f} s"
        )
    print(f"{len(found.causes['landed after the plan'])} parts of routes, s beyond the plan: mean, median, 5 % and 95 % quantile")  # fmt: skip
    for name, values in found.causes.items():
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
        print(f"  {name}: {np.mean(values):.2f}, {middle:.2f}, {low:.2f} to {high:.2f}")


def main() -> None:
    """Run services, and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--services", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1, help="services at the same time")
    parser.add_argument("--folder", type=Path, help="keeps ledgers and journals here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)) / f"seed-{options.seed}"
        demos = [scenario_of(options.seed, number) for number in range(options.services)]
        with ThreadPoolExecutor(options.at_once) as pool:
            ended = pool.map(lambda one: run(one[1], folder / str(one[0])), enumerate(demos))
            found = Found()
            for number, (demo, whole) in enumerate(zip(demos, ended, strict=True)):
                before = len(found.told)
                read(folder / str(number), number, found)
                own = [one.p95_s for one in found.told[before:] if not np.isnan(one.p95_s)]
                kept = sum(late_s <= 0.0 for late_s in own)
                note = "" if whole else ", did not end"
                print(f"{demo.begin:%Y-%m-%d %H:%M}, {demo.drones} drones: {len(found.told) - before} promised, {kept} of {len(own)} by the 95 % time{note}", flush=True)  # fmt: skip
    show(found)


if __name__ == "__main__":
    main()
