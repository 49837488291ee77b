"""A port: a two-way connection of a vehicle, with its own frames, signing and message intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.wire.messages import Mavlink, message, message_id

if TYPE_CHECKING:
    from collections.abc import Callable


def _any_room() -> float:
    return math.inf


@dataclass(slots=True)
class Stream:
    """A message sent at intervals of simulated time."""

    interval_s: float
    due_s: float
    """`interval_s`, `due_s`: between two, and when the next is due."""


@dataclass(eq=False, slots=True)
class Port:
    """One connection of a vehicle."""

    send: Callable[[bytes], None]
    """Takes the bytes of one frame."""
    mavlink: Mavlink
    """Frames out and in."""
    datagrams: bool
    """Frames never continue in the next bytes."""
    version: int = 2
    """MAVLink 1 or 2, as it speaks."""
    streams: dict[int, Stream] = field(default_factory=dict)
    """By message id."""
    next_due_s: float = math.inf
    """When the next stream is due."""
    shortest_s: float = math.inf
    """Interval of the fastest stream."""
    heard_version_2: bool = False
    beside: dict[int, Mavlink] = field(default_factory=dict)
    """Frames of other components of the vehicle, each with numbers of its own."""
    closed: bool = False
    muted: bool = False
    room: Callable[[], float] = _any_room
    """Bytes that the link takes now without losing any."""
    paced_byteps: float = 0.0
    """Rate of a link without flow control, bytes a second, which a sender must not fill; 0 where it need not care."""

    def write(self, sent: Any, component: int = 0) -> None:
        """Send a message as a frame; of another component of the vehicle where one is named."""
        mavlink = self.mavlink
        if component:
            mavlink = self.beside.setdefault(component, Mavlink(self.mavlink.srcSystem, component))
            mavlink.signing = self.mavlink.signing
        frame = None if self.muted else mavlink.frame(sent, self.version)
        if frame is not None:
            self.send(frame)

    def reply(self, name: str, /, **fields: Any) -> None:
        """Send a message by name."""
        self.write(message(name, **fields))

    def hear(self, data: bytes) -> list[Any]:
        """Messages that bytes complete."""
        return self.mavlink.hear(data, whole=self.datagrams)

    def set_interval(self, name: str, interval_s: float | None, now_s: float) -> None:
        """Send a message every so often from now on; None stops it."""
        if interval_s is None:
            self.streams.pop(message_id(name), None)
        else:
            self.streams[message_id(name)] = Stream(interval_s, now_s)
        self.reschedule()

    def reschedule(self) -> None:
        """Find when the next stream is due, and how fast the fastest is."""
        self.shortest_s = min((stream.interval_s for stream in self.streams.values()), default=math.inf)
        self.next_due_s = min((stream.due_s for stream in self.streams.values()), default=math.inf)


@dataclass(frozen=True, slots=True)
class Partner:
    """A communication partner: a port, and a system and component on it."""

    port: Port
    system: int
    component: int

    @classmethod
    def of(cls, port: Port, message: Any) -> Partner:
        """Sender of a message."""
        return cls(port, message.get_srcSystem(), message.get_srcComponent())

    def tell(self, name: str, **fields: Any) -> None:
        """Send a message to it."""
        self.port.reply(name, target_system=self.system, target_component=self.component, **fields)
