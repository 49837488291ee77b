"""UDP sockets of a vehicle."""

from __future__ import annotations

import errno
import selectors
import socket
from typing import TYPE_CHECKING, Any

from skyway.models.base.address import bind, resolve
from skyway.models.base.errors import InputError
from skyway.sim_stub.transports.channel import Lane

if TYPE_CHECKING:
    from skyway.models.base.address import Address
    from skyway.sim_stub.transports.channel import Impairment
    from skyway.sim_stub.vehicle import Vehicle

_MAX_PEERS = 8
_READ_BYTES = 65536
_READS_PER_TURN = 64
_MAX_DATAGRAM = 1200
_GONE = frozenset({errno.ECONNREFUSED, errno.ECONNRESET, errno.ENETUNREACH, errno.EHOSTUNREACH})


class UdpEndpoint:
    """UDP: `udpout` sends first to one address, `udpin` answers all senders.

    Raises an `InputError` if the address is taken, or if there is no such host.
    """

    def __init__(
        self,
        address: Address,
        vehicle: Vehicle,
        impairment: Impairment,
        seed: str,
        selector: selectors.BaseSelector,
    ) -> None:
        self.vehicle, self.impairment, self.seed = vehicle, impairment, seed
        family, target = resolve(address, socket.SOCK_DGRAM)
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.settimeout(0.0)
        self.selector = selector
        self.peers: dict[tuple[Any, ...], Lane] = {}
        self.known = 0
        self.outgoing = address.kind == "udpout"
        if self.outgoing:
            self._peer(target)
        else:
            bind(self.socket, target, address)
        self.where = f"{address.kind}:{address.host}:{address.port or self.socket.getsockname()[1]}"
        selector.register(self.socket, selectors.EVENT_READ, self)

    def _peer(self, address: tuple[Any, ...]) -> Lane | None:
        lane = self.peers.get(address)
        if lane is None:
            if len(self.peers) >= _MAX_PEERS:  # whoever has been silent longest makes room
                silent = min(self.peers, key=lambda peer: self.peers[peer].heard_s)
                self.peers.pop(silent).close()
            self.known += 1
            try:
                lane = Lane(self.vehicle, self.impairment, f"{self.seed}/{self.known}", datagrams=True)
            except InputError:
                return None  # too many speak with this vehicle already
            self.peers[address] = lane
        return lane

    def readable(self) -> None:
        """Read datagrams, a bounded number at a time."""
        for _ in range(_READS_PER_TURN):
            try:
                data, sender = self.socket.recvfrom(_READ_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno in _GONE:  # nobody listens there yet
                    continue
                return  # the network is down: datagrams are lost, as they may be
            if self.outgoing and len(self.peers) == 1:
                lane: Lane | None = next(iter(self.peers.values()))
            else:
                lane = self._peer(sender)
            if lane is not None:
                lane.arrived(data, self.vehicle.wall_s)

    def flush(self, now_s: float) -> None:
        """Send frames, several to a datagram where the link is perfect."""
        for address, lane in self.peers.items():
            frames = lane.turn(now_s)
            if not frames:
                continue
            for packet in _packed(frames) if lane.perfect else frames:
                try:
                    self.socket.sendto(packet, address)
                except OSError:
                    break  # full, or nobody there: datagrams are lost, as they may be

    def next_s(self) -> float:
        """Due time of the next delayed packet."""
        return min((lane.next_s() for lane in self.peers.values()), default=float("inf"))

    def close(self) -> None:
        """Close."""
        for lane in self.peers.values():
            lane.close()
        self.selector.unregister(self.socket)
        self.socket.close()


def _packed(frames: list[bytes]) -> list[bytes]:
    """Join frames into datagrams below the usual size of a packet."""
    packets: list[bytes] = []
    current: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > _MAX_DATAGRAM and current:
            packets.append(b"".join(current))
            current, size = [], 0
        current.append(frame)
        size += len(frame)
    packets.append(b"".join(current))
    return packets
