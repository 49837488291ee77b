"""Files of orders and of the drones of a fleet: CSV, or JSON (``skyway.orders/1``, ``skyway.vehicles/1``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.orders.order import MAX_PRIORITY, Order, Vehicle
from skyway.models.orders.rows import Row, checked_rows, fault_at, read_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

T = TypeVar("T", Order, Vehicle)
ORDER_FIELDS = ("id", "from", "to", "mass_kg", "ready", "due")
ORDER_OPTIONAL = ("kind", "priority", "value")
VEHICLE_FIELDS = ("id", "type", "home")
VEHICLE_OPTIONAL = ("at", "charge_percent", "available_from", "available_to", "battery_health_percent")
"""Columns of the two files, required and optional."""
LONGEST_S = 48 * 3600.0
"""From ready to due: as far ahead as forecasts are used."""


def read_orders(path: Path) -> tuple[Order, ...]:
    """Read orders; an `InputError` lists every fault of the file, each with its line (CSV) or place in the list (JSON)."""
    return _without_faults(*orders_in(path))


def orders_in(path: Path) -> tuple[list[Order], list[Fault]]:
    """Return the orders of a file, those with faults too, whose missing texts are empty, and the faults."""
    return _rows_in(path, "orders", (ORDER_FIELDS, ORDER_OPTIONAL), _order, "two orders have the same id")


def order_of(values: Mapping[str, Any], source: str) -> Order:
    """Read one order from values that were typed or sent; an `InputError` lists every fault."""
    faults: list[Fault] = []
    rows = checked_rows([(Fault("", source), dict(values))], ORDER_FIELDS, ORDER_OPTIONAL, faults)
    orders = [_order(row) for row in rows]
    refuse(faults)
    return orders[0]


def read_vehicles(path: Path) -> tuple[Vehicle, ...]:
    """Read the drones of a fleet; an `InputError` lists every fault of the file."""
    return _without_faults(*vehicles_in(path))


def vehicles_in(path: Path) -> tuple[list[Vehicle], list[Fault]]:
    """Return the drones of a file, those with faults too, whose missing texts are empty, and the faults."""
    return _rows_in(path, "vehicles", (VEHICLE_FIELDS, VEHICLE_OPTIONAL), _vehicle, "two drones have the same id")


def read_both(orders: Path | None, vehicles: Path | None) -> tuple[tuple[Order, ...], tuple[Vehicle, ...]]:
    """Read the files that are given; an `InputError` lists every fault of both."""
    ordered, faults = ([], []) if orders is None else orders_in(orders)
    drones, more = ([], []) if vehicles is None else vehicles_in(vehicles)
    refuse([*faults, *more])
    return tuple(ordered), tuple(drones)


def _rows_in(
    path: Path, key: str, fields: tuple[Sequence[str], Sequence[str]], read: Callable[[Row], T], twice: str
) -> tuple[list[T], list[Fault]]:
    faults: list[Fault] = []
    found: list[T] = []
    try:
        found += (read(row) for row in read_rows(path, key, *fields, faults))
    except InputError as error:
        faults += error.faults
    return found, _by_line(faults + _doubles(found, twice))


def _without_faults(rows: list[T], faults: list[Fault]) -> tuple[T, ...]:
    refuse(faults)
    return tuple(rows)


def _order(row: Row) -> Order:
    ready, due = row.instant("ready"), row.instant("due")
    if ready is not None and due is not None:
        if due <= ready:
            row.fault("due", "is not after ready", f"later than {row.values['ready']}")
        elif (due - ready).total_seconds() > LONGEST_S:
            row.fault("due", "is more than 48 h after ready", "forecasts cover 48 h")
    mass = row.number("mass_kg", 0.0, 1000.0)
    value = row.number("value", 0.0, 1e12, -1.0)
    order = Order(
        id=_order_id(row),
        origin=_place(row, "from"),
        destination=_place(row, "to"),
        mass_kg=mass,
        ready=ready,  # type: ignore[arg-type]  # missing: a fault, and the order is not handed out
        due=due,  # type: ignore[arg-type]
        kind=row.text("kind", ""),
        priority=row.whole("priority", 0, MAX_PRIORITY, 0),
        value=None if value < 0.0 else value,
        source=row.place,
    )
    if order.origin and order.origin == order.destination:
        row.fault("to", "is where the order comes from", "another place")
    return order


def _order_id(row: Row) -> str:
    """Read the id of an order; it can be asked for by the HTTP API, as one segment of a path."""
    name = row.text("id")
    if "/" in name or name in {".", ".."}:
        row.fault("id", "cannot be asked for in a path", "an id without /, and not . or ..")
    return name


def _vehicle(row: Row) -> Vehicle:
    begin, end = row.instant("available_from", required=False), row.instant("available_to", required=False)
    if begin is not None and end is not None and end <= begin:
        row.fault("available_to", "is not after available_from", f"later than {row.values['available_from']}")
    home = row.text("home")
    return Vehicle(
        id=row.text("id"),
        type=row.text("type"),
        home=home,
        place=row.text("at", home),
        soc=_percent(row, "charge_percent", 0.0),
        available_from=begin,
        available_to=end,
        battery_health=_percent(row, "battery_health_percent", 10.0),
        source=row.place,
    )


def _percent(row: Row, field: str, low: float) -> float:
    """Read percent as a share; without it, the whole."""
    percent = row.number(field, low, 100.0, 100.0, " percent")
    if 0.0 < percent < 1.0:
        row.fault(field, "is probably a share: it is read as percent", f"{100.0 * percent:g} for {100.0 * percent:g} %")
    return percent / 100.0


def _place(row: Row, field: str) -> str:
    """Read a place: a text, or in JSON also [lat, lon]."""
    value = row.values.get(field)
    pair = value if isinstance(value, list) and len(value) == 2 else None
    if pair is not None and all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in pair):
        return f"{pair[0]},{pair[1]}"
    return row.text(field)


def _doubles(rows: Iterable[Order | Vehicle], problem: str) -> list[Fault]:
    """Faults of ids that occur twice."""
    first: dict[str, Fault] = {}
    faults = []
    for one in rows:
        known = first.setdefault(one.id, one.source)
        if one.id and known is not one.source:
            where = f"on line {known.line}" if known.line else f"at {known.field}"
            faults.append(fault_at(one.source, "id", problem, one.id, f"it is already {where}"))
    return faults


def _by_line(faults: list[Fault]) -> list[Fault]:
    return sorted(faults, key=lambda fault: fault.line or 0)
