"""The pad service over TCP: one JSON line a request, one a reply."""

from __future__ import annotations

import selectors
import socket
from typing import TYPE_CHECKING

from models.pad_service import (
    MAX_LINE_BYTES,
    DroneOnPad,
    PadAnswer,
    PadServiceError,
    decode_request,
    encode,
)
from sim_stub.transports.sockets import bind, resolve

if TYPE_CHECKING:
    from sim_stub.pads import Pads
    from sim_stub.transports.urls import Address

_MAX_CLIENTS = 32
_MAX_BACKLOG_BYTES = 1_000_000


def answer(pads: Pads, line: bytes) -> PadAnswer:
    """Do what a line asks for; every refusal is an answer."""
    try:
        request = decode_request(line)
        drone: DroneOnPad | None = None
        if request.op == "charge":
            drone = pads.charge(request.station, request.drone, request.to_soc)
        elif request.op == "release":
            drone = pads.release(request.station, request.drone)
        return PadAnswer(ok=True, station=pads.status(request.station), drone=drone)
    except PadServiceError as error:
        return PadAnswer(ok=False, error=str(error))


class PadClient:
    """One connected client.

    Parameters
    ----------
    connection : socket
        Connected.
    pads : Pads
        What it asks about.
    """

    def __init__(self, connection: socket.socket, pads: Pads, selector: selectors.BaseSelector) -> None:
        self.socket, self.pads, self.selector = connection, pads, selector
        self.received = b""
        self.backlog = b""
        self.closed = False
        connection.settimeout(0.0)
        selector.register(connection, selectors.EVENT_READ, self)

    def readable(self) -> None:
        """Answer the lines that are complete; a line too long ends the connection."""
        if self.closed:
            return
        try:
            data = self.socket.recv(65536)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        self.received += data
        while b"\n" in self.received:
            line, self.received = self.received.split(b"\n", 1)
            if line.strip():
                self.backlog += encode(answer(self.pads, line[: MAX_LINE_BYTES + 1]))
        if len(self.received) > MAX_LINE_BYTES:
            self.backlog += encode(PadAnswer(ok=False, error="the line is too long"))
            self.flush(0.0)
            self.close()

    def flush(self, now_s: float) -> None:  # noqa: ARG002
        """Send as much as goes."""
        if self.closed or not self.backlog:
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
        """Nothing is ever delayed."""
        return float("inf")

    def close(self) -> None:
        """Close."""
        if not self.closed:
            self.closed = True
            self.selector.unregister(self.socket)
            self.socket.close()


class PadServer:
    """The listening socket.

    Parameters
    ----------
    address : Address
        Where.
    pads : Pads
        What is served.
    """

    def __init__(self, address: Address, pads: Pads, selector: selectors.BaseSelector) -> None:
        self.pads, self.selector = pads, selector
        family, target = resolve(address, socket.SOCK_STREAM)
        self.socket = socket.socket(family, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.settimeout(0.0)
        bind(self.socket, target, address)
        self.socket.listen(_MAX_CLIENTS)
        self.where = f"tcp:{address.host}:{self.socket.getsockname()[1]}"
        self.clients: list[PadClient] = []
        selector.register(self.socket, selectors.EVENT_READ, self)

    def readable(self) -> None:
        """Accept."""
        try:
            connection, _ = self.socket.accept()
        except OSError:
            return
        self.clients = [client for client in self.clients if not client.closed]
        if len(self.clients) >= _MAX_CLIENTS:
            connection.close()
            return
        self.clients.append(PadClient(connection, self.pads, self.selector))

    def flush(self, now_s: float) -> None:
        """Send what is waiting."""
        for client in self.clients:
            client.flush(now_s)

    def next_s(self) -> float:
        """Nothing is ever delayed."""
        return float("inf")

    def close(self) -> None:
        """Close everything."""
        for client in self.clients:
            client.close()
        self.selector.unregister(self.socket)
        self.socket.close()
