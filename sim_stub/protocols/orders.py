"""A command from COMMAND_LONG or COMMAND_INT in one form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.items import Frame, Item

if TYPE_CHECKING:
    from skyway.sim_stub.wire.frames import Message
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
    def of_long(cls, port: Port, message: Message, *, relative: bool) -> Order:
        """Read a COMMAND_LONG; the family says what its heights count from."""
        f = message.fields
        p = (f["param1"], f["param2"], f["param3"], f["param4"])
        place = (f["param5"], f["param6"], f["param7"])
        return cls(f["command"], p, *place, relative, port, message.system, message.component, as_int=False)

    @classmethod
    def of_int(cls, port: Port, message: Message, *, heeds_frame: bool) -> Order | None:
        """Read a COMMAND_INT; None where its frame is none for a command."""
        f = message.fields
        if f["frame"] not in _FRAMES:
            return None
        p = (f["param1"], f["param2"], f["param3"], f["param4"])
        lat, lon = (math.nan if v == _NO_PLACE else v * 1e-7 for v in (f["x"], f["y"]))
        relative = heeds_frame and f["frame"] in (Frame.RELATIVE, Frame.RELATIVE_INT)
        return cls(f["command"], p, lat, lon, f["z"], relative, port, message.system, message.component, as_int=True)

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
