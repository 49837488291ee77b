"""Server of a player: packets to a MAVLink address, control on a socket with one JSON object per line."""

from __future__ import annotations

import selectors
import socket
import time
from typing import TYPE_CHECKING

from skyway.models.base.errors import LinkError
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from skyway.link.replay.player import Player

TICK_S = 0.02
MAX_LINE = 4096
MAX_CLIENTS = 8


class ControlServer:
    """Listens for commands on a TCP port of this machine."""

    def __init__(self, player: Player, port: int) -> None:
        self._player = player
        self._selector = selectors.DefaultSelector()
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            self._listener.close()
            raise LinkError(f"cannot listen on port {port}: {error}") from error
        self._listener.listen()
        self._listener.settimeout(0.0)
        self.port: int = self._listener.getsockname()[1]
        self._pending: dict[socket.socket, bytes] = {}
        self._selector.register(self._listener, selectors.EVENT_READ)

    def serve(self, timeout_s: float) -> None:
        """Answer the requests received within a duration."""
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._listener:
                self._accept()
            elif isinstance(key.fileobj, socket.socket):
                self._answer(key.fileobj)

    def close(self) -> None:
        """Close all sockets."""
        for client in list(self._pending):
            self._drop(client)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if len(self._pending) >= MAX_CLIENTS:
            client.close()
            return
        client.settimeout(0.0)
        self._pending[client] = b""
        self._selector.register(client, selectors.EVENT_READ)

    def _answer(self, client: socket.socket) -> None:
        try:
            data = client.recv(MAX_LINE)
        except OSError:
            data = b""
        if not data or len(self._pending[client]) > MAX_LINE:
            self._drop(client)
            return
        *lines, rest = (self._pending[client] + data).split(b"\n")
        self._pending[client] = rest
        for line in lines:
            reply = self._player.command(line.decode("utf-8", "replace"))
            try:
                client.sendall(json_text(reply).encode() + b"\n")
            except OSError:
                self._drop(client)
                return

    def _drop(self, client: socket.socket) -> None:
        self._pending.pop(client, None)
        self._selector.unregister(client)
        client.close()


def play(player: Player, control: ControlServer | None, *, hold: bool = False) -> int:
    """Play to the end on the wall clock, and with `hold` stay there for commands; returns the packets sent."""
    sent = 0
    last = time.monotonic()
    while hold or not player.ended:
        if control is None:
            time.sleep(TICK_S)
        else:
            control.serve(TICK_S)
        now = time.monotonic()
        sent += player.step(now - last)
        last = now
    return sent
