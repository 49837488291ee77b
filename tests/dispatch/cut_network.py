"""A network between a client and a server that can be cut: connections stay, and nothing comes through."""

import contextlib
import re
import socket
import threading
from urllib.parse import parse_qs, urlsplit


class CutNetwork:
    """Forwards TCP connections to a PostgreSQL server on a local socket, until it is cut."""

    def __init__(self, address):
        parts = urlsplit(address)
        folder = parse_qs(parts.query)["host"][0]
        self._server = f"{folder}/.s.PGSQL.{parts.port or 5432}"
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open = threading.Event()
        self._open.set()
        self._sockets, self._threads = [], []
        port = self._listener.getsockname()[1]
        user = re.match(r"[^@]*", parts.netloc)[0] or "postgres"
        self.address = f"postgresql://{user}@127.0.0.1:{port}{parts.path}"
        self._begin(self._accept)

    def cut(self):
        self._open.clear()

    def mend(self):
        self._open.set()

    def close(self):
        self.mend()
        for one in [self._listener, *self._sockets]:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
        for one in self._threads:
            one.join()
        for one in [self._listener, *self._sockets]:
            one.close()

    def _begin(self, what, *given):
        thread = threading.Thread(target=what, args=given, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.socket(socket.AF_UNIX)
                self._sockets += [client, server]
                server.connect(self._server)
                self._begin(self._forward, client, server)
                self._begin(self._forward, server, client)

    def _forward(self, a, b):
        with contextlib.suppress(OSError):
            while data := a.recv(65536):
                self._open.wait()  # what is under way is held back, as on a network that loses it and sends it again
                b.sendall(data)
        for one in (a, b):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
