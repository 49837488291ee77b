"""A command from COMMAND_LONG or COMMAND_INT in one form, and groups of those that are executed."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import Frame, Item
from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.autopilot.base import Autopilot
    from skyway.sim_stub.autopilot.family import Family
    from skyway.sim_stub.autopilot.items import Result
    from skyway.sim_stub.protocols.commands import CommandServer
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_FRAMES = (0, 2, 3, 5, 6)
_NO_PLACE = -(2**31)


@dataclass(frozen=True, slots=True)
class Order:
    """A command as it came."""

    number: int
    """MAV_CMD."""
    p: tuple[float, float, float, float]
    """p1 to p4."""
    lat: float
    lon: float
    """`lat`, `lon`: degrees; NaN where none is given."""
    z: float
    """p7."""
    relative: bool
    """z counts from home."""
    sender: Partner
    """Who gave it, and gets the answer."""
    as_int: bool
    """It came as COMMAND_INT."""

    @classmethod
    def of(cls, port: Port, message: Any, family: Family) -> Order | None:
        """Read a COMMAND_LONG or COMMAND_INT as a family does; None where its frame is none for a command."""
        p = (message.param1, message.param2, message.param3, message.param4)
        sender = Partner.of(port, message)
        if message.get_type() == "COMMAND_LONG":
            place = (message.param5, message.param6, message.param7)
            return cls(message.command, p, *place, family.LONG_HEIGHTS_RELATIVE, sender, as_int=False)
        if message.frame not in _FRAMES:
            return None
        lat, lon = (math.nan if v == _NO_PLACE else v * 1e-7 for v in (message.x, message.y))
        relative = family.HEEDS_FRAMES and message.frame in (Frame.RELATIVE, Frame.RELATIVE_INT)
        return cls(message.command, p, lat, lon, message.z, relative, sender, as_int=True)

    @property
    def by(self) -> str:
        """Its sender, for the log."""
        return f"station {self.sender.system}"

    @property
    def placed(self) -> bool:
        """Whether it names a place."""
        return math.isfinite(self.lat) and math.isfinite(self.lon)

    def item(self) -> Item:
        """The same as a mission item."""
        x, y = (round(self.lat * 1e7), round(self.lon * 1e7)) if self.placed else (0, 0)
        return Item(self.number, Frame.GLOBAL, *self.p, x, y, self.z)


class CommandGroup(ABC):
    """Commands that a vehicle obeys, by number."""

    def __init__(self, vehicle: Vehicle, server: CommandServer) -> None:
        self.vehicle, self.server = vehicle, server

    @abstractmethod
    def table(self) -> dict[int, Callable[[Order], Result]]:
        """Handlers by command."""

    @property
    def _pilot(self) -> Autopilot:
        return self.vehicle.autopilot
