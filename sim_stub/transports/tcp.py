"""TCP servers and peers with bounded backlogs, for vehicles and pads."""

from __future__ import annotations

import selectors
import socket
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from skyway.models.base.address import bind, resolve
from skyway.models.base.errors import Fault, InputError
from skyway.sim_stub.transports.channel import Lane

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.base.address import Address
    from skyway.sim_stub.transports.channel import Impairment
    from skyway.sim_stub.vehicle import Vehicle

MAX_VEHICLE_PEERS = 8
"""Ground stations at one TCP port of a vehicle."""
_MAX_BACKLOG_BYTES = 1_000_000
_READ_BYTES = 65536
_GONE_AFTER_MS = 30_000
SILENT_S = 10.0
"""Where there is no room, a peer that has said nothing for so long makes it."""
_CONNECT_S = 5.0


class TcpPeer(ABC):
    """Somebody connected; a peer that does not read is cut off rather than waited for."""

    def __init__(self, connection: socket.socket, selector: selectors.BaseSelector) -> None:
        self.socket, self.selector = connection, selector
        self.backlog = b""
        self.closed = False
        self.heard_s = time.monotonic()
        connection.settimeout(0.0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # a peer that disappeared silently does not keep its place
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _GONE_AFTER_MS)
        selector.register(connection, selectors.EVENT_READ, self)

    @abstractmethod
    def received(self, data: bytes) -> None:
        """Take bytes of the peer."""

    @abstractmethod
    def outgoing(self, now_s: float) -> bytes:
        """Bytes for the peer."""

    def left(self) -> None:  # noqa: B027  not all do anything
        """React to the end of the connection."""

    def readable(self) -> None:
        """Read what has arrived; an end or an error closes."""
        if self.closed:
            return
        try:
            data = self.socket.recv(_READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self.heard_s = time.monotonic()
        self.received(data)

    def flush(self, now_s: float) -> None:
        """Send as much as goes."""
        if self.closed:
            return
        self.backlog += self.outgoing(now_s)
        if not self.backlog:
            return
        try:
            sent = self.socket.send(self.backlog)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError:
            self.close()
            return
        self.backlog = self.backlog[sent:]
        if len(self.backlog) > _MAX_BACKLOG_BYTES:
            self.close()

    def next_s(self) -> float:
        """Next wall instant with scheduled data to send."""
        return float("inf")

    def close(self) -> None:
        """Close."""
        if not self.closed:
            self.closed = True
            self.left()
            self.selector.unregister(self.socket)
            self.socket.close()


class TcpListener:
    """A listening socket.

    `greet` makes a peer of a connection and the number of peers so far; `InputError` turns it away. More peers than
    `most` are turned away, unless one has been silent for `SILENT_S`. An address that is taken, or a host that is not
    there, is an `InputError`.
    """

    def __init__(
        self,
        address: Address,
        selector: selectors.BaseSelector,
        most: int,
        greet: Callable[[socket.socket, int], TcpPeer],
    ) -> None:
        self.selector, self.most, self.greet = selector, most, greet
        family, target = resolve(address, socket.SOCK_STREAM)
        self.socket = socket.socket(family, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.settimeout(0.0)
        bind(self.socket, target, address)
        self.socket.listen(most)
        self.where = f"tcp:{address.host}:{self.socket.getsockname()[1]}"
        self.peers: list[TcpPeer] = []
        selector.register(self.socket, selectors.EVENT_READ, self)

    def readable(self) -> None:
        """Accept."""
        try:
            connection, _ = self.socket.accept()
        except OSError:
            return
        if not self._room():
            connection.close()
            return
        try:
            self.peers.append(self.greet(connection, len(self.peers)))
        except InputError:
            connection.close()

    def _room(self) -> bool:
        """Whether there is room for one more; half-open connections do not keep it forever."""
        self.peers = [peer for peer in self.peers if not peer.closed]
        if len(self.peers) < self.most:
            return True
        silent = min(self.peers, key=lambda peer: peer.heard_s)
        if time.monotonic() - silent.heard_s < SILENT_S:
            return False
        silent.close()
        self.peers.remove(silent)
        return True

    def flush(self, now_s: float) -> None:
        """Send what is waiting to every peer."""
        for peer in self.peers:
            peer.flush(now_s)

    def next_s(self) -> float:
        """Due time of the next delayed packet."""
        return min((peer.next_s() for peer in self.peers), default=float("inf"))

    def close(self) -> None:
        """Close everything."""
        for peer in self.peers:
            peer.close()
        self.selector.unregister(self.socket)
        self.socket.close()


class VehiclePeer(TcpPeer):
    """A ground station of a vehicle."""

    def __init__(
        self, connection: socket.socket, selector: selectors.BaseSelector, lane: Lane, where: str = ""
    ) -> None:
        super().__init__(connection, selector)
        self.lane, self.where = lane, where

    def received(self, data: bytes) -> None:
        """Hand on to the vehicle."""
        self.lane.arrived(data, self.lane.vehicle.wall_s)

    def outgoing(self, now_s: float) -> bytes:
        """Return the pending bytes of the vehicle."""
        return b"".join(self.lane.turn(now_s))

    def left(self) -> None:
        """Close the vehicle's port."""
        self.lane.close()

    def next_s(self) -> float:
        """Due time of the next delayed packet."""
        return float("inf") if self.closed else self.lane.next_s()


def listen(
    address: Address, vehicle: Vehicle, impairment: Impairment, seed: str, selector: selectors.BaseSelector
) -> TcpListener:
    """Let ground stations connect to a vehicle."""

    def greet(connection: socket.socket, number: int) -> TcpPeer:
        return VehiclePeer(connection, selector, Lane(vehicle, impairment, f"{seed}/{number}", datagrams=False))

    return TcpListener(address, selector, MAX_VEHICLE_PEERS, greet)


def connect(
    address: Address, vehicle: Vehicle, impairment: Impairment, seed: str, selector: selectors.BaseSelector
) -> VehiclePeer:
    """Connect a vehicle to a ground station. Raises an `InputError` if nobody listens there."""
    where = f"tcp:{address.host}:{address.port}"
    try:
        connection = socket.create_connection((address.host, address.port), timeout=_CONNECT_S)
    except OSError as error:
        remedy = "start the ground station first, or use udpout:"
        problem = f"cannot connect: {error.strerror or error}"
        raise InputError(Fault(problem, field="--connect", value=where, remedy=remedy)) from error
    return VehiclePeer(connection, selector, Lane(vehicle, impairment, seed, datagrams=False), where)
