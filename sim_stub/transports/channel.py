"""Impaired links: loss, delay, duplication and reordering, reproducible from a seed; and the path of a peer to its vehicle."""

from __future__ import annotations

import heapq
import math
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.ranges import range_faults

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port

_BUFFER_BYTES, _BUFFER_S = 2048.0, 0.05
"""What waits at most to be sent over a link of a given rate: the greater of both."""


@dataclass(frozen=True, slots=True)
class Impairment:
    """Impairment of packets on a link; each direction is sampled separately."""

    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """`delay_s`, `jitter_s`: every packet is late by the delay and a uniform share of the jitter."""
    duplicate: float = 0.0
    reorder: float = 0.0
    """`loss`, `duplicate`, `reorder`: probabilities, 0-1. A reordered packet is held back by another delay."""
    rate_byteps: float = 0.0
    """What each direction carries, bytes a second, as a radio on a serial port does; 0 is as much as is sent."""
    flow_control: bool = False
    """Whether a sender notices that such a link is full."""

    def __post_init__(self) -> None:
        faults = []
        for name in ("loss", "duplicate", "reorder"):
            faults += range_faults(name, getattr(self, name), 0.0, 1.0, "a probability, 0 to 1")
        for name in ("delay_s", "jitter_s"):
            faults += range_faults(name, getattr(self, name), 0.0, 60.0, "seconds, 0 to 60")
        faults += range_faults("rate_byteps", self.rate_byteps, 0.0, 1e9, "bytes a second; 0 is no limit")
        if faults:
            raise InputError(faults)

    @property
    def perfect(self) -> bool:
        """Whether packets simply pass."""
        return self == Impairment()


@dataclass(slots=True)
class Channel:
    """One direction of a link."""

    impairment: Impairment
    generator: random.Random
    """Its luck."""
    _queue: list[tuple[float, int, bytes]] = field(default_factory=list)
    _count: int = 0
    _last_s: float = 0.0
    _free_s: float = 0.0

    def room(self, now_s: float) -> float:
        """Bytes that it takes now; more are lost."""
        rate = self.impairment.rate_byteps
        if not rate:
            return math.inf
        return max(_BUFFER_BYTES, _BUFFER_S * rate) - max(self._free_s - now_s, 0.0) * rate

    def put(self, now_s: float, packet: bytes) -> None:
        """Send a packet."""
        how, luck = self.impairment, self.generator
        if how.rate_byteps:
            if len(packet) > self.room(now_s):
                return
            now_s = self._free_s = max(self._free_s, now_s) + len(packet) / how.rate_byteps
        if how.loss and luck.random() < how.loss:
            return
        copies = 2 if how.duplicate and luck.random() < how.duplicate else 1
        for _ in range(copies):
            at = now_s + how.delay_s
            if how.jitter_s:
                at += luck.random() * how.jitter_s
            if how.reorder and luck.random() < how.reorder:
                at += how.delay_s + how.jitter_s + 0.01
            elif not how.reorder:
                at = max(at, self._last_s)
            self._last_s = max(self._last_s, at)
            self._count += 1
            heapq.heappush(self._queue, (at, self._count, packet))

    def next_s(self) -> float:
        """Arrival of the next packet."""
        return self._queue[0][0] if self._queue else math.inf

    def take(self, now_s: float) -> list[bytes]:
        """Packets that have arrived."""
        packets = []
        while self._queue and self._queue[0][0] <= now_s:
            packets.append(heapq.heappop(self._queue)[2])
        return packets


class Lane:
    """What lies between a socket and a vehicle: a link that does something to packets, by its seed.

    Frames of `datagrams` never continue in the next bytes. Raises an `InputError` if too many speak with this vehicle
    already.
    """

    def __init__(self, vehicle: Vehicle, impairment: Impairment, seed: str, *, datagrams: bool) -> None:
        self.vehicle = vehicle
        self.perfect = impairment.perfect
        self.up = Channel(impairment, random.Random(f"up/{seed}"))  # noqa: S311
        self.down = Channel(impairment, random.Random(f"down/{seed}"))  # noqa: S311
        self.inbox: list[bytes] = []
        self.heard_s = vehicle.wall_s
        self.port: Port = vehicle.radio.connect(self._from_vehicle, datagrams=datagrams)
        self.port.room = lambda: self.down.room(vehicle.wall_s)
        self.port.paced_byteps = 0.0 if impairment.flow_control else impairment.rate_byteps

    def _from_vehicle(self, frame: bytes) -> None:
        if self.perfect:
            self.inbox.append(frame)
        else:
            self.down.put(self.vehicle.wall_s, frame)

    def arrived(self, data: bytes, now_s: float) -> None:
        """Take bytes from the peer."""
        self.heard_s = now_s
        if self.perfect:
            self.vehicle.receive(self.port, data)
        else:
            self.up.put(now_s, data)

    def turn(self, now_s: float) -> list[bytes]:
        """Hand on what has been delayed long enough; returns frames for the peer."""
        self.deliver(now_s)
        frames, self.inbox = self.inbox, []
        return frames

    def deliver(self, now_s: float) -> None:
        """Hand over what has arrived at either end."""
        for packet in self.up.take(now_s):
            self.vehicle.receive(self.port, packet)
        self.inbox.extend(self.down.take(now_s))

    def next_s(self) -> float:
        """Due time of the next delayed packet."""
        return min(self.up.next_s(), self.down.next_s())

    def close(self) -> None:
        """Cut it."""
        self.vehicle.radio.disconnect(self.port)
