"""The state of a dispatcher: orders, drones, flights and pads out of order, as on the desk and as changed by a step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.dispatch.records import (
    ACTIVE,
    CANCELLED,
    FLYING,
    HANDED_OVER,
    LOST,
    OPEN,
    TO_PACKAGE,
    Board,
    CancelRecord,
    DroneRecord,
    FlightRecord,
    OrderRecord,
    read,
)
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from skyway.dispatch.records import PadRecord, PlanStep
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.ledger import Lease


class Situation:
    """State of the dispatcher, each entry with its own state, by its id; changes are written together.

    Attributes
    ----------
    orders : dict
        Open orders, and those closed in this step.
    drones, pads : dict
        All drones; pads that are out of order, or will be.
    flights : dict
        Flights that are not closed.
    cancels : dict
        Requests to cancel orders that have no answer yet, by the id of the order.
    late_s : dict
        Delay of each flight already planned with.
    """

    def __init__(self, desk: Desk) -> None:
        self.board = Board(desk)
        self.orders: dict[str, tuple[str, OrderRecord]] = {}
        self.drones: dict[str, tuple[str, DroneRecord]] = {}
        self.flights: dict[str, tuple[str, FlightRecord]] = {}
        self.pads: dict[str, tuple[str, PadRecord]] = {}
        self.cancels: dict[str, tuple[str, CancelRecord]] = {}
        self.late_s: dict[str, float] = {}
        self._cancelled: dict[str, bool] = {}

    def read(self) -> None:
        """Read the desk; changes that were not written are dropped."""
        board = self.board
        board.forget_changes()
        self.orders = board.read("order", OrderRecord, OPEN)
        self.drones = board.read("drone", DroneRecord)
        self.flights = board.read("flight", FlightRecord, (*ACTIVE, "ended"))
        self.pads = board.pads_out()
        self.cancels = board.read("cancel", CancelRecord, ("asked",))
        self._cancelled.clear()

    def closed_order(self, name: str) -> tuple[str, OrderRecord]:
        """Return an order that was closed before this step."""
        entry = self.board.desk.get("order", name)
        if entry is None:
            raise InputError(
                "the desk has a request to cancel an order that does not exist", field="cancel", value=name
            )
        return entry.state, read(entry, OrderRecord)

    def find_order(self, name: str) -> bool:
        """Say whether an order is open, or was handed over to a person before its flight ended; that one joins `orders` again."""
        if name not in self.orders:
            self.orders.update(self.board.read_one("order", name, OrderRecord, HANDED_OVER))
        return name in self.orders

    def recalled(self, flight: FlightRecord) -> bool:
        """Say whether a drone flies to the package of a cancelled order: its worker lets it stay where it stands, or lands next."""
        order = flight.order
        if flight.phase != TO_PACKAGE or order is None:
            return False
        if order in self.orders:
            return self.orders[order][0] == CANCELLED
        if order not in self._cancelled:
            entry = self.board.desk.get("order", order)
            self._cancelled[order] = entry is not None and entry.state == CANCELLED
        return self._cancelled[order]

    def steps_of(self, flight: FlightRecord) -> tuple[PlanStep, ...]:
        """Return the steps of a flight, of one that is recalled without those after its next landing, or after its present stop."""
        progress = flight.progress
        if progress is None or not self.recalled(flight):
            return flight.steps
        ends = [number for number, one in enumerate(flight.steps) if one.kind == "fly"]
        if progress.station is None:
            return flight.steps[: ends[max(progress.flights, 1) - 1] + 1]
        return flight.steps[: ends[progress.flights]] if progress.flights < len(ends) else flight.steps

    def write(self, lease: Lease) -> None:
        """Write all changes to the desk, or none."""
        self.board.write(lease)

    def change_order(self, name: str, state: str, record: OrderRecord) -> None:
        """Change an order."""
        self.orders[name] = (state, record)
        self.board.change("order", name, state, record)

    def answer_cancel(self, name: str, reason: str) -> None:
        """Answer the request to cancel an order: done, or refused for a reason."""
        _, request = self.cancels.pop(name)
        request.reason = reason
        self.board.change("cancel", name, "refused" if reason else "done", request)

    def change_drone(self, name: str, state: str, record: DroneRecord) -> None:
        """Change a drone."""
        self.drones[name] = (state, record)
        self.board.change("drone", name, state, record)

    def begin_flight(self, number: int, drone: str, record: FlightRecord, keeper: str) -> None:
        """Give the first part of a drone's route to a worker."""
        id_ = f"{number:06d} {drone}"
        self.flights[id_] = ("ordered", record)
        self.board.change("flight", id_, "ordered", record, keeper=keeper)
        of = self.drones[drone][1]
        of.flight, of.route = id_, of.route[1:]
        self.change_drone(drone, FLYING, of)

    def close_flight(self, name: str) -> None:
        """Close a flight whose end was processed."""
        self.board.change("flight", name, "closed", self.flights.pop(name)[1])
        self.late_s.pop(name, None)

    @property
    def next_flight(self) -> int:
        """Return the number of the next flight."""
        return self.board.count("flight") + 1

    @property
    def busy(self) -> bool:
        """Whether any order is open, or any drone has a task."""
        open_orders = any(state in OPEN for state, _ in self.orders.values())
        moving = any(state != LOST and (one.flight is not None or one.route) for state, one in self.drones.values())
        return open_orders or moving or bool(self.flights)
