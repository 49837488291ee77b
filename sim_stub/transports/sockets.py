"""Sockets of simulated vehicles: UDP out and in, TCP server and client; never blocking, closed on any error."""

from __future__ import annotations

import errno
import random
import selectors
import socket
from typing import TYPE_CHECKING, Any, Protocol

from models.errors import Fault, InputError
from sim_stub.transports.channel import Channel, Impairment

if TYPE_CHECKING:
    from sim_stub.ports import Port
    from sim_stub.transports.urls import Address
    from sim_stub.vehicle import Vehicle

_MAX_PEERS = 8
_MAX_BACKLOG_BYTES = 1_000_000
_READ_BYTES = 65536
_READS_PER_TURN = 64
_MAX_DATAGRAM = 1200
_GONE_AFTER_MS = 30_000
_GONE = frozenset({errno.ECONNREFUSED, errno.ECONNRESET, errno.ENETUNREACH, errno.EHOSTUNREACH})


class Endpoint(Protocol):
    """Something with a socket in the loop."""

    def readable(self) -> None:
        """Read what is there."""
        ...

    def flush(self, now_s: float) -> None:
        """Send what is waiting."""
        ...

    def next_s(self) -> float:
        """Wall instant at which a delayed packet is due."""
        ...

    def close(self) -> None:
        """Close for good."""
        ...


class Lane:
    """One peer of a vehicle: its port, and both directions of an impaired link.

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
    """

    def __init__(self, vehicle: Vehicle, impairment: Impairment, seed: str, *, datagrams: bool) -> None:
        self.vehicle = vehicle
        self.perfect = impairment.perfect
        self.up = Channel(impairment, random.Random(f"up/{seed}"))  # noqa: S311
        self.down = Channel(impairment, random.Random(f"down/{seed}"))  # noqa: S311
        self.out: list[bytes] = []
        self.heard_s = vehicle.wall_s
        self.port: Port = vehicle.connect(self._from_vehicle, datagrams=datagrams)

    def _from_vehicle(self, frame: bytes) -> None:
        if self.perfect:
            self.out.append(frame)
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
        if not self.perfect:
            for packet in self.up.take(now_s):
                self.vehicle.receive(self.port, packet)
            self.out.extend(self.down.take(now_s))
        frames, self.out = self.out, []
        return frames

    def next_s(self) -> float:
        """When a delayed packet is due."""
        return min(self.up.next_s(), self.down.next_s())

    def close(self) -> None:
        """Cut it."""
        self.vehicle.disconnect(self.port)


class UdpEndpoint:
    """UDP: `udpout` speaks first to one address, `udpin` answers all who spoke.

    Parameters
    ----------
    address : Address
        Where.
    vehicle : Vehicle
        Whose.
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
        """When a delayed packet is due."""
        return min((lane.next_s() for lane in self.peers.values()), default=float("inf"))

    def close(self) -> None:
        """Close."""
        for lane in self.peers.values():
            lane.close()
        self.selector.unregister(self.socket)
        self.socket.close()


class TcpConnection:
    """One TCP peer of a vehicle.

    Parameters
    ----------
    connection : socket
        Connected.
    lane : Lane
        Its port.
    """

    def __init__(self, connection: socket.socket, lane: Lane, selector: selectors.BaseSelector) -> None:
        self.socket, self.lane, self.selector = connection, lane, selector
        self.backlog = b""
        self.closed = False
        connection.settimeout(0.0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # a peer that is gone without a word does not keep its place
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _GONE_AFTER_MS)
        selector.register(connection, selectors.EVENT_READ, self)

    def readable(self) -> None:
        """Read what is there; an end or an error closes."""
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
        self.lane.arrived(data, self.lane.vehicle.wall_s)

    def flush(self, now_s: float) -> None:
        """Send as much as goes; a peer that does not read is cut off rather than waited for."""
        if self.closed:
            return
        self.backlog += b"".join(self.lane.turn(now_s))
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
        """When a delayed packet is due."""
        return float("inf") if self.closed else self.lane.next_s()

    def close(self) -> None:
        """Close."""
        if not self.closed:
            self.closed = True
            self.lane.close()
            self.selector.unregister(self.socket)
            self.socket.close()


class TcpServer:
    """A listening TCP port of a vehicle; up to `_MAX_PEERS` ground stations at once.

    Parameters
    ----------
    address : Address
        Where.
    vehicle : Vehicle
        Whose.
    """

    def __init__(
        self,
        address: Address,
        vehicle: Vehicle,
        impairment: Impairment,
        seed: str,
        selector: selectors.BaseSelector,
    ) -> None:
        self.vehicle, self.impairment, self.seed, self.selector = vehicle, impairment, seed, selector
        family, target = resolve(address, socket.SOCK_STREAM)
        self.socket = socket.socket(family, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.settimeout(0.0)
        bind(self.socket, target, address)
        self.socket.listen(_MAX_PEERS)
        self.where = f"tcp:{address.host}:{self.socket.getsockname()[1]}"
        self.connections: list[TcpConnection] = []
        selector.register(self.socket, selectors.EVENT_READ, self)

    def readable(self) -> None:
        """Accept."""
        try:
            connection, _ = self.socket.accept()
        except OSError:
            return
        self.connections = [c for c in self.connections if not c.closed]
        if len(self.connections) >= _MAX_PEERS:
            connection.close()
            return
        try:
            lane = Lane(self.vehicle, self.impairment, f"{self.seed}/{len(self.connections)}", datagrams=False)
        except InputError:
            connection.close()  # too many speak with this vehicle already
            return
        self.connections.append(TcpConnection(connection, lane, self.selector))

    def flush(self, now_s: float) -> None:
        """Send what is waiting on every connection."""
        for connection in self.connections:
            connection.flush(now_s)

    def next_s(self) -> float:
        """When a delayed packet is due."""
        return min((c.next_s() for c in self.connections), default=float("inf"))

    def close(self) -> None:
        """Close everything."""
        for connection in self.connections:
            connection.close()
        self.selector.unregister(self.socket)
        self.socket.close()


class TcpClient(TcpConnection):
    """A vehicle that connects to a ground station.

    Raises
    ------
    InputError
        Nobody listens there.
    """

    def __init__(
        self,
        address: Address,
        vehicle: Vehicle,
        impairment: Impairment,
        seed: str,
        selector: selectors.BaseSelector,
    ) -> None:
        try:
            connection = socket.create_connection((address.host, address.port), timeout=5.0)
        except OSError as error:
            where = f"tcp:{address.host}:{address.port}"
            remedy = "start the ground station first, or use udpout:"
            problem = f"cannot connect: {error.strerror or error}"
            raise InputError(Fault(problem, field="--connect", value=where, remedy=remedy)) from None
        super().__init__(connection, Lane(vehicle, impairment, seed, datagrams=False), selector)
        self.where = f"tcp:{address.host}:{address.port}"


def open_endpoint(
    address: Address, vehicle: Vehicle, impairment: Impairment, seed: str, selector: selectors.BaseSelector
) -> UdpEndpoint | TcpServer | TcpClient:
    """Open what a connection string says.

    Raises
    ------
    InputError
        The address is taken, unknown or not reachable.
    """
    if address.kind == "tcp":
        return TcpClient(address, vehicle, impairment, seed, selector)
    if address.kind == "tcpin":
        return TcpServer(address, vehicle, impairment, seed, selector)
    return UdpEndpoint(address, vehicle, impairment, seed, selector)


def resolve(address: Address, kind: int) -> tuple[int, tuple[Any, ...]]:
    """Family and address of a host."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except OSError as error:
        raise InputError(
            Fault(f"unknown host: {error.strerror or error}", field="--connect", value=address.host)
        ) from None
    return found[0][0], found[0][4]


def bind(listener: socket.socket, target: tuple[Any, ...], address: Address) -> None:
    """Bind a socket, or say why not."""
    try:
        listener.bind(target)
    except OSError as error:
        listener.close()
        where = f"{address.host}:{address.port}"
        problem = f"cannot listen: {error.strerror or error}"
        remedy = "another program listens there; choose another port"
        raise InputError(Fault(problem, field="--connect", value=where, remedy=remedy)) from None


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
