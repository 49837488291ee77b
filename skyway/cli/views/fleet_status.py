"""The status of a fleet as tables: first alarms that require a person, then orders, drones and changed promises."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Literal
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.dispatch.attention import alarms
from skyway.dispatch.records import CLOSED
from skyway.models.base.formatting import clock, date_clock, duration, percent
from skyway.models.base.units import from_posix
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from skyway.dispatch.records import OrderRecord
    from skyway.dispatch.status import Status

SHOWN = 40
"""Rows of each table; all are in the JSON."""
_LEFT: Literal["left"] = "left"


def print_status(status: Status, timezone: str) -> None:
    """Print a status."""
    zone = ZoneInfo(timezone)
    counts = ", ".join(f"{status.count(one)} {one}" for one in sorted({state for state, _ in status.orders.values()}))
    say(f"{status.dispatcher}, {status.state}, {date_clock(from_posix(status.now_s), zone, named=True)}: {counted(len(status.orders), 'order')} ({counts or 'none'}); "
        f"{counted(len(status.flights), 'flight')} of {counted(len(status.drones), 'drone')}")  # fmt: skip
    for words in alarms(status):
        say(f"! {words}")
    say("")
    print_orders(status, timezone)
    say("")
    drones = Sheet([Column("drone", justify=_LEFT), Column("state", justify=_LEFT), Column("place", justify=_LEFT), Column("charge"),
                    Column("doing", justify=_LEFT), Column("late"), Column("next", justify=_LEFT)])  # fmt: skip
    for name, (_, one) in islice(status.drones.items(), SHOWN):
        flight = status.flights.get(one.flight or "")
        progress = None if flight is None else flight[1].progress
        soc = one.soc if progress is None or progress.soc is None else progress.soc
        state, place, doing = status.shown(name)
        late = duration(flight[1].late_s) if flight is not None and flight[1].late_s >= 60.0 else ""
        drones.add(name, state, place, percent(soc), doing, late, ", ".join(part.task for part in one.route))
    drones.show()
    _say_hidden(len(status.drones), "drone")
    if status.changes:
        say("")
        say(f"Promises changed: {len(status.changes)}")
        for _, change in sorted(status.changes.values(), key=lambda pair: pair[1].at_s)[-SHOWN:]:
            say(
                f"  {clock(from_posix(change.at_s), zone, from_posix(status.service.begin_s))}  {change.order}: {change.why}"
            )


def print_orders(status: Status, timezone: str) -> None:
    """Print the orders alone."""
    zone = ZoneInfo(timezone)
    columns = [Column("order", justify=_LEFT), Column("state", justify=_LEFT), Column("from", justify=_LEFT), Column("to", justify=_LEFT), Column("due"),
               Column("promised"), Column("delivered"), Column("drone", justify=_LEFT), Column("changes"), Column("reason", justify=_LEFT)]  # fmt: skip
    sheet = Sheet(columns)
    begin = from_posix(status.service.begin_s)
    for name, (state, one) in _foremost(status).items():
        due = clock(one.order.due, zone, begin) if one.order.due >= begin else date_clock(one.order.due, zone)
        promised = "" if one.promise is None else clock(from_posix(one.promise.delivered_s), zone, begin)
        done = "" if one.delivered_s is None else clock(from_posix(one.delivered_s), zone, begin)
        sheet.add(
            name,
            state,
            one.order.origin,
            one.order.destination,
            due,
            promised,
            done,
            _drone(one),
            str(one.changes),
            one.reason,
        )
    sheet.show()
    _say_hidden(len(status.orders), "order")


def _foremost(status: Status) -> dict[str, tuple[str, OrderRecord]]:
    """Return the orders that are shown: of too many those that are not closed and due first, then the latest of the closed ones."""

    def urgency(name: str) -> tuple[bool, float]:
        state, one = status.orders[name]
        due_s = one.order.due.timestamp()
        return (True, -(one.delivered_s or due_s)) if state in CLOSED else (False, due_s)

    kept = set(sorted(status.orders, key=urgency)[:SHOWN])
    return {name: found for name, found in status.orders.items() if name in kept}


def _say_hidden(count: int, what: str) -> None:
    if count > SHOWN:
        say(f"… and {counted(count - SHOWN, f'more {what}')}: --json has them all")


def _drone(record: OrderRecord) -> str:
    return record.drone or ("" if record.promise is None else record.promise.drone)
