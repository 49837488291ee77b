"""A network between clients and a PostgreSQL server that can be interrupted: connections stay open, and no data pass."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from collections.abc import Callable


class CutNetwork:
    """Forwards TCP connections to a PostgreSQL server on a local socket, until it is interrupted.

    Attributes
    ----------
    address : str
        Address of the server through this network.
    """

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        folder = parse_qs(parts.query)["host"][0]
        self._server = f"{folder}/.s.PGSQL.{parts.port or 5432}"
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open = threading.Event()
        self._open.set()
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        port = self._listener.getsockname()[1]
        user = re.match(r"[^@]*", parts.netloc)
        self.address = f"postgresql://{user[0] if user and user[0] else 'postgres'}@127.0.0.1:{port}{parts.path}"
        self._begin(self._accept)

    def cut(self) -> None:
        """Stop forwarding."""
        self._open.clear()

    def mend(self) -> None:
        """Forward the withheld data, and resume forwarding."""
        self._open.set()

    def close(self) -> None:
        """End all connections."""
        self.mend()
        for one in [self._listener, *self._sockets]:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for one in [self._listener, *self._sockets]:
            one.close()

    def _begin(self, what: Callable[..., None], *given: socket.socket) -> None:
        thread = threading.Thread(target=what, args=given, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.socket(socket.AF_UNIX)
                self._sockets += [client, server]
                try:
                    server.connect(self._server)
                except OSError:  # the server is unavailable: the client is disconnected
                    client.close()
                    continue
                self._begin(self._forward, client, server)
                self._begin(self._forward, server, client)

    def _forward(self, a: socket.socket, b: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := a.recv(65536):
                self._open.wait()  # data in transit are withheld, as on a network that loses and retransmits them
                b.sendall(data)
        for one in (a, b):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
