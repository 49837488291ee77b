"""Command protocol: COMMAND_LONG and COMMAND_INT, acknowledgement, progress, cancelling."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import Result
from skyway.sim_stub.protocols.flight_commands import FlightCommands
from skyway.sim_stub.protocols.operator_control import OperatorControl
from skyway.sim_stub.protocols.orders import Order
from skyway.sim_stub.protocols.system_commands import SystemCommands
from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_TELLS = 4
"""Interval between progress reports, where progress is known."""
_UNKNOWN_PROGRESS = 255


@dataclass(slots=True)
class Task:
    """A command that takes a while."""

    order: Order
    """What was asked."""
    begun_s: float
    lasts_s: float
    """`begun_s`, `lasts_s`: wall time."""
    finish: Callable[[], Result]
    """Does what is done at the end; returns the final result."""
    tells: bool = True
    """It says how far it is; otherwise only that it is under way."""
    reported: int = 0
    """How often it has said so."""

    @property
    def progress(self) -> int:
        """Percent, or 255 for unknown."""
        return self.reported * 100 // _TELLS if self.tells else _UNKNOWN_PROGRESS

    @property
    def next_s(self) -> float:
        """Wall instant at which there is something to tell."""
        return self.begun_s + self.lasts_s * ((self.reported + 1) / _TELLS if self.tells else 1.0)


class CommandServer:
    """Executes commands and answers each one."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.tasks: dict[int, Task] = {}
        self.control = OperatorControl(vehicle, self)
        groups = FlightCommands(vehicle, self), SystemCommands(vehicle, self), self.control
        self.table = {number: obeys for group in groups for number, obeys in group.table().items()}

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "COMMAND_LONG": self.command,
            "COMMAND_INT": self.command,
            "COMMAND_CANCEL": self.cancel,
        }

    def command(self, port: Port, message: Any) -> None:
        """Execute a command."""
        order = Order.of(port, message, self.vehicle.autopilot)
        if order is None:
            Partner.of(port, message).tell("COMMAND_ACK", command=message.command, result=int(Result.DENIED))
            return
        if self.control.denies(order.sender.system, order.number):
            self._answer(order, Result.DENIED)
            return
        unsupported = order.number in self.vehicle.autopilot.UNSUPPORTED
        handler = None if unsupported else self.table.get(order.number)
        self._answer(order, Result.UNSUPPORTED if handler is None else handler(order))

    def _answer(self, order: Order, result: Result) -> None:
        task = self.tasks.get(order.number)
        progress = task.progress if task is not None and result == Result.IN_PROGRESS else 0
        order.sender.tell("COMMAND_ACK", command=order.number, result=int(result), progress=progress)

    # What takes a while

    def begin(self, order: Order, lasts_s: float, finish: Callable[[], Result], *, tells: bool = True) -> Result:
        """Start a command that takes a while; repeated requests meanwhile are answered with its progress."""
        if order.number not in self.tasks:
            self.tasks[order.number] = Task(order, self.vehicle.wall_s, lasts_s, finish, tells)
        return Result.IN_PROGRESS

    def drop(self, number: int) -> None:
        """Cancel the work of a command, and tell its sender."""
        task = self.tasks.pop(number, None)
        if task is not None:
            self._answer(task.order, Result.CANCELLED)

    def next_wall_s(self) -> float:
        """Next time at which progress is reported."""
        return min(task.next_s for task in self.tasks.values()) if self.tasks else math.inf

    def tick(self) -> None:
        """Report progress, and the end."""
        now = self.vehicle.wall_s
        for number, task in list(self.tasks.items()):
            while task.next_s <= now and number in self.tasks:
                task.reported += 1
                if task.tells and task.reported < _TELLS:
                    self._answer(task.order, Result.IN_PROGRESS)
                    continue
                del self.tasks[number]
                task.order.sender.tell("COMMAND_ACK", command=number, result=int(task.finish()), progress=100)

    def cancel(self, port: Port, message: Any) -> None:  # noqa: ARG002
        """Cancel what takes long."""
        self.drop(message.command)

    def forget(self) -> None:
        """Drop what is under way."""
        self.tasks.clear()
