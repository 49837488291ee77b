"""What operators ask of a dispatcher through its desk: take orders, cancel one, close a pad, open it again."""

from __future__ import annotations

import difflib
import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.dispatch.records import (
    ACTIVE,
    CANCELLED,
    CLOSED,
    WITH_PACKAGE,
    Board,
    CancelRecord,
    FlightRecord,
    OrderRecord,
    ReopenRecord,
    read,
    written,
)
from skyway.dispatch.status import status_of
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.geodesy import distance_m
from skyway.models.base.units import from_posix, iso
from skyway.models.orders.fitting import fit
from skyway.models.orders.rows import fault_at
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from skyway.dispatch.records import PadRecord
    from skyway.models.ledger.desk import Desk, Entry
    from skyway.models.network.network import Network
    from skyway.models.network.station import Station
    from skyway.models.orders.order import Order
    from skyway.models.scenario.scenario import Scenario

LEDGER_WAIT_S = 5.0
"""How long a request of a page or a program waits for a ledger that another process writes to; meanwhile others wait for the process that serves it."""


def refuse_ended(service: Entry | None) -> None:
    """Refuse a service that has ended, with an `InputError`: it is not resumed, and nobody would act on what it is told."""
    if service is not None and service.state == "ended":
        remedy = "name another --holder, or another ledger"
        raise InputError("the service of this name has ended", field="--holder", value=service.keeper, remedy=remedy)


def put_order(desk: Desk, order: Order) -> None:
    """Add an order to a desk; an `InputError` if its id exists already."""
    put_orders(desk, (order,))


def put_orders(desk: Desk, orders: Sequence[Order]) -> None:
    """Add orders to a desk, all or none; an `InputError` if one of the ids exists already."""
    desk.put_down_all("order", "new", {one.id: written(OrderRecord(order=one, place=one.origin)) for one in orders})


class Arrivals:
    """Initial orders of a service: all arrive at its beginning or, with a notice, each that long before it is ready, s."""

    def __init__(self, orders: Sequence[Order], notice_s: float | None) -> None:
        self.coming = sorted(orders, key=lambda one: one.ready)
        """Orders that are not on the desk yet."""
        self._notice_s = math.inf if notice_s is None else notice_s

    def put_down(self, desk: Desk, now_s: float) -> None:
        """Add the orders that have arrived, all or none; a service that was started again has some of them already."""
        arrived = [one for one in self.coming if one.ready.timestamp() - self._notice_s <= now_s]
        if arrived:
            put_orders(desk, [one for one in arrived if desk.get("order", one.id) is None])
            self.coming = self.coming[len(arrived) :]


class NotCancelledError(InputError):
    """The order exists, and cannot be cancelled any more."""


def give_orders(desk: Desk, orders: Sequence[Order]) -> None:
    """Give orders to a dispatcher, all or none."""
    refuse_ended(desk.get("service", "service"))
    check_orders(desk, orders)
    put_orders(desk, orders)


def check_orders(desk: Desk, orders: Sequence[Order]) -> None:
    """Refuse orders that the dispatcher would refuse at once: unknown places, places without pads, due times that have passed.

    An `InputError` lists every fault.
    """
    status = status_of(desk)
    network = _scenario(status.service.scenario).network
    work = fit(_scenario(status.service.scenario), orders, [one.vehicle for _, one in status.drones.values()])
    wider, faults = work.scenario.network, []
    for one, fitted in zip(orders, work.orders, strict=True):
        written_as = {"from": one.origin, "to": one.destination}
        for field, place in without_pads(network, fitted):
            near = ", ".join(_nearest_pads(network, wider.stations[wider.index[place]]))
            remedy = f"a station with pads, the nearest are {near}"
            faults.append(fault_at(one.source, field, "has no pads", written_as[field], remedy))
        if one.due.timestamp() <= status.now_s:
            now = iso(from_posix(status.now_s))
            faults.append(
                fault_at(one.source, "due", "has passed", iso(one.due), f"a time after {now}, the time of the service")
            )
    refuse(faults)


def without_pads(network: Network, order: Order) -> list[tuple[str, str]]:
    """Return field and place of each end of an order at which no drone of a service may land: without pads, or not of its network."""
    pads = {one.id: one.pads for one in network.stations}
    return [
        (field, place) for field, place in (("from", order.origin), ("to", order.destination)) if not pads.get(place)
    ]


@lru_cache(maxsize=1)
def _scenario(folder: str | None) -> Scenario:
    return load_scenario(None if folder is None else Path(folder))


def _nearest_pads(network: Network, to: Station) -> list[str]:
    """Return the ids of the three nearest stations with pads."""
    with_pads = [one for one in network.stations if one.pads]
    return [one.id for one in sorted(with_pads, key=lambda one: distance_m(to.lat, to.lon, one.lat, one.lon))[:3]]


def unknown_order(desk: Desk, order: str) -> Fault:
    """Return the fault of an order that does not exist, with the nearest ids."""
    close = difflib.get_close_matches(order, [one.id for one in desk.entries("order")], n=3, cutoff=0.5)
    remedy = f"did you mean {' or '.join(close)}?" if close else "skyway orders list shows the orders"
    return Fault("there is no such order", field="id", value=order, remedy=remedy)


def cancel_order(desk: Desk, order: str, by: str) -> str:
    """Ask the dispatcher to cancel an order; return ``asked``, or ``cancelled`` if it already was.

    Raises an `InputError` if there is no such order, and a `NotCancelledError` if its package is aboard or it is closed.
    """
    entry = desk.get("order", order)
    if entry is None:
        raise InputError(unknown_order(desk, order))
    if entry.state == CANCELLED:
        return CANCELLED
    flights = [one for _, one in Board(desk).read("flight", FlightRecord, ACTIVE).values()]
    reason = why_not(order, entry.state, read(entry, OrderRecord), flights)
    if reason:
        raise _not_cancelled(order, reason)
    asked = desk.get("cancel", order)
    if asked is None:
        refuse_ended(desk.get("service", "service"))
        desk.put_down("cancel", order, "asked", written(CancelRecord(by=by)))
    return "asked"


def why_not(name: str, state: str, order: OrderRecord, flights: Iterable[FlightRecord]) -> str:
    """Return why an order in a state cannot be cancelled, and what can be done; empty if it can."""
    if state in CLOSED:
        return f"it is {state} already"
    carriers = [one.drone for one in flights if one.order == name and one.phase == WITH_PACKAGE]
    if state == "aboard" or carriers:
        drone = carriers[0] if carriers else order.drone
        back = f"give a new order from {order.order.destination} to {order.order.origin} to have it brought back"
        return f"its package is aboard {drone} and will be delivered; {back}"
    return ""


def cancellation(desk: Desk, order: str) -> str:
    """Return what became of the request to cancel an order: ``asked``, or ``cancelled``; a `NotCancelledError` if it was refused."""
    entry = desk.get("cancel", order)
    if entry is not None and entry.state == "refused":
        raise _not_cancelled(order, read(entry, CancelRecord).reason)
    return "asked" if entry is not None and entry.state == "asked" else CANCELLED


def cancellation_told(desk: Desk, order: str) -> tuple[bool, str]:
    """Return whether a dispatcher that runs has yet to answer the request to cancel an order, and what became of it, in words.

    Raises a `NotCancelledError` if it was refused.
    """
    led = desk.ledger.led(desk.dispatcher)
    if cancellation(desk, order) != "asked":
        return False, f"{order} is cancelled"
    if led:
        return True, f"{order}: cancellation asked; the dispatcher has not answered yet"
    return False, f"{order}: cancellation asked; no dispatcher runs, the next skyway dispatch run decides"


def _not_cancelled(order: str, reason: str) -> NotCancelledError:
    return NotCancelledError(f"{order} cannot be cancelled: {reason}")


def close_pad(desk: Desk, record: PadRecord) -> None:
    """Report a pad as out of order."""
    first = name = f"{record.station} {record.pad} {record.until_s:.0f}"
    number = 1
    while desk.get("pad", name) is not None and desk.get("reopening", name) is not None:  # closed again
        number += 1
        name = f"{first} {number}"
    desk.put_down("pad", name, "out", written(record))


def open_pads(desk: Desk, station: str, pad: int | None, now_s: float, by: str) -> list[int]:
    """End the closures, present and coming, of one pad of a station, or of all; return the numbers of the pads that were closed."""
    lifted = set()
    for name, (_, one) in Board(desk).pads_out().items():
        if one.station == station and pad in (None, one.pad) and one.until_s > now_s:
            desk.put_down("reopening", name, "told", written(ReopenRecord(at_s=now_s, by=by)))
            lifted.add(one.pad)
    return sorted(lifted)
