"""How many whole itineraries a ledger books in a second when 16 clients want the same 40 pads."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.fleet.ledger_load import STOPS, Load, postgresql_server, run, told_booked
from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger

if TYPE_CHECKING:
    from collections.abc import Callable

CLIENTS, COUNT, SLOTS = 16, 500, 19_200
WANTED = {"SQLite": 1000.0, "PostgreSQL": 300.0}


def measure(store: str, count: int, kill: int = 0) -> Load:
    """Load one store, and look through its history afterwards; with `kill` so many clients are killed, and the server of PostgreSQL once."""
    with tempfile.TemporaryDirectory() as folder:
        if store == "SQLite":
            return _audited(str(Path(folder) / "ledger.db"), Path(folder), count, kill)
        with postgresql_server() as (address, restart):
            return _audited(address, Path(folder), count, kill, restart if kill else lambda: None)


def _audited(name: str, folder: Path, count: int, kill: int, meanwhile: Callable[[], None] = lambda: None) -> Load:
    load = run(name, folder, clients=CLIENTS, count=count, slots=SLOTS, kill=kill, meanwhile=meanwhile)
    with open_ledger(name) as ledger:
        found = audit(ledger)
        stops: dict[str, int] = {}
        for one in ledger.holds():
            stops[one.itinerary] = stops.get(one.itinerary, 0) + 1
    found += [f"{one} is booked half" for one, many in stops.items() if many != STOPS]
    found += [f"{one} is lost" for one in told_booked(folder) - stops.keys()]
    if found:
        raise AssertionError(found[0])
    return load


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="attempts of each client")
    parser.add_argument(
        "--kill",
        type=int,
        default=0,
        help="clients that are killed with SIGKILL amid it, and the server of PostgreSQL once",
    )
    parser.add_argument("--store", choices=WANTED, help="only this one")
    options = parser.parse_args()
    for store, wanted in WANTED.items():
        if options.store not in (None, store):
            continue
        load = measure(store, options.count, options.kill)
        print(
            f"{store:<12} {load.per_s:6.0f} four-stop itineraries/s (wanted {wanted:.0f}), {load.attempts / load.wall_s:.0f} attempts/s; "
            f"{load.booked} of {load.attempts} booked by {CLIENTS} clients on 40 pads; history audited: no overlap, none half booked, none lost; {load.killed} killed"
        )


if __name__ == "__main__":
    main()
