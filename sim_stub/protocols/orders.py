"""A command from COMMAND_LONG or COMMAND_INT in one form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import Frame, Item

if TYPE_CHECKING:
    from skyway.sim_stub.wire.ports import Port

_FRAMES = (0, 2, 3, 5, 6)
_NO_PLACE = -(2**31)


@dataclass(frozen=True, slots=True)
class Order:
    """A command as it came.

    Attributes
    ----------
    number : int
        MAV_CMD.
    p : tuple of float
        p1 to p4.
    lat, lon : float
        Degrees; NaN where none is given.
    z : float
        p7.
    relative : bool
        z counts from home.
    port : Port
        Where it came from and the answer goes.
    system, component : int
        Who sent it.
    as_int : bool
        It came as COMMAND_INT.
    """

    number: int
    p: tuple[float, float, float, float]
    lat: float
    lon: float
    z: float
    relative: bool
    port: Port
    system: int
    component: int
    as_int: bool

    @classmethod
    def of_long(cls, port: Port, message: Any, *, relative: bool) -> Order:
        """Read a COMMAND_LONG; the family says what its heights count from."""
        p = (message.param1, message.param2, message.param3, message.param4)
        place = (message.param5, message.param6, message.param7)
        return cls(
            message.command,
            p,
            *place,
            relative,
            port,
            message.get_srcSystem(),
            message.get_srcComponent(),
            as_int=False,
        )

    @classmethod
    def of_int(cls, port: Port, message: Any, *, heeds_frame: bool) -> Order | None:
        """Read a COMMAND_INT; None where its frame is none for a command."""
        if message.frame not in _FRAMES:
            return None
        p = (message.param1, message.param2, message.param3, message.param4)
        lat, lon = (math.nan if v == _NO_PLACE else v * 1e-7 for v in (message.x, message.y))
        relative = heeds_frame and message.frame in (Frame.RELATIVE, Frame.RELATIVE_INT)
        return cls(
            message.command,
            p,
            lat,
            lon,
            message.z,
            relative,
            port,
            message.get_srcSystem(),
            message.get_srcComponent(),
            as_int=True,
        )

    @property
    def by(self) -> str:
        """Who gave it, for the log."""
        return f"station {self.system}"

    @property
    def placed(self) -> bool:
        """Whether it names a place."""
        return math.isfinite(self.lat) and math.isfinite(self.lon)

    def item(self) -> Item:
        """The same as a mission item."""
        x, y = (round(self.lat * 1e7), round(self.lon * 1e7)) if self.placed else (0, 0)
        return Item(self.number, Frame.GLOBAL, *self.p, x, y, self.z)
