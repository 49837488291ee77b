"""A fleet for the fleet page: the data of `skyway dispatch status`, the timelines of drones and pads, and requests to cancel an order."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from skyway.dispatch.attention import alarms
from skyway.dispatch.requests import LEDGER_WAIT_S, cancel_order, cancellation_told, why_not
from skyway.dispatch.status import Status, document_of, status_of
from skyway.models.base.formatting import natural
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from skyway.dispatch.records import PlanStep
    from skyway.models.scenario.scenario import Scenario

MOST_ROWS = 200
"""Number of drones and pads that are drawn; all are in the tables."""
SHOWN = 1.645
"""Standard deviations within which nine of ten drones arrive and leave."""


def told(ledger: str, holder: str) -> dict[str, Any]:
    """Return the status of a fleet. Raises an `InputError` if the file is not a ledger, or has no service."""
    with open_ledger(ledger, create=False, wait_s=LEDGER_WAIT_S) as book:
        desk = Desk(book, holder)
        status, asked = status_of(desk), [one.id for one in desk.entries("cancel", ("asked",))]
    document = document_of(status)
    for one in document["drones"]:
        if one["lat"] is None:  # a standing drone is at its station
            one["lat"], one["lon"] = _places(status.service.scenario).get(one["place"], (None, None))
        one["shown"], one["place"], one["doing"] = status.shown(one["id"])
    return document | {
        "timezone": _timezone(status.service.scenario), "begin_s": status.service.begin_s, "now_s": status.now_s, "alarms": alarms(status), "doing": _doing(status),
        "cancellable": _cancellable(status), "asked": asked, "booked": _booked(status), "whole": len(status.drones),
    }  # fmt: skip


def _cancellable(status: Status) -> list[str]:
    """Return the orders that a dispatcher would cancel now, by their ids."""
    flights = [one for _, one in status.flights.values()]
    running = status.state != "ended"
    return [name for name, (state, one) in status.orders.items() if running and not why_not(name, state, one, flights)]


def cancel(ledger: str, holder: str, order: str, by: str) -> dict[str, Any]:
    """Ask the dispatcher of a fleet to cancel an order; returns what became of it, see `cancellation`."""
    with open_ledger(ledger, create=False, wait_s=LEDGER_WAIT_S) as book:
        desk = Desk(book, holder)
        if cancel_order(desk, order, by) != "asked":
            return {"waits": False, "told": f"{order} was already cancelled"}
        return _answer(desk, order)


def cancellation(ledger: str, holder: str, order: str) -> dict[str, Any]:
    """Return what became of the request to cancel an order: whether the dispatcher has yet to answer, and words; a `SkywayError` if it was refused."""
    with open_ledger(ledger, create=False, wait_s=LEDGER_WAIT_S) as book:
        return _answer(Desk(book, holder), order)


def _answer(desk: Desk, order: str) -> dict[str, Any]:
    waits, words = cancellation_told(desk, order)
    return {"waits": waits, "told": words}


@lru_cache(maxsize=8)
def _scenario(folder: str | None) -> Scenario:
    from pathlib import Path

    return load_scenario(None if folder is None else Path(folder))


def _timezone(scenario: str | None) -> str:
    return _scenario(scenario).timezone


@lru_cache(maxsize=8)
def _places(scenario: str | None) -> dict[str, tuple[float | None, float | None]]:
    return {one.id: (one.lat, one.lon) for one in _scenario(scenario).network.stations}


def _bars(steps: tuple[PlanStep, ...], what: str, state: str) -> list[dict[str, Any]]:
    return [
        {
            "kind": "charge" if one.kind == "charge" else "fly", "begin_s": one.begin_s, "end_s": one.end_s, "state": state,
            "words": f"{what}: {one.origin} to {one.destination}" if one.origin != one.destination else f"{what}: at {one.origin}",
        }
        for one in steps
    ]  # fmt: skip


def _doing(status: Status) -> list[dict[str, Any]]:
    """Timeline of each drone: the current flight, and the planned ones after it."""
    rows = []
    for name, (state, drone) in list(status.drones.items())[:MOST_ROWS]:
        flight = status.flights.get(drone.flight or "")
        bars = [] if flight is None else _bars(flight[1].steps, flight[1].task, "now")
        for part in drone.route:
            bars += _bars(part.steps, part.task, "planned")
        rows.append({"name": name, "bars": bars, "wrong": state == "lost"})
    return rows


def _booked(status: Status) -> list[dict[str, Any]]:
    """Intervals in which each pad is held, and the holder; with the time in which nine of ten drones arrive and leave."""
    rows: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for hold in status.holds:
        one = hold.window
        begin_s, end_s = one.start.timestamp(), one.end.timestamp()
        rows.setdefault((one.station, one.pad), []).append({
            "kind": "charge", "begin_s": begin_s, "end_s": end_s, "words": f"{hold.name}, {hold.state}", "state": hold.state,
            "from_s": begin_s - SHOWN * one.start_sd_s, "until_s": end_s + SHOWN * one.end_sd_s,
        })  # fmt: skip
    for _, pad in status.pads.values():
        out = {
            "kind": "hold",
            "begin_s": pad.from_s,
            "end_s": pad.until_s,
            "words": f"out of order {pad.reason}".strip(),
            "state": "out of order",
        }
        rows.setdefault((pad.station, pad.pad), []).append(out)
    return [
        {"name": f"{station} {number}", "bars": bars, "wrong": any(one["kind"] == "hold" for one in bars)}
        for (station, number), bars in sorted(rows.items(), key=lambda row: (natural(row[0][0]), row[0][1]))[:MOST_ROWS]
    ]
