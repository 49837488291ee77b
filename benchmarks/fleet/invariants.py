"""Invariants of a flown fleet, checked on the history of its ledger by code that shares none with the writer.

It reads the tables with SQL and the documents as plain JSON: no module of skyway is imported. ``python -m benchmarks.fleet.invariants LEDGER``
prints violations and figures; exit code 1 if there are violations.
"""

from __future__ import annotations

import json
import sqlite3
import sys
from collections import Counter, defaultdict
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    Rows = Callable[[str], list[tuple[Any, ...]]]

CLOSED = ("delivered", "refused", "cancelled", "handed to a person")
ON_PAD = ("firm", "in use", "late")
WITH_PACKAGE = "with the package"
US = 1e6
SHOWN_SOC = 0.005
"""A vehicle reports whole percent."""


@dataclass(frozen=True)
class Line:
    """One line of the history of the desk."""

    id: str
    version: int
    state: str
    document: dict[str, Any]


@dataclass
class Judged:
    """Findings."""

    wrong: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)


@contextmanager
def _sqlite(name: str) -> Iterator[Rows]:
    with closing(sqlite3.connect(f"file:{name}?mode=ro", uri=True)) as connection:
        yield lambda sql: connection.execute(sql).fetchall()


@contextmanager
def _postgresql(name: str) -> Iterator[Rows]:
    import psycopg

    with psycopg.connect(name, autocommit=True) as connection:
        yield lambda sql: connection.execute(sql.encode()).fetchall()


def judge(ledger: str, dispatcher: str = "dispatch", *, reserve: float = 0.2, running: bool = False) -> Judged:
    """Check everything done by one dispatcher; the pads are checked for all together. If it is `running`, open entries are permitted."""
    with (_postgresql if ledger.startswith("postgres") else _sqlite)(ledger) as rows:
        return _judged(rows, dispatcher, reserve, running=running)


def _judged(rows: Rows, dispatcher: str, reserve: float, *, running: bool) -> Judged:
    found = Judged()
    kinds: dict[str, dict[str, list[Line]]] = defaultdict(lambda: defaultdict(list))
    name = dispatcher.replace("'", "''")
    history = rows(
        f"SELECT kind, id, version, state, document FROM desk_history WHERE dispatcher = '{name}' ORDER BY seq"
    )
    for kind, id_, version, state, document in history:
        data = document if isinstance(document, dict) else json.loads(document)
        kinds[kind][id_].append(Line(id_, version, state, data))
    for kind, entries in kinds.items():
        for lines in entries.values():
            if [one.version for one in lines] != list(range(1, len(lines) + 1)):
                found.wrong.append(
                    f"{kind} {lines[0].id}: its versions are not 1, 2, 3 …: something is lost or twice there"
                )
    flights = [lines[-1] for lines in kinds["flight"].values()]
    _orders(kinds["order"], flights, found, running=running)
    _drones(kinds["drone"], history, flights, found, running=running)
    folders = [lines[-1].document["folder"] for lines in kinds["service"].values()]
    charges = [
        soc for folder in folders for one in flights for soc in _landings(Path(folder) / one.document["journal"])
    ]
    below = sum(soc < reserve - SHOWN_SOC for soc in charges)
    found.figures |= {"landings": float(len(charges)), "landings below the reserve": float(below)}
    _pads(rows, found, running=running)
    return found


def _orders(orders: dict[str, list[Line]], flights: Iterable[Line], found: Judged, *, running: bool) -> None:
    """Each order ends once, with a reason or a delivery; its package continues from its last place, in one drone at a time."""
    carried: dict[str, list[Line]] = defaultdict(list)
    for one in flights:
        if one.document["phase"] == WITH_PACKAGE and one.document["order"] is not None:
            carried[one.document["order"]].append(one)
    ends = Counter(lines[-1].state for lines in orders.values())
    found.figures |= {f"orders {state}": float(count) for state, count in ends.items()}
    for name, lines in orders.items():
        last = lines[-1]
        if last.state not in CLOSED:
            if not running:
                found.wrong.append(f"order {name} is forgotten: {last.state}")
            continue
        closed = [one.state for one in lines if one.state in CLOSED]
        if len(set(closed)) != 1 or any(one.state not in CLOSED for one in lines[len(lines) - len(closed) :]):
            found.wrong.append(f"order {name} ended more than once: {', '.join(closed)}")
        if last.state != "delivered" and not last.document.get("reason"):
            found.wrong.append(f"order {name} was {last.state} without a reason")
        place = lines[0].document["order"]["origin"]
        ways = sorted(carried.get(name, []), key=lambda one: one.id)
        for way in ways:
            steps, end = way.document["steps"], way.document.get("end")
            if ways.index(way) and steps[0]["origin"] != place:
                found.wrong.append(
                    f"order {name}: flight {way.id} carries it from {steps[0]['origin']}, but it is at {place}"
                )
            place = end["station"] if end and end["station"] else steps[-1]["destination"]
        if last.state == "delivered":
            arrived = [one for one in ways if one.document.get("end") and one.document["end"]["arrived"]]
            if len(arrived) != 1 or arrived[0] is not ways[-1]:
                found.wrong.append(f"order {name} is delivered, but {len(arrived)} flights arrived with it")


def _drones(
    drones: dict[str, list[Line]],
    history: Iterable[tuple[Any, ...]],
    flights: list[Line],
    found: Judged,
    *,
    running: bool,
) -> None:
    """Each drone has one flight at a time, which begins where the previous one ended; it stands at a station at the end, or was handed over to a person."""
    active: dict[str, str] = {}
    for kind, id_, _, state, document in history:
        if kind != "flight":
            continue
        drone = (document if isinstance(document, dict) else json.loads(document))["drone"]
        if state in ("ordered", "flying"):
            other = active.setdefault(drone, id_)
            if other != id_:
                found.wrong.append(f"drone {drone} had two flights at once: {other} and {id_}")
        elif active.get(drone) == id_:
            del active[drone]
    by_drone: dict[str, list[Line]] = defaultdict(list)
    for one in sorted(flights, key=lambda one: one.id):
        by_drone[one.document["drone"]].append(one)
    for drone, own in by_drone.items():
        place = drones[drone][0].document["place"]
        for one in own:
            begins, end = one.document["steps"][0]["origin"], one.document.get("end")
            if place is not None and begins != place:
                found.wrong.append(f"drone {drone}: flight {one.id} begins at {begins}, but it stands at {place}")
            if end is None and not (running and one is own[-1]):
                found.wrong.append(f"flight {one.id} of drone {drone} never ended")
            place = None if end is None else end["station"]
    for name, lines in drones.items():
        last = lines[-1]
        if (last.state == "flying" and not running) or (last.state == "lost" and not last.document.get("reason")):
            found.wrong.append(f"drone {name} is {last.state} at the end, and no person was informed")
    found.figures |= {
        "drones": float(len(drones)), "drones lost": float(sum(lines[-1].state == "lost" for lines in drones.values())), "flights": float(len(flights)),
    }  # fmt: skip


def _landings(journal: Path) -> Iterator[float]:
    """Charge at each landing of a flight, as in its journal; a drone that stood before a flight that was not begun has not landed."""
    if not journal.exists():
        return
    for line in journal.read_text(encoding="utf-8").splitlines():
        with suppress(ValueError):  # the last line of a killed process
            entry = json.loads(line)
            if entry["event"] == "landed":
                yield entry["data"]["soc"]


def _pads(rows: Rows, found: Judged, *, running: bool) -> None:
    """No two hard windows of one pad overlap while both are held; nothing is held at the end."""
    sql = "SELECT itinerary, version, number, station, pad, starts, ends, epsilon, state FROM history ORDER BY seq"
    held: dict[tuple[str, int], dict[tuple[str, int, int], tuple[Any, Any]]] = defaultdict(dict)
    booked = 0
    for itinerary, version, number, station, pad, starts, ends, epsilon, state in rows(sql):
        own, key = held[station, pad], (itinerary, version, number)
        if state not in ON_PAD:
            own.pop(key, None)
        elif epsilon == 0.0 and key not in own:
            booked += 1
            for other, (begin, end) in own.items():
                if begin < ends and starts < end:
                    found.wrong.append(f"pad {pad} of {station} is held twice: by {other[0]} and {itinerary}")
            own[key] = starts, ends
    left = [f"{key[0]} at {station} {pad}" for (station, pad), own in held.items() for key in own]
    if left and not running:
        found.wrong.append(f"still booked at the end: {', '.join(left[:5])}")
    found.figures["windows booked"] = float(booked)


def main() -> None:
    """Check a ledger."""
    found = judge(*sys.argv[1:3])
    for name, value in found.figures.items():
        print(f"{name}: {value:g}")
    print("\n".join(found.wrong) if found.wrong else "nothing is wrong")
    raise SystemExit(1 if found.wrong else 0)


if __name__ == "__main__":
    main()
