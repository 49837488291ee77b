"""Rate at which a ledger books whole itineraries when 16 clients want the same 40 pads."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.fleet.ledger_load import STOPS, Load, confirmed_bookings, postgresql_server, run
from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CLIENTS, COUNT, SLOTS = 16, 500, 19_200
WANTED = {"SQLite": 1000.0, "PostgreSQL": 300.0}


def measure(store: str, count: int, kill: int = 0, parts: int = 1) -> Iterator[Load]:
    """Load one store in parts, and check its history after each; with `kill`, this number of clients of a part are killed, and the server of PostgreSQL once."""
    with tempfile.TemporaryDirectory() as folder:
        if store == "SQLite":
            for part in range(parts):
                yield _audited(str(Path(folder) / "ledger.db"), Path(folder), count, kill, part)
            return
        with postgresql_server() as (address, restart):
            for part in range(parts):
                yield _audited(address, Path(folder), count, kill, part, restart if kill else lambda: None)


def _audited(
    name: str, folder: Path, count: int, kill: int, part: int, meanwhile: Callable[[], None] = lambda: None
) -> Load:
    load = run(name, folder, clients=CLIENTS, count=count, slots=SLOTS, kill=kill, part=part, meanwhile=meanwhile)
    with open_ledger(name) as ledger:
        found = audit(ledger)
        stops: dict[str, int] = {}
        for one in ledger.holds():
            stops[one.itinerary] = stops.get(one.itinerary, 0) + 1
    found += [f"{one} is booked half" for one, many in stops.items() if many != STOPS]
    found += [f"{one} is lost" for one in confirmed_bookings(folder) - stops.keys()]
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
    parser.add_argument("--parts", type=int, default=1, help="so often, on in the same ledger, with other clients")
    options = parser.parse_args()
    for store, wanted in WANTED.items():
        if options.store not in (None, store):
            continue
        total = booked = killed = 0
        for load in measure(store, options.count, options.kill, options.parts):
            total, booked, killed = total + load.attempts, booked + load.booked, killed + load.killed
            print(
                f"{store:<12} {load.per_s:6.0f} four-stop itineraries/s (wanted {wanted:.0f}), {load.attempts / load.wall_s:.0f} attempts/s, "
                f"{1e6 * load.cpu_s:.0f} µs of a processor for an attempt in its client; {booked} of {total} booked by {CLIENTS} clients on 40 pads; "
                f"history audited: no overlap, none half booked, none lost; {killed} killed",
                flush=True,
            )


if __name__ == "__main__":
    main()
