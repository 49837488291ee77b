"""Transports: UDP, TCP and serial lines; they never block longer than requested, and reconnect by themselves."""

from __future__ import annotations

import errno
import select
import socket
import time
from typing import TYPE_CHECKING, Any, Protocol

from skyway.models.base.address import bind, resolve
from skyway.models.base.errors import Fault, InputError, LinkLostError

if TYPE_CHECKING:
    from skyway.models.base.address import Address

_READ_BYTES = 65536
_AGAIN_S = 1.0
_CONNECT_S = 2.0
_MAX_ROUTES = 255
_MAX_BACKLOG_BYTES = 1_000_000
_SILENT_S = 5.0
"""A peer that has been silent for this long may be replaced by another one."""
_DEAD_MS = 10_000
"""A TCP peer that acknowledges nothing for this long is gone, for example after a power failure."""
_NOBODY = frozenset(
    {
        errno.ECONNREFUSED,
        errno.ENETUNREACH,
        errno.EHOSTUNREACH,
        errno.EHOSTDOWN,
        errno.ENETDOWN,
        errno.EADDRNOTAVAIL,
        errno.ENOBUFS,
        errno.EPERM,
    }
)
"""Errors of UDP to a port without a listener, or while the network is down; packets are lost, as on radios."""


class Transport(Protocol):
    """Bytes in and out."""

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Return received data, at the latest after the time-out; empty if there are none."""
        ...

    def write(self, data: bytes) -> None:
        """Send one frame; on a link that is down it is lost."""
        ...

    def close(self) -> None:
        """Close."""
        ...


def open_transport(address: Address) -> Transport:
    """Open the transport that a connection string names.

    Raises an `InputError` if the address is taken or unknown, or if the device cannot be opened; a `LinkLostError`
    if there is no answer.
    """
    if address.kind == "serial":
        try:
            from skyway.link.wire.serial_line import SerialLine
        except ImportError:
            problem, remedy = "serial lines need Linux or macOS", "bridge it to udp: or tcp:"
            raise InputError(Fault(problem, field="--connect", value=str(address), remedy=remedy)) from None
        return SerialLine(address)
    if address.kind == "tcp":
        return TcpClient(address)
    if address.kind == "tcpin":
        return TcpServer(address)
    return UdpSocket(address)


class UdpSocket:
    """UDP: `udpout` sends first to one address, `udpin` answers its senders."""

    def __init__(self, address: Address) -> None:
        family, target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(0.0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        self._target: Any = None if address.listens else target
        self._routes: dict[int, tuple[Any, float]] = {}
        self._sender: Any = None
        if address.listens:
            bind(self._socket, target, address)
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
                raise LinkLostError(f"the connection failed: {error.strerror or error}") from error
            if self._target is None or self._sender[:2] == self._target[:2]:
                return data
        return b""

    def learn(self, system: int, *, proven: bool = False) -> bool:
        """Record that the last datagram came from that vehicle, proven by its signature or only claimed.

        Returns False if that vehicle currently uses another address: then the sender is another station.
        """
        if self._target is not None:
            return True
        known, now = self._routes.get(system), time.monotonic()
        if known is None and len(self._routes) >= _MAX_ROUTES:
            return False
        if known is not None and known[0] != self._sender and not proven and now <= known[1] + _SILENT_S:
            return False
        self._routes[system] = (self._sender, now)
        return True

    def forget(self, system: int) -> None:
        """Forget the address of a vehicle."""
        self._routes.pop(system, None)

    def write_to(self, system: int, data: bytes) -> None:
        """Send towards one vehicle, or to all if its address is unknown."""
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
                raise LinkLostError(f"the connection failed: {error.strerror or error}") from error

    def close(self) -> None:
        """Close."""
        self._socket.close()


class _Stream:
    """One TCP connection, or none at present."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None

    def _receive(self) -> bytes:
        """Received data; a connection that has ended is dropped."""
        if self._socket is None:
            return b""
        try:
            data = self._socket.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class TcpClient(_Stream):
    """TCP to one address; tries again every second after the other side has gone.

    Raises a `LinkLostError` if there is no listener at the start.
    """

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._dialled: socket.socket | None = None
        self._backlog = b""
        try:
            made = socket.create_connection((address.host, address.port), timeout=_CONNECT_S)
        except OSError as error:
            problem = f"cannot connect to {address}: {error.strerror or error}; is the vehicle on?"
            raise LinkLostError(problem) from error
        self._family, self._there = made.family, made.getpeername()
        self._dialled_s = 0.0
        self._take(made)

    def _take(self, made: socket.socket) -> None:
        _prepare(made)
        self._socket, self._dialled, self._backlog = made, None, b""

    @property
    def up(self) -> bool:
        """Whether it is connected."""
        return self._socket is not None

    def _dial(self, timeout_s: float) -> None:
        """Reconnect, without blocking for longer than requested."""
        now = time.monotonic()
        if self._dialled is None:
            if now < self._dialled_s + _AGAIN_S:
                time.sleep(min(timeout_s, self._dialled_s + _AGAIN_S - now))
                return
            self._dialled_s = now
            self._dialled = socket.socket(self._family, socket.SOCK_STREAM)
            self._dialled.settimeout(0.0)
            self._dialled.connect_ex(self._there)
        _, ready, _ = select.select([], [self._dialled], [], timeout_s)
        if ready and self._dialled.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0:
            self._take(self._dialled)
        elif ready or now > self._dialled_s + _CONNECT_S:
            self._dialled.close()
            self._dialled = None

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Bytes received."""
        if self._socket is None:
            self._dial(timeout_s)
            return b""
        self._flush()
        if self._socket is not None and timeout_s > 0.0:
            select.select([self._socket], [], [], timeout_s)
        return self._receive()

    def write(self, data: bytes) -> None:
        """Send; data that cannot be sent yet wait, up to a bound."""
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
        super()._drop()
        self._dialled_s = time.monotonic()

    def close(self) -> None:
        """Close."""
        self._drop()
        if self._dialled is not None:
            self._dialled.close()


class TcpServer(_Stream):
    """A listening TCP port; one vehicle at a time, which no other connection can displace while it sends."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        family, target = resolve(address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.settimeout(0.0)
        bind(self._listener, target, address)
        self._listener.listen(1)
        self.port: int = self._listener.getsockname()[1]
        self._heard_s = 0.0

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Bytes received."""
        waiting = [self._listener] if self._socket is None else [self._listener, self._socket]
        ready, _, _ = select.select(waiting, [], [], timeout_s)
        data = b""
        if self._socket in ready:
            data, self._heard_s = self._receive(), time.monotonic()
        if self._listener in ready:
            self._accept()
        return data

    def _accept(self) -> None:
        try:
            peer, _ = self._listener.accept()
        except OSError:
            return
        if self._socket is not None and time.monotonic() < self._heard_s + _SILENT_S:
            peer.close()
            return
        self._drop()
        _prepare(peer)
        self._socket, self._heard_s = peer, time.monotonic()

    def write(self, data: bytes) -> None:
        """Send; a peer that stops reading is disconnected."""
        if self._socket is None:
            return
        try:
            if self._socket.send(data) != len(data):
                self._drop()
        except OSError:
            self._drop()

    def close(self) -> None:
        """Close."""
        self._drop()
        self._listener.close()


def _prepare(stream: socket.socket) -> None:
    stream.settimeout(0.0)
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux; elsewhere the system's own, longer time
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_MS)
