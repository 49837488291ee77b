"""What needs a person in a fleet, in words: for the table, the page, and whoever else shows its status."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.dispatch.records import HANDED_OVER, OPEN, WITH_PACKAGE
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from skyway.dispatch.records import OrderRecord
    from skyway.dispatch.status import Status

LATE_S = 60.0
"""An order that is expected so long after its due time needs a person."""


def alarms(status: Status) -> list[str]:
    """Return what needs a person, one sentence each, the worst first."""
    running = status.state != "ended"
    found = []
    if running and not status.led:
        found.append("no dispatcher runs: start skyway dispatch run again with the same ledger")
    if not running and not status.led and any(state in OPEN for state, _ in status.orders.values()):
        found.append(
            "the dispatcher died before it closed all orders: start skyway dispatch run again with the same ledger"
        )
    for name, (state, drone) in status.drones.items():
        if state == "lost":
            found.append(f"{name} is lost, a person must check it: {drone.reason}")
    for name, (state, order) in status.orders.items():
        if state == HANDED_OVER:
            found.append(f"{name} needs a person: {order.reason}")
    found += [f"{name} does not run" for name, alive in status.workers.items() if running and not alive]
    for _, pad in status.pads.values():
        lasts = f"for {duration(pad.until_s - max(pad.from_s, status.now_s))}"
        when = f"in {duration(pad.from_s - status.now_s)} {lasts}" if pad.from_s > status.now_s else lasts
        why = f": {pad.reason}" if pad.reason else ""
        if pad.until_s > status.now_s:
            found.append(f"pad {pad.pad} of {pad.station} is out of order {when}{why}")
    return found + _late(status)


def _late(status: Status) -> list[str]:
    """Return the open orders that are expected after their due times, the latest first, then those whose promise was withdrawn."""
    planned = _planned(status)
    late, withdrawn = [], []
    for name, (state, order) in status.orders.items():
        if state not in OPEN:
            continue
        due_s = order.order.due.timestamp()
        drone, end_s, behind_s = planned.get(name, ("", None, 0.0))
        if end_s is None and order.promise is not None:
            end_s = max(order.promise.delivered_s, status.now_s)
        if end_s is None:
            if order.first is not None:
                withdrawn.append(f"{name} is no longer promised: {order.reason}")
            continue
        after_s = end_s + behind_s - due_s
        if after_s >= LATE_S:
            cause = _cause(status, name, order, drone, end_s - due_s, behind_s)
            late.append((after_s, f"{name} is expected {duration(after_s)} after its due time{cause}"))
    return [words for _, words in sorted(late, key=lambda one: -one[0])] + withdrawn


def _planned(status: Status) -> dict[str, tuple[str, float | None, float]]:
    """Return the drone of each order that is planned, the planned delivery, POSIX seconds, and how far the drone is behind that plan, s.

    A flight that ends late delays the next ones of its drone by what is left of the delay after the time between them.
    """
    found: dict[str, tuple[str, float | None, float]] = {}
    for name, (_, drone) in status.drones.items():
        free_s = status.now_s
        _, flight = status.flights.get(drone.flight or "", ("", None))
        if flight is not None:
            free_s = flight.end_s + flight.late_s
            if flight.order is not None and flight.phase == WITH_PACKAGE:
                found[flight.order] = (name, flight.end_s, flight.late_s)
        for part in drone.route:
            behind_s = max(free_s - part.begin_s, 0.0)
            free_s = part.end_s + behind_s
            if part.order is not None and part.phase == WITH_PACKAGE:
                found[part.order] = (name, part.end_s, behind_s)
    return found


def _cause(status: Status, name: str, order: OrderRecord, drone: str, plan_after_s: float, behind_s: float) -> str:
    """Return the shares of a delay: what the plan allowed for, with its reason, and how far the drone is behind that plan."""
    behind = f"{drone} is {duration(behind_s)} behind"
    if plan_after_s < LATE_S:
        spare = f", which had {duration(-plan_after_s)} to spare" if plan_after_s <= -LATE_S else ""
        return f": {behind} its plan{spare}"
    why = _why_planned_late(status, name, order)
    if behind_s < LATE_S:
        return f": {why}" if why else ""
    return f": its plan is {duration(plan_after_s)} late already{f' ({why})' if why else ''}, and {behind} that plan"


def _why_planned_late(status: Status, name: str, order: OrderRecord) -> str:
    changes = [one for _, one in status.changes.values() if one.order == name]
    if order.reason:
        return order.reason
    if changes:
        return f"promised {max(changes, key=lambda one: one.at_s).why}"
    first_s = 0.0 if order.first is None else order.first.delivered_s - order.order.due.timestamp()
    return f"promised {duration(first_s)} late from the start" if first_s >= LATE_S else ""
