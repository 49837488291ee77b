"""How many whole itineraries a ledger books in a second when 16 clients want the same 40 pads."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from benchmarks.fleet.ledger_load import Load, postgresql_server, run
from skyway.models.ledger.audit import audit
from skyway.models.ledger.opening import open_ledger

CLIENTS, COUNT, SLOTS = 16, 500, 19_200
WANTED = {"SQLite": 1000.0, "PostgreSQL": 300.0}


def measure(store: str, count: int) -> Load:
    """Load one store, and look through its history afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        if store == "SQLite":
            name = str(Path(folder) / "ledger.db")
            return _audited(name, Path(folder), count)
        with postgresql_server() as address:
            return _audited(address, Path(folder), count)


def _audited(name: str, folder: Path, count: int) -> Load:
    load = run(name, folder, clients=CLIENTS, count=count, slots=SLOTS)
    with open_ledger(name) as ledger:
        found = audit(ledger)
    if found:
        raise AssertionError(found[0])
    return load


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="attempts of each client")
    count = parser.parse_args().count
    for store, wanted in WANTED.items():
        load = measure(store, count)
        print(
            f"{store:<12} {load.per_s:6.0f} four-stop itineraries/s (wanted {wanted:.0f}), {load.attempts / load.wall_s:.0f} attempts/s; "
            f"{load.booked} of {load.attempts} booked by {CLIENTS} clients on 40 pads; history audited, no overlap"
        )


if __name__ == "__main__":
    main()
