"""Clients of forwarding: sockets that never block, each with its own bounds."""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from skyway.link.wire.address import parse_address
from skyway.link.wire.frames import FrameReader
from skyway.link.wire.transport import open_transport
from skyway.models.base.address import bind, resolve
from skyway.models.base.errors import InputError, LinkLostError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.link.wire.signing import Signing
    from skyway.link.wire.transport import Transport
    from skyway.models.base.address import Address

MAX_CLIENTS = 8
"""Per listening address."""
_READ_BYTES = 2048
"""Limit of a datagram; complete frames are shorter, and larger ones would only cost time."""
_POLLED = 1000
"""Datagrams that are read at once: those of a flooding client are dropped one by one, and must not displace those of others in the buffer of the socket."""
_DATAGRAM_BYTES = 1200
_BACKLOG_BYTES = _SOCKET_BYTES = 65_536
"""Backlog of a slow client: beyond it packets to it are dropped, rather than delayed."""
GONE_S = 30.0
"""A client at a listening UDP address that has been silent for this long is removed."""
_STUCK_S = 10.0
"""A TCP client that reads nothing for this long is disconnected."""
RATE_BYTES, BURST_BYTES = 25_000.0, 65_536.0
"""Rate limit of a client: bytes a second, and burst. A telemetry radio carries less."""
RATE_PACKETS = 200.0
"""Packets per second: a short packet costs a vehicle as much work as a long one."""


@dataclass(slots=True)
class Allowance:
    """Remaining allowance of one client (a token bucket)."""

    left_bytes: float = BURST_BYTES
    since_s: float = 0.0

    def takes(self, size: int, now_s: float) -> bool:
        """Whether a packet of a number of bytes is within the budget; if so, subtract it."""
        size = max(size, round(RATE_BYTES / RATE_PACKETS))
        self.left_bytes = min(BURST_BYTES, self.left_bytes + RATE_BYTES * max(0.0, now_s - self.since_s))
        self.since_s = now_s
        if size > self.left_bytes:
            return False
        self.left_bytes -= size
        return True


class Way(Protocol):
    """Connection to one client."""

    def write(self, data: bytes) -> None:
        """Send frames; what cannot be sent at once waits within bounds, or is lost."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


@dataclass(eq=False, slots=True)
class Client:
    """One client, with its state as received so far."""

    name: str
    """Its address, for a person."""
    way: Way
    reader: FrameReader
    heard_s: float
    """Time of its last packet, by the clock."""
    allowance: Allowance = field(default_factory=Allowance)
    speakers: dict[tuple[int, int], float] = field(default_factory=dict)
    """System and component of the stations behind it, and when each was last received."""
    flooded: int = 0
    noted_s: deque[float] = field(default_factory=deque)
    """Time of the last note on frequent events of it."""
    """Number of its packets that were not processed."""
    garbage_bytes: int = 0
    """Number of its bytes outside MAVLink, since the last message."""
    waiting: list[bytes] = field(default_factory=list)
    waiting_bytes: int = 0
    """`waiting`, `waiting_bytes`: frames to go out together."""

    def put(self, frame: bytes) -> None:
        """Queue a frame for it."""
        if self.waiting_bytes + len(frame) > _DATAGRAM_BYTES:
            self.flush()
        self.waiting.append(frame)
        self.waiting_bytes += len(frame)

    def flush(self) -> None:
        """Send the queued frames, as one datagram."""
        if self.waiting:
            self.way.write(b"".join(self.waiting))
            self.waiting.clear()
            self.waiting_bytes = 0


class Endpoint(Protocol):
    """One address for forwarding: one client, or the clients that connect to it."""

    clients: list[Client]

    def poll(self, now_s: float) -> Iterator[tuple[Client, bytes]]:
        """Yield received data, a datagram or piece of a stream at a time; never waits."""
        ...

    def close(self) -> None:
        """Close."""
        ...


class SingleClient:
    """One client behind a transport: ``udpout``, ``tcp`` and serial lines."""

    def __init__(self, address: Address, signing: Signing | None) -> None:
        self._transport: Transport = open_transport(address)
        datagrams = address.kind.startswith("udp")
        self.clients = [Client(str(address), self._transport, FrameReader(signing, datagrams), 0.0)]

    def poll(self, now_s: float) -> Iterator[tuple[Client, bytes]]:
        """Yield received data."""
        client = self.clients[0]
        for _ in range(MAX_CLIENTS):
            try:
                data = self._transport.read(0.0)
            except LinkLostError:  # the device is gone: this client is lost, the flight is not affected
                return
            if not data:
                return
            client.heard_s = now_s
            yield client, data

    def close(self) -> None:
        """Close."""
        self._transport.close()


class _Datagrams:
    """The path to one sender of datagrams."""

    def __init__(self, shared: socket.socket, there: Any) -> None:
        self._shared, self._there = shared, there

    def write(self, data: bytes) -> None:
        """Send; failed datagrams are lost, as is normal for datagrams."""
        with contextlib.suppress(OSError):
            self._shared.sendto(data, self._there)

    def close(self) -> None:
        """Nothing to close."""


class UdpClients:
    """Clients of a listening UDP address."""

    def __init__(self, address: Address, signing: Callable[[], Signing | None]) -> None:
        family, target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(0.0)
        bind(self._socket, target, address)
        self.port: int = self._socket.getsockname()[1]
        self._signing, self._known = signing, dict[Any, Client]()
        self.clients: list[Client] = []

    def poll(self, now_s: float) -> Iterator[tuple[Client, bytes]]:
        """Yield received packets; a client that has been silent for long is removed."""
        for _ in range(_POLLED):
            try:
                data, there = self._socket.recvfrom(_READ_BYTES)
            except OSError:  # no more data, or the report that a client is gone
                return
            client = self._known.get(there) or self._meet(there, now_s)
            if client is not None:
                client.heard_s = now_s
                yield client, data

    def _meet(self, there: Any, now_s: float) -> Client | None:
        self._known = {at: one for at, one in self._known.items() if now_s <= one.heard_s + GONE_S}
        if len(self._known) >= MAX_CLIENTS:
            return None
        name = f"{there[0]}:{there[1]} (udpin port {self.port})"
        made = Client(name, _Datagrams(self._socket, there), FrameReader(self._signing(), datagrams=True), now_s)
        self._known[there] = made
        self.clients = list(self._known.values())
        return made

    def close(self) -> None:
        """Close."""
        self._socket.close()


class _Stream:
    """The path to one TCP client: complete frames wait up to a bound, and are lost beyond it."""

    def __init__(self, made: socket.socket) -> None:
        made.settimeout(0.0)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
        self.socket: socket.socket | None = made
        self._backlog: deque[bytes] = deque()
        self._backlog_bytes = 0
        self.stuck_since_s: float | None = None

    def write(self, data: bytes) -> None:
        """Send."""
        if self.socket is None or self._backlog_bytes + len(data) > _BACKLOG_BYTES:
            return
        self._backlog.append(data)
        self._backlog_bytes += len(data)
        self.push()

    def push(self) -> bool:
        """Send queued data; returns whether any was sent, or none is queued."""
        while self._backlog and self.socket is not None:
            try:
                sent = self.socket.send(self._backlog[0])
            except BlockingIOError:
                return False
            except OSError:
                self.close()
                break
            self._backlog_bytes -= sent
            rest = self._backlog.popleft()[sent:]
            if rest:
                self._backlog.appendleft(rest)
        return True

    def read(self) -> bytes | None:
        """Bytes received; None if the client has disconnected."""
        if self.socket is None:
            return None
        try:
            return self.socket.recv(_READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Disconnect."""
        if self.socket is not None:
            self.socket.close()
        self.socket = None


class TcpClients:
    """Clients of a listening TCP port."""

    def __init__(self, address: Address, signing: Callable[[], Signing | None]) -> None:
        family, target = resolve(address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.settimeout(0.0)
        bind(self._listener, target, address)
        self._listener.listen(MAX_CLIENTS)
        self.port: int = self._listener.getsockname()[1]
        self._signing = signing
        self._streams: dict[Client, _Stream] = {}
        self.clients: list[Client] = []

    def poll(self, now_s: float) -> Iterator[tuple[Client, bytes]]:
        """Yield received data; clients that disconnect, or read nothing any more, are removed."""
        self._accept(now_s)
        for client, stream in list(self._streams.items()):
            data = stream.read()
            if stream.push():
                stream.stuck_since_s = None
            elif stream.stuck_since_s is None:
                stream.stuck_since_s = now_s
            stuck = stream.stuck_since_s is not None and now_s > stream.stuck_since_s + _STUCK_S
            if data is None or stuck:
                stream.close()
                del self._streams[client]
                self.clients = list(self._streams)
            elif data:
                client.heard_s = now_s
                yield client, data

    def _accept(self, now_s: float) -> None:
        try:
            made, there = self._listener.accept()
        except OSError:
            return
        if len(self._streams) >= MAX_CLIENTS:
            made.close()
            return
        stream = _Stream(made)
        name = f"{there[0]}:{there[1]} (tcpin port {self.port})"
        self._streams[Client(name, stream, FrameReader(self._signing()), now_s)] = stream
        self.clients = list(self._streams)

    def close(self) -> None:
        """Close."""
        for stream in self._streams.values():
            stream.close()
        self._listener.close()


def open_endpoint(text: str, signing: Callable[[], Signing | None]) -> Endpoint:
    """Open an address for forwarding.

    Raises an `InputError` if it is not a connection string, or if it is taken; a `LinkLostError` if there is no answer.
    """
    address = parse_address(text, option="--forward")
    try:
        if address.kind == "udpin":
            return UdpClients(address, signing)
        if address.kind == "tcpin":
            return TcpClients(address, signing)
        return SingleClient(address, signing())
    except InputError as error:
        raise InputError([replace(fault, field="--forward") for fault in error.faults]) from None
    except LinkLostError as error:
        problem = one_line(str(error)).replace("; is the vehicle on?", "; no program listens there")
        raise LinkLostError(f"--forward: {problem}") from error
