"""Orders and drones matched to a scenario: their places to nodes of its network, their types to its drones."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.orders.files import orders_in, vehicles_in
from skyway.models.orders.rows import fault_at

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.models.orders.order import Order, Vehicle
    from skyway.models.scenario.scenario import Scenario

MAX_TARGETS = 5000
"""Places that are not stations: each becomes a node of the network."""
TOLERATED_KG = 1e-9
"""Rounding of masses."""
_POSITION = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*,\s*([+-]?\d+(?:\.\d+)?)\s*")


@dataclass(frozen=True)
class Work:
    """Orders and drones in a scenario; their places are ids of its nodes."""

    scenario: Scenario
    orders: tuple[Order, ...]
    vehicles: tuple[Vehicle, ...]

    def carriers(self, order: Order) -> tuple[Vehicle, ...]:
        """Return the drones that can carry the package of an order."""
        most_kg = {one.id: one.max_payload_kg for one in self.scenario.drones}
        return tuple(one for one in self.vehicles if order.mass_kg <= most_kg[one.type] + TOLERATED_KG)

    def too_heavy(self, order: Order) -> str | None:
        """Say that an order is heavier than any drone of the fleet carries; None if it is not."""
        if self.carriers(order):
            return None
        most_kg = max(self.scenario.drone(one.type).max_payload_kg for one in self.vehicles)
        return f"its {order.mass_kg:g} kg are more than any drone of the fleet carries (up to {most_kg:g} kg)"


def fit(scenario: Scenario, orders: Sequence[Order], vehicles: Sequence[Vehicle]) -> Work:
    """Find the places and types of orders and drones; targets given as ``lat,lon`` join the network.

    An `InputError` lists every order and drone that does not fit: places and types that are unknown, homes without a pad.
    """
    work, faults = _fitted(scenario, orders, vehicles)
    if not vehicles:
        faults.append(Fault("the fleet is empty", field="fleet", remedy="one drone or more"))
    refuse(faults)
    return work


def read_work(scenario: Scenario, orders: Path, vehicles: Path) -> Work:
    """Read orders and drones, and match them to a scenario; an `InputError` lists every fault of both files, as they are and in the scenario."""
    ordered, faults = orders_in(orders)
    drones, more = vehicles_in(vehicles)
    work, unfit = _fitted(scenario, ordered, drones)
    found = [*faults, *more, *unfit]
    refuse(sorted(found, key=lambda one: (one.file == str(vehicles), one.line or 0)))
    return work


def _fitted(scenario: Scenario, orders: Sequence[Order], vehicles: Sequence[Vehicle]) -> tuple[Work, list[Fault]]:
    places = _Places(scenario)
    fitted = [_vehicle(one, places) for one in vehicles]
    wanted = [_order(one, places) for one in orders]
    return Work(places.scenario, tuple(wanted), tuple(fitted)), places.faults


class _Places:
    """Finds each place once; faults are collected."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.faults: list[Fault] = []
        self._found: dict[str, str | Fault] = {}
        self._targets = 0

    def find(self, text: str, source: Fault, field: str, *, targets: bool = True) -> str:
        """Return the id of the node that a text names; the text itself, with a fault, if there is none. A missing text is a fault of its file."""
        if not text:
            return text
        if text not in self._found:
            try:
                self._found[text] = self._look_up(text, targets=targets)
            except InputError as error:
                self._found[text] = error.faults[0]
        found = self._found[text]
        if isinstance(found, Fault):
            self.faults.append(fault_at(source, field, found.problem, text, found.remedy))
            return text
        return found

    def _look_up(self, text: str, *, targets: bool) -> str:
        match, network = _POSITION.fullmatch(text), self.scenario.network
        if match is None:
            return network.stations[network.find(text)].id
        if not targets:
            raise InputError("is not a station", remedy="drones stand at stations: name one by its id")
        if self._targets >= MAX_TARGETS:
            raise InputError(f"more than {MAX_TARGETS:,} places that are not stations", remedy="dispatch them in parts")
        wider = self.scenario.with_target(float(match[1]), float(match[2]), id=f"{match[1]},{match[2]}")
        if len(wider.network.tail) == len(network.tail):
            raise InputError("no segment leads there", remedy="a place nearer to a station; lat comes before lon")
        self.scenario = wider
        self._targets += 1
        bends = len(wider.network) - len(network)
        return next(one.id for one in wider.network.stations[-bends:] if not one.flyover)


def _order(order: Order, places: _Places) -> Order:
    origin = places.find(order.origin, order.source, "from")
    destination = places.find(order.destination, order.source, "to")
    if origin == destination and order.origin != order.destination:
        places.faults.append(fault_at(order.source, "to", "is where the order comes from", order.destination))
    return replace(order, origin=origin, destination=destination)


def _vehicle(vehicle: Vehicle, places: _Places) -> Vehicle:
    known = [drone.id for drone in places.scenario.drones]
    if vehicle.type and vehicle.type not in known:
        remedy = "one of " + ", ".join(known)
        places.faults.append(fault_at(vehicle.source, "type", "is not a drone of the scenario", vehicle.type, remedy))
    home = _pads_of(vehicle, vehicle.home, "home", places)
    place = home if vehicle.place == vehicle.home else _pads_of(vehicle, vehicle.place, "at", places)
    return replace(vehicle, home=home, place=place)


def _pads_of(vehicle: Vehicle, text: str, field: str, places: _Places) -> str:
    """Return the id of the station with pads that a field of a drone names."""
    node = places.find(text, vehicle.source, field, targets=False)
    network = places.scenario.network
    if node in network.index and not network.stations[network.index[node]].pads:
        places.faults.append(fault_at(vehicle.source, field, "has no pads", node, "a station with pads"))
    return node
