"""The vehicle's side of the mission protocol, shared by both families."""

from __future__ import annotations

import math
import struct
import zlib
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import MISSION, Answer, Frame, Item
from skyway.sim_stub.wire.ports import Partner

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_METHODS = {
    "MISSION_COUNT": "count",
    "MISSION_ITEM": "item",
    "MISSION_ITEM_INT": "item",
    "MISSION_REQUEST_LIST": "request_list",
    "MISSION_REQUEST": "request",
    "MISSION_REQUEST_INT": "request",
    "MISSION_CLEAR_ALL": "clear",
    "MISSION_SET_CURRENT": "set_current",
    "MISSION_ACK": "acknowledged",
    "MISSION_WRITE_PARTIAL_LIST": "write_partial",
}
"""Method of a family's server that handles a message: it takes the sender, the mission type and the message."""
PARTS = (0, 1, 2)
"""Mission types that a vehicle stores: mission, fence, rally."""


class MissionServer(ABC):
    """Answers the mission messages that its family handles; one transfer at a time, timers at wall time."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.partner: Partner | None = None
        self.kind = MISSION
        self.expected = 0
        self.last = 0
        self.heard_s = 0.0
        self.asked_s = 0.0
        self._obeyed: dict[str, Callable[[Partner, int, Any], None]] = {
            name: getattr(self, method) for name, method in _METHODS.items() if hasattr(self, method)
        }

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return dict.fromkeys(self._obeyed, self.hear)

    def hear(self, port: Port, message: Any) -> None:
        """Handle a message of the protocol."""
        kind = getattr(message, "mission_type", MISSION)
        self._obeyed[message.get_type()](Partner.of(port, message), kind, message)

    def forget(self) -> None:
        """Drop any transfer, as a reboot does."""
        self.partner = None

    def next_wall_s(self) -> float:
        """Next time at which `tick` has work."""
        return math.inf

    def acknowledge(self, to: Partner, kind: int, answer: Answer, opaque_id: int = 0) -> None:
        """Send MISSION_ACK."""
        to.tell("MISSION_ACK", type=int(answer), mission_type=kind, opaque_id=opaque_id)

    def send_count(self, to: Partner, kind: int, count: int, opaque_id: int = 0) -> None:
        """Send MISSION_COUNT."""
        to.tell("MISSION_COUNT", count=count, mission_type=kind, opaque_id=opaque_id)

    def send_request(self, to: Partner, *, as_int: bool) -> None:
        """Ask for the item expected next."""
        name = "MISSION_REQUEST_INT" if as_int else "MISSION_REQUEST"
        to.tell(name, seq=self.expected, mission_type=self.kind)
        self.asked_s = self.vehicle.wall_s

    def send_item(self, to: Partner, kind: int, index: int, item: Item, *, as_int: bool, current: bool) -> None:
        """Send one item of a download."""
        scale = 1.0 if item.frame == Frame.MISSION else 1e-7
        to.tell(
            "MISSION_ITEM_INT" if as_int else "MISSION_ITEM",
            seq=index,
            frame=int(item.frame),
            command=int(item.command),
            current=int(current),
            autocontinue=item.autocontinue,
            param1=item.p1,
            param2=item.p2,
            param3=item.p3,
            param4=item.p4,
            x=item.x if as_int else item.x * scale,
            y=item.y if as_int else item.y * scale,
            z=item.z,
            mission_type=kind,
        )

    @staticmethod
    def read_item(message: Any) -> Item:
        """Item of a message, from INT or float fields."""
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            scale = 1.0 if message.frame == Frame.MISSION else 1e7
            x, y = (_whole(v * scale) for v in (x, y))
        return Item(
            message.command,
            message.frame,
            message.param1,
            message.param2,
            message.param3,
            message.param4,
            x,
            y,
            message.z,
            message.autocontinue,
        )

    @abstractmethod
    def tick(self) -> None:
        """Repeat requests, give up in the end."""


def _whole(value: float) -> int:
    """Nearest 32-bit integer; what is not a number is 0."""
    if not math.isfinite(value):
        return 0
    return max(-(2**31), min(2**31 - 1, round(value)))


def identity(items: Sequence[Item]) -> int:
    """Opaque id of a list of items: 0 for none, else its checksum."""
    if not items:
        return 0
    crc = 0
    for i in items:
        crc = zlib.crc32(
            struct.pack("<IIB4fiif", i.frame, i.command, i.autocontinue & 0xFF, i.p1, i.p2, i.p3, i.p4, i.x, i.y, i.z),
            crc,
        )
    return crc or 1
