"""The status of a service: orders, drones, flights, pads and changed promises, for people, for programs and for Prometheus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from skyway.dispatch.records import (
    ACTIVE,
    CLOSED,
    FLYING,
    LOST,
    OPEN,
    STANDING,
    Board,
    ChangeRecord,
    DroneRecord,
    FlightRecord,
    OrderRecord,
    PadRecord,
    ServiceRecord,
    read,
)
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import natural
from skyway.models.base.units import from_posix, iso
from skyway.models.base.views import counted
from skyway.models.ledger.audit import audit
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger

if TYPE_CHECKING:
    from skyway.models.ledger.ledger import Hold

SCHEMA = "skyway.fleet-status/1"
T = TypeVar("T")


@dataclass(frozen=True)
class Status:
    """Everything on a desk, and the bookings."""

    dispatcher: str
    state: str
    """Of the service: ``begun``, ``running`` or ``ended``."""
    led: bool
    """A dispatcher has its lease now."""
    now_s: float
    """Latest time that the service has reported anything, POSIX seconds of its own clock."""
    service: ServiceRecord
    orders: dict[str, tuple[str, OrderRecord]]
    drones: dict[str, tuple[str, DroneRecord]]
    flights: dict[str, tuple[str, FlightRecord]]
    """Flights that are not over."""
    pads: dict[str, tuple[str, PadRecord]]
    """Pads that are out of order, or will be."""
    changes: dict[str, tuple[str, ChangeRecord]]
    holds: list[Hold]
    workers: dict[str, bool]
    """By name, whether its lease is held."""

    def count(self, state: str) -> int:
        """Return the number of orders in a state."""
        return sum(one == state for one, _ in self.orders.values())

    def shown(self, drone: str) -> tuple[str, str, str]:
        """Return the state of a drone, its place and what it does now, for people: a drone under way stands on pads, too."""
        state, one = self.drones[drone]
        _, flight = self.flights.get(one.flight or "", ("", None))
        if flight is not None:
            doing = f"{flight.task}: {'begins' if flight.progress is None else flight.progress.state}"
        else:
            doing = "" if one.idle is None else f"charges on pad {one.idle.pad}"
        progress = None if flight is None else flight.progress
        place = one.place if progress is None else progress.station or "in the air"
        return "under way" if state == FLYING else state, place, doing

    @property
    def lateness_s(self) -> list[float]:
        """Return the delay of each delivered order, s; negative if it was early."""
        done = (one for _, one in self.orders.values() if one.delivered_s is not None)
        return [float(one.delivered_s or 0.0) - one.order.due.timestamp() for one in done]


def status_of(desk: Desk) -> Status:
    """Read the status of the service of a desk; an `InputError` if there is none."""
    board = Board(desk)
    found = desk.get("service", "service")
    if found is None:
        remedy = "start one: skyway dispatch run"
        raise InputError(
            "the ledger has no service of this name", field="--holder", value=desk.dispatcher, remedy=remedy
        )
    service = read(found, ServiceRecord)
    flights = board.read("flight", FlightRecord, ACTIVE)
    changes = board.read("change", ChangeRecord)
    orders = _sorted(board.read("order", OrderRecord))
    drones = _sorted(board.read("drone", DroneRecord))
    times_s = [
        service.begin_s,
        *(one.at_s for _, one in changes.values()),
        *(one.measured_s for _, one in drones.values()),
    ]
    times_s += [one.progress.at_s for _, one in flights.values() if one.progress is not None]
    unread = board.read("flight", FlightRecord, ("ended",))  # while no dispatcher runs, or one plans
    times_s += [one.end.at_s for _, one in unread.values() if one.end is not None]
    times_s += [one.cancelled_s for _, one in orders.values() if one.cancelled_s is not None]
    times_s += [one.delivered_s for _, one in orders.values() if one.delivered_s is not None]
    from skyway.dispatch.worker import worker_name

    names = [worker_name(desk.dispatcher, number) for number in range(1, service.workers + 1)]
    return Status(
        dispatcher=desk.dispatcher, state=found.state, led=desk.ledger.led(desk.dispatcher), now_s=max(times_s),
        service=service, orders=orders, drones=drones, flights=flights, pads=_sorted(_not_over(board.pads_out(), max(times_s))),
        changes=changes, holds=desk.ledger.holds(), workers={one: desk.ledger.led(one) for one in names},
    )  # fmt: skip


def _not_over(pads: dict[str, tuple[str, PadRecord]], now_s: float) -> dict[str, tuple[str, PadRecord]]:
    return {name: (state, one) for name, (state, one) in pads.items() if one.until_s > now_s}


def _sorted(found: dict[str, T]) -> dict[str, T]:
    return {name: found[name] for name in sorted(found, key=natural)}


def outcome(ledger: str, dispatcher: str) -> list[str]:
    """Return the outcome of the orders of a service, and that of the audit of the ledger's history, in words."""
    with open_ledger(ledger, create=False) as book:
        status = status_of(Desk(book, dispatcher))
        wrong = audit(book)
    counts = ", ".join(f"{status.count(one)} {one}" for one in CLOSED if status.count(one)) or "none"
    late = sum(one > 0.0 for one in status.lateness_s)
    lost = sum(state == LOST for state, _ in status.drones.values())
    return [
        f"{counted(len(status.orders), 'order')}: {counts}; {late} after the due time; {counted(len(status.changes), 'change')} of promises; {counted(lost, 'drone')} lost",
        f"history of the ledger: {'; '.join(wrong) if wrong else 'no pad was held twice'}",
    ]


def order_document(name: str, state: str, record: OrderRecord) -> dict[str, Any]:
    """Return an order as JSON values."""
    order, promise = record.order, record.promise
    return {
        "id": name,
        "state": state,
        "from": order.origin,
        "to": order.destination,
        "mass_kg": order.mass_kg,
        "kind": order.kind,
        "priority": order.priority,
        "ready": iso(order.ready),
        "due": iso(order.due),
        "drone": record.drone or (None if promise is None else promise.drone),
        "promised": None if promise is None else iso(from_posix(promise.delivered_s)),
        "chance": None if promise is None else promise.chance,
        "p50": None if promise is None or promise.p50_s is None else iso(from_posix(promise.p50_s)),
        "p95": None if promise is None or promise.p95_s is None else iso(from_posix(promise.p95_s)),
        "first_promised": None if record.first is None else iso(from_posix(record.first.delivered_s)),
        "changes": record.changes,
        "delivered": None if record.delivered_s is None else iso(from_posix(record.delivered_s)),
        "cancelled": None if record.cancelled_s is None else iso(from_posix(record.cancelled_s)),
        "cancelled_by": record.cancelled_by or None,
        "place": record.place,
        "reason": record.reason,
    }


def document_of(status: Status) -> dict[str, Any]:
    """Return a status as JSON values (``skyway.fleet-status/1``)."""
    return {
        "schema": SCHEMA,
        "dispatcher": status.dispatcher,
        "state": status.state,
        "led": status.led,
        "time": iso(from_posix(status.now_s)),
        "workers": status.workers,
        "orders": [order_document(name, state, one) for name, (state, one) in status.orders.items()],
        "drones": [_drone(status, name) for name in status.drones],
        "flights": [
            {
                "id": name, "state": state, "drone": one.drone, "order": one.order, "phase": one.phase,
                "begin": iso(from_posix(one.begin_s)), "end": iso(from_posix(one.end_s)), "late_s": one.late_s,
                "doing": None if one.progress is None else one.progress.state,
            }
            for name, (state, one) in status.flights.items()
        ],
        "pads": [
            {
                "station": one.window.station, "pad": one.window.pad, "from": iso(one.window.start), "until": iso(one.window.end),
                "state": one.state, "itinerary": one.name, "holder": one.holder,
            }
            for one in status.holds
        ],
        "out_of_order": [
            {"station": one.station, "pad": one.pad, "from": iso(from_posix(one.from_s)), "until": iso(from_posix(one.until_s)), "reason": one.reason}
            for _, one in status.pads.values()
        ],
        "changes": [
            {
                "time": iso(from_posix(one.at_s)), "order": one.order, "why": one.why,
                "before": None if one.before is None else iso(from_posix(one.before.delivered_s)),
                "after": None if one.after is None else iso(from_posix(one.after.delivered_s)),
            }
            for _, one in sorted(status.changes.values(), key=lambda pair: pair[1].at_s)
        ],
    }  # fmt: skip


def _drone(status: Status, name: str) -> dict[str, Any]:
    state, one = status.drones[name]
    flight = status.flights.get(one.flight or "")
    progress = None if flight is None else flight[1].progress
    lat, lon = (None, None) if progress is None else (progress.lat, progress.lon)
    return {
        "id": name, "type": one.vehicle.type, "state": state, "system": one.system, "home": one.vehicle.home, "place": one.place,
        "charge_percent": 100.0 * (one.soc if progress is None or progress.soc is None else progress.soc), "lat": lat, "lon": lon,
        "flight": one.flight, "aboard": one.aboard, "idle_charge_pad": None if one.idle is None else one.idle.pad, "next": [part.task for part in one.route], "reason": one.reason,
    }  # fmt: skip


def prometheus(status: Status) -> str:
    """Return figures in the text format of Prometheus."""
    lines: list[str] = []

    def family(name: str, kind: str, what: str, values: dict[str, float]) -> None:
        lines.append(f"# HELP skyway_{name} {what}")
        lines.append(f"# TYPE skyway_{name} {kind}")
        lines.extend(f"skyway_{name}{label} {value:g}" for label, value in values.items())

    late = status.lateness_s
    out = {(one.station, one.pad) for _, one in status.pads.values() if one.from_s <= status.now_s}
    late_by = [one.late_s for _, one in status.flights.values()]
    soc = {_label("drone", name): one.soc for name, (_, one) in status.drones.items()}
    booked: dict[str, float] = {}
    for hold in status.holds:
        label = _label("station", hold.window.station)
        booked[label] = booked.get(label, 0.0) + 1.0
    drones = {one: sum(state == one for state, _ in status.drones.values()) for one in (STANDING, FLYING, LOST)}
    family("orders", "gauge", "Orders by state.", {_label("state", one): status.count(one) for one in (*OPEN, *CLOSED)})
    family("orders_late", "gauge", "Orders delivered after they were due.", {"": sum(one > 0.0 for one in late)})
    family("promises_changed_total", "counter", "Promises that were changed.", {"": len(status.changes)})
    family("drones", "gauge", "Drones by state.", {_label("state", one): float(count) for one, count in drones.items()})
    family("drone_charge_ratio", "gauge", "Charge of each drone at its last stop, 0 to 1.", soc)
    family("flights", "gauge", "Flights that are not over.", {"": len(status.flights)})
    family(
        "flight_late_seconds_max",
        "gauge",
        "Greatest delay of a flight against its plan.",
        {"": max(late_by, default=0.0)},
    )
    family("pads_booked", "gauge", "Windows that are booked, by station.", booked)
    family("pads_out_of_order", "gauge", "Pads that are out of order.", {"": len(out)})
    workers = {_label("worker", name): float(alive) for name, alive in status.workers.items()}
    family("worker_up", "gauge", "Whether the lease of a worker is held.", workers)
    family("dispatcher_up", "gauge", "Whether the lease of the dispatcher is held.", {"": float(status.led)})
    return "\n".join(lines) + "\n"


def _label(name: str, value: str) -> str:
    escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'{{{name}="{escaped}"}}'
