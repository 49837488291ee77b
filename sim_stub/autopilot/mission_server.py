"""The vehicle's side of the mission protocol, shared by both families."""

from __future__ import annotations

import math
import struct
import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.autopilot.items import MISSION, Answer, Frame, Item

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

PARTS = (0, 1, 2)
"""Mission types that a vehicle stores: mission, fence, rally."""


@dataclass(frozen=True, slots=True)
class Partner:
    """Who is talking: a port and a system and component on it."""

    port: Port
    system: int
    component: int

    @classmethod
    def of(cls, port: Port, message: Any) -> Partner:
        """Sender of a message."""
        return cls(port, message.get_srcSystem(), message.get_srcComponent())


class MissionServer(ABC):
    """Answers mission messages; one transfer at a time, timers at wall time.

    Parameters
    ----------
    vehicle : Vehicle
        Whose items they are.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.partner: Partner | None = None
        self.kind = MISSION
        self.expected = 0
        self.last = 0
        self.heard_s = 0.0
        self.asked_s = 0.0

    def handlers(self) -> dict[str, object]:
        """Message names with what handles them."""
        return {
            "MISSION_COUNT": self.count,
            "MISSION_ITEM": self.item,
            "MISSION_ITEM_INT": self.item,
            "MISSION_REQUEST_LIST": self.request_list,
            "MISSION_REQUEST": self.request,
            "MISSION_REQUEST_INT": self.request,
            "MISSION_CLEAR_ALL": self.clear,
            "MISSION_SET_CURRENT": self.set_current,
            "MISSION_ACK": self.acknowledged,
            "MISSION_WRITE_PARTIAL_LIST": self.write_partial,
        }

    def forget(self) -> None:
        """Drop any transfer, as a reboot does."""
        self.partner = None

    def next_wall_s(self) -> float:
        """When `tick` has something to do."""
        return math.inf

    def acknowledge(self, to: Partner, kind: int, answer: Answer, opaque_id: int = 0) -> None:
        """Send MISSION_ACK."""
        to.port.reply(
            "MISSION_ACK",
            target_system=to.system,
            target_component=to.component,
            type=int(answer),
            mission_type=kind,
            opaque_id=opaque_id,
        )

    def send_count(self, to: Partner, kind: int, count: int, opaque_id: int = 0) -> None:
        """Send MISSION_COUNT."""
        to.port.reply(
            "MISSION_COUNT",
            target_system=to.system,
            target_component=to.component,
            count=count,
            mission_type=kind,
            opaque_id=opaque_id,
        )

    def send_request(self, to: Partner, *, as_int: bool) -> None:
        """Ask for the item expected next."""
        to.port.reply(
            "MISSION_REQUEST_INT" if as_int else "MISSION_REQUEST",
            target_system=to.system,
            target_component=to.component,
            seq=self.expected,
            mission_type=self.kind,
        )
        self.asked_s = self.vehicle.wall_s

    def send_item(self, to: Partner, kind: int, index: int, item: Item, *, as_int: bool, current: bool) -> None:
        """Send one item of a download."""
        scale = 1.0 if item.frame == Frame.MISSION else 1e-7
        to.port.reply(
            "MISSION_ITEM_INT" if as_int else "MISSION_ITEM",
            target_system=to.system,
            target_component=to.component,
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
    def count(self, port: Port, message: Any) -> None:
        """Begin an upload."""

    @abstractmethod
    def item(self, port: Port, message: Any) -> None:
        """Take an item."""

    @abstractmethod
    def request_list(self, port: Port, message: Any) -> None:
        """Begin a download."""

    @abstractmethod
    def request(self, port: Port, message: Any) -> None:
        """Send an item."""

    @abstractmethod
    def clear(self, port: Port, message: Any) -> None:
        """Clear items."""

    @abstractmethod
    def set_current(self, port: Port, message: Any) -> None:
        """Make an item the current one."""

    @abstractmethod
    def acknowledged(self, port: Port, message: Any) -> None:
        """Hear the other side's MISSION_ACK."""

    @abstractmethod
    def write_partial(self, port: Port, message: Any) -> None:
        """Begin an upload of some items."""

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
