"""A port of a vehicle: its frames, signing and message intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skyway.sim_stub.wire.frames import FrameReader, FrameWriter
from skyway.sim_stub.wire.messages import MessageSpec, spec

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(slots=True)
class Stream:
    """A message sent at intervals of simulated time.

    Attributes
    ----------
    interval_s, due_s : float
        Between two, and when the next is due.
    """

    message: MessageSpec
    interval_s: float
    due_s: float


@dataclass(eq=False, slots=True)
class Port:
    """One connection of a vehicle.

    Attributes
    ----------
    send : callable
        Takes the bytes of one frame.
    writer, reader : FrameWriter, FrameReader
        Frames out and in.
    streams : dict
        By message id.
    next_due_s : float
        When the next stream is due.
    shortest_s : float
        Interval of the fastest stream.
    tamper : callable or None
        Changes payloads before they are framed and signed: a vehicle that says what is not so.
    """

    send: Callable[[bytes], None]
    writer: FrameWriter
    reader: FrameReader
    streams: dict[int, Stream] = field(default_factory=dict)
    next_due_s: float = math.inf
    shortest_s: float = math.inf
    heard_version_2: bool = False
    closed: bool = False
    muted: bool = False
    tamper: Callable[[MessageSpec, bytes], bytes] | None = None

    @classmethod
    def of(cls, system: int, send: Callable[[bytes], None], *, datagrams: bool) -> Port:
        """Make a port that speaks for a system; `datagrams` where frames never continue in the next bytes."""
        return cls(send, FrameWriter(system, 1), FrameReader(whole=datagrams))

    def write(self, message: MessageSpec, payload: bytes) -> None:
        """Send a payload as a frame."""
        if self.tamper is not None:
            payload = self.tamper(message, payload)
        frame = None if self.muted else self.writer.frame(message, payload)
        if frame is not None:
            self.send(frame)

    def reply(self, name: str, **fields: Any) -> None:
        """Send a message by name."""
        message = spec(name)
        self.write(message, message.pack(fields))

    def set_interval(self, message: MessageSpec, interval_s: float | None, now_s: float) -> None:
        """Send a message every so often from now on; None stops it."""
        if interval_s is None:
            self.streams.pop(message.id, None)
        else:
            self.streams[message.id] = Stream(message, interval_s, now_s)
        self.reschedule()

    def reschedule(self) -> None:
        """Find when the next stream is due, and how fast the fastest is."""
        self.shortest_s = min((stream.interval_s for stream in self.streams.values()), default=math.inf)
        self.next_due_s = min((stream.due_s for stream in self.streams.values()), default=math.inf)
