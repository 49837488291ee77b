"""Ways to the vehicles: UDP, TCP and serial lines, never blocking longer than asked, connected again by themselves."""

from __future__ import annotations

import errno
import os
import select
import socket
import time
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from models.errors import Fault, InputError, LinkLostError

if TYPE_CHECKING:
    from link.address import Address

_READ_BYTES = 65536
_AGAIN_S = 1.0
_CONNECT_S = 2.0
_ROUTE_S = 5.0
_MAX_ROUTES = 255
_MAX_BACKLOG_BYTES = 1_000_000
_NOBODY = frozenset({errno.ECONNREFUSED, errno.ENETUNREACH, errno.EHOSTUNREACH, errno.EHOSTDOWN, errno.ENETDOWN})
"""UDP to where nobody listens yet; packets are lost, as radios lose them."""


class Transport(Protocol):
    """Bytes in and out."""

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Return what has come, at the latest after the time-out; empty for nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Send one frame; a link that is down loses it."""
        ...

    def close(self) -> None:
        """Close."""
        ...


@runtime_checkable
class Routed(Protocol):
    """A transport with several others at the far end."""

    def learn(self, system: int) -> None:
        """The packet read last came from that vehicle, and was believed."""
        ...

    def write_to(self, system: int, data: bytes) -> None:
        """Send one frame towards that vehicle, or to all where its way is not known."""
        ...


def open_transport(address: Address) -> Transport:
    """Open what a connection string says.

    Raises
    ------
    InputError
        The address is taken or unknown, or the device cannot be opened.
    LinkLostError
        Nobody answers there.
    """
    if address.kind == "serial":
        from link.serial_line import SerialLine

        return SerialLine(address)
    if address.kind == "tcp":
        return TcpClient(address)
    if address.kind == "tcpin":
        return TcpServer(address)
    return UdpSocket(address)


class UdpSocket:
    """UDP: `udpout` speaks first to one address, `udpin` answers those who spoke.

    Parameters
    ----------
    address : Address
        Where.
    """

    def __init__(self, address: Address) -> None:
        family, target = _resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(0.0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        self._target: Any = None if address.listens else target
        self._routes: dict[int, tuple[Any, float]] = {}
        self._sender: Any = None
        if address.listens:
            _bind(self._socket, target, address)
        self.port: int = self._socket.getsockname()[1]

    def read(self, timeout_s: float = 0.0) -> bytes:
        """One datagram."""
        for wait in (0.0, timeout_s):
            if wait > 0.0:
                select.select([self._socket], [], [], wait)
            try:
                data, self._sender = self._socket.recvfrom(_READ_BYTES)
            except BlockingIOError:
                continue
            except OSError as error:
                if error.errno in _NOBODY:
                    continue
                raise LinkLostError(f"the connection failed: {error.strerror or error}") from None
            if self._target is None or self._sender[:2] == self._target[:2]:
                return data
        return b""

    def learn(self, system: int) -> None:
        """Remember the way to a vehicle; another address takes it over only when the first has been silent."""
        if self._target is not None:
            return
        known, now = self._routes.get(system), time.monotonic()
        if known is None and len(self._routes) >= _MAX_ROUTES:
            return
        if known is None or known[0] == self._sender or now > known[1] + _ROUTE_S:
            self._routes[system] = (self._sender, now)

    def write_to(self, system: int, data: bytes) -> None:
        """Send towards one vehicle."""
        route = self._routes.get(system)
        if self._target is None and route is not None:
            self._send(data, route[0])
        else:
            self.write(data)

    def write(self, data: bytes) -> None:
        """Send to all."""
        targets = [self._target] if self._target is not None else {route for route, _ in self._routes.values()}
        for target in targets:
            self._send(data, target)

    def _send(self, data: bytes, target: Any) -> None:
        try:
            self._socket.sendto(data, target)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in _NOBODY:
                raise LinkLostError(f"the connection failed: {error.strerror or error}") from None

    def close(self) -> None:
        """Close."""
        self._socket.close()


class TcpClient:
    """TCP to one address; tries again every second after the other side has gone.

    Raises
    ------
    LinkLostError
        Nobody listens there at the start.
    """

    def __init__(self, address: Address) -> None:
        self.address = address
        self._socket: socket.socket | None = None
        self._backlog = b""
        self._tried_s = 0.0
        problem = self._connect()
        if problem is not None:
            raise LinkLostError(f"cannot connect to {address}: {problem}; is the vehicle on?")

    def _connect(self) -> str | None:
        self._tried_s = time.monotonic()
        try:
            made = socket.create_connection((self.address.host, self.address.port), timeout=_CONNECT_S)
        except OSError as error:
            return error.strerror or str(error)
        made.settimeout(0.0)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._backlog = made, b""
        return None

    def _connected(self) -> socket.socket | None:
        return self._socket

    @property
    def up(self) -> bool:
        """Whether it is connected."""
        return self._socket is not None

    def read(self, timeout_s: float = 0.0) -> bytes:
        """What has come."""
        if self._socket is None:
            if time.monotonic() < self._tried_s + _AGAIN_S:
                time.sleep(min(timeout_s, 0.05))
                return b""
            if self._connect() is not None:
                return b""
        self._flush()
        connection = self._connected()
        if connection is None:
            return b""
        if timeout_s > 0.0:
            select.select([connection], [], [], timeout_s)
        try:
            data = connection.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def write(self, data: bytes) -> None:
        """Send; what does not go through yet waits, up to a bound."""
        if self._socket is None or len(self._backlog) > _MAX_BACKLOG_BYTES:
            return
        self._backlog += data
        self._flush()

    def _flush(self) -> None:
        if self._socket is None or not self._backlog:
            return
        try:
            self._backlog = self._backlog[self._socket.send(self._backlog) :]
        except BlockingIOError:
            return
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self._tried_s = time.monotonic()

    def close(self) -> None:
        """Close."""
        self._drop()


class TcpServer:
    """A listening TCP port; one vehicle at a time, the newest."""

    def __init__(self, address: Address) -> None:
        family, target = _resolve(address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.settimeout(0.0)
        _bind(self._listener, target, address)
        self._listener.listen(1)
        self.port: int = self._listener.getsockname()[1]
        self._peer: socket.socket | None = None

    def read(self, timeout_s: float = 0.0) -> bytes:
        """What has come."""
        waiting = [self._listener] if self._peer is None else [self._listener, self._peer]
        ready, _, _ = select.select(waiting, [], [], timeout_s)
        if self._listener in ready:
            self._accept()
        if self._peer is None or self._peer not in ready:
            return b""
        try:
            data = self._peer.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def _accept(self) -> None:
        try:
            peer, _ = self._listener.accept()
        except OSError:
            return
        if self._peer is not None:
            peer.close()  # who is connected stays: nobody else may push it off
            return
        peer.settimeout(0.0)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer = peer

    def write(self, data: bytes) -> None:
        """Send; a peer that takes nothing any more is cut off."""
        if self._peer is None:
            return
        try:
            if self._peer.send(data) != len(data):
                self._drop()
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer = None

    def close(self) -> None:
        """Close."""
        self._drop()
        self._listener.close()


def _resolve(address: Address, kind: int) -> tuple[int, Any]:
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except OSError as error:
        problem = f"unknown host: {error.strerror or error}"
        raise InputError(Fault(problem, field="--connect", value=address.host)) from None
    return found[0][0], found[0][4]


def _bind(listener: socket.socket, target: Any, address: Address) -> None:
    try:
        listener.bind(target)
    except OSError as error:
        listener.close()
        problem, remedy = f"cannot listen: {error.strerror or error}", "another program listens there"
        raise InputError(Fault(problem, field="--connect", value=str(address), remedy=remedy)) from None


def read_fd(descriptor: int, timeout_s: float) -> bytes:
    """Read a descriptor that does not block; empty for nothing."""
    if timeout_s > 0.0:
        select.select([descriptor], [], [], timeout_s)
    try:
        return os.read(descriptor, _READ_BYTES)
    except BlockingIOError:
        return b""
