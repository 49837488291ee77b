"""One peer of a vehicle: its port, and both directions of an impaired link."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from skyway.sim_stub.transports.channel import Channel, Impairment

if TYPE_CHECKING:
    from skyway.sim_stub.vehicle import Vehicle
    from skyway.sim_stub.wire.ports import Port


class Lane:
    """What lies between a socket and a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
        At this end.
    impairment : Impairment
        What the link does.
    seed : str
        Its luck.
    datagrams : bool
        Frames never continue in the next bytes.

    Raises
    ------
    InputError
        Too many speak with this vehicle already.
    """

    def __init__(self, vehicle: Vehicle, impairment: Impairment, seed: str, *, datagrams: bool) -> None:
        self.vehicle = vehicle
        self.perfect = impairment.perfect
        self.up = Channel(impairment, random.Random(f"up/{seed}"))  # noqa: S311
        self.down = Channel(impairment, random.Random(f"down/{seed}"))  # noqa: S311
        self.inbox: list[bytes] = []
        self.heard_s = vehicle.wall_s
        self.port: Port = vehicle.connect(self._from_vehicle, datagrams=datagrams)

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
        """When a delayed packet is due."""
        return min(self.up.next_s(), self.down.next_s())

    def close(self) -> None:
        """Cut it."""
        self.vehicle.disconnect(self.port)
